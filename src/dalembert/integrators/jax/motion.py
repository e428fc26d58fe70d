"""A traced run whose derivatives are taken over its steps at once: forward and reverse, alone and in batches.

The run itself is a plain loop, which takes down where each attempt began and how far it went. Derivatives are those of
the accepted steps at these sizes (see `dalembert.integrators.jax.derivatives`). States at wanted times are ends of
shorter steps of the same method, from the beginning of the step that passes over them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, final

import jax
import jax.numpy as jnp
from jax import lax

from ...once import once_property
from .derivatives import CHUNK, Linear, Record, Steps, pulled, pulled_over, pushed, pushed_over
from .lanes import RUNNING, Attempts, Batch, Projections, Rows, State, advanced, begun

__all__ = ["Limits", "Motion", "Pieces", "Stepping", "ended"]


class Stepping(Linear, Protocol):
    """Steps of given sizes, and their derivatives."""

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, n_y rows (k,)."""


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

        States that were not reached are NaN.
        """
        y, reached, status = self._passing(lax.stop_gradient(t), y0, c)
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        known = forward * (t - reached) <= 0.0
        return jnp.where(known[:, None], y, jnp.nan), status.astype(int)

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
    def _passing(self) -> Callable[..., tuple[Any, ...]]:
        """The function (t, y0, c) -> states (n_t, n_y), the time reached, the status as a number."""

        def primal(t: Any, y0: Any, c: Any) -> Any:
            return self._run(t, y0, c, 0 if len(t) <= 2 else self._room)[0]

        def push(values: Any, tangents: Any) -> Any:
            (t, y0, c), (_, dy, dc) = values, tangents
            out, record, passed = self._run(t, y0, c, self._room)
            along, end = pushed(self._pieces.steps, record, c, dy, dc, keep=passed is not None)
            if passed is None:
                dy = jnp.stack([dy, end])[: len(t)]
            else:
                at, steps = passed
                dy = pushed_over(self._pieces.steps, steps, along[at], dc)
            return out, (dy, *(jnp.zeros_like(value) for value in out[1:]))

        def ahead(t: Any, y0: Any, c: Any) -> Any:
            out, record, passed = self._run(t, y0, c, self._room)
            return out, (t, record, passed, c)

        def back(kept: Any, cotangents: Any) -> Any:
            (t, record, passed, c), y = kept, cotangents[0]
            if passed is None:
                none = jnp.zeros(0, dtype=int), jnp.zeros((0, y.shape[1]))
                first, share = pulled(self._pieces.steps, record, c, *none, y[1] if len(t) > 1 else 0.0 * y[0])
                return 0.0 * t, first + y[0], share
            at, steps = passed
            starts, extra = pulled_over(self._pieces.steps, steps, y)
            first, share = pulled(self._pieces.steps, record, c, at, starts, jnp.zeros_like(y[0]))
            return 0.0 * t, first, share + extra

        if self._forward:
            forward = jax.custom_jvp(primal)
            forward.defjvp(push)
            return forward
        reverse = jax.custom_vjp(primal)
        reverse.defvjp(ahead, back)
        return reverse

    def _run(self, t: Any, y0: Any, c: Any, room: int) -> tuple[Any, Record, Any]:
        """Return what `_passing` does, the record, and for more than two times which steps pass over them.

        These are the numbers of the attempts, and the steps cut at the times.
        """
        record = self._one(room, t[0], t[-1], y0, c)
        if len(t) <= 2:
            return (jnp.stack([y0, record.end])[: len(t)], record.reached, record.status), record, None
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        times = jnp.where(jnp.arange(room) < record.count, forward * record.t, jnp.inf)
        at = jnp.maximum(jnp.searchsorted(times, forward * t, side="right") - 1, 0)
        begins = record.t[at]
        steps = Steps(begins, t - begins, tuple(record.y[at].T), tuple(c), record.count > 0)
        y = jnp.stack(self._pieces.steps(steps), axis=1)
        return (y, record.reached, record.status), record, (at, steps)
