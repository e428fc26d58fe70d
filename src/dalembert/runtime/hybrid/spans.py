"""Sweeps and prepared runs of scenes with contacts over spans that may begin elsewhere than at time zero.

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
from ...options import PrepareOptions, SweepOptions
from ...results.hybrid_sweep import HybridSweep
from .. import inputs
from ..cases import Cases, spans_of, with_grid
from ..elapsed import begins_elsewhere, elapsed_times, extension, in_elapsed_time, offset_columns
from ..event_parameters import with_event_parameters
from ..prepared import PreparedRun
from ..reductions import reduction_table
from .given_values import plain_mode, refuse_open_gains, run_cases
from .prepare import prepared, with_extension

if TYPE_CHECKING:
    from .model import HybridModel

__all__ = ["moving_events", "prepare", "sweep"]

Given = Mapping[Any, Any]


def sweep(
    model: HybridModel, t_span: tuple[Any, Any], initial: Given, parameters: Given, options: SweepOptions
) -> HybridSweep:
    """Return the results of many cases; see `Model.sweep`."""
    events, reduce, grid, t_eval = options.events, options.reduce, options.grid, options.t_eval
    model = with_event_parameters(model, parameters, events, reduce, grid)
    starts, lasts = spans_of(t_span)
    if options.inputs is not None:
        options.inputs.refuse_span(starts, lasts)
        parameters = options.inputs.case_parameters(parameters, starts, lasts)
    together = len(starts) == len(lasts) == 1
    other, own, table = None, events, reduce
    if begins_elsewhere(starts, lasts) and (together or t_eval is None):
        other, own, table = in_elapsed_time(model, starts, lasts, events, reduce)
    options = replace(options, events=own, reduce=table)
    if other is None:
        return _sweep_in_own_time(model, t_span, initial, parameters, options)
    wanted = elapsed_times(float(starts[0]), float(lasts[0]), t_eval)
    given = parameters
    if other is not model:
        whole = (initial, parameters) if grid is None else with_grid(model.layout, grid, initial, parameters)
        closed = model.modes.model(plain_mode(model.modes, CLOSED))
        cases = Cases(closed.stages.program, closed.derived.start, t_span, *whole)
        offsets = other._equations.symbols.offsets
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
    events = moving_events(model, options.events)
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
    other, _, _ = in_elapsed_time(model, t0, t1) if begins_elsewhere(t0, t1) else (None, (), None)
    span = t_span if other is None else (0.0, t1 - t0)
    own = other or model
    offsets = own._equations.symbols.offsets
    if given is not None and other is not None:
        given = given.counted_from(t0)
    run = prepared(own.modes, own.layout, span, replace(options, inputs=given))
    if offsets:
        run = with_extension(run, extension(own.layout.parameters, model.layout.parameters, offsets, t0))
    layout = replace(model.layout, state=model.layout.variables)
    return PreparedRun(run, chosen, layout, partial(prepare, model, t_span, options), given, span)


def moving_events(model: HybridModel, events: Any) -> tuple[Event, ...]:
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
