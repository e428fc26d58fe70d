"""The numba backend: a generated module of Python, compiled by numba and called by compiled integrator loops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, final

from ...ir.program import Program
from ..base import Backend, Engine, RenderedModule
from ..cache import digest_of, module_folder
from ..compiled_engine import METHODS, CompiledEngine, default_source
from ..generator_digest import generator_digest
from ..llvm.loops import toolchain
from ..llvm.target import target
from .library import NumbaLibrary
from .objects import numba_version

__all__ = ["NumbaBackend"]


@final
class NumbaBackend(Backend):
    """Kernels that numba compiles, one case at a time, for the same integrator loops as the default backend's."""

    name = "numba"
    for_stages = ("radau",)
    series = ("taylor",)
    methods: ClassVar[Mapping[str, str]] = METHODS

    def render(self, program: Program, *, cache: bool) -> RenderedModule:
        """See `Backend.render`."""
        target()  # one that does not serve is refused before anything is made for it
        parts = (toolchain(), numba_version(), generator_digest(), program.name, repr(program.kernels))

        def write() -> str:
            return default_source(program, NumbaLibrary(program, None), self.serving(program))

        return RenderedModule(self.name, program, write, digest_of(self.name, *parts))

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`."""
        program = rendered.program
        folder = module_folder(program.name, rendered.digest) if cache else None
        return CompiledEngine(program, NumbaLibrary(program, folder))
