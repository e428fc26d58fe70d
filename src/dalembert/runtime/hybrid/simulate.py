"""Simulation of one motion with contacts: phase after phase, each a run of the model of its mode up to a guard."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ...arrays import FloatArray
from ...errors import InitialStateError, ValueInputError
from ...hybrid import CLOSED, OPEN, SLIP, SMOOTH, Mode
from ...hybrid.modes import STATES
from ...integrators.contact_cases import NOISE, UNDECIDED
from ...integrators.contact_decisions import SOON, SOON_IN_A_ROW
from ...integrators.contact_table import GAP, MU, MU_STATIC, RESTITUTION
from ...integrators.event_code import Event
from ...ir.program import Layout
from ...mechanics.equations import Guard
from ...methods.status import Status
from ...options import SimulateOptions
from ...results.events import EventRecords
from ...results.hybrid import HybridTrajectory, Part, Phase, joined_records
from ...results.motion import RunStatistics
from ...results.trajectory import Trajectory
from .. import inputs
from ..input_values import GivenInputs
from ..simulate import simulate_from_state, simulate_in_own_time
from .decisions import flag
from .event_jumps import EventJumps
from .mode_models import ModeModels
from .output_values import BROKEN, JAMMED
from .phases import compiled_phases
from .preview import PhasePreview, PhaseStart
from .state import HybridState

__all__ = ["Request", "simulate"]


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
    options : SimulateOptions
        As `simulate` was given them.
    events : tuple of Event
    jumps : EventJumps
        Of the events that map the state.
    layout : Layout
        Of the scene, with the outputs that were asked for.
    """

    t0: float
    t1: float
    x: FloatArray
    parameters: dict[str, float]
    c: FloatArray
    options: SimulateOptions
    events: tuple[Event, ...]
    jumps: EventJumps
    layout: Layout


def simulate(modes: ModeModels, request: Request) -> HybridTrajectory:
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

    def __init__(self, modes: ModeModels, request: Request) -> None:
        self.modes, self.request = modes, request
        self.begin = time.perf_counter()
        self.forward = 1.0 if request.t1 >= request.t0 else -1.0
        t, x, c = np.array([request.t0]), request.x[np.newaxis], request.c[np.newaxis]
        self.t, t1 = request.t0, np.array([request.t1])
        self.now = HybridState.starting(t, x, c, t1 - t, len(modes.equations.contacts), len(modes.equations.states))
        self.breaks = modes.breaks(c, t, t1)
        given = request.options.inputs
        self.inputs: GivenInputs | None = given if given is not None and given.sampled else None
        self.mode: Mode | None = None
        self.parts: list[Part] = []
        self.records: list[tuple[Part, EventRecords]] = []
        self.counts = {event.label: 0 for event in request.events}
        self.steps = self.rejected = self.evaluations = self.soon = 0
        self.compile_seconds = 0.0
        self.method = request.options.method
        self.note = ""
        # events of users may happen just where a phase ends, and are located together with its guards
        changing = self.breaks is not None or self.inputs is not None
        alone = bool(request.events) or changing or not compiled_phases(modes)
        about = modes, request.layout, request.options, request.t1, self.now
        self.preview = None if alone else PhasePreview(*about)

    def trajectory(self) -> HybridTrajectory:
        """Run to the end and return what was recorded."""
        status = self._decide(())
        while status is None:
            status = self._previewed()
            if status is None:
                status = self._phase()
        if not self.parts:
            self._stay(status)
        return self._joined(status)

    # -- between phases --------------------------------------------------------------------

    def _decide(self, fired: Sequence[Guard]) -> Status | None:
        """Decide how the motion goes on; return a status where it cannot."""
        cases = self.now.cases
        if self.breaks is not None and self.breaks.place is not None:
            self.now.c[:, self.breaks.place] = self.breaks.middles(np.zeros(1, np.intp), self.now.t)
        self._renew_inputs()
        if self.mode is None:
            cases.modes[:] = UNDECIDED
        cases.fired[:] = 0
        for guard in fired:
            if guard.contact >= 0:
                cases.fired[0, guard.contact] |= flag(guard)
        self.modes.decisions.decide(self.now, np.zeros(1, np.intp), self.request.options.rtol)
        status = Status(int(cases.status[0]))
        if status is Status.INITIAL_STATE:
            raise self._complaint()
        if status is not Status.SUCCESS:
            self.note = self._where()
            return status
        self.mode = self.modes.automaton.mode(int(self.now.mode_numbers()[0]))
        return None

    def _renew_inputs(self) -> None:
        """Let the parameters of inputs be those of the present time."""
        for name, column in self._inputs_at(float(self.now.t[0])).items():
            self.now.c[:, self.request.layout.parameters.index(name)] = column

    def _inputs_at(self, t: float) -> dict[str, float]:
        """Return the parameters of inputs with knots from a time on."""
        if self.inputs is None:
            return {}
        columns = self.inputs.columns(np.array([t]), np.zeros(1, np.intp), self.forward > 0.0)
        return {name: float(column[0]) for name, column in columns.items()}

    def _complaint(self) -> Exception:
        """Return what is wrong with the start."""
        decisions, now = self.modes.decisions, self.now
        values = decisions.values(now.t, now.x, now.c)
        gap, mu, static, e = (decisions.numbers(values, which)[0] for which in (GAP, MU, MU_STATIC, RESTITUTION))
        faults = []
        for i, contact in enumerate(self.modes.equations.contacts):
            if mu[i] < 0.0:
                faults.append(f"mu of {contact.name!r} is {mu[i]:g}; it must not be negative")
            elif static[i] < mu[i]:
                faults.append(
                    f"mu_static of {contact.name!r} is {static[i]:g}, less than mu = {mu[i]:g}; raise it, or leave it"
                    " out"
                )
            if not 0.0 <= e[i] <= 1.0:
                faults.append(f"restitution of {contact.name!r} is {e[i]:g}; it must lie between 0 and 1")
        if faults:
            return ValueInputError("; ".join(faults))
        for i, contact in enumerate(self.modes.equations.contacts):
            name = self.modes.equations.symbols.unknowns[contact.normal]
            if contact.constraint is None:
                continue
            if not decisions.pushes_open(values[0], i):
                faults.append(
                    f"contact {contact.name!r}: {name} pushes its gap closed here; turn the sign of the gap, or the"
                    " direction of the force in the joint"
                )
            elif gap[i] < 0.0:
                faults.append(f"contact {contact.name!r} penetrates: its gap is {gap[i]:.3g}; start with gap >= 0")
        return InitialStateError("the initial state contradicts the contacts:\n  " + "\n  ".join(faults))

    def _where(self) -> str:
        """Return where the run ended, for the note."""
        symbols = self.modes.equations.symbols
        place = ", ".join(f"{n} = {v:.6g}" for n, v in zip(symbols.variables, self.now.x[0], strict=True))
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
        names = equations.symbols.variables
        initial = dict(zip(names, self.now.x[0].tolist(), strict=True))
        before = time.perf_counter()
        model = self.modes.model(mode)
        self.compile_seconds += time.perf_counter() - before
        own = self._parameters(self._present(mode))
        return simulate_in_own_time(model, (self.t, t1), initial, own, self._options(events))

    def _parameters(self, start: PhaseStart) -> dict[str, float]:
        """Return the parameters of a mode."""
        added = self.modes.added(start.mode, start.directions, start.sides, start.rest)
        own = self._inputs_at(start.t)
        return {**self.request.parameters, **own, **{name: float(value) for name, value in added.items()}}

    def _present(self, mode: Mode) -> PhaseStart:
        """Return how the phase at hand begins."""
        now = self.now
        about = now.x[0].copy(), now.directions()[0].copy(), now.cases.sides[0].copy(), now.cases.rest[0].copy()
        return PhaseStart(float(now.t[0]), self.soon, mode, *about)

    def _options(self, events: Sequence[Event] = ()) -> SimulateOptions:
        """Return the options of the next phase."""
        options = self.request.options
        return replace(
            options,
            events=events,
            t_eval=None,
            max_steps=max(1, options.max_steps - self.steps - self.rejected),
            dense=options.dense or options.t_eval is not None,
            first_step=None if self.parts else options.first_step,
        )

    def _previewed(self) -> Status | None:
        """Run the phases that compiled code sees ahead; return a status where the motion ends."""
        while self.preview is not None and self.mode is not None:
            seen = self.preview.preview(self.now, self.soon)
            if seen is None or not (seen.starts or seen.status is Status.SUCCESS):
                return None
            starts = [self._present(self.mode), *seen.starts]
            last = seen.status is Status.SUCCESS and starts[-1].t != self.request.t1
            begun = self._begun(starts if last else starts[:-1])
            for start, state, following in zip(starts, begun, seen.starts, strict=False):
                status = self._up_to(following.t, start.mode, state)
                if status is not Status.SUCCESS:
                    return status
            self.mode, self.soon = starts[-1].mode, starts[-1].soon
            if last:
                return self._up_to(self.request.t1, self.mode, begun[-1])
            self._go_to(starts[-1], seen.state)
            if seen.status is not None:  # the last phase fails, or takes no time: its run says how it ends
                return None
        return None

    def _go_to(self, start: PhaseStart, later: HybridState) -> None:
        """Go to the beginning of a phase; what contacts remember is taken from a later state."""
        self.now.copied_from(later)
        now, cases = self.now, self.now.cases
        now.t[:], now.x[:], cases.sides[:], cases.rest[:] = start.t, start.x, start.sides, start.rest
        cases.directions[:] = start.directions.ravel()
        cases.modes[:] = [STATES.index(state) for state in start.mode]
        cases.after[:] = UNDECIDED

    def _begun(self, starts: Sequence[PhaseStart]) -> list[_Begun]:
        """Return states (n_y,) and constants (n_c,) from which phases begin, each in its mode."""
        begun = [_Begun(np.empty(0), np.empty(0)) for _ in starts]
        for mode in dict.fromkeys(start.mode for start in starts):
            some = [i for i, start in enumerate(starts) if start.mode == mode]
            own = [self._parameters(starts[i]) for i in some]
            program = self.modes.model(mode).stages.program
            c = inputs.prepare_rows(program, np.array([[p[name] for name in program.layout.parameters] for p in own]))
            t, x = np.array([starts[i].t for i in some]), np.array([starts[i].x for i in some])
            y = self.modes.states(mode, t, x, c)
            for place, i in enumerate(some):
                begun[i] = _Begun(y[place], c[place])
        return begun

    def _up_to(self, t1: float, mode: Mode, begun: _Begun) -> Status:
        """Run one phase that ends at a time; return its status. One that takes no time is left out."""
        self.mode = mode
        if t1 == self.t:
            return Status.SUCCESS
        run = simulate_from_state(self.modes.model(mode), (self.t, t1), begun.y, begun.c, self._options())
        self._add(run, mode, float(run.t[-1]))
        return run.status if run.status is Status.SUCCESS else self._failed(run, mode)

    def _add(self, run: Trajectory, mode: Mode, end: float) -> None:
        """Take down a phase that ended at a time; one that took no time, and in which nothing occurred, leaves none."""
        stats = run.stats
        self.steps, self.rejected = self.steps + stats.steps, self.rejected + stats.rejected
        self.evaluations += stats.evaluations
        self.method = stats.method
        if end == self.t != self.request.t1 and run.status is Status.EVENT and not self.request.events:
            return
        part = Part(Phase(self.t, end, self.modes.named(mode)), run, self.modes.violation(mode))
        self.t = end
        self.parts.append(part)
        self.records.append((part, run.events))
        for event in self.request.events:
            self.counts[event.label] += len(run.events[event.label])

    def _phase(self) -> Status | None:
        """Run one phase and decide what comes after; return a status where the motion ends."""
        mode = self.mode
        assert mode is not None
        run = self._run(mode, self.request.t1, self._events() + self.modes.events(mode))
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
        x = last.variables[-1:]
        self.now.t[:], self.now.x[:], self.now.cases.passed[:] = self.t, x, self.t - before
        status = self._too_soon(abs(self.t - before))
        if status is not None:
            return status
        return self._after(mode, happened)

    def _after(self, mode: Mode, happened: Sequence[str]) -> Status | None:
        """Apply events that ended a phase, and decide how the motion goes on."""
        for event in self.request.events:
            if event.label in happened and event.apply is None and 0 < int(event.terminal) <= self.counts[event.label]:
                return Status.EVENT
        applied = [event for event in self.request.events if event.label in happened and event.apply is not None]
        self._renew_inputs()
        for event in applied:
            about = np.array([self.t]), self.now.x, self.now.c, self.request.layout.parameters
            after, allowed = self.request.jumps(event.label, *about)
            if not allowed[0]:
                return Status.EVENT_STATE
            self.now.x[:] = after
        if any(0 < int(event.terminal) <= self.counts[event.label] for event in applied):
            return Status.EVENT
        fired = [guard for guard in self.modes.guards(mode) if guard.output in happened]
        if any(guard.kind == "paradox" for guard in fired):
            self.note = self._where()
            return Status.CONTACT_IMPOSSIBLE
        if applied:
            self.mode, fired = None, []
        return self._decide(fired)

    def _failed(self, run: Trajectory, mode: Mode) -> Status:
        """Return how a phase ended that no event ended; a failure near Painleve's paradox is one of that."""
        self.note = run.stats.note
        status = run.status
        if status in BROKEN and SLIP in mode:
            if not run["uniqueness of reactions"][-1] > JAMMED:
                status = Status.CONTACT_IMPOSSIBLE
                self.now.x[:] = run.variables[-1]
                self.note = self._where()
        return status

    def _too_soon(self, passed: float) -> Status | None:
        """Judge whether phases follow each other too fast to be told apart."""
        if self.steps + self.rejected >= self.request.options.max_steps:
            return Status.MAX_STEPS
        span = abs(self.request.t1 - self.request.t0)
        self.soon = self.soon + 1 if passed <= SOON * span else 0
        if self.soon < SOON_IN_A_ROW:
            return None
        after = self.modes.named(self.mode or ())
        before = self.parts[-1].phase.modes if self.parts else after
        changing = [name for name in before if before[name] != after.get(name)] or list(before)
        self.note = f"contact {', '.join(changing)} {self._where()}"
        return Status.EVENTS_ACCUMULATE

    # -- results ---------------------------------------------------------------------------

    def _stay(self, status: Status) -> None:
        """Record the start of a motion that cannot go on from it."""
        mode = self._sliding_mode()
        model = self.modes.model(mode)
        names = model.layout.variables
        initial = dict(zip(names, self.now.x[0].tolist(), strict=True))
        options = SimulateOptions(method=self.request.options.method)
        run = simulate_in_own_time(model, (self.t, self.t), initial, self.request.parameters, options)
        self.parts.append(Part(Phase(self.t, self.t, self.modes.named(mode)), run, self.modes.violation(mode)))

    def _sliding_mode(self) -> Mode:
        """Return the mode at the start in which all that touches is closed, and slips."""
        decisions, now, able = self.modes.decisions, self.now, []
        gaps = decisions.numbers(decisions.values(now.t, now.x, now.c), GAP)[0]
        for contact, gap in zip(self.modes.equations.contacts, gaps, strict=True):
            smooth = SMOOTH if contact.regularization is not None else SLIP
            apart = contact.constraint is not None and gap > NOISE * (abs(gap) + 1.0)
            able.append(OPEN if apart else smooth if contact.tangential else CLOSED)
        return tuple(able)

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
        times = self.request.options.t_eval
        if times is not None:
            run = run(times[(times - self.t) * self.forward <= 0.0])
        if not self.request.events or not self.records:
            return run
        labels = [event.label for event in self.request.events]
        records = joined_records(labels, self.records, make)
        return run.with_events(EventRecords(list(records.values()), self.modes.equations.symbols.aliases))
