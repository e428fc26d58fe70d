"""The numba backend: a generated module of Python, compiled by numba and called by compiled integrator loops."""

from __future__ import annotations

from pathlib import Path
from typing import final

from ...ir.program import Program
from ..base import Capability
from ..compiled_backend import CompiledBackend
from .library import NumbaLibrary
from .objects import numba_version

__all__ = ["NumbaBackend"]


@final
class NumbaBackend(CompiledBackend):
    """Kernels that numba compiles, one case at a time, for the same integrator loops as the default backend's."""

    name = "numba"
    capabilities = frozenset({Capability.KERNEL_FUNCTIONS})

    def versions(self) -> str:
        """See `CompiledBackend.versions`."""
        return f"{super().versions()} {numba_version()}"

    def library(self, program: Program, folder: Path | None) -> NumbaLibrary:
        """See `CompiledBackend.library`."""
        return NumbaLibrary(program, folder)
