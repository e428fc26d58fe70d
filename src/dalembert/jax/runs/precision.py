"""Precision of JAX code: double inside, whatever the process has, and the constants of traced code in either."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, final

import jax
import jax.numpy as jnp

from ...methods import step_constants


@final
@dataclass(frozen=True)
class Precision:
    """Constants of steps and projections in one floating point type.

    Attributes
    ----------
    smallest_of_time, smallest_normal, smallest_scale, stretch, quadratic_change : float
        As `dalembert.methods.step_constants` has them.
    jump : float
        Share of the rates that counts as a jump.
    rtol, atol : float
        Tolerances of traced runs unless others are given.
    least_rtol, least_atol : float
        Tolerances below which rounding makes the error, so that steps get shorter while errors do not.
    """

    smallest_of_time: float
    smallest_normal: float
    smallest_scale: float
    stretch: float
    quadratic_change: float
    jump: float
    rtol: float
    atol: float
    least_rtol: float = 0.0
    least_atol: float = 0.0


DOUBLE = Precision(
    smallest_of_time=step_constants.SMALLEST_OF_TIME,
    smallest_normal=step_constants.SMALLEST_NORMAL,
    smallest_scale=step_constants.SMALLEST_SCALE,
    stretch=step_constants.STRETCH,
    quadratic_change=step_constants.QUADRATIC_CHANGE,
    jump=1e-7,
    rtol=1e-8,
    atol=1e-10,
)

_EPSILON = 2.0**-23
SINGLE = Precision(
    smallest_of_time=16.0 * _EPSILON,
    smallest_normal=1e-37,
    smallest_scale=1e-15,
    stretch=1.0 + 4.0 * _EPSILON,
    quadratic_change=3e-4,
    jump=1e-3,
    rtol=1e-5,
    atol=1e-7,
    least_rtol=1e-6,
    least_atol=1e-8,
)


def precision_of(*values: Any) -> Precision:
    """Return the precision of what is computed from values: that of their common type."""
    return DOUBLE if jnp.result_type(*values) == jnp.float64 else SINGLE


def process_precision() -> Precision:
    """Return the precision of numbers that are traced in this process."""
    return DOUBLE if jax.config.jax_enable_x64 else SINGLE  # type: ignore[attr-defined]


def double_precision() -> contextlib.AbstractContextManager[Any]:
    """Trace and run in 64 bits, in this thread only; JAX keys what it compiled by this setting.

    NaN is a status of ours, so that a user's ``jax_debug_nans`` does not apply inside.
    """
    if not jax.config.jax_debug_nans:  # type: ignore[attr-defined]
        return jax.enable_x64(True)
    return _without_debugging()


@contextlib.contextmanager
def _without_debugging() -> Iterator[None]:
    with jax.enable_x64(True), jax.debug_nans(False):
        yield
