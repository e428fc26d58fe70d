"""One integration of a compiled model: its method, its events, where it has to end, and its trajectory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..integrators.problem import IntegrationProblem, SamplingClock, Solution, prescribed
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..progress import enter_stage
from ..results.motion import RunStatistics
from ..results.trajectory import Trajectory
from .constraint_rank import indeterminate
from .gimbal import locked, remedy
from .jump_sliding import slid_along
from .left_out_constraints import ended_where_left_out_matter
from .pathway_lengths import lost_directions
from .recording import Record
from .singular import checked_run, searched
from .symbol_assumptions import warn_of_motion
from .table_range import ended_outside

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
    if model.stages.reduced.unproven:  # between steps too it is found out whether these constraints follow
        problem = replace(problem, dense=True)
    if model.layout.state:
        enter_stage("machine code")
        model.engine.prepare(problem, method)
    compiled = time.perf_counter() - ready
    solution, occurrences, method, note = _integrated(model, problem, method, watch, automatic, carried)
    solution, beyond = ended_outside(model.derived.tables, problem, solution, model.engine.constants_along(problem))
    solution, where = _ended_where_singular(model, problem, method, solution)
    along = model.engine.constants_along(problem)
    notes = [note, beyond, where, lost_directions(model, solution, along), slid_along(model, solution, along)]
    reduced = model.stages.reduced
    if reduced.unproven:
        solution, broken = ended_where_left_out_matter(model.stages.program, reduced, problem, solution, along)
        notes = [model.note, *notes, broken]
        solution = solution if wanted else replace(solution, dense=None)
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
    program, c = model.stages.program, model.engine.constants_along(problem)
    run = Trajectory(program, c, solution.status, solution.t, solution.y, statistics, solution.dense)
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


def _ended_where_singular(
    model: CompiledModel, problem: IntegrationProblem, method: str, solution: Solution
) -> tuple[Solution, str]:
    """Return a run ended where its angles lock or its constraints lose rank, and a note on where that is."""
    program, enforced, gimbals = model.stages.program, model.derived.enforced, model.derived.gimbals
    if gimbals is None and not enforced:
        return solution, ""
    c, steps = model.engine.constants_along(problem), _steps(model, problem, method, solution)
    span = problem.t0, problem.t1
    if gimbals is not None:
        solution, where = locked(program, gimbals, solution, c, steps, span)
        if where:
            return solution, f"{where}; {remedy(model.stages.scene)}"
    if not enforced:
        return solution, ""
    where = ""
    if solution.status is not Status.SINGULAR_CONFIGURATION:
        solution, where = checked_run(program, solution, c, enforced, steps, span)
    loose = indeterminate(program, problem.t0, problem.y0, problem.constants)
    return solution, "; ".join(text for text in (where, loose) if text)


def _steps(model: CompiledModel, problem: IntegrationProblem, method: str, solution: Solution) -> Solution:
    """Return a run with its accepted steps for records, as far as that says more of it.

    Of a run that failed they are integrated once more, from what it recorded last.
    """
    if problem.t_eval is None or not model.layout.state:
        return solution
    if solution.dense is not None:
        return replace(solution, t=solution.dense.knots, y=solution.dense(solution.dense.knots))
    if solution.success:
        return solution
    t, y = (solution.t[-1], solution.y[-1]) if len(solution.t) else (problem.t0, problem.y0)
    rest = replace(problem, t0=float(t), y0=y, t_eval=None, first_step=None, sampled=SamplingClock(problem.t0, t))
    again = model.engine.integrate(rest, method)
    t, y = np.concatenate([solution.t, again.t]), np.concatenate([solution.y, again.y])
    return replace(solution, t=t, y=y)
