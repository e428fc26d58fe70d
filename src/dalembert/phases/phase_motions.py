"""Motions of recorded phases: [RecordedPhase] -> [Trajectory]."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..events.recorded_motion import Occurrence, step_polynomials
from ..ir.conditions import CONDITION_TIME
from ..lanes.host_stops import joined
from ..lanes.step_records import ATTEMPTS_AT, ENDED_AT, FIRST_AT
from ..methods.status import Status
from ..options import SimulateOptions
from ..results.events import event_records
from ..results.parts import Part
from ..results.statistics import RunStatistics
from ..results.trajectory import Trajectory
from ..starts import inputs
from ..starts.symbol_assumptions import warn_of_motion
from ..steps.dense_output import PiecewisePolynomial
from ..steps.problem import Solution
from ..steps.projection import projected
from ..stops.segments import Constants, Segments, constants_at
from .mode_models import ModeModels
from .motion_recorder import MotionRequest, RecordedPhase
from .stops import Stops

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def trajectories(
    phases: Sequence[RecordedPhase],
    request: MotionRequest[SimulateOptions],
    status: Status,
    stops: Stops | None,
) -> list[Trajectory]:
    """Return the motions of recorded phases, with the events that users watch.

    Parameters
    ----------
    phases : sequence of RecordedPhase
    request : MotionRequest
    status : Status
        How the last of them ended.
    stops : Stops or None
        Where constants change, and controllers act, within phases.
    """
    modes = request.modes
    dense, labels = request.options.dense or request.options.t_eval is not None, request.labels
    acts = stops is not None and stops.acts
    found = [_joined_runs(phase.runs, labels, right=acts) if phase.runs else None for phase in phases]
    for mode in dict.fromkeys(phase.mode for phase in phases if not phase.runs):
        some = [i for i, phase in enumerate(phases) if phase.mode == mode and not phase.runs]
        model = modes.serving(mode)
        p = parameters_of_phases(modes, [phases[i] for i in some], request.parameters)
        c: Iterable[Constants] = inputs.prepare_rows(model.stages.program, p) if stops is None else ()
        if stops is not None:
            c = [_constants_along(model, phases[i], own, stops) for i, own in zip(some, p, strict=True)]
        for row, i in zip(c, some, strict=True):
            ended = status if i == len(phases) - 1 else Status.SUCCESS
            found[i] = _trajectory(modes, model, phases[i], row, ended, labels, dense, acts)
    return [motion for motion in found if motion is not None]


def parameters_of_phases(modes: ModeModels, phases: Sequence[RecordedPhase], given: Mapping[str, float]) -> FloatArray:
    """Return the parameters (k, n_p) of the model of the mode that phases share."""
    layout, mode = modes.serving(phases[0].mode).layout, phases[0].mode
    values = {**layout.defaults, **given, **modes.added(mode, np.array([phase.added for phase in phases]))}
    p = np.empty((len(phases), len(layout.parameters)))
    for place, name in enumerate(layout.parameters):
        p[:, place] = values[name]
    return p


def _constants_along(model: CompiledModel, phase: RecordedPhase, p: FloatArray, stops: Stops) -> Segments:
    """Return the constants along a phase, for the parameters (n_p,) of the model of its mode."""
    program, breaks = model.stages.program, stops.breaks
    edges = np.array([phase.t0, phase.t1])
    if breaks is not None:
        inside = (breaks.times - phase.t0) * (phase.t1 - breaks.times) > 0.0
        edges = np.concatenate([edges[:1], breaks.times[inside], edges[1:]])
    rows = np.tile(p, (len(edges) - 1, 1))
    if breaks is not None and breaks.place is not None:
        place = program.layout.parameters.index(CONDITION_TIME)
        rows[:, place] = breaks.middles(np.zeros(len(rows), np.intp), edges[:-1])
    records = None if stops.inputs is None else stops.inputs.records(program.layout)
    return Segments(edges, inputs.prepare_rows(program, rows), records)


def _trajectory(
    modes: ModeModels,
    model: CompiledModel,
    phase: RecordedPhase,
    c: Constants,
    status: Status,
    labels: Sequence[str],
    dense: bool,
    acts: bool,
) -> Trajectory:
    """Return the motion of one phase with its constants; where controllers act, behind each instant what follows it."""
    n, method = len(model.layout.state), "" if phase.runner is None else phase.runner.method
    rows = phase.steps if phase.rows else np.empty((0, FIRST_AT + 6 * n))
    if len(rows):
        t, y, output = _recorded(rows, n, phase.t0, method, acts)
    else:
        t = np.array([phase.t0])
        y = modes.states(phase.mode, t, phase.x[np.newaxis], constants_at(c, t).reshape(1, -1))
        output = PiecewisePolynomial(np.array([phase.t0, phase.t0]), y.reshape(1, 1, n))
    counted = rows[:, ATTEMPTS_AT].tolist()  # anew behind every stop
    attempts = int(sum(a for a, b in pairwise([*counted, 0.0]) if b <= a))
    stats = RunStatistics(method, len(rows), attempts - len(rows), attempts, model.stages.compile_seconds, 0.0, "")
    about = output if dense else None, phase.t1, model.stages.scene, model.monitors
    run = Trajectory((Part(model.stages.program, c, t, y, *about),), status, stats)
    if model.derived.signed:
        warn_of_motion(model.layout.assumptions, model.derived.signed, run.t, run.__getitem__)
    if not labels:
        return run
    return run.with_events(event_records(labels, _occurrences(model, phase, c, len(labels), output, y[-1]), run))


def _joined_runs(runs: Sequence[Trajectory], labels: Sequence[str], *, right: bool) -> Trajectory:
    """Return one motion from runs of one program, each of which continues the one before with other constants.

    Parameters
    ----------
    runs : sequence of Trajectory
    labels : sequence of str
        Names of the events that are kept.
    right : bool
        Whether steps hold the states behind the joints, not those before them.
    """
    if len(runs) == 1:
        return runs[0]
    parts = [run.parts[0] for run in runs]
    first, last = parts[0], parts[-1]
    solutions = [
        Solution(
            status=run.status,
            t=part.t,
            y=part.y,
            steps=run.stats.steps,
            rejected=run.stats.rejected,
            evaluations=run.stats.evaluations,
            dense=part.dense,
            wrapped=part.wrapped,
        )
        for run, part in zip(runs, parts, strict=True)
    ]
    whole = joined(solutions, recorded=False, right=right)
    edges = np.array([part.t[0] for part in parts] + [last.t[-1]])
    c = Segments(edges, np.array([constants_at(part.c, part.t[:1]).reshape(-1) for part in parts]))
    stats = replace(runs[-1].stats, steps=whole.steps, rejected=whole.rejected, evaluations=whole.evaluations)
    about = last.end, first.scene, first.monitors, whole.wrapped
    found = Trajectory((Part(first.program, c, whole.t, whole.y, whole.dense, *about),), runs[-1].status, stats)
    occurrences = [
        Occurrence(e, float(t), before, after, int(sign))
        for run in runs
        for e, record in enumerate(run.events[label] for label in labels)
        for t, before, after, sign in zip(record.t, record.before.y, record.after.y, record.direction, strict=True)
    ]
    in_order = sorted(occurrences, key=lambda one: abs(one.t - first.t[0]))
    return found.with_events(event_records(labels, in_order, found))


def _recorded(
    rows: FloatArray, n: int, t0: float, method: str, acts: bool
) -> tuple[FloatArray, FloatArray, PiecewisePolynomial]:
    """Return times, states (k + 1, n) and the continuous output of recorded steps from a start on."""
    polynomials = rows[:, FIRST_AT + 2 * n :].reshape(len(rows), n, -1)
    t, y = np.empty(len(rows) + 1), np.empty((len(rows) + 1, n))
    t[0], t[1:] = t0, rows[:, ENDED_AT]
    y[0], y[1:] = polynomials[0, :, 0], rows[:, FIRST_AT + n : FIRST_AT + 2 * n]
    if acts:
        y[1:-1] = polynomials[1:, :, 0]
    return t, y, PiecewisePolynomial(t, partial(step_polynomials, rows, n, in_time=method == "taylor"))


def _occurrences(
    model: CompiledModel, phase: RecordedPhase, c: Constants, count: int, output: PiecewisePolynomial, last: FloatArray
) -> list[Occurrence]:
    """Return the occurrences of the first events, `count` in number, in a phase that ends in the state `last`."""
    found = [(int(e), t, int(sign)) for e, t, sign in phase.occurrences[:, :3].tolist() if e < count]
    if not found:
        return []
    low, high = sorted((phase.t0, phase.t1))
    times = np.clip(np.array([t for _, t, _ in found]), low, high)
    states = projected(model.stages.program, c, times, output(times))
    states[times == phase.t1] = last
    listed = zip(found, times.tolist(), states, strict=True)
    return [Occurrence(e, at, own, own, sign) for (e, _, sign), at, own in listed]
