"""Single runs that are more than one call of an engine: with events, without a state, and searched for lost ranks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..arrays import FloatArray
from ..integrators.problem import IntegrationProblem, Solution, prescribed
from ..methods.status import Status
from .recording import Record
from .singular import checked_run, searched

if TYPE_CHECKING:
    from ..integrators.event_code import EventCode
    from ..integrators.recorded_motion import Occurrence
    from .model import CompiledModel

__all__ = ["special_run"]


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


def _searched(model: CompiledModel, problem: IntegrationProblem, method: str) -> tuple[Solution, str]:
    """Integrate one problem without continuous output, ended where it crosses a lost rank, and a note on that."""
    program, enforced = model.stages.program, model.derived.enforced
    record, where, span = Record(program, problem, model.engine.constants_along(problem)), "", (problem.t0, problem.t1)
    for part in model.engine.step_blocks(replace(problem, t_eval=None, dense=True), method):
        found, where = checked_run(program, part, model.engine.constants_along(problem), enforced, part, span)
        record.add(found)
        if found.status is Status.SINGULAR_CONFIGURATION:
            break
    return record.solution(), where
