"""Functions of generated JAX modules whose derivatives are finite where those of ``jax.numpy`` are not.

A root, a power and an arctangent have no derivative at zero, and the product of an infinite derivative with a tangent
that is zero is NaN, which a body at rest or at zero angle would meet. Here such derivatives are taken to be zero
(`dalembert.transforms.derivatives.GUARDED` has the same convention). The argument is replaced before the function is
applied, because a selection after it does not stop a NaN in reverse mode. For the same reason `guarded` wraps
whatever only branches of selections use: a quotient in the branch that is not taken may divide by zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ..ir.tables import numbers_of, table_of


def guarded(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return an element-by-element function of arrays, with derivatives 0 where they are not finite.

    The cotangent of a branch that was not chosen is zero, and stays so only in products with numbers.
    """
    guard = jax.custom_jvp(function)

    def push(values: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        moved = jnp.zeros(())
        for i, tangent in enumerate(tangents):
            one = tuple(jnp.ones_like(v) if i == j else jnp.zeros_like(v) for j, v in enumerate(values))
            partial = jax.jvp(function, values, one)[1]
            moved = moved + jnp.where(jnp.isfinite(partial), partial, 0.0) * tangent
        return function(*values), moved

    guard.defjvp(push)
    return guard(*(jnp.asarray(argument) for argument in arguments))


def product(a: Any, b: Any) -> Any:
    """Return a * b, with derivatives 0 where a factor is not finite; traced sooner than `guarded`."""
    finite = jnp.isfinite(a) & jnp.isfinite(b)
    moving = jnp.where(finite, a, 0.0) * jnp.where(finite, b, 0.0)
    return jnp.where(finite, moving, lax.stop_gradient(a * b))


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


def piece(x: Any, key: int) -> Any:
    """Return the number of the piece of a table that x lies in, as `dalembert.ir.tables.piece` does."""
    found = jnp.searchsorted(jnp.asarray(table_of(key).edges), lax.stop_gradient(x), side="right")
    return jnp.where(jnp.isnan(x), 0.0, found.astype(float))


def entry(place: Any, key: int, row: int) -> Any:
    """Return a number of a piece of a table."""
    return jnp.asarray(numbers_of(key).row(row))[lax.stop_gradient(place).astype(int)]
