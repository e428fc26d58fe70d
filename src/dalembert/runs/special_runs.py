"""Single runs that are more than one call of an engine: with events, without a state, and searched for lost ranks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..ir.program import Program
from ..methods.status import Status
from ..steps.problem import IntegrationProblem, Solution, prescribed
from ..steps.projection import projected
from ..stops.segments import Constants
from .singular import checked_run, searched

if TYPE_CHECKING:
    from ..events.event_code import EventCode
    from ..events.recorded_motion import Occurrence
    from ..model.model import CompiledModel


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


def special_run(
    model: CompiledModel,
    problem: IntegrationProblem,
    method: str,
    watch: EventCode | None,
    automatic: bool,
    carried: FloatArray | None,
) -> tuple[Solution, list[Occurrence], str, str] | None:
    """Return the solution of a problem that is more than a run of the engine; None where it is not.

    Return its events, the method taken, and why it is another one than was chosen, too.
    """
    note = ""
    if watch is not None:
        if automatic and model.layout.state:
            short = _short_run(model, problem, method, watch, carried)
            if short is not None:
                return *short, method, note
            method, note = model.engine.fit(problem, method)
        return *model.engine.integrate_watched(problem, method, watch, carried), method, note
    if not model.layout.state:
        return prescribed(problem), [], method, note
    if model.derived.enforced and searched(model.stages.program) and not problem.dense:
        if automatic:
            method, note = model.engine.fit(problem, method)
        solution, crossed = _searched(model, problem, method)
        return solution, [], method, "; ".join(text for text in (note, crossed) if text)
    return None


def _short_run(
    model: CompiledModel, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
) -> tuple[Solution, list[Occurrence]] | None:
    """Return a run with events that a few steps complete, None for others.

    Such a run needs no other method, and the tests for one take longer than it where the right-hand side is long.
    """
    if not model.engine.tries_first:
        return None
    from ..steps.method_choice import EXPLICIT_STEPS

    signs = None if carried is None else carried.copy()
    tried = replace(problem, max_steps=min(problem.max_steps, EXPLICIT_STEPS))
    solution, occurrences = model.engine.integrate_watched(tried, method, watch, signs)
    if solution.status is Status.MAX_STEPS:
        return None
    if carried is not None:
        carried[:] = signs
    return solution, occurrences


def _searched(model: CompiledModel, problem: IntegrationProblem, method: str) -> tuple[Solution, str]:
    """Integrate one problem without continuous output, ended where it crosses a lost rank, and a note on that."""
    program, enforced = model.stages.program, model.derived.enforced
    record = StepRecording(program, problem, model.engine.constants_along(problem))
    where, span = "", (problem.t0, problem.t1)
    for part in model.engine.step_blocks(replace(problem, t_eval=None, dense=True), method):
        found, where = checked_run(program, part, model.engine.constants_along(problem), enforced, part, span)
        record.add(found)
        if found.status is Status.SINGULAR_CONFIGURATION:
            break
    return record.solution(), where
