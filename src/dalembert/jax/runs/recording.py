"""Loops of traced runs: with a record of all attempts, or of those that pass over requested times alone."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ...methods.status import RUNNING
from .lanes import Attempts, Batch, State, advanced, begun, direction_of
from .mesh_axes import varying_like
from .projection import Projections, Rows

_BLOCK = 32
"""Attempts that a run without derivatives takes down before it looks which of them pass over requested times."""


def _rows(part: Any, shape: tuple[int, ...]) -> Any:
    """Return an array whose last axes have a shape, which may hold no cases, with one axis before them."""
    leading = jnp.shape(part)[: jnp.ndim(part) - len(shape)]
    return jnp.reshape(part, (math.prod(leading), *shape))


def block_of(
    attempts: Attempts, projections: Projections, room: int, batch: Batch, state: State, *, whole: bool = False
) -> tuple[Any, Any, State]:
    """Return the number of attempts, what they were (room, 2 + n_y, ...), and how cases stand behind them.

    An attempt is one row, its start, its size and the state, as every array that is written to costs an attempt time.
    The block ends with the runs, or where its room is filled; not so where the `whole` runs are wanted.
    """
    shape = jnp.shape(batch.t0)

    def row(t: Any, size: Any, y: Rows) -> Any:
        return jnp.concatenate([_rows(part, shape) for part in (t, size, *y)])

    def body(carry: Any) -> Any:
        i, state, taken = carry
        after, size = advanced(attempts, projections, batch, batch.t1, state)
        if room:
            new = row(state.t, size, state.y)
            taken = lax.dynamic_update_index_in_dim(taken, new, i, 0)
        return i + 1, after, taken

    def goes_on(carry: Any) -> Any:
        running = jnp.any(carry[1].status == RUNNING)
        return running if whole else running & (carry[0] < room)

    width = len(jax.eval_shape(row, batch.t0, batch.t0, batch.y))
    first = varying_like((0, state, jnp.zeros((room, width, *shape))), batch)
    count, end, taken = lax.while_loop(goes_on, body, first)
    return jnp.asarray(count), taken, end


def _passing(attempts: Attempts, projections: Projections, room: int, batch: Batch, t: Any) -> tuple[Any, Any, State]:
    """Return the number of attempts, where those began that pass over times t (n_t, ...), and how the run ended.

    The beginnings (n_t, 1 + n_y, ...) are a time and the state there. Attempts are taken down in blocks of `room`, so
    that memory does not grow with their number.
    """
    shape = jnp.shape(batch.t0)
    direction = direction_of(batch)

    def row(state: State) -> Any:
        return jnp.concatenate([_rows(part, shape) for part in (state.t, *state.y)])

    def attempt(carry: Any) -> Any:
        i, state, block = carry
        block = lax.dynamic_update_index_in_dim(block, row(state), i, 0)
        return i + 1, advanced(attempts, projections, batch, batch.t1, state)[0], block

    def goes_on(carry: Any) -> Any:
        return (carry[0] < room) & jnp.any(carry[1].status == RUNNING)

    def found(count: Any, block: Any, times: Any, direction: Any, begins: Any) -> Any:
        starts = jnp.where(jnp.arange(room) < count, direction * block[:, 0], jnp.inf)
        at = jnp.searchsorted(starts, direction * times, side="right") - 1
        return jnp.where((at >= 0)[:, None], block[jnp.maximum(at, 0)], begins)

    if shape:
        found = jax.vmap(found, (None, -1, -1, -1, -1), -1)

    def body(carry: Any) -> Any:
        total, state, block, begins = carry
        count, state, block = lax.while_loop(goes_on, attempt, varying_like((0, state, block), batch))
        return total + count, state, block, found(count, block, t, direction, begins)

    start = begun(attempts, batch)
    first = row(start)
    begins = jnp.broadcast_to(first, (len(t), *first.shape))
    carry = (0, start, jnp.zeros((room, *first.shape)), begins)
    carry = varying_like(carry, batch)
    count, end, _, begins = lax.while_loop(lambda carry: jnp.any(carry[1].status == RUNNING), body, carry)
    return jnp.asarray(count), begins, end


def course_of(attempts: Attempts, projections: Projections, room: int, batch: Batch, t: Any) -> tuple[Any, Any, State]:
    """Return the result of `block_of` where there is room, else of `_passing` for times t (n_t, ...) between ends."""
    if room or not len(t):
        return block_of(attempts, projections, room, batch, begun(attempts, batch), whole=True)
    return _passing(attempts, projections, _BLOCK, batch, t)
