"""The numba backend: generated Python compiled to machine code, integrated by our own loops."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any, ClassVar, final

import llvmlite
import numba
import numpy as np
from numba import types

from ... import __version__
from ...integrators.digest import integrator_digest
from ...integrators.problem import IntegrationProblem, Kernels, Solution
from ...integrators.tableaus import TABLEAUS
from ...ir.program import Program
from ...runtime.cache import load_from_disk, load_in_memory
from ..base import Backend, Engine, FloatArray, RenderedModule
from ..printers import PYTHON
from ..rendering import digest_of, render_source

__all__ = ["NumbaBackend"]

_VECTOR = types.float64[::1]
SIGNATURE = types.void(types.float64, _VECTOR, _VECTOR, _VECTOR)
OPTIONS = 'cache={}, nogil=True, error_model="numpy", fastmath={{"contract"}}'
_NEEDED = ("rhs", "project_position", "project_velocity")


@final
class NumbaEngine(Engine):
    """Kernels of a module compiled by numba; those that integrators call are compiled when loaded, others when used."""

    def __init__(self, program: Program, module: ModuleType) -> None:
        self._sizes = {kernel.name: len(kernel.outputs) for kernel in program}
        self._module = module
        for name in _NEEDED:
            if name in program:
                self._compiled(name)

    def _compiled(self, name: str) -> Any:
        kernel = getattr(self._module, name)
        if not kernel.signatures:
            kernel.compile(SIGNATURE)
        return kernel

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`."""
        out = np.empty((len(y), self._sizes[kernel]))
        function = self._compiled(kernel)
        for i in range(len(y)):
            function(t[i], y[i], c, out[i])
        return out

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        from ...integrators.numba.explicit import integrate

        tableau = next(tableau for tableau in TABLEAUS if tableau.name == method)
        projections = [self._compiled(name) if name in self._sizes else None for name in _NEEDED[1:]]
        return integrate(Kernels(self._compiled("rhs"), *projections), tableau, problem)


@final
class NumbaBackend(Backend):
    """The default backend."""

    name = "numba"
    methods: ClassVar[Mapping[str, str]] = {
        "dop853": "explicit Runge-Kutta of order 8 (Hairer, Norsett and Wanner)",
        "tsit5": "explicit Runge-Kutta of order 5 (Tsitouras)",
    }

    def render(self, program: Program, *, cache: bool) -> RenderedModule:
        """See `Backend.render`."""
        source = render_source("numba.py.j2", program, PYTHON, OPTIONS.format(cache))
        versions = f"{__version__} {sys.version_info[:3]} {numba.__version__} {llvmlite.__version__}"
        return RenderedModule(self.name, program, source, digest_of(self.name, versions, integrator_digest(), source))

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`."""
        program = rendered.program
        if not cache:
            return NumbaEngine(program, load_in_memory(rendered.digest, rendered.source))
        return load_from_disk(
            program.name, rendered.digest, rendered.source, lambda module: NumbaEngine(program, module)
        )
