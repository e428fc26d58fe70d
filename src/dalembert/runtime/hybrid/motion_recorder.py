"""Records of one motion with contacts by the loop over phases, and the trajectories of its phases."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, final

import numpy as np

from ...arrays import FloatArray
from ...hybrid import Mode
from ...hybrid.modes import STATES
from ...integrators.dense_output import PiecewisePolynomial
from ...integrators.event_code import Event
from ...integrators.events import Occurrence
from ...integrators.projected_states import projected
from ...integrators.segments import Constants, Segments, constants_at
from ...integrators.step_records import ATTEMPTS_AT, END_AT, ENDED_AT, FIRST_AT, START_AT
from ...integrators.workspace import ROUNDING
from ...interrupts import check
from ...ir.conditions import CONDITION_TIME
from ...ir.program import Layout
from ...methods.status import Status
from ...options import SimulateOptions
from ...results.motion import RunStatistics
from ...results.trajectory import Trajectory, joined_runs
from .. import inputs
from ..symbol_assumptions import warn_of_motion
from .event_jumps import EventJumps
from .host_runners import HostRunner
from .lone_case import LoneCase
from .mode_models import ModeModels
from .mode_runners import ModeRunner
from .reductions import PhaseReductions
from .stops import Stops

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["MotionRecorder", "RecordedPhase", "trajectories"]

_MOST_KEPT = 16
"""Sets of options and events whose recorders are kept."""

_LINES = 256
"""Phases after which the loop returns to Python."""


@final
@dataclass(eq=False)
class RecordedPhase:
    """The record of a phase.

    Attributes
    ----------
    t0, t1 : float
        Its span [s].
    mode : Mode
    x : ndarray (2 n_q + n_z,)
        Coordinates, rates and first-order states where it begins.
    directions, sides, rest : ndarray (n_contacts, 2), (n_contacts,), (n_contacts,)
        Directions of slip, signs of normal reactions and rest speeds.
    runner : ModeRunner, HostRunner or None
        What ran it; None where it took no time.
    rows : list of ndarray (k, ...)
        Records of its steps (`dalembert.integrators.step_records`).
    runs : list of Trajectory
        Its motion from stop to stop, where Python ran it.
    occurrences : ndarray (m, 3)
        Event, time and sign of what occurred in it.
    after : ndarray (2 n_q + n_z,) or None
        The same after the jump that ended it.
    """

    t0: float
    t1: float
    mode: Mode
    x: FloatArray
    directions: FloatArray
    sides: FloatArray
    rest: FloatArray
    runner: ModeRunner | HostRunner | None = None
    rows: list[FloatArray] = field(default_factory=list)
    runs: list[Trajectory] = field(default_factory=list)
    occurrences: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    after: FloatArray | None = None

    @property
    def steps(self) -> FloatArray:
        """All records of steps (k, ...)."""
        return self.rows[0] if len(self.rows) == 1 else np.concatenate(self.rows)

    def parameters(self, modes: ModeModels, given: Mapping[str, float]) -> list[float]:
        """Return the parameters of the model of its mode."""
        layout = modes.model(self.mode).layout
        values = {**layout.defaults, **given, **modes.added(self.mode, self.directions, self.sides, self.rest)}
        return [float(values[name]) for name in layout.parameters]


@contextmanager
def recorder_of(
    modes: ModeModels, layout: Layout, options: SimulateOptions, events: Sequence[Event], stops: Stops | None
) -> Iterator[MotionRecorder]:
    """Context with a recorder for these options and events, which is kept for the next run that is given the same."""
    dense = options.dense or options.t_eval is not None
    steps = options.method, options.rtol, options.atol, options.max_step, options.max_steps, options.first_step, dense
    key = repr((*steps, tuple(events), stops is not None))
    if len(modes.recorders) >= _MOST_KEPT and key not in modes.recorders:
        modes.recorders.clear()
    kept = modes.recorders.setdefault(key, [])
    try:
        recorder = kept.pop()
    except IndexError:
        own = replace(options, dense=dense, t_eval=None, events=(), inputs=None, progress=False, error_estimate=False)
        recorder = MotionRecorder(modes, layout, own, PhaseReductions({}, tuple(events)))
    recorder.case.stop_at(stops)
    yield recorder
    kept.append(recorder)


@final
class MotionRecorder:
    """Runs motions and records them, one after the other.

    Parameters
    ----------
    modes : ModeModels
    layout : Layout
        Of the scene.
    options : SimulateOptions
        Method, tolerances, first and largest step, number of steps, and whether the motion is to be evaluated later.
    watched : PhaseReductions
        The events that users watch.
    """

    def __init__(self, modes: ModeModels, layout: Layout, options: SimulateOptions, watched: PhaseReductions) -> None:
        known = modes, layout, options, watched
        self.case = LoneCase(*known, lines=_LINES, fits=True, first_step=options.first_step)
        self._modes, self.note = modes, ""
        self._phases: list[RecordedPhase] = []
        self._rows: list[tuple[ModeRunner, FloatArray]] = []
        self._runs: list[tuple[HostRunner, Trajectory]] = []
        self._occurrences: list[FloatArray] = []

    def run(self, jumps: EventJumps) -> list[RecordedPhase]:
        """Run the motion that `case` has begun; return its phases. What Python notes of its end is in `note`."""
        self._phases, self._rows, self._runs, self._occurrences = [], [], [], []
        self.case.run(jumps, self._take, self._jumped)
        self._take()
        self._sort()
        self.note = self._runs[-1][1].stats.note if self._runs else ""
        return self._phases

    def _take(self) -> None:
        """Take what the loop has recorded so far."""
        numbers, executor = self.case.table.numbers, self.case.executor
        if numbers.logged[0]:
            self._take_lines(self.case.log[: int(numbers.logged[0])].copy())
            numbers.logged[0] = 0
        for runner, call in zip(executor.runners, executor.calls, strict=False):
            if isinstance(runner, HostRunner):
                self._runs += [(runner, run) for run in runner.runs]
                runner.runs.clear()
                continue
            count, occurred = call.progress.recorded, int(call.occurrences[0, 0])
            if count:
                self._rows.append((runner, call.steps[:count].copy()))
                check(call.steps[count - 1, ENDED_AT].item())
                call.progress.recorded = 0
            if occurred:
                self._occurrences.append(call.occurrences[1 : 1 + occurred].copy())
                call.occurrences[0, 0] = 0.0

    def _take_lines(self, lines: FloatArray) -> None:
        """Take lines of the log (n, ...): beginnings of phases."""
        k, first = len(self._modes.equations.contacts), 2
        modes = [tuple(STATES[number] for number in row) for row in lines[:, first : first + k].astype(int).tolist()]
        directions = lines[:, first + k : first + 3 * k].reshape(len(lines), k, 2)
        sides, rest = lines[:, first + 3 * k : first + 4 * k], lines[:, first + 4 * k : first + 5 * k]
        for i, (t, mode) in enumerate(zip(lines[:, 0].tolist(), modes, strict=True)):
            self._phases.append(RecordedPhase(t, t, mode, lines[i, first + 5 * k :], directions[i], sides[i], rest[i]))

    def _jumped(self) -> None:
        self._phases[-1].after = self.case.state.x[0].copy()

    def _sort(self) -> None:
        """Give every phase its end, its steps, and what occurred in it."""
        if not self._phases:
            return
        for phase, following in zip(self._phases, self._phases[1:], strict=False):
            phase.t1 = following.t0
        self._phases[-1].t1 = float(self.case.state.t[0])
        forward = 1.0 if self._phases[-1].t1 >= self._phases[0].t0 else -1.0
        begins = forward * np.array([phase.t0 for phase in self._phases])
        for runner, recorded in self._rows:
            rows = recorded[recorded[:, ENDED_AT] != recorded[:, START_AT]]  # others are of phases that took no time
            places = np.searchsorted(begins, forward * rows[:, START_AT], side="right") - 1
            for place in np.unique(places):
                phase = self._phases[place]
                phase.runner = runner
                phase.rows.append(rows[places == place])
        for k, (host, run) in enumerate(self._runs, 1):
            place = int(np.searchsorted(begins, forward * run.t[0], side="right")) - 1
            if run.t[-1] != run.t[0] or (k == len(self._runs) and self._phases[place].mode == host.mode):
                self._phases[place].runner = host
                self._phases[place].runs.append(run)
        if self._occurrences:
            found = np.concatenate(self._occurrences)
            found = found[np.argsort(forward * found[:, 1], kind="stable")]
            places = np.maximum(np.searchsorted(begins, forward * found[:, 1], side="left") - 1, 0)
            for place in np.unique(places):
                self._phases[place].occurrences = found[places == place]


def trajectories(
    modes: ModeModels,
    phases: Sequence[RecordedPhase],
    given: Mapping[str, float],
    status: Status,
    labels: Sequence[str],
    stops: Stops | None,
    *,
    dense: bool,
) -> list[Trajectory]:
    """Return the motions of recorded phases, with their events.

    Parameters
    ----------
    modes : ModeModels
    phases : sequence of RecordedPhase
    given : mapping of str to float
        Parameters of the scene.
    status : Status
        How the last of them ended.
    labels : sequence of str
        Names of the events that users watch.
    stops : Stops or None
        Where constants change, and controllers act, within phases.
    dense : bool
        Whether they can be evaluated between their steps.
    """
    acts = stops is not None and stops.acts
    found = [joined_runs(phase.runs, labels, right=acts) if phase.runs else None for phase in phases]
    for mode in dict.fromkeys(phase.mode for phase in phases if not phase.runs):
        some = [i for i, phase in enumerate(phases) if phase.mode == mode and not phase.runs]
        model = modes.model(mode)
        p = np.array([phases[i].parameters(modes, given) for i in some]).reshape(len(some), -1)
        c: Iterable[Constants] = inputs.prepare_rows(model.stages.program, p) if stops is None else ()
        if stops is not None:
            c = [_course(model, phases[i], own, stops) for i, own in zip(some, p, strict=True)]
        for row, i in zip(c, some, strict=True):
            ended = status if i == len(phases) - 1 else Status.SUCCESS
            found[i] = _trajectory(modes, model, phases[i], row, ended, labels, dense, acts)
    return [motion for motion in found if motion is not None]


def _course(model: CompiledModel, phase: RecordedPhase, p: FloatArray, stops: Stops) -> Segments:
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
