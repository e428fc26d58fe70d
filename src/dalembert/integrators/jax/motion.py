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

from ...once import once_property
from ..status import Status
from .derivatives import CHUNK, Linear, Record, Steps, instantiate, pulled, pulled_over, pushed, pushed_over
from .lanes import RUNNING, Attempts, Batch, Projections, Rows, State, advanced, begun

__all__ = ["Limits", "Motion", "Pieces", "Stepping", "ended", "in_order"]


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
    """

    one: Attempts
    one_projections: Projections
    many: Attempts
    many_projections: Projections
    steps: Stepping


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
    """How a run went: its record, which times it reached (n_t,), and for more than two times the steps over them.

    These are the numbers of the attempts, and the steps cut at the times.
    """

    record: Record
    known: Any
    passing: tuple[Any, Steps] | None


def in_order(t: Any) -> tuple[Any, Any]:
    """Return times (n_t,) by which to run, and whether they are those given: finite, and going one way."""
    ordered = jnp.all(jnp.isfinite(t)) & (jnp.all(t[1:] >= t[:-1]) | jnp.all(t[1:] <= t[:-1]))
    return jnp.where(ordered, t, 0.0), ordered


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


def _single(pieces: Pieces, room: int, batch: Batch) -> Record:
    """Return how one case went, whose state and constants are arrays."""
    batch = batch._replace(y=(batch.y,), c=(batch.c,))
    count, taken, end = _record(pieces.one, pieces.one_projections, room, batch)
    return Record(count, taken, end.y[0], end.t, end.status.astype(float))


def ended(pieces: Pieces, batch: Batch) -> tuple[Any, Any, Any]:
    """Return the last state (n_y,) of one case, whose state and constants are arrays, its time, and the status."""
    return _single(pieces, 0, batch)[2:]


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

    def __call__(self, t: Any, y0: Any, c: Any) -> tuple[Any, Any]:
        """Return the states (n_t, n_y) at the sorted times t (n_t,), from y0 (n_y,) at t[0], and the status.

        States that were not reached are NaN, and so are all derivatives of what is computed from them.
        """
        y, status = self._passing(t, y0, c)
        return y, status.astype(int)

    # -- the run --------------------------------------------------------------------------

    def _batch(self, t0: Any, t1: Any, y: Any, c: Any) -> Batch:
        limits = self._limits
        return Batch(y, c, t0, t1, (), limits.floor, limits.rtol, limits.atol, limits.max_step, limits.max_steps)

    def _one(self, room: int, t0: Any, t1: Any, y: Any, c: Any) -> Record:
        """Run one case, as one of a batch where it is vectorised."""
        pieces = self._pieces

        @jax.custom_batching.custom_vmap
        def one(t0: Any, t1: Any, y: Any, c: Any) -> Record:
            return _single(pieces, room, self._batch(t0, t1, y, c))

        @one.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[Record, Record]:
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            return self._many(room, *rows), Record(False, *[True] * 4)

        found: Record = one(t0, t1, y, c)
        return found

    def _many(self, room: int, t0: Any, t1: Any, y: Any, c: Any) -> Record:
        """Run cases in one loop; a batch of batches is one batch."""
        pieces = self._pieces

        @jax.custom_batching.custom_vmap
        def many(t0: Any, t1: Any, y: Any, c: Any) -> Record:
            batch = self._batch(t0, t1, tuple(y.T), tuple(c.T))
            count, taken, end = _record(pieces.many, pieces.many_projections, room, batch)
            states = jnp.stack(end.y, axis=-1) if end.y else jnp.zeros((len(t0), 0))
            return Record(count, jnp.moveaxis(taken, 2, 0), states, end.t, end.status.astype(float))

        @many.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[Record, Record]:
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            count, *rest = self._many(room, *(row.reshape(-1, *row.shape[2:]) for row in rows))
            split = [value.reshape(size, -1, *value.shape[1:]) for value in rest]
            return Record(count, *split), Record(False, *[True] * 4)

        found: Record = many(t0, t1, y, c)
        return found

    # -- its derivatives ------------------------------------------------------------------

    @once_property
    def _passing(self) -> Callable[..., tuple[Any, Any]]:
        """The function (t, y0, c) -> states (n_t, n_y), the status as a number."""

        def primal(t: Any, y0: Any, c: Any) -> Any:
            y, status, _ = self._run(t, y0, c, 0 if len(t) <= 2 else self._room)
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
        (t, y0, c), (dt, dy, dc) = values, tangents
        dy, dc = instantiate(dy), instantiate(dc)
        y, status, way = self._run(t, y0, c, self._room)
        along, end = pushed(self._pieces.steps, way.record, c, dy, dc, keep=way.passing is not None)
        if way.passing is None:
            dy = jnp.stack([dy, end])[: len(t)]
        else:
            at, steps = way.passing
            dy = pushed_over(self._pieces.steps, steps, along[at], dc)
        if not isinstance(dt, SymbolicZero):
            dy = dy + dt[:, None] * self._rates(t, y, c)
        return (y, status), (jnp.where(way.known[:, None], dy, jnp.nan), jnp.zeros_like(status))

    def _ahead(self, t: Any, y0: Any, c: Any) -> Any:
        """Return what `_passing` does, and what `_back` needs; states only where the times are differentiated."""
        y, status, way = self._run(t.value, y0.value, c.value, self._room)
        return (y, status), (way, t.value, y if t.perturbed else None, c.value)

    def _back(self, kept: Any, cotangents: Any) -> Any:
        """Return the cotangents of the times (n_t,), of the first state (n_y,) and of the constants (n_c,)."""
        (way, t, y, c), given = kept, instantiate(cotangents[0])
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
            times = jnp.where(way.known, jnp.sum(given * self._rates(t, y, c), axis=1), 0.0)
        return tuple(jnp.where(failed, jnp.nan, cotangent) for cotangent in (times, first, share))

    def _rates(self, t: Any, y: Any, c: Any) -> Any:
        """Return the rates (n_t, n_y) of states at times: the derivatives of where a run is by the time."""
        steps = Steps(t, jnp.zeros_like(t), tuple(y.T), tuple(c), jnp.isfinite(t[0]))
        return jnp.stack(self._pieces.steps.rates(steps), axis=1)

    def _run(self, t: Any, y0: Any, c: Any, room: int) -> tuple[Any, Any, _Way]:
        """Return the states (n_t, n_y), NaN where they were not reached, the status, and the way there."""
        t, ordered = in_order(t)
        record = self._one(room, t[0], t[-1], y0, c)
        record = record._replace(status=jnp.where(ordered, record.status, float(Status.TIMES_IN_NO_ORDER)))
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        known = ordered & (forward * (t - record.reached) <= 0.0)
        if len(t) <= 2:
            y = jnp.stack([y0, record.end])[: len(t)]
            return jnp.where(known[:, None], y, jnp.nan), record.status, _Way(record, known, None)
        times = jnp.where(jnp.arange(room) < record.count, forward * record.t, jnp.inf)
        at = jnp.maximum(jnp.searchsorted(times, forward * t, side="right") - 1, 0)
        begins = record.t[at]
        size = jnp.where(known, t - begins, 0.0)  # beyond the end, steps might overflow
        steps = Steps(begins, size, tuple(record.y[at].T), tuple(c), record.count > 0)
        y = jnp.where(known[:, None], jnp.stack(self._pieces.steps(steps), axis=1), jnp.nan)
        return y, record.status, _Way(record, known, (at, steps))
