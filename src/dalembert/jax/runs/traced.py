"""Values that JAX traces, as arrays."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp


def is_traced(*values: Any) -> bool:
    """Return whether any of the values, which may be trees, holds something that JAX traces."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(values))


def traced_array(value: Any) -> Any:
    """Return numbers, of which JAX traces some, as an array of floating point numbers."""
    return jnp.asarray(value, dtype=float)
