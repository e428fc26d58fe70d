"""The numba backend: a generated module of Python, compiled by numba and called by compiled integrator loops."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import final

from ...ir.kernel import Kernel
from ...ir.program import Program
from ...methods.tableau import Tableau
from ...once import once_property
from ...transforms.taylor.recurrences import Recurrences
from ..base import Capability
from ..cache import digest_of, load_in_memory
from ..compiled_backend import CompiledBackend
from ..library import Code, KernelLibrary
from . import texts
from .objects import load_functions, numba_version

# Kernels and steps of one program as modules of Python that numba compiles.


@final
class NumbaLibrary(KernelLibrary):
    """Kernels and steps of one program, printed as Python and compiled by numba, one case at a time."""

    @property
    def lanes(self) -> int:
        """See `KernelLibrary.lanes`."""
        return 1

    def source(self, method: str, order: int) -> str:
        """See `KernelLibrary.source`: the module of all kernels of the program, and what the method needs besides."""
        return texts.module(self._program, self._method_texts(method, order))

    def _method_texts(self, method: str, order: int) -> list[str]:
        if method == "taylor":
            return [self._taylor_text(order, 1, True, False)]
        if method == "radau":
            return [self._derivative_text("stages" if "stages" in self._program else "rhs", 1)]
        return []

    @once_property
    def _module(self) -> str:
        return texts.module(self._program)

    @once_property
    def functions(self) -> SimpleNamespace:
        """See `KernelLibrary.functions`."""
        from .kept_kernels import keep_compiled
        from .objects import configure_numba

        configure_numba()
        module = load_in_memory(digest_of("numba", self._module), self._module, named=True)
        kernels = {kernel.name: getattr(module, kernel.name) for kernel in self._program}
        if self.folder is not None:
            for kernel in kernels.values():
                keep_compiled(kernel, self.folder)
        return SimpleNamespace(**kernels)

    def kernel_text(self, name: str, kernel: Kernel, lanes: int, *, exact: bool = False) -> str:
        """See `KernelLibrary.kernel_text`; sines and cosines are always those of the C library."""
        return texts.kernel(name, kernel, lanes)

    def step_text(self, name: str, known: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
        """See `KernelLibrary.step_text`."""
        assert lanes == 1
        return texts.taylor_step(name, known, order, dense=dense)

    def attempt_text(self, tableau: Tableau, lanes: int, *, dense: bool, weighted: bool) -> str:
        """See `KernelLibrary.attempt_text`."""
        assert lanes == 1
        rhs, about = self._program.kernel("rhs"), {"dense": dense, "carried": self.carried, "weighted": weighted}
        return texts.attempt(rhs, tableau, knots=self.knots, **about)

    def _program_text(self, name: str, lanes: int) -> str:
        """See `KernelLibrary._program_text`."""
        assert lanes == 1
        return texts.program_kernel(self._program, name)

    def _load(self, name: str, lanes: int, text: Callable[[], str], functions: tuple[str, ...]) -> Code:
        """See `KernelLibrary._load`."""
        return load_functions(self.folder, f"{name}_{lanes}", text, functions)


@final
class NumbaBackend(CompiledBackend):
    """Kernels that numba compiles, one case at a time, for the same integrator loops as the default backend's."""

    name = "numba"
    largest = 5_000
    capabilities = frozenset({Capability.KERNEL_FUNCTIONS})

    def versions(self) -> str:
        """See `CompiledBackend.versions`."""
        return f"{super().versions()} {numba_version()}"

    def library(self, program: Program, folder: Path | None) -> NumbaLibrary:
        """See `CompiledBackend.library`."""
        return NumbaLibrary(program, folder)
