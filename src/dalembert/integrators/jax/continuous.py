"""Continuous adjoints: variational equations forward, and adjoint equations backward beside the motion itself.

Nothing is kept of the run but its states at marks: requested times, and breaks at which constants change, such as
knots of inputs. From one mark to the next the motion is integrated once more to the tolerances of the run: with its
changes or, backward, with the cotangents of its states and constants.
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
from .lanes import RUNNING, Batch, advanced, begun
from .mesh_axes import varying_like
from .pairs import PairAttempts
from .projection import Rows
from .run_constants import RunConstants

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
        (t, y, c) -> rates (n_y,), c as `RunConstants.of_one` has it.
    pull
        (t, y, c, cotangents of rates) -> cotangents of y (n_y,) and of c.
    knots
        As for `PairAttempts`, of one row; None where there are none.
    constants
        What the constants of a run are.
    """

    tableau: Tableau
    rates: Callable[[Any, Any, Rows], Any]
    pull: Callable[[Any, Any, Rows, Any], tuple[Any, Rows]]
    knots: Callable[..., Rows] | None
    constants: RunConstants


@final
class Passed(NamedTuple):
    """The marks that a run reached, and its constants, in floating point numbers.

    Attributes
    ----------
    t, y : Array (n,), (n, n_y)
        Times of the marks in the order of the run, and the states there; what lies behind `count` is no mark.
    count : Array ()
    at : Array (n_t,)
        Numbers of the marks that are the requested times; the last one where a time was not reached.
    c : Array (n_c,)
    requested : Array (n_t,)
        The requested times, for derivatives of second order by them to be noticed.
    """

    t: Any
    y: Any
    count: Any
    at: Any
    c: Any
    requested: Any


@final
@dataclass(frozen=True, eq=False)
class Continuous(FirstOrder):
    """Changes of states at times (n_t, n_y), from `Passed` and changes of the first state and of the constants.

    `settings` are rtol, atol, the largest step, and how many steps may be attempted from one mark to the next.
    """

    field: Field
    settings: tuple[float, float, float, int]

    def __call__(self, held: Passed, moving: Any) -> Any:
        """See `LinearMap`."""
        dy, dc = moving
        n, at = len(dy), held.at.astype(int)
        of_one = self.field.constants.of_one

        def segment(number: Any, carry: Any) -> Any:
            change, rows = carry
            t0, t1, middle = _segment(held, number)
            c, changes = jax.jvp(lambda c: of_one(c, middle), (held.c,), (dc,))

            def rates(t: Any, z: Any, c: Rows) -> Any:
                return jnp.concatenate(jax.jvp(lambda y, c: self.field.rates(t, y, c), (z[:n], c), (z[n:], changes)))

            change = self._integrated(rates, n, t0, t1, jnp.concatenate([held.y[number], change]), c)[n:]
            return change, lax.dynamic_update_index_in_dim(rows, change, number + 1, 0)

        begin = varying_like((dy, jnp.zeros_like(held.y).at[0].set(dy)), (held, dc))
        return lax.fori_loop(0, _segments(held), segment, begin)[1][at]

    def pulled(self, held: Passed, given: Any) -> tuple[Any, Any]:
        """Return the cotangents of the first state and of the constants, from those of the states at times."""
        n, constants = held.y.shape[1], self.field.constants
        size = jnp.max(jnp.abs(given))
        size = jnp.where(size > 0.0, size, 1.0)  # so that the absolute tolerance is one of cotangents of size 1
        cotangents = jnp.zeros_like(held.y).at[held.at.astype(int)].add(given / size)

        def rates(t: Any, z: Any, c: Rows) -> Any:
            back, share = self.field.pull(t, z[:n], c, z[n : 2 * n])
            return jnp.concatenate([self.field.rates(t, z[:n], c), -back, *(-part for part in share)])

        def segment(turn: Any, carry: Any) -> Any:
            ahead, total = carry
            number = _segments(held) - 1 - turn
            t0, t1, middle = _segment(held, number)
            c = constants.of_one(held.c, middle)
            z = jnp.concatenate([held.y[number + 1], ahead + cotangents[number + 1], *map(jnp.zeros_like, c)])
            z = self._integrated(rates, n, t1, t0, z, c)
            z = jnp.where(self._returned(z[:n], held.y[number]), z, jnp.nan)
            share = jnp.split(z[2 * n :], [len(c[0])])[: len(c)]
            return z[n : 2 * n], constants.added(total, tuple(share), held.c, middle)

        begin = varying_like((jnp.zeros(n), jnp.zeros_like(held.c)), (held, given))
        first, total = lax.fori_loop(0, _segments(held), segment, begin)
        return size * (first + cotangents[0]), size * total

    def _returned(self, y: Any, begin: Any) -> Any:
        """Return whether a motion that was integrated backward came to where it began: what is damped may not."""
        rtol, atol, *_ = self.settings
        return jnp.all(jnp.abs(y - begin) <= _RETURN * (atol + rtol * jnp.max(jnp.abs(begin), initial=0.0)))

    def _integrated(self, rates: Any, n: int, t0: Any, t1: Any, z: Any, c: Rows) -> Any:
        """Return what follows of z at t1, the first `n` of which are the state; NaN where the integration fails."""
        knots, limits = self.field.knots, None
        if knots is not None:

            def limits(t: Any, z: Rows, c: Rows) -> Rows:
                return knots(t, (z[0][:n],), c)

        attempts = PairAttempts(lambda t, z, c: (rates(t, z[0], c),), self.field.tableau, moved=False, knots=limits)
        rtol, atol, max_step, max_steps = self.settings
        batch = Batch((z,), c, t0, t1, 0.0, rtol, atol, max_step, max_steps)
        end = lax.while_loop(
            lambda state: state.status == RUNNING,
            lambda state: advanced(attempts, (), batch, t1, state)[0],
            varying_like(begun(attempts, batch), batch),
        )
        return jnp.where(end.status == int(Status.SUCCESS), end.y[0], jnp.nan)


def _segments(held: Passed) -> Any:
    """Return how many segments lie between marks: a number where that is known while tracing, for a plain loop."""
    return len(held.t) - 1 if len(held.t) == len(held.at) else held.count.astype(int) - 1


def _segment(held: Passed, number: Any) -> tuple[Any, Any, Any]:
    """Return begin, end and middle of a segment."""
    t0, t1 = held.t[number], held.t[number + 1]
    return t0, t1, t0 + 0.5 * (t1 - t0)
