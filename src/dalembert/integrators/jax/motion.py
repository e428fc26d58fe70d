"""A traced run whose derivatives are taken over its steps at once: forward and reverse, alone and in batches.

The run itself is a plain loop, which takes down where each attempt began and how far it went. Derivatives are those of
the accepted steps at these sizes (see `dalembert.integrators.jax.derivatives`). States at wanted times are ends of
shorter steps of the same method, from the beginning of the step that passes over them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, final

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero

from ...methods.status import Status
from ...once import once_property
from .derivatives import CHUNK, Linear, Record, Steps, instantiate, pulled, pulled_over, pushed, pushed_over, rows_at
from .jumping import moved_until, sure_until
from .lanes import RUNNING, Attempts, Batch, Function, Projections, Rows, State, advanced, begun, direction_of

__all__ = ["Limits", "Motion", "Pieces", "Stepping", "ended", "following", "in_order", "middles"]

_BLOCK = 32
"""Attempts that a run without derivatives takes down before it looks which of them pass over wanted times."""


class Stepping(Linear, Protocol):
    """Steps of given sizes, and their derivatives."""

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, n_y rows (k,)."""

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps, n_y rows (k,)."""


@final
@dataclass(frozen=True)
class Pieces:
    """A method, in the forms that a traced run needs.

    Attributes
    ----------
    one, one_projections
        Attempts and corrections of one case, on one row that holds all components.
    many, many_projections
        Attempts and corrections of many cases, on a row for each component.
    steps
        Steps of given sizes, and their derivatives.
    decided
        (t, y, c) -> the values in the rates that jump with the state, on rows; None where nothing does.
    moved_by
        Numbers of the constants on which the times of breaks depend.
    """

    one: Attempts
    one_projections: Projections
    many: Attempts
    many_projections: Projections
    steps: Stepping
    decided: Function | None = None
    moved_by: tuple[int, ...] = ()


@final
@dataclass(frozen=True)
class Limits:
    """Tolerances, the least scale of Taylor steps, the largest step, and how many steps may be attempted."""

    rtol: float
    atol: float
    floor: float
    max_step: float
    max_steps: int


@final
class _Way(NamedTuple):
    """Course of a run: its record, which times it reached (n_t,), and for more than two times the steps over them.

    These are the numbers of the attempts, and the steps cut at the times. Times that are `moved` (n_t,) lie behind a
    jump whose time depends on constants.
    """

    record: Record
    known: Any
    passing: tuple[Any, Steps] | None
    moved: Any = None


def in_order(t: Any) -> tuple[Any, Any]:
    """Return times (n_t,) by which to run, and whether they are those given: finite, and going one way."""
    ordered = jnp.all(jnp.isfinite(t)) & (jnp.all(t[1:] >= t[:-1]) | jnp.all(t[1:] <= t[:-1]))
    return jnp.where(ordered, t, 0.0), ordered


def middles(t: Any, breaks: Any) -> Any:
    """Return the middles (n_t,) between the breaks (n,) around times, of which the first is 0 and the last the end."""
    direction, count = jnp.where(t[-1] >= t[0], 1.0, -1.0), len(breaks)
    passed = jnp.searchsorted(direction * breaks, direction * t, side="right")
    behind = jnp.where(passed > 0, breaks[jnp.maximum(passed - 1, 0)], t[0])
    ahead = breaks[jnp.minimum(passed, count - 1)]
    ahead = jnp.where((passed < count) & jnp.isfinite(ahead), ahead, t[-1])
    return behind + 0.5 * (ahead - behind)


@jax.custom_jvp
def following(y: Any, t: Any, rates: Any) -> Any:
    """Return states (n_t, n_y), which change with times (n_t,) by rates (n_t, n_y)."""
    return y


@following.defjvp
def _(values: Any, tangents: Any) -> tuple[Any, Any]:
    (y, _, rates), (dy, dt, _) = values, tangents
    return y, dy + dt[:, None] * rates


def _record(attempts: Attempts, projections: Projections, room: int, batch: Batch) -> tuple[Any, Any, State]:
    """Return the number of attempts, what they were (room, 2 + n_y, ...), and how the run ended.

    An attempt is one row, its start, its size and the state, as every array that is written to costs an attempt time.
    """
    shape = jnp.shape(batch.t0)
    start = begun(attempts, batch)

    def row(t: Any, size: Any, y: Rows) -> Any:
        return jnp.concatenate([jnp.reshape(part, (-1, *shape)) for part in (t, size, *y)])

    def body(carry: Any) -> Any:
        i, state, taken = carry
        after, size = advanced(attempts, projections, batch, batch.t1, state)
        if room:
            new = row(state.t, size, state.y)
            taken = lax.dynamic_update_index_in_dim(taken, new, i, 0)
        return i + 1, after, taken

    width = len(jax.eval_shape(row, batch.t0, batch.t0, batch.y))
    first = (0, start, jnp.zeros((room, width, *shape)))
    count, end, taken = lax.while_loop(lambda carry: jnp.any(carry[1].status == RUNNING), body, first)
    return jnp.asarray(count), taken, end


def _passing(attempts: Attempts, projections: Projections, room: int, batch: Batch, t: Any) -> tuple[Any, Any, State]:
    """Return the number of attempts, where those began that pass over times t (n_t, ...), and how the run ended.

    The beginnings (n_t, 1 + n_y, ...) are a time and the state there. Attempts are taken down in blocks of `room`, so
    that memory does not grow with their number.
    """
    shape = jnp.shape(batch.t0)
    direction = direction_of(batch)

    def row(state: State) -> Any:
        return jnp.concatenate([jnp.reshape(part, (-1, *shape)) for part in (state.t, *state.y)])

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
        count, state, block = lax.while_loop(goes_on, attempt, (0, state, block))
        return total + count, state, block, found(count, block, t, direction, begins)

    start = begun(attempts, batch)
    first = row(start)
    begins = jnp.broadcast_to(first, (len(t), *first.shape))
    carry = (0, start, jnp.zeros((room, *first.shape)), begins)
    count, end, _, begins = lax.while_loop(lambda carry: jnp.any(carry[1].status == RUNNING), body, carry)
    return jnp.asarray(count), begins, end


def _course(attempts: Attempts, projections: Projections, room: int, batch: Batch, t: Any) -> tuple[Any, Any, State]:
    """Return what `_record` does where there is room, else what `_passing` does for times t (n_t, ...) between ends."""
    if room or not len(t):
        return _record(attempts, projections, room, batch)
    return _passing(attempts, projections, _BLOCK, batch, t)


def _single(pieces: Pieces, room: int, batch: Batch, t: Any) -> Record:
    """Return how one case went, whose state and constants are arrays."""
    batch = batch._replace(y=(batch.y,), c=(batch.c,))
    count, taken, end = _course(pieces.one, pieces.one_projections, room, batch, t)
    return Record(count, taken, end.y[0], end.t, end.status.astype(float))


def ended(pieces: Pieces, batch: Batch) -> tuple[Any, Any, Any]:
    """Return the last state (n_y,) of one case, whose state and constants are arrays, its time, and the status."""
    return _single(pieces, 0, batch, ())[2:]


@final
class Motion:
    """Runs of one method for one program, as functions that JAX differentiates and vectorises.

    Parameters
    ----------
    pieces : Pieces
        The method.
    limits : Limits
        How the steps are chosen.
    forward : bool
        Whether derivatives are pushed forward (``jax.jvp``), else pulled back (``jax.vjp``).
    """

    def __init__(self, pieces: Pieces, limits: Limits, *, forward: bool) -> None:
        self._pieces, self._limits, self._forward = pieces, limits, forward
        self._room = -(-limits.max_steps // CHUNK) * CHUNK

    def __call__(self, t: Any, y0: Any, c: Any, breaks: Any = (), moved: Any = ()) -> tuple[Any, Any]:
        """Return the states (n_t, n_y) at the sorted times t (n_t,), from y0 (n_y,) at t[0] = 0, and the status.

        States that were not reached are NaN, and so are all derivatives of what is computed from them. Steps end at
        `breaks` (n,), in the order of the run, infinite behind the last, which are `moved` (n,) by constants or not.
        """
        y, status = self._passing(t, y0, c, jnp.asarray(breaks, dtype=float), jnp.asarray(moved, dtype=float))
        return y, status.astype(int)

    # -- the run --------------------------------------------------------------------------

    def _batch(self, t0: Any, t1: Any, y: Any, c: Any, breaks: Any) -> Batch:
        limits, place = self._limits, self._pieces.steps.place
        batch = Batch(y, c, t0, t1, (), limits.floor, limits.rtol, limits.atol, limits.max_step, limits.max_steps)
        return batch._replace(breaks=breaks, place=place) if len(breaks) else batch

    def _one(self, room: int, *given: Any) -> Record:
        """Run one case from t0 to t1, y, c, breaks and times t, as one of a batch where it is vectorised."""
        pieces = self._pieces

        @jax.custom_batching.custom_vmap
        def one(*given: Any) -> Record:
            return _single(pieces, room, self._batch(*given[:-1]), given[-1])

        @one.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[Record, Record]:
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            return self._many(room, *rows), Record(False, *[True] * 4)

        found: Record = one(*given)
        return found

    def _many(self, room: int, *given: Any) -> Record:
        """Run cases in one loop; a batch of batches is one batch."""
        pieces = self._pieces

        @jax.custom_batching.custom_vmap
        def many(t0: Any, t1: Any, y: Any, c: Any, breaks: Any, t: Any) -> Record:
            batch = self._batch(t0, t1, tuple(y.T), tuple(c.T), breaks.T)
            count, taken, end = _course(pieces.many, pieces.many_projections, room, batch, t.T)
            states = jnp.stack(end.y, axis=-1) if end.y else jnp.zeros((len(t0), 0))
            return Record(count, jnp.moveaxis(taken, 2, 0), states, end.t, end.status.astype(float))

        @many.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[Record, Record]:
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            count, *rest = self._many(room, *(row.reshape(size * row.shape[1], *row.shape[2:]) for row in rows))
            split = [value.reshape(size, -1, *value.shape[1:]) for value in rest]
            return Record(count, *split), Record(False, *[True] * 4)

        found: Record = many(*given)
        return found

    # -- its derivatives ------------------------------------------------------------------

    @once_property
    def _passing(self) -> Callable[..., tuple[Any, Any]]:
        """The function (t, y0, c, breaks, moved) -> states (n_t, n_y), the status as a number."""

        def primal(t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> Any:
            y, status, _ = self._run(t, y0, c, breaks, 0)
            return y, status

        if self._forward:
            forward = jax.custom_jvp(primal)
            forward.defjvp(self._push, symbolic_zeros=True)
            return forward
        reverse = jax.custom_vjp(primal)
        reverse.defvjp(self._ahead, self._back, symbolic_zeros=True)
        return reverse

    def _push(self, values: Any, tangents: Any) -> Any:
        """Return what `_passing` does, and its change."""
        (t, y0, c, breaks, moved), (dt, dy, dc) = values, tangents[:3]
        dy, dc = instantiate(dy), instantiate(dc)
        y, status, way = self._recorded(t, y0, c, breaks, moved)
        along, end = pushed(self._pieces.steps, way.record, c, dy, dc, keep=way.passing is not None)
        if way.passing is None:
            dy = jnp.stack([dy, end])[: len(t)]
        else:
            at, steps = way.passing
            dy = pushed_over(self._pieces.steps, steps, along[at], dc)
        if not isinstance(dt, SymbolicZero):
            dy = dy + dt[:, None] * self._rates(t, y, c, breaks)
        known = way.known
        if way.moved is not None:
            known &= ~(way.moved & jnp.any(dc[jnp.array(self._pieces.moved_by)] != 0.0))
        return (y, status), (jnp.where(known[:, None], dy, jnp.nan), jnp.zeros_like(status))

    def _ahead(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> Any:
        """Return what `_passing` does, and what `_back` needs; states only where the times are differentiated."""
        y, status, way = self._recorded(*(given.value for given in (t, y0, c, breaks, moved)))
        return (y, status), (way, t.value, y if t.perturbed else None, c.value, breaks.value)

    def _back(self, kept: Any, cotangents: Any) -> Any:
        """Return the cotangents of the times (n_t,), of the first state (n_y,) and of the constants (n_c,)."""
        (way, t, y, c, breaks), given = kept, instantiate(cotangents[0])
        known, steps = way.known[:, None], self._pieces.steps
        # What is asked of states that were not reached has no answer, however little else it has to do with them.
        failed = jnp.any(~known & (given != 0.0))
        given = jnp.where(known, given, 0.0)
        if way.passing is None:
            none = jnp.zeros(0, dtype=int), jnp.zeros((0, given.shape[1]))
            first, share = pulled(steps, way.record, c, *none, given[1] if len(t) > 1 else 0.0 * given[0])
            first = first + given[0]
        else:
            at, passing = way.passing
            starts, extra = pulled_over(steps, passing, given)
            first, share = pulled(steps, way.record, c, at, starts, jnp.zeros_like(given[0]))
            share = share + extra
        times = jnp.zeros_like(t)
        if y is not None:
            times = jnp.where(way.known, jnp.sum(given * self._rates(t, y, c, breaks), axis=1), 0.0)
        if way.moved is not None:
            moved_by = jnp.zeros(len(c), dtype=bool).at[jnp.array(self._pieces.moved_by)].set(True)
            share = jnp.where(moved_by & jnp.any(way.moved[:, None] & (given != 0.0)), jnp.nan, share)
        found = (jnp.where(failed, jnp.nan, cotangent) for cotangent in (times, first, share))
        return *found, jnp.zeros_like(breaks), jnp.zeros_like(breaks)

    def _recorded(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> tuple[Any, Any, _Way]:
        """Return what `_run` does; what lies behind a jump is not known to those who differentiate."""
        y, status, way = self._run(t, y0, c, breaks, self._room)
        decided, moved_by = self._pieces.decided, self._pieces.moved_by
        if not len(y0) or (decided is None and not moved_by):
            return y, status, way

        def rates(t: Any, y: Rows, c: Rows) -> Rows:
            return self._pieces.steps.rates(Steps(t, jnp.zeros_like(t), y, c, way.record.count > 0))

        direction, place = jnp.where(t[-1] >= t[0], 1.0, -1.0), self._pieces.steps.place
        if decided is not None:
            until = sure_until(decided, rates, place, way.record, c, direction)
            way = way._replace(known=way.known & (direction * (t - until) <= 0.0))
        if moved_by:
            until = moved_until(rates, place, way.record, c, direction, (t[-1], breaks, moved > 0.0))
            way = way._replace(moved=direction * (t - until) > 0.0)
        return y, status, way

    def _rates(self, t: Any, y: Any, c: Any, breaks: Any) -> Any:
        """Return the rates (n_t, n_y) of states at times: the derivatives of where a run is by the time."""
        place = self._pieces.steps.place
        rows = rows_at(place, c, t if place is None else middles(t, breaks))
        steps = Steps(t, jnp.zeros_like(t), tuple(y.T), rows, jnp.isfinite(t[0]))
        return jnp.stack(self._pieces.steps.rates(steps), axis=1)

    def _run(self, t: Any, y0: Any, c: Any, breaks: Any, room: int) -> tuple[Any, Any, _Way]:
        """Return the states (n_t, n_y), NaN where they were not reached, the status, and the way there."""
        t, ordered = in_order(t)
        record = self._one(room, t[0], t[-1], y0, c, breaks, t if len(t) > 2 else t[:0])
        record = record._replace(status=jnp.where(ordered, record.status, float(Status.TIMES_IN_NO_ORDER)))
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        known = ordered & (forward * (t - record.reached) <= 0.0)
        if len(t) <= 2:
            y = jnp.stack([y0, record.end])[: len(t)]
            return jnp.where(known[:, None], y, jnp.nan), record.status, _Way(record, known, None)
        at: Any = ()
        if room:
            times = jnp.where(jnp.arange(room) < record.count, forward * record.t, jnp.inf)
            at = jnp.maximum(jnp.searchsorted(times, forward * t, side="right") - 1, 0)
            begins, states = record.t[at], record.y[at]
        else:
            begins, states = record.taken[:, 0], record.taken[:, 1:]
        size = jnp.where(known, t - begins, 0.0)  # beyond the end, steps might overflow
        rows = rows_at(self._pieces.steps.place, c, begins + 0.5 * size)
        steps = Steps(begins, size, tuple(states.T), rows, record.count > 0)
        y = jnp.where(known[:, None], jnp.stack(self._pieces.steps(steps), axis=1), jnp.nan)
        return y, record.status, _Way(record, known, (at, steps))
