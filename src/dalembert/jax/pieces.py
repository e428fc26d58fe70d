"""Methods for traced runs: [Program] -> [Pieces]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp

from ..codegen.printers import JAX, JAX_SERIES
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..methods import names
from ..methods.names import CORRECTIONS, TRACED
from ..methods.tableau import Tableau
from ..methods.tableaus import KVAERNO5
from ..once import once
from ..transforms.taylor.nonsmooth import decisions, only_in_branches
from ..transforms.taylor.recurrences import recurrences
from ..transforms.taylor.step import series_kernel, step_kernel
from .blocks import blocked, cotangents_of, looped
from .feedback import FeedbackKernels
from .foreign import ForeignRuns
from .modules import compile_kernel
from .runs.adjoint import InTurn
from .runs.derivatives import Stepping
from .runs.lanes import Sides, TaylorAttempts
from .runs.pairs import PairAttempts
from .runs.precision import LARGEST_FUSED
from .runs.run_constants import ArrayKernels, Function, OnArrays, RunConstants, on_one_row
from .runs.run_data import RunPieces
from .runs.step_rules import Projections, Rows
from .step_derivatives import PairSteps, WholeSteps, implicit_ends, series_ends

EXPLICIT = {name: names.PAIRS[m.compiled].tableau for name, m in TRACED.items() if m.compiled in names.PAIRS}
PAIRS = {**EXPLICIT, "kvaerno5": KVAERNO5}
"""The pairs by their names here."""

SERVED = (*PAIRS, "taylor")
"""Methods of traced runs."""

_LARGEST_AT_ONCE = 200
"""Operations up to which a right-hand side of one case runs faster whole than in blocks: of chains of rods, 195 take
two thirds of the time, 288 some 1.7 times, 413 and 1,201 some four times (on CPU, measured in turn)."""

_SHORT = 50
"""Operations up to which derivatives, and steps to requested times, are faster together than one stage after the other:
of the sleigh, whose right-hand side has nine, they take half of the time or less (on CPU)."""


@once
def pieces_of(
    program: Program,
    kernels: ArrayKernels,
    method: str,
    order: int,
    constants: RunConstants | None = None,
    weighted: bool = False,
) -> RunPieces:
    """Return the pieces of a method for a program, made once; see `pieces_with`."""
    return pieces_with(program, kernels, method, order, constants, weighted=weighted)


def pieces_with(
    program: Program,
    kernels: ArrayKernels,
    method: str,
    order: int,
    constants: RunConstants | None,
    feedback: FeedbackKernels | None = None,
    *,
    weighted: bool = False,
) -> RunPieces:
    """Return the pieces of a method for a program.

    `order` is that of Taylor steps; `constants` are those of a run that has more than the program takes; inputs may be
    functions, with `feedback`, but in Taylor steps. Where steps are `weighted`, each component of the state has an
    absolute tolerance of its own, and no machine code is called.
    """
    foreign = None
    served = not weighted and method != "kvaerno5" and feedback is None and program.conditions is None
    if served and constants is None and program.layout.state:
        foreign = ForeignRuns(program, method, order)
    if constants is None:
        constants = RunConstants(place_of(program))
    projections = _corrections(program, lambda name: blocked(program.kernel(name)))
    sides = _sides(program, kernels, feedback)
    if method == "taylor":
        made = _taylor_pieces(program, order, projections, constants, sides, weighted)
    else:
        made = _pair_pieces(program, kernels, PAIRS[method], projections, constants, feedback, sides)
    return replace(made, moved_by=_moved_by(program), foreign=foreign)


def _corrections(program: Program, made: Callable[[str], Any]) -> tuple[tuple[Any, int], ...]:
    """Return the projections of a program, made from their names, each with the number of its iterations."""
    return tuple((made(name), count) for name, count in CORRECTIONS.items() if name in program)


def corrections_on_rows(program: Program) -> Projections:
    """Return the projections of many cases."""
    return _corrections(program, lambda name: compile_kernel(program.kernel(name), JAX))


def _taylor_pieces(
    program: Program,
    order: int,
    projections: Projections,
    constants: RunConstants,
    sides: tuple[Sides | None, Sides | None],
    weighted: bool,
) -> RunPieces:
    """Return the pieces of Taylor steps that depend on the method."""
    known = recurrences(program.kernel("rhs"), step_growth_limited=program.nonanalytic, weighted=weighted)
    step, limited = step_kernel(known, order, dense=False), known.step_growth_limited
    series = _series(series_kernel(known, order))
    return RunPieces(
        one=TaylorAttempts(_step_of_one(looped(step)), step_growth_limited=limited, sides=sides[0]),
        one_projections=_corrections(program, lambda name: on_one_row(looped(program.kernel(name), JAX))),
        many=TaylorAttempts(compile_kernel(step), step_growth_limited=limited, sides=sides[1]),
        many_projections=corrections_on_rows(program),
        steps=WholeSteps(blocked(program.kernel("rhs")), partial(series_ends, series, order), projections, constants),
        decided=_decided(program),
    )


def series_attempts(step: Kernel, size: int, *, step_growth_limited: bool) -> TaylorAttempts:
    """Return attempts of one case by a Taylor step that also gives its series, for `size` components of the state."""
    whole = compile_kernel(step)

    def on_arrays(*given: Any) -> Any:
        return jnp.stack([jnp.asarray(value, dtype=float) for value in whole(*given)])

    series = len(step.outputs) - size - 2
    return TaylorAttempts(_step_of_one(on_arrays), step_growth_limited=step_growth_limited, series=series)


def _pair_pieces(
    program: Program,
    kernels: ArrayKernels,
    tableau: Tableau,
    projections: Projections,
    constants: RunConstants,
    feedback: FeedbackKernels | None,
    sides: tuple[Sides | None, Sides | None],
) -> RunPieces:
    """Return the pieces of a Runge-Kutta pair that depend on the method."""

    def one_row(kernel: Function) -> Function:
        return kernel if feedback is None else feedback.on_one_row(kernel)

    def rows(kernel: Function) -> Function:
        return kernel if feedback is None else feedback.on_rows(kernel)

    whole = _corrections(program, lambda name: on_one_row(_of_one(program, kernels, name)))
    rhs, moved = program.kernel("rhs"), bool(whole) or constants.broken
    limits: tuple[Function | None, ...] = None, None
    if "knots" in program:
        limits = one_row(_knots_of_one(program, kernels)), rows(compile_kernel(program.kernel("knots")))
    rates, length = one_row(on_one_row(_of_one(program, kernels, "rhs"))), len(rhs.body)
    in_turn: InTurn | None = None
    if length > _SHORT and not (moved or tableau.implicit or constants.extended or only_in_branches(rhs)):
        sizes = len(program.layout.state), program.layout.constants or len(program.layout.parameters)
        pulling = cache(partial(cotangents_of, rhs, *sizes))
        in_turn = InTurn(tableau, looped(rhs), pulling)
    in_steps, decided = rows(blocked(rhs)), _decided(program)
    steps: Stepping
    if tableau.implicit:
        steps = WholeSteps(in_steps, partial(implicit_ends, in_steps, tableau), projections, constants)
    else:
        steps = PairSteps(in_steps, tableau, projections, in_turn, constants)
    pair = partial(PairAttempts, tableau=tableau, moved=moved, operations=length)
    return RunPieces(
        one=pair(rates, knots=limits[0], sides=sides[0]),
        one_projections=whole,
        many=pair(rows(compile_kernel(rhs, JAX)), knots=limits[1], sides=sides[1]),
        many_projections=corrections_on_rows(program),
        steps=steps,
        decided=None if decided is None else rows(decided),
    )


def constants_of_segments(program: Program) -> RunConstants | None:
    """Return what constants are in runs that are cut where conditions on time change: given, as kernels take them."""
    return None if program.conditions is None else RunConstants()


def place_of(program: Program) -> int | None:
    """Return the number of the constant which is the time at which conditions on time are decided; None without any."""
    return None if program.conditions is None else program.conditions.place


def _decided(program: Program) -> Function | None:
    """Return the values in the rates that jump with the state; None where nothing does."""
    kernel = decisions(program)
    return None if kernel is None else compile_kernel(kernel, JAX)


def _moved_by(program: Program) -> tuple[int, ...]:
    """Return the numbers of the parameters on which the times of breaks depend."""
    if program.conditions is None:
        return ()
    functions, place = program.conditions.functions, program.conditions.place
    loads = {load.index for function in functions for load in function.loads if load.array == "p"}
    return tuple(sorted(index for index in loads if index is not None and index != place))


def _of_one(program: Program, kernels: ArrayKernels, name: str) -> OnArrays:
    """Return a kernel of one case: as it is, or in blocks where it is long."""
    kernel = program.kernel(name)
    return looped(kernel, JAX) if len(kernel.body) > _LARGEST_AT_ONCE else kernels[name]


def _sides(
    program: Program, kernels: ArrayKernels, feedback: FeedbackKernels | None
) -> tuple[Sides | None, Sides | None]:
    """Return moves of states at breaks, of one case and of many; None where there are none."""
    if program.knot_sides is None:
        return None, None
    n, both = len(program.layout.state), (program.knot_sides.near, program.knot_sides.sides)
    one = [on_one_row(_of_one(program, kernels, kernel.name)) for kernel in both]
    many: list[Function] = [compile_kernel(kernel, JAX) for kernel in both]
    if feedback is not None:
        one, many = [feedback.on_one_row(each) for each in one], [feedback.on_rows(each) for each in many]
    near_one, near_many = one[0], many[0]
    return (
        _where_near(lambda t, y, c: near_one(t, y, c)[0][0], _sides_of_one(one[1], n)),
        _where_near(lambda t, y, c: near_many(t, y, c)[0], _sides_of_many(many[1], n)),
    )


def _where_near(near: Callable[..., Any], sides: Sides) -> Sides:
    """Return moves at breaks that are computed where a state is on a jump."""

    def where_near(t: Any, y: Rows, c: Rows) -> tuple[Rows, Rows]:
        def moved() -> tuple[Rows, Rows]:
            ahead, back = (
                tuple(jnp.broadcast_to(a, jnp.shape(b)) for a, b in zip(way, y, strict=True)) for way in sides(t, y, c)
            )
            return ahead, back

        return jax.lax.cond(jnp.any(jnp.not_equal(near(t, y, c), 0.0)), moved, lambda: (tuple(y), tuple(y)))

    return where_near


def _sides_of_one(kernel: Function, n: int) -> Sides:
    """Return moves at breaks of one case, whose components are one row."""

    def sides(t: Any, y: Rows, c: Rows) -> tuple[Rows, Rows]:
        (found,) = kernel(t, y, c)
        return (found[:n],), (found[n : 2 * n],)

    return sides


def _sides_of_many(kernel: Function, n: int) -> Sides:
    """Return moves at breaks of many cases, with a row for each component."""

    def sides(t: Any, y: Rows, c: Rows) -> tuple[Rows, Rows]:
        found = kernel(t, y, c)
        return found[:n], found[n : 2 * n]

    return sides


def _knots_of_one(program: Program, kernels: ArrayKernels) -> Function:
    """Return the limits of steps at knots of tables for one case on a row."""
    limits = _of_one(program, kernels, "knots")
    return lambda t, y, c: tuple(limits(t, y[0], c[0]))


def _series(kernel: Kernel) -> Function:
    """Return the coefficients of a Taylor series; in blocks where it is too long to be fused."""
    if len(kernel.body) > LARGEST_FUSED:
        return blocked(kernel, JAX_SERIES)
    return compile_kernel(kernel, JAX_SERIES)


def _step_of_one(step: Function) -> Function:
    """Return a Taylor step on arrays as a function of rows, of which there is one; a series is one row, too."""

    def on_row(t: Any, y: Rows, c: Rows, settings: Rows) -> Rows:
        known = jnp.append(y[0], y[1]) if y[1:] else y[0]
        out = step(t, known, c[0], jnp.stack(jnp.broadcast_arrays(*settings)))
        n = len(y[0])
        return out[:n], out[n], out[n + 1], *((out[n + 2 :],) if len(out) > n + 2 else ())

    return on_row
