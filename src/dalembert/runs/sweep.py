"""Simulation of many cases of a compiled model, each with its own steps and status."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError
from ..lanes.cases import BlockResult
from ..methods.status import Status
from ..options import SweepOptions, tighter
from ..results.cases import CaseSet
from ..results.statistics import SweepStatistics
from ..results.sweep import Sweep
from ..results.sweep_states import NO_MODE, ProgramStates
from ..starts import inputs
from ..starts.first_integrals import refuse_jumps
from ..starts.symbol_assumptions import warn_of_motion
from ..threads import available_threads
from .case_blocks import fitted, run_cases
from .case_models import divisible_cases, independent_cases, keeping_cases, surely_independent, unlike_left_out
from .case_settings import CaseSettings, check_settings, common_settings, spans_of, with_grid
from .cases import Cases
from .elapsed import begins_elsewhere, elapsed_times, far, in_elapsed_time, offset_columns
from .events import with_event_parameters
from .reductions import reduction_table
from .run_checks import checked_cases
from .simulate import NO_ESTIMATE
from .small_motions import sweep_at_scale
from .special_runs import give_gains

if TYPE_CHECKING:
    from ..model.model import CompiledModel

Given = Mapping[Any, Any]


def sweep_cases(
    model: CompiledModel, t_span: tuple[Any, Any], initial: Given, parameters: Given, options: SweepOptions
) -> Sweep:
    """Return the results of many cases; see `CompiledModel.sweep`.

    Those that start far from zero run in the time since their start.
    """
    model = with_event_parameters(model, parameters, options.events, options.reduce, options.grid)
    if options.fits_atol:
        return sweep_at_scale(model, partial(sweep_cases, model, t_span), (initial, parameters), options)
    run_model: Callable[..., Sweep] = sweep_in_own_time
    if model.modes is not None:
        from ..phases.given_values import run_cases as run_contact_cases

        run_model = run_contact_cases
    t_span = starts, lasts = spans_of(t_span)
    if options.inputs is not None:
        options.inputs.refuse_span(starts, lasts)
        parameters = options.inputs.case_parameters(parameters, starts, lasts)
    together = len(starts) == len(lasts) == 1
    if not begins_elsewhere(starts, lasts) or not (together or options.t_eval is None):
        return run_model(model, t_span, initial, parameters, options)
    other, events, reduce = in_elapsed_time(model, starts, lasts, options.events, options.reduce)
    if other is None:
        return run_model(model, t_span, initial, parameters, options)
    times = options.t_eval
    since = None if times is None else elapsed_times(float(starts[0]), float(lasts[0]), times)
    given = _with_offset_columns(model, other, t_span, initial, parameters, options.grid)
    near = ~far(starts, lasts) if other is not model else np.zeros(1, bool)
    begins = np.where(near, np.nan, starts) - starts  # NaN is not run
    start = 0.0 if since is None else float(starts[0])
    own = replace(options, t_eval=since, origin=start, events=events, reduce=reduce)
    if options.inputs is not None:
        own = replace(own, inputs=options.inputs.counted_from(starts))
        given = own.inputs.case_parameters(given, begins, lasts - starts)
    run = run_model(other, (begins, lasts - starts), initial, given, own)
    table = reduction_table(options.reduce, model.layout.aliases)
    crossings = [name for name, each in table.items() if each.kind == "first crossing"]
    run = run.counted_from(starts, times, model.layout.parameters, crossings)
    if not np.any(near):
        return run
    rest = run_model(model, (np.where(near, starts, np.nan), lasts), initial, parameters, options)
    return run.with_cases(np.broadcast_to(near, len(run)), rest, starts)


def _with_offset_columns(
    model: CompiledModel,
    other: CompiledModel,
    t_span: tuple[Any, Any],
    initial: Given,
    parameters: Given,
    grid: CaseSet | None,
) -> Given:
    """Return parameters with those that another model of the scene has for the start of each case."""
    offsets = other.equations.symbols.offsets
    if not offsets:
        return parameters
    whole = (initial, parameters) if grid is None else with_grid(model.layout, grid, initial, parameters)
    reader = model if model.modes is None else model.modes.model(model.modes.closed_mode)
    cases = Cases(reader.stages.program, reader.derived.start, t_span, *whole)
    return {**parameters, **offset_columns(offsets, cases.span["start"], cases.parameters)}


def sweep_in_own_time(
    model: CompiledModel,
    t_span: tuple[Any, Any],
    initial: Given,
    parameters: Given,
    options: SweepOptions,
    carried: FloatArray | None = None,
    times: FloatArray | None = None,
) -> Sweep:
    """Return the results of many cases of a model without contacts, in the time of the model.

    For runs that are parts of others, `carried` (k, 2 n_events) is what events carry (`CaseColumns.carried`), and
    `times` (n_t,) those to record of all of these others.
    """
    if options.project_invariants is not False:
        refuse_jumps(options.events, model.layout.aliases)
        model, further = keeping_cases(model, options.project_invariants, t_span, initial, parameters, options.grid)
        options, parameters = replace(options, project_invariants=False), {**parameters, **further}
    begin = time.perf_counter()
    if options.grid is not None:
        initial, parameters = with_grid(model.layout, options.grid, initial, parameters)
    model, cases, settings, independent = _model_and_cases(model, t_span, initial, parameters, options, begin)
    if carried is not None or times is not None:
        settings = replace(settings, carried=carried, t_eval=settings.t_eval if times is None else times)
    chosen = settings
    settings = _guarded(model, cases, chosen, options)
    if options.fits:
        settings = fitted(model.engine, cases, settings, model.derived.quick_start)
        if settings.method != chosen.method:
            settings = _guarded(model, cases, replace(settings, watch=chosen.watch), options)
    give_gains(model.engine, cases, settings, parameters)
    axes = {} if options.grid is None else options.grid.axes
    if not independent:
        settings = unlike_left_out(model, cases, settings)
    run = _results(model, cases, settings, run_cases(model.engine, cases, settings), axes, begin)
    if not options.error_estimate:
        return run
    options = tighter(options)
    method = model.choose_method(options.method, options.rtol, options.atol, many=True)
    method = options.method_chosen(NO_MODE, method)
    finer = replace(settings, rtol=options.rtol, atol=options.atol, method=method)
    if options.fits:
        finer = fitted(model.engine, cases, finer, model.derived.quick_start)
    begin, stop = time.perf_counter(), bool(np.any(run.status == Status.INTERRUPTED))
    return run.with_twin(_results(model, cases, finer, run_cases(model.engine, cases, finer, stop), axes, begin))


def _model_and_cases(
    model: CompiledModel,
    t_span: tuple[Any, Any],
    initial: Given,
    parameters: Given,
    options: SweepOptions,
    begin: float,
) -> tuple[CompiledModel, Cases, CaseSettings, bool]:
    """Return the model that cases take, without constraints that depend on others at the first start, and what it runs.

    Last is whether its constraints are certainly independent in all cases.

    Raises
    ------
    OptionError, ValueInputError
        For options that make no sense with these cases, or with each other.
    """
    while True:
        method = model.choose_method(options.method, options.rtol, options.atol, many=True)
        method = options.method_chosen(NO_MODE, method)
        inputs.warn_below_floor(options.rtol, options.atol, model.stages.program, method)
        cases = Cases(model.stages.program, model.derived.start, t_span, initial, parameters, options.inputs)
        able = divisible_cases(model, cases)
        if able is model:
            settings = _settings(model, cases, options, method)
            independent = surely_independent(model, cases, settings)
            if not independent:
                able = independent_cases(model, cases, settings, begin)
            if able is model:
                return model, cases, settings, independent
        model = able


def _settings(model: CompiledModel, cases: Cases, options: SweepOptions, method: str) -> CaseSettings:
    """Return the common settings of all cases, checked, and kept for calls with the same options.

    Raises
    ------
    OptionError, ValueInputError
        For options that make no sense with these cases, or with each other.
    """
    if not options.repeats:
        return _new_settings(model, cases, options, method)
    kept, key = model.derived.sweep_settings, (options, method, options.threads or available_threads())
    found = kept.get(key)
    if found is None:
        found = kept[key] = _new_settings(model, cases, options, method), cases.ends
    elif not cases.together or (options.t_eval is not None and found[1] != cases.ends):
        check_settings(cases, options)
        kept[key] = found[0], cases.ends
    return found[0]


def _new_settings(model: CompiledModel, cases: Cases, options: SweepOptions, method: str) -> CaseSettings:
    """Return new settings; errors as for `_settings`."""
    settings = common_settings(cases, options, method)
    watch = model.derived.events(options.events, options.reduce)
    if watch is not None and options.error_estimate:
        raise OptionError(NO_ESTIMATE)
    return replace(settings, watch=watch, judge=partial(checked_cases, model.checks) if model.checks else None)


def _guarded(model: CompiledModel, cases: Cases, settings: CaseSettings, options: SweepOptions) -> CaseSettings:
    """Return settings whose cases are watched for what the checks of the model look for, where they have to be."""
    guards = tuple([check.guards(settings.method) for check in model.checks])
    if not any(guards):
        return settings
    watch = model.derived.events(options.events, options.reduce, guards=guards, duration=cases.duration)
    return replace(settings, watch=watch)


def _results(
    model: CompiledModel,
    cases: Cases,
    settings: CaseSettings,
    done: BlockResult,
    axes: Mapping[str, FloatArray],
    begin: float,
) -> Sweep:
    """Return the results of all cases; the run time counts from `begin`."""
    if settings.apart is not None:
        done.refuse(settings.apart, Status.SINGULAR_CONFIGURATION)
    if cases.refused is not None:
        done.refuse(cases.refused, Status.ASSUMPTION)
    statistics = partial(
        SweepStatistics,
        method=settings.method,
        threads=settings.threads,
        compile_seconds=model.stages.compile_seconds,
        run_seconds=time.perf_counter() - begin,
        note=settings.note,
        rtol=settings.rtol,
        atol=settings.atol,
        methods={(NO_MODE, settings.rtol): settings.method},
    )
    samples = None if settings.t_eval is None else done.samples
    varied, program = cases.given, model.stages.program
    t_eval, about = settings.t_eval, (program.name, program.formulation, program.layout, varied)
    states = ProgramStates(program, cases.constants_at, done.ends[:, 0], done.y, samples, t_eval)
    run = Sweep(*about, done.ends, t_eval, axes, statistics, states)
    if model.derived.signed:
        warn_of_motion(model.layout.assumptions, model.derived.signed, run.t, run._final)
    watch = settings.watch
    return run if watch is None else run.with_events(watch.labels, done.happened, list(watch.plan), done.totals)
