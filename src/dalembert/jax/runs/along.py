"""Changes along a recorded run as linear maps, pushed forward and pulled back, to any order.

A change of the first state and of the constants is propagated from step to step, and from some steps to states at
requested times; cotangents are propagated back. The Jacobians of the steps depend on the states along the run and on
the constants, too: such changes of second order are changes along the same run that enter at every step.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, final

import jax
import jax.numpy as jnp

from ...frozen import frozen
from .derivatives import CHUNK, Over, Stepping, Steps, StepsRecord, alone_or_many, pulled, pushed
from .linear_maps import Back, Given, LinearMap, Moved, RowFunction, apply, changed
from .mesh_axes import stack

if TYPE_CHECKING:
    from .adjoint import InTurn


@final
class Course(NamedTuple):
    """A recorded run, of which attempts and end count, steps over requested times (n_t,), and constants (n_c,).

    All are floating point numbers.
    """

    record: StepsRecord
    over: Over
    c: Any

    @property
    def at(self) -> Any:
        """The numbers of the attempts that pass over requested times."""
        return self.over.at.astype(int)

    @property
    def counted(self) -> StepsRecord:
        """The record with the number of attempts as one."""
        return self.record._replace(count=self.record.count.astype(int))


@final
@frozen
class Step:
    """Ends of steps (k, n_y) from states (k, n_y), as a function of rows; where nothing moves, states as they are.

    What steps share are constants (n_c,), and a state that the run has been in (n_y,).
    """

    linear: Stepping

    def __call__(self, sizes: Any, y: Any, shared: Any) -> tuple[Any, Any]:
        """Return the ends; `sizes` are starts (k,) and sizes (k,)."""
        (t, h), (c, end) = sizes, shared
        moves = (h != 0.0)[:, None]
        safe = jnp.where(moves, y, jax.lax.stop_gradient(end))
        rows = self.linear.constants.rows(c, t + 0.5 * h)
        ends = self.linear.moved(Steps(t, h, tuple(safe.T), rows))
        return jnp.where(moves, stack(ends, axis=1), y), ()


def _steps(course: Course) -> Given:
    """Return all steps but those over requested times."""
    record = course.record
    return Given(-(-record.count // CHUNK), (record.t, record.taken[:, 1]), record.y, (course.c, record.end))


def _times(course: Course) -> Any:
    """Return the steps over requested times and their states."""
    return (course.over.begins, course.over.sizes), course.record.taken[course.at, 2:]


@final
@frozen
class Along(LinearMap):
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
        timed = len(held.over.at) > 0
        rows, end = pushed(
            self.linear, held.counted, held.c, dy, dc, keep=self.kept or timed, sources=sources[0] if sources else None
        )
        at_times = jnp.zeros((0, len(dy)))
        if timed:
            sizes, states = _times(held)
            starts = jnp.where(held.record.count > 0.0, rows[held.at], dy)
            shared = (held.c, held.record.end), (dc, jnp.zeros_like(held.record.end))
            at_times, _ = Moved(Step(self.linear))(sizes, (states, starts), shared)
        if sources:
            at_times = at_times + sources[1]
        return (end, at_times, rows) if self.kept else (end, at_times)

    def back(self, held: Course, given: Any) -> Any:
        """See `LinearMap`."""
        turns = self.linear.in_turn
        # Elsewhere it is long rows that are fast.
        if turns is None or self.sources or jax.default_backend() != "cpu":
            return self._back_in_rows(held, given)
        return alone_or_many(partial(self._back_in_turn, turns), self._back_in_rows, held, given)

    def change(self, held: Course, dheld: Course, moving: Any, still: Any) -> Any:
        """See `LinearMap`."""
        (dy, dc), none = moving[:2], jnp.zeros_like
        rows = apply(replace(self, kept=True), held, moving)[2]
        shared, over = (dc, none(held.record.end)), rows[held.at]
        (new, _), (later, _) = self._changes(Moved(Step(self.linear)), (held, dheld), rows, over, shared)
        return apply(replace(self, sources=True), held, (none(dy), none(dc), new, later))

    def change_back(self, held: Course, dheld: Course, given: Any, still: Any) -> Any:
        """See `LinearMap`."""
        (end, at_times), none = given[:2], jnp.zeros_like
        ahead = apply(replace(self, sources=True).transposed, held, given)[2]
        (rows, (added, _)), (starts, more) = self._changes(Back(Step(self.linear)), (held, dheld), ahead, at_times, ())
        if more:
            rows, added = rows.at[held.at].add(starts), added + more[0]
        kept = none(end), none(at_times), rows
        first, share, *others = apply(replace(self, kept=True).transposed, held, kept)
        return (first, share + added, *others)

    @staticmethod
    def _changes(function: RowFunction, held: tuple[Course, Course], rows: Any, over: Any, shared: Any) -> Any:
        """Return the changes with a run, and its change, of a function of all steps, and of those to requested times.

        The function also takes `rows` beside the states of steps, `over` beside those of steps to times, and `shared`.
        """
        course, dcourse = held
        whole = changed(function, CHUNK, _steps(course), _steps(dcourse), (rows, shared))
        (sizes, states), at = _times(course), course.at
        if not len(at):
            return whole, (states, ())

        def timed(y: Any, c: Any) -> Any:
            return function(sizes, (y, over), ((c, course.record.end), shared))

        return whole, jax.jvp(timed, (states, course.c), (dcourse.record.taken[at, 2:], dcourse.c))[1]

    def _back_in_turn(self, turns: InTurn, held: Course, given: Any) -> Any:
        """Return the cotangents of one run, one stage after the other."""
        end, at_times, *kept = given
        over = (held.over._replace(at=held.at), at_times) if len(held.over.at) else ()
        return self._with_start(held, at_times, turns(held.counted, held.c, tuple(kept), end, over))

    def _back_in_rows(self, held: Course, given: Any) -> Any:
        """Return the same, of chunks of steps at once, as a batch of runs has it."""
        end, at_times, *kept = given
        added, share = tuple(kept), jnp.zeros_like(held.c)
        if len(held.over.at):
            sizes, states = _times(held)
            starts, (share, _) = Back(Step(self.linear))(sizes, (states, at_times), ((held.c, held.record.end), ()))
            rows = kept[0] if kept else jnp.zeros_like(held.record.y)
            added = (rows.at[held.at].add(starts),)
        first, more, *ahead = pulled(self.linear, held.counted, held.c, added, end, sources=self.sources)
        first, share = self._with_start(held, at_times, (first, share + more))
        return (first, share, ahead[0], at_times) if self.sources else (first, share)

    @staticmethod
    def _with_start(held: Course, at_times: Any, found: tuple[Any, Any]) -> tuple[Any, Any]:
        """Return cotangents of the first state and the constants; where no step was taken, every time is the first."""
        first, share = found
        return jnp.where(held.record.count > 0.0, first, first + jnp.sum(at_times, 0)), share
