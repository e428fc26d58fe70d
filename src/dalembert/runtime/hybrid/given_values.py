"""Runs and sweeps of scenes with contacts from given values, in the time of the model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arrays import FloatArray
from ...errors import OptionError, ValueInputError, list_names
from ...hybrid import Mode
from ...ir.decay_rates import along_run
from ...ir.interpret import interpret_rows
from ...methods.status import RUNNING, Status
from ...options import SimulateOptions, SweepOptions, tighter
from ...reduction.baumgarte import GAINS, Baumgarte
from ...results.sweep import Sweep
from ...results.trajectory import Trajectory
from .. import inputs
from ..case_settings import common_settings
from ..cases import Cases, with_grid
from ..event_parameters import moving_events
from ..reductions import reduction_table
from ..simulate import NO_ESTIMATE
from .mode_models import ModeModels, all_modes
from .reductions import PhaseReductions
from .request import MotionRequest
from .simulate import simulate
from .sweep import sweep

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["refuse_kept_invariants", "refuse_open_gains", "run_cases", "run_motion", "start_state"]


def refuse_kept_invariants(model: CompiledModel, project_invariants: Any) -> ModeModels:
    """Return the modes of a model, after refusing to keep first integrals.

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
    model = modes.model(_starting_mode(modes, values))
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
    known = {layout.aliases.get(str(key), str(key)) for key in initial}
    first = modes.model(_starting_mode(modes, known))
    program = first.stages.program
    cases = Cases(program, first.derived.start, t_span, initial, parameters)
    settings = common_settings(
        cases, options, first.choose_method(options.method, options.rtol, options.atol, many=True)
    )
    block, status = cases.block(slice(0, cases.count), settings)
    own, p = cases.parameters_of(slice(0, cases.count)), np.zeros((cases.count, 0))
    columns = {name: own[name] for name in layout.parameters}
    if columns:
        p = np.column_stack([np.broadcast_to(values, cases.count) for values in columns.values()])
    request = MotionRequest(
        modes=modes,
        t0=block.spans[:, 0],
        t1=block.spans[:, 1],
        x=interpret_rows(program.kernel("expand"), block.spans[:, 0], block.y, block.c),
        p=p,
        status=status.astype(np.int64),
        options=replace(options, t_eval=settings.t_eval, threads=settings.threads),
        reductions=PhaseReductions(table, events),
    )
    varied = cases.initial, columns
    run = sweep(request, varied)
    if not options.error_estimate:
        return run
    stop = bool(np.any(run.status == Status.INTERRUPTED))
    return run.with_twin(sweep(replace(request, options=tighter(request.options)), varied, stop))


def _starting_mode(modes: ModeModels, given: Iterable[str]) -> Mode:
    """Return the mode whose model starts from given values: all contacts close where these leave something out."""
    known = set(given)
    for entry in modes.equations.symbols.entries:
        if known.issuperset((*entry.names, *entry.needs)):
            known |= set(entry.targets)
    return modes.open_mode if known.issuperset((*modes.layout.coordinates, *modes.layout.rates)) else modes.closed_mode
