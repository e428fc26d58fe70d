"""A traced run whose derivatives are taken over its steps at once: forward and reverse, alone and in batches.

The run itself is a plain loop, which takes down where each attempt began and how far it went. Derivatives are those of
the accepted steps at these sizes (see `dalembert.integrators.jax.derivatives`). States at wanted times are ends of
shorter steps of the same method, from the beginning of the step that passes over them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol, final

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from ...methods.status import Status
from ...once import once_property
from .along import Along, Course, Differentiable
from .continuous import Continuous, Field, Passed
from .derivatives import CHUNK, Over, Record, Steps, instantiate
from .jumping import moved_until, sure_until
from .lanes import Attempts, Batch, Function, Projections, Rows
from .linear_maps import apply
from .mesh_axes import stack, vectorised
from .recomputed import Blocks, Kept, Recomputed, with_blocks
from .recording import course_of
from .timed import At, Timed
from .unknown import Known, OrNan

__all__ = ["Limits", "Motion", "Path", "Pieces", "Reached", "Stepping", "ended", "in_order", "middles"]


class Stepping(Differentiable, Protocol):
    """Steps of given sizes, and their derivatives."""

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, n_y rows (k,)."""

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps, n_y rows (k,)."""


class Foreign(Protocol):
    """Runs of one case as calls of machine code."""

    @property
    def serves(self) -> bool:
        """Whether the present trace may have such calls."""
        ...

    def __call__(self, limits: Limits, room: int, traced: Callable[..., Record], t: Any, y: Any, c: Any) -> Record:
        """Return how a run went, which `traced`, a function of (t, y, c), does in a traced loop."""
        ...


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
    field
        What makes the rates and their cotangents for continuous adjoints.
    foreign
        Runs of one case as calls of machine code; None where there are none.
    """

    one: Attempts
    one_projections: Projections
    many: Attempts
    many_projections: Projections
    steps: Stepping
    decided: Function | None = None
    moved_by: tuple[int, ...] = ()
    field: Callable[[], Field] | None = None
    foreign: Foreign | None = None


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
class Reached(NamedTuple):
    """States (n_t, n_y) of a run, NaN where it did not come, its status, its accepted steps, and its attempts."""

    y: Any
    status: Any
    steps: Any
    attempts: Any


@final
class Path(NamedTuple):
    """The attempts of a run, of which `count` were made, as in `Record`: what it takes to go along it again.

    ``taken`` (room, 2 + n_y), ``end`` (n_y,), and the time ``reached``, in the direction of the run.
    """

    count: Any
    taken: Any
    end: Any
    reached: Any
    direction: Any


@final
class _Full(NamedTuple):
    """A run with its record, in floating point numbers: as in `Reached`, in `Course` and in `Known`.

    `passing` are the attempts that pass over more than two times: their numbers, starts, and sizes to the times.
    """

    y: Any
    status: Any
    steps: Any
    attempts: Any
    count: Any
    taken: Any
    end: Any
    reached: Any
    passing: tuple[Any, Any, Any]
    known: Any
    moved: Any


def in_order(t: Any) -> tuple[Any, Any]:
    """Return times (n_t,) by which to run, and whether they are those given: finite, and going one way."""
    ordered = jnp.all(jnp.isfinite(t)) & (jnp.all(t[1:] >= t[:-1]) | jnp.all(t[1:] <= t[:-1]))
    return jnp.where(ordered, t, 0.0), ordered


def middles(t: Any, breaks: Any) -> Any:
    """Return the middles (n_t,) between the breaks (n,) around times, of which the first is 0 and the last the end."""
    direction, count = jnp.where(t[-1] >= t[0], 1.0, -1.0), len(breaks)
    passed = _places(direction * breaks, direction * t)
    behind = jnp.where(passed > 0, breaks[jnp.maximum(passed - 1, 0)], t[0])
    ahead = breaks[jnp.minimum(passed, count - 1)]
    ahead = jnp.where((passed < count) & jnp.isfinite(ahead), ahead, t[-1])
    return behind + 0.5 * (ahead - behind)


def _places(rows: Any, values: Any) -> Any:
    """Return how many of the rising `rows` (n,) are at most each of the values (k,)."""
    still = jax.lax.stop_gradient
    return vectorised(partial(jnp.searchsorted, side="right"), True, still(rows), still(values))


def _single(pieces: Pieces, room: int, batch: Batch, t: Any) -> Record:
    """Return how one case went, whose state and constants are arrays."""
    batch = batch._replace(y=(batch.y,), c=pieces.steps.constants.split(batch.c))
    count, taken, end = course_of(pieces.one, pieces.one_projections, room, batch, t)
    return Record(count, taken, end.y[0], end.t, end.status.astype(float), end.steps, end.attempts)


def ended(pieces: Pieces, batch: Batch) -> tuple[Any, Any, Any]:
    """Return the last state (n_y,) of one case, whose state and constants are arrays, its time, and the status."""
    return _single(pieces, 0, batch, ())[2:5]


@final
class Motion:
    """Runs of one method for one program, as functions that JAX differentiates and vectorises.

    Parameters
    ----------
    pieces : Pieces
        The method.
    limits : Limits
        How the steps are chosen.
    adjoint : str
        A name in `dalembert.options.ADJOINTS`.
    """

    def __init__(self, pieces: Pieces, limits: Limits, adjoint: str = "recorded") -> None:
        self._pieces, self._limits, self._adjoint = pieces, limits, adjoint
        self._room = -(-limits.max_steps // CHUNK) * CHUNK

    def __call__(self, t: Any, y0: Any, c: Any, breaks: Any = (), moved: Any = ()) -> Reached:
        """Return the states (n_t, n_y) at the sorted times t (n_t,), from y0 (n_y,) at t[0] = 0, and how the run went.

        States that were not reached are NaN, and so are all derivatives of what is computed from them. Steps end at
        `breaks` (n,), in the order of the run, infinite behind the last, which are `moved` (n,) by constants or not.
        """
        given = t, y0, c, jnp.asarray(breaks, dtype=float), jnp.asarray(moved, dtype=float)
        passing = self._passing if self._adjoint == "recorded" else self._unrecorded
        y, *numbers = passing(*given)
        return Reached(y, *(number.astype(int) for number in numbers))

    def recorded(self, t: Any, y0: Any, c: Any, breaks: Any = (), moved: Any = ()) -> tuple[Reached, Path]:
        """Return what a call does, and the path of the run, whose states are differentiated, too.

        Behind jumps of the rates that depend on the state, or on parameters in time, their derivatives miss a term:
        see `jumps`.
        """
        full = self._full(t, y0, c, jnp.asarray(breaks, dtype=float), jnp.asarray(moved, dtype=float))
        y, *numbers = full[:4]
        direction = jnp.where(full.reached >= 0.0, 1.0, -1.0)
        path = Path(full.count, full.taken, full.end, full.reached, direction)
        return Reached(y, *(number.astype(int) for number in numbers)), path

    @property
    def jumps(self) -> bool:
        """Whether derivatives along a path may miss what a jump of the rates adds."""
        return self._pieces.decided is not None or bool(self._pieces.moved_by)

    def states(self, path: Path, t: Any, c: Any) -> Any:
        """Return the states (n_t, n_y) at times t (n_t,) since the start of a run, NaN where it did not come.

        They are ends of shorter steps of the same method, and change with the times as those with their sizes do.
        """
        still = jax.lax.stop_gradient
        forward, taken = path.direction, path.taken
        inside = jnp.arange(len(taken)) < path.count
        starts = jnp.where(inside, forward * taken[:, 0], jnp.inf)
        at = jnp.maximum(_places(starts, forward * t) - 1, 0)
        known = (forward * t >= 0.0) & (forward * t <= forward * path.reached) & (path.count > 0.0)
        known |= (t == 0.0) & (path.reached == 0.0)
        begins = jnp.where(known, still(taken[at, 0]), 0.0)
        size = jnp.where(known, t - begins, 0.0)
        y = jnp.where((known & (path.count > 0.0))[:, None], taken[at, 2:], path.end)
        rows = self._pieces.steps.constants.rows(c, begins + 0.5 * still(size))
        ends = self._pieces.steps.moved(Steps(begins, size, tuple(y.T), rows, path.count > 0.0))
        zeros = jnp.zeros(len(t))
        moving = stack(ends, axis=1), (t, path.end, c)
        return apply(OrNan(()), Known(known.astype(float), zeros, still(c)), moving)

    # -- the run --------------------------------------------------------------------------

    def _batch(self, t0: Any, t1: Any, y: Any, c: Any, breaks: Any) -> Batch:
        limits, constants = self._limits, self._pieces.steps.constants
        batch = Batch(y, c, t0, t1, (), limits.floor, limits.rtol, limits.atol, limits.max_step, limits.max_steps)
        if not len(breaks):
            return batch
        return batch._replace(breaks=breaks, between=constants.reading(c, breaks, t0, t1))

    def _one(self, room: int, *given: Any) -> Record:
        """Run one case at times t, from y, with c and breaks, as one of a batch where it is vectorised."""
        pieces = self._pieces

        def traced(t: Any, y: Any, c: Any, breaks: Any = ()) -> Record:
            return _single(pieces, room, self._batch(t[0], t[-1], y, c, breaks), t if len(t) > 2 else t[:0])

        @jax.custom_batching.custom_vmap
        def one(t: Any, y: Any, c: Any, breaks: Any) -> Record:
            if pieces.foreign is not None and pieces.foreign.serves:
                return pieces.foreign(self._limits, room, traced, t, y, c)
            return traced(t, y, c, breaks)

        @one.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[Record, Record]:
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            t, *rest = rows
            between = t if t.shape[1] > 2 else t[:, :0]
            return self._many(room, t[:, 0], t[:, -1], *rest, between), Record(False, *[True] * 6)

        found: Record = one(*given)
        return found

    def _many(self, room: int, *given: Any) -> Record:
        """Run cases in one loop; a batch of batches is one batch."""
        pieces = self._pieces

        @jax.custom_batching.custom_vmap
        def many(t0: Any, t1: Any, y: Any, c: Any, breaks: Any, t: Any) -> Record:
            batch = self._batch(t0, t1, tuple(y.T), c, breaks.T)
            batch = batch._replace(c=pieces.steps.constants.split(c))
            count, taken, end = course_of(pieces.many, pieces.many_projections, room, batch, t.T)
            states = jnp.stack(end.y, axis=-1) if end.y else jnp.zeros((len(t0), 0))
            status = end.status.astype(float)
            return Record(count, jnp.moveaxis(taken, 2, 0), states, end.t, status, end.steps, end.attempts)

        @many.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> tuple[Record, Record]:
            rows = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(arguments, batched, strict=True)]
            own = rows[0].shape[1]
            count, *rest = self._many(room, *(row.reshape(size * own, *row.shape[2:]) for row in rows))
            split = [value.reshape(size, own, *value.shape[1:]) for value in rest]
            return Record(count, *split), Record(False, *[True] * 6)

        found: Record = many(*given)
        return found

    def _plain(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> Any:
        """Return how the run went, in floating point numbers."""
        return vectorised(lambda *values: self._run(0, *values)[0], True, t, y0, c, breaks)

    # -- its derivatives ------------------------------------------------------------------

    @once_property
    def _passing(self) -> Callable[..., Reached]:
        """The function (t, y0, c, breaks, moved) -> how the run went, in floating point numbers."""

        def push(values: Any, tangents: Any) -> Any:
            full = self._full(*values)
            dy = self._changes(full, values, tangents, kept=False)[0]
            reached = Reached(*full[:4])
            return reached, Reached(dy, *(jnp.zeros_like(number) for number in reached[1:]))

        passing = jax.custom_jvp(self._plain)
        passing.defjvp(push, symbolic_zeros=True)
        return passing

    @once_property
    def _unrecorded(self) -> Callable[..., Reached]:
        """What `_passing` is, with derivatives for which no record of the whole run is kept; first ones alone."""

        def push(values: Any, tangents: Any) -> Any:
            (t, y0, c, breaks, _), (dt, dy, dc) = values, tangents[:3]
            dy, dc, times = instantiate(dy), instantiate(dc), instantiate(dt)
            reached, known, changes = (self._along_field if self._adjoint == "continuous" else self._along_blocks)(
                t, y0, c, breaks, (dy, dc)
            )
            if not isinstance(dt, SymbolicZero):
                changes = changes + times[:, None] * self._rates(t, reached.y, c, breaks)
            held = Known(known.astype(float), jnp.zeros(len(t)), c)
            dy = apply(OrNan(()), held, (changes, (times, dy, dc)))
            return reached, Reached(dy, *(jnp.zeros_like(number) for number in reached[1:]))

        unrecorded = jax.custom_jvp(self._plain)
        unrecorded.defjvp(push, symbolic_zeros=True)
        return unrecorded

    def _along_field(self, t: Any, y0: Any, c: Any, breaks: Any, moving: Any) -> tuple[Reached, Any, Any]:
        """Return how a run went, which times it reached, and the changes of the states there, by `Continuous`."""
        still = jax.lax.stop_gradient
        given = still(t), still(y0), still(c), still(breaks)
        reached, known = vectorised(lambda *values: self._run(0, *values)[::2], True, *given)
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        times = forward * jax.lax.cummax(jnp.where(known, forward * t, 0.0))
        later = jnp.where(known[1:, None], reached.y[1:], y0)
        held = Passed(times, jnp.concatenate([y0[None], later]), c)
        limits, make = self._limits, self._pieces.field
        assert make is not None
        settings = limits.rtol, limits.atol, limits.max_step, limits.max_steps
        return reached, known, apply(Continuous(make(), settings), held, moving)

    def _along_blocks(self, t: Any, y0: Any, c: Any, breaks: Any, moving: Any) -> tuple[Reached, Any, Any]:
        """Return what `_along_field` does, by `Recomputed`."""
        limits, pieces, still = self._limits, self._pieces, jax.lax.stop_gradient
        settings = limits.floor, limits.rtol, limits.atol, limits.max_step, limits.max_steps
        blocks = Blocks(pieces.one, pieces.one_projections, settings)
        kept, reached, known = vectorised(partial(self._in_blocks, blocks), True, still(t), still(y0), still(c))
        states = jnp.concatenate([y0[None], kept.states.y[0][1:]])
        kept = kept._replace(states=kept.states._replace(y=(states,)), c=c)
        last, changes = apply(Recomputed(pieces.steps, blocks), kept, moving)
        if len(t) <= 2:
            changes = stack([moving[0], last])[: len(t)]
        return reached, known, changes

    def _in_blocks(self, blocks: Blocks, t: Any, y0: Any, c: Any) -> tuple[Kept, Reached, Any]:
        """Return what is kept of a run, how it went, and which times were reached."""
        times, ordered = in_order(t)
        end, kept = with_blocks(blocks, times, y0, c)
        forward = jnp.where(times[-1] >= times[0], 1.0, -1.0)
        known = ordered & (forward * (times - end.t) <= 0.0)
        if len(t) <= 2:
            y = jnp.stack([y0, end.y[0]])[: len(t)]
        else:
            steps = Steps(kept.begins, kept.sizes, tuple(kept.states_there.T), tuple(c), kept.count > 0.0)
            y = jnp.stack(self._pieces.steps(steps), axis=1)
        status = jnp.where(ordered, end.status.astype(float), float(Status.TIMES_IN_NO_ORDER))
        return kept, Reached(jnp.where(known[:, None], y, jnp.nan), status, end.steps, end.attempts), known

    @once_property
    def _full(self) -> Callable[..., _Full]:
        """The function (t, y0, c, breaks, moved) -> a run with its record, differentiated as such."""

        def push(values: Any, tangents: Any) -> Any:
            full = self._full(*values)
            dy, end, rows = self._changes(full, values, tangents, kept=True)
            still = jax.tree.map(jnp.zeros_like, full)
            taken = jnp.concatenate([still.taken[:, :2], rows], axis=1)
            return full, still._replace(y=dy, taken=taken, end=end)

        def recorded(*values: Any) -> Any:
            whole = _Full(True, True, True, True, False, True, True, True, (True, True, True), True, True)
            return vectorised(self._recorded, whole, *values)

        full = jax.custom_jvp(recorded)
        full.defjvp(push, symbolic_zeros=True)
        return full

    def _changes(self, full: _Full, values: Any, tangents: Any, *, kept: bool) -> tuple[Any, ...]:
        """Return the changes of the states (n_t, n_y), of the last one, and where `kept` of those in the record."""
        (t, _, c, breaks, _), (dt, dy, dc) = values, tangents[:3]
        dy, dc = instantiate(dy), instantiate(dc)
        timed = len(t) > 2
        course = Course(full.count, full.taken, full.end, *full.passing, c)
        end, over, *rows = apply(Along(self._pieces.steps, kept), course, (dy, dc))
        changes = over if timed else stack([dy, end])[: len(t)]
        changes = apply(Timed(self._rates), At(t, full.y, c, breaks), (changes, dc))
        if not isinstance(dt, SymbolicZero):
            changes = changes + dt[:, None] * self._rates(t, full.y, c, breaks)
        known = Known(full.known, full.moved, c)
        sources = instantiate(dt), dy, dc
        return apply(OrNan(self._pieces.moved_by), known, (changes, sources)), end, *rows

    def _recorded(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> _Full:
        """Return a run with its record; what lies behind a jump is not known to those who differentiate."""
        reached, record, known, passing = self._run(self._room, t, y0, c, breaks)
        decided, moved_by = self._pieces.decided, self._pieces.moved_by
        behind = jnp.zeros(len(t))

        def rates(t: Any, y: Rows, c: Rows) -> Rows:
            return self._pieces.steps.rates(Steps(t, jnp.zeros_like(t), y, c, record.count > 0))

        direction, constants = jnp.where(t[-1] >= t[0], 1.0, -1.0), self._pieces.steps.constants
        if decided is not None and len(y0):
            until = sure_until(decided, rates, constants, record, c, direction)
            known &= direction * (t - until) <= 0.0
        if moved_by and len(y0):
            until = moved_until(rates, constants, record, c, direction, (t[-1], breaks, moved > 0.0))
            behind = (direction * (t - until) > 0.0).astype(float)
        count, known = record.count.astype(float), known.astype(float)
        return _Full(*reached, count, record.taken, record.end, record.reached, passing, known, behind)

    def _rates(self, t: Any, y: Any, c: Any, breaks: Any) -> Any:
        """Return the rates (n_t, n_y) of states at times: the derivatives of where a run is by the time."""
        constants = self._pieces.steps.constants
        rows = constants.rows(c, middles(jax.lax.stop_gradient(t), breaks) if constants.broken else t)
        steps = Steps(t, jnp.zeros_like(t), tuple(y.T), rows, jnp.isfinite(jax.lax.stop_gradient(t[0])))
        return stack(self._pieces.steps.rates(steps), axis=1)

    def _ends(self, over: Over, states: Any, c: Any, go: Any) -> Any:
        """Return the ends (n_t, n_y) of steps to wanted times, one stage after the other where that is faster."""
        moves = self._pieces.steps

        def in_rows(over: Over, states: Any, c: Any, go: Any) -> Any:
            rows = moves.constants.rows(c, over.begins + 0.5 * over.sizes)
            return jnp.stack(moves(Steps(over.begins, over.sizes, tuple(states.T), rows, go)), axis=1)

        turns = moves.in_turn
        if turns is None or jax.default_backend() != "cpu":
            return in_rows(over, states, c, go)
        alone = jax.custom_batching.custom_vmap(lambda over, states, c, go: turns.ends(over, states, c))

        @alone.def_vmap
        def _(size: int, batched: Any, *arguments: Any) -> Any:
            axes = jax.tree.map(lambda yes: 0 if yes else None, tuple(batched))
            return jax.vmap(in_rows, axes, axis_size=size)(*arguments), True

        return alone(over, states, c, go)

    def _run(self, room: int, t: Any, y0: Any, c: Any, breaks: Any) -> tuple[Reached, Record, Any, Any]:
        """Return how the run went, its record, which times were reached, and what passes over them, as in `_Full`."""
        t, ordered = in_order(t)
        record = self._one(room, t, y0, c, breaks)
        record = record._replace(status=jnp.where(ordered, record.status, float(Status.TIMES_IN_NO_ORDER)))
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        known = ordered & (forward * (t - record.reached) <= 0.0)
        numbers = record.status, record.steps, record.attempts
        if len(t) <= 2:
            y = jnp.stack([y0, record.end])[: len(t)]
            y = jnp.where(known[:, None], y, jnp.nan)
            return Reached(y, *numbers), record, known, (jnp.zeros(0),) * 3
        at = jnp.zeros(0, dtype=int)
        if room:
            times = jnp.where(jnp.arange(room) < record.count, forward * record.t, jnp.inf)
            at = jnp.maximum(jnp.searchsorted(times, forward * t, side="right") - 1, 0)
            begins, states = record.t[at], jnp.where(record.count > 0, record.y[at], y0)
        else:
            begins, states = record.taken[:, 0], record.taken[:, 1:]
        size = jnp.where(known, t - begins, 0.0)  # beyond the end, steps might overflow
        ends = self._ends(Over(at, begins, size), states, c, record.count > 0)
        y = jnp.where(known[:, None], ends, jnp.nan)
        return Reached(y, *numbers), record, known, (at.astype(float), begins, size)
