"""Simulation of one motion with contacts."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np

from ...arrays import FloatArray
from ...errors import InitialStateError
from ...hybrid import CLOSED, OPEN, SLIP, SMOOTH, Mode
from ...methods.status import Status
from ...options import SimulateOptions
from ...results.hybrid import HybridTrajectory, Part, Phase
from ...results.motion import RunStatistics
from ..simulate import simulate_in_own_time
from .mode_models import ModeModels
from .motion_recorder import RecordedPhase, recorder_of, trajectories
from .phase_events import PhaseEvents, after_jump, event_history
from .request import MotionRequest
from .start_faults import start_error
from .state import HybridState
from .stops import Stops, stops_of

__all__ = ["simulate"]

_SAME = 1e-9
"""Share of a state by which the state after an impact differs at least."""


def simulate(modes: ModeModels, request: MotionRequest) -> HybridTrajectory:
    """Return the requested motion.

    Raises
    ------
    ValueInputError, InitialStateError
        For starts that the contacts forbid.
    """
    options, begin = request.options, time.perf_counter()
    given = options.inputs if options.inputs is not None and options.inputs.sampled else None
    spans = np.array([request.t0]), np.array([request.t1])
    stops = stops_of(modes, request.layout, given, request.c[np.newaxis], spans, options.t_eval)
    with recorder_of(modes, request.layout, options, request.events, stops) as recorder:
        case = recorder.case
        case.begin(request.t0, request.t1, request.x, request.c)
        phases, now = recorder.run(request.jumps), case.state
        status, seconds = case.status, case.executor.compile_seconds
        if status is Status.INITIAL_STATE:
            _refuse(modes, request, phases, now)
        records = _records(modes, request, _kept(phases, status), status, stops)
        parts = [record.part for record in records] or [_start(modes, request, now)]
        note = _note(modes, phases, now, status) or recorder.note
    stats = _statistics(parts, options, note, (seconds, time.perf_counter() - begin - seconds))
    if status is Status.EVENT and records and records[-1].after is not None:
        parts.append(after_jump(records[-1].part, request.jumps, records[-1].after, request.c))
    elif status is Status.SUCCESS and records and _struck_at_end(records[-1].part, now.x[0]):
        parts.append(after_jump(records[-1].part, request.jumps, now.x[0], request.c))
    return _motion(modes, request, parts, records, status, stats)


def _struck_at_end(part: Part, x: FloatArray) -> bool:
    """Return whether the state x (2 n_q + n_z,) in which a motion ends is that after an impact at its end."""
    gap = np.abs(x - part.motion.variables[-1])
    return bool(np.max(gap, initial=0.0) > _SAME * np.max(np.abs(x), initial=0.0))


def _kept(phases: Sequence[RecordedPhase], status: Status) -> list[RecordedPhase]:
    """Return the phases of a motion, of those that took no time at most the last.

    That is left out where the motion has reached its end, unless Python has run the phase before.
    """
    kept = [phase for phase in phases if phase.t0 != phase.t1 or phase.after is not None]
    if not (status.success and kept) or (status is Status.SUCCESS and kept[-1].runs):
        kept += [phase for phase in phases[-1:] if phase not in kept]
    return kept


def _records(
    modes: ModeModels, request: MotionRequest, phases: Sequence[RecordedPhase], status: Status, stops: Stops | None
) -> list[PhaseEvents]:
    """Return the phases with their motions and events."""
    options, labels = request.options, [event.label for event in request.events]
    dense = options.dense or options.t_eval is not None
    runs = trajectories(modes, phases, request.parameters, status, labels, stops, dense=dense)
    found = []
    for phase, run in zip(phases, runs, strict=True):
        part = Part(Phase(phase.t0, phase.t1, modes.named(phase.mode)), run, modes.violation(phase.mode))
        found.append(PhaseEvents(part, run.events, phase.after))
    return found


def _statistics(
    parts: Sequence[Part], options: SimulateOptions, note: str, seconds: tuple[float, float]
) -> RunStatistics:
    """Return what a motion cost, with the seconds of compilation and of the run."""
    every = [part.motion.stats for part in parts]
    return RunStatistics(
        method=next((each.method for each in reversed(every) if each.method), options.method),
        steps=sum(each.steps for each in every),
        rejected=sum(each.rejected for each in every),
        evaluations=sum(each.evaluations for each in every),
        compile_seconds=seconds[0],
        run_seconds=seconds[1],
        note=note,
        rtol=options.rtol,
        atol=options.atol,
    )


def _motion(
    modes: ModeModels,
    request: MotionRequest,
    parts: Sequence[Part],
    records: Sequence[PhaseEvents],
    status: Status,
    stats: RunStatistics,
) -> HybridTrajectory:
    """Return the motion of some parts, at the requested times and with the requested events."""
    phases = [record.part.phase for record in records] or [part.phase for part in parts]

    def make(some: Sequence[Part]) -> HybridTrajectory:
        return HybridTrajectory(some, phases, None, parts, status, stats, modes.equations.name, request.layout)

    run, times = make(parts), request.options.t_eval
    if times is not None:
        forward = 1.0 if request.t1 >= request.t0 else -1.0
        run = run(times[(times - phases[-1].t1) * forward <= 0.0])
    if not request.events or not records:
        return run
    aliases = modes.equations.symbols.aliases
    return run.with_events(event_history(request.events, records, make, request.jumps, request.c, aliases))


# -- motions that cannot continue --------------------------------------------------------------


def _refuse(modes: ModeModels, request: MotionRequest, phases: Sequence[RecordedPhase], now: HybridState) -> None:
    """Raise what is wrong with the start of a motion, or of its last phase.

    Raises
    ------
    ValueInputError, InitialStateError
    """
    for phase in phases[-1:]:
        model = modes.model(phase.mode)
        own = dict(zip(model.layout.parameters, phase.parameters(modes, request.parameters), strict=True))
        x = dict(zip(model.layout.variables, phase.x.tolist(), strict=True))
        model.uncut.state(x, own, t=phase.t0)
    raise start_error(modes, now) or InitialStateError("the initial state contradicts the contacts")


def _note(modes: ModeModels, phases: Sequence[RecordedPhase], now: HybridState, status: Status) -> str:
    """Return where a motion ended whose contacts let it go no further, and what they did; nothing for others."""
    values = zip(modes.equations.symbols.variables, now.x[0], strict=True)
    where = f"at t = {float(now.t[0]):.6g} with {', '.join(f'{name} = {value:.6g}' for name, value in values)}"
    if status in (Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS):
        return where
    if status is not Status.EVENTS_ACCUMULATE:
        return ""
    before, after = (modes.named(phases[-k].mode) for k in (min(2, len(phases)), 1))
    return f"contact {', '.join(_changing(before, after))} {where}"


def _changing(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return which contacts differ in two modes; all where none does."""
    return [name for name in before if before[name] != after.get(name)] or list(before)


def _start(modes: ModeModels, request: MotionRequest, now: HybridState) -> Part:
    """Return the start of a motion that cannot continue, in the mode in which all touching contacts slip."""
    mode = _sliding_mode(modes, now)
    model, t = modes.model(mode), request.t0
    initial = dict(zip(model.layout.variables, now.x[0].tolist(), strict=True))
    options = SimulateOptions(method=request.options.method)
    run = simulate_in_own_time(model, (t, t), initial, request.parameters, options)
    return Part(Phase(t, t, modes.named(mode)), run, modes.violation(mode))


def _sliding_mode(modes: ModeModels, now: HybridState) -> Mode:
    """Return the mode in which all that touches is closed, and slips."""
    decisions, able = modes.decisions, []
    gaps, noise = decisions.gaps(decisions.values(now.t, now.x, now.c)[0], now.x[0])
    for contact, far in zip(modes.equations.contacts, gaps > noise, strict=True):
        smooth = SMOOTH if contact.regularization is not None else SLIP
        able.append(OPEN if far else smooth if contact.tangential else CLOSED)
    return tuple(able)
