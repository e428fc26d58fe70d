"""Kernels and steps of one program as LLVM assembly and machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from ...ir.kernel import Kernel
from ...methods.tableau import Tableau
from ...transforms.recurrences import Recurrences
from ...transforms.taylor import step_kernel
from ..library import Code, KernelLibrary
from ..rendering import banner_lines, render
from .assembly import Shape, assembly, load_object
from .attempts import attempt_assembly
from .lane_types import native_lanes
from .objects import object_code
from .order_loops import LEAST_ORDER, order_loop_assembly
from .series_loops import series_loop_assembly
from .tables import with_tables

__all__ = ["LLVMLibrary"]

_LARGEST_STRAIGHT = 1000
"""Lines up to which a step is unrolled. Longer code outgrows the cache of instructions: the loop over the orders is up
to twice as fast, and is compiled in a third of the time or less (measured on spheres and sleighs)."""
_LARGEST_PASS = 500
"""Values up to which one pass of the loop over the orders is straight-line code: it takes a second to compile there,
and ever more beyond, and is twice as fast as loops throughout (measured on chains of pendulums)."""
_ONCE = "watch_begins"
"""Kernel that runs at starts of phases alone (`dalembert.reduction.event_functions`)."""


@final
class LLVMLibrary(KernelLibrary):
    """Kernels and steps of one program, as LLVM assembly for any number of lanes."""

    compiles_starts = True

    @property
    def lanes(self) -> int:
        """See `KernelLibrary.lanes`: as many as a vector register holds."""
        return native_lanes()

    def source(self, method: str, order: int) -> str:
        """See `KernelLibrary.source`: the assembly, module after module, below a comment that says of what."""
        banner = render("llvm/banner.ll.j2", {"banner": banner_lines(self._program)})
        kernels = ["prepare", "project_position", "project_velocity"]
        texts = []
        if method == "taylor":
            texts.append(self._taylor_text(order, 1, True))
        elif method == "radau":
            rates = "stages" if "stages" in self._program else "rhs"
            kernels.insert(1, rates)
            texts.append(self._derivative_text(rates))
        else:
            kernels.insert(1, "rhs")
        return "\n".join([banner, *(self._program_text(name, 1) for name in kernels if name in self._program), *texts])

    def kernel_text(self, name: str, kernel: Kernel, lanes: int, *, exact: bool = False) -> str:
        """See `KernelLibrary.kernel_text`."""
        return with_tables(assembly([(name, kernel)], lanes, exact=exact))

    def step_text(self, name: str, known: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
        """See `KernelLibrary.step_text`: unrolled if short, else with loops, and the longest with little else."""
        return with_tables(self._step_text(name, known, order, lanes, dense))

    def _step_text(self, name: str, known: Recurrences, order: int, lanes: int, dense: bool) -> str:
        if known.unrolled_lines(order) <= _LARGEST_STRAIGHT or order < LEAST_ORDER:
            return assembly([(name, step_kernel(known, order, dense=dense))], lanes)
        if len(known.items) <= _LARGEST_PASS:
            return order_loop_assembly(name, known, order, lanes, native_lanes(), dense=dense)
        return series_loop_assembly(name, known, order, lanes, dense=dense)

    def attempt_text(self, tableau: Tableau, lanes: int, *, dense: bool) -> str:
        """See `KernelLibrary.attempt_text`."""
        rhs, knots = self._program.kernel("rhs"), self.knots
        return with_tables(attempt_assembly(rhs, tableau, lanes, dense=dense, carried=self.carried, knots=knots))

    def _load(self, name: str, lanes: int, text: Callable[[], str], functions: tuple[str, ...]) -> Code:
        """See `KernelLibrary._load`."""
        shape: Shape = "once" if name.startswith(_ONCE) else "straight"
        return load_object(object_code(self.folder, f"{name}_{lanes}", text, shape))
