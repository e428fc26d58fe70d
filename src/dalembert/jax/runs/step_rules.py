"""Rules of steps in traced code: limits of sizes and projection, as `dalembert.steps` has them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
from jax import lax

from ...methods.step_constants import (
    ADMITTED_ENERGY,
    BRANCH,
    LINEAR_CHANGE,
    LINEAR_CORRECTIONS,
    SMALL_COMPONENT,
    SMALLEST_OF_REST,
)
from .precision import precision_of

Rows = tuple[Any, ...]
"""One array (k,) for each component of k states, or one (n,) with all components of a state."""

Projections = Sequence[tuple[Callable[[Any, Rows, Rows], Rows], int]]
"""Functions (t, y, c) -> correction of the state, and how often each is applied after a step."""

Tolerances = tuple[Any, Any]
"""rtol and atol of the steps, 0 for both where there are none."""


def project(
    projections: Projections, t: Any, y: Rows, c: Rows, before: Rows = (), tolerances: Tolerances = (0.0, 0.0)
) -> tuple[Rows, Any]:
    """Return states on the constraints, and where that succeeded.

    `before` are the states at the start of the step; without them nothing is known of branches.
    """
    held = jnp.ones(jnp.shape(t), dtype=bool)
    for correct, count in projections:
        for attempt in range(count):
            corrections = correct(t, y, c)
            if attempt == 0 and count == LINEAR_CORRECTIONS and before:
                size, magnitude = _largest(y, before, corrections, t)
                held &= size <= _largest_change(magnitude, *tolerances)
            if attempt == count - 1:
                _, magnitude = _largest(y, before or y, corrections, t)
                least = SMALL_COMPONENT * magnitude + tolerances[1]
            y = tuple(a + b for a, b in zip(y, corrections, strict=True))
        change = jnp.zeros(jnp.shape(t))
        for value, correction in zip(y, corrections, strict=True):
            scale = least + jnp.abs(value) + precision_of(change).smallest_normal
            change = jnp.maximum(change, _whole(jnp.abs(correction) / scale, t))
        held &= change <= max(LINEAR_CHANGE, precision_of(change).quadratic_change)
    return y, held


def _whole(values: Any, like: Any) -> Any:
    """Return the largest of the components of a state; `like` has the shape of the answer."""
    return values if jnp.ndim(values) <= jnp.ndim(like) else jnp.max(values)


def _largest(y: Rows, before: Rows, corrections: Rows, like: Any) -> tuple[Any, Any]:
    """Return size and magnitude of corrections, see `dalembert.steps.projection.add_correction`."""
    size = moved = magnitude = jnp.zeros(jnp.shape(like))
    for value, earlier, correction in zip(y, before, corrections, strict=True):
        size = jnp.maximum(size, _whole(jnp.abs(correction), like))
        away, either = jnp.abs(value + correction - earlier), jnp.maximum(jnp.abs(value), jnp.abs(earlier))
        moved = jnp.maximum(moved, _whole(jnp.where(correction != 0.0, away, 0.0), like))
        magnitude = jnp.maximum(magnitude, _whole(jnp.where(correction != 0.0, either, 0.0), like))
    return jnp.minimum(size, moved), magnitude


def _largest_change(magnitude: Any, rtol: Any, atol: Any) -> Any:
    """See `dalembert.steps.projection.largest_change`."""
    error = atol + jnp.maximum(rtol, precision_of(magnitude).smallest_of_time) * magnitude
    energy = jnp.sqrt(ADMITTED_ENERGY * error * magnitude)
    return jnp.minimum(BRANCH * magnitude, energy) + ADMITTED_ENERGY**0.5 * atol


def smallest_of(atol: Any) -> Any:
    """Return the smallest absolute tolerance, of one for all components or of one each."""
    return jnp.min(atol) if jnp.ndim(atol) else atol


def of_rows(atol: Any, y: Rows) -> Rows:
    """Return the absolute tolerance of each row of a state, which has all components or one."""
    return (atol,) * len(y) if jnp.ndim(atol) == 0 or len(y) == 1 else tuple(atol[i] for i in range(len(y)))


def weights_of(atol: Any) -> Rows:
    """Return what Taylor steps read of absolute tolerances besides the smallest (`transforms.taylor.step.SETTINGS`)."""
    if jnp.ndim(atol) == 0:
        return ()
    smallest = smallest_of(atol)
    return tuple(smallest / atol[i] for i in range(len(atol)))


def smallest_step(t: Any, rest: Any) -> Any:
    """Return the size below which a step does not advance the time; ``rest`` is the time that is left."""
    return precision_of(t).smallest_of_time * jnp.abs(t) + SMALLEST_OF_REST * rest


def limit_at_knots(limits: Any, t: Any, direction: Any) -> Any:
    """Return the largest size of a step, of those forward and backward in time that knots of tables allow."""
    limit = jnp.where(direction < 0.0, limits[1], limits[0])
    return lax.stop_gradient(jnp.maximum(limit, 4.0 * precision_of(t).smallest_of_time * jnp.abs(t)))
