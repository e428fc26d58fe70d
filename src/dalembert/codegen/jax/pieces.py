"""Methods for traced runs: [Program] -> [Pieces]."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np

from ...integrators.jax.adjoint import InTurn
from ...integrators.jax.compiling import LARGEST_FUSED
from ...integrators.jax.continuous import Field
from ...integrators.jax.derivatives import Steps, jacobians
from ...integrators.jax.kernels import CORRECTIONS, Function, Kernels, OnArrays
from ...integrators.jax.lanes import Projections, Rows, TaylorAttempts, project
from ...integrators.jax.motion import Pieces
from ...integrators.jax.pairs import PairAttempts, slopes_of, weighted
from ...integrators.jax.products import contracted, product
from ...integrators.jax.run_constants import RunConstants
from ...integrators.jax.solvers import METHODS
from ...ir.kernel import Kernel
from ...ir.program import Program
from ...methods.tableau import Tableau
from ...methods.tableaus import TABLEAUS
from ...once import once
from ...transforms.nonsmooth import decisions, only_in_branches
from ...transforms.recurrences import recurrences
from ...transforms.taylor import series_kernel, step_kernel
from ..printers import JAX, JAX_SERIES
from .blocks import Conditional, blocked, cotangents_of, looped
from .feedback_kernels import FeedbackKernels
from .foreign import ForeignRuns
from .kernels import compile_kernel

__all__ = ["PAIRS", "SERVED", "pieces_of", "pieces_with", "place_of"]

_BY_NAME = {tableau.name: tableau for tableau in TABLEAUS}
PAIRS = {"dopri8": _BY_NAME["dop853"], "tsit5": _BY_NAME["tsit5"]}
"""The pairs by which our own loops run."""

SERVED = (*METHODS, "taylor")
"""Methods of traced runs."""

_LARGEST_AT_ONCE = 200
"""Operations up to which a right-hand side of one case runs faster whole than in blocks: of chains of rods, 195 take
two thirds of the time, 288 some 1.7 times, 413 and 1,201 some four times (on CPU, measured in turn)."""

_SHORT = 50
"""Operations up to which a gradient is faster in chunks of steps than one stage after the other."""


@once
def pieces_of(
    program: Program, kernels: Kernels, method: str, order: int, constants: RunConstants | None = None
) -> Pieces:
    """Return the pieces of a method for a program, made once; see `pieces_with`."""
    return pieces_with(program, kernels, method, order, constants)


def pieces_with(
    program: Program,
    kernels: Kernels,
    method: str,
    order: int,
    constants: RunConstants | None,
    feedback: FeedbackKernels | None = None,
) -> Pieces:
    """Return the pieces of a method for a program.

    `order` is that of Taylor steps; `constants` are those of a run that has more than the program takes; inputs may be
    functions, with `feedback`, but in Taylor steps.
    """

    def one_row(kernel: Function) -> Function:
        return kernel if feedback is None else feedback.on_one_row(kernel)

    def rows(kernel: Function) -> Function:
        return kernel if feedback is None else feedback.on_rows(kernel)

    foreign = None
    if constants is None and feedback is None and program.conditions is None and program.layout.state:
        foreign = ForeignRuns(program, method)
    if constants is None:
        constants = RunConstants(place_of(program))
    corrections = {name: count for name, count in CORRECTIONS.items() if name in program}
    on_rows = tuple((compile_kernel(program.kernel(name), JAX), count) for name, count in corrections.items())
    in_blocks = [(blocked(program.kernel(name)), count) for name, count in corrections.items()]

    def projections(go: Any) -> Projections:
        return tuple((correct(go), count) for correct, count in in_blocks)

    moved_by = _moved_by(program)
    field = cache(partial(_field, program, kernels, method))
    if method == "taylor":
        known = recurrences(program.kernel("rhs"), step_growth_limited=program.nonanalytic)
        step = step_kernel(known, order, dense=False)
        taylor = TaylorAttempts(_step_of_one(looped(step)), step_growth_limited=known.step_growth_limited)
        alone = tuple((_on_one_row(looped(program.kernel(name), JAX)), count) for name, count in corrections.items())
        series = _series(series_kernel(known, order))
        taylors = TaylorAttempts(compile_kernel(step), step_growth_limited=known.step_growth_limited)
        steps = _SeriesSteps(blocked(program.kernel("rhs")), series, order, projections, constants)
        return Pieces(taylor, alone, taylors, on_rows, steps, _decided(program), moved_by, field, foreign)
    whole = tuple((_on_one_row(_of_one(program, kernels, name)), count) for name, count in corrections.items())
    rhs, tableau, moved = program.kernel("rhs"), PAIRS[method], bool(corrections) or constants.broken
    limits: tuple[Function | None, ...] = None, None
    if "knots" in program:
        limits = one_row(_knots_of_one(program, kernels)), rows(compile_kernel(program.kernel("knots")))
    rates, length = one_row(_on_one_row(_of_one(program, kernels, "rhs"))), len(rhs.body)
    one = PairAttempts(rates, tableau, moved=moved, knots=limits[0], operations=length)
    many = PairAttempts(rows(compile_kernel(rhs, JAX)), tableau, moved=moved, knots=limits[1], operations=length)
    in_turn: InTurn | None = None
    if not moved and not constants.extended and not only_in_branches(rhs):
        sizes = len(program.layout.state), program.layout.constants or len(program.layout.parameters)
        pulling = cache(partial(cotangents_of, rhs, *sizes))
        in_turn = InTurn(tableau, looped(rhs), pulling, whole=len(rhs.body) > _SHORT)
    in_steps, decided = blocked(rhs), _decided(program)
    steps_of_pair = _PairSteps(lambda go: rows(in_steps(go)), tableau, projections, in_turn, constants)
    decided = None if decided is None else rows(decided)
    return Pieces(one, whole, many, on_rows, steps_of_pair, decided, moved_by, field, foreign)


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


def _of_one(program: Program, kernels: Kernels, name: str) -> OnArrays:
    """Return a kernel of one case: as it is, or in blocks where it is long."""
    kernel = program.kernel(name)
    return looped(kernel, JAX) if len(kernel.body) > _LARGEST_AT_ONCE else kernels[name]


def _on_one_row(kernel: OnArrays) -> Function:
    """Return a kernel on arrays as a function of rows, of which there is one."""
    return lambda t, y, c: (kernel(t, y[0], c[0]),)


def _field(program: Program, kernels: Kernels, method: str) -> Field:
    """Return the rates of one case and their cotangents, for continuous adjoints."""
    kernel, rates = program.kernel("rhs"), _of_one(program, kernels, "rhs")
    sizes = len(program.layout.state), program.layout.constants or len(program.layout.parameters)
    generated = None if only_in_branches(kernel) else cotangents_of(kernel, *sizes)

    def pull(t: Any, y: Any, c: Any, ahead: Any) -> tuple[Any, Any]:
        if generated is None:
            back, share = jax.vjp(lambda y, c: rates(t, y, c), y, c)[1](ahead)
            return back, share
        memory, back = generated(generated.begin(c), t, y, ahead)
        return back, generated.sums(memory)

    return Field(
        PAIRS.get(method, PAIRS["dopri8"]), rates, pull, _knots_of_one(program, kernels) if "knots" in program else None
    )


def _knots_of_one(program: Program, kernels: Kernels) -> Function:
    """Return the limits of steps at knots of tables for one case on a row."""
    limits = _of_one(program, kernels, "knots")
    return lambda t, y, c: tuple(limits(t, y[0], c[0]))


def _series(kernel: Kernel) -> Conditional:
    """Return the coefficients of a Taylor series; in blocks where it is too long to be fused."""
    if len(kernel.body) > LARGEST_FUSED:
        return blocked(kernel, JAX_SERIES)
    whole = compile_kernel(kernel, JAX_SERIES)
    return lambda go: whole


def _step_of_one(step: Function) -> Function:
    """Return a Taylor step on arrays as a function of rows, of which there is one."""

    def on_row(t: Any, y: Rows, c: Rows, settings: Rows) -> Rows:
        known = jnp.append(y[0], y[1]) if y[1:] else y[0]
        out = step(t, known, c[0], jnp.stack(jnp.broadcast_arrays(*settings)))
        n = len(y[0])
        return out[:n], out[n], out[n + 1]

    return on_row


def _settled(projections: Callable[[Any], Projections], steps: Steps, ends: Rows) -> Rows:
    """Return the ends of steps on the constraints."""
    return project(projections(steps.go), steps.t + steps.h, ends, steps.c)[0]


def _again(projections: Callable[[Any], Projections], steps: Steps, ends: Rows) -> Rows:
    """Return the ends of steps on the constraints, made so that JAX finds the derivatives of `_correction` there."""
    if not projections(steps.go):
        return ends
    still = jax.lax.stop_gradient
    fixed = steps._replace(t=still(steps.t), h=still(steps.h), y=still(steps.y), c=still(steps.c))
    held = _settled(projections, fixed, still(ends))
    at = tuple(on + (end - still(end)) for on, end in zip(held, ends, strict=True))
    return _correction(projections, steps, at, steps.c)


def _correction(projections: Callable[[Any], Projections], steps: Steps, at: Rows, c: Rows) -> Rows:
    """Return states, on the constraints already, after one correction of each kind.

    To first order that is what all of them do: the derivative of a Newton iteration that has converged is that of one
    more, as its derivative there is a projection.
    """
    for correct, _ in projections(steps.go):
        at = tuple(a + b for a, b in zip(at, correct(steps.t + steps.h, at, c), strict=True))
    return at


@final
class _PairSteps:
    """Steps of a pair and their derivatives, by the derivatives of the right-hand side at the stages.

    Parameters
    ----------
    rhs
        From a condition to (t, y, c) -> rates, on rows.
    tableau
        The pair.
    projections
        From a condition to what moves the end of a step.
    in_turn
        What pulls a run of one case back one stage after the other, where that is faster and possible.
    constants
        See `Linear`.
    """

    def __init__(
        self,
        rhs: Conditional,
        tableau: Tableau,
        projections: Callable[[Any], Projections],
        in_turn: InTurn | None,
        constants: RunConstants,
    ) -> None:
        self.in_turn, self.constants = in_turn, constants
        count = tableau.end
        self._rhs, self._tableau, self._projections, self._count = rhs, tableau, projections, count
        self._matrix, self._weights = tableau.A[:count, :count], tableau.b[:count]

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, on the constraints."""
        return _settled(self._projections, steps, self._stages(steps)[1])

    def moved(self, steps: Steps) -> Rows:
        """See `Differentiable`."""
        return _again(self._projections, steps, self._stages(steps)[1])

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps."""
        return slopes_of(self._rhs(steps.go), steps.t, steps.y, steps.c)

    def _stages(self, steps: Steps) -> tuple[Rows, Rows]:
        """Return the slopes (stages, k) and the ends of steps before they are projected."""
        t, h, y, c, go = steps
        slopes = weighted(self._rhs(go), self._tableau, self._count, (t, y), h, c, ())
        return slopes, tuple(a + h * contracted(self._weights, k) for a, k in zip(y, slopes, strict=True))

    def along(self, steps: Steps) -> tuple[Any, Any]:
        """See `Linear`: h, derivatives (stages, n_y, n_y) of the slopes, and (n_y, n_y) of the projection."""
        t, h, y, c, go = steps
        slopes, ends = self._stages(steps)
        points = tuple(a + h * contracted(self._matrix, k) for a, k in zip(y, slopes, strict=True))
        times = t + self._tableau.c[: self._count, np.newaxis] * h
        matrices = jnp.moveaxis(jacobians(lambda at: slopes_of(self._rhs(go), times, at, c), points), 1, 0)
        if not self._projections(go):
            return (h, matrices), (times, points, ends)
        ends = _settled(self._projections, steps, ends)
        held = jacobians(lambda at: _correction(self._projections, steps, at, c), ends)
        return (h, matrices, held), (times, points, ends)

    def shifts(self, steps: Steps, places: Any, dc: Rows) -> Any:
        """See `Linear`: changes (stages, n_y) of the slopes, and (n_y,) of the projection."""
        times, points, ends = places
        rates = jax.jvp(lambda *c: slopes_of(self._rhs(steps.go), times, points, c), steps.c, dc)[1]
        shift = jnp.stack([rate.T for rate in rates], axis=-1)
        if not self._projections(steps.go):
            return (shift,)
        moves = jax.jvp(lambda *c: _correction(self._projections, steps, ends, c), steps.c, dc)[1]
        return shift, jnp.stack(moves, axis=-1)

    def push(self, along: Any, shift: Any, dy: Any) -> Any:
        """See `Linear`."""
        h, matrices, *held = along
        slopes: list[Any] = []
        for i, row in enumerate(self._matrix.tolist()):  # numbers of no precision of their own
            point = sum((h * a * k for a, k in zip(row, slopes, strict=False) if a), start=dy)
            slopes.append(product(matrices[i], point) + shift[0][i])
        end = sum((h * b * k for b, k in zip(self._weights.tolist(), slopes, strict=True) if b), start=dy)
        return product(held[0], end) + shift[1] if held else end

    def pull(self, along: Any, ahead: Any) -> tuple[Any, Any]:
        """See `Linear`: cotangents (stages, n_y) of the slopes, and (n_y,) of the end."""
        h, matrices, *held = along
        end = product(ahead, held[0]) if held else ahead
        before, matrix, weights = end, self._matrix.tolist(), self._weights.tolist()
        points: list[Any] = [None] * self._count
        slopes: list[Any] = [None] * self._count
        for i in reversed(range(self._count)):
            later = (h * matrix[j][i] * points[j] for j in range(i + 1, self._count) if matrix[j][i])
            slopes[i] = sum(later, start=h * weights[i] * end)
            points[i] = product(slopes[i], matrices[i])
            before = before + points[i]
        return before, (jnp.stack(slopes), ahead)

    def share(self, steps: Steps, places: Any, within: Any) -> Rows:
        """See `Linear`."""
        (times, points, ends), (slopes, ahead) = places, within
        rates = tuple(slopes[..., i].T for i in range(len(points)))
        found: Rows = jax.vjp(lambda *c: slopes_of(self._rhs(steps.go), times, points, c), *steps.c)[1](rates)
        if self._projections(steps.go):
            moved = jax.vjp(lambda *c: _correction(self._projections, steps, ends, c), *steps.c)[1](tuple(ahead.T))
            found = tuple(a + b for a, b in zip(found, moved, strict=True))
        return found


@final
class _SeriesSteps:
    """Steps of a Taylor series and their derivatives.

    Parameters
    ----------
    rhs
        From a condition to (t, y, c) -> rates, on rows.
    series
        From a condition to (t, y, c) -> coefficients of each component in turn, on rows.
    order
        Order of the series.
    projections
        From a condition to what moves the end of a step.
    constants
        See `Linear`.
    """

    def __init__(
        self,
        rhs: Conditional,
        series: Conditional,
        order: int,
        projections: Callable[[Any], Projections],
        constants: RunConstants,
    ) -> None:
        self.in_turn, self.constants = None, constants
        self._rhs, self._series, self._order, self._projections = rhs, series, order, projections

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, on the constraints."""
        return _settled(self._projections, steps, self._ends(steps, steps.y, steps.c))

    def moved(self, steps: Steps) -> Rows:
        """See `Differentiable`."""
        return _again(self._projections, steps, self._ends(steps, steps.y, steps.c))

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps."""
        return slopes_of(self._rhs(steps.go), steps.t, steps.y, steps.c)

    def _ends(self, steps: Steps, y: Rows, c: Rows) -> Rows:
        """Return the ends of steps before they are projected."""
        t, h = steps.t, steps.h
        values, each = self._series(steps.go)(t, y, c), self._order + 1
        new = []
        for i, row in enumerate(y):
            total = jnp.zeros(jnp.shape(row))
            for value in reversed(values[i * each + 1 : (i + 1) * each]):
                total = h * (value + total)
            new.append(row + total)
        return tuple(new)

    def along(self, steps: Steps) -> tuple[Any, Any]:
        """See `Linear`: derivatives (n_y, n_y) of the step, and (n_y, n_y) of the projection."""
        step = jacobians(lambda at: self._ends(steps, at, steps.c), steps.y)
        if not self._projections(steps.go):
            return (step,), None
        ends = _settled(self._projections, steps, self._ends(steps, steps.y, steps.c))
        held = jacobians(lambda at: _correction(self._projections, steps, at, steps.c), ends)
        return (step, held), ends

    def shifts(self, steps: Steps, places: Any, dc: Rows) -> Any:
        """See `Linear`: changes (n_y,) of the end, and of the projection."""
        step = jnp.stack(jax.jvp(lambda *c: self._ends(steps, steps.y, c), steps.c, dc)[1], axis=-1)
        if places is None:
            return (step,)
        moves = jax.jvp(lambda *c: _correction(self._projections, steps, places, c), steps.c, dc)[1]
        return step, jnp.stack(moves, axis=-1)

    def push(self, along: Any, shift: Any, dy: Any) -> Any:
        """See `Linear`."""
        end = product(along[0], dy) + shift[0]
        return product(along[1], end) + shift[1] if along[1:] else end

    def pull(self, along: Any, ahead: Any) -> tuple[Any, Any]:
        """See `Linear`: the cotangents of the end, before it is projected and after."""
        end = product(ahead, along[1]) if along[1:] else ahead
        return product(end, along[0]), (end, ahead)

    def share(self, steps: Steps, places: Any, within: Any) -> Rows:
        """See `Linear`."""
        end, ahead = within
        found: Rows = jax.vjp(lambda *c: self._ends(steps, steps.y, c), *steps.c)[1](tuple(end.T))
        if places is not None:
            moved = jax.vjp(lambda *c: _correction(self._projections, steps, places, c), *steps.c)[1](tuple(ahead.T))
            found = tuple(a + b for a, b in zip(found, moved, strict=True))
        return found
