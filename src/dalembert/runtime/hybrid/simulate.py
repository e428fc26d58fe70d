"""Simulation of one motion with contacts: phases by the loop over phases, or each a run of the model of its mode."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ...arrays import FloatArray
from ...errors import InitialStateError
from ...hybrid import CLOSED, OPEN, SLIP, SMOOTH, Mode
from ...integrators.contact_cases import NOISE, UNDECIDED
from ...integrators.contact_decisions import SOON, SOON_IN_A_ROW
from ...integrators.contact_table import GAP
from ...integrators.event_code import Event
from ...integrators.workspace import RUNNING
from ...ir.program import Layout
from ...mechanics.equations import Guard
from ...methods.status import Status
from ...options import SimulateOptions
from ...results.hybrid import HybridTrajectory, Part, Phase
from ...results.motion import RunStatistics
from ...results.trajectory import Trajectory
from ..input_values import GivenInputs
from ..simulate import simulate_in_own_time
from .decisions import flag
from .event_jumps import EventJumps
from .mode_models import ModeModels
from .motion_recorder import MotionRecorder, RecordedPhase, recorder_of, trajectories
from .output_values import BROKEN, JAMMED
from .phase_events import PhaseEvents, after_jump, event_history
from .phases import compiled_phases
from .start_faults import start_error
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
        self.phases: list[Phase] = []
        self.records: list[PhaseEvents] = []
        self.counts = {event.label: 0 for event in request.events}
        self.steps = self.rejected = self.evaluations = self.soon = 0
        self.compile_seconds = 0.0
        self.method = request.options.method
        self.note = ""
        self.recorder: MotionRecorder | None = None

    def trajectory(self) -> HybridTrajectory:
        """Run to the end and return what was recorded."""
        request = self.request
        if self.breaks is None and self.inputs is None and compiled_phases(self.modes):
            with recorder_of(self.modes, request.layout, request.options, request.events) as self.recorder:
                return self._joined(self._end())
        return self._joined(self._end())

    def _end(self) -> Status:
        """Run to the end and return the status."""
        status: Status | None = None
        if self.recorder is None or self.request.options.first_step is not None:
            status = self._decide(())
            status = self._phase() if status is None else status
        while status is None:
            status = None if self.recorder is None else self._recorded(self.recorder)
            status = self._phase() if status is None else status
        if not self.parts:
            self._stay(status)
        return status

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
            raise start_error(self.modes, self.now) or InitialStateError("the initial state contradicts the contacts")
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
        cases = self.now.cases
        added = self.modes.added(mode, self.now.directions()[0], cases.sides[0], cases.rest[0])
        own = {**self.request.parameters, **self._inputs_at(self.t)}
        own |= {name: float(value) for name, value in added.items()}
        return simulate_in_own_time(model, (self.t, t1), initial, own, self._options(events))

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

    def _recorded(self, recorder: MotionRecorder) -> Status | None:
        """Run phases by compiled code as far as it serves their modes; return a status where the motion ends."""
        case = recorder.case
        numbers = case.table.numbers
        if self.mode is None:
            case.begin(self.t, self.request.t1, self.now.x[0], self.now.c[0])
        else:
            case.begin_from(self.now, self.request.t1)
        numbers.soon[0], numbers.steps[0] = self.soon, self.steps + self.rejected
        case.table.occurred[0, ::3] = list(self.counts.values())
        phases = recorder.run(self.request.jumps)
        self.compile_seconds += case.executor.compile_seconds
        self.now.copied_from(case.state)
        self.soon, status = int(numbers.soon[0]), case.status
        self._add_phases(phases, status)
        if status is Status.INITIAL_STATE and not phases:
            raise start_error(self.modes, self.now) or InitialStateError("the initial state contradicts the contacts")
        self.t = float(self.now.t[0])
        if status is None or status is Status.INITIAL_STATE:  # the model of the mode says what is wrong
            self.mode = self.modes.automaton.mode(int(self.now.mode_numbers()[0]))
            return None
        if status in (Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS):
            self.note = self._where()
        elif status is Status.EVENTS_ACCUMULATE:
            self.note = self._changing(*(self.modes.named(phase.mode) for phase in (phases[-2:] * 2)[:2]))
        if any(phase.after is not None for phase in phases[-1:]) and status is Status.EVENT:
            self._end_after_jump()
        return status

    def _add_phases(self, phases: Sequence[RecordedPhase], status: Status | None) -> None:
        """Take down the phases that compiled code has run; those that took no time leave none but the last."""
        kept = [phase for phase in phases if phase.t0 != phase.t1 or phase.after is not None]
        if status is not None and not (status.success and (kept or self.parts)):
            kept += [phase for phase in phases[-1:] if phase not in kept]
        options, labels = self.request.options, [event.label for event in self.request.events]
        ended = Status.SUCCESS if status is None else status
        dense = options.dense or options.t_eval is not None
        runs = trajectories(self.modes, kept, self.request.parameters, ended, labels, dense=dense)
        for phase, run in zip(kept, runs, strict=True):
            self._add(run, phase.mode, phase.t1, phase.after)

    def _add(self, run: Trajectory, mode: Mode, end: float, after: FloatArray | None = None) -> None:
        """Take down a phase that ended at a time, and perhaps in a jump."""
        stats = run.stats
        self.steps, self.rejected = self.steps + stats.steps, self.rejected + stats.rejected
        self.evaluations += stats.evaluations
        self.method = stats.method or self.method
        part = Part(Phase(self.t, end, self.modes.named(mode)), run, self.modes.violation(mode))
        self.t = end
        self.parts.append(part)
        self.phases.append(part.phase)
        self.records.append(PhaseEvents(part, run.events, after))
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
        occurred = any(len(run.events[event.label]) for event in self.request.events)
        if end != self.t or end == self.request.t1 or not ended or occurred:
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
        self._renew_inputs()
        if any(label in self.request.jumps for label in happened):
            return self._jump(happened)
        fired = [guard for guard in self.modes.guards(mode) if guard.output in happened]
        if any(guard.kind == "paradox" for guard in fired):
            self.note = self._where()
            return Status.CONTACT_IMPOSSIBLE
        return self._decide(fired)

    def _jump(self, happened: Sequence[str]) -> Status | None:
        """Map the state by the events that ended a phase, and decide how the motion goes on."""
        occurred = [
            (self.counts[e.label], np.nan, self.t if e.label in happened else np.nan) for e in self.request.events
        ]
        here = np.zeros(1, np.intp)
        status = int(self.request.jumps.apply(self.now, np.array(occurred).reshape(1, -1), here)[0])
        self.records[-1] = replace(self.records[-1], after=self.now.x[0].copy())
        if status == RUNNING:
            self.mode = None
            return self._decide(())
        if status == Status.EVENT:
            self._end_after_jump()
        return Status(status)

    def _end_after_jump(self) -> None:
        """Record the state after a jump with which the motion ends."""
        last = self.records[-1]
        assert last.after is not None
        self.parts.append(after_jump(last.part, self.request.jumps, last.after, self.request.c))

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
        self.note = self._changing(self.phases[-1].modes if self.phases else after, after)
        return Status.EVENTS_ACCUMULATE

    def _changing(self, before: Mapping[str, str], after: Mapping[str, str]) -> str:
        """Return which contacts change, and where, for the note."""
        changing = [name for name in before if before[name] != after.get(name)] or list(before)
        return f"contact {', '.join(changing)} {self._where()}"

    # -- results ---------------------------------------------------------------------------

    def _stay(self, status: Status) -> None:
        """Record the start of a motion that cannot go on from it."""
        mode = self._sliding_mode()
        model = self.modes.model(mode)
        names = model.layout.variables
        initial = dict(zip(names, self.now.x[0].tolist(), strict=True))
        options = SimulateOptions(method=self.request.options.method)
        run = simulate_in_own_time(model, (self.t, self.t), initial, self.request.parameters, options)
        part = Part(Phase(self.t, self.t, self.modes.named(mode)), run, self.modes.violation(mode))
        self.parts.append(part)
        self.phases.append(part.phase)

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
        options = self.request.options
        stats = RunStatistics(
            method=self.method,
            steps=self.steps,
            rejected=self.rejected,
            evaluations=self.evaluations,
            compile_seconds=self.compile_seconds,
            run_seconds=seconds,
            note=self.note,
            rtol=options.rtol,
            atol=options.atol,
        )
        phases = self.phases
        name = self.modes.equations.name

        def make(parts: Sequence[Part]) -> HybridTrajectory:
            return HybridTrajectory(parts, phases, None, self.parts, status, stats, name, self.request.layout)

        run = make(self.parts)
        times = self.request.options.t_eval
        if times is not None:
            run = run(times[(times - self.t) * self.forward <= 0.0])
        if not self.request.events or not self.records:
            return run
        aliases = self.modes.equations.symbols.aliases
        about = make, self.request.jumps, self.request.c, aliases
        return run.with_events(event_history(self.request.events, self.records, *about))
