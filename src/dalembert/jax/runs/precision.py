"""Precision of JAX code, and how it is compiled: double inside, whatever the process has; full products.

Accelerators multiply matrices of 32 bits with ten binary digits or so by default.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ...arrays import FloatArray
from ...frozen import frozen
from ...methods import step_constants

CONFIG: Any = jax.config
"""Settings of JAX, whose names its types know in some releases only."""


@final
@frozen
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
    return DOUBLE if CONFIG.jax_enable_x64 else SINGLE


def double_precision() -> contextlib.AbstractContextManager[Any]:
    """Trace and run in 64 bits, in this thread only; JAX keys what it compiled by this setting.

    NaN is a status of ours, so that a user's ``jax_debug_nans`` does not apply inside.
    """
    if not CONFIG.jax_debug_nans:
        return jax.enable_x64(True)
    return _without_debugging()


@contextlib.contextmanager
def _without_debugging() -> Iterator[None]:
    with jax.enable_x64(True), jax.debug_nans(False):
        yield


def product(a: Any, b: Any) -> Any:
    """Return the product of matrices and vectors."""
    return jnp.matmul(a, b, precision=lax.Precision.HIGHEST)


def contracted(weights: Any, rows: Any) -> Any:
    """Return the sum of weights (k,) or (n, k) times what lies along the first axis of `rows`.

    `rows` is an array (k, ...), or a tuple of k arrays, for which `weights` (k,) are numbers.
    """
    if isinstance(rows, tuple):
        return _sum(weights, rows)
    weights = jnp.asarray(weights, dtype=rows.dtype)
    if jax.default_backend() == "cpu" or weights.ndim > 1:
        return jnp.tensordot(weights, rows, 1, precision=lax.Precision.HIGHEST)
    return jnp.sum(jnp.expand_dims(weights, tuple(range(1, jnp.ndim(rows)))) * rows, axis=0)  # fused with others


def _sum(weights: FloatArray, rows: tuple[Any, ...]) -> Any:
    """Return a sum without the terms whose weight is zero."""
    terms = [float(weight) * row for weight, row in zip(np.asarray(weights), rows, strict=False) if weight]
    return sum(terms[1:], start=terms[0]) if terms else jnp.zeros_like(rows[0])


LARGEST_FUSED = 1000
"""Operations of a step up to which XLA is left to fuse them. It repeats in one fused loop for each component of the
state what these have in common, and LLVM takes more than proportionally long over a long loop: 640 operations in five
components compile in 0.5 s and run three times faster than unfused; 2,559 in eight do not compile within a minute,
and unfused in 2.5 s. Runge-Kutta attempts are faster unfused from the start (measured on CPU)."""


def compiled(function: Callable[..., Any], operations: int) -> Any:
    """Return `function` jitted; on CPU, XLA fuses nothing in it where it holds more than `LARGEST_FUSED` operations."""
    long = operations > LARGEST_FUSED and jax.default_backend() == "cpu"
    return jax.jit(function, compiler_options={"xla_disable_hlo_passes": "fusion"} if long else None)


def is_traced(*values: Any) -> bool:
    """Return whether any of the values, which may be trees, holds something that JAX traces."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(values))


def traced_array(value: Any) -> Any:
    """Return numbers, of which JAX traces some, as an array of floating point numbers."""
    return jnp.asarray(value, dtype=float)
