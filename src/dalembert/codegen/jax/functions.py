"""Functions of generated JAX modules whose derivatives are finite where those of ``jax.numpy`` are not.

A root, a power and an arctangent have no derivative at zero, and the product of an infinite derivative with a tangent
that is zero is NaN, which a body at rest or at zero angle would meet. Here such derivatives are taken to be zero
(`dalembert.ir.derivatives.GUARDED` has the same convention). The argument is replaced before the function is
applied, because a selection after it does not stop a NaN in reverse mode.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

__all__ = ["acos", "asin", "atan2", "power", "sqrt"]


def sqrt(a: Any) -> Any:
    """Return the square root, with the derivative 0 at 0."""
    a = jnp.asarray(a)
    zero = a == 0.0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, a)))


def power(a: Any, b: Any) -> Any:
    """Return a**b, with the derivative 0 at a = 0."""
    a = jnp.asarray(a)
    zero = a == 0.0
    return jnp.where(zero, lax.stop_gradient(jnp.power(a, b)), jnp.power(jnp.where(zero, 1.0, a), b))


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y), with the derivative 0 at the origin."""
    y, x = jnp.asarray(y), jnp.asarray(x)
    origin = (y == 0.0) & (x == 0.0)
    return jnp.where(origin, lax.stop_gradient(jnp.arctan2(y, x)), jnp.arctan2(y, jnp.where(origin, 1.0, x)))


def asin(a: Any) -> Any:
    """Return the arcsine, with the derivative 0 at -1 and 1."""
    a = jnp.asarray(a)
    end = jnp.abs(a) == 1.0
    return jnp.where(end, lax.stop_gradient(jnp.arcsin(a)), jnp.arcsin(jnp.where(end, 0.0, a)))


def acos(a: Any) -> Any:
    """Return the arccosine, with the derivative 0 at -1 and 1."""
    a = jnp.asarray(a)
    end = jnp.abs(a) == 1.0
    return jnp.where(end, lax.stop_gradient(jnp.arccos(a)), jnp.arccos(jnp.where(end, 0.0, a)))
