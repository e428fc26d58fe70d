"""The numpy backend: generated Python on the ``math`` module, integrated by SciPy, without compilation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, final

import numpy as np

from ...arrays import FloatArray
from ...ir.interpret import interpret, interpret_rows
from ...ir.program import Program
from ...once import computed_once
from ...steps.method_choice import fitting
from ...steps.problem import IntegrationProblem, Kernels, Solution
from ...transforms.partials import jacobian_kernel
from ...version import __version__
from ..base import Backend, RenderedModule
from ..cache import digest_of, load_in_memory
from ..engine import Engine
from ..printers import NUMPY
from ..rendering import program_variables, render
from .methods import IMPLICIT, METHODS

ArrayKernel = Callable[[float, FloatArray, FloatArray, FloatArray], None]


def _filling(
    kernel: Callable[..., Sequence[float]],
) -> ArrayKernel:
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
        self._program = program
        self._jacobians: dict[str, ArrayKernel] = {}

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`."""
        out = np.empty((len(y), self._sizes[kernel]))
        function = self._kernels[kernel]
        for i in range(len(y)):
            function(float(t[i]), y[i], c, out[i])
        return out

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        from .solvers import integrate

        problem = problem.with_components(self._program.layout.state)
        if "stages" in self._kernels:
            return self._integrate_stages(problem)
        return integrate(self._stepped(method), method, problem)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`: one step each; of equations in stages, the whole run."""
        from .solvers import step_blocks

        if "stages" in self._kernels:
            return super().step_blocks(problem, method)
        return step_blocks(self._stepped(method), method, problem.with_components(self._program.layout.state))

    def _stepped(self, method: str) -> Kernels:
        named = self._kernels
        jacobian = self._derivative("rhs") if method in IMPLICIT else None
        projections = named.get("project_position"), named.get("project_velocity")
        tables = self._program.stops_at_tables
        return Kernels(named["rhs"], *projections, jacobian, named.get("knots"), tables)

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """See `Engine.integrate_automatic`: decided before the run, at little cost."""
        method, why = self.fit(problem, method)
        return self.integrate(problem, method), method, why

    def fit(self, problem: IntegrationProblem, method: str) -> tuple[str, str]:
        """See `Engine.fit`."""
        rhs = self._program.kernel("rhs")

        def rates(t: FloatArray, y: FloatArray) -> FloatArray:
            return interpret_rows(rhs, t, y, problem.constants)

        return fitting(problem, method, rates, self.integrate, len(rhs.body))

    def _integrate_stages(self, problem: IntegrationProblem) -> Solution:
        from .index2_reference import integrate

        c, n = problem.constants, self._sizes["stages"]

        def function(kernel: ArrayKernel, size: int) -> Callable[[float, FloatArray], FloatArray]:
            def call(t: float, y: FloatArray) -> FloatArray:
                out = np.empty(size)
                kernel(t, y, c, out)
                return out

            return call

        jacobian = function(self._derivative("stages"), n * n)
        start = function(self._kernels["multipliers"], self._sizes["multipliers"])(problem.t0, problem.y0)
        rhs = function(self._kernels["stages"], n)
        return integrate(rhs, lambda t, y: jacobian(t, y).reshape(n, n), problem, start)

    def _derivative(self, name: str) -> ArrayKernel:
        """Return the Jacobian of a kernel by its state, made on first use."""
        kernel = self._program.kernel(name)

        def make() -> ArrayKernel:
            made = jacobian_kernel(kernel, len(kernel.outputs), exact=False)
            return _filling(lambda t, y, c: interpret(made, {"t": t, "y": y, "c": c}))

        return computed_once(self._jacobians, name, make)


@final
class NumpyBackend(Backend):
    """Reference backend: slow and simple; every other backend is tested against it."""

    name = "numpy"
    for_stages = ("radau",)

    @property
    def methods(self) -> Mapping[str, str]:
        """See `Backend.methods`: SciPy's."""
        return {name: method.description for name, method in METHODS.items()}

    def render(self, program: Program) -> RenderedModule:
        """See `Backend.render`."""
        source = render("numpy/module.py.j2", program_variables(program, NUMPY))
        return RenderedModule(self.name, program, lambda: source, digest_of(self.name, __version__, source))

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`; nothing is kept on disk."""
        module = load_in_memory(rendered.digest, rendered.source)
        return NumpyEngine(rendered.program, module.__dict__)
