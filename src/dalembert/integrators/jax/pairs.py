"""Attempts of explicit Runge-Kutta pairs for many cases at once (see `dalembert.integrators.jax.lanes`).

The stages are a loop, so that the right-hand side is compiled once whatever the tableau. Every component has arrays of
its own, slopes (stages, k) and a state (k,), which XLA vectorises over the cases; with one array for all components,
as ``vmap`` of a solver has it, the rows of the right-hand side are computed with branches. Control of the step as in
`dalembert.integrators.gains`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import gains
from ..tableau import Tableau
from .lanes import Attempted, Batch, Rows

__all__ = ["PairAttempts"]

_SMALLEST = 16.0 * 2.220446049250313e-16


@final
class PairAttempts:
    """Attempts by a tableau; what they remember is the size proposed and the previous error.

    Parameters
    ----------
    rhs : callable
        (t, y, c) -> rates, on rows.
    tableau : Tableau
        The pair.
    """

    def __init__(self, rhs: Callable[..., Rows], tableau: Tableau) -> None:
        self._rhs, self._tableau = rhs, tableau
        self._stages = tableau.end + (1 if tableau.fsal else 0)

    def _slopes(self, t: Any, y: Rows, c: Rows) -> Rows:
        return tuple(jnp.broadcast_to(rate, t.shape) for rate in self._rhs(t, y, c))

    def start(self, batch: Batch, direction: Any) -> Any:
        """Return the memory before the first step, whose size is that of Hairer, Norsett, Wanner, section II.4."""
        t, y = batch.t0, batch.y
        first = self._slopes(t, y, batch.c)
        scales = [1.0 / (batch.rtol * jnp.abs(a) + batch.atol) for a in y]

        def norm(values: Rows) -> Any:
            return jnp.sqrt(sum((v * s) ** 2 for v, s in zip(values, scales, strict=True)) / len(y))

        size, slope = norm(y), norm(first)
        h = jnp.where(jnp.minimum(size, slope) < 1e-5, 1e-6, 0.01 * size / jnp.maximum(slope, 1e-5))
        h = jnp.minimum(h, jnp.minimum(batch.max_step, jnp.abs(batch.t1 - t)))
        moved = tuple(a + direction * h * rate for a, rate in zip(y, first, strict=True))
        second = self._slopes(t + direction * h, moved, batch.c)
        change = norm(tuple(b - a for a, b in zip(first, second, strict=True))) / jnp.maximum(h, 1e-300)
        largest = jnp.maximum(jnp.maximum(slope, change), 1e-15)
        improved = jnp.minimum(100.0 * h, (0.01 / largest) ** (1.0 / (self._tableau.error_order + 1)))
        h = jnp.where(jnp.isfinite(change), improved, h)
        return jnp.where(jnp.isfinite(slope), h, 0.0), jnp.full(t.shape, gains.SMALLEST_PREVIOUS)

    def attempt(self, batch: Batch, t: Any, y: Rows, largest: Any, direction: Any, memory: Any) -> Attempted:
        """Attempt a step of at most `largest`."""
        proposal, previous = memory
        proposed = jnp.maximum(proposal, _SMALLEST * jnp.abs(t))
        size = jnp.where(largest <= proposed * gains.STRETCH, largest, proposed)
        h = direction * size
        slopes = self._all_slopes(t, y, batch.c, h)
        weights = jnp.asarray(self._tableau.b[: self._stages])
        new = tuple(a + h * (weights @ k) for a, k in zip(y, slopes, strict=True))
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
        return Attempted(new, size, finite, accepted, following, (following, previous))

    def _all_slopes(self, t: Any, y: Rows, c: Rows, h: Any) -> Rows:
        count = self._stages
        matrix = jnp.asarray(self._tableau.A[:count, :count])
        nodes = jnp.asarray(self._tableau.c[:count])
        first = tuple(jnp.zeros((count, *t.shape)).at[0].set(rate) for rate in self._slopes(t, y, c))

        def stage(i: Any, slopes: Rows) -> Rows:
            point = tuple(a + h * (matrix[i] @ k) for a, k in zip(y, slopes, strict=True))
            rates = self._slopes(t + nodes[i] * h, point, c)
            return tuple(k.at[i].set(rate) for k, rate in zip(slopes, rates, strict=True))

        slopes: Rows = lax.fori_loop(1, count, stage, first)
        return slopes

    def _error(self, batch: Batch, y: Rows, new: Rows, slopes: Rows, size: Any) -> Any:
        """Return the RMS norm of the error over the tolerances (see `Tableau.error`)."""
        totals = [jnp.zeros(size.shape) for _ in self._tableau.error]
        for a, b, k in zip(y, new, slopes, strict=True):
            scale = 1.0 / (batch.atol + batch.rtol * jnp.maximum(jnp.abs(a), jnp.abs(b)))
            for place, row in enumerate(self._tableau.error):
                estimate = jnp.asarray(np.ascontiguousarray(row[: self._stages])) @ k
                totals[place] = totals[place] + (estimate * scale) ** 2
        if len(totals) == 1:
            return size * jnp.sqrt(totals[0] / len(y))
        below = totals[0] + gains.SECOND_ERROR_WEIGHT * totals[1]
        return size * totals[0] / jnp.sqrt(jnp.maximum(below, 1e-300) * len(y))
