"""Single runs that are more than one call of an engine.

These are runs with events, without a state, searched for lost ranks, and of the formulation `baumgarte` where its gains
are not given: they follow from the steps of a run without them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..codegen.engine import Engine
from ..ir.program import Layout, Program, along_run
from ..methods.status import Status
from ..reduction.stabilised import GAINS
from ..starts import inputs
from ..steps.problem import IntegrationProblem, Solution, prescribed
from ..steps.projection import projected
from ..stops.segments import Constants
from .singular import checked_run, searched

if TYPE_CHECKING:
    from ..events.event_code import EventCode
    from ..events.recorded_motion import Occurrence
    from ..model.model import CompiledModel
    from .case_settings import CaseSettings
    from .cases import Cases


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


_PILOT_STEPS = 24
_SHARE = 0.5
"""Product of gain and step: violations decay by two thirds over two steps, far within the stability of any method."""

Run = Callable[[IntegrationProblem], Solution]


def _left_out(layout: Layout, given: Mapping[Any, Any]) -> list[str]:
    if not layout.defaults:
        return []
    known = {layout.aliases.get(str(key), str(key)) for key in given}
    return [name for name in GAINS if name in layout.defaults and name not in known] if layout.state else []


def _gain_for(problem: IntegrationProblem, start: FloatArray, run: Run) -> float:
    """Return the gain [1/s] for both positions and velocities, or 0 where there is no step to go by.

    A short run with the constants `start` (n_c,), those without any gain, gives the step.
    """
    pilot = run(replace(problem, constants=start, t_eval=None, dense=False, max_steps=_PILOT_STEPS))
    sizes = np.abs(np.diff(pilot.t))
    return _SHARE / float(np.max(sizes)) if len(sizes) else 0.0


def with_gains(program: Program, run: Run, problem: IntegrationProblem, given: Mapping[Any, Any]) -> IntegrationProblem:
    """Return the problem with the gains that `given` parameters leave out, where the formulation has any."""
    layout = program.layout
    out = _left_out(layout, given)
    if not out:
        return problem

    def constants(gain: float) -> FloatArray:
        p = inputs.parameter_vector(layout, {**given, **dict.fromkeys(out, gain)})
        return inputs.constants(program, along_run(layout.parameters, p, backward=problem.t1 < problem.t0))

    return replace(problem, constants=constants(_gain_for(problem, constants(0.0), run)))


def give_gains(engine: Engine, cases: Cases, settings: CaseSettings, given: Mapping[Any, Any]) -> None:
    """Give all cases the gains that the first one would get alone, where the formulation has any left out."""
    out = _left_out(cases.program.layout, given)
    if not out:
        return
    from .cases import single_problem

    problem = single_problem(cases, settings, 0)
    if problem is None:
        return
    for name in out:
        cases.set_parameter(name, np.zeros(1))
    start = cases.constants(slice(0, 1))[0]
    gain = _gain_for(problem, start, lambda pilot: engine.integrate(pilot, settings.method))
    for name in out:
        cases.set_parameter(name, np.array([gain]))
