"""First states of runs whose start is differentiated, while what ends their steps stays where it is."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from .derivatives import instantiate


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def started(rates: Callable[[Any, Any, Any], Any], y: Any, t: Any, c: Any) -> Any:
    """Return the state (n_y,) at time 0 of a run from the state y (n_y,) at the time t, which is 0, too.

    It changes with t as a motion with ``rates(t, y, c)`` does, in derivatives up to the fourth.
    """
    # In a batch whose cases differ in t or c alone JAX takes the value for one of all cases, and the change for one of
    # each, which it does not bring together.
    return jnp.where(True, y, t + jnp.sum(c))


@partial(started.defjvp, symbolic_zeros=True)
def _(rates: Callable[[Any, Any, Any], Any], values: Any, tangents: Any) -> tuple[Any, Any]:
    def reached(y: Any, t: Any, c: Any) -> Any:
        # A step of the classical method, of which derivatives up to the fourth by its size are those of the motion.
        h = -t
        k1 = rates(t, y, c)
        k2 = rates(0.5 * t, y + 0.5 * h * k1, c)
        k3 = rates(0.5 * t, y + 0.5 * h * k2, c)
        k4 = rates(0.0, y + h * k3, c)
        return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    value = started(rates, *values)
    if isinstance(tangents[1], SymbolicZero):
        return value, instantiate(tangents[0])
    return value, jax.jvp(reached, values, tuple(instantiate(tangent) for tangent in tangents))[1]
