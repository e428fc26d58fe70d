"""Sweeps of motions with contacts."""

from __future__ import annotations

import time

import numpy as np

from ...arrays import FloatArray
from ...integrators.contact_cases import UNDECIDED
from ...methods.status import RUNNING, Status
from ...options import SweepOptions
from ...progress import meter
from ...results.sweep import Sweep, SweepStatistics
from ...results.sweep_states import ContactStates
from ..symbol_assumptions import warn_of_motion
from .case_runs import CaseRuns
from .output_values import OutputValues
from .request import MotionRequest
from .runner_choice import RunnerChoice
from .stops import Stops

__all__ = ["sweep"]

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
    begin, options, count = time.perf_counter(), request.options, len(request.t0)
    stops = request.stops(many=True)
    assert options.threads is not None
    chosen = None if options.chosen is None else options.method_chosen
    choice = RunnerChoice(request.modes, options, request.reductions, fits=options.fits, chosen=chosen)
    runs = CaseRuns(choice, count, threads=options.threads, t_eval=options.t_eval, origin=options.origin)
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
    refused = np.isin(status, (Status.INITIAL_STATE, Status.ASSUMPTION)) | (request.status != RUNNING)
    refused |= runs.cases.number == UNDECIDED  # no motion begins from where the contacts select no mode
    runs.drop_results(np.flatnonzero(refused))
    return _results(request, runs, stops, varied, time.perf_counter() - begin)


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
    stats = SweepStatistics(
        method=", ".join(dict.fromkeys(methods.values())),
        threads=options.threads,
        steps=int(numbers.steps.sum()),
        compile_seconds=runs.choice.compile_seconds,
        run_seconds=seconds - runs.choice.compile_seconds,
        rtol=options.rtol,
        atol=options.atol,
        methods={(number, options.rtol): method for number, method in methods.items()},
    )
    last, samples = runs.states(np.arange(len(request.t0))), None if options.t_eval is None else runs.samples
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
    about, labels = (runs.occurred, runs.totals), request.labels
    reduced = request.reductions.results(value, last, request.t0, numbers.state, about)
    return run.with_events(labels, runs.occurred[:, : 3 * len(labels)], list(request.reductions.table), reduced)
