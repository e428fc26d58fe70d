"""Derivatives of a recorded run along its steps, at fixed sizes: pushed forward, and pulled back.

A run of one case goes back one stage after the other where that is faster (`dalembert.jax.runs.adjoint`). Else,
nothing in the derivative of one step waits for another step, so that these are computed for `CHUNK` steps together, on
rows; one after the other there are but products of small matrices and vectors.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, final

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero

from .mesh_axes import varying_like
from .run_constants import RunConstants
from .step_rules import Rows

if TYPE_CHECKING:
    from .adjoint import InTurn

CHUNK = 16
"""Steps that are differentiated together."""


@final
class StepsRecord(NamedTuple):
    """Record of a run: the number of attempts (), the attempts (room, 2 + n_y), and its end.

    Of each attempt that is when it started, its size, and the state there. The room is a multiple of `CHUNK`. Rejected
    attempts have size 0, and so does room that was not used. ``end`` is the last state (n_y,), at the time ``reached``.
    ``steps`` are the attempts that were accepted, ``attempts`` those of this case, where others had more.
    """

    count: Any
    taken: Any
    end: Any
    reached: Any
    status: Any
    steps: Any = ()
    attempts: Any = ()

    @property
    def t(self) -> Any:
        """Starts of the attempts (room,)."""
        return self.taken[:, 0]

    @property
    def y(self) -> Any:
        """States at the starts (room, n_y)."""
        return self.taken[:, 2:]


@final
class Steps(NamedTuple):
    """Steps to differentiate: starts t (k,), sizes h (k,), states y (n_y rows (k,)), constants c (n_c rows ())."""

    t: Any
    h: Any
    y: Rows
    c: Rows


@final
class Over(NamedTuple):
    """Shorter steps from the starts of attempts to requested times, each on its own.

    Attributes
    ----------
    at, begins, sizes : Array (n_t,)
        Numbers of the attempts, when these began, and how far the steps go.
    """

    at: Any
    begins: Any
    sizes: Any


class Stepping(Protocol):
    """The steps of one method, of given sizes, and their derivatives.

    ``in_turn`` goes over a run of one case one stage after the other, where that is faster and possible (see
    `dalembert.jax.runs.adjoint`).

    ``constants`` says what the constants of a run are.

    ``along`` and ``shifts`` are trees of arrays whose leading axis counts the steps; `push` and `pull` take what they
    hold for one step.
    """

    @property
    def constants(self) -> RunConstants:
        """See the class."""

    @property
    def in_turn(self) -> InTurn | None:
        """See the class."""

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, n_y rows (k,)."""

    def moved(self, steps: Steps) -> Rows:
        """Return the same, made so that JAX finds their derivatives."""

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps, n_y rows (k,)."""

    def along(self, steps: Steps) -> tuple[Any, Any]:
        """Return the derivatives by the states, and where they were taken, for `shifts` and `share`."""

    def shifts(self, steps: Steps, places: Any, dc: Rows) -> Any:
        """Return the change of the end of each step that a change of the constants makes within it."""

    def push(self, along: Any, shift: Any, dy: Any) -> Any:
        """Return the change of the state (n_y,) at the end of a step, from that at its start."""

    def pull(self, along: Any, ahead: Any) -> tuple[Any, Any]:
        """Return the cotangent of the state (n_y,) at the start, from that at the end, and those within the step."""

    def share(self, steps: Steps, places: Any, within: Any) -> Rows:
        """Return the cotangents of the constants, from the cotangents within all steps."""


def instantiate(tangent: Any) -> Any:
    """Return a tangent or cotangent as an array, also where JAX knows that it is zero."""
    if isinstance(tangent, SymbolicZero):
        return varying_like(jnp.zeros(tangent.shape, tangent.dtype), tangent)
    return tangent


def alone_or_many(alone: Callable[..., Any], many: Callable[..., Any], *arguments: Any) -> Any:
    """Return ``alone(*arguments)``, where each case of a batch is computed by `many` instead."""
    one = jax.custom_batching.custom_vmap(alone)

    @one.def_vmap
    def _(size: int, batched: Any, *arguments: Any) -> tuple[Any, Any]:
        axes = jax.tree.map(lambda yes: 0 if yes else None, tuple(batched))
        found = jax.vmap(many, axes, axis_size=size)(*arguments)
        return found, jax.tree.map(lambda _: True, found)

    return one(*arguments)


def jacobians(function: Any, y: Rows) -> Any:
    """Return the derivatives (*shape, n_out, n_y) of a function from rows to rows of a common shape."""

    def column(direction: Any) -> Rows:
        tangents = tuple(jnp.broadcast_to(d, row.shape) for d, row in zip(direction, y, strict=True))
        along: Rows = jax.jvp(lambda *y: function(y), y, varying_like(tangents, y))[1]
        return along

    columns = jnp.stack(jax.vmap(column)(jnp.eye(len(y))))  # (n_out, n_y, *shape)
    return jnp.moveaxis(columns, (0, 1), (-2, -1))


def pushed(
    linear: Stepping, record: StepsRecord, c: Any, dy: Any, dc: Any, *, keep: bool, sources: Any = None
) -> tuple[Any, Any]:
    """Return the change of the states at the starts of attempts (room, n_y) and at the end (n_y,).

    Parameters
    ----------
    linear
        The derivatives of the steps.
    record, c
        The run, and its constants (n_c,).
    dy, dc
        Change of the first state (n_y,), and of the constants.
    keep
        Whether the changes at the starts are wanted; else there are none.
    sources
        Changes (room, n_y) that enter at the ends of the steps, where there are any.
    """

    def chunk(number: Any, carry: Any) -> Any:
        first = number * CHUNK
        steps = _steps(linear, record, first, c)
        along, places = linear.along(steps)
        shifts = linear.shifts(steps, places, linear.constants.changes(dc, c, _middles(steps), steps.c))

        def one(j: Any, inner: Any) -> Any:
            change, kept = inner
            if keep:
                kept = lax.dynamic_update_index_in_dim(kept, change, first + j, 0)
            after = linear.push(_at(along, j), _at(shifts, j), change)
            if sources is not None:
                after = after + sources[first + j]
            return jnp.where(steps.h[j] != 0.0, after, change), kept

        return lax.fori_loop(0, CHUNK, one, carry)

    kept = jnp.zeros(record.y.shape if keep else (0, len(dy)))
    begin = varying_like((dy, kept), (record, c, dy, dc, sources))
    end, kept = lax.fori_loop(0, -(-record.count // CHUNK), chunk, begin)
    return kept, end


def pulled(
    linear: Stepping,
    record: StepsRecord,
    c: Any,
    given: tuple[Any, ...],
    end: Any,
    *,
    sources: bool = False,
) -> tuple[Any, ...]:
    """Return the cotangents of the first state (n_y,), of the constants (n_c,), and of `sources` where they are wanted.

    Parameters
    ----------
    linear
        The derivatives of the steps.
    record, c
        The run, and its constants (n_c,).
    given
        Nothing, or the cotangents (room, n_y) of the states at the starts of attempts.
    end
        Cotangent of the last state (n_y,).
    sources
        Whether the cotangents (room, n_y) of the ends of steps are wanted.
    """
    chunks = -(-record.count // CHUNK)

    def chunk(number: Any, carry: Any) -> Any:
        first = (chunks - 1 - number) * CHUNK
        steps = _steps(linear, record, first, c)
        along, places = linear.along(steps)
        added = [lax.dynamic_slice_in_dim(rows, first, CHUNK) for rows in given]

        def one(ahead: Any, j: Any) -> Any:
            before, within = linear.pull(_at(along, j), ahead)
            moved = steps.h[j] != 0.0
            before = jnp.where(moved, before, ahead)
            within = jax.tree.map(lambda value: jnp.where(moved, value, 0.0), within)
            return sum((rows[j] for rows in added), start=before), (within, ahead if sources else ())

        ahead, total, kept = carry
        ahead, (within, ends) = lax.scan(one, ahead, jnp.arange(CHUNK), reverse=True)
        if sources:
            kept = lax.dynamic_update_slice_in_dim(kept, ends, first, 0)
        share = linear.share(steps, places, within)
        return ahead, linear.constants.summed(total, share, c, _middles(steps)), kept

    kept = jnp.zeros_like(record.y) if sources else ()
    begin = varying_like((end, jnp.zeros_like(c), kept), (record, c, given, end))
    first, share, kept = lax.fori_loop(0, chunks, chunk, begin)
    return (first, share, kept) if sources else (first, share)


def _steps(linear: Stepping, record: StepsRecord, first: Any, c: Any) -> Steps:
    """Return CHUNK of the attempts of a run; where nothing moved, with a state that the run has been in."""
    taken = lax.dynamic_slice_in_dim(record.taken, first, CHUNK)
    h = taken[:, 1]
    y = jnp.where(h[:, jnp.newaxis] != 0.0, taken[:, 2:], record.end)
    rows = linear.constants.rows(c, taken[:, 0] + 0.5 * h)
    return Steps(taken[:, 0], h, tuple(y.T), rows)


def _middles(steps: Steps) -> Any:
    """Return the middles (k,) of steps."""
    return steps.t + 0.5 * steps.h


def _at(tree: Any, j: Any) -> Any:
    return jax.tree.map(lambda value: lax.dynamic_index_in_dim(value, j, keepdims=False), tree)
