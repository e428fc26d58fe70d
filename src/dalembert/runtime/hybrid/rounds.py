"""Cases of a sweep with contacts, and rounds in which all that are in one mode run side by side.

Rounds serve what the loop over phases does not run: other engines, and modes that it leaves out.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...hybrid import SLIP, Mode
from ...integrators.contact_decisions import SOON, SOON_IN_A_ROW
from ...integrators.event_code import Event
from ...integrators.phase_ends import next_history
from ...integrators.phase_stops import BEHIND
from ...integrators.phase_tables import JUMPS, NOBODY, NOT_BEGUN
from ...ir.conditions import CONDITION_TIME
from ...mechanics.equations import Guard
from ...methods.status import Status
from ...results.hybrid_sweep import States
from ...results.sweep import Sweep
from ..input_values import GivenInputs
from ..sweep import begin_sweep
from .case_table import case_table
from .controller_clocks import ControllerClocks
from .decisions import flag
from .mode_models import ModeModels
from .output_values import BROKEN, JAMMED
from .phases import compiled_phases
from .request import SweepRequest
from .state import HybridState, placed
from .stops import stops_of

__all__ = ["RUNNING", "CaseRounds"]

RUNNING = -1
"""Status of a case that goes on."""
_BETWEEN_FITS = 16
"""Rounds in one mode after which it is asked anew which method fits."""


@final
class CaseRounds:
    """Cases of a sweep: where they are, what has been counted, and what runs them.

    Attributes
    ----------
    now : HybridState
        Present states.
    table : CaseTable
        The same arrays, and what is recorded, as the loop over phases takes them.
    status, phases, steps : ndarray (n_case,)
        Status, number of phases and steps of each case.
    occurred, totals : ndarray
        Events and reductions of each case.
    samples : States
        States at the times to record.
    methods : dict of str to None
        Methods in the order in which they were taken.
    fits : dict of Mode to (int, str)
        Rounds in each mode, and the method that fits there.
    compile_seconds : float
    """

    def __init__(self, modes: ModeModels, request: SweepRequest) -> None:
        self.modes, self.request = modes, request
        count, k = len(request.t), len(modes.equations.contacts)
        self.names = request.layout.variables
        self.span = request.t1 - request.t
        self.now = HybridState.starting(request.t, request.x, request.p, self.span, k, len(request.layout.states))
        wanted = 0 if request.t_eval is None else len(request.t_eval)
        self.samples = samples = States.nothing_yet(count * wanted, len(self.names), k)
        self.reductions = request.reductions
        self.table = table = case_table(
            self.now, request.t1, self.reductions, request.t_eval, samples, np.empty((0, 0))
        )
        self.numbers, self.occurred, self.totals = table.numbers, table.occurred, table.totals
        self.status, self.phases, self.steps = self.numbers.state, self.numbers.phases, self.numbers.steps
        self.soon, self.next = self.numbers.soon, self.numbers.next
        self.status[:], self.numbers.runner[:] = request.status, NOT_BEGUN
        given = request.options.inputs
        self.inputs: GivenInputs | None = given if given is not None and given.sampled else None
        self.forward = np.where(self.span >= 0.0, 1.0, -1.0)
        sampling, about = modes.sampling(request.layout), (request.t, request.t1, request.p, request.t_eval)
        self.clocks = None if sampling is None else ControllerClocks(sampling, *about)
        bad = None if self.clocks is None else self.clocks.senseless()
        spans = request.t, request.t1
        self.stops = None
        if compiled_phases(modes):
            self.stops = stops_of(modes, request.layout, self.inputs, request.p, spans, request.t_eval, bad)
        self.breaks = None if self.stops is None else self.stops.breaks
        if not compiled_phases(modes):
            self.breaks = modes.breaks(request.p, request.t, request.t1)
        if self.stops is not None:
            self.table = table._replace(stops=self.stops.table)
        if self.clocks is not None:
            self.status[self.clocks.senseless() & (self.status == RUNNING)] = int(Status.NON_FINITE)
        self.compile_seconds = 0.0
        self.methods: dict[str, None] = {}
        self.fits: dict[Mode, tuple[int, str]] = {}
        self.watched: dict[Mode, tuple[Event, ...]] = {}

    def going(self) -> NDArray[np.intp]:
        """Return the cases that go on."""
        return np.flatnonzero(self.status == RUNNING)

    # -- one round -------------------------------------------------------------------------

    def run(self, running: NDArray[np.intp]) -> None:
        """Run cases, each to its next sample, its end, or what ends its mode: those alike together."""
        numbers = self.now.mode_numbers(running)
        for number in np.unique(numbers):
            some, mode = running[numbers == number], self.modes.automaton.mode(int(number))
            columns = self._columns(mode, some)
            self._end_round(mode, some, columns, self._begin(mode, some, columns))

    def _end_round(
        self, mode: Mode, some: NDArray[np.intp], columns: Mapping[str, FloatArray], waiting: Callable[..., Sweep]
    ) -> None:
        """Wait for a group of cases, and look how each goes on."""
        run = waiting()
        rounds, _ = self.fits.get(mode, (0, ""))
        self.fits[mode] = rounds + 1, run.stats.method
        self.methods[run.stats.method] = None
        if self.breaks is not None and self.breaks.place is not None:
            columns = {**columns, CONDITION_TIME: self.breaks.middles(some, run.t)}
        columns = {**columns, **self._inputs_at(some, run.t)}
        x, place = self.modes.expand(mode, run.t, run.y, columns), placed(some)
        self._keep(run, some, run.t - self.now.t[place])
        self.now.t[place], self.now.x[place], self.now.cases.passed[place] = run.t, x, run.t - self.table.begun[place]
        self.steps[place] += run.steps
        status = run.status.astype(np.int64)
        failed = (status != Status.SUCCESS) & (status != Status.EVENT)
        if np.any(failed):
            self.status[some[failed]] = self._statuses(run, status, mode)[failed]
        reached = status == Status.SUCCESS
        if self.clocks is not None:
            self.clocks.reached(some[reached], run.t[reached])
        done = reached & (run.t == self.request.t1[some])
        self.status[some[done]] = int(Status.SUCCESS)
        self._sample(some[reached])
        self._after(run, mode, some, np.flatnonzero(status == Status.EVENT))
        if np.any(status == Status.INTERRUPTED):
            raise KeyboardInterrupt

    def _goal(self, some: NDArray[np.intp]) -> FloatArray:
        """Return the times up to which cases run."""
        goal = self.request.t1[some].copy()
        t_eval = self.request.t_eval
        if t_eval is not None:
            more = self.next[some] < len(t_eval)
            goal[more] = t_eval[self.next[some[more]]]
        return goal

    def _columns(self, mode: Mode, some: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Return the parameters (k,) or (1,) of a mode's model for some cases, in the order of its layout."""
        before, place, given = time.perf_counter(), placed(some), self.request.varied[1]
        layout = self.modes.model(mode).layout
        self.compile_seconds += time.perf_counter() - before
        own = {name: given[name] for name in self.request.layout.parameters}
        columns = {name: values if len(values) == 1 else values[place] for name, values in own.items()}
        columns |= self._inputs_at(some, self.now.t[some])
        cases = self.now.cases
        columns |= self.modes.added(mode, self.now.directions(place), cases.sides[place], cases.rest[place])
        return {name: columns[name] for name in layout.parameters}

    def _inputs_at(self, some: NDArray[np.intp], t: FloatArray) -> dict[str, FloatArray]:
        """Return the parameters (k,) of inputs with knots, from times (k,) on."""
        return {} if self.inputs is None else self.inputs.columns(t, some, self.forward[some] > 0.0)

    def _pass_breaks(self, some: NDArray[np.intp]) -> None:
        """Let parameters be those from the present times on, and controllers act that are to act then."""
        now = self.now
        if self.breaks is not None and self.breaks.place is not None:
            now.c[some, self.breaks.place] = self.breaks.middles(some, now.t[some])
        for name, column in self._inputs_at(some, self.now.t[some]).items():
            now.c[some, self.request.layout.parameters.index(name)] = column
        if self.clocks is not None:
            now.x[some] = self.clocks.act(some, now.t[some], now.x[some], now.c[some])

    def leave_loop(self, some: NDArray[np.intp]) -> None:
        """Take over running cases from the loop over phases, which has passed the stops up to their times."""
        if self.clocks is not None:
            for i, t in zip(some.tolist(), self.now.t[some].tolist(), strict=True):
                self.clocks.clocks[i].last = t

    def enter_loop(self, some: NDArray[np.intp]) -> None:
        """Hand cases over to the loop over phases: those in the middle of a phase go on where they are."""
        if self.stops is not None:
            self._pass_breaks(some)
            self.stops.table.next[some] = BEHIND

    def states(self, some: NDArray[np.intp]) -> States:
        """Return the present states of some cases, after what controllers are to do."""
        now, found = self.now, self.now.states(some, self.numbers.history[some])
        return (
            found if self.clocks is None else replace(found, x=self.clocks.acted(some, found.t, found.x, now.c[some]))
        )

    def _begin(self, mode: Mode, some: NDArray[np.intp], columns: Mapping[str, FloatArray]) -> Callable[..., Sweep]:
        """Begin to run cases in one mode; return what waits for the results."""
        model, place = self.modes.model(mode), placed(some)
        if mode not in self.watched:
            events = self.reductions.events
            asked = [replace(e, name=e.label, terminal=bool(e.terminal or e.apply), apply=None) for e in events]
            self.watched[mode] = (*asked, *self.modes.events(mode))
        rounds, method = self.fits.get(mode, (0, ""))
        options = replace(self.request.options, events=self.watched[mode], reduce=self.reductions.along or None)
        options = replace(options, grid=None, t_eval=None, threads=self.request.threads, progress=False)
        options = replace(options, inputs=None if self.inputs is None else self.inputs.part(some))
        clocks = () if self.clocks is None else [self.clocks.clocks[i] for i in some.tolist()]
        if options.automatic and not options.fits:
            number = self.modes.automaton.number(mode)
            method = options.method_chosen(number, model.choose_method("auto", options.rtol, options.atol, many=True))
            options = replace(options, method=method)
        elif rounds % _BETWEEN_FITS:  # the method that fits is known; to ask takes as long as some hundred phases
            options = replace(options, method=method)
        return begin_sweep(
            model,
            (self.now.t[some], self._goal(some)),
            {name: self.now.x[place, i] for i, name in enumerate(self.names)},
            columns,
            options,
            clocks,
        )

    def _statuses(self, run: Sweep, status: NDArray[np.int64], mode: Mode) -> NDArray[np.int64]:
        """Return statuses, those of runs into Painleve's paradox told from other failures."""
        if SLIP not in mode:
            return status
        broken = np.isin(status, BROKEN)
        if not np.any(broken):
            return status
        return np.where(broken & ~(run["uniqueness of reactions"] > JAMMED), int(Status.CONTACT_IMPOSSIBLE), status)

    def _keep(self, run: Sweep, some: NDArray[np.intp], passed: FloatArray) -> None:
        """Join what was counted and reduced in a phase to what was before."""
        for i, event in enumerate(self.reductions.events):
            record, occurred = run.events[event.label], self.occurred[some, 3 * i : 3 * i + 3]
            occurred[:, 0] += record.count
            occurred[:, 1] = np.where(np.isnan(occurred[:, 1]), record.first, occurred[:, 1])
            last = run.t if event.terminal or event.apply else record.last  # what stops a phase happens at one time
            occurred[:, 2] = np.where(record.count > 0, last, occurred[:, 2])
            self.occurred[some, 3 * i : 3 * i + 3] = occurred
        self.totals[some] = self.reductions.keep(self.totals[some], run.reduced, passed)

    def _sample(self, some: NDArray[np.intp]) -> None:
        """Take down the samples that cases have reached."""
        t_eval, samples = self.request.t_eval, self.samples
        if t_eval is None:
            return
        while len(some):
            some = some[self.next[some] < len(t_eval)]
            some = some[(t_eval[self.next[some]] - self.now.t[some]) * self.forward[some] <= 0.0]
            rows, now = some * len(t_eval) + self.next[some], self.states(some)
            for name in ("t", "x", "mode", "history", "directions", "sides", "rest"):
                getattr(samples, name)[rows] = getattr(now, name)
            self.next[some] += 1

    # -- between rounds --------------------------------------------------------------------

    def _after(self, run: Sweep, mode: Mode, some: NDArray[np.intp], ended: NDArray[np.intp]) -> None:
        """Decide on the cases whose phase was ended by events."""
        guards = self.modes.guards(mode)
        fired = np.array([run.events[g.output].last == run.t for g in guards]).reshape(len(guards), len(some))
        jumps = np.zeros(len(some), np.bool_)
        for i, event in enumerate(self.reductions.events):
            here = run.events[event.label].count > 0
            if event.apply is not None:
                jumps |= here
            elif event.terminal:
                reached = self.occurred[some, 3 * i] >= int(event.terminal)
                ended = self._over(some, ended, here & reached, Status.EVENT)
        for guard, row in zip(guards, fired, strict=True):
            if guard.kind == "paradox":
                ended = self._over(some, ended, row & ~jumps, Status.CONTACT_IMPOSSIBLE)
        ended = ended[(jumps | np.any(fired, axis=0))[ended]]  # others are in the middle of a phase
        cases = some[ended]
        passed = self.now.cases.passed[cases]
        quick = np.abs(passed) <= SOON * np.abs(self.span[cases])
        self.soon[cases] = np.where(quick, self.soon[cases] + 1, 0)
        self.status[cases[self.soon[cases] >= SOON_IN_A_ROW]] = int(Status.EVENTS_ACCUMULATE)
        self.status[cases[self.steps[cases] >= self.request.options.max_steps]] = int(Status.MAX_STEPS)
        keep = self.status[cases] == RUNNING
        ended, cases, passed = ended[keep], cases[keep], passed[keep]
        self.phases[cases] += passed != 0.0
        history, number = self.numbers.history[cases], self.modes.automaton.number(mode)
        self.numbers.history[cases] = np.where(passed != 0.0, next_history(history, number), history)
        self.numbers.runner[cases[jumps[ended]]] = JUMPS
        self._pass_breaks(cases[jumps[ended]])
        ended, cases = ended[~jumps[ended]], cases[~jumps[ended]]
        self._decide(cases, mode, {guard: row[ended] for guard, row in zip(guards, fired, strict=True)})
        self._sample(cases)

    def jump(self, going: NDArray[np.intp], *, deciding: bool) -> None:
        """Map the states of cases in which events have occurred that do so, and let them begin anew.

        Their modes are selected here where `deciding`, else by the loop over phases.
        """
        some = going[self.numbers.runner[going] == JUMPS]
        if not len(some):
            return
        assert self.request.jumps is not None
        self.status[some] = self.request.jumps.apply(self.now, self.occurred, some)
        going = self.status[some] == RUNNING
        self.phases[some[~going]] -= self.now.cases.passed[some[~going]] != 0.0
        some = some[going]
        self.numbers.runner[some] = NOT_BEGUN
        if deciding:
            self.begin(some)

    def begin(self, some: NDArray[np.intp]) -> None:
        """Select the modes in which cases begin."""
        self._decide(some, None, {})
        self._sample(some)

    def _over(
        self, some: NDArray[np.intp], ended: NDArray[np.intp], over: NDArray[np.bool_], status: Status
    ) -> NDArray[np.intp]:
        """Give a status to those of `some` with the numbers `ended` that are `over`, and return the other numbers."""
        if not np.any(over):
            return ended
        self.status[some[ended[over[ended]]]] = int(status)
        return ended[~over[ended]]

    def _decide(self, some: NDArray[np.intp], mode: Mode | None, fired: Mapping[Guard, NDArray[np.bool_]]) -> None:
        """Decide how cases go on; `fired` tells of which of them a guard has fired (k,)."""
        if not len(some):
            return
        cases = self.now.cases
        self._pass_breaks(some)
        cases.fired[some] = 0
        for guard, here in fired.items():
            if guard.contact >= 0:
                cases.fired[some[here], guard.contact] |= flag(guard)
        self.modes.decisions.decide(self.now, some, self.request.options.rtol)
        status, self.table.begun[some] = cases.status[some], self.now.t[some]
        bad = some[status != Status.SUCCESS]
        self.status[bad] = cases.status[bad]
        self.phases[bad] -= cases.passed[bad] != 0.0
        some = some[status == Status.SUCCESS]
        self.numbers.runner[some] = NOBODY
        over = some[self.now.t[some] == self.request.t1[some]]
        self.status[over] = int(Status.SUCCESS)
        self.phases[over] -= cases.passed[over] != 0.0
