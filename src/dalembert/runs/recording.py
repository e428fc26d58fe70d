"""Recording of runs that come in blocks of steps: their accepted steps, or the requested times."""

from __future__ import annotations

from typing import final

import numpy as np

from ..arrays import FloatArray
from ..ir.program import Program
from ..methods.status import Status
from ..steps.problem import IntegrationProblem, Solution
from ..steps.projection import projected
from ..stops.segments import Constants


@final
class StepRecording:
    """Gathers blocks of steps with continuous output to one solution without."""

    def __init__(self, program: Program, problem: IntegrationProblem, c: Constants) -> None:
        self._program, self._problem, self._constants = program, problem, c
        self._times: list[FloatArray] = []
        self._states: list[FloatArray] = []
        self._steps = self._rejected = self._evaluations = 0
        self._status = Status.SUCCESS
        self._wanted = 0
        self._end = float(problem.t0)

    def add(self, part: Solution) -> None:
        """Record a block of steps."""
        self._steps += part.steps
        self._rejected += part.rejected
        self._evaluations += part.evaluations
        self._status = part.status
        self._end = self._end if part.end is None else part.end
        t_eval = self._problem.t_eval
        if t_eval is None:
            first = 1 if self._times else 0
            self._times.append(part.t[first:])
            self._states.append(part.y[first:])
        elif part.dense is not None and len(part.t):
            forward = 1.0 if self._problem.t1 >= self._problem.t0 else -1.0
            rest = t_eval[self._wanted :]
            inside = rest[(rest - self._end) * forward <= 0.0]
            states = projected(self._program, self._constants, inside, part.dense(inside))
            for k in (0, -1):
                states[inside == part.t[k]] = part.y[k]
            self._times.append(inside)
            self._states.append(states)
            self._wanted += len(inside)

    def solution(self) -> Solution:
        """Return the recorded solution; the status is that of the last block."""
        return Solution(
            status=self._status,
            t=np.concatenate(self._times) if self._times else np.empty(0),
            y=np.concatenate(self._states) if self._states else np.empty((0, len(self._problem.y0))),
            steps=self._steps,
            rejected=self._rejected,
            evaluations=self._evaluations,
            dense=None,
            end=self._end,
        )
