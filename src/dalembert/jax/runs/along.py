"""Changes along a recorded run as linear maps, pushed forward and pulled back, to any order.

A change of the first state and of the constants is propagated from step to step, and from some steps to states at
requested times; cotangents are propagated back. The Jacobians of the steps depend on the states along the run and on
the constants, too: such changes of second order are changes along the same run that enter at every step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, final

import jax
import jax.numpy as jnp

from .derivatives import CHUNK, Over, Stepping, Steps, StepsRecord, pulled, pushed
from .linear_maps import Given, LinearMap, PushedRows, apply
from .mesh_axes import stack

if TYPE_CHECKING:
    from .adjoint import InTurn


@final
class Course(NamedTuple):
    """A recorded run, in floating point numbers.

    Attributes
    ----------
    count, taken, end : Array (), (room, 2 + n_y), (n_y,)
        As in `StepsRecord`.
    at, begins, sizes : Array (n_t,)
        The attempts that pass over requested times, by number; when these began, and how far they go to the times.
    c : Array (n_c,)
        Constants.
    """

    count: Any
    taken: Any
    end: Any
    at: Any
    begins: Any
    sizes: Any
    c: Any

    @property
    def record(self) -> StepsRecord:
        """The run as a record."""
        return StepsRecord(self.count.astype(int), self.taken, self.end, jnp.nan, jnp.nan)


@final
@dataclass(frozen=True)
class Step:
    """Ends of steps (k, n_y) from states (k, n_y) and constants (n_c,); where nothing moves, states as they are."""

    linear: Stepping

    def __call__(self, sizes: Any, y: Any, c: Any, end: Any) -> Any:
        """Return the ends; `sizes` are starts (k,), sizes (k,), and the number of attempts (k,)."""
        t, h, go = sizes
        moves = (h != 0.0)[:, None]
        safe = jnp.where(moves, y, jax.lax.stop_gradient(end))
        rows = self.linear.constants.rows(c, t + 0.5 * h)
        ends = self.linear.moved(Steps(t, h, tuple(safe.T), rows, go[0] > 0.0))
        return jnp.where(moves, stack(ends, axis=1), y)


@final
@dataclass(frozen=True)
class PushedStep:
    """The change of the end of a step with its start and the constants, as a function of rows."""

    step: Step

    def __call__(self, sizes: Any, rows: Any, shared: Any) -> Any:
        """Return the changes of the ends, of changes of states among `rows`, and of constants."""
        (y, dy), (c, dc, end) = rows, shared
        return jax.jvp(lambda y, c: self.step(sizes, y, c, end), (y, c), (dy, dc))[1], ()


@final
@dataclass(frozen=True)
class PulledStep:
    """The cotangents of the start of a step, and of the constants, as a function of rows."""

    step: Step

    def __call__(self, sizes: Any, rows: Any, shared: Any) -> Any:
        """Return the cotangents, of those of the ends among `rows`."""
        (y, ahead), (c, end) = rows, shared
        return jax.vjp(lambda y, c: self.step(sizes, y, c, end), y, c)[1](ahead)


def _steps(course: Course, rows: Any, shared: Any) -> Given:
    """Return all steps but those over requested times, with `rows` beside their states."""
    go = jnp.broadcast_to(course.count, course.taken.shape[:1])
    sizes = course.taken[:, 0], course.taken[:, 1], go
    return Given(-(-course.count // CHUNK), sizes, (course.taken[:, 2:], rows), shared)


def _times(course: Course) -> Any:
    """Return the steps over requested times and their states."""
    go = jnp.broadcast_to(course.count, course.begins.shape)
    return (course.begins, course.sizes, go), course.taken[course.at.astype(int), 2:]


@final
@dataclass(frozen=True)
class Along:
    """Changes along a run: from `Course` and (change of the first state, of the constants) to changes at the ends.

    The value is the change of the last state (n_y,) and of the states at requested times (n_t, n_y); where they are
    `kept`, also of those at the starts of attempts (room, n_y). With `sources`, changes that enter at the ends of all
    steps (room, n_y) and at requested times (n_t, n_y) follow those of the constants.
    """

    linear: Stepping
    kept: bool = False
    sources: bool = False

    def __call__(self, held: Course, moving: Any) -> Any:
        """See `LinearMap`."""
        dy, dc, *sources = moving
        timed = len(held.at) > 0
        rows, end = pushed(
            self.linear, held.record, held.c, dy, dc, keep=self.kept or timed, sources=sources[0] if sources else None
        )
        at_times = jnp.zeros((0, len(dy)))
        if timed:
            sizes, states = _times(held)
            starts = jnp.where(held.count > 0.0, rows[held.at.astype(int)], dy)
            at_times, _ = PushedStep(Step(self.linear))(sizes, (states, starts), (held.c, dc, held.end))
        if sources:
            at_times = at_times + sources[1]
        return (end, at_times, rows) if self.kept else (end, at_times)

    @property
    def transposed(self) -> LinearMap:
        """See `LinearMap`."""
        return _Against(self.linear, self.kept, self.sources)

    def change(self, held: Course, dheld: Course, moving: Any, still: Any) -> Any:
        """See `LinearMap`."""
        dy, dc = moving[:2]
        rows = apply(Along(self.linear, True, self.sources), held, moving)[2]
        step = Step(self.linear)
        given = _steps(held, rows, (held.c, dc, held.end))
        none = jnp.zeros_like
        moved = (dheld.taken[:, 2:], none(rows)), (dheld.c, none(dc), none(held.end))
        new, _ = apply(PushedRows(PushedStep(step), CHUNK), given, moved)
        sizes, states = _times(held)
        at = held.at.astype(int)

        def over(y: Any, c: Any) -> Any:
            return PushedStep(step)(sizes, (y, rows[at]), (c, dc, held.end))[0]

        later = jax.jvp(over, (states, held.c), (dheld.taken[at, 2:], dheld.c))[1] if len(at) else states
        return apply(Along(self.linear, self.kept, True), held, (none(dy), none(dc), new, later))


@final
@dataclass(frozen=True)
class _Against:
    """The transpose of `Along`."""

    linear: Stepping
    kept: bool
    sources: bool

    def __call__(self, held: Course, moving: Any) -> Any:
        turns = self.linear.in_turn
        # Elsewhere it is long rows that are fast.
        if turns is None or self.sources or jax.default_backend() != "cpu":
            return self._in_rows(held, moving)
        alone = jax.custom_batching.custom_vmap(partial(self._in_turn, turns))

        @alone.def_vmap
        def _(size: int, batched: Any, held: Course, moving: Any) -> Any:
            axes = jax.tree.map(lambda yes: 0 if yes else None, tuple(batched))
            return jax.vmap(self._in_rows, axes, axis_size=size)(held, moving), (True, True)

        return alone(held, moving)

    def _in_turn(self, turns: InTurn, held: Course, moving: Any) -> Any:
        """Return the same, one stage after the other, of one run."""
        end, at_times, *kept = moving
        over = (Over(held.at.astype(int), held.begins, held.sizes), at_times) if len(held.at) else ()
        return self._with_start(held, at_times, turns(held.record, held.c, tuple(kept), end, over))

    def _in_rows(self, held: Course, moving: Any) -> Any:
        """Return the same, of chunks of steps at once, as a batch of runs has it."""
        end, at_times, *kept = moving
        given, share = tuple(kept), jnp.zeros_like(held.c)
        if len(held.at):
            sizes, states = _times(held)
            starts, share = PulledStep(Step(self.linear))(sizes, (states, at_times), (held.c, held.end))
            rows = kept[0] if kept else jnp.zeros_like(held.record.y)
            given = (rows.at[held.at.astype(int)].add(starts),)
        first, added, *ahead = pulled(self.linear, held.record, held.c, given, end, sources=self.sources)
        first, added = self._with_start(held, at_times, (first, share + added))
        return (first, added, ahead[0], at_times) if self.sources else (first, added)

    @staticmethod
    def _with_start(held: Course, at_times: Any, found: tuple[Any, Any]) -> tuple[Any, Any]:
        """Return cotangents of the first state and the constants; where no step was taken, every time is the first."""
        first, share = found
        return jnp.where(held.count > 0.0, first, first + jnp.sum(at_times, 0)), share

    @property
    def transposed(self) -> LinearMap:
        return Along(self.linear, self.kept, self.sources)

    def change(self, held: Course, dheld: Course, moving: Any, still: Any) -> Any:
        end, at_times = moving[:2]
        ahead = apply(_Against(self.linear, self.kept, True), held, moving)[2]
        step, none = Step(self.linear), jnp.zeros_like
        given = _steps(held, ahead, (held.c, held.end))
        moved = (dheld.taken[:, 2:], none(ahead)), (dheld.c, none(held.end))
        rows, added = apply(PushedRows(PulledStep(step), CHUNK), given, moved)
        sizes, states = _times(held)
        at = held.at.astype(int)

        def over(y: Any, c: Any) -> Any:
            return PulledStep(step)(sizes, (y, at_times), (c, held.end))

        if len(at):
            starts, more = jax.jvp(over, (states, held.c), (dheld.taken[at, 2:], dheld.c))[1]
            rows, added = rows.at[at].add(starts), added + more
        first, share, *others = apply(
            _Against(self.linear, True, self.sources), held, (none(end), none(at_times), rows)
        )
        return (first, share + added, *others)
