"""Sums of products in the full precision of their numbers.

Accelerators multiply matrices of 32 bits with ten binary digits or so unless they are told otherwise.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ...arrays import FloatArray


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
