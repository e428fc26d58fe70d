"""Continuous adjoints: variational equations forward, and adjoint equations backward beside the motion itself.

Nothing is kept of the run but its states at wanted times. From one of them to the next the motion is integrated once
more, with its changes or, backward, with the cotangents of its states and constants: to the tolerances of the run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp
from jax import lax

from ...methods.status import Status
from ...methods.tableau import Tableau
from .first_order import FirstOrder
from .lanes import RUNNING, Batch, Rows, advanced, begun
from .mesh_axes import varying_like
from .pairs import PairAttempts

__all__ = ["Continuous", "Field", "Passed"]

_RETURN = 1e4
"""Multiple of the tolerances to which a motion that is integrated backward must return to where it began."""


@final
@dataclass(frozen=True, eq=False)
class Field:
    """The rates of one case, and their cotangents.

    Attributes
    ----------
    tableau
        The pair by which they are integrated.
    rates
        (t, y, c) -> rates (n_y,).
    pull
        (t, y, c, cotangents of rates) -> cotangents of y (n_y,) and of c (n_c,).
    knots
        As for `PairAttempts`, of one row; None where there are none.
    """

    tableau: Tableau
    rates: Callable[[Any, Any, Any], Any]
    pull: Callable[[Any, Any, Any, Any], tuple[Any, Any]]
    knots: Callable[..., Rows] | None


@final
class Passed(NamedTuple):
    """Times (n_t,) that a run reached, none before the one ahead of it, the states there (n_t, n_y), and constants."""

    t: Any
    y: Any
    c: Any


@final
@dataclass(frozen=True, eq=False)
class Continuous(FirstOrder):
    """Changes of states at times (n_t, n_y), from `Passed` and changes of the first state and of the constants.

    `settings` are rtol, atol, the largest step, and how many steps may be attempted from one time to the next.
    """

    field: Field
    settings: tuple[float, float, float, int]

    def __call__(self, held: Passed, moving: Any) -> Any:
        """See `LinearMap`."""
        dy, dc = moving
        n = len(dy)

        def rates(t: Any, z: Any, c: Any) -> Any:
            return jnp.concatenate(jax.jvp(lambda y, c: self.field.rates(t, y, c), (z[:n], c), (z[n:], dc)))

        def segment(change: Any, ends: Any) -> tuple[Any, Any]:
            t0, t1, y = ends
            after = self._integrated(rates, n, t0, t1, jnp.concatenate([y, change]), held.c)[n:]
            return after, after

        _, rows = lax.scan(segment, varying_like(dy, held), (held.t[:-1], held.t[1:], held.y[:-1]))
        return jnp.concatenate([dy[None], rows])

    def pulled(self, held: Passed, given: Any) -> tuple[Any, Any]:
        """Return the cotangents of the first state and of the constants, from those of the states at times."""
        n = held.y.shape[1]
        size = jnp.max(jnp.abs(given))
        size = jnp.where(size > 0.0, size, 1.0)  # so that the absolute tolerance is one of cotangents of size 1

        def rates(t: Any, z: Any, c: Any) -> Any:
            back, share = self.field.pull(t, z[:n], c, z[n : 2 * n])
            return jnp.concatenate([self.field.rates(t, z[:n], c), -back, -share])

        def segment(carry: Any, ends: Any) -> tuple[Any, None]:
            t0, t1, begin, y, cotangent = ends
            ahead = carry.at[:n].add(cotangent / size)
            z = self._integrated(rates, n, t1, t0, jnp.concatenate([y, ahead]), held.c)
            return jnp.where(self._returned(z[:n], begin), z[n:], jnp.nan), None

        begin = varying_like(jnp.zeros(n + len(held.c)), (held, given))
        ends = held.t[:-1], held.t[1:], held.y[:-1], held.y[1:], given[1:]
        total, _ = lax.scan(segment, begin, ends, reverse=True)
        return given[0] + size * total[:n], size * total[n:]

    def _returned(self, y: Any, begin: Any) -> Any:
        """Return whether a motion that was integrated backward came to where it began: what is damped may not."""
        rtol, atol, *_ = self.settings
        return jnp.all(jnp.abs(y - begin) <= _RETURN * (atol + rtol * jnp.max(jnp.abs(begin), initial=0.0)))

    def _integrated(self, rates: Any, n: int, t0: Any, t1: Any, z: Any, c: Any) -> Any:
        """Return what follows of z at t1, the first `n` of which are the state; NaN where the integration fails."""
        knots, limits = self.field.knots, None
        if knots is not None:

            def limits(t: Any, z: Rows, c: Rows) -> Rows:
                return knots(t, (z[0][:n],), c)

        attempts = PairAttempts(lambda t, z, c: (rates(t, z[0], c[0]),), self.field.tableau, moved=False, knots=limits)
        rtol, atol, max_step, max_steps = self.settings
        batch = Batch((z,), (c,), t0, t1, (), 0.0, rtol, atol, max_step, max_steps)
        end = lax.while_loop(
            lambda state: state.status == RUNNING,
            lambda state: advanced(attempts, (), batch, t1, state)[0],
            varying_like(begun(attempts, batch), batch),
        )
        return jnp.where(end.status == int(Status.SUCCESS), end.y[0], jnp.nan)
