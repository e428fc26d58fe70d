"""Motions of cases with contacts, one or many, run to their ends by the loop over phases."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.host_code import raise_failure
from ..codegen.llvm.loops import loop_named
from ..contacts.contact_cases import ADDED, UNDECIDED, contact_cases
from ..contacts.phase_maps import MAP, REFUSE, EventMaps, MapArguments
from ..contacts.phase_stops import no_phase_stops
from ..contacts.phase_tables import JUMPS, NOT_STARTED, CaseSamples, CaseTable, case_numbers
from ..events.event_rules import last_instants
from ..lanes.cases import BlockResult
from ..methods.status import RUNNING, Status
from ..results.sweep_states import NO_MODE, SweepStates
from ..runs.run_check import FAILED
from ..runs.sampling import diverged, free_places
from .output_values import OutputValues
from .phases import PhaseExecutor
from .runner_choice import RunnerChoice
from .stops import Stops
from .velocity_jumps import EventJumps

_BROKEN = np.isin(np.arange(max(Status) + 2), FAILED)
"""Whether a run with a status may have failed for its contacts, by status; the last is for RUNNING, which is -1."""


_LINES = 256
"""Phases after which a run that is recorded returns to Python."""


@final
class CaseRuns:
    """Cases that are run from their starts to their ends, and what is recorded of them.

    A single run is one case whose phases and steps are recorded, a prepared run one case without records that begins
    again and again in the same memory, a sweep many cases.

    Parameters
    ----------
    choice : RunnerChoice
        The runners of the modes.
    count : int
        Number of cases.
    threads : int
        0 for one case that runs in the thread that calls.
    repeats : bool
        Whether they may begin again and again; their results are overwritten then.
    t_eval : ndarray (m,) or None
        Times of samples [s].
    origin : float
        Time from which times are counted [s].

    Attributes
    ----------
    cases : ContactCases
        The cases as they are.
    samples : States
        Samples, case by case.
    log : ndarray (n_lines, n)
        Beginnings of the phases of a case that is recorded.
    executor : PhaseExecutor
    first : ndarray (k, 2 n_q + n_z) or None
        The states in which the cases began, where controllers act.
    """

    def __init__(
        self,
        choice: RunnerChoice,
        count: int = 1,
        *,
        threads: int = 0,
        repeats: bool = True,
        t_eval: FloatArray | None = None,
        origin: float = 0.0,
    ) -> None:
        self.choice, layout, lines = choice, choice.modes.layout, _LINES if choice.recorded else 0
        k, n, n_p = len(choice.modes.equations.contacts), len(layout.variables), len(layout.parameters)
        times = np.empty(0) if t_eval is None else np.ascontiguousarray(t_eval, np.float64)
        t, x, p = np.zeros(count), np.zeros((count, n)), np.zeros((count, n_p))
        self.cases = contact_cases(t, x, p, t, k, len(layout.states))
        self.samples = samples = SweepStates.empty(count * len(times), n, ADDED * k)
        self.log, self.numbers = np.empty((lines, 2 + ADDED * k + n)), case_numbers(count)
        self.occurred, self.totals = choice.reductions.at_start(count)
        none = np.zeros(0, np.int64)
        self._table = CaseTable(
            t0=np.zeros(count),
            t1=np.zeros(count),
            cases=self.cases,
            numbers=self.numbers,
            occurred=self.occurred,
            totals=self.totals,
            order=none,
            turn=none,
            t_eval=times,
            t_last=last_instants(times, origin),
            samples=CaseSamples(samples.t, samples.x, samples.added, samples.mode, samples.history),
            log=self.log,
            stops=no_phase_stops(),
            carried=np.zeros((0, 0)),
        )
        self.executor = PhaseExecutor(choice, self._table, threads)
        recorded = (*self.cases, *self.numbers, self.occurred, self.totals, *samples.arrays())
        changing, self._anew = recorded if repeats else (), bool(threads)
        self.first: FloatArray | None = None
        self._maps: EventMaps | None = None
        self._initial = [(values, values.copy()) for values in changing if values.size]

    def begin(
        self,
        t0: float | FloatArray,
        t1: float | FloatArray,
        x: FloatArray,
        p: FloatArray,
        stops: Stops | None = None,
        first_step: float | None = None,
    ) -> None:
        """Begin the cases, whose modes are to be selected.

        Parameters
        ----------
        t0, t1 : float or ndarray (k,)
            Spans [s].
        x : ndarray (k, 2 n_q + n_z) or (2 n_q + n_z,)
            Coordinates, rates and first-order states.
        p : ndarray (k, n_p) or (n_p,)
            Parameters of the scene.
        stops : Stops or None
            Times at which the cases stop.
        first_step : float or None
            Size of the first step of one case that is recorded; None where it is to be chosen.
        """
        for values, first in self._initial:
            values[...] = first
        cases, table, self._maps = self.cases, self._table, None
        cases.t[...] = table.t0[...] = t0
        table.t1[...], cases.span[...] = t1, t1 - t0
        cases.x[...], cases.p[...] = x, p
        if self.choice.modes.equations.controllers:
            self.first = cases.x.copy()
        self.numbers.state[...], self.numbers.runner[...] = RUNNING, NOT_STARTED
        self.executor.begin(None if stops is None else stops.table)
        self.choice.begin(first_step, anew=self._anew)

    @property
    def status(self) -> Status:
        """The status with which the only case ended."""
        return Status(int(self.numbers.state[0]))

    def running(self) -> NDArray[np.intp]:
        """Return the cases that have not ended."""
        return np.flatnonzero(self.numbers.state == RUNNING)

    def run(
        self,
        jumps: EventJumps | None = None,
        *,
        together: int | None = None,
        paused: Callable[[], None] | None = None,
        jumped: Callable[[], None] | None = None,
        advance: Callable[[int], object] | None = None,
    ) -> None:
        """Run the cases to their ends.

        Parameters
        ----------
        jumps : EventJumps, optional
            Maps of the state by events.
        together : int, optional
            Cases that run before `advance` is called; all by default.
        paused : function, optional
            Called whenever the loop has returned.
        jumped : function, optional
            Called when states have jumped.
        advance : function, optional
            Called with the number of cases that have ended since its last call.
        """
        try:
            while len(running := self.running()):
                self.executor.run(running[:together], paused)
                if paused is not None:
                    paused()
                if np.any((self.numbers.state == RUNNING) & (self.numbers.runner == JUMPS)):
                    self._mapped(jumps, MAP)
                    if jumped is not None:
                        jumped()
                if advance is not None:
                    advance(len(running) - len(self.running()))
        finally:
            if self._maps is not None:
                self._mapped(jumps, REFUSE)
            self._mark_failures()
            self._mark_divergence()

    def _mapped(self, jumps: EventJumps | None, task: int) -> None:
        """Map the states of cases in which events have occurred that do so, which begin anew; or undo such maps."""
        if self._maps is None:
            assert jumps is not None
            self._maps = jumps.maps(len(self.numbers.state))
        loop_named("map_loop")(MapArguments(self.executor.table, self._maps, task))
        raise_failure()

    def _mark_failures(self) -> None:
        """Distinguish failures at kinks of gaps and near Painleve's paradox from others."""
        broken = np.flatnonzero(_BROKEN[self.numbers.state])
        if len(broken):
            values = OutputValues(self.choice.modes, self.cases.p)
            states = self.states(broken)
            kinked = values.at_kinks(states)
            self.numbers.state[broken[kinked]] = int(Status.CONTACT_UNSUPPORTED)
            jammed = ~kinked & values.jammed(states) & (self.numbers.state[broken] != Status.PROJECTION_FAILED)
            self.numbers.state[broken[jammed]] = int(Status.CONTACT_IMPOSSIBLE)

    def _mark_divergence(self) -> None:
        """Distinguish failures of loops with controllers that are unstable from others."""
        if self.first is not None:
            free = free_places(self.choice.modes.layout)
            grown = diverged(self.numbers.state, self.first[:, free], self.cases.x[:, free])
            self.numbers.state[grown] = int(Status.DIVERGED)

    def interrupt(self) -> None:
        """Set the status of cases that an interrupt has stopped, or kept from running, and NaN for their results."""
        some, numbers = self.running(), self.numbers
        numbers.state[some], numbers.steps[some], numbers.phases[some] = int(Status.INTERRUPTED), 0, 0
        self.cases.t[some] = np.nan
        self.drop_results(some)
        self.occurred[some] = BlockResult.at_start(len(some), self.occurred.shape[1] // 3, ())[0]

    def drop_results(self, some: NDArray[np.intp]) -> None:
        """Set NaN for the results of some cases."""
        samples, width = self.samples, len(self.samples.t) // max(len(self.numbers.state), 1)
        rows = (some[:, np.newaxis] * width + np.arange(width)).ravel()
        self.cases.x[some], self.cases.number[some] = np.nan, UNDECIDED
        samples.t[rows], samples.x[rows], samples.mode[rows] = np.nan, np.nan, NO_MODE

    @property
    def samples_taken(self) -> SweepStates:
        """The samples, a copy of their own where the cases may begin again."""
        samples = self.samples
        return SweepStates(*(values.copy() for values in samples.arrays())) if self._initial else samples

    def states(self, some: NDArray[np.intp]) -> SweepStates:
        """Return the states of some cases as they are."""
        cases = self.cases
        about = cases.number[some], self.numbers.history[some], cases.added[some]
        return SweepStates(cases.t[some], cases.x[some], some, *about)
