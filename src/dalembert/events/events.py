"""Integration with events by blocks of steps with continuous output, which any integrator gives.

A motion is cut where its state jumps: the rest of the block is dropped and a new one begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..lanes.cases import BlockResult
from ..lanes.step_records import ATTEMPTS_AT, END_AT, ENDED_AT, FIRST_AT, START_AT
from ..lanes.workspace import OCCURRENCE, EventKernels, event_workspace
from ..methods.status import RUNNING, Status
from ..steps.dense_output import DenseOutput, PiecewisePolynomial
from ..steps.problem import IntegrationProblem, Solution
from ..steps.projection import end_in, projected
from ..stops.segments import Constants, Segments
from .event_code import EventCode
from .event_resolution import BEGIN, END, RESOLVE, RESTART, SEARCH, SearchArguments, SearchProgress
from .event_search import BROKEN, NOTHING
from .recorded_motion import RecordedCase

StepBlocks = Callable[[IntegrationProblem], Iterator[Solution]]

_DEGREE, _ROOM = 12, 256
"""Degree of the polynomials that continuous output is at most; occurrences that there is room for at first."""


def run_with_events(
    step_blocks: StepBlocks,
    problem: IntegrationProblem,
    watch: EventCode,
    events: EventKernels,
    constants: Constants,
    loop: Callable[[SearchArguments], int],
    carried: FloatArray | None,
) -> RecordedCase:
    """Integrate a problem with events.

    Parameters
    ----------
    step_blocks
        Gives the solution of a problem in blocks of steps, each with its continuous output; the status of the last is
        that of the whole.
    problem : IntegrationProblem
    watch, events : EventCode, EventKernels
    constants : ndarray (n_c,) or Segments
        Those of the run; blocks end where they change.
    loop
        That of `dalembert.events.event_resolution`.
    carried : ndarray (2 n_events,) or None
        See `dalembert.codegen.engine.Engine.integrate_watched`.
    """
    room = _ROOM
    while True:
        run = _SearchedRun(step_blocks, problem, watch, events, constants, loop, carried, room)
        found = run.case()
        if found is not None:
            return found
        room *= 8  # more occurred in a step than there was room for


@final
class _SearchedRun:
    """One integration in progress."""

    def __init__(
        self,
        step_blocks: StepBlocks,
        problem: IntegrationProblem,
        watch: EventCode,
        events: EventKernels,
        constants: Constants,
        loop: Callable[[SearchArguments], int],
        carried: FloatArray | None,
        room: int,
    ) -> None:
        self.step_blocks, self.problem, self.watch, self.events = step_blocks, problem, watch, events
        self.constants, self.loop, self.carried, self.room = constants, loop, carried, room
        self.t, self.y, self.n = float(problem.t0), np.array(problem.y0, dtype=float), len(problem.y0)
        self.happened = BlockResult.at_start(1, len(watch.events), ())[0]
        self.rows: list[FloatArray] = []
        self.occurrences: list[FloatArray] = []
        self.recorded = self.steps = self.rejected = self.evaluations = 0
        self.overflows = False
        self.progress = SearchProgress()
        self.progress.direction = 1.0 if problem.t1 >= problem.t0 else -1.0
        self.progress.span = abs(problem.t1 - problem.t0)
        self.work: SearchArguments | None = None

    def case(self) -> RecordedCase | None:
        """Run to the end and return what was recorded; None where there was no room for it."""
        status, task = RUNNING, BEGIN
        while status == RUNNING and not self.overflows:
            status, task = self._until_jump(task), RESTART
        if self.overflows:
            return None
        self._carry(status)
        occurrences = np.concatenate(self.occurrences) if self.occurrences else np.empty((0, OCCURRENCE))
        width = FIRST_AT + 3 * self.n if not self.rows else self.rows[0].shape[1]
        return RecordedCase(
            np.concatenate(self.rows) if self.rows else np.empty((0, width)),
            occurrences,
            self.y,
            Status(status),
            (self.steps, self.rejected, self.evaluations),
            in_time=False,
            jumping=[jump is not None for jump in self.watch.jumps],
        )

    def _until_jump(self, task: int) -> int:
        """Integrate to the end or to the next jump; return the status, `RUNNING` for the latter."""
        problem, left = self.problem, self.problem.max_steps - self.steps - self.rejected
        if left <= 0:
            return Status.MAX_STEPS
        rest = replace(problem, t0=self.t, y0=self.y, t_eval=None, dense=True, bounded=True, max_steps=left)
        status, begun = int(Status.SUCCESS), False
        for block in self.step_blocks(rest):
            status = int(block.status)
            self.steps += block.steps
            self.rejected += block.rejected
            self.evaluations += block.evaluations
            if not (len(block.t) > 1 and block.t[-1] != block.t[0]):  # of a motion that takes no steps
                continue
            rows = self._rows_of(block)
            self._load_constants(float(block.t[0]), float(block.t[-1]), rows)
            if not begun:
                self._at(task, self.t, self.y)
                begun = True
                self.progress.fresh = 1
            outcome = self._scan(rows)
            if outcome is not None:
                return outcome
        if status == Status.SUCCESS and begun:
            return self._end()
        return status

    # -- blocks of steps -------------------------------------------------------------------

    def _rows_of(self, block: Solution) -> FloatArray:
        """Return a block as records of steps."""
        assert block.dense is not None
        coefficients, n = _polynomials(block.dense), self.n
        knots = block.dense.knots
        ends = np.concatenate([block.y[1:], block.y[1:]], axis=1)
        moved = np.flatnonzero(np.diff(knots) != 0.0)
        found = coefficients[moved].copy()
        if n:
            end_in(block.y[1:][moved], found)
        rows = np.empty((len(moved), FIRST_AT + 2 * n + n * coefficients.shape[1]))
        rows[:, START_AT], rows[:, END_AT], rows[:, ENDED_AT] = knots[moved], knots[moved + 1], knots[moved + 1]
        rows[:, ATTEMPTS_AT] = 0.0
        rows[:, FIRST_AT : FIRST_AT + 2 * n] = ends[moved]
        rows[:, FIRST_AT + 2 * n :] = found.transpose(0, 2, 1).reshape(len(moved), -1)
        return rows

    def _load_constants(self, t0: float, t1: float, rows: FloatArray) -> None:
        """Make the arguments of the loop at first, and write the constants between two times into them."""
        c = self.constants
        own = c.at(np.array([t0 + 0.5 * (t1 - t0)]))[0] if isinstance(c, Segments) else c
        if self.work is None:
            terms = (rows.shape[1] - FIRST_AT - 2 * self.n) // self.n if self.n else 1
            space = event_workspace(self.events, self.n, terms - 1, len(own), 2, 1)
            space = space._replace(occurrences=np.zeros((1 + self.room, OCCURRENCE)))
            if self.carried is not None:
                space = space._replace(carried=self.carried[np.newaxis].copy())
            nothing = np.zeros(1), np.zeros((0, self.n * terms))
            self.work = SearchArguments(self.events, space, *nothing, self.happened, self.progress)
        space = self.work.workspace
        if len(own):
            changed = self.recorded > 0 and bool(np.any(space.own[0] != own))
            space.own[0], space.constants[:] = own, own[:, np.newaxis]
            if changed:
                space.jumped[0, 2] = 1.0

    def _call(self, task: int) -> int:
        assert self.work is not None
        self.progress.task = task
        return self.loop(self.work)

    def _at(self, task: int, t: float, y: FloatArray) -> int:
        """Carry out a task at a time and a state."""
        assert self.work is not None
        self.work.workspace.one_point[0, : self.n] = y
        self.progress.t = t
        return self._call(task)

    def _scan(self, rows: FloatArray) -> int | None:
        """Search a block of steps; return the status where something stops it, `RUNNING` to continue from there."""
        work, progress = self.work, self.progress
        assert work is not None
        n, knots = self.n, np.append(rows[:, START_AT], rows[-1, END_AT])
        self.work = work._replace(knots=knots, polynomials=np.ascontiguousarray(rows[:, FIRST_AT + 2 * n :]))
        progress.step, progress.before = 0, self.recorded
        outcome = self._call(SEARCH)
        if outcome == NOTHING:
            self._keep(rows)
            self.t, self.y = float(rows[-1, END_AT]), rows[-1, FIRST_AT + n : FIRST_AT + 2 * n].copy()
            return None
        rows, theta = rows[: progress.step + 1], progress.theta
        last = rows[-1]
        if theta < 1.0:
            t = float(last[START_AT] + theta * (last[END_AT] - last[START_AT]))
            y = np.zeros(n)
            if n:
                y = np.polynomial.polynomial.polyval(theta, last[FIRST_AT + 2 * n :].reshape(n, -1).T)
            y = projected(self.watch.program, self.constants, np.array([t]), np.reshape(y, (1, n)))[0]
            last[ENDED_AT], last[FIRST_AT + n : FIRST_AT + 2 * n] = t, y
        else:
            t, y = float(last[END_AT]), last[FIRST_AT + n : FIRST_AT + 2 * n]
        self.t, self.y = t, np.array(y)
        if outcome == BROKEN:
            self._keep(rows)
            return Status.EVENT_NON_FINITE
        status = self._resolved()
        self._keep(rows)
        return status

    def _resolved(self) -> int:
        """Resolve what stops the motion at the present time and state; return the status."""
        assert self.work is not None
        status = self._at(RESOLVE, self.t, self.y)
        if status != Status.EVENT_STATE:
            self.y = self.work.workspace.one_point[0, : self.n].copy()
        return int(Status.SUCCESS) if status == RUNNING and self.t == self.problem.t1 else status

    def _keep(self, rows: FloatArray) -> None:
        """Record steps, and what occurred in them."""
        assert self.work is not None
        occurrences = self.work.workspace.occurrences
        count = int(occurrences[0, 0])
        if count:
            self.overflows = count >= len(occurrences)
            self.occurrences.append(occurrences[1 : 1 + count].copy())
            occurrences[0, 0] = 0.0
        self.rows.append(rows)
        self.recorded += len(rows)

    def _end(self) -> int:
        """Look for expressions that are zero at the very end, where they need not change their signs."""
        assert self.work is not None
        space, status = self.work.workspace, int(Status.SUCCESS)
        space.occurrences[0, 1] = float(self.recorded - 1)
        if self._at(END, self.t, self.y):
            self.progress.theta = 1.0
            status = self._resolved()
        self._keep(np.empty((0, self.rows[0].shape[1])))
        return status

    def _carry(self, status: int) -> None:
        """Write with what the motion may continue after its end (`EventWorkspace.carried`)."""
        if self.carried is None or self.work is None:
            return
        space, n = self.work.workspace, len(self.watch.events)
        signs, noticed = self.carried[: 2 * n : 2], self.carried[1 : 2 * n : 2]
        if status == Status.SUCCESS:
            signs[:] = np.where(space.zero[0, :n] != 0.0, 0.0, space.signs[0, :n])
        noticed[space.seen[0, :n] != 0.0] = 1.0


def _polynomials(dense: DenseOutput) -> FloatArray:
    """Return the coefficients (k, degree + 1, n) of continuous output, which is a polynomial in each step."""
    if isinstance(dense, PiecewisePolynomial):
        return dense.coefficients
    steps = len(dense.knots) - 1
    points = 0.5 - 0.5 * np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)
    values = dense.within(np.repeat(np.arange(steps), len(points)), np.tile(points, steps))
    n = values.shape[1]
    values = values.reshape(steps, len(points), n).transpose(1, 0, 2).reshape(len(points), -1)
    found = np.asarray(np.linalg.solve(np.vander(points, increasing=True), values), dtype=np.float64)
    return found.reshape(len(points), steps, n).transpose(1, 0, 2)
