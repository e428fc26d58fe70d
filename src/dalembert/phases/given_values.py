"""Runs, sweeps and prepared runs of scenes with contacts from given values, in the time of the model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from threading import get_ident
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray, arrays_of
from ..codegen.llvm.prepared import Admission
from ..codegen.runs import Final, Prepared, PreparedStates
from ..contacts.contact_cases import UNDECIDED
from ..errors import OptionError, ValueInputError, list_names
from ..ir.graph import Graph
from ..ir.interpret import interpret_rows
from ..ir.program import along_run
from ..ir.random_points import values_of
from ..methods.status import RUNNING, Status
from ..options import PrepareOptions, SimulateOptions, SweepOptions, tighter
from ..progress import meter
from ..reduction.stabilised import GAINS, Baumgarte
from ..results.statistics import SweepStatistics
from ..results.sweep import Sweep
from ..results.sweep_states import ContactStates
from ..results.trajectory import Trajectory
from ..runs.case_settings import common_settings, with_grid
from ..runs.cases import Cases
from ..runs.events import moving_events
from ..runs.reductions import reduction_table
from ..runs.simulate import NO_ESTIMATE
from ..starts import inputs
from ..starts.inputs import warn_below_floor
from ..starts.symbol_assumptions import warn_of_motion
from .case_runs import CaseRuns
from .mode_models import ModeModels, all_modes
from .motion_recorder import MotionRequest, runs_of
from .output_values import OutputValues, PhaseReductions
from .runner_choice import RunnerChoice
from .simulate import simulate
from .stops import Stops, stops_of

if TYPE_CHECKING:
    from ..model.model import CompiledModel


# Sweeps of motions with contacts.

_BETWEEN_LOOKS = 1024
"""Cases after which a bar shows how far they are."""


def sweep(
    request: MotionRequest[SweepOptions],
    varied: tuple[dict[str, FloatArray], dict[str, FloatArray]],
    stop: bool = False,
) -> Sweep:
    """Return the results of all cases; with `stop` none of them is run.

    `varied` are initial values and parameters as they were given.
    """
    begin, stops = time.perf_counter(), request.stops(many=True)
    with runs_of(request, stops=stops is not None) as runs:
        _run(request, runs, stops, stop)
        return _results(request, runs, stops, varied, time.perf_counter() - begin)


def _run(request: MotionRequest[SweepOptions], runs: CaseRuns, stops: Stops | None, stop: bool) -> None:
    """Run all cases, or with `stop` none."""
    options, count = request.options, len(request.t0)
    runs.begin(request.t0, request.t1, request.x, request.p, stops)
    status = runs.numbers.state
    status[:] = request.status
    if stops is not None:
        status[stops.senseless & (status == RUNNING)] = int(Status.NON_FINITE)
    with meter(count, options.progress) as advance:
        advance(count - len(runs.running()))
        try:
            if stop:
                raise KeyboardInterrupt
            runs.run(request.jumps, together=_BETWEEN_LOOKS if options.progress else None, advance=advance)
        except KeyboardInterrupt:
            runs.interrupt()
    refused = (status == Status.INITIAL_STATE) | (status == Status.ASSUMPTION) | (request.status != RUNNING)
    lost = (runs.cases.number == UNDECIDED) & (status != Status.CONTACT_UNSUPPORTED)
    refused |= lost  # no motion begins from where the contacts select no mode
    runs.drop_results(np.flatnonzero(refused))


def _results(
    request: MotionRequest[SweepOptions],
    runs: CaseRuns,
    stops: Stops | None,
    varied: tuple[dict[str, FloatArray], dict[str, FloatArray]],
    seconds: float,
) -> Sweep:
    """Return the results of cases that have been run."""
    numbers, options, methods, modes = runs.numbers, request.options, runs.choice.methods, request.modes
    assert options.threads is not None
    stats = partial(
        SweepStatistics,
        method=", ".join(dict.fromkeys(methods.values())),
        threads=options.threads,
        compile_seconds=runs.choice.compile_seconds,
        run_seconds=seconds - runs.choice.compile_seconds,
        rtol=options.rtol,
        atol=options.atol,
        methods={(number, options.rtol): method for number, method in methods.items()},
    )
    last = runs.states(np.arange(len(request.t0)))
    samples = None if options.t_eval is None else runs.samples_taken
    if samples is not None:
        samples.case[:] = np.repeat(last.case, len(options.t_eval))
    met = last.mode if samples is None else np.concatenate([last.mode, samples.mode])
    value = OutputValues(modes, request.p, stops, (request.t1, request.t1 >= request.t0))
    states = ContactStates(
        last,
        samples,
        value,
        [contact.name for contact in modes.equations.contacts],
        {int(n): modes.named(modes.automaton.mode(int(n))) for n in np.unique(met[met >= 0])},
        numbers.phases + (last.mode >= 0),
    )
    run = Sweep(
        modes.equations.name,
        "by mode",
        modes.layout,
        varied,
        np.column_stack([last.t, numbers.state.astype(float), numbers.steps.astype(float)]),
        options.t_eval,
        {} if options.grid is None else options.grid.axes,
        stats,
        states,
    )
    warn_of_motion(modes.layout.assumptions, modes.layout.coordinates, run.t, run._final)
    happened, labels = runs.occurred.copy(), request.labels
    about = happened, runs.totals
    reduced = request.reductions.results(value, last, request.t0, numbers.state, about)
    return run.with_events(labels, happened[:, : 3 * len(labels)], list(request.reductions.table), reduced)


def refuse_kept_invariants(model: CompiledModel, project_invariants: Any) -> ModeModels:
    """Return the modes of a model; raise an error if first integrals are to be kept.

    Raises
    ------
    OptionError
    """
    if project_invariants is not False:
        raise OptionError(
            f"project_invariants: friction takes energy, and impacts and changes of contact change what else may be"
            f" conserved in {model.name!r} ({list_names(model.contacts)}). Leave it out, or run a model of one"
            " mode, as mode() gives it"
        )
    return all_modes(model)


def refuse_open_gains(modes: ModeModels) -> None:
    """Raise `OptionError` where modes have gains of the formulation "baumgarte" that were not given.

    A single run finds them from its steps, of each phase anew; all cases of a sweep must have the same.
    """
    program = modes.model(modes.open_mode).stages.program
    if program.formulation != Baumgarte.name:
        return
    if set(modes.model(modes.closed_mode).layout.defaults) & set(GAINS):
        raise OptionError(
            "sweeps and prepared runs of a scene with contacts need the gains of 'baumgarte': give gains=(alpha, beta)"
            " [1/s] to compile_model, or take another formulation"
        )


def start_state(
    modes: ModeModels, t: float, values: Mapping[str, float], parameters: Mapping[str, float]
) -> FloatArray:
    """Return consistent coordinates, rates and first-order states (2 n_q + n_z,)."""
    apart = open_contacts(modes, {**parameters, **values, modes.equations.symbols.time: t})
    model = modes.model(modes.starting_mode(frozenset(values), apart))
    y = model.state(values, parameters, t=t)
    return model.expand(t, y, parameters)


def run_motion(
    model: CompiledModel,
    t_span: tuple[float, float],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    options: SimulateOptions,
) -> Trajectory:
    """Return one trajectory of a model with several modes, in the time of the model."""
    modes = refuse_kept_invariants(model, options.project_invariants)
    (t0, t1), times, layout = t_span, options.t_eval, modes.layout
    p, values = model.parameter_vector(parameters), inputs.given_values(layout, initial)
    events = moving_events(layout, options.events)
    p = along_run(layout.parameters, p, backward=t1 < t0)
    given = dict(zip(layout.parameters, p.tolist(), strict=True))
    inputs.warn_below_floor(options.rtol, options.atol)
    if events and options.error_estimate:
        raise OptionError(NO_ESTIMATE)
    if times is not None and not (np.all(np.isfinite(times)) and np.all((times - t0) * (times - t1) <= 0.0)):
        raise ValueInputError(f"t_eval must lie within t_span = ({t0:g}, {t1:g})")
    request = MotionRequest(
        modes=modes,
        t0=np.array([t0]),
        t1=np.array([t1]),
        x=start_state(modes, t0, values, given)[np.newaxis],
        p=p[np.newaxis],
        status=np.array([RUNNING]),
        options=options,
        reductions=PhaseReductions({}, events),
    )
    run = simulate(request)
    if not options.error_estimate:
        return run
    finer = replace(tighter(options), dense=True, t_eval=None)
    return run.with_twin(simulate(replace(request, options=finer)))


def run_cases(
    model: CompiledModel,
    t_span: tuple[Any, Any],
    initial: Mapping[Any, Any],
    parameters: Mapping[Any, Any],
    options: SweepOptions,
) -> Sweep:
    """Return the results of many cases of a model with several modes, in the time of the model."""
    modes = refuse_kept_invariants(model, options.project_invariants)
    events = moving_events(modes.layout, options.events)
    inputs.warn_below_floor(options.rtol, options.atol)
    refuse_open_gains(modes)
    layout = modes.layout
    table = reduction_table(options.reduce, layout.aliases)
    if (events or table) and options.error_estimate:
        raise OptionError(NO_ESTIMATE)
    if options.grid is not None:
        initial, parameters = with_grid(layout, options.grid, initial, parameters)
    known = frozenset(layout.aliases.get(str(key), str(key)) for key in initial)
    first = modes.model(modes.starting_mode(known))
    program = first.stages.program
    cases = Cases(program, first.derived.start, t_span, initial, parameters)
    settings = common_settings(
        cases, options, first.choose_method(options.method, options.rtol, options.atol, many=True)
    )
    block, status = cases.block(slice(0, cases.count), settings)
    own, p = cases.parameters_of(slice(0, cases.count)), np.zeros((cases.count, 0))
    columns = arrays_of({name: own[name] for name in layout.parameters})
    if columns:
        p = np.column_stack([np.broadcast_to(values, cases.count) for values in columns.values()])
    request = MotionRequest(
        modes=modes,
        t0=block.spans[:, 0],
        t1=block.spans[:, 1],
        x=interpret_rows(program.kernel("expand"), block.spans[:, 0], block.y, block.c),
        p=p,
        status=status.astype(np.int64),
        options=options if options.threads == settings.threads else replace(options, threads=settings.threads),
        reductions=PhaseReductions(table, events),
    )
    varied = cases.initial, columns
    run = sweep(request, varied)
    if not options.error_estimate:
        return run
    stop = bool(np.any(run.status == Status.INTERRUPTED))
    return run.with_twin(sweep(replace(request, options=tighter(request.options)), varied, stop))


def open_contacts(modes: ModeModels, given: Mapping[str, float]) -> frozenset[int]:
    """Return the numbers of the contacts whose gaps are positive at given values; not those these do not tell."""
    found = set()
    for number, contact in enumerate(modes.equations.contacts):
        if contact.constraint is None or contact.gap is None:
            continue
        inputs = {node: str(node.payload) for node in Graph.topological([contact.gap]) if node.op == "input"}
        if given.keys() >= set(inputs.values()):
            gap = values_of([contact.gap], {node: given[name] for node, name in inputs.items()})[0]
            found |= {number} if gap > 0.0 else set()
    return frozenset(found)


def prepare_with_contacts(
    model: CompiledModel, t_span: tuple[float, float], options: PrepareOptions
) -> tuple[str, Prepared]:
    """Return the method and the run of a model with several modes, in the time of the model."""
    modes = refuse_kept_invariants(model, options.project_invariants)
    warn_below_floor(options.rtol, options.atol)
    refuse_open_gains(modes)
    opened = modes.model(modes.open_mode)
    method = opened.choose_method(options.method, options.rtol, options.atol, many=True)
    return method, _prepared(modes, t_span, options)


def _prepared(modes: ModeModels, t_span: tuple[float, float], options: PrepareOptions) -> Prepared:
    """Return a function from variables (2 n_q + n_z,) and parameters of the scene (n_p,) to the final variables.

    Every thread keeps its memory.
    """
    tests = modes.admission
    admission = None if tests is None else Admission(tests, t_span[0], options.rtol)
    spans = np.array([t_span[0]]), np.array([t_span[1]])
    stopping = modes.changes or (options.inputs is not None and options.inputs.sampled)
    names, backward = modes.layout.parameters, t_span[1] < t_span[0]
    own: dict[int, CaseRuns] = {}

    def run(x: FloatArray, p: FloatArray) -> Final:
        if not (np.isfinite(x.sum()) and np.isfinite(p.sum())):
            return np.full_like(x, np.nan), Status.NON_FINITE
        p = along_run(names, p, backward=backward)
        case = own.get(get_ident())
        if case is None:
            case = own[get_ident()] = CaseRuns(RunnerChoice(modes, options, PhaseReductions({}, ())))
        stops = stops_of(modes, options.inputs, p[np.newaxis], spans) if stopping else None
        case.begin(*t_span, x, p, stops)
        case.run()
        return case.cases.x[0].copy(), case.status

    return PreparedStates(run, admission)
