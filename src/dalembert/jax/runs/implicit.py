"""Stages of implicit Runge-Kutta steps, solved one after the other, with derivatives up to the third order.

Each stage has a Jacobian of its own, with which simplified Newton iterations are made. One Jacobian for all stages of a
step takes ten times the steps on a double pendulum in Cartesian coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ...methods.tableau import Tableau
from .mesh_axes import varying_like
from .precision import precision_of
from .products import product
from .projection import Rows

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
