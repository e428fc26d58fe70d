"""The LLVM backend: kernels and steps as LLVM assembly, compiled by llvmlite and called by compiled integrator loops.

Every kernel, step and projection is a module of assembly of its own (`dalembert.codegen.llvm.assembly`), compiled when
it is first needed, for one lane or as many as a vector register has.
"""

from __future__ import annotations

from pathlib import Path
from typing import final

from ...ir.program import Program
from ..compiled_backend import CompiledBackend
from .library import LLVMLibrary

__all__ = ["LLVMBackend"]


@final
class LLVMBackend(CompiledBackend):
    """The default backend."""

    name = "llvm"

    def library(self, program: Program, folder: Path | None) -> LLVMLibrary:
        """See `CompiledBackend.library`."""
        return LLVMLibrary(program, folder)
