"""Simulation of one trajectory of a compiled model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..arrays import FloatArray
from ..errors import OptionError
from ..ir.program import Program, along_run
from ..methods.status import Status
from ..options import SimulateOptions, tighter
from ..progress import enter_stage
from ..results.events import event_records
from ..results.parts import Part
from ..results.statistics import RunStatistics
from ..results.trajectory import Trajectory
from ..starts import inputs
from ..starts.constraint_choice import divisible_model, independent_model
from ..starts.initial_states import directed, initial_state
from ..starts.segment_constants import starting_constants
from ..starts.symbol_assumptions import warn_of_motion
from ..steps.problem import IntegrationProblem
from .run_checks import checked
from .run_notes import lost_directions, lost_reactions, slid_along
from .special_runs import special_run, with_gains

if TYPE_CHECKING:
    from ..events.event_code import EventCode
    from ..events.recorded_motion import Occurrence
    from ..model.model import CompiledModel


NO_ESTIMATE = "error_estimate compares motions time by time, which events may end or cut: leave out one of the two"

Given = Mapping[Any, Any]


def simulate_in_own_time(
    model: CompiledModel,
    t_span: tuple[float, float],
    initial: Given,
    parameters: Given,
    options: SimulateOptions,
    carried: FloatArray | None = None,
) -> Trajectory:
    """Return one trajectory in the time of the model, whatever the span.

    `carried` (2 n_events,) is what events carry, for a run that is a part of another (see `Engine.integrate_watched`).
    """
    if options.project_invariants is not False:
        from ..starts.first_integrals import keeping_from, refuse_jumps

        refuse_jumps(options.events, model.layout.aliases)
        model, kept = keeping_from(model, options.project_invariants, t_span, initial, parameters)
        options, parameters = replace(options, project_invariants=False), {**parameters, **kept}
    begin = time.perf_counter()
    chosen = _model_and_problem(model, t_span, initial, parameters, options, begin)
    if not isinstance(chosen, tuple):
        return chosen
    model, method, problem, watch = chosen
    engine = model.engine
    problem = with_gains(model.stages.program, lambda pilot: engine.integrate(pilot, method), problem, parameters)
    run = integrate(model, problem, method, begin, watch, automatic=options.automatic, carried=carried)
    return run.with_twin(_twin(model, problem, run, options)) if options.error_estimate else run


def _model_and_problem(
    model: CompiledModel,
    t_span: tuple[float, float],
    initial: Given,
    parameters: Given,
    options: SimulateOptions,
    begin: float,
) -> tuple[CompiledModel, str, IntegrationProblem, EventCode | None] | Trajectory:
    """Return the model that a run takes, without constraints that depend on others at its start, and what it runs.

    That is a method, a problem and events. Where nothing can run from the start, return the run that ends there.
    """
    while True:
        able = divisible_model(model, t_span[0], initial, parameters)
        method = able.choose_method(options.method, options.rtol, options.atol)
        problem = _problem(able, t_span, initial, parameters, options, method)
        watch = able.derived.events(options.events)
        if watch is not None and options.error_estimate:
            raise OptionError(NO_ESTIMATE)
        found = independent_model(able, problem, method, begin)
        if found is able:
            return able, method, problem, watch
        if isinstance(found, Trajectory):
            return found if watch is None else found.with_events(event_records(watch.labels, [], found))
        model = found


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
    signs of events (see `Engine.integrate_watched`).
    """
    ready, wanted = time.perf_counter(), problem.dense
    for check in model.checks:
        problem = check.before(problem)
    if model.layout.state:
        enter_stage("machine code")
        model.engine.prepare(problem, method, watch)
    compiled = time.perf_counter() - ready
    engine, note = model.engine, ""
    occurrences: list[Occurrence] = []
    special = special_run(model, problem, method, watch, automatic, carried)
    if special is not None:
        solution, occurrences, method, note = special
    elif automatic:
        solution, method, note = engine.integrate_automatic(problem, method)
    else:
        solution = engine.integrate(problem, method)
    solution, notes = checked(model, problem, method, solution)
    along = model.engine.constants_along(problem)
    about = [find(model, solution, along) for find in (lost_directions, slid_along, lost_reactions)]
    notes = [note, *notes, *about]
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
    part = Part(
        model.stages.program,
        along,
        solution.t,
        solution.y,
        solution.dense,
        solution.end,
        model.stages.scene,
        model.monitors,
        solution.wrapped,
    )
    run = Trajectory((part,), solution.status, statistics)
    if model.derived.signed:
        warn_of_motion(model.layout.assumptions, model.derived.signed, run.t, run.__getitem__)
    return run if watch is None else run.with_events(event_records(watch.labels, occurrences, run))


def ended_early(model: CompiledModel, problem: IntegrationProblem) -> tuple[IntegrationProblem, Status | None]:
    """Return a problem up to where a run ends because some constraints follow from others no more, and its status.

    Where it does not, return the problem and None.
    """
    if not model.stages.reduced.unproven and model.stages.reduced.redundancy is None:
        return problem, None
    method = model.choose_method("auto", problem.rtol, problem.atol)
    run = integrate(model, problem, method, time.perf_counter(), automatic=True)
    if run.status is not Status.SINGULAR_CONFIGURATION:
        return problem, None
    times, forward = problem.t_eval, 1.0 if problem.t1 >= problem.t0 else -1.0
    times = None if times is None else times[forward * times < forward * run.t_end]
    return replace(problem, t1=run.t_end, t_eval=times), run.status


def _problem(
    model: CompiledModel,
    t_span: tuple[float, float],
    initial: Given,
    parameters: Given,
    options: SimulateOptions,
    method: str,
) -> IntegrationProblem:
    """Return the problem of a run from given values.

    Raises
    ------
    UnknownNameError, ValueInputError, InitialStateError, OptionError
        For values and options that are wrong.
    """
    program, (t0, t1) = model.stages.program, t_span
    p = inputs.in_order(program.layout, model.read_parameters(parameters))
    p = along_run(program.layout.parameters, p, backward=t1 < t0)
    values = directed(model.read_initial(initial), t0, t1)
    inputs.warn_below_floor(options.rtol, options.atol, program, method)
    start = model.derived.quick_start(values)
    found = start(t0, values, p) if program.conditions is None else None
    if found is None:
        c = starting_constants(program, inputs.constants(program, p), t0, t1)
        found = initial_state(start.start, t0, values, c, program), c
    return _limited(program, t_span, *found, options)


def _limited(
    program: Program, t_span: tuple[float, float], y: FloatArray, c: FloatArray, options: SimulateOptions
) -> IntegrationProblem:
    """Return the problem of a run over a span from a state (n_y,) with constants (n_c,)."""
    return IntegrationProblem(
        t0=t_span[0],
        t1=t_span[1],
        y0=y,
        constants=c,
        rtol=options.rtol,
        atol=options.atol,
        t_eval=options.t_eval,
        first_step=options.first_step,
        max_step=options.max_step,
        max_steps=options.max_steps,
        dense=options.dense,
        inputs=None if options.inputs is None else options.inputs.records(program.layout, program.knot_sides),
    )


def _twin(model: CompiledModel, problem: IntegrationProblem, run: Trajectory, options: SimulateOptions) -> Trajectory:
    """Return a run at tighter tolerances, recorded at the times of another."""
    options = tighter(options)
    finer = replace(problem, rtol=options.rtol, atol=options.atol, t_eval=run.t, dense=False)
    method = model.choose_method(options.method, options.rtol, options.atol)
    return integrate(model, finer, method, time.perf_counter(), automatic=options.automatic)
