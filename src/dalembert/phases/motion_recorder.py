"""Requests of motions with contacts, and records of one motion by the loop over phases."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Generic, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..contacts.equations.contact_laws import Mode
from ..contacts.phase_tables import NO_RUNNER
from ..frozen import frozen
from ..lanes.step_records import ENDED_AT, START_AT
from ..lanes.workspace import OCCURRENCE
from ..methods.status import Status
from ..options import SimulateOptions, SweepOptions
from ..results.trajectory import Trajectory
from ..threads import check
from .case_runs import CaseRuns
from .host_runners import HostMode
from .mode_models import ModeModels
from .mode_runners import ModeRunner
from .output_values import PhaseReductions
from .runner_choice import RunnerChoice
from .stops import Stops, stops_of
from .velocity_jumps import EventJumps

OptionsT = TypeVar("OptionsT", SimulateOptions, SweepOptions)
KeptT = TypeVar("KeptT")


@final
@frozen(eq=False)
class MotionRequest(Generic[OptionsT]):
    """Request of one motion, or of the cases of a sweep.

    Attributes
    ----------
    modes : ModeModels
    t0, t1 : ndarray (k,)
        Spans [s].
    x : ndarray (k, 2 n_q + n_z)
        Consistent coordinates, rates and first-order states to start from.
    p : ndarray (k, n_p)
        Parameters in the order of the scene.
    status : ndarray (k,) of int
        Of cases that cannot start; RUNNING for the others.
    options : SimulateOptions or SweepOptions
        As `simulate` or `sweep` was given them, with checked `t_eval` and `threads`.
    reductions : PhaseReductions
        With the events that users watch.
    """

    modes: ModeModels
    t0: FloatArray
    t1: FloatArray
    x: FloatArray
    p: FloatArray
    status: NDArray[np.int64]
    options: OptionsT
    reductions: PhaseReductions

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Parameters of the first case by name."""
        return dict(zip(self.modes.layout.parameters, self.p[0].tolist(), strict=True))

    def stops(self, *, many: bool = False) -> Stops | None:
        """Return where the cases stop, see `stops_of`; None where they do not."""
        options, spans = self.options, (self.t0, self.t1)
        return stops_of(self.modes, options.inputs, self.p, spans, options.t_eval, many=many)

    @cached_property
    def jumps(self) -> EventJumps:
        """Maps of the state by the events that users watch."""
        return EventJumps(self.modes, self.reductions.requested)

    @property
    def labels(self) -> list[str]:
        """Names of the events that users watch."""
        return [event.label for event in self.reductions.requested]


_MOST_KEPT, _MOST_STATES = 16, 1 << 13
"""Sets of options and events whose recorders and runs are kept, and the most states of cases in such runs."""


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
    added : ndarray (4 n_contacts,)
        Parameters that the contacts add (`ContactCases.added`).
    runner : ModeRunner, HostRunner or None
        What ran it; None where it took no time.
    rows : list of ndarray (k, ...)
        Records of its steps (`dalembert.lanes.step_records`).
    runs : list of Trajectory
        Its motion from stop to stop, where Python ran it.
    occurrences : ndarray (m, OCCURRENCE)
        What occurred in it: event, time, sign and more (`dalembert.lanes.workspace.OCCURRENCE`).
    after : ndarray (2 n_q + n_z,) or None
        The same after the jump that ended it.
    """

    t0: float
    t1: float
    mode: Mode
    x: FloatArray
    added: FloatArray
    runner: ModeRunner | HostMode | None = None
    rows: list[FloatArray] = field(default_factory=list)
    runs: list[Trajectory] = field(default_factory=list)
    occurrences: FloatArray = field(default_factory=lambda: np.empty((0, OCCURRENCE)))
    after: FloatArray | None = None

    @property
    def steps(self) -> FloatArray:
        """All records of steps (k, ...)."""
        return self.rows[0] if len(self.rows) == 1 else np.concatenate(self.rows)


@contextmanager
def _kept(modes: ModeModels, key: str, make: Callable[[], KeptT]) -> Iterator[KeptT]:
    """Context with what a model keeps for the next request of the same key; what an error has left is not kept."""
    if len(modes.recorders) >= _MOST_KEPT and key not in modes.recorders:
        modes.recorders.clear()
    kept = modes.recorders.setdefault(key, [])
    try:
        found: KeptT = kept.pop()
    except IndexError:
        found = make()
    yield found
    kept.append(found)


@contextmanager
def recorder_of(request: MotionRequest[SimulateOptions]) -> Iterator[MotionRecorder]:
    """Context with a recorder for a request, which is kept for the next one with the same options and events."""
    options, events, modes = request.options, request.reductions, request.modes
    dense = options.dense or options.t_eval is not None
    steps = options.method, options.rtol, options.atol, options.max_step, options.max_steps, dense

    def make() -> MotionRecorder:
        own = replace(options, dense=dense, t_eval=None, events=(), inputs=None, progress=False, error_estimate=False)
        return MotionRecorder(RunnerChoice(modes, own, events, fits=True, recorded=True))

    with _kept(modes, repr((*steps, events.requested)), make) as recorder:
        yield recorder


@contextmanager
def runs_of(request: MotionRequest[SweepOptions], *, stops: bool) -> Iterator[CaseRuns]:
    """Context with the runs of a sweep, kept for the next one of as many cases with the same options and events.

    Not kept are those of many cases, where memory counts and not the time to make it, and those with `stops`.
    """
    options, modes, count = request.options, request.modes, len(request.t0)
    times = 0 if options.t_eval is None else len(options.t_eval)
    again = not stops and options.chosen is None and count * (1 + times) <= _MOST_STATES
    assert options.threads is not None

    def make() -> CaseRuns:
        chosen = None if options.chosen is None else options.method_chosen
        choice = RunnerChoice(modes, options, request.reductions, fits=options.fits, chosen=chosen)
        about = {"threads": options.threads, "t_eval": options.t_eval, "origin": options.origin}
        return CaseRuns(choice, count, repeats=again, **about)

    if not again:
        yield make()
        return
    steps = options.method, options.rtol, options.atol, options.max_step, options.max_steps, options.origin
    sampled = None if options.t_eval is None else options.t_eval.tobytes()
    watched = request.reductions.requested, dict(request.reductions.table)
    with _kept(modes, repr((*steps, options.threads, count, sampled, watched)), make) as runs:
        yield runs


@final
class MotionRecorder:
    """Runs motions and records them, one after the other.

    Parameters
    ----------
    choice : RunnerChoice
        Runners of one motion that is recorded.

    Attributes
    ----------
    case : CaseRuns
        The motion.
    note : str
        What Python noted of its end.
    """

    def __init__(self, choice: RunnerChoice) -> None:
        self.case = CaseRuns(choice)
        self.note = ""
        self._phases: list[RecordedPhase] = []
        self._rows: list[tuple[ModeRunner, FloatArray]] = []
        self._runs: list[tuple[HostMode, Trajectory]] = []
        self._occurrences: list[FloatArray] = []

    def run(self, request: MotionRequest[SimulateOptions], stops: Stops | None) -> list[RecordedPhase]:
        """Run the requested motion; return its phases.

        Where more has occurred in one step than there were rows for, it is run again with more of them.
        """
        span, rows = (float(request.t0[0]), float(request.t1[0])), 0
        while rows != self.case.choice.rows:
            rows = self.case.choice.rows
            self._phases, self._rows, self._runs, self._occurrences = [], [], [], []
            self.case.begin(*span, request.x, request.p, stops, request.options.first_step)
            self.case.run(request.jumps, paused=self._take, jumped=self._jumped)
            if rows != self.case.choice.rows:
                self.case.executor.forget_memory()
        if self.case.status is Status.EVENT_STATE:  # the map did not take place
            self._jumped()
        self._sort()
        self.note = self._runs[-1][1].stats.note if self._runs else ""
        return self._phases

    def _take(self) -> None:
        """Take what the loop has recorded so far."""
        numbers, runners, calls = self.case.numbers, self.case.choice.runners, self.case.executor.calls
        if numbers.logged[0]:
            width, automaton = self.case.cases.added.shape[1], self.case.choice.modes.automaton
            for line in self.case.log[: int(numbers.logged[0])].copy():
                t, mode = line[0].item(), automaton.mode(int(line[1]))
                self._phases.append(RecordedPhase(t, t, mode, x=line[2 + width :], added=line[2 : 2 + width]))
            numbers.logged[0] = 0
        for runner, call in zip(runners, calls, strict=False):
            if isinstance(runner, HostMode):
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
                if occurred >= len(call.occurrences):
                    self.case.choice.rows = max(self.case.choice.rows, 2 * occurred)

    def _jumped(self) -> None:
        self._phases[-1].after = self.case.cases.x[0].copy()

    def _sort(self) -> None:
        """Give every phase its end, its steps, and what occurred in it."""
        numbers = self.case.numbers
        if self.case.status is Status.PROJECTION_FAILED and numbers.runner[0] == NO_RUNNER and len(self._phases) > 1:
            self._phases.pop()  # the phase that could not start
        if not self._phases:
            return
        for phase, following in zip(self._phases, self._phases[1:], strict=False):
            phase.t1 = following.t0
        self._phases[-1].t1 = float(self.case.cases.t[0])
        forward = 1.0 if self._phases[-1].t1 >= self._phases[0].t0 else -1.0
        begins = forward * np.array([phase.t0 for phase in self._phases])
        for runner, recorded in self._rows:
            lasting = recorded[:, ENDED_AT] != recorded[:, START_AT]  # others are of phases that took no time
            rows = recorded if lasting.all() else recorded[lasting]
            places = np.searchsorted(begins, forward * rows[:, START_AT], side="right") - 1
            for place, some in _in_a_row(places):
                phase = self._phases[place]
                phase.runner = runner
                phase.rows.append(rows[some])
        for k, (host, run) in enumerate(self._runs, 1):
            place = int(np.searchsorted(begins, forward * run.t[0], side="right")) - 1
            if run.t[-1] != run.t[0] or (k == len(self._runs) and self._phases[place].mode == host.mode):
                self._phases[place].runner = host
                self._phases[place].runs.append(run)
        if self._occurrences:
            found = np.concatenate(self._occurrences)
            found = found[np.argsort(forward * found[:, 1], kind="stable")]
            places = np.maximum(np.searchsorted(begins, forward * found[:, 1], side="left") - 1, 0)
            for place, some in _in_a_row(places):
                self._phases[place].occurrences = found[some]


def _in_a_row(places: NDArray[np.intp]) -> Iterator[tuple[int, slice]]:
    """Yield the equal numbers that follow each other in some (k,), with where they are."""
    edges = [*np.flatnonzero(np.diff(places, prepend=-1)).tolist(), len(places)]
    for first, last in itertools.pairwise(edges):
        yield int(places[first]), slice(first, last)
