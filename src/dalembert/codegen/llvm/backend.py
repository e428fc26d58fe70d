"""The LLVM backend: kernels and steps as LLVM assembly, compiled by llvmlite and called by compiled integrator loops.

Every kernel, step and projection is a module of assembly of its own (`dalembert.codegen.llvm.assembly`), compiled when
it is first needed, for one lane or as many as a vector register has.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, final

from ...ir.program import Program
from ..base import Backend, Engine, RenderedModule
from ..cache import digest_of, module_folder
from ..compiled_engine import METHODS, CompiledEngine, default_source
from ..generator_digest import generator_digest
from .loops import toolchain
from .steps import StepLibrary
from .target import target

__all__ = ["LLVMBackend"]


@final
class LLVMBackend(Backend):
    """The default backend."""

    name = "llvm"
    for_stages = ("radau",)
    series = ("taylor",)
    methods: ClassVar[Mapping[str, str]] = METHODS

    def render(self, program: Program, *, cache: bool) -> RenderedModule:
        """See `Backend.render`."""
        target()  # one that does not serve is refused before anything is made for it
        digest = digest_of(self.name, toolchain(), generator_digest(), program.name, "\n".join(map(str, program)))

        def write() -> str:
            return default_source(program, StepLibrary(program, None), self.serving(program))

        return RenderedModule(self.name, program, write, digest)

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`."""
        program = rendered.program
        folder = module_folder(program.name, rendered.digest) if cache else None
        return CompiledEngine(program, StepLibrary(program, folder))
