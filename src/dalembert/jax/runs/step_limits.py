"""Limits of step sizes in JAX: the mirror of `dalembert.steps.step_control`."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

from ...methods.step_constants import SMALLEST_OF_REST
from .precision import precision_of


def smallest_step(t: Any, rest: Any) -> Any:
    """Return the size below which a step does not advance the time; ``rest`` is the time that is left."""
    return precision_of(t).smallest_of_time * jnp.abs(t) + SMALLEST_OF_REST * rest


def limit_at_knots(limits: Any, t: Any, direction: Any) -> Any:
    """Return the largest size of a step, of those forward and backward in time that knots of tables allow."""
    limit = jnp.where(direction < 0.0, limits[1], limits[0])
    return lax.stop_gradient(jnp.maximum(limit, 4.0 * precision_of(t).smallest_of_time * jnp.abs(t)))
