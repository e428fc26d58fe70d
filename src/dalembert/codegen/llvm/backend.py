"""The LLVM backend: kernels and steps as LLVM assembly, compiled by llvmlite and called by compiled integrator loops.

Every kernel, step and projection is a module of assembly of its own (`dalembert.codegen.llvm.assembly`), compiled when
it is first needed, for one lane or as many as a vector register has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, final

from ...ir.kernel import Kernel
from ...ir.program import Program
from ...methods.tableau import Tableau
from ...subset.arguments import OwnedAddress
from ...transforms.runge_kutta import AttemptPieces, attempt_kernel, attempt_pieces, start_kernel, start_pieces
from ...transforms.taylor.order_pass import LEAST_ORDER
from ...transforms.taylor.recurrences import Recurrences
from ...transforms.taylor.step import paired_step, step_kernel
from ..compiled_backend import CompiledBackend
from ..library import Code, KernelLibrary
from ..rendering import banner_lines, render
from .assembly import Shape, assembly, kernel_functions, load_object, object_code, piece_calls, stack_alignment
from .definitions import with_definitions
from .order_loops import order_loop_assembly
from .series_loops import series_loop_assembly
from .target import native_lanes, vector
from .vector_functions import prelude_variables

# Attempts of Runge-Kutta steps in assembly: straight-line code, or calls where that is too long.

LARGEST_INLINED = 1000
"""Operations of all evaluations of the right-hand side together, above which it is called instead of repeated. Below,
repeating it saves some 5% of the time of an attempt; above, calls are as fast and compile up to seven times faster
(measured on chains of pendulums)."""


def attempt_assembly(
    rhs: Kernel,
    tableau: Tableau,
    lanes: int,
    *,
    dense: bool,
    carried: bool,
    inline: bool | None = None,
    knots: Kernel | None = None,
    weighted: bool = False,
) -> str:
    """Return a module with the functions ``attempt`` and ``start`` of `dalembert.transforms.runge_kutta`.

    `inline` says whether the right-hand side is repeated once a stage; by default, its length decides. Steps end at
    `knots` of tables. Where `weighted`, each component of the state has an absolute tolerance of its own.
    """
    if inline is None:
        inline = len(rhs.body) * (tableau.n_total if dense else tableau.end + 1) <= LARGEST_INLINED
    if inline:
        attempt = attempt_kernel(rhs, tableau, dense=dense, carried=carried, knots=knots, weighted=weighted)
        start = start_kernel(rhs, tableau, carried=carried, weighted=weighted)
        return assembly([("attempt", attempt), ("start", start)], lanes)
    pieces = attempt_pieces(rhs, tableau, dense=dense, carried=carried, knots=knots, weighted=weighted)
    return _calls_assembly((pieces, start_pieces(rhs, tableau, carried=carried, weighted=weighted)), lanes)


def _calls_assembly(parts: Sequence[AttemptPieces], lanes: int) -> str:
    """Return a module of functions that call a right-hand side."""
    kernels = [parts[0].rhs, *(kernel for pieces in parts for _, kernel in pieces.stages)]
    kernels += [pieces.finish for pieces in parts]
    kernels += [pieces.knots for pieces in parts if pieces.knots is not None]
    printed = [kernel_functions(kernel.name, kernel, lanes) for kernel in kernels]
    variables = {
        "prelude": prelude_variables(lanes),
        "vector": vector(lanes),
        "kernels": [function for functions in printed for function in functions.straight],
        "stack_alignment": stack_alignment(lanes),
        "chains": [_chain_variables(pieces, len(pieces.rhs.outputs)) for pieces in parts],
    }
    return render("llvm/attempt_calls.ll.j2", variables) + piece_calls(printed)


def _chain_variables(pieces: AttemptPieces, n: int) -> dict[str, Any]:
    """Return names and sizes of the function that calls the pieces in turn; `n` is the length of the state."""
    clock = len(pieces.moved)
    return {
        "name": pieces.name,
        "rhs": pieces.rhs.name,
        "finish": pieces.finish.name,
        "held": pieces.held,
        "limits": [] if pieces.knots is None else [{"name": pieces.knots.name, "place": pieces.slopes}],
        "point": clock + 1,
        "clock": clock,
        "stages": [{"name": kernel.name, "number": stage, "place": stage * n} for stage, kernel in pieces.stages],
    }


# Kernels and steps of one program as LLVM assembly and machine code.

_LARGEST_STRAIGHT, _LARGEST_PAIRED = 2000, 3600
"""Lines up to which a step is unrolled: in lanes, and on one lane, where operations go in pairs. Longer code outgrows
the cache of instructions: the loop over the orders is up to 2.8 times as fast, and is compiled in a third of the time
or less. Below, steps in pairs take 0.75 of its time by the median, mostly 0.57 to 1.1 (`benchmarks/step_forms.py`)."""
_LARGEST_PASS = 500
"""Values up to which one pass of the loop over the orders is straight-line code: it takes a second to compile there,
and ever more beyond, and is twice as fast as loops throughout (measured on chains of pendulums)."""
_ONCE = ("watch_begins", "start_", "contact_data")
"""Beginnings of the names of kernels that run at starts of phases alone, once or twice each."""


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
            texts.append(self._taylor_text(order, 1, True, False))
        elif method == "radau":
            rates = "stages" if "stages" in self._program else "rhs"
            kernels.insert(1, rates)
            texts.append(self._derivative_text(rates, 1))
        else:
            kernels.insert(1, "rhs")
        return "\n".join([banner, *(self._program_text(name, 1) for name in kernels if name in self._program), *texts])

    def kernel_text(self, name: str, kernel: Kernel, lanes: int, *, exact: bool = False) -> str:
        """See `KernelLibrary.kernel_text`."""
        return with_definitions(assembly([(name, kernel)], lanes, exact=exact))

    def step_text(self, name: str, known: Recurrences, order: int, lanes: int, *, dense: bool) -> str:
        """See `KernelLibrary.step_text`: unrolled if short, else with loops, and the longest with little else."""
        return with_definitions(self._step_text(name, known, order, lanes, dense))

    def _step_text(self, name: str, known: Recurrences, order: int, lanes: int, dense: bool) -> str:
        largest = _LARGEST_PAIRED if lanes == 1 else _LARGEST_STRAIGHT
        if known.unrolled_lines(order) <= largest or order < LEAST_ORDER:
            if lanes > 1:
                return assembly([(name, step_kernel(known, order, dense=dense))], lanes)
            kernel, pairs = paired_step(known, order, dense=dense)
            return assembly([(name, kernel)], lanes, pairs=pairs)
        if len(known.items) <= _LARGEST_PASS:
            return order_loop_assembly(name, known, order, lanes, native_lanes(), dense=dense)
        return series_loop_assembly(name, known, order, lanes, dense=dense)

    def attempt_text(self, tableau: Tableau, lanes: int, *, dense: bool, weighted: bool) -> str:
        """See `KernelLibrary.attempt_text`."""
        rhs, about = self._program.kernel("rhs"), {"dense": dense, "carried": self.carried, "weighted": weighted}
        return with_definitions(attempt_assembly(rhs, tableau, lanes, knots=self.knots, **about))

    def beginning(self, tableau: Tableau, lanes: int, *, weighted: bool) -> OwnedAddress:
        """See `KernelLibrary.beginning`: of a long right-hand side the attempt is not compiled."""
        rhs = self._program.kernel("rhs")
        if len(rhs.body) <= LARGEST_INLINED:
            return super().beginning(tableau, lanes, weighted=weighted)

        def text() -> str:
            pieces = start_pieces(rhs, tableau, carried=self.carried, weighted=weighted)
            return with_definitions(_calls_assembly((pieces,), lanes))

        return self._entry(f"{tableau.name}_start{'_weighted' * weighted}", lanes, text, "start")

    def _load(self, name: str, lanes: int, text: Callable[[], str], functions: tuple[str, ...]) -> Code:
        """See `KernelLibrary._load`."""
        shape: Shape = "once" if name.startswith(_ONCE) else "straight"
        return load_object(object_code(self.folder, f"{name}_{lanes}", text, shape))


@final
class LLVMBackend(CompiledBackend):
    """The default backend."""

    name = "llvm"

    def library(self, program: Program, folder: Path | None) -> LLVMLibrary:
        """See `CompiledBackend.library`."""
        return LLVMLibrary(program, folder)
