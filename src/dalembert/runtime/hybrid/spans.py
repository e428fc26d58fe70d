"""Runs, sweeps and prepared runs of scenes with contacts over spans that may begin elsewhere than at time zero.

They are counted from their start, as those of scenes without contacts (`dalembert.runtime.elapsed`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ...errors import ExpressionError
from ...hybrid import CLOSED, OPEN
from ...integrators.event_code import Event, event_list
from ...options import PrepareOptions, SimulateOptions, SweepOptions
from ...results.hybrid import HybridTrajectory
from ...results.hybrid_sweep import HybridSweep
from .. import inputs
from ..cases import Cases, spans_of, with_grid
from ..elapsed import asked, begins_elsewhere, elapsed_times, extension, noted_from, offset_columns, offset_values
from ..event_parameters import event_parameters
from ..prepared import PreparedRun
from ..reductions import reduction_table
from .given_values import plain_mode, refuse_open_gains, run_cases, run_motion
from .prepare import prepared, with_extension

if TYPE_CHECKING:
    from .model import HybridModel

__all__ = ["prepare", "simulate", "sweep"]

Given = Mapping[Any, Any]


def simulate(
    model: HybridModel, t_span: tuple[float, float], initial: Given, parameters: Given, options: SimulateOptions
) -> HybridTrajectory:
    """Return one trajectory; see `Model.simulate`."""
    t0, t1 = inputs.span_of(t_span)
    events, given_inputs = options.events, options.inputs
    model = event_parameters(model, model.layout, parameters, events, None, None, make=model.with_parameters)
    if given_inputs is not None:
        given_inputs.refuse_span(t0, t1)
        parameters = given_inputs.parameters(parameters, t0, after=t1 >= t0)
    other, own, _ = _in_elapsed_time(model, t0, t1, events) if begins_elsewhere(t0, t1) else (None, events, None)
    if other is None:
        return _simulate_in_own_time(model, (t0, t1), initial, parameters, options)
    times = options.t_eval
    wanted = elapsed_times(t0, t1, times)
    given = parameters
    if other is not model:
        offsets = other.several.automaton.equations.symbols.offsets
        given = {**parameters, **offset_values(offsets, t0, model.parameter_values(parameters))}
    if given_inputs is not None:
        given_inputs = given_inputs.counted_from(t0)
        given = given_inputs.parameters(given, 0.0, after=t1 >= t0)
    options = replace(options, t_eval=wanted, events=own, inputs=given_inputs)
    run = _simulate_in_own_time(other, (0.0, t1 - t0), initial, given, options)
    if times is not None and wanted is not None:
        times = times[(wanted - run.t_end) * (1.0 if t1 >= t0 else -1.0) <= 0.0]
    return run.counted_from(t0, times, noted_from(run.stats.note, t0))


def _simulate_in_own_time(
    model: HybridModel, t_span: tuple[float, float], initial: Given, parameters: Given, options: SimulateOptions
) -> HybridTrajectory:
    """Return one trajectory in the time of the model, whatever the span."""
    p, values = model.parameter_vector(parameters), inputs.given_values(model.layout, initial)
    return run_motion(model.modes, model.layout, t_span, values, p, options, _moving_events(model, options.events))


def sweep(
    model: HybridModel, t_span: tuple[Any, Any], initial: Given, parameters: Given, options: SweepOptions
) -> HybridSweep:
    """Return the results of many cases; see `Model.sweep`."""
    events, reduce, grid, t_eval = options.events, options.reduce, options.grid, options.t_eval
    model = event_parameters(model, model.layout, parameters, events, reduce, grid, make=model.with_parameters)
    starts, lasts = spans_of(t_span)
    if options.inputs is not None:
        options.inputs.refuse_span(starts, lasts)
        parameters = options.inputs.case_parameters(parameters, starts, lasts)
    together = len(starts) == len(lasts) == 1
    other, own, table = None, events, reduce
    if begins_elsewhere(starts, lasts) and (together or t_eval is None):
        other, own, table = _in_elapsed_time(model, starts, lasts, events, reduce)
    options = replace(options, events=own, reduce=table)
    if other is None:
        return _sweep_in_own_time(model, t_span, initial, parameters, options)
    wanted = elapsed_times(float(starts[0]), float(lasts[0]), t_eval)
    given = parameters
    if other is not model:
        whole = (initial, parameters) if grid is None else with_grid(model.layout, grid, initial, parameters)
        closed = model.modes.model(plain_mode(model.modes, CLOSED))
        cases = Cases(closed.stages.program, closed.derived.start, t_span, *whole)
        offsets = other.several.automaton.equations.symbols.offsets
        given = {**parameters, **offset_columns(offsets, starts, cases.parameters)}
    options = replace(options, t_eval=wanted)
    if options.inputs is not None:
        options = replace(options, inputs=options.inputs.counted_from(starts))
        given = options.inputs.case_parameters(given, starts - starts, lasts - starts)
    run = _sweep_in_own_time(other, (starts - starts, lasts - starts), initial, given, options)
    reductions = reduction_table(reduce, model.layout.aliases)
    crossings = [name for name, each in reductions.items() if each.kind == "first crossing"]
    return run.counted_from(starts, t_eval, model.layout.parameters, crossings)


def _sweep_in_own_time(
    model: HybridModel, t_span: tuple[Any, Any], initial: Given, parameters: Given, options: SweepOptions
) -> HybridSweep:
    """Return the results of many cases in the time of the model."""
    events = _moving_events(model, options.events)
    return run_cases(model.modes, model.layout, t_span, initial, parameters, options, events)


def prepare(model: HybridModel, t_span: tuple[float, float], options: PrepareOptions) -> PreparedRun:
    """Return a prepared run; see `Model.prepare`."""
    t0, t1 = t_span
    given = options.inputs
    if given is not None:
        given.refuse_span(t0, t1)
    refuse_open_gains(model.modes)
    opened = model.modes.model(plain_mode(model.modes, OPEN))
    chosen = opened.choose_method(options.method, options.rtol, options.atol, many=True)
    inputs.warn_below_floor(options.rtol, options.atol)
    other, _, _ = _in_elapsed_time(model, t0, t1) if begins_elsewhere(t0, t1) else (None, (), None)
    span = t_span if other is None else (0.0, t1 - t0)
    own = other or model
    offsets = own.several.automaton.equations.symbols.offsets
    if given is not None and other is not None:
        given = given.counted_from(t0)
    run = prepared(own.modes, own.layout, span, replace(options, inputs=given))
    if offsets:
        run = with_extension(run, extension(own.layout.parameters, model.layout.parameters, offsets, t0))
    layout = replace(model.layout, state=model.layout.variables)
    return PreparedRun(run, chosen, layout, partial(prepare, model, t_span, options), given, span)


def _in_elapsed_time(
    model: HybridModel, t0: Any, t1: Any, events: Any = (), reduce: Any = None
) -> tuple[HybridModel | None, Any, Any]:
    """Return the model that runs in the time since a start, as that of a scene without contacts does."""
    found = asked(model.several.automaton.equations.symbols, (t0, t1), events, reduce)
    if found is None:
        return None, events, reduce
    if not found.other:
        return model, events, reduce
    _moving_events(model, events)
    return model.in_elapsed_time(found.watched), found.events, found.reductions


def _moving_events(model: HybridModel, events: Any) -> tuple[Event, ...]:
    """Return events, each of which moves in some mode.

    Raises
    ------
    ExpressionError
        For those that are constant along every motion.
    """
    listed = event_list(events, model.layout.aliases)
    for event in listed:
        watched = event.expression
        inside = getattr(watched, "free_symbols", ())
        names = {watched} if isinstance(watched, str) else {str(symbol) for symbol in inside}
        if names <= {*model.layout.parameters}:
            raise ExpressionError(
                f"event {event.label!r} is constant along every motion, so that nothing can be watched: write it"
                " in coordinates, rates, outputs or time"
            )
    return listed
