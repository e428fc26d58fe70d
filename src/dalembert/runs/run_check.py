"""The base of all checks of runs, and a run as checks look at it.

A check finds out whether a run should have ended before its loop ended it. It is an object of one model, which is
asked before a run, and after it: for one run, and for the cases of a sweep (`dalembert.runs.run_checks`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import Status
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

    def guards(self, method: str) -> bool:
        """Whether the cases of a sweep by a method are watched for what the check looks for, by events of its own."""
        return False

    @abstractmethod
    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """End the cases of a block, run by a method, that should have ended."""
