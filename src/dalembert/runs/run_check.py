"""The base of all checks of runs, and a run as checks look at it.

A check finds out whether a run should have ended before its loop ended it. It is an object of one model, which is
asked before a run, and after it: for one run, and for the cases of a sweep (`dalembert.runs.run_checks`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import SUSPECT, Status
from ..once import once_property
from ..steps.problem import IntegrationProblem, SamplingClock, Solution
from ..stops.segments import Constants

if TYPE_CHECKING:
    from ..model.model import CompiledModel


FAILED = (Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED, Status.MAX_STEPS)
"""Statuses of runs whose steps failed, for which a check may know the reason."""


@final
class EndedRun:
    """A run that its loop has ended.

    Attributes
    ----------
    problem : IntegrationProblem
    solution : Solution
        What was recorded; a check that ends the run takes its end away.
    constants : ndarray (n_c,) or Segments
    """

    def __init__(self, model: CompiledModel, problem: IntegrationProblem, method: str, solution: Solution) -> None:
        self._model, self._method = model, method
        self.problem, self.solution = problem, solution
        self.constants: Constants = model.engine.constants_along(problem)

    @property
    def span(self) -> tuple[float, float]:
        """Start and end [s] as they were asked for."""
        return self.problem.t0, self.problem.t1

    @property
    def stop(self) -> tuple[float, FloatArray]:
        """Time [s] and state (n_y,) at which the loop has stopped, recorded or not."""
        problem, solution = self.problem, self.solution
        if solution.end is not None and solution.last is not None:
            return solution.end, solution.last
        return (float(solution.t[-1]), solution.y[-1]) if len(solution.t) else (problem.t0, problem.y0)

    @property
    def steps(self) -> Solution:
        """The run with its accepted steps for records, as far as that says more of it.

        Of a run that failed they are integrated once more, from what it recorded last.
        """
        if self.problem.t_eval is None or not self._model.layout.state:
            return self.solution
        return self._further_steps

    @once_property
    def _further_steps(self) -> Solution:
        problem, solution = self.problem, self.solution
        if solution.dense is not None:
            return replace(solution, t=solution.dense.knots, y=solution.dense(solution.dense.knots))
        if solution.success:
            return solution
        t, y = (solution.t[-1], solution.y[-1]) if len(solution.t) else (problem.t0, problem.y0)
        rest = replace(problem, t0=float(t), y0=y, t_eval=None, first_step=None, sampled=SamplingClock(problem.t0, t))
        again = self._model.engine.integrate(rest, self._method)
        t, y = np.concatenate([solution.t, again.t]), np.concatenate([solution.y, again.y])
        return replace(solution, t=t, y=y)


class RunCheck(ABC):
    """A check of the runs of one model."""

    def before(self, problem: IntegrationProblem) -> IntegrationProblem:
        """Return a problem with what the check reads of its run."""
        return problem

    @abstractmethod
    def after(self, run: EndedRun) -> tuple[Solution, str]:
        """Return the solution of a run, ended where it should have been, and a note on where that is and why."""

    def guards(self, method: str) -> str:
        """Return what the cases of a sweep by a method are watched for: "ranks", "locks", "ends" or nothing."""
        return ""

    @abstractmethod
    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """End the cases of a block, run by a method, that should have ended."""


def ended_alone(
    model: CompiledModel,
    method: str,
    block: CaseBlock,
    done: BlockResult,
    i: int,
    problem: IntegrationProblem,
    ended: Callable[[IntegrationProblem, Solution, Constants], float | None],
    status: Status = Status.SINGULAR_CONFIGURATION,
) -> bool:
    """Run case i alone, and end it with a status if it should have ended; return whether it should have.

    `ended` returns the last time before it should have in a run, or a part of one; None where it should not.
    """
    c, before = model.engine.constants_along(problem), 0
    for solution in _alone(model, method, block, problem):
        last = ended(problem, solution, c)
        if last is not None:
            forward = 1.0 if problem.t1 >= problem.t0 else -1.0
            steps = max(1, int(np.sum((solution.t - last) * forward <= 0.0)))
            done.y[i], done.ends[i] = solution.y[steps - 1], (solution.t[steps - 1], float(status), before + steps - 1)
            done.samples[i, (block.t_eval - last) * forward > 0.0] = np.nan
            done.totals[i] = np.nan
            done.happened[i] = np.nan
            done.happened[i, ::3] = 0.0
            return True
        before += len(solution.t) - 1
    return False


def end_suspects(
    check: RunCheck, model: CompiledModel, method: str, block: CaseBlock, done: BlockResult, status: Status
) -> None:
    """Run marked cases alone once more, and end with a status those that a check ends so."""

    def last(problem: IntegrationProblem, solution: Solution, c: Constants) -> float | None:
        ended, _ = check.after(EndedRun(model, problem, method, solution))
        if ended.status is not status:
            return None
        return float(ended.t[-1] if len(ended.t) else solution.t[0])

    for i in np.flatnonzero(done.ends[:, 1] <= SUSPECT).tolist():
        ended_alone(model, method, block, done, i, block.problem(i, dense=True), last, status)


def _alone(model: CompiledModel, method: str, block: CaseBlock, problem: IntegrationProblem) -> Iterator[Solution]:
    """Yield a case of a block with its continuous output, and with its events where it has any.

    Without constraints that need not follow everywhere it comes in parts: beyond the place where these matter, steps
    may become very small.
    """
    engine, watch = model.engine, block.watch
    if watch is not None and watch.reported:
        return iter([engine.integrate_watched(problem, method, watch)[0]])
    if model.stages.reduced.unproven or model.stages.reduced.redundancy is not None:
        return engine.step_blocks(problem, method)
    return iter([engine.integrate(problem, method)])
