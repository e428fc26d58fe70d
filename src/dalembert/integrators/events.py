"""Integration with events: a motion is cut where its state jumps, and ends where an event says so.

Any integrator serves that gives blocks of steps of a motion with continuous output. After a jump the rest of the block
is dropped and a new one begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.event_constants import RESIDUAL, TIME_NOISE
from ..methods.status import Status
from .crossings import Crossing, Pieces, changes, located, pieces
from .event_rules import (
    accumulates,
    carried_sign,
    happens_together,
    start_sign,
    too_soon,
    zero_level,
)
from .motion_record import MotionRecord
from .problem import IntegrationProblem, Solution
from .watched import Occurrence, Watched, recorded_states
from .zero_starts import ZeroStarts, short_share

__all__ = ["integrate_watched"]

StepBlocks = Callable[[IntegrationProblem], Iterator[Solution]]


def integrate_watched(
    step_blocks: StepBlocks, problem: IntegrationProblem, watched: Watched, carried: FloatArray | None = None
) -> tuple[Solution, list[Occurrence]]:
    """Integrate a problem with events.

    Parameters
    ----------
    step_blocks
        Gives the solution of a problem in blocks of steps, each with its continuous output; the status of the last is
        that of the whole.
    problem
        The problem.
    watched
        The events.
    carried
        Signs (n_events,) from which a motion goes on behind a stop (`EventWorkspace.carried`): expressions that change
        theirs by what happens at the stop occur at once. It gets the signs with which this part of the motion ends.

    Returns
    -------
    Solution
        Where a state jumps, its accepted steps hold the time twice.
    list of Occurrence
        In the order of time.
    """
    return _Run(step_blocks, problem, watched, carried).solution()


@final
class _Run:
    """One integration in progress."""

    def __init__(
        self, step_blocks: StepBlocks, problem: IntegrationProblem, watched: Watched, carried: FloatArray | None
    ) -> None:
        self.step_blocks, self.problem, self.watched, self.carried = step_blocks, problem, watched, carried
        self.t, self.y = float(problem.t0), np.array(problem.y0, dtype=float)
        self.forward = 1.0 if problem.t1 >= problem.t0 else -1.0
        self.span = abs(problem.t1 - problem.t0)
        self.occurrences: list[Occurrence] = []
        self.counts = [0] * len(watched.rules)
        self.jumped_at: float | None = None
        self.soon = 0.0
        self.record = MotionRecord(self.t, len(self.y), controlled=problem.sampled is not None)
        self.steps = self.rejected = self.evaluations = 0
        self.signs: NDArray[np.int8] = np.zeros(len(watched.rules), np.int8)
        self.seen: NDArray[np.bool_] = np.zeros(len(watched.rules), np.bool_)
        self.zero: NDArray[np.bool_] = np.zeros(len(watched.rules), np.bool_)
        self.residual = np.zeros(len(watched.rules))
        self.began = self.t
        self._directions = np.array([rule.direction for rule in watched.rules])
        self._armed = np.abs(self._directions) > 1

    def solution(self) -> tuple[Solution, list[Occurrence]]:
        """Run to the end and collect what was recorded."""
        status: Status | None = None
        while status is None:
            status = self._until_jump()
        t, y, dense = self.record.joined()
        if self.problem.t_eval is not None:
            t, y = recorded_states(self.watched, self.problem.t_eval, dense, t, y)
        return Solution(
            status=status,
            t=t,
            y=y,
            steps=self.steps,
            rejected=self.rejected,
            evaluations=self.evaluations,
            dense=dense if self.problem.dense else None,
            end=self.t,
        ), self.occurrences

    def _begin(self) -> None:
        """Record the state and the signs from which the motion begins, or continues after a jump."""
        self.record.add(np.array([self.t]), self.y)
        self.began = self.t
        self.signs, self.zero = self._signs(self.t, self.y, self.residual, armed=True)
        if self.carried is not None and self.t == self.problem.t0:
            self._go_on(self.carried)
        self.seen = np.zeros(len(self.counts), np.bool_)

    def _go_on(self, carried: FloatArray) -> None:
        """Take over the signs from which a motion goes on behind a stop."""
        begins = self.watched.begins(self.t, self.y).tolist()
        rows = zip(carried[: len(begins)].tolist(), begins, self.watched.rules, strict=True)
        for e, (before, (value, rate, noise), rule) in enumerate(rows):
            sign = carried_sign(before, value, rate, noise, self.t, self.forward, rule.direction)
            if sign != 0.0:
                self.signs[e], self.zero[e] = int(sign), False

    def _signs(
        self, t: float, y: FloatArray, residual: FloatArray, *, armed: bool
    ) -> tuple[NDArray[np.int8], NDArray[np.bool_]]:
        """Return the sign that each expression has, or takes at once where it is zero, and where it is."""
        rows = zip(self.watched.begins(t, y).tolist(), residual.tolist(), self.watched.rules, strict=True)
        found = [
            start_sign(value, rate, noise, left, t, self.forward, rule.direction if armed else 0)
            for (value, rate, noise), left, rule in rows
        ]
        return np.array([sign for sign, _ in found], np.int8), np.array([zero for _, zero in found], np.bool_)

    def _noise(self, t: float, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rates, and the sizes below which expressions count as zero, for a state that is not one of them."""
        begins = self.watched.begins(t, y)
        return begins[:, 1], np.array([zero_level(rate, noise, t) for _, rate, noise in begins.tolist()])

    def _until_jump(self) -> Status | None:
        """Integrate to the end, or to the next jump, for which None is returned."""
        self._begin()
        left = self.problem.max_steps - self.steps - self.rejected
        if left <= 0:
            return Status.MAX_STEPS
        rest = replace(self.problem, t0=self.t, y0=self.y, t_eval=None, dense=True, bounded=True, max_steps=left)
        status = Status.SUCCESS
        for block in self.step_blocks(rest):
            status = block.status
            self.steps += block.steps
            self.rejected += block.rejected
            self.evaluations += block.evaluations
            if len(block.t) > 1 and block.t[-1] != block.t[0]:  # also of a motion that takes no steps
                ended, outcome = self._scan(block)
                if ended:
                    return outcome
        return self._last(status)

    def _scan(self, block: Solution) -> tuple[bool, Status | None]:
        """Search for events in a block of steps; return whether one ended the motion or a part of it, and how."""
        dense = block.dense
        assert dense is not None
        knots = dense.knots
        sizes = np.diff(knots)
        watched = self.watched
        if watched.during is not None:
            watched = watched.during(float(knots[0]), float(knots[-1]))

        def states(step: NDArray[np.intp], theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            times = np.where(theta == 1.0, knots[step + 1], knots[step] + theta * sizes[step])
            times = np.clip(times, min(knots[0], knots[-1]), max(knots[0], knots[-1]))
            return times, watched.settle(times, dense.within(step, theta))

        def sample(step: NDArray[np.intp], theta: FloatArray) -> FloatArray:
            return watched.values(*states(step, theta))

        if not self.counts:
            self._take(block)
            return False, None
        rate, noise = self._noise(float(knots[0]), block.y[0])
        least = TIME_NOISE * np.maximum(np.abs(knots[:-1]), np.abs(knots[1:])) / np.abs(sizes)
        fresh = self.t == self.began
        starts = None
        if fresh and np.any(self.zero):

            def near(share: float) -> tuple[FloatArray, FloatArray]:
                times, y = states(np.array([0]), np.array([share]))
                begins = self.watched.begins(float(times[0]), y[0])
                return begins[:, 0], begins[:, 1] * sizes[0]

            slopes, sides = np.where(self.zero, rate * sizes[0], np.nan), np.where(self._armed, self.signs, 0.0)
            starts = ZeroStarts(slopes, sides, short_share(float(knots[0]), float(sizes[0])), near)
        cut = pieces(sample, len(sizes), noise, least, starts, oscillating=watched.oscillating)
        if fresh:
            cut.first[0, self.zero] = 0.0
        broken = int(np.argmin(cut.finite)) if not np.all(cut.finite) else None
        whole = cut if broken is None else Pieces(*(getattr(cut, name)[:broken] for name in cut.__dataclass_fields__))
        found, self.signs, seen = changes(whole, self.signs, noise)

        def state(crossing: Crossing) -> tuple[float, FloatArray]:
            times, y = states(np.array([crossing.step]), np.array([crossing.theta]))
            return float(times[0]), y[0]

        ended, outcome = self._occur(located(sample, whole, found, least), state, block)
        if not ended and broken is not None:
            place, theta = np.array([cut.step[broken]]), np.array([cut.low[broken]])
            (t,), y = states(place, theta)
            self._cut(block, float(t), y[0])
            return True, Status.EVENT_NON_FINITE
        if not ended:
            self.seen |= seen
            self._take(block)
        return ended, outcome

    def _occur(
        self,
        found: Iterator[Crossing],
        state: Callable[[Crossing], tuple[float, FloatArray]],
        block: Solution | None,
    ) -> tuple[bool, Status | None]:
        """Record sign changes as events up to the first that ends the run or makes it jump."""
        rules = self.watched.rules
        for crossing in found:
            rule = rules[crossing.function]
            if not rule.counts(crossing.sign):
                continue
            t, y = state(crossing)
            terminal = rule.last > 0 and self.counts[crossing.function] + 1 >= rule.last
            if rule.jump is None and not terminal:
                self._occurred(crossing, t, y, y)
                continue
            together = [crossing]
            for other in found:
                if not happens_together(state(other)[0] - t, t, self.t):
                    break
                if rules[other.function].counts(other.sign):
                    together.append(other)
            return True, self._stop(together, t, y, block)
        return False, None

    def _occurred(self, crossing: Crossing, t: float, before: FloatArray, after: FloatArray) -> bool:
        """Record an occurrence; return whether it ends the run."""
        number = crossing.function
        self.counts[number] += 1
        self.occurrences.append(Occurrence(number, t, before, after, crossing.sign))
        last = self.watched.rules[number].last
        return 0 < last <= self.counts[number]

    def _stop(self, together: Sequence[Crossing], t: float, y: FloatArray, block: Solution | None) -> Status | None:
        """End the present part of the motion at time t in state y, where `together` occur; None to continue."""
        if block is not None:
            self._cut(block, t, y)
        jumps = [self.watched.rules[crossing.function].jump for crossing in together]
        after: FloatArray | None = y
        for jump in jumps:
            if jump is not None and after is not None:
                after = jump(t, after, self.forward)
        status = None
        for crossing in together:
            if self._occurred(crossing, t, y, y if after is None else after):
                status = Status.EVENT
        if after is None:
            return Status.EVENT_STATE
        first_of_part = all(crossing.seen or self.seen[crossing.function] for crossing in together)
        self.t, self.y = t, after
        here = np.array([crossing.function for crossing in together])
        self.residual = np.zeros(len(self.counts))
        self.residual[here] = RESIDUAL * np.abs(self.watched.values(np.array([t]), y[np.newaxis])[0, here])
        if status is None:
            status = self._accumulation(t, first_of_part)
        if status is None and t == self.problem.t1:
            status = Status.SUCCESS
        if status is not None and any(jump is not None for jump in jumps):
            self.record.add(np.array([t]), after)
        return status

    def _accumulation(self, t: float, seen: bool) -> Status | None:
        """Return the status where jumps accumulate; `seen`: there was motion beyond rounding in between."""
        before, self.jumped_at = self.jumped_at, t
        if before is None:
            return None
        gap = abs(t - before)
        self.soon = too_soon(gap, self.span, self.soon)
        return Status.EVENTS_ACCUMULATE if accumulates(gap, t, self.span, seen, self.soon) else None

    def _take(self, block: Solution) -> None:
        """Record a whole block."""
        self.record.take(block)
        self.t, self.y = float(block.t[-1]), block.y[-1]

    def _cut(self, block: Solution, t: float, y: FloatArray) -> None:
        """Record a block of steps up to time t, where the state is y."""
        self.record.cut(block, t, y, self.forward)
        self.t, self.y = t, y

    def _last(self, status: Status) -> Status | None:
        """Search for events at the very end, where an expression may be zero without a change of sign.

        One that is zero from the beginning, up to rounding, does not occur there.
        """
        if status is not Status.SUCCESS or self.span == 0.0:
            return status
        signs, zero = self._signs(self.t, self.y, np.zeros(len(self.counts)), armed=False)
        if self.carried is not None:
            self.carried[: len(zero)] = np.where(zero, 0.0, self.signs)
        left = self.seen | ~self.zero
        found = (
            Crossing(int(i), 0, 1.0, int(signs[i]), True)
            for i in np.flatnonzero((signs * self.signs < 0) & zero & left)
        )
        ended, outcome = self._occur(found, lambda crossing: (self.t, self.y), None)
        return outcome if ended else status
