"""Limits of step sizes in JAX: the mirror of `dalembert.integrators.step_control`."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from ...methods.step_constants import SMALLEST_OF_REST, SMALLEST_OF_TIME

__all__ = ["smallest_step"]


def smallest_step(t: Any, rest: Any) -> Any:
    """Return the size below which a step does not advance the time; ``rest`` is the time that is left."""
    return SMALLEST_OF_TIME * jnp.abs(t) + SMALLEST_OF_REST * rest
