"""Stops on the host: cases go from stop to stop by an engine whose loops pass none, and their solutions are joined.

The lists are those that compiled loops take (`dalembert.stops.stops`); knots of inputs end pieces of a run, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import KnotSides
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_OF_TIME
from ..steps.dense_output import DenseOutput, JoinedOutput, PiecewisePolynomial
from ..steps.problem import IntegrationProblem, SamplingClock, Solution
from ..stops.input_records import InputRecords
from ..stops.stops import CaseStops, StopLists
from .cases import BlockResult, CaseBlock

IntArray = NDArray[np.intp]
Prepare = Callable[[FloatArray], FloatArray]
"""From parameters, the first of the columns (k, n), to constants (k, n_c)."""

ALONE = np.zeros(1, np.intp)
"""The number of a case that is alone."""

_NO_STOPS = CaseStops(
    StopLists(np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(0), np.zeros(0, np.int64), np.zeros(0)), None, ()
)


@final
class CasesAtStops:
    """Cases on their way from stop to stop.

    Parameters
    ----------
    stops : CaseStops
    spans : ndarray (k, 2)
        Starts and ends.
    y, c : ndarray (k, n_y), (k, n_c)
        States and constants at the starts.
    prepare : function or None
        Gives constants where conditions are decided.
    inputs : InputRecords or None
        Those of a case that is alone; of others what they say about sides.
    at_knots : bool
        Whether pieces end at knots of the inputs, too, which the engine does not pass.
    clock : SamplingClock or None
        Gets the last time at which controllers have acted.

    Attributes
    ----------
    t, y, c : ndarray (k,), (k, n_y), (k, n_c)
        Present times, states and constants.
    ends, number : ndarray (k,)
        Where the next pieces end; the next stops.
    """

    def __init__(
        self,
        stops: CaseStops,
        spans: FloatArray,
        y: FloatArray,
        c: FloatArray,
        prepare: Prepare | None,
        inputs: InputRecords | None,
        *,
        at_knots: bool = True,
        clock: SamplingClock | None = None,
    ) -> None:
        self.stops, self.spans, self._prepare, self._at_knots, self._clock = stops, spans, prepare, at_knots, clock
        self.t, self.ends, self.y, self.c = spans[:, 0].copy(), spans[:, 1].copy(), y.copy(), c.copy()
        self.number, self._sign = stops.lists.first.copy(), np.where(spans[:, 1] >= spans[:, 0], 1.0, -1.0)
        times = stops.lists.times
        self._together = bool(np.any(np.abs(np.diff(times)) <= SMALLEST_OF_TIME * np.abs(times[1:])))
        self._sides: KnotSides | None = None if inputs is None else inputs.sides
        self._inputs = inputs if inputs is not None and inputs.records else None
        self._knots = np.zeros(0) if self._inputs is None else self._sign[0] * self._inputs.knots(*spans[0].tolist())

    @classmethod
    def alone(
        cls,
        problem: IntegrationProblem,
        prepare: Prepare | None = None,
        *,
        at_knots: bool = True,
        clock: SamplingClock | None = None,
    ) -> CasesAtStops:
        """Return the case of a problem, which may have stops."""
        spans, y, c = np.array([[problem.t0, problem.t1]]), problem.y0[np.newaxis], problem.constants[np.newaxis]
        stops = _NO_STOPS if problem.stops is None else problem.stops
        return cls(stops, spans, y, c, prepare, problem.inputs, at_knots=at_knots, clock=clock)

    def piece(
        self, problem: IntegrationProblem, t_eval: FloatArray | None, first_step: float | None, max_steps: int
    ) -> IntegrationProblem:
        """Return the next piece of the problem of a case that is alone; for the other arguments see there."""
        return replace(
            problem,
            t0=float(self.t[0]),
            t1=float(self.ends[0]),
            y0=self.y[0].copy(),
            constants=self.c[0].copy(),
            t_eval=t_eval,
            first_step=first_step,
            max_steps=max_steps,
            inputs=None if self._at_knots else problem.inputs,
            stops=None,
        )

    def take(self, some: IntArray) -> None:
        """Take the stops of some cases at their present times, and move states to the sides that they go to."""
        before, first = self.c[some] if self.stops.calls else None, self.number[some]
        self.look_ahead(some)
        taken = self.number[some] - first
        for k in range(max(taken.tolist(), default=0)):
            mine = taken > k
            self._take_one(some[mine], first[mine] + k, None if before is None else before[mine])
        if self._sides is not None:
            self._take_sides(self._sides, some[(taken > 0) | (self.t[some] != self.spans[some, 0])])

    def look_ahead(self, some: IntArray) -> None:
        """Find where the next pieces of some cases end, behind the stops at their present times."""
        lists, due = self.stops.lists, self._due(some)
        while len(due):
            self.number[due] += 1
            due = self._due(due) if self._together else due[:0]
        further = some[self.number[some] < lists.last[some]]
        self.ends[some] = self.spans[some, 1]
        self.ends[further] = lists.times[self.number[further]]
        if self._inputs is not None:
            self._write_inputs(self._inputs)

    def _due(self, some: IntArray) -> IntArray:
        """Return those of some cases that have reached their next stops, as `stops.is_due` does in loops."""
        left = some[self.number[some] < self.stops.lists.last[some]]
        t = self.t[left]
        ahead = self._sign[left] * (self.stops.lists.times[self.number[left]] - t)
        return left[ahead <= SMALLEST_OF_TIME * np.abs(t)]

    def _write_inputs(self, inputs: InputRecords) -> None:
        """Write the inputs behind the present time of a case that is alone."""
        t, end, sign = float(self.t[0]), float(self.ends[0]), float(self._sign[0])
        k = int(np.searchsorted(self._knots, sign * t + SMALLEST_OF_TIME * abs(t), side="right"))
        if k < len(self._knots) and sign * end - self._knots[k] > SMALLEST_OF_TIME * abs(end):
            end = sign * float(self._knots[k])
            self.ends[0] = end if self._at_knots else self.ends[0]
        inputs.write(self.c, np.array([t + 0.5 * (end - t)]))

    def _take_one(self, due: IntArray, number: IntArray, before: FloatArray | None) -> None:
        """Decide and act at one stop of each of some cases, whose constants were those `before` if functions act."""
        acts, middles = self.stops.lists.acts[number], self.stops.lists.middles[number]
        if self._prepare is not None and self.stops.place is not None:
            finite = np.isfinite(middles)
            decided = due[finite]
            rows = self.c[decided]
            rows[:, self.stops.place] = middles[finite]
            self.c[decided] = self._prepare(rows) if len(rows) else rows
        if self._clock is not None and acts[0]:
            self._clock.last = float(self.t[0])
        for a, action in enumerate(self.stops.actions):
            acting, places = acts >> a & 1 == 1, np.array(action.places)
            cases = due[acting]
            if action.kernel is not None and len(cases):
                values = interpret_rows(action.kernel, self.t[cases], self.y[cases], self.c[cases])
                self.y[cases[:, np.newaxis], places] = values
            elif action.function is not None and before is not None:
                for i, earlier in zip(cases, before[acting], strict=True):
                    self.y[i, places] = action.function(float(self.t[i]), self.y[i].copy(), earlier, self.c[i].copy())

    def _take_sides(self, sides: KnotSides, some: IntArray) -> None:
        """Move the states of cases to the sides of knots and switches that their motions go to."""
        near = interpret_rows(sides.near, self.t[some], self.y[some], self.c[some])[:, 0] != 0.0
        some, n = some[near], self.y.shape[1]
        if len(some):
            found = interpret_rows(sides.sides, self.t[some], self.y[some], self.c[some])
            forward = self._sign[some, np.newaxis] > 0.0
            self.y[some] = np.where(forward, found[:, :n], found[:, n : 2 * n])


def in_blocks(
    case: CasesAtStops, problem: IntegrationProblem, step_blocks: Callable[[IntegrationProblem], Iterable[Solution]]
) -> Iterator[Solution]:
    """Yield the solution of a problem in blocks of steps, none of which reaches beyond a stop.

    `step_blocks` gives those of each piece: with the times to record in it and its end, or with its steps where there
    are none of these.
    """
    left, first, low, last = problem.max_steps, problem.first_step, 0, False
    sign, requested = (1.0 if problem.t1 >= problem.t0 else -1.0), problem.t_eval
    while not last:
        case.take(ALONE)
        end, times, status = float(case.ends[0]), requested, Status.SUCCESS
        last = end == problem.t1
        if requested is not None and not (last and case.t[0] == problem.t0):
            high = len(requested) if last else int(np.searchsorted(sign * requested, sign * end))
            times, low = np.append(requested[low:high], end) if low < high else None, high
        for block in step_blocks(case.piece(problem, times, first, left)):
            left -= block.steps + block.rejected
            status = block.status
            if len(block.y):
                case.y[0] = block.y[-1]
            if status is Status.SUCCESS and left <= 0 and not last and block.t[-1] == end:
                status = Status.MAX_STEPS
            recorded = block if times is requested else at_requested(block, times)
            yield recorded if status is block.status else replace(recorded, status=status)
        if status is not Status.SUCCESS:
            return
        case.t[0], first = end, None


def in_pieces(
    case: CasesAtStops, problem: IntegrationProblem, integrate: Callable[[IntegrationProblem], Solution], behind: bool
) -> Solution:
    """Return the solution of a problem, piece by piece.

    Of the states on both sides of a stop, accepted steps hold the first, or those `behind`.
    """
    done = list(in_blocks(case, problem, lambda piece: (integrate(piece),)))
    return done[0] if len(done) == 1 else joined(done, recorded=problem.t_eval is not None, right=behind)


def side_by_side(
    cases: CasesAtStops,
    some: IntArray,
    block: CaseBlock,
    integrate_block: Callable[[CaseBlock, BlockResult], None],
    result: BlockResult,
) -> None:
    """Write the ends of some cases of a block: every round takes those that are left to their next stops.

    Nothing is watched, there are no times to record, and no inputs with knots. Other cases end where they start.
    """
    last = cases.stops.lists.last
    result.y[:], result.ends[:, 0], result.ends[:, 1:] = cases.y, cases.t, (Status.NON_FINITE, 0.0)
    while len(some):
        cases.take(some)
        done = BlockResult.empty(len(some), cases.y.shape[1], 0)
        spans = np.stack([cases.t[some], cases.ends[some]], axis=1)
        integrate_block(replace(block, y=cases.y[some], c=cases.c[some], spans=spans), done)
        cases.t[some], cases.y[some] = done.ends[:, 0], done.y
        status, steps = done.ends[:, 1], result.ends[some, 2] + done.ends[:, 2]
        further = (cases.number[some] < last[some]) & (status == Status.SUCCESS)
        spent = further & (steps >= block.max_steps)
        status[spent], status[further & ~spent] = Status.MAX_STEPS, Status.INTERRUPTED
        result.y[some], result.ends[some] = done.y, np.stack([cases.t[some], status, steps], axis=1)
        some = some[further & ~spent]


def at_requested(solution: Solution, times: FloatArray | None) -> Solution:
    """Return a solution at the first of the times that it recorded, without the last, its end; at none for None."""
    count = 0 if times is None else min(len(solution.t), len(times) - 1)
    wrapped = None if solution.wrapped is None else solution.wrapped[:count]
    end = solution.end
    if end is None and len(solution.t):
        end = float(solution.t[-1])
    return replace(solution, t=solution.t[:count], y=solution.y[:count], wrapped=wrapped, end=end)


def joined(done: Sequence[Solution], *, recorded: bool, right: bool) -> Solution:
    """Return consecutive solutions as one; states that accepted steps share are kept once.

    `recorded` means that they are at requested times. Of the states on both sides of a break, accepted steps hold the
    first, or where `right` the second.
    """
    if right and not recorded:
        done = [*(at_requested(part, part.t) for part in done[:-1]), done[-1]]
    first = [0 if recorded or right or k == 0 else 1 for k in range(len(done))]
    wrapped = None
    if any(part.wrapped is not None for part in done):
        wrapped = np.concatenate(
            [(part.y if part.wrapped is None else part.wrapped)[i:] for i, part in zip(first, done, strict=True)]
        )
    return Solution(
        status=done[-1].status,
        t=np.concatenate([part.t[i:] for i, part in zip(first, done, strict=True)]),
        y=np.concatenate([part.y[i:] for i, part in zip(first, done, strict=True)]),
        steps=sum(part.steps for part in done),
        rejected=sum(part.rejected for part in done),
        evaluations=sum(part.evaluations for part in done),
        dense=_dense([part.dense for part in done]),
        wrapped=wrapped,
        end=done[-1].end,
        last=done[-1].last,
    )


def _dense(parts: Sequence[DenseOutput | None]) -> DenseOutput | None:
    """Return consecutive continuous outputs as one; None where there is none."""
    found = [part for part in parts if part is not None and len(part.knots) > 1]
    if not found:
        return parts[0]
    polynomials = [part for part in found if isinstance(part, PiecewisePolynomial)]
    if len(polynomials) == len(found) and len({part.coefficients.shape[1] for part in polynomials}) == 1:
        knots = np.concatenate([found[0].knots[:1], *(part.knots[1:] for part in found)])
        return PiecewisePolynomial(knots, np.concatenate([part.coefficients for part in polynomials]))
    edges = np.array([float(found[0].knots[0]), *(float(part.knots[-1]) for part in found)])
    return JoinedOutput(edges, found)
