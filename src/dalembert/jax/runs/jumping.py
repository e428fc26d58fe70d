"""Times at which states jump or change, along recorded runs that vary with what is differentiated.

Where rates jump, derivatives of a motion jump, too, and what is computed along its steps does not include it. A kink,
at which the rates are the same on both sides, is no harm.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp
from jax import lax

from ...frozen import frozen
from .derivatives import CHUNK, StepsRecord
from .linear_maps import LinearMap
from .mesh_axes import varying_like
from .precision import precision_of
from .run_constants import RunConstants
from .step_rules import Rows

Rates = Callable[[Any, Any, Any, Any], Any]
"""From times (n_t,), states (n_t, n_y), constants (n_c,) and breaks (n,) to rates (n_t, n_y)."""


@final
class At(NamedTuple):
    """Times (n_t,), the states there (n_t, n_y), constants (n_c,), and breaks (n,)."""

    t: Any
    y: Any
    c: Any
    breaks: Any


def _changed(rates: Rates, at: At, dy: Any, dc: Any) -> Any:
    """Return the changes of rates (n_t, n_y)."""
    return jax.jvp(lambda y, c: rates(at.t, y, c, at.breaks), (at.y, at.c), (dy, dc))[1]


@final
@frozen
class Timed(LinearMap):
    """Changes of states (n_t, n_y) as they are, given with those of the constants (n_c,).

    With the times, they change as the rates do.
    """

    rates: Rates

    def __call__(self, held: At, moving: Any) -> Any:
        """See `LinearMap`."""
        return moving[0]

    def back(self, held: At, given: Any) -> Any:
        """See `LinearMap`."""
        return given, jnp.zeros_like(held.c)

    def change(self, held: At, dheld: At, moving: Any, still: At) -> Any:
        """See `LinearMap`."""
        if still.t:
            return jnp.zeros_like(held.y)
        return dheld.t[:, None] * _changed(self.rates, held, *moving)

    def change_back(self, held: At, dheld: At, given: Any, still: At) -> Any:
        """See `LinearMap`."""
        if still.t:
            return jnp.zeros_like(held.y), jnp.zeros_like(held.c)
        return jax.vjp(partial(_changed, self.rates, held), held.y, held.c)[1](dheld.t[:, None] * given)


_HALVINGS = 52
_AT_ONCE = 1e-12
"""Share of a step up to which a change is at its start."""
_ROUNDS = 2
"""Largest number of changes examined between two points."""

OnRows = Callable[[Any, Rows, Rows], Rows]


def sure_until(
    decided: OnRows, rates: OnRows, constants: RunConstants, record: StepsRecord, c: Any, direction: Any
) -> Any:
    """Return up to which time a run went across no jump, infinity in its `direction` if it went across none.

    Parameters
    ----------
    decided
        (t, y, c) -> the values in the rates that jump, comparisons for instance, on rows.
    rates
        (t, y, c) -> rates, on rows.
    constants, record, c
        What constants are; the run, and its constants (n_c,).
    direction
        1 where time runs forward, -1 where it runs backward.
    """

    def chunk(number: Any, until: Any) -> Any:
        t, y = _points(rates, constants, record, number * CHUNK, c)
        begins = jnp.repeat(t[:-1:2], 2)
        rows = constants.rows(c, jnp.repeat(t[1::2], 2))
        jumps = _jumps(decided, rates, t, y, rows, number == 0)
        return jnp.minimum(until, jnp.min(jnp.where(jumps, direction * begins, jnp.inf)))

    return direction * lax.fori_loop(0, -(-record.count // CHUNK), chunk, varying_like(jnp.inf, (record, c, direction)))


def moved_until(
    rates: OnRows, constants: RunConstants, states: Any, c: Any, direction: Any, course: tuple[Any, Any, Any, Any]
) -> Any:
    """Return up to which time a run came to no break that moves and at which rates jump, else as `sure_until`.

    `states` (n, n_y) are those at the breaks; `course` is the end of the run, the time that it reached, its breaks
    (n,), and which of them move.
    """
    end, reached, breaks, moved = course
    inside = moved & (direction * breaks < direction * reached)
    t, behind = jnp.where(inside, breaks, 0.0), jnp.append(0.0, breaks[:-1])
    ahead = jnp.append(breaks[1:], end)
    ahead = jnp.where(jnp.isfinite(ahead), ahead, end)
    middles = (jnp.where(inside, 0.5 * (a + b), 0.0) for a, b in ((behind, breaks), (breaks, ahead)))
    one, other = (_table(rates, t, states, constants.rows(c, middle)) for middle in middles)
    return direction * jnp.min(jnp.where(inside & _apart(one, other), direction * breaks, jnp.inf))


def _apart(one: Any, other: Any) -> Any:
    """Return where rates (k, n_y) on two sides differ by more than rounding."""
    size = jnp.maximum(jnp.max(jnp.abs(one), axis=1), jnp.max(jnp.abs(other), axis=1))
    return ~jnp.all(jnp.abs(one - other) <= precision_of(size).jump * size[:, None], axis=1)


def _points(rates: OnRows, constants: RunConstants, record: StepsRecord, first: Any, c: Any) -> tuple[Any, Any]:
    """Return times (2 CHUNK + 1,) and states there (2 CHUNK + 1, n_y): ends of steps, and their middles."""
    number = first + jnp.arange(CHUNK + 1)
    taken = record.taken[jnp.minimum(number, len(record.taken) - 1)]
    inside = number < record.count
    t = jnp.where(inside, taken[:, 0], record.reached)
    y = jnp.where(inside[:, None], taken[:, 2:], record.end)
    h = jnp.diff(t)
    slopes = _table(rates, t, y, constants.rows(c, t + 0.5 * jnp.append(h, 0.0)))
    middle = 0.5 * (y[1:] + y[:-1]) + 0.125 * h[:, None] * (slopes[:-1] - slopes[1:])
    times = jnp.append(jnp.stack([t[:-1], t[:-1] + 0.5 * h], axis=1).ravel(), t[-1])
    states = jnp.stack([y[:-1], middle], axis=1).reshape(2 * CHUNK, -1)
    return times, jnp.concatenate([states, y[-1:]])


def _jumps(decided: OnRows, rates: OnRows, t: Any, y: Any, c: Rows, begins: Any) -> Any:
    """Return between which points rates jump; what is left at once where a run `begins` is not among it."""

    def at(share: Any) -> tuple[Any, Any]:
        return t[:-1] + share * jnp.diff(t), y[:-1] + share[:, None] * jnp.diff(y, axis=0)

    def made(share: Any) -> Any:
        return _table(decided, *at(share), c)

    def differ(a: Any, b: Any) -> Any:
        return jnp.any(a != b, axis=1)

    def search(low: Any) -> Any:
        """Return shares below and above the first change that halving finds."""
        first = made(low)

        def halve(carry: Any) -> Any:
            number, low, high = carry
            middle = 0.5 * (low + high)
            changed = differ(made(middle), first)
            return number + 1, jnp.where(changed, low, middle), jnp.where(changed, middle, high)

        def unfinished(carry: Any) -> Any:
            return (carry[0] < _HALVINGS) & jnp.any(open_)

        open_ = differ(made(jnp.ones_like(low)), first)
        _, low, high = lax.while_loop(unfinished, halve, varying_like((0, low, jnp.ones_like(low)), (t, y, c)))
        return open_, low, high

    low = jnp.zeros(len(t) - 1)
    found = jnp.zeros(len(t) - 1, dtype=bool)
    for _ in range(_ROUNDS):
        open_, below, low = search(low)
        one, other = (_table(rates, *at(share), c) for share in (below, low))
        at_start = begins & (jnp.arange(len(low)) == 0) & (low < _AT_ONCE)
        found |= open_ & _apart(one, other) & ~at_start
    return found


def _table(function: OnRows, t: Any, y: Any, c: Rows) -> Any:
    """Return the values (k, n) of a function on rows at times (k,) and states (k, n_y)."""
    rows = function(t, tuple(y.T), c)
    return jnp.stack([jnp.broadcast_to(row, t.shape) for row in rows], axis=1)
