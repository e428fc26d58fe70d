"""The plain reference: generated Python on the ``math`` module, integrated by SciPy. Nothing is compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, final

import numpy as np

from ... import __version__
from ...integrators.problem import IntegrationProblem, Kernels, Solution
from ...ir.program import Program
from ...runtime.cache import load_in_memory
from ..base import Backend, Engine, FloatArray, RenderedModule
from ..printers import NUMPY
from ..rendering import digest_of, render_source

__all__ = ["NumpyBackend"]


def _filling(
    kernel: Callable[..., tuple[float, ...]],
) -> Callable[[float, FloatArray, FloatArray, FloatArray], None]:
    """Return a kernel that writes into an array."""

    def fill(t: float, y: FloatArray, c: FloatArray, out: FloatArray) -> None:
        out[:] = kernel(t, y.tolist(), c.tolist())

    return fill


@final
class NumpyEngine(Engine):
    """Kernels of a module of plain Python."""

    def __init__(self, program: Program, namespace: dict[str, Any]) -> None:
        self._sizes = {kernel.name: len(kernel.outputs) for kernel in program}
        self._kernels = {name: _filling(namespace[name]) for name in self._sizes if name != "prepare"}

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`."""
        out = np.empty((len(y), self._sizes[kernel]))
        function = self._kernels[kernel]
        for i in range(len(y)):
            function(float(t[i]), y[i], c, out[i])
        return out

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        from ...integrators.scipy.solvers import integrate

        return integrate(self._stepped(), method, problem)

    def stretches(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.stretches`: one step each."""
        from ...integrators.scipy.solvers import stretches

        return stretches(self._stepped(), method, problem)

    def _stepped(self) -> Kernels:
        named = self._kernels
        return Kernels(named["rhs"], named.get("project_position"), named.get("project_velocity"))


@final
class NumpyBackend(Backend):
    """Reference backend: slow, simple, and what every other backend is tested against."""

    name = "numpy"
    methods: ClassVar[Mapping[str, str]] = {
        "dop853": "explicit Runge-Kutta of order 8 (SciPy)",
        "rk45": "explicit Runge-Kutta of order 5 (SciPy)",
        "radau": "implicit Runge-Kutta of order 5, for stiff scenes (SciPy)",
        "bdf": "backward differentiation, for stiff scenes (SciPy)",
        "lsoda": "Adams or backward differentiation, chosen on the way (SciPy)",
    }

    def render(self, program: Program, *, cache: bool) -> RenderedModule:
        """See `Backend.render`."""
        source = render_source("numpy.py.j2", program, NUMPY)
        return RenderedModule(self.name, program, source, digest_of(self.name, __version__, source))

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`; there is nothing worth keeping on disk."""
        module = load_in_memory(rendered.digest, rendered.source)
        return NumpyEngine(rendered.program, module.__dict__)
