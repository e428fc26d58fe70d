"""Attempts of Runge-Kutta steps, explicit and implicit, for many cases at once or for one.

Each implicit stage has a Jacobian of its own, with which simplified Newton iterations are made. One for all stages of a
step takes ten times the steps on a double pendulum in Cartesian coordinates.

Explicit stages are a loop, so that the right-hand side is compiled once whatever the tableau. Of many cases every
component has arrays of its own, slopes (stages, k) and a state (k,), which XLA vectorises over the cases; with one
array for all components, as ``vmap`` of a solver has it, the rows of the right-hand side are computed with branches.
One case is a single row that holds all components (n_y,), which takes fewer and longer operations. Control of the step
as in `dalembert.methods.step_constants`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ...methods import step_constants as gains
from ...methods.tableau import Tableau
from .lanes import Attempted, Attempts, Batch, Sides
from .mesh_axes import varying_like
from .precision import contracted, precision_of, product
from .step_rules import Rows, limit_at_knots, of_rows

_ITERATIONS = 20
_STALLED = 0.9
"""Ratio of changes of an iteration from which on it does not converge, or rounding is all that is left."""
_NEGLIGIBLE = 1e-3
"""Share of the tolerances to which stages are solved."""

Rates = Callable[[Any, Any, Rows], Any]


def implicit_slopes(
    rates: Callable[..., Rows], tableau: Tableau, start: Any, h: Any, c: Rows, first: Rows = (), scales: Rows = ()
) -> Rows:
    """Return the slopes of the stages, each row (stages, ...), of a step h from `start` = (t, y).

    Parameters
    ----------
    rates
        (t, y, c) -> rates, on rows, shaped like the state.
    first
        The slopes at the start where they are known.
    scales
        Tolerances of the components of the state; slopes are NaN where a stage is not solved to a share of them.
        Without any, stages are solved to rounding, and differentiated.
    """
    t, y = start
    if jnp.ndim(y[0]) > jnp.ndim(h):  # one row that holds all components
        given = t, y[0], h, tuple(c), first[0] if first else None, scales[0] if scales else None
        return (_of_case(lambda t, y, c: rates(t, (y,), c)[0], tableau, *given),)

    def case(*given: Any) -> Any:
        return _of_case(lambda t, y, c: jnp.stack(rates(t, tuple(y), c)), tableau, *given)

    def columns(rows: Rows) -> Any:
        return jnp.stack([jnp.broadcast_to(row, jnp.shape(h)) for row in rows], axis=-1) if rows else None

    of_c = tuple(0 if jnp.ndim(row) else None for row in c)
    axes = 0, 0, 0, of_c, 0 if first else None, 0 if scales else None
    times = jnp.broadcast_to(t, jnp.shape(h))
    found = jax.vmap(case, axes)(times, columns(y), h, tuple(c), columns(first), columns(scales))
    return tuple(found[:, :, i].T for i in range(len(y)))


def _of_case(rates: Rates, tableau: Tableau, t: Any, y: Any, h: Any, c: Rows, first: Any, scale: Any) -> Any:
    """Return the slopes (stages, n_y) of one case."""
    count = tableau.end + 1
    matrix, nodes = jnp.asarray(tableau.A[:count, :count]), jnp.asarray(tableau.c[:count])

    def stage(i: Any, slopes: Any) -> Any:
        point = y + h * product(matrix[i].at[i].set(0.0), slopes)
        return slopes.at[i].set(_solved(rates, t + nodes[i] * h, point, slopes[i - 1], h * matrix[i, i], c, scale))

    begin = jnp.zeros((count, len(y))).at[0].set(rates(t, y, c) if first is None else first)
    return lax.fori_loop(1, count, stage, varying_like(begin, (t, y, h, c, begin)))


def _solved(rates: Rates, t: Any, point: Any, guess: Any, size: Any, c: Rows, scale: Any) -> Any:
    """Return the slope k = rates(t, point + size k, c)."""

    def residual(slope: Any, t: Any, point: Any, size: Any, c: Rows) -> Any:
        return slope - rates(t, point + size * slope, c)

    still = lax.stop_gradient((t, point, size, c))
    slope, change = _iterated(lambda slope: residual(slope, *still), lax.stop_gradient(guess), still, scale)
    if scale is not None:
        return jnp.where(change <= _NEGLIGIBLE, slope, jnp.nan)
    # The first correction has the first derivatives of the solution, the second those up to the third order.
    for _ in range(2):
        matrix = jax.jacfwd(residual)(slope, t, point, size, c)
        slope = slope - jnp.linalg.solve(matrix, residual(slope, t, point, size, c))
    return slope


def _iterated(residual: Callable[[Any], Any], guess: Any, given: Any, scale: Any) -> tuple[Any, Any]:
    """Return the zero of a function, and the last change of the state over its tolerances."""
    _, point, size, _ = given
    factors = jax.scipy.linalg.lu_factor(jax.jacfwd(residual)(guess))
    if scale is None:
        largest = precision_of(point).smallest_normal + jnp.max(jnp.abs(point), initial=0.0)
        scale = precision_of(point).smallest_of_time * largest

    def improved(carry: Any) -> Any:
        count, slope, change, _ = carry
        move = jax.scipy.linalg.lu_solve(factors, residual(slope))
        return count + 1, slope - move, jnp.max(jnp.abs(size * move) / scale, initial=0.0), change

    def goes_on(carry: Any) -> Any:
        count, _, change, before = carry
        return (change > _NEGLIGIBLE) & (change < _STALLED * before) & (count < _ITERATIONS)

    start = varying_like((0, guess, jnp.inf, jnp.inf), (given, guess))
    _, slope, change, _ = lax.while_loop(goes_on, improved, improved(start))
    return slope, change


_LARGEST_UNROLLED = 3000
"""Operations of all stages of a step up to which an accelerator takes them without a loop: it then keeps the slopes of
a case in registers, and starts few functions, each of which takes as long as a step of thousands of cases."""


def slopes_of(rhs: Callable[..., Rows], t: Any, y: Rows, c: Rows) -> Rows:
    """Return the rates of a state, shaped like it."""
    rates = zip(rhs(t, y, c), y, strict=True)
    return varying_like(tuple(jnp.broadcast_to(rate, jnp.shape(row)) for rate, row in rates), (t, y, c))


def weighted(rhs: Callable[..., Rows], tableau: Tableau, count: int, start: Any, h: Any, c: Any, first: Rows) -> Rows:
    """Return the slopes of `count` stages, each row (count, ...), of a step h from `start` = (t, y).

    `first` are the slopes at the start where they are known; else they are computed in the loop, with the others.
    """
    (t, y), matrix, nodes = start, jnp.asarray(tableau.A[:count, :count]), jnp.asarray(tableau.c[:count])
    begin = tuple(jnp.zeros((count, *jnp.broadcast_shapes(jnp.shape(row), jnp.shape(h)))) for row in y)
    if first:
        begin = tuple(slopes.at[0].set(rate) for slopes, rate in zip(begin, first, strict=True))

    def stage(i: Any, slopes: Rows) -> Rows:
        point = tuple(a + h * contracted(matrix[i], k) for a, k in zip(y, slopes, strict=True))
        rates = slopes_of(rhs, t + nodes[i] * h, point, c)
        return tuple(k.at[i].set(rate) for k, rate in zip(slopes, rates, strict=True))

    slopes: Rows = lax.fori_loop(1 if first else 0, count, stage, varying_like(begin, (start, h, c, first)))
    return slopes


def slopes_in_turn(
    rhs: Callable[..., Rows], rows: Any, nodes: Any, start: Any, h: Any, c: Any, first: Rows = ()
) -> tuple[Rows, ...]:
    """Return the result of `weighted`, each row a tuple of slopes, without a loop: stages have these rows and nodes."""
    (t, y), slopes = start, [first] if first else []
    for i in range(len(slopes), len(rows)):
        sums = (contracted(rows[i][:i], tuple(k)) for k in zip(*slopes, strict=True)) if i else (0.0 for _ in y)
        point = tuple(a + h * total for a, total in zip(y, sums, strict=True))
        slopes.append(slopes_of(rhs, t + float(nodes[i]) * h, point, c))
    return tuple(zip(*slopes, strict=True))


def _mean(values: Rows, t: Any) -> Any:
    """Return the mean over the components: the rows, or what the one row of a single case holds."""
    if jnp.ndim(values[0]) > jnp.ndim(t):
        return jnp.mean(values[0])
    return sum(values[1:], start=values[0]) / len(values)


@final
class PairAttempts(Attempts):
    """Attempts by a tableau; what they remember is the size proposed, the previous error and the next slope.

    Parameters
    ----------
    rhs : callable
        (t, y, c) -> rates, on rows.
    tableau : Tableau
        The pair.
    moved : bool
        Whether states are moved between steps, so that the slope at the end of one is not that of the next.
    knots : callable, optional
        (t, y, c) -> the largest sizes of a step, forward and backward in time, that knots of tables allow.
    operations : int
        Length of the right-hand side.
    sides : callable, optional
        Moves of states at breaks.
    """

    def __init__(
        self,
        rhs: Callable[..., Rows],
        tableau: Tableau,
        *,
        moved: bool,
        knots: Callable[..., Rows] | None = None,
        operations: int,
        sides: Sides | None = None,
    ) -> None:
        self._rhs, self._tableau, self._knots, self.sides, self.sized = rhs, tableau, knots, sides, True
        self._stages = tableau.end + (1 if tableau.fsal else 0)
        self._looped = jax.default_backend() == "cpu" or operations * self._stages > _LARGEST_UNROLLED
        self._goes_on = tableau.fsal and not moved

    def start(self, batch: Batch, direction: Any) -> Any:
        """Return the memory before the first step, whose size is that of Hairer, Norsett, Wanner, section II.4."""
        t, y = batch.t0, batch.y
        first = slopes_of(self._rhs, t, y, batch.c)
        scales = [1.0 / (batch.rtol * jnp.abs(a) + atol) for a, atol in zip(y, of_rows(batch.atol, y), strict=True)]

        def norm(values: Rows) -> Any:
            return jnp.sqrt(_mean(tuple((v * s) ** 2 for v, s in zip(values, scales, strict=True)), t))

        size, slope = norm(y), norm(first)
        h = jnp.where(
            jnp.minimum(size, slope) < gains.FIRST_NEGLIGIBLE,
            gains.FIRST_BLIND,
            gains.FIRST_SHARE * size / jnp.maximum(slope, gains.FIRST_NEGLIGIBLE),
        )
        h = jnp.minimum(h, jnp.minimum(batch.max_step, jnp.abs(batch.t1 - t)))
        moved = tuple(a + direction * h * rate for a, rate in zip(y, first, strict=True))
        second = slopes_of(self._rhs, t + direction * h, moved, batch.c)
        change = norm(tuple(b - a for a, b in zip(first, second, strict=True))) / jnp.maximum(
            h, precision_of(h).smallest_normal
        )
        largest = jnp.maximum(jnp.maximum(slope, change), gains.FIRST_SLOPE)
        exponent = 1.0 / (self._tableau.error_order + 1)
        improved = jnp.minimum(gains.FIRST_GROWTH * h, (gains.FIRST_SHARE / largest) ** exponent)
        h = jnp.where(jnp.isfinite(change), improved, h)
        previous = jnp.full(jnp.shape(t), gains.SMALLEST_PREVIOUS)
        return jnp.where(jnp.isfinite(slope), h, 0.0), previous, first if self._goes_on else ()

    def attempt(self, batch: Batch, t: Any, y: Rows, largest: Any, direction: Any, memory: Any) -> Attempted:
        """Attempt a step of at most `largest`."""
        proposal, previous, first = memory
        proposed = jnp.maximum(proposal, precision_of(t).smallest_of_time * jnp.abs(t))
        if self._knots is not None:
            limit = limit_at_knots(self._knots(t, y, batch.c), t, direction)
            largest = jnp.minimum(largest, limit)
        size = jnp.where(largest <= proposed * precision_of(t).stretch, largest, proposed)
        h = direction * size
        if self._tableau.implicit:
            rates, own = partial(slopes_of, self._rhs), of_rows(batch.atol, y)
            scales = tuple(atol + batch.rtol * jnp.abs(a) for a, atol in zip(y, own, strict=True))
            slopes = implicit_slopes(rates, self._tableau, (t, y), h, batch.c, first, scales)
        elif self._looped:
            slopes = weighted(self._rhs, self._tableau, self._stages, (t, y), h, batch.c, first)
        else:
            A, nodes = self._tableau.A[: self._stages], self._tableau.c
            slopes = slopes_in_turn(self._rhs, A, nodes, (t, y), h, batch.c, first)
        weights = self._tableau.b[: self._stages]
        new = tuple(a + h * contracted(weights, k) for a, k in zip(y, slopes, strict=True))
        error = self._error(batch, y, new, slopes, size)
        finite, accepted = jnp.isfinite(error), error <= 1.0
        exponent = 1.0 / (self._tableau.error_order + 1)
        beta = gains.INTEGRAL * exponent
        safe = jnp.where(finite, jnp.maximum(error, 1e-30), 1.0)
        power = jnp.where(accepted, safe ** (gains.PROPORTIONAL * beta - exponent) * previous**beta, safe**-exponent)
        factor = jnp.clip(gains.SAFETY * power, gains.LARGEST_REDUCTION, gains.LARGEST_GROWTH)
        following = size * jnp.where(finite, factor, gains.REDUCTION_BLIND)
        following = jnp.where(accepted, jnp.maximum(following, jnp.where(size < proposed, proposed, 0.0)), following)
        previous = jnp.where(accepted, jnp.maximum(safe, gains.SMALLEST_PREVIOUS), previous)
        kept: Rows = ()
        if self._goes_on:
            kept = tuple(jnp.where(accepted, k[-1], rate) for k, rate in zip(slopes, first, strict=True))
        return Attempted(new, size, finite, accepted, following, (following, previous, kept))

    def _error(self, batch: Batch, y: Rows, new: Rows, slopes: Rows, size: Any) -> Any:
        """Return the RMS norm of the error over the tolerances (see `Tableau.error`)."""
        scales = [
            1.0 / (atol + batch.rtol * jnp.maximum(jnp.abs(a), jnp.abs(b)))
            for a, b, atol in zip(y, new, of_rows(batch.atol, y), strict=True)
        ]

        def norm(row: Any) -> Any:
            part = np.ascontiguousarray(row[: self._stages])
            estimates = (contracted(part, k) * scale for k, scale in zip(slopes, scales, strict=True))
            return _mean(tuple(estimate**2 for estimate in estimates), size)

        squares = [norm(row) for row in self._tableau.error]
        if len(squares) == 1:
            return size * jnp.sqrt(squares[0])
        below = squares[0] + gains.SECOND_ERROR_WEIGHT * squares[1]
        return size * squares[0] / jnp.sqrt(jnp.maximum(below, precision_of(below).smallest_normal))
