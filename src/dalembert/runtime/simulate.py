"""Simulation of one trajectory of a compiled model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from ..arrays import FloatArray
from ..errors import OptionError
from ..integrators.problem import IntegrationProblem
from ..ir.decay_rates import along_run
from ..ir.program import Program
from ..methods.status import Status
from ..options import SimulateOptions, tighter
from ..progress import enter_stage, run_meter
from ..results.motion import RunStatistics
from ..results.trajectory import Trajectory
from . import inputs
from .constraint_choice import divisible_model, independent_model
from .elapsed import begins_elsewhere, elapsed_times, in_elapsed_time, noted_from, with_offsets
from .event_parameters import with_event_parameters
from .gains import with_gains
from .initial_states import directed, initial_state
from .inputs import span_of
from .jump_sliding import slid_along
from .pathway_lengths import lost_directions
from .run_checks import checked
from .segment_constants import starting_constants
from .special_runs import special_run
from .symbol_assumptions import warn_of_motion

if TYPE_CHECKING:
    from ..integrators.event_code import EventCode
    from ..integrators.watched import Occurrence
    from ..results.motion import Motion
    from .base import Model
    from .model import CompiledModel

__all__ = ["NO_ESTIMATE", "ended_early", "simulate", "simulate_in_own_time"]

NO_ESTIMATE = "error_estimate compares motions time by time, which events may end or cut: leave out one of the two"

Given = Mapping[Any, Any]
RunT = TypeVar("RunT", bound="Motion")


def simulate(
    model: Model[RunT, Any], t_span: tuple[float, float], initial: Given, parameters: Given, options: SimulateOptions
) -> RunT:
    """Return one trajectory; see `Model.simulate`."""
    model = with_event_parameters(model, parameters, options.events)
    t0, t1 = span_of(t_span)
    if options.inputs is not None:
        options.inputs.refuse_span(t0, t1)
        parameters = options.inputs.parameters(parameters, t0, after=t1 >= t0)
    span, times, other = (t0, t1), options.t_eval, None
    if begins_elsewhere(t0, t1):
        other, events, _ = in_elapsed_time(model, t0, t1, options.events)
        options = replace(options, events=events)
    if other is not None:
        span, parameters = (0.0, t1 - t0), with_offsets(model, other, t0, parameters)
        options = replace(options, t_eval=elapsed_times(t0, t1, times), origin=t0)
        if options.inputs is not None:
            options = replace(options, inputs=options.inputs.counted_from(t0))
            parameters = options.inputs.parameters(parameters, 0.0, after=t1 >= t0)
    with run_meter(*span, options.progress) as show:
        run = (model if other is None else other)._simulate_in_own_time(span, initial, parameters, options)
        show(run.t_end)
    return run if other is None else run.counted_from(t0, times, noted_from(run.stats.note, t0))


def simulate_in_own_time(
    model: CompiledModel,
    t_span: tuple[float, float],
    initial: Given,
    parameters: Given,
    options: SimulateOptions,
    carried: FloatArray | None = None,
) -> Trajectory:
    """Return one trajectory in the time of the model, whatever the span.

    `carried` (n_events,) are signs of events, for a run that is a part of another (see `integrate_watched`).
    """
    if options.project_invariants is not False:
        from .invariant_projection import keeping_from, refuse_jumps

        refuse_jumps(options.events, model.layout.aliases)
        model, kept = keeping_from(model, options.project_invariants, t_span, initial, parameters)
        options, parameters = replace(options, project_invariants=False), {**parameters, **kept}
    begin = time.perf_counter()
    chosen = _model_and_problem(model, t_span, initial, parameters, options, begin)
    if isinstance(chosen, Trajectory):
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
        if isinstance(found, Trajectory):
            return found
        if found is able:
            return able, method, problem, watch
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
    signs of events (see `integrate_watched`).
    """
    ready, wanted = time.perf_counter(), problem.dense
    for check in model.checks:
        problem = check.before(problem)
    if model.layout.state:
        enter_stage("machine code")
        model.engine.prepare(problem, method)
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
    p = along_run(program.layout.parameters, model.parameter_vector(parameters), backward=t1 < t0)
    values = directed(model.initial_values(initial), t0, t1)
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
