"""Backends that compile kernels to machine code: rendering and loading."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path

from ..ir.program import Program
from ..methods.names import PAIRS
from .base import Backend, RenderedModule
from .cache import digest_of, module_folder
from .compiled_engine import CompiledEngine, default_source
from .engine import Engine
from .library import KernelLibrary
from .llvm.loops import toolchain
from .llvm.target import target
from .rendering import generator_digest

_TAYLOR = "Taylor series of an order chosen by the tolerance (Jorba and Zou)"
_RADAU = "implicit Runge-Kutta of order 5, for stiff scenes (Radau IIA; Hairer and Wanner)"


class CompiledBackend(Backend):
    """A backend whose kernels are machine code, which compiled integrator loops call."""

    for_stages = ("radau",)
    series = ("taylor",)

    @property
    def methods(self) -> Mapping[str, str]:
        """See `Backend.methods`: Taylor steps, the pairs, and the implicit method."""
        pairs = {name: pair.description for name, pair in PAIRS.items()}
        return {"taylor": _TAYLOR, **pairs, "radau": _RADAU}

    @abstractmethod
    def library(self, program: Program, folder: Path | None) -> KernelLibrary:
        """Return the library of a program; compiled code is kept in `folder`, None keeps nothing."""

    def versions(self) -> str:
        """Return the versions that compiled kernels depend on."""
        return toolchain()

    def render(self, program: Program) -> RenderedModule:
        """See `Backend.render`; the text is printed on demand, because nothing runs it as a whole."""
        target()  # a library that does not support the program is rejected first
        kernels = "\n".join(map(str, program))
        digest = digest_of(self.name, self.versions(), generator_digest(), program.name, kernels)

        def write() -> str:
            return default_source(program, self.library(program, None), self.serving(program))

        return RenderedModule(self.name, program, write, digest)

    def load(self, rendered: RenderedModule, *, cache: bool) -> Engine:
        """See `Backend.load`."""
        program = rendered.program
        folder = module_folder(program.name, rendered.digest) if cache else None
        return CompiledEngine(program, self.library(program, folder))
