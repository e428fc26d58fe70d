"""One integration of a compiled model: its method, its events, where it has to end, and its trajectory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ..arrays import FloatArray
from ..integrators.problem import IntegrationProblem, Solution, prescribed
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..progress import enter_stage
from ..results.motion import RunStatistics
from ..results.trajectory import Trajectory
from .jump_sliding import slid_along
from .pathway_lengths import lost_directions
from .recording import Record
from .run_checks import checked
from .singular import checked_run, searched
from .symbol_assumptions import warn_of_motion

if TYPE_CHECKING:
    from ..integrators.event_code import EventCode
    from ..integrators.watched import Occurrence
    from .model import CompiledModel

__all__ = ["ended_early", "integrate"]


def integrate(
    model: CompiledModel,
    problem: IntegrationProblem,
    method: str,
    begin: float,
    watch: EventCode | None = None,
    *,
    automatic: bool = False,
    carried: FloatArray | None = None,
) -> Trajectory:
    """Return the trajectory of one problem; its run time counts from `begin`, less what was compiled.

    Where the method was chosen automatically, a stiff run without events changes to an implicit one. `carried` are
    signs of events (see `integrate_watched`).
    """
    ready, wanted = time.perf_counter(), problem.dense
    for check in model.checks:
        problem = check.before(problem)
    if model.layout.state:
        enter_stage("machine code")
        model.engine.prepare(problem, method)
    compiled = time.perf_counter() - ready
    solution, occurrences, method, note = _integrated(model, problem, method, watch, automatic, carried)
    solution, notes = checked(model, problem, method, solution)
    along = model.engine.constants_along(problem)
    notes = [note, *notes, lost_directions(model, solution, along), slid_along(model, solution, along)]
    if problem.dense and not wanted:
        solution = replace(solution, dense=None)
    statistics = RunStatistics(
        method=method,
        steps=solution.steps,
        rejected=solution.rejected,
        evaluations=solution.evaluations,
        compile_seconds=model.stages.compile_seconds + compiled,
        run_seconds=time.perf_counter() - begin - compiled,
        note="; ".join(text for text in notes if text),
        rtol=problem.rtol,
        atol=problem.atol,
    )
    program = model.stages.program
    run = Trajectory(program, along, solution.status, solution.t, solution.y, statistics, solution.dense)
    run.ended_at(solution.end)
    if model.derived.signed:
        warn_of_motion(model.layout.assumptions, model.derived.signed, run.t, run.__getitem__)
    run.with_monitors(model.monitors).with_wrapped(solution.wrapped).of_scene(model.stages.scene)
    return run if watch is None else run.with_events(watch.labels, occurrences)


def ended_early(model: CompiledModel, problem: IntegrationProblem) -> tuple[IntegrationProblem, Status | None]:
    """Return a problem up to where a run ends because constraints that were left out matter, and the status of that.

    Where it does not, return the problem and None.
    """
    if not model.stages.reduced.unproven:
        return problem, None
    method = model.choose_method("auto", problem.rtol, problem.atol)
    run = integrate(model, problem, method, time.perf_counter(), automatic=True)
    if run.status is not Status.SINGULAR_CONFIGURATION:
        return problem, None
    times, forward = problem.t_eval, 1.0 if problem.t1 >= problem.t0 else -1.0
    times = None if times is None else times[forward * times < forward * run.t_end]
    return replace(problem, t1=run.t_end, t_eval=times), run.status


def _integrated(
    model: CompiledModel,
    problem: IntegrationProblem,
    method: str,
    watch: EventCode | None,
    automatic: bool,
    carried: FloatArray | None,
) -> tuple[Solution, list[Occurrence], str, str]:
    """Return the solution of a problem, its events, the method taken, and why it is another one than was chosen."""
    note, engine = "", model.engine
    if watch is not None:
        if automatic and model.layout.state:
            method, note = engine.fit(problem, method)
        return *_watched(model, problem, method, watch, carried), method, note
    if not model.layout.state:
        return prescribed(problem), [], method, note
    if model.derived.enforced and searched(model.stages.program) and not problem.dense:
        if automatic:
            method, note = engine.fit(problem, method)
        solution, crossed = _searched(model, problem, method)
        return solution, [], method, "; ".join(text for text in (note, crossed) if text)
    if automatic:
        solution, method, note = engine.integrate_automatic(problem, method)
        return solution, [], method, note
    return engine.integrate(problem, method), [], method, note


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


def _watched(
    model: CompiledModel, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
) -> tuple[Solution, list[Occurrence]]:
    """Integrate one problem with events."""
    from ..integrators.chaining import blocks_between_knots
    from ..integrators.events import integrate_watched

    engine = model.engine

    def step_blocks(part: IntegrationProblem) -> Iterator[Solution]:
        if not (model.layout.state or engine.cuts):
            return iter([prescribed(part)])
        blocks = partial(engine.step_blocks, method=method)
        return blocks_between_knots(blocks, part) if watch.reads_inputs else blocks(part)

    problem = engine.after_start(problem)
    # guards of modes are evaluated in every phase, so that compiling them pays
    rows = engine.rows if watch.smooth else interpret_rows
    return integrate_watched(step_blocks, problem, watch.watched(engine.constants_along(problem), rows), carried)
