"""Simulation of one motion with contacts: phases by the loop over phases, or each a run of the model of its mode."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import final

import numpy as np

from ...errors import InitialStateError
from ...hybrid import CLOSED, OPEN, SLIP, SMOOTH, Mode
from ...integrators.contact_cases import NOISE, UNDECIDED
from ...integrators.contact_decisions import SOON, SOON_IN_A_ROW
from ...integrators.contact_table import GAP
from ...integrators.event_code import Event
from ...integrators.workspace import RUNNING
from ...mechanics.equations import Guard
from ...methods.status import Status
from ...options import SimulateOptions
from ...results.hybrid import HybridTrajectory, Part, Phase
from ...results.trajectory import Trajectory
from ..input_values import GivenInputs
from ..simulate import simulate_in_own_time
from .controller_clocks import ControllerClocks
from .decisions import flag
from .mode_models import ModeModels
from .motion_log import MotionLog
from .motion_recorder import MotionRecorder, recorder_of
from .output_values import BROKEN, JAMMED
from .phases import compiled_phases
from .request import MotionRequest
from .start_faults import start_error
from .state import HybridState
from .stops import stops_of

__all__ = ["simulate"]


def simulate(modes: ModeModels, request: MotionRequest) -> HybridTrajectory:
    """Return the motion that was asked for."""
    return _Run(modes, request).trajectory()


@final
class _Run:
    """One run in progress."""

    def __init__(self, modes: ModeModels, request: MotionRequest) -> None:
        self.modes, self.request = modes, request
        self.forward = 1.0 if request.t1 >= request.t0 else -1.0
        t, x, c = np.array([request.t0]), request.x[np.newaxis], request.c[np.newaxis]
        t1 = np.array([request.t1])
        self.now = HybridState.starting(t, x, c, t1 - t, len(modes.equations.contacts), len(modes.equations.states))
        given = request.options.inputs
        given = given if given is not None and given.sampled else None
        compiled = compiled_phases(modes)
        self.stops = stops_of(modes, request.layout, given, c, (t, t1), request.options.t_eval) if compiled else None
        self.breaks = self.stops.breaks if self.stops is not None else None if compiled else modes.breaks(c, t, t1)
        self.inputs: GivenInputs | None = given
        sampling, wanted = modes.sampling(request.layout), request.options.t_eval
        self.clocks = None if sampling is None else ControllerClocks(sampling, t, t1, c, wanted)
        self.mode: Mode | None = None
        self.soon = 0
        self.log = MotionLog(modes, request)
        self.recorder: MotionRecorder | None = None

    def trajectory(self) -> HybridTrajectory:
        """Run to the end and return what was recorded."""
        request = self.request
        if compiled_phases(self.modes):
            known = self.modes, request.layout, request.options, request.events, self.stops
            with recorder_of(*known) as self.recorder:
                return self.log.trajectory(self._end())
        return self.log.trajectory(self._end())

    def _end(self) -> Status:
        """Run to the end and return the status."""
        status: Status | None = None
        if self.recorder is None or self.request.options.first_step is not None:
            status = self._decide(())
            status = self._phase() if status is None else status
        while status is None:
            status = None if self.recorder is None else self._recorded(self.recorder)
            status = self._phase() if status is None else status
        if not self.log.parts:
            self._stay(status)
        return status

    # -- between phases --------------------------------------------------------------------

    def _decide(self, fired: Sequence[Guard]) -> Status | None:
        """Decide how the motion goes on; return a status where it cannot."""
        cases = self.now.cases
        self._pass_break()
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
            self.log.note = self._where()
            return status
        self.mode = self.modes.automaton.mode(int(self.now.mode_numbers()[0]))
        return None

    def _pass_break(self) -> None:
        """Let parameters be those from the present time on, and controllers act that are to act then."""
        one = np.zeros(1, np.intp)
        if self.breaks is not None and self.breaks.place is not None:
            self.now.c[:, self.breaks.place] = self.breaks.middles(one, self.now.t)
        for name, column in self._inputs_at(float(self.now.t[0])).items():
            self.now.c[:, self.request.layout.parameters.index(name)] = column
        if self.clocks is not None:
            self.now.x[:] = self.clocks.act(one, self.now.t, self.now.x, self.now.c)

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
        return f"at t = {self.log.t:.6g} with {place}"

    # -- phases ----------------------------------------------------------------------------

    def _run(self, mode: Mode, t1: float, events: Sequence[Event]) -> Trajectory:
        """Run the model of a mode from where the motion is, up to a time or what ends it."""
        equations = self.modes.equations
        names = equations.symbols.variables
        initial = dict(zip(names, self.now.x[0].tolist(), strict=True))
        before = time.perf_counter()
        model = self.modes.model(mode)
        self.log.compile_seconds += time.perf_counter() - before
        cases = self.now.cases
        added = self.modes.added(mode, self.now.directions()[0], cases.sides[0], cases.rest[0])
        own = {**self.request.parameters, **self._inputs_at(self.log.t)}
        own |= {name: float(value) for name, value in added.items()}
        clock = None if self.clocks is None else self.clocks.clocks[0]
        return simulate_in_own_time(model, (self.log.t, t1), initial, own, self._options(events), clock)

    def _options(self, events: Sequence[Event] = ()) -> SimulateOptions:
        """Return the options of the next phase."""
        options = self.request.options
        return replace(
            options,
            events=events,
            t_eval=None,
            max_steps=max(1, options.max_steps - self.log.attempts),
            dense=options.dense or options.t_eval is not None,
            first_step=None if self.log.parts else options.first_step,
        )

    def _recorded(self, recorder: MotionRecorder) -> Status | None:
        """Run phases by compiled code as far as it serves their modes; return a status where the motion ends."""
        case = recorder.case
        numbers = case.table.numbers
        if self.mode is None:
            case.begin(self.log.t, self.request.t1, self.now.x[0], self.now.c[0])
        else:
            case.begin_from(self.now, self.request.t1)
        numbers.soon[0], numbers.steps[0] = self.soon, self.log.attempts
        case.table.occurred[0, ::3] = list(self.log.counts.values())
        phases = recorder.run(self.request.jumps)
        self.log.compile_seconds += case.executor.compile_seconds
        self.now.copied_from(case.state)
        self.soon, status = int(numbers.soon[0]), case.status
        self.log.add_recorded(phases, status, self.stops)
        if self.clocks is not None:
            self.clocks.clocks[0].last = float(self.now.t[0])
        if status is Status.INITIAL_STATE and not phases:
            raise start_error(self.modes, self.now) or InitialStateError("the initial state contradicts the contacts")
        self.log.t = float(self.now.t[0])
        if status is None or status is Status.INITIAL_STATE:  # the model of the mode says what is wrong
            self.mode = self.modes.automaton.mode(int(self.now.mode_numbers()[0]))
            return None
        if status in (Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS):
            self.log.note = self._where()
        elif status is Status.EVENTS_ACCUMULATE:
            self.log.note = self._changing(*(self.modes.named(phase.mode) for phase in (phases[-2:] * 2)[:2]))
        if any(phase.after is not None for phase in phases[-1:]) and status is Status.EVENT:
            self.log.end_after_jump()
        return status

    def _phase(self) -> Status | None:
        """Run one phase and decide what comes after; return a status where the motion ends."""
        mode = self.mode
        assert mode is not None
        run = self._run(mode, self.request.t1, self.log.events() + self.modes.events(mode))
        ended = run.status is Status.EVENT
        end = (
            max((r.t[-1] for r in run.events.values() if len(r)), key=lambda t: t * self.forward)
            if ended
            else run.t[-1]
        )
        before = self.log.t
        occurred = any(len(run.events[event.label]) for event in self.request.events)
        if end != self.log.t or end == self.request.t1 or not ended or occurred:
            self.log.add(run, mode, float(end))
        happened = [name for name, record in run.events.items() if len(record) and record.t[-1] == end] if ended else []
        if not ended:
            return self._failed(run, mode)
        last = run.events[happened[0]].after
        x = last.variables[-1:]
        self.now.t[:], self.now.x[:], self.now.cases.passed[:] = self.log.t, x, self.log.t - before
        status = self._too_soon(abs(self.log.t - before))
        if status is not None:
            return status
        return self._after(mode, happened)

    def _after(self, mode: Mode, happened: Sequence[str]) -> Status | None:
        """Apply events that ended a phase, and decide how the motion goes on."""
        for event in self.request.events:
            if (
                event.label in happened
                and event.apply is None
                and 0 < int(event.terminal) <= self.log.counts[event.label]
            ):
                return Status.EVENT
        self._pass_break()
        if any(label in self.request.jumps for label in happened):
            return self._jump(happened)
        fired = [guard for guard in self.modes.guards(mode) if guard.output in happened]
        if any(guard.kind == "paradox" for guard in fired):
            self.log.note = self._where()
            return Status.CONTACT_IMPOSSIBLE
        return self._decide(fired)

    def _jump(self, happened: Sequence[str]) -> Status | None:
        """Map the state by the events that ended a phase, and decide how the motion goes on."""
        occurred = [
            (self.log.counts[e.label], np.nan, self.log.t if e.label in happened else np.nan)
            for e in self.request.events
        ]
        here = np.zeros(1, np.intp)
        status = int(self.request.jumps.apply(self.now, np.array(occurred).reshape(1, -1), here)[0])
        self.log.records[-1] = replace(self.log.records[-1], after=self.now.x[0].copy())
        if status == RUNNING:
            self.mode = None
            return self._decide(())
        if status == Status.EVENT:
            self.log.end_after_jump()
        return Status(status)

    def _failed(self, run: Trajectory, mode: Mode) -> Status:
        """Return how a phase ended that no event ended; a failure near Painleve's paradox is one of that."""
        self.log.note = run.stats.note
        status = run.status
        if status in BROKEN and SLIP in mode:
            if not run["uniqueness of reactions"][-1] > JAMMED:
                status = Status.CONTACT_IMPOSSIBLE
                self.now.x[:] = run.variables[-1]
                self.log.note = self._where()
        return status

    def _too_soon(self, passed: float) -> Status | None:
        """Judge whether phases follow each other too fast to be told apart."""
        if self.log.attempts >= self.request.options.max_steps:
            return Status.MAX_STEPS
        span = abs(self.request.t1 - self.request.t0)
        self.soon = self.soon + 1 if passed <= SOON * span else 0
        if self.soon < SOON_IN_A_ROW:
            return None
        after = self.modes.named(self.mode or ())
        self.log.note = self._changing(self.log.phases[-1].modes if self.log.phases else after, after)
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
        run = simulate_in_own_time(model, (self.log.t, self.log.t), initial, self.request.parameters, options)
        part = Part(Phase(self.log.t, self.log.t, self.modes.named(mode)), run, self.modes.violation(mode))
        self.log.parts.append(part)
        self.log.phases.append(part.phase)

    def _sliding_mode(self) -> Mode:
        """Return the mode at the start in which all that touches is closed, and slips."""
        decisions, now, able = self.modes.decisions, self.now, []
        gaps = decisions.numbers(decisions.values(now.t, now.x, now.c), GAP)[0]
        for contact, gap in zip(self.modes.equations.contacts, gaps, strict=True):
            smooth = SMOOTH if contact.regularization is not None else SLIP
            apart = contact.constraint is not None and gap > NOISE * (abs(gap) + 1.0)
            able.append(OPEN if apart else smooth if contact.tangential else CLOSED)
        return tuple(able)
