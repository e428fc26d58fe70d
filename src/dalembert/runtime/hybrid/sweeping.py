"""Many motions with contacts: in every round, all cases that are in one mode run side by side up to what ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.event_code import Event
from ...integrators.events import SOON, SOON_IN_A_ROW
from ...integrators.phase_tables import NOTHING_FIRED, Fleet, case_numbers
from ...ir.conditions import CONDITION_TIME
from ...mechanics.equations import Watchpoint
from ...methods.status import Status
from ...options import SweepOptions
from ...reduction.modes import SLIP, Mode
from ...results.hybrid_sweep import HybridSweep, States
from ...results.sweep import Sweep, SweepStatistics
from ..sweep import begin_sweep
from ..sweeping import meter
from ..symbol_assumptions import warn_of_motion
from .campaign import Campaign, Value
from .carrying import Carrier
from .instants import Instants, placed
from .modes import Modes
from .running import JAMMED

__all__ = ["sweep"]

_RUNNING = -1
_BETWEEN_FITS = 16
"""Rounds in one mode after which it is asked anew which method fits."""
_BETWEEN_LOOKS = 1024
"""Cases after which a bar shows how far they are."""
_BROKEN = (int(Status.STEP_TOO_SMALL), int(Status.NON_FINITE), int(Status.MAX_STEPS))


def sweep(modes: Modes, campaign: Campaign) -> HybridSweep:
    """Return the results of all cases."""
    return _Sweep(modes, campaign).results()


@final
class _Sweep:
    """One sweep in progress."""

    def __init__(self, modes: Modes, campaign: Campaign) -> None:
        self.modes, self.campaign = modes, campaign
        self.begin = time.perf_counter()
        count, k = len(campaign.t), len(modes.equations.contacts)
        self.names = (*campaign.layout.coordinates, *campaign.layout.rates)
        self.now = Instants.starting(campaign.t.copy(), campaign.x.copy(), campaign.p, k)
        self.numbers = numbers = case_numbers(count)
        self.status, self.mode, self.cause, self.station = numbers.state, numbers.mode, numbers.cause, numbers.station
        self.fired, self.phases, self.steps = numbers.fired, numbers.phases, numbers.steps
        self.soon, self.next = numbers.soon, numbers.next
        self.status[:], self.mode[:], self.station[:], self.fired[:] = campaign.status, -1, -1, NOTHING_FIRED
        self.table: list[Mode] = []
        self.breaks = modes.breaks(campaign.p, campaign.t, campaign.t1)
        self.value = Value(modes, campaign.layout, campaign.p, self.table, self.breaks)
        self.causes: list[tuple[Mode | None, tuple[Watchpoint, ...]]] = [(None, ())]
        self.span = campaign.t1 - campaign.t
        self.forward = np.where(self.span >= 0.0, 1.0, -1.0)
        self.occurred = np.tile(np.array([0.0, np.nan, np.nan]), (count, len(campaign.events)))
        self.kept = {name: np.full(count, np.nan) for name in campaign.reductions}
        wanted = 0 if campaign.t_eval is None else len(campaign.t_eval)
        self.samples = States.nothing_yet(count * wanted, len(campaign.layout.coordinates), k)
        self.compile_seconds = 0.0
        self.methods: dict[str, None] = {}
        self.fits: dict[Mode, tuple[int, str]] = {}
        self.watched: dict[tuple[Mode, int], tuple[Event, ...]] = {}
        known = modes, campaign.layout, campaign.options, campaign.events, self._fleet(), self.table, self.causes
        self.carrier = None if campaign.reductions or self.breaks is not None else Carrier(*known)

    def _fleet(self) -> Fleet:
        """Return all cases as compiled code sees them: the very same arrays."""
        now, samples, count, k = self.now, self.samples, len(self.status), len(self.modes.equations.contacts)
        nothing = np.zeros(0, np.int64)
        return Fleet(
            now.t,
            np.ascontiguousarray(self.campaign.t1),
            self.span,
            now.passed,
            now.x,
            np.ascontiguousarray(now.c),
            now.directions.reshape(count, 2 * k),
            now.sides,
            now.speeds,
            self.numbers,
            self.occurred,
            nothing,
            nothing,
            np.empty(0) if self.campaign.t_eval is None else np.ascontiguousarray(self.campaign.t_eval),
            samples.t,
            samples.x,
            samples.mode,
            samples.directions.reshape(len(samples.t), 2 * k),
            samples.sides,
            np.empty((0, 0)),
        )

    def results(self) -> HybridSweep:
        """Run all cases to their ends."""
        every = np.flatnonzero(self.status == _RUNNING)
        self._settle(every, None, ())
        self._sample(every)
        with meter(len(self.status), self.campaign.progress) as advance:
            advance(len(self.status) - len(self._going()))
            try:
                while len(going := self._going()):
                    if not self._carried(going):
                        self._round(going)
                    advance(len(going) - len(self._going()))
            except KeyboardInterrupt:
                pass
        self.status[self.status == _RUNNING] = int(Status.INTERRUPTED)
        return self._finished()

    def _going(self) -> NDArray[np.intp]:
        """Return the cases that go on."""
        return np.flatnonzero(self.status == _RUNNING)

    # -- compiled code ---------------------------------------------------------------------

    def _carried(self, going: NDArray[np.intp]) -> bool:
        """Let compiled code carry cases as far as it can; return whether it could do anything."""
        if self.campaign.progress:
            going = going[:_BETWEEN_LOOKS]
        if self.carrier is None or not self.carrier.carry(going):
            return False
        self.methods |= dict.fromkeys(method for method in self.carrier.methods.values() if method)
        status = self.status[going]
        broken = going[np.isin(status, _BROKEN)]
        for number in np.unique(self.mode[broken]):
            here, mode = broken[self.mode[broken] == number], self.table[number]
            if SLIP in mode:
                regular = self.value("uniqueness of reactions", self._states(here)) > JAMMED
                self.status[here[~regular]] = int(Status.CONTACT_IMPOSSIBLE)
        waiting = going[(status == _RUNNING) & (self.fired[going] != NOTHING_FIRED)]
        alike = self.mode[waiting] + len(self.table) * self.fired[waiting]
        for number in np.unique(alike):
            some = waiting[alike == number]
            mode, bits = self.table[self.mode[some[0]]], int(self.fired[some[0]])
            fired = [point for i, point in enumerate(self.modes.points(mode)) if bits >> i & 1]
            self.carrier.learn(some, mode, fired)
            self.fired[some] = NOTHING_FIRED
            self._settle(some, mode, fired)
        self._sample(waiting)
        return True

    # -- one round -------------------------------------------------------------------------

    def _round(self, running: NDArray[np.intp]) -> None:
        """Run cases, each to its next sample, its end, or what ends its mode: those alike together."""
        mixed = self.mode[running] * len(self.causes) + self.cause[running]
        for number in np.unique(mixed):
            some = running[mixed == number]
            mode = self.table[self.mode[some[0]]]
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
        x, place = self.modes.expand(mode, run.t, run.y, columns), placed(some)
        passed = run.t - self.now.t[place]
        self._keep(run, some, passed)
        self.now.t[place], self.now.x[place], self.now.passed[place] = run.t, x, passed
        self.steps[place] += run.steps
        self.cause[place] = 0
        status = run.status.astype(np.int64)
        failed = (status != Status.SUCCESS) & (status != Status.EVENT)
        if np.any(failed):
            self.status[some[failed]] = self._judged(run, status, mode)[failed]
        reached = status == Status.SUCCESS
        done = reached & (run.t == self.campaign.t1[some])
        self.status[some[done]] = int(Status.SUCCESS)
        self._sample(some[reached])
        self._after(run, mode, some, np.flatnonzero(status == Status.EVENT))
        if np.any(status == Status.INTERRUPTED):
            raise KeyboardInterrupt

    def _goal(self, some: NDArray[np.intp]) -> FloatArray:
        """Return the times up to which cases run."""
        goal = self.campaign.t1[some].copy()
        t_eval = self.campaign.t_eval
        if t_eval is not None:
            more = self.next[some] < len(t_eval)
            goal[more] = t_eval[self.next[some[more]]]
        return goal

    def _columns(self, mode: Mode, some: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Return the parameters (k,) or (1,) of a mode's model for some cases, in the order of its layout."""
        before, place, given = time.perf_counter(), placed(some), self.campaign.varied[1]
        layout = self.modes.model(mode).layout
        self.compile_seconds += time.perf_counter() - before
        own = {name: given[name] for name in self.campaign.layout.parameters}
        columns = {name: values if len(values) == 1 else values[place] for name, values in own.items()}
        columns |= self.modes.added(mode, self.now.directions[place], self.now.sides[place])
        return {name: columns[name] for name in layout.parameters}

    def _states(self, some: NDArray[np.intp]) -> States:
        """Return the present states of some cases."""
        now = self.now
        return States(now.t[some], now.x[some], some, self.mode[some], now.directions[some], now.sides[some])

    def _begin(self, mode: Mode, some: NDArray[np.intp], columns: Mapping[str, FloatArray]) -> Callable[..., Sweep]:
        """Begin to run cases in one mode that come from one cause; return what waits for the results."""
        model, place = self.modes.model(mode), placed(some)
        key = mode, int(self.cause[some[0]])
        if key not in self.watched:
            asked = [replace(e, name=e.label) for e in self.campaign.events]
            self.watched[key] = (*asked, *self.modes.events(mode, *self.causes[key[1]]))
        rounds, method = self.fits.get(mode, (0, ""))
        options = {**self.campaign.options}
        if rounds % _BETWEEN_FITS:
            options["method"] = method  # as it was found to fit this mode; asking takes as long as some hundred phases
        return begin_sweep(
            model,
            (self.now.t[some], self._goal(some)),
            {name: self.now.x[place, i] for i, name in enumerate(self.names)},
            columns,
            SweepOptions(events=self.watched[key], reduce=self.campaign.reductions, **options),
        )

    def _judged(self, run: Sweep, status: NDArray[np.int64], mode: Mode) -> NDArray[np.int64]:
        """Return statuses, those of runs into Painleve's paradox told from other failures."""
        if SLIP not in mode:
            return status
        broken = np.isin(status, (Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.MAX_STEPS))
        if not np.any(broken):
            return status
        return np.where(broken & ~(run["uniqueness of reactions"] > JAMMED), int(Status.CONTACT_IMPOSSIBLE), status)

    def _keep(self, run: Sweep, some: NDArray[np.intp], passed: FloatArray) -> None:
        """Join what was counted and reduced in a phase to what was before."""
        for i, event in enumerate(self.campaign.events):
            record, occurred = run.events[event.label], self.occurred[some, 3 * i : 3 * i + 3]
            occurred[:, 0] += record.count
            occurred[:, 1] = np.where(np.isnan(occurred[:, 1]), record.first, occurred[:, 1])
            occurred[:, 2] = np.where(record.count > 0, record.last, occurred[:, 2])
            self.occurred[some, 3 * i : 3 * i + 3] = occurred
        whole = np.abs(self.now.t[some] - self.campaign.t[some])
        for name, reduction in self.campaign.reductions.items():
            old, new = self.kept[name][some], run.reduced[name]
            if reduction.kind == "minimum":
                new = np.fmin(old, new)
            elif reduction.kind == "maximum":
                new = np.fmax(old, new)
            elif reduction.kind == "first crossing":
                new = np.where(np.isnan(old), new, old)
            elif reduction.kind == "mean":
                share = whole / np.where(whole + np.abs(passed) > 0.0, whole + np.abs(passed), 1.0)
                new = np.where(whole > 0.0, share * old + (1.0 - share) * new, new)
            self.kept[name][some] = new

    def _sample(self, some: NDArray[np.intp]) -> None:
        """Take down the samples that cases have reached."""
        t_eval, samples = self.campaign.t_eval, self.samples
        if t_eval is None:
            return
        while len(some):
            some = some[self.next[some] < len(t_eval)]
            some = some[(t_eval[self.next[some]] - self.now.t[some]) * self.forward[some] <= 0.0]
            rows = some * len(t_eval) + self.next[some]
            samples.t[rows], samples.x[rows], samples.mode[rows] = self.now.t[some], self.now.x[some], self.mode[some]
            samples.directions[rows], samples.sides[rows] = self.now.directions[some], self.now.sides[some]
            self.next[some] += 1

    # -- between rounds --------------------------------------------------------------------

    def _after(self, run: Sweep, mode: Mode, some: NDArray[np.intp], ended: NDArray[np.intp]) -> None:
        """Settle the cases whose phase was ended by events."""
        points = self.modes.points(mode)
        fired = np.array([run.events[p.output].last == run.t for p in points]).reshape(len(points), len(some))
        for event in self.campaign.events:
            if event.terminal:
                ended = self._over(some, ended, run.events[event.label].last == run.t, Status.EVENT)
        for point, row in zip(points, fired, strict=True):
            if point.kind == "paradox":
                ended = self._over(some, ended, row, Status.CONTACT_IMPOSSIBLE)
        cases = some[ended]
        quick = np.abs(self.now.passed[cases]) <= SOON * np.abs(self.span[cases])
        self.soon[cases] = np.where(quick, self.soon[cases] + 1, 0)
        self.status[cases[self.soon[cases] >= SOON_IN_A_ROW]] = int(Status.EVENTS_ACCUMULATE)
        keep = self.status[cases] == _RUNNING
        ended, cases = ended[keep], cases[keep]
        self.phases[cases] += 1
        mixed = np.zeros(len(ended), np.int64)
        for i, row in enumerate(fired):
            mixed += np.left_shift(row[ended], i, dtype=np.int64)
        for number in np.unique(mixed):
            self._settle(cases[mixed == number], mode, [p for i, p in enumerate(points) if int(number) >> i & 1])
        self._sample(cases)

    def _over(
        self, some: NDArray[np.intp], ended: NDArray[np.intp], over: NDArray[np.bool_], status: Status
    ) -> NDArray[np.intp]:
        """Give a status to those of `some` with the numbers `ended` that are `over`, and return the other numbers."""
        if not np.any(over):
            return ended
        self.status[some[ended[over[ended]]]] = int(status)
        return ended[~over[ended]]

    def _settle(self, some: NDArray[np.intp], mode: Mode | None, fired: Sequence[Watchpoint]) -> None:
        """Decide how cases go on."""
        if not len(some):
            return
        cause = mode, tuple(fired)
        if cause not in self.causes:
            self.causes.append(cause)
        self.cause[some] = self.causes.index(cause)
        if self.breaks is not None and self.breaks.place is not None:
            self.now.c[some, self.breaks.place] = self.breaks.middles(some, self.now.t[some])
        settled = self.modes.laws.settle(self.now.part(placed(some)), mode, fired)
        good = settled.status == Status.SUCCESS
        if not np.all(good):
            self.status[some[~good]] = settled.status[~good]
            self.phases[some[~good]] -= mode is not None
            some, settled = some[good], settled.part(good)
        for name in ("x", "directions", "sides", "speeds"):
            getattr(self.now, name)[placed(some)] = getattr(settled, name)
        self.table.extend(found for found in settled.table if found not in self.table)
        numbers = np.array([self.table.index(found) for found in settled.table], np.intp)
        self.mode[some], self.station[some] = numbers[settled.mode], -1
        over = some[self.now.t[some] == self.campaign.t1[some]]
        self.status[over] = int(Status.SUCCESS)
        self.phases[over] -= mode is not None

    # -- results ---------------------------------------------------------------------------

    def _finished(self) -> HybridSweep:
        campaign = self.campaign
        started = self.mode >= 0
        ends = np.column_stack([self.now.t, self.status.astype(float), self.steps.astype(float)])
        stats = SweepStatistics(
            method=", ".join(self.methods),
            threads=int(campaign.options["threads"]),
            steps=int(self.steps.sum()),
            compile_seconds=self.compile_seconds,
            run_seconds=time.perf_counter() - self.begin - self.compile_seconds,
        )
        count = len(self.mode)
        last = self._states(np.arange(count))
        if campaign.t_eval is not None:
            self.samples.case[:] = np.repeat(np.arange(count), len(campaign.t_eval))
        modes = [self.modes.named(mode) for mode in self.table]
        run = HybridSweep(
            self.modes.equations.name,
            campaign.layout,
            campaign.varied,
            ends,
            campaign.t_eval,
            campaign.axes,
            stats,
            (last, None if campaign.t_eval is None else self.samples),
            self.phases + started,
            modes,
            self.value,
        )
        warn_of_motion(campaign.layout.assumptions, campaign.layout.coordinates, run.t, run._final)
        failed = ~run.success
        for values in self.kept.values():
            values[failed] = np.nan
        reduced = np.array(list(self.kept.values())).T.reshape(count, len(self.kept))
        labels = [event.label for event in campaign.events]
        return run.with_events(labels, self.occurred, list(self.kept), reduced)
