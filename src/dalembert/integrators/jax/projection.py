"""Projection of states onto the constraints in traced code: the rules of `dalembert.integrators.projection`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp

from ...methods.step_constants import BRANCH, LINEAR_CHANGE, LINEAR_CORRECTIONS, SLOW
from .precision import precision_of

__all__ = ["CORRECTIONS", "Projections", "Rows", "project"]

Rows = tuple[Any, ...]
"""One array (k,) for each component of k states, or one (n,) with all components of a state."""

Projections = Sequence[tuple[Callable[[Any, Rows, Rows], Rows], int]]
"""Functions (t, y, c) -> correction of the state, and how often each is applied after a step."""

CORRECTIONS = {"project_position": 3, "project_velocity": LINEAR_CORRECTIONS}
"""Number of times that each correction is applied, always, so that derivatives pass through; from the end of an
accepted step the first one leaves the square of the step's error, and the last removes rounding."""


def project(projections: Projections, t: Any, y: Rows, c: Rows) -> tuple[Rows, Any]:
    """Return states on the constraints, and where that succeeded."""
    held = jnp.ones(jnp.shape(t), dtype=bool)
    for correct, count in projections:
        change = jnp.zeros(jnp.shape(t))
        for attempt in range(count):
            corrections = correct(t, y, c)
            if attempt == 0 and count == LINEAR_CORRECTIONS:
                held &= _on_branch(y, corrections, t)
            y = tuple(a + b for a, b in zip(y, corrections, strict=True))
        for value, correction in zip(y, corrections, strict=True):
            change = jnp.maximum(change, _whole(jnp.abs(correction) / (SLOW + jnp.abs(value)), t))
        held &= change <= max(LINEAR_CHANGE, precision_of(change).quadratic_change)
    return y, held


def _whole(values: Any, like: Any) -> Any:
    """Return the largest of the components of a state; `like` has the shape of the answer."""
    return values if jnp.ndim(values) <= jnp.ndim(like) else jnp.max(values)


def _on_branch(y: Rows, corrections: Rows, like: Any) -> Any:
    """Return where corrections of velocities are small beside them."""
    size = magnitude = jnp.zeros(jnp.shape(like))
    for value, correction in zip(y, corrections, strict=True):
        size = jnp.maximum(size, _whole(jnp.abs(correction), like))
        magnitude = jnp.maximum(magnitude, _whole(jnp.where(correction != 0.0, jnp.abs(value), 0.0), like))
    return size <= BRANCH * (SLOW + magnitude)
