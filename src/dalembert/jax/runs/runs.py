"""Runs of one method for one program as they are: traced loops or calls of machine code, alone and many.

Loops that rules of ours differentiate are guarded (`ruled`). Where JAX differentiates ``jax.lax.scan`` forward over
reverse, it takes functions with derivatives of their own apart and differentiates what is inside: a loop without a
derivative, or one whose derivative is another. It leaves functions with batches of their own whole, with what they
hold.
"""

from __future__ import annotations

import math
from typing import Any, NoReturn, final

import jax
import jax.numpy as jnp
from jax import lax

from ...errors import CapabilityError
from ...methods.status import RUNNING, Status
from .derivatives import Over, Steps, StepsRecord, alone_or_many
from .lanes import Attempts, Batch, State, advanced, begun, direction_of
from .mesh_axes import stack, varying_like
from .run_data import Limits, RunPieces, in_order, middles
from .step_rules import Projections, Rows

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


@jax.custom_batching.custom_vmap
def ruled(*values: Any) -> Any:
    """Return values from which something is computed that has derivatives by a rule alone.

    Differentiating them raises a `CapabilityError`.
    """
    return _guarded(*values)


@ruled.def_vmap
def _(size: int, batched: Any, *values: Any) -> tuple[Any, Any]:
    return ruled(*values), tuple(batched)


@jax.custom_jvp
def _guarded(*values: Any) -> Any:
    return values


@_guarded.defjvp
def _(primals: Any, tangents: Any) -> NoReturn:
    raise CapabilityError(
        "JAX has dropped the rule by which a run is differentiated, as it does where jax.lax.scan or jax.lax.map is"
        " differentiated forward over reverse (jax.hessian, jax.jacfwd of jax.grad). Use jax.jacrev(jax.jacfwd(f)) or"
        " jax.jacfwd(jax.jacfwd(f)) there, or jax.vmap in place of jax.lax.map"
    )


@final
class Runs:
    """Runs as functions that JAX vectorises, without derivatives, and rates along them, with derivatives.

    Parameters
    ----------
    pieces : Pieces
        The method.
    limits : Limits
        How the steps are chosen.
    """

    def __init__(self, pieces: RunPieces, limits: Limits) -> None:
        self._pieces, self._limits = pieces, limits

    def _batch(self, t0: Any, t1: Any, y: Any, c: Any, breaks: Any) -> Batch:
        limits, constants = self._limits, self._pieces.steps.constants
        batch = Batch(y, c, t0, t1, limits.floor, limits.rtol, limits.atol, limits.max_step, limits.max_steps)
        if not len(breaks):
            return batch
        return batch._replace(breaks=breaks, between=constants.reading(c, breaks, t0, t1))

    def one(self, room: int, *given: Any) -> StepsRecord:
        """Run one case at times t, from y, with c and breaks, as one of a batch where it is vectorised."""
        foreign = self._pieces.foreign

        def cases(t: Any, y: Any, c: Any) -> StepsRecord:
            if len(t) == 1:
                found = self._alone(room, t[0], y[0], c[0])
                return StepsRecord(found.count, *(value[jnp.newaxis] for value in found[1:]))
            return self._many(room, t, y, c, jnp.zeros((len(t), 0)))

        @jax.custom_batching.custom_vmap
        def one(t: Any, y: Any, c: Any, breaks: Any) -> StepsRecord:
            if foreign is None or not foreign.serves:
                return self._alone(room, t, y, c, breaks)
            found = foreign(self._limits, room, cases, 1, t[jnp.newaxis], y[jnp.newaxis], c[jnp.newaxis])
            return StepsRecord(found.count, *(value[0] for value in found[1:]))

        @one.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[StepsRecord, StepsRecord]:
            each = StepsRecord(False, *[True] * 6)
            if foreign is not None and foreign.serves:
                own = (a if b else a[jnp.newaxis] for a, b in zip(arguments[:3], batched, strict=False))
                return foreign(self._limits, room, cases, size, *own), each
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            return self._many(room, *rows), each

        found: StepsRecord = one(*ruled(*given))
        return found

    def _alone(self, room: int, t: Any, y: Any, c: Any, breaks: Any = ()) -> StepsRecord:
        """Run one case in a loop of its own."""
        pieces, between = self._pieces, t if len(t) > 2 else t[:0]
        batch = self._batch(t[0], t[-1], (y,), c, breaks)._replace(c=pieces.steps.constants.split(c))
        count, taken, end = course_of(pieces.one, pieces.one_projections, room, batch, between)
        return StepsRecord(count, taken, end.y[0], end.t, end.status.astype(float), end.steps, end.attempts)

    def _many(self, room: int, *given: Any) -> StepsRecord:
        """Run cases in one loop; a batch of batches is one batch."""
        pieces = self._pieces

        @jax.custom_batching.custom_vmap
        def many(t: Any, y: Any, c: Any, breaks: Any) -> StepsRecord:
            between = t if t.shape[1] > 2 else t[:, :0]
            batch = self._batch(t[:, 0], t[:, -1], tuple(y.T), c, breaks.T)
            batch = batch._replace(c=pieces.steps.constants.split(c))
            count, taken, end = course_of(pieces.many, pieces.many_projections, room, batch, between.T)
            states = jnp.stack(end.y, axis=-1) if end.y else jnp.zeros((len(t), 0))
            status = end.status.astype(float)
            return StepsRecord(count, jnp.moveaxis(taken, 2, 0), states, end.t, status, end.steps, end.attempts)

        @many.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[StepsRecord, StepsRecord]:
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            own = rows[0].shape[1]
            count, *rest = self._many(room, *(row.reshape(size * own, *row.shape[2:]) for row in rows))
            split = [value.reshape(size, own, *value.shape[1:]) for value in rest]
            return StepsRecord(count, *split), StepsRecord(False, *[True] * 6)

        found: StepsRecord = many(*given)
        return found

    def rates(self, t: Any, y: Any, c: Any, breaks: Any) -> Any:
        """Return the rates (n_t, n_y) of states at times: the derivatives of where a run is by the time."""
        constants = self._pieces.steps.constants
        rows = constants.rows(c, middles(jax.lax.stop_gradient(t), breaks) if constants.broken else t)
        steps = Steps(t, jnp.zeros_like(t), tuple(y.T), rows)
        return stack(self._pieces.steps.rates(steps), axis=1)

    def _ends(self, over: Over, states: Any, c: Any) -> Any:
        """Return the ends (n_t, n_y) of steps to requested times, one stage after the other where that is faster."""
        moves = self._pieces.steps

        def in_rows(over: Over, states: Any, c: Any) -> Any:
            rows = moves.constants.rows(c, over.begins + 0.5 * over.sizes)
            return jnp.stack(moves(Steps(over.begins, over.sizes, tuple(states.T), rows)), axis=1)

        turns = moves.in_turn
        if turns is None or jax.default_backend() != "cpu":
            return in_rows(over, states, c)
        return alone_or_many(turns.ends, in_rows, over, states, c)

    def run(self, room: int, t: Any, y0: Any, c: Any, breaks: Any) -> tuple[Any, StepsRecord, Any, Over]:
        """Return the states (n_t, n_y), the record, which times were reached, and steps over more than two times."""
        t, ordered = in_order(t)
        return self._at_times(room, t, ordered, y0, c, self.one(room, t, y0, c, breaks))

    def _at_times(
        self, room: int, t: Any, ordered: Any, y0: Any, c: Any, record: StepsRecord
    ) -> tuple[Any, StepsRecord, Any, Over]:
        """Return the result of `run`, from the record of the run."""
        record = record._replace(status=jnp.where(ordered, record.status, float(Status.TIMES_IN_NO_ORDER)))
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        known = ordered & (forward * (t - record.reached) <= 0.0)
        if len(t) <= 2:
            y = jnp.stack([y0, record.end])[: len(t)]
            return jnp.where(known[:, None], y, jnp.nan), record, known, Over(*(jnp.zeros(0),) * 3)
        at = jnp.zeros(0, dtype=int)
        if room:
            times = jnp.where(jnp.arange(room) < record.count, forward * record.t, jnp.inf)
            at = jnp.maximum(jnp.searchsorted(times, forward * t, side="right") - 1, 0)
            begins, states = record.t[at], jnp.where(record.count > 0, record.y[at], y0)
        else:
            begins, states = record.taken[:, 0], record.taken[:, 1:]
        size = jnp.where(known, t - begins, 0.0)  # beyond the end, steps might overflow
        ends = self._ends(Over(at, begins, size), states, c)
        return jnp.where(known[:, None], ends, jnp.nan), record, known, Over(at.astype(float), begins, size)
