"""Motions of recorded phases: [RecordedPhase] -> [Trajectory]."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...arrays import FloatArray
from ...integrators.dense_output import PiecewisePolynomial
from ...integrators.projected_states import projected
from ...integrators.segments import Constants, Segments, constants_at
from ...integrators.step_records import ATTEMPTS_AT, END_AT, ENDED_AT, FIRST_AT, START_AT
from ...integrators.watched import Occurrence
from ...integrators.workspace import ROUNDING
from ...ir.conditions import CONDITION_TIME
from ...methods.status import Status
from ...options import SimulateOptions
from ...results.motion import RunStatistics
from ...results.trajectory import Trajectory, joined_runs
from .. import inputs
from ..symbol_assumptions import warn_of_motion
from .mode_models import ModeModels
from .motion_recorder import RecordedPhase
from .request import MotionRequest
from .stops import Stops

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["trajectories"]


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
    found = [joined_runs(phase.runs, labels, right=acts) if phase.runs else None for phase in phases]
    for mode in dict.fromkeys(phase.mode for phase in phases if not phase.runs):
        some = [i for i, phase in enumerate(phases) if phase.mode == mode and not phase.runs]
        model = modes.model(mode)
        p = np.array([phases[i].parameters(modes, request.parameters) for i in some]).reshape(len(some), -1)
        c: Iterable[Constants] = inputs.prepare_rows(model.stages.program, p) if stops is None else ()
        if stops is not None:
            c = [_constants_along(model, phases[i], own, stops) for i, own in zip(some, p, strict=True)]
        for row, i in zip(c, some, strict=True):
            ended = status if i == len(phases) - 1 else Status.SUCCESS
            found[i] = _trajectory(modes, model, phases[i], row, ended, labels, dense, acts)
    return [motion for motion in found if motion is not None]


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
    n, program = len(model.layout.state), model.stages.program
    rows = phase.steps if phase.rows else np.empty((0, FIRST_AT + 6 * n))
    polynomials = rows[:, FIRST_AT + 2 * n :].reshape(len(rows), n, -1) if len(rows) else np.empty((0, n, 4))
    if len(rows):
        first = polynomials[0, :, 0]
    else:
        begin = np.array([phase.t0])
        first = modes.states(phase.mode, begin, phase.x[np.newaxis], constants_at(c, begin).reshape(1, -1))[0]
    t = np.concatenate([[phase.t0], rows[:, ENDED_AT]])
    y = np.concatenate([first[np.newaxis], rows[:, FIRST_AT + n : FIRST_AT + 2 * n]])
    if acts and len(rows) > 1:
        y[1:-1] = polynomials[1:, :, 0]
    method = "" if phase.runner is None else phase.runner.method
    if len(rows):
        output = PiecewisePolynomial(t, partial(_coefficients, rows, polynomials, in_time=method == "taylor"))
    else:
        output = PiecewisePolynomial(np.array([phase.t0, phase.t0]), first.reshape(1, 1, n))
    counted = rows[:, ATTEMPTS_AT]  # anew behind every stop
    attempts = int(counted[np.append(counted[1:] <= counted[:-1], True)].sum()) if len(rows) else 0
    stats = RunStatistics(method, len(rows), attempts - len(rows), attempts, model.stages.compile_seconds, 0.0, "")
    run = Trajectory(program, c, status, t, y, stats, output if dense else None)
    run.ended_at(phase.t1)
    if model.derived.signed:
        warn_of_motion(model.layout.assumptions, model.derived.signed, run.t, run.__getitem__)
    run.with_monitors(model.monitors).of_scene(model.stages.scene)
    if not labels:
        return run
    found = [(int(e), t, int(sign)) for e, t, sign in phase.occurrences.tolist() if e < len(labels)]
    low, high = sorted((phase.t0, phase.t1))
    times = np.clip(np.array([t for _, t, _ in found]), low, high)
    states = projected(program, c, times, output(times)) if found else np.empty((0, n))
    states[times == phase.t1] = y[-1]
    listed = zip(found, times.tolist(), states, strict=True)
    return run.with_events(labels, [Occurrence(e, at, own, own, sign) for (e, _, sign), at, own in listed])


def _coefficients(rows: FloatArray, polynomials: FloatArray, *, in_time: bool) -> FloatArray:
    """Return coefficients (k, degree + 1, n_y) in the fraction of each step, up to where events cut it.

    As where events are searched, polynomials end in the states in which the steps ended.
    """
    n, terms = polynomials.shape[1:]
    whole, powers = (rows[:, END_AT] - rows[:, START_AT])[:, np.newaxis], np.arange(terms)
    found = polynomials * (whole**powers)[:, np.newaxis] if in_time else polynomials.copy()
    gap = rows[:, FIRST_AT : FIRST_AT + n] - found.sum(axis=2)
    gap[np.abs(gap) <= ROUNDING * np.abs(found).sum(axis=2)] = 0.0
    found[:, :, 2] += 3.0 * gap
    found[:, :, 3] -= 2.0 * gap
    share = (rows[:, ENDED_AT] - rows[:, START_AT])[:, np.newaxis] / whole
    found *= (share**powers)[:, np.newaxis]
    return np.ascontiguousarray(found.transpose(0, 2, 1))
