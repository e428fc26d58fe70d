"""Record of one motion with contacts: its phases, what occurred in them, and what they cost."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ...arrays import FloatArray
from ...hybrid import Mode
from ...integrators.event_code import Event
from ...methods.status import Status
from ...results.hybrid import HybridTrajectory, Part, Phase
from ...results.motion import RunStatistics
from ...results.trajectory import Trajectory
from .mode_models import ModeModels
from .motion_recorder import RecordedPhase, trajectories
from .phase_events import PhaseEvents, after_jump, event_history
from .request import MotionRequest
from .stops import Stops

__all__ = ["MotionLog"]


@final
class MotionLog:
    """Record of a motion so far.

    Attributes
    ----------
    t : float
        Time that it has reached [s].
    parts : list of Part
        Trajectories of the phases.
    phases : list of Phase
    records : list of PhaseEvents
        Events of each phase.
    counts : dict of str to int
        How often each event occurred.
    attempts : int
        Steps, accepted or not.
    compile_seconds : float
    note : str
        How the run ended.
    """

    def __init__(self, modes: ModeModels, request: MotionRequest) -> None:
        self.modes, self.request, self.t = modes, request, request.t0
        self.parts: list[Part] = []
        self.phases: list[Phase] = []
        self.records: list[PhaseEvents] = []
        self.counts = {event.label: 0 for event in request.events}
        self.compile_seconds, self.note = 0.0, ""
        self._begin = time.perf_counter()
        self._steps = self._rejected = self._evaluations = 0
        self._method = request.options.method

    @property
    def attempts(self) -> int:
        """Steps, accepted or not."""
        return self._steps + self._rejected

    def events(self) -> list[Event]:
        """Return the events that were asked for, as a phase watches for them."""
        events = []
        for event in self.request.events:
            last = int(event.terminal) - self.counts[event.label] if event.terminal else 0
            last = 1 if event.apply is not None else last
            events.append(replace(event, name=event.label, apply=None, terminal=last))
        return events

    def add(self, run: Trajectory, mode: Mode, end: float, after: FloatArray | None = None) -> None:
        """Take down a phase that ended at a time, and perhaps in a jump."""
        stats = run.stats
        self._steps, self._rejected = self._steps + stats.steps, self._rejected + stats.rejected
        self._evaluations += stats.evaluations
        self._method = stats.method or self._method
        part = Part(Phase(self.t, end, self.modes.named(mode)), run, self.modes.violation(mode))
        self.t = end
        self.parts.append(part)
        self.phases.append(part.phase)
        self.records.append(PhaseEvents(part, run.events, after))
        for event in self.request.events:
            self.counts[event.label] += len(run.events[event.label])

    def add_recorded(self, phases: Sequence[RecordedPhase], status: Status | None, stops: Stops | None) -> None:
        """Take down the phases that compiled code has run; those that took no time leave none but the last."""
        kept = [phase for phase in phases if phase.t0 != phase.t1 or phase.after is not None]
        if status is not None and not (status.success and (kept or self.parts)):
            kept += [phase for phase in phases[-1:] if phase not in kept]
        options, labels = self.request.options, [event.label for event in self.request.events]
        ended = Status.SUCCESS if status is None else status
        dense = options.dense or options.t_eval is not None
        runs = trajectories(self.modes, kept, self.request.parameters, ended, labels, stops, dense=dense)
        for phase, run in zip(kept, runs, strict=True):
            self.add(run, phase.mode, phase.t1, phase.after)

    def end_after_jump(self) -> None:
        """Record the state after a jump with which the motion ends."""
        last = self.records[-1]
        assert last.after is not None
        self.parts.append(after_jump(last.part, self.request.jumps, last.after, self.request.c))

    def trajectory(self, status: Status) -> HybridTrajectory:
        """Return the motion, which ended with a status."""
        forward = 1.0 if self.request.t1 >= self.request.t0 else -1.0
        seconds = time.perf_counter() - self._begin - self.compile_seconds
        options = self.request.options
        stats = RunStatistics(
            method=self._method,
            steps=self._steps,
            rejected=self._rejected,
            evaluations=self._evaluations,
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
            run = run(times[(times - self.t) * forward <= 0.0])
        if not self.request.events or not self.records:
            return run
        aliases = self.modes.equations.symbols.aliases
        about = make, self.request.jumps, self.request.c, aliases
        return run.with_events(event_history(self.request.events, self.records, *about))
