"""Derivatives along the steps of a run that are taken once more: of n steps, some sqrt(n) are in memory at a time.

A first run keeps where it was after every so many attempts. Along these blocks the derivatives are those of recorded
runs (`dalembert.integrators.jax.derivatives`); the record of a block is made when its turn comes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp
from jax import lax

from .along import Along, Course, PulledStep, PushedStep, Step
from .derivatives import CHUNK, Record, pushed
from .first_order import FirstOrder
from .lanes import RUNNING, Attempts, Batch, State, advanced, begun
from .mesh_axes import varying_like
from .projection import Projections
from .run_constants import RunConstants

__all__ = ["Blocks", "Kept", "Recomputed", "attempts_of_a_block", "with_blocks"]


@final
class Kept(NamedTuple):
    """The blocks of a run and its steps to requested times, in floating point numbers.

    Attributes
    ----------
    states
        Where it was at the start of each block, with what the method remembers; the first axis counts the blocks.
    count : Array ()
        Number of blocks.
    end : Array (n_y,)
        The last state.
    at, begins, sizes, states_there : Array (n_t,), (n_t, n_y)
        The attempts that pass over requested times, by number; when these began, how far they go, and the states there.
    t0, t1, c, breaks : Array
        Start, end, constants (n_c,), and breaks (n,).
    requested : Array (n_t,)
        The requested times, for derivatives of second order by them to be noticed.
    """

    states: Any
    count: Any
    end: Any
    at: Any
    begins: Any
    sizes: Any
    states_there: Any
    t0: Any
    t1: Any
    c: Any
    breaks: Any
    requested: Any


def attempts_of_a_block(max_steps: int) -> int:
    """Return the number of attempts in a block."""
    return CHUNK * max(1, math.ceil(math.sqrt(max_steps) / CHUNK))


@final
@dataclass(frozen=True, eq=False)
class Blocks:
    """A run of one case in blocks of attempts.

    Attributes
    ----------
    attempts, projections
        The method.
    settings
        Floor, rtol, atol, the largest step, and how many steps may be attempted.
    constants
        What the constants of the run are.
    """

    attempts: Attempts
    projections: Projections
    settings: tuple[float, float, float, float, int]
    constants: RunConstants

    @property
    def length(self) -> int:
        """Attempts of a block."""
        return attempts_of_a_block(self.settings[-1])

    def batch(self, t0: Any, t1: Any, y: Any, c: Any, breaks: Any) -> Batch:
        """Return the case."""
        batch = Batch((y,), self.constants.split(c), t0, t1, *self.settings)
        if not len(breaks):
            return batch
        return batch._replace(breaks=breaks, between=self.constants.reading(c, breaks, t0, t1))

    def block(self, batch: Batch, state: State) -> tuple[Any, Any, State]:
        """Return the number of attempts of a block, what they were (length, 2 + n_y), and the state behind it."""

        def body(carry: Any) -> Any:
            i, state, taken = carry
            after, size = advanced(self.attempts, self.projections, batch, batch.t1, state)
            row = jnp.concatenate([jnp.stack([state.t, size]), state.y[0]])
            return i + 1, after, lax.dynamic_update_index_in_dim(taken, row, i, 0)

        first = varying_like((0, state, jnp.zeros((self.length, 2 + len(state.y[0])))), (batch, state))
        count, end, taken = lax.while_loop(
            lambda carry: (carry[0] < self.length) & (carry[1].status == RUNNING), body, first
        )
        return count, taken, end


def _packed(state: State) -> State:
    """Return a state in floating point numbers."""
    return jax.tree.map(lambda value: value.astype(float), state)


def _unpacked(state: State) -> State:
    """Return a state from floating point numbers."""
    passed = jax.tree.map(lambda value: value.astype(int), state.passed)
    return state._replace(status=state.status.astype(int), passed=passed)


def with_blocks(blocks: Blocks, t: Any, y: Any, c: Any, breaks: Any) -> tuple[State, Kept]:
    """Return the end of a run from the state y at t[0] to t[-1], and what is kept for derivatives.

    That is at all of the times t (n_t,), in any order between the first and the last, if there are more than two.
    """
    batch, requested = blocks.batch(t[0], t[-1], y, c, breaks), t if len(t) > 2 else t[:0]
    direction, length = jnp.where(t[-1] >= t[0], 1.0, -1.0), blocks.length
    start = begun(blocks.attempts, batch)
    room = -(-blocks.settings[-1] // length)
    states = jax.tree.map(lambda value: jnp.zeros((room, *jnp.shape(value))), _packed(start))

    def body(carry: Any) -> Any:
        number, state, states, at, rows = carry
        states = jax.tree.map(
            lambda kept, value: lax.dynamic_update_index_in_dim(kept, value, number, 0), states, _packed(state)
        )
        count, taken, after = blocks.block(batch, state)
        if len(requested):
            starts = jnp.where(jnp.arange(length) < count, direction * taken[:, 0], jnp.inf)
            found = jnp.searchsorted(starts, direction * requested, side="right") - 1
            inside = found >= 0
            at = jnp.where(inside, number * length + found, at)
            rows = jnp.where(inside[:, None], taken[jnp.maximum(found, 0)], rows)
        return number + 1, after, states, at, rows

    first = jnp.concatenate([jnp.stack([t[0], 0.0]), y])
    carry = 0, start, states, jnp.zeros(len(requested), dtype=int), jnp.tile(first, (len(requested), 1))
    carry = varying_like(carry, batch)
    number, end, states, at, rows = lax.while_loop(lambda carry: carry[1].status == RUNNING, body, carry)
    reached = direction * (requested - end.t) <= 0.0
    sizes = jnp.where(reached, requested - rows[:, 0], 0.0)
    count = jnp.asarray(number).astype(float)
    kept = Kept(states, count, end.y[0], at.astype(float), rows[:, 0], sizes, rows[:, 2:], t[0], t[-1], c, breaks, t)
    return end, kept


@final
@dataclass(frozen=True, eq=False)
class Recomputed(FirstOrder):
    """Changes of the last state (n_y,) and of those at requested times (n_t, n_y), from `Kept`.

    They follow from changes of the first state and of the constants, as of `Along`.
    """

    linear: Any
    blocks: Blocks

    def record(self, held: Kept, number: Any) -> tuple[Record, Any]:
        """Return the record of a block, and the number of its first attempt."""
        state = jax.tree.map(lambda rows: lax.dynamic_index_in_dim(rows, number, keepdims=False), held.states)
        batch = self.blocks.batch(held.t0, held.t1, state.y[0], held.c, held.breaks)
        count, taken, end = self.blocks.block(batch, _unpacked(state))
        return Record(count, taken, end.y[0], end.t, jnp.nan), number * self.blocks.length

    def over(self, held: Kept) -> Any:
        """Return the steps over requested times."""
        return held.begins, held.sizes, jnp.broadcast_to(held.count, held.begins.shape)

    def __call__(self, held: Kept, moving: Any) -> Any:
        """See `LinearMap`."""
        dy, dc = moving
        timed = len(held.at) > 0
        starts = jnp.tile(dy, (len(held.at), 1))

        def one(number: Any, carry: Any) -> Any:
            change, starts = carry
            record, first = self.record(held, number)
            rows, after = pushed(self.linear, record, held.c, change, dc, keep=timed)
            if timed:
                own = held.at.astype(int) - first
                inside = (own >= 0) & (own < self.blocks.length)
                starts = jnp.where(inside[:, None], rows[jnp.clip(own, 0, self.blocks.length - 1)], starts)
            return after, starts

        end, starts = lax.fori_loop(0, held.count.astype(int), one, varying_like((dy, starts), (held, moving)))
        if not timed:
            return end, starts
        rows = held.states_there, starts
        return end, PushedStep(Step(self.linear))(self.over(held), rows, (held.c, dc, held.end))[0]

    def pulled(self, held: Kept, given: Any) -> Any:
        """Return the cotangents of the first state and of the constants, from those of the value."""
        end, at_times = given
        share, length = jnp.zeros_like(held.c), self.blocks.length
        starts = jnp.zeros((0, len(end)))
        if len(held.at):
            step = PulledStep(Step(self.linear))
            starts, share = step(self.over(held), (held.states_there, at_times), (held.c, held.end))

        def one(turn: Any, carry: Any) -> Any:
            ahead, share = carry
            record, first = self.record(held, held.count.astype(int) - 1 - turn)
            kept: tuple[Any, ...] = ()
            if len(held.at):
                own = held.at.astype(int) - first
                inside = (own >= 0) & (own < length)
                some = jnp.where(inside[:, None], starts, 0.0)
                kept = (jnp.zeros((length, len(end))).at[jnp.clip(own, 0, length - 1)].add(some),)
            none = jnp.zeros(0)
            course = Course(record.count.astype(float), record.taken, record.end, none, none, none, held.c)
            against = Along(self.linear, kept=bool(kept)).transposed
            before, added = against(course, (ahead, jnp.zeros((0, len(end))), *kept))
            return before, share + added

        first, share = lax.fori_loop(0, held.count.astype(int), one, varying_like((end, share), (held, given)))
        # Where no step was taken, every time is the first.
        return jnp.where(held.count > 0.0, first, first + jnp.sum(starts, 0)), share
