"""Sweeps of motions with contacts: by the loop over phases, or in rounds of all cases that are in one mode."""

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
from ...integrators.phase_loop import next_history
from ...integrators.phase_tables import JUMPS, NOBODY, NOT_BEGUN
from ...ir.conditions import CONDITION_TIME
from ...mechanics.equations import Guard
from ...methods.status import Status
from ...progress import meter
from ...results.hybrid_sweep import HybridSweep, States
from ...results.sweep import Sweep, SweepStatistics
from ..input_values import GivenInputs
from ..sweep import begin_sweep
from ..symbol_assumptions import warn_of_motion
from .case_table import case_table
from .decisions import flag
from .mode_models import ModeModels
from .output_values import BROKEN, JAMMED, OutputValues
from .phases import PhaseExecutor, compiled_phases
from .request import SweepRequest
from .state import HybridState, placed

__all__ = ["sweep"]

_RUNNING = -1
_BETWEEN_FITS = 16
"""Rounds in one mode after which it is asked anew which method fits."""
_BETWEEN_LOOKS = 1024
"""Cases after which a bar shows how far they are."""


def sweep(modes: ModeModels, request: SweepRequest) -> HybridSweep:
    """Return the results of all cases."""
    return _Sweep(modes, request).results()


@final
class _Sweep:
    """One sweep in progress."""

    def __init__(self, modes: ModeModels, request: SweepRequest) -> None:
        self.modes, self.request = modes, request
        self.begin = time.perf_counter()
        count, k = len(request.t), len(modes.equations.contacts)
        self.names = request.layout.variables
        self.span = request.t1 - request.t
        self.now = HybridState.starting(request.t, request.x, request.p, self.span, k, len(request.layout.states))
        wanted = 0 if request.t_eval is None else len(request.t_eval)
        self.samples = samples = States.nothing_yet(count * wanted, len(self.names), k)
        self.reductions = request.reductions
        table = case_table(self.now, request.t1, self.reductions, request.t_eval, samples, np.empty((0, 0)))
        self.numbers, self.occurred, self.totals = table.numbers, table.occurred, table.totals
        self.status, self.phases, self.steps = self.numbers.state, self.numbers.phases, self.numbers.steps
        self.soon, self.next = self.numbers.soon, self.numbers.next
        self.status[:], self.numbers.runner[:] = request.status, NOT_BEGUN
        self.breaks = modes.breaks(request.p, request.t, request.t1)
        given = request.options.inputs
        self.inputs: GivenInputs | None = given if given is not None and given.sampled else None
        self.forward = np.where(self.span >= 0.0, 1.0, -1.0)
        changing = None if self.inputs is None else (self.inputs, request.t1, self.forward > 0.0)
        self.value = OutputValues(modes, request.layout, request.p, self.breaks, changing)
        self.compile_seconds = 0.0
        self.methods: dict[str, None] = {}
        self.fits: dict[Mode, tuple[int, str]] = {}
        self.watched: dict[Mode, tuple[Event, ...]] = {}
        known = modes, request.layout, request.options, request.threads, self.reductions, self.now, table
        compiled = self.breaks is None and self.inputs is None and compiled_phases(modes)
        fits, chosen = request.options.fits, request.options.method_chosen
        self.executor = PhaseExecutor(*known, fits=fits, chosen=chosen) if compiled else None

    def results(self) -> HybridSweep:
        """Run all cases to their ends."""
        if self.executor is None:
            self._begin_cases(self._going())
        with meter(len(self.status), self.request.options.progress) as advance:
            advance(len(self.status) - len(self._going()))
            try:
                while len(going := self._going()):
                    if not self._executed(going):
                        self._round(going)
                    self._jump(self._going())
                    advance(len(going) - len(self._going()))
            except KeyboardInterrupt:
                pass
        self.status[self.status == _RUNNING] = int(Status.INTERRUPTED)
        return self._finished()

    def _going(self) -> NDArray[np.intp]:
        """Return the cases that go on."""
        return np.flatnonzero(self.status == _RUNNING)

    # -- compiled code ---------------------------------------------------------------------

    def _executed(self, going: NDArray[np.intp]) -> bool:
        """Let compiled code run cases as far as it can; return whether it could do anything."""
        if self.request.options.progress:
            going = going[:_BETWEEN_LOOKS]
        if self.executor is None or not self.executor.run(going):
            return False
        self.methods |= dict.fromkeys(method for method in self.executor.methods.values() if method)
        broken = going[np.isin(self.status[going], BROKEN)]
        self.status[broken[self.value.jammed(self._states(broken))]] = int(Status.CONTACT_IMPOSSIBLE)
        return True

    # -- one round -------------------------------------------------------------------------

    def _round(self, running: NDArray[np.intp]) -> None:
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
        passed = run.t - self.now.t[place]
        self._keep(run, some, passed)
        self.now.t[place], self.now.x[place], self.now.cases.passed[place] = run.t, x, passed
        self.steps[place] += run.steps
        status = run.status.astype(np.int64)
        failed = (status != Status.SUCCESS) & (status != Status.EVENT)
        if np.any(failed):
            self.status[some[failed]] = self._statuses(run, status, mode)[failed]
        reached = status == Status.SUCCESS
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

    def _renew_inputs(self, some: NDArray[np.intp]) -> None:
        """Let the parameters of inputs be those of the present times."""
        for name, column in self._inputs_at(some, self.now.t[some]).items():
            self.now.c[some, self.request.layout.parameters.index(name)] = column

    def _states(self, some: NDArray[np.intp]) -> States:
        """Return the present states of some cases."""
        return self.now.states(some, self.numbers.history[some])

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
            rows, now = some * len(t_eval) + self.next[some], self._states(some)
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
        keep = self.status[cases] == _RUNNING
        ended, cases, passed = ended[keep], cases[keep], passed[keep]
        self.phases[cases] += passed != 0.0
        history, number = self.numbers.history[cases], self.modes.automaton.number(mode)
        self.numbers.history[cases] = np.where(passed != 0.0, next_history(history, number), history)
        self.numbers.runner[cases[jumps[ended]]] = JUMPS
        ended, cases = ended[~jumps[ended]], cases[~jumps[ended]]
        self._decide(cases, mode, {guard: row[ended] for guard, row in zip(guards, fired, strict=True)})
        self._sample(cases)

    def _jump(self, going: NDArray[np.intp]) -> None:
        """Map the states of cases in which events have occurred that do so, and let them begin anew."""
        some = going[self.numbers.runner[going] == JUMPS]
        if not len(some):
            return
        self._renew_inputs(some)
        assert self.request.jumps is not None
        self.status[some] = self.request.jumps.apply(self.now, self.occurred, some)
        going = self.status[some] == _RUNNING
        self.phases[some[~going]] -= self.now.cases.passed[some[~going]] != 0.0
        some = some[going]
        self.numbers.runner[some] = NOT_BEGUN
        if self.executor is None:
            self._begin_cases(some)

    def _begin_cases(self, some: NDArray[np.intp]) -> None:
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
        if self.breaks is not None and self.breaks.place is not None:
            self.now.c[some, self.breaks.place] = self.breaks.middles(some, self.now.t[some])
        self._renew_inputs(some)
        cases.fired[some] = 0
        for guard, here in fired.items():
            if guard.contact >= 0:
                cases.fired[some[here], guard.contact] |= flag(guard)
        self.modes.decisions.decide(self.now, some, self.request.options.rtol)
        status = cases.status[some]
        bad = some[status != Status.SUCCESS]
        self.status[bad] = cases.status[bad]
        self.phases[bad] -= cases.passed[bad] != 0.0
        some = some[status == Status.SUCCESS]
        self.numbers.runner[some] = NOBODY
        over = some[self.now.t[some] == self.request.t1[some]]
        self.status[over] = int(Status.SUCCESS)
        self.phases[over] -= cases.passed[over] != 0.0

    # -- results ---------------------------------------------------------------------------

    def _methods(self) -> dict[tuple[int, float], str]:
        """Return the method of each mode by its number and the tolerance."""
        compiled = {} if self.executor is None else self.executor.methods
        found = {mode: method for mode, (_, method) in self.fits.items()}
        found |= {mode: method for mode, method in compiled.items() if method}
        number, rtol = self.modes.automaton.number, self.request.options.rtol
        return {(number(mode), rtol): method for mode, method in found.items()}

    def _finished(self) -> HybridSweep:
        request = self.request
        started = self.now.mode_numbers() >= 0
        ends = np.column_stack([self.now.t, self.status.astype(float), self.steps.astype(float)])
        stats = SweepStatistics(
            method=", ".join(self.methods),
            threads=request.threads,
            steps=int(self.steps.sum()),
            compile_seconds=self.compile_seconds,
            run_seconds=time.perf_counter() - self.begin - self.compile_seconds,
            rtol=request.options.rtol,
            atol=request.options.atol,
            methods=self._methods(),
        )
        count = len(self.status)
        last = self._states(np.arange(count))
        if request.t_eval is not None:
            self.samples.case[:] = np.repeat(np.arange(count), len(request.t_eval))
        met, automaton = np.concatenate([last.mode, self.samples.mode]), self.modes.automaton
        modes = {int(n): self.modes.named(automaton.mode(int(n))) for n in np.unique(met[met >= 0])}
        run = HybridSweep(
            self.modes.equations.name,
            request.layout,
            request.varied,
            ends,
            request.t_eval,
            request.axes,
            stats,
            (last, None if request.t_eval is None else self.samples),
            self.phases + started,
            [contact.name for contact in self.modes.equations.contacts],
            modes,
            self.value,
        )
        warn_of_motion(request.layout.assumptions, request.layout.coordinates, run.t, run._final)
        about = self.occurred, self.totals
        reduced = self.reductions.results(self.value, last, request.t, self.status, about)
        labels = [event.label for event in self.reductions.asked]
        return run.with_events(labels, self.occurred[:, : 3 * len(labels)], list(self.reductions.table), reduced)
