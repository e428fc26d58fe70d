"""One motion with contacts: phase after phase, each a run of the model of its mode up to what ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from ...arrays import FloatArray
from ...errors import InitialStateError, ValueInputError
from ...integrators.event_code import Event
from ...integrators.events import SOON, SOON_IN_A_ROW
from ...ir.program import Layout
from ...mechanics.equations import Watchpoint
from ...methods.status import Status
from ...options import SimulateOptions
from ...reduction.modes import SLIP, Mode
from ...results.events import EventRecords
from ...results.hybrid import HybridTrajectory, Part, Phase, joined_records
from ...results.motion import RunStatistics
from ...results.trajectory import Trajectory
from .. import inputs
from ..simulate import simulate_from_state, simulate_in_own_time
from .instants import Instants, Settled
from .looking import Lookout
from .modes import Modes

__all__ = ["JAMMED", "Request", "simulate"]

JAMMED = 0.05
"""Determinant of the reactions below which a failing run counts as one into Painleve's paradox."""


@final
@dataclass(frozen=True, eq=False)
class Request:
    """What a run was asked for.

    Attributes
    ----------
    t0, t1 : float
        Span [s].
    x : ndarray (2 n_q,)
        Consistent coordinates and rates to start from.
    parameters : dict of str to float
        Of the scene.
    c : ndarray (n_p,)
        The same in the order of the scene.
    t_eval : ndarray or None
    options : mapping
        Further arguments of `simulate`.
    events : tuple of Event
    jumps : mapping of str to callable
        For each event that maps the state: from time and state (2 n_q,) to the state after it, or None.
    layout : Layout
        Of the scene, with the outputs that were asked for.
    """

    t0: float
    t1: float
    x: FloatArray
    parameters: dict[str, float]
    c: FloatArray
    t_eval: FloatArray | None
    options: Mapping[str, Any]
    events: tuple[Event, ...]
    jumps: Mapping[str, Callable[[float, FloatArray], FloatArray | None]]
    layout: Layout


def simulate(modes: Modes, request: Request) -> HybridTrajectory:
    """Return the motion that was asked for."""
    return _Run(modes, request).trajectory()


@final
@dataclass(frozen=True, eq=False)
class _Begun:
    """State (n_y,) and constants (n_c,) from which a phase begins."""

    y: FloatArray
    c: FloatArray


@final
class _Run:
    """One run in progress."""

    def __init__(self, modes: Modes, request: Request) -> None:
        self.modes, self.request = modes, request
        self.begin = time.perf_counter()
        self.forward = 1.0 if request.t1 >= request.t0 else -1.0
        t, x, c = np.array([request.t0]), request.x[np.newaxis], request.c[np.newaxis]
        self.t = request.t0
        self.now = Instants.starting(t, x, c, len(modes.equations.contacts))
        self.breaks = modes.breaks(c, t, np.array([request.t1]))
        self.mode: Mode | None = None
        self.cause: tuple[Mode | None, tuple[Watchpoint, ...]] = (None, ())
        self.parts: list[Part] = []
        self.records: list[tuple[Part, EventRecords]] = []
        self.counts = {event.label: 0 for event in request.events}
        self.steps = self.rejected = self.evaluations = self.soon = 0
        self.compile_seconds = 0.0
        self.method = str(request.options["method"])
        self.note = ""
        span, about = (request.t0, request.t1), (modes, request.layout, request.options)
        # what users watch for may happen just where a phase ends, and is looked for together with that
        alone = bool(request.events) or self.breaks is not None
        self.lookout = None if alone else Lookout(*about, span, self.now)

    def trajectory(self) -> HybridTrajectory:
        """Run to the end and return what was recorded."""
        status = self._settle(())
        if status is not None and not self.parts:
            self._stay(status)
        while status is None:
            status = self._carried()
            if status is None:
                status = self._phase()
        return self._joined(status)

    # -- between phases --------------------------------------------------------------------

    def _settle(self, fired: Sequence[Watchpoint]) -> Status | None:
        """Decide how the motion goes on; return a status where it cannot."""
        laws = self.modes.laws
        if self.breaks is not None and self.breaks.place is not None:
            c = self.now.c.copy()
            c[:, self.breaks.place] = self.breaks.middles(np.zeros(1, np.intp), self.now.t)
            self.now = replace(self.now, c=c)
        settled = laws.settle(self.now, self.mode, fired)
        status = Status(int(settled.status[0]))
        if status is Status.INITIAL_STATE:
            raise self._complaint()
        if status is not Status.SUCCESS:
            self.note = self._where()
            return status
        self.cause = self.mode, tuple(fired)
        self._take(settled)
        return None

    def _take(self, settled: Settled) -> None:
        fields = {name: getattr(settled, name) for name in ("x", "directions", "sides", "speeds")}
        self.now = replace(self.now, **fields)
        self.mode = settled.table[settled.mode[0]]

    def _complaint(self) -> Exception:
        """Return what is wrong with the start."""
        facts = self.modes.laws.facts(self.now.t, self.now.x, self.now.c)
        faults = []
        for i, contact in enumerate(self.modes.equations.contacts):
            mu, static, e = facts.mu[0, i], facts.mu_static[0, i], facts.restitution[0, i]
            if mu < 0.0:
                faults.append(f"mu of {contact.name!r} is {mu:g}; it must not be negative")
            elif static < mu:
                faults.append(
                    f"mu_static of {contact.name!r} is {static:g}, less than mu = {mu:g}; raise it, or leave it out"
                )
            if not 0.0 <= e <= 1.0:
                faults.append(f"restitution of {contact.name!r} is {e:g}; it must lie between 0 and 1")
        if faults:
            return ValueInputError("; ".join(faults))
        for i, contact in enumerate(self.modes.equations.contacts):
            name = self.modes.equations.symbols.unknowns[contact.normal]
            if contact.constraint is None:
                continue
            if not facts.pushes_open(i)[0]:
                faults.append(
                    f"contact {contact.name!r}: {name} pushes its gap closed here; turn the sign of the gap, or the"
                    " direction of the force in the joint"
                )
            elif facts.gap[0, i] < 0.0:
                faults.append(
                    f"contact {contact.name!r} penetrates: its gap is {facts.gap[0, i]:.3g}; start with gap >= 0"
                )
        return InitialStateError("the initial state contradicts the contacts:\n  " + "\n  ".join(faults))

    def _where(self) -> str:
        """Return where the run ended, for the note."""
        symbols = self.modes.equations.symbols
        place = ", ".join(
            f"{n} = {v:.6g}" for n, v in zip((*symbols.coordinates, *symbols.rates), self.now.x[0], strict=True)
        )
        return f"at t = {self.t:.6g} with {place}"

    # -- phases ----------------------------------------------------------------------------

    def _events(self) -> list[Event]:
        """Return the events that were asked for, as a phase watches for them."""
        events = []
        for event in self.request.events:
            last = int(event.terminal) - self.counts[event.label] if event.terminal else 0
            last = 1 if event.apply is not None else last
            events.append(replace(event, name=event.label, apply=None, terminal=last))
        return events

    def _run(self, mode: Mode, t1: float, events: Sequence[Event]) -> Trajectory:
        """Run the model of a mode from where the motion is, up to a time or what ends it."""
        equations = self.modes.equations
        names = (*equations.symbols.coordinates, *equations.symbols.rates)
        initial = dict(zip(names, self.now.x[0].tolist(), strict=True))
        before = time.perf_counter()
        model = self.modes.model(mode)
        self.compile_seconds += time.perf_counter() - before
        options = SimulateOptions(events=events, **self._options())
        return simulate_in_own_time(model, (self.t, t1), initial, self._parameters(self.now, mode), options)

    def _parameters(self, now: Instants, mode: Mode) -> dict[str, float]:
        """Return the parameters of a mode."""
        added = self.modes.added(mode, now.directions[0], now.sides[0])
        return {**self.request.parameters, **{name: float(value) for name, value in added.items()}}

    def _options(self) -> dict[str, Any]:
        """Return the options of the next phase."""
        options = dict(self.request.options)
        options["max_steps"] = max(1, options["max_steps"] - self.steps - self.rejected)
        options["dense"] = options["dense"] or self.request.t_eval is not None
        if self.parts:
            options["first_step"] = None
        return options

    def _carried(self) -> Status | None:
        """Go through the phases that compiled code sees ahead; return a status where the motion ends."""
        while self.lookout is not None and self.mode is not None:
            seen = self.lookout.look(self.now, self.mode, self.cause, self.soon)
            if seen is None:
                return None
            legs = [(self.now, self.mode), *((stop.now, stop.mode) for stop in seen.stops)]
            begun = iter(self._begun(legs))
            for stop in seen.stops:
                status = self._up_to(float(stop.now.t[0]), next(begun))
                if status is not Status.SUCCESS:
                    return status
                self.now, self.mode, self.cause, self.soon = stop.now, stop.mode, stop.cause, stop.soon
            if seen.done:
                return self._up_to(self.request.t1, next(begun))
            if seen.fired is None and not seen.stops:
                return None
            if seen.fired is not None:
                status = self._up_to(float(seen.now.t[0]), next(begun))
                if status is not Status.SUCCESS:
                    return status
                before, self.now = self.now.t[0], seen.now
                ends = self._too_soon(abs(self.t - before)) or self._settle(seen.fired)
                if ends is not None:
                    return ends
        return None

    def _begun(self, legs: Sequence[tuple[Instants, Mode]]) -> list[_Begun]:
        """Return states (n_y,) and constants (n_c,) from which phases begin, each a case in its mode."""
        begun = [_Begun(np.empty(0), np.empty(0)) for _ in legs]
        for mode in dict.fromkeys(mode for _, mode in legs):
            some = [i for i, leg in enumerate(legs) if leg[1] == mode]
            own = [self._parameters(legs[i][0], mode) for i in some]
            program = self.modes.model(mode).stages.program
            c = inputs.prepare_rows(program, np.array([[p[name] for name in program.layout.parameters] for p in own]))
            t, x = (np.concatenate([getattr(legs[i][0], name) for i in some]) for name in ("t", "x"))
            y = self.modes.states(mode, t, x, c)
            for place, i in enumerate(some):
                begun[i] = _Begun(y[place], c[place])
        return begun

    def _up_to(self, t1: float, begun: _Begun) -> Status:
        """Run one phase that ends at a time; return its status."""
        mode = self.mode
        assert mode is not None
        options = SimulateOptions(**self._options())
        run = simulate_from_state(self.modes.model(mode), (self.t, t1), begun.y, begun.c, options)
        self._add(run, mode, float(run.t[-1]))
        return run.status if run.status is Status.SUCCESS else self._failed(run, mode)

    def _add(self, run: Trajectory, mode: Mode, end: float) -> None:
        """Take down a phase that ended at a time."""
        stats = run.stats
        self.steps, self.rejected = self.steps + stats.steps, self.rejected + stats.rejected
        self.evaluations += stats.evaluations
        self.method = stats.method
        part = Part(Phase(self.t, end, self.modes.named(mode)), run, self.modes.violation(mode))
        self.t = end
        self.parts.append(part)
        self.records.append((part, run.events))
        for event in self.request.events:
            self.counts[event.label] += len(run.events[event.label])

    def _phase(self) -> Status | None:
        """Run one phase and settle what comes after; return a status where the motion ends."""
        mode = self.mode
        assert mode is not None
        run = self._run(mode, self.request.t1, self._events() + self.modes.events(mode, *self.cause))
        ended = run.status is Status.EVENT
        end = (
            max((r.t[-1] for r in run.events.values() if len(r)), key=lambda t: t * self.forward)
            if ended
            else run.t[-1]
        )
        before = self.t
        self._add(run, mode, float(end))
        happened = [name for name, record in run.events.items() if len(record) and record.t[-1] == end] if ended else []
        if not ended:
            return self._failed(run, mode)
        last = run.events[happened[0]].after
        x = np.concatenate([last.q[-1], last.qdot[-1]])[np.newaxis]
        self.now = replace(self.now, t=np.array([self.t]), x=x, passed=np.array([self.t - before]))
        status = self._too_soon(abs(self.t - before))
        if status is not None:
            return status
        return self._after(mode, happened)

    def _after(self, mode: Mode, happened: Sequence[str]) -> Status | None:
        """Apply events that ended a phase, and settle how the motion goes on."""
        for event in self.request.events:
            if event.label in happened and event.apply is None and 0 < int(event.terminal) <= self.counts[event.label]:
                return Status.EVENT
        applied = [event for event in self.request.events if event.label in happened and event.apply is not None]
        for event in applied:
            after = self.request.jumps[event.label](self.t, self.now.x[0])
            if after is None:
                return Status.EVENT_STATE
            self.now = replace(self.now, x=after[np.newaxis])
        if any(0 < int(event.terminal) <= self.counts[event.label] for event in applied):
            return Status.EVENT
        fired = [point for point in self.modes.points(mode) if point.output in happened]
        if any(point.kind == "paradox" for point in fired):
            self.note = self._where()
            return Status.CONTACT_IMPOSSIBLE
        if applied:
            self.mode, fired = None, []
        return self._settle(fired)

    def _failed(self, run: Trajectory, mode: Mode) -> Status:
        """Return how a phase ended that no event ended; a failure near Painleve's paradox is one of that."""
        self.note = run.stats.note
        status = run.status
        if status in (Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.MAX_STEPS) and SLIP in mode:
            if not run["uniqueness of reactions"][-1] > JAMMED:
                status = Status.CONTACT_IMPOSSIBLE
                self.now = replace(self.now, x=np.hstack([run.q[-1:], run.qdot[-1:]]))
                self.note = self._where()
        return status

    def _too_soon(self, passed: float) -> Status | None:
        """Judge whether phases follow each other too fast to be told apart."""
        span = abs(self.request.t1 - self.request.t0)
        self.soon = self.soon + 1 if passed <= SOON * span else 0
        if self.soon < SOON_IN_A_ROW:
            return None
        before, after = self.parts[-1].phase.modes, self.modes.named(self.mode or ())
        changing = [name for name in before if before[name] != after.get(name)] or list(before)
        self.note = f"contact {', '.join(changing)} {self._where()}"
        return Status.EVENTS_ACCUMULATE

    # -- results ---------------------------------------------------------------------------

    def _stay(self, status: Status) -> None:
        """Record the start of a motion that cannot go on from it."""
        facts = self.modes.laws.facts(self.now.t, self.now.x, self.now.c)
        mode = self.modes.laws.plain(facts)
        model = self.modes.model(mode)
        names = (*model.layout.coordinates, *model.layout.rates)
        initial = dict(zip(names, self.now.x[0].tolist(), strict=True))
        options = SimulateOptions(method=self.request.options["method"])
        run = simulate_in_own_time(model, (self.t, self.t), initial, self.request.parameters, options)
        self.parts.append(Part(Phase(self.t, self.t, self.modes.named(mode)), run, self.modes.violation(mode)))

    def _joined(self, status: Status) -> HybridTrajectory:
        seconds = time.perf_counter() - self.begin - self.compile_seconds
        stats = RunStatistics(
            self.method, self.steps, self.rejected, self.evaluations, self.compile_seconds, seconds, self.note
        )
        phases = [part.phase for part in self.parts]
        name = self.modes.equations.name

        def make(parts: Sequence[Part]) -> HybridTrajectory:
            return HybridTrajectory(parts, phases, None, self.parts, status, stats, name, self.request.layout)

        run = make(self.parts)
        if self.request.t_eval is not None:
            reached = self.request.t_eval[(self.request.t_eval - self.t) * self.forward <= 0.0]
            run = run(reached)
        if not self.request.events or not self.records:
            return run
        labels = [event.label for event in self.request.events]
        records = joined_records(labels, self.records, make)
        return run.with_events(EventRecords(list(records.values()), self.modes.equations.symbols.aliases))
