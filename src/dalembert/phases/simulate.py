"""Simulation of one motion with contacts."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from ..contacts.contact_cases import ContactCases
from ..errors import InitialStateError, list_names
from ..methods.status import Status
from ..options import SimulateOptions
from ..results.events import EventRecord, EventRecords
from ..results.parts import Part, Phase
from ..results.statistics import RunStatistics
from ..results.trajectory import Trajectory
from ..runs.sampling import free_places, growth_note
from ..runs.simulate import simulate_in_own_time
from .mode_models import ModeModels
from .motion_recorder import MotionRequest, RecordedPhase, recorder_of
from .phase_motions import parameters_of_phases, trajectories

_SAME = 1e-9
"""Share of a state by which the state after an impact differs at least."""


def simulate(request: MotionRequest[SimulateOptions]) -> Trajectory:
    """Return the requested motion.

    Raises
    ------
    ValueInputError, InitialStateError
        For starts that the contacts forbid.
    """
    options, modes, begin = request.options, request.modes, time.perf_counter()
    stops = request.stops()
    with recorder_of(request) as recorder:
        phases, case = recorder.run(request, stops), recorder.case
        status, now, seconds = case.status, case.cases, case.choice.compile_seconds
        if status is Status.INITIAL_STATE:
            _refuse(request, phases, now)
        kept = _kept(phases, status)
        runs = trajectories(kept, request, status, stops)
        about = {m: (modes.named(m), modes.opened(m), modes.closed(m)) for m in {phase.mode: None for phase in kept}}
        parts = [_part(run, phase.t0, phase.t1, *about[phase.mode]) for phase, run in zip(kept, runs, strict=True)]
        if not kept:
            runs, parts = _start(request, now)
        note = _note(modes, phases, now, status, case.first) or recorder.note or _shared_impacts(modes, now)
        end = now.x[0].copy()
    stats = _statistics(runs, options, note, (seconds, time.perf_counter() - begin - seconds))
    whole, after = list(parts), None
    if kept and status is Status.EVENT:
        after = kept[-1].after
    elif kept and status is Status.SUCCESS and _struck_at_end(parts[-1], end):
        after = end
    if after is not None:
        whole.append(_after_jump(parts[-1], request, after))

    own = tuple(part.phase for part in parts if part.phase is not None)

    def make(some: Sequence[Part]) -> Trajectory:
        return Trajectory(some, status, stats, modes.layout, own, whole)

    run, times = make(whole), options.t_eval
    if times is not None:
        forward = 1.0 if request.t1[0] >= request.t0[0] else -1.0
        run = run.at_elapsed(times[(times - own[-1].t1) * forward <= 0.0], options.origin)
    if not request.labels or not kept:
        return run
    history = _event_history(request, kept, runs, parts, make)
    return run.with_events(EventRecords(history, modes.equations.symbols.aliases))


def _part(run: Trajectory, t0: float, t1: float, named: Mapping[str, str], *contacts: tuple[str | None, ...]) -> Part:
    """Return the motion of a phase, with what each contact does in it, and the contacts of the constraints."""
    return run.parts[0].in_phase(Phase(t0, t1, named), *contacts)


def _after_jump(part: Part, request: MotionRequest[SimulateOptions], x: FloatArray) -> Part:
    """Return the variables x (2 n_q + n_z,) after a jump at the end of a phase.

    They belong to no mode yet, and are a motion of the model in which all that can open is open.
    """
    t, modes, model = np.array([part.t_end]), request.modes, request.jumps.model
    y, c = request.jumps.motion_state(t, x[np.newaxis], request.p)
    after = Part(model.stages.program, c[0], t, y, None, None, model.stages.scene, model.monitors)
    return after.in_phase(part.phase and replace(part.phase, t0=part.phase.t1), modes.opened(modes.open_mode))


def _event_history(
    request: MotionRequest[SimulateOptions],
    phases: Sequence[RecordedPhase],
    runs: Sequence[Trajectory],
    parts: Sequence[Part],
    make: Callable[[Sequence[Part]], Trajectory],
) -> list[EventRecord]:
    """Return the records of all events over phases and their motions; `make` joins parts."""
    history = []
    for label in request.labels:
        records = [run.events[label] for run in runs]
        sides = [(record.before.parts[0], record.after.parts[0]) for record in records]
        about = [(part.phase, part.opened, part.closed) for part in parts]
        before = [side.in_phase(*own) for own, (side, _) in zip(about, sides, strict=True)]
        after = [side.in_phase(*own) for own, (_, side) in zip(about, sides, strict=True)]
        for i, (phase, record) in enumerate(zip(phases, records, strict=True)):
            if phase.after is not None and label in request.jumps and len(record):  # a phase ends where its state jumps
                after[i] = _after_jump(parts[i], request, phase.after)
        signs = np.concatenate([record.direction for record in records])
        history.append(EventRecord(label, signs, make(before), make(after)))
    return history


def _struck_at_end(part: Part, x: FloatArray) -> bool:
    """Return whether the state x (2 n_q + n_z,) in which a motion ends is that after an impact at its end."""
    gap = np.abs(x - part.variables[-1])
    return bool(np.max(gap, initial=0.0) > _SAME * np.max(np.abs(x), initial=0.0))


def _kept(phases: Sequence[RecordedPhase], status: Status) -> list[RecordedPhase]:
    """Return the phases of a motion, of those that took no time at most the last.

    That is left out where the motion has reached its end, unless Python has run the phase before.
    """
    kept = [phase for phase in phases if phase.t0 != phase.t1 or phase.after is not None]
    if not (status.success and kept) or (status is Status.SUCCESS and kept[-1].runs):
        kept += [phase for phase in phases[-1:] if phase not in kept]
    return kept


def _statistics(
    runs: Sequence[Trajectory], options: SimulateOptions, note: str, seconds: tuple[float, float]
) -> RunStatistics:
    """Return what a motion cost, with the seconds of compilation and of the run."""
    every = [run.stats for run in runs]
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


# -- motions that cannot continue --------------------------------------------------------------


def _refuse(request: MotionRequest[SimulateOptions], phases: Sequence[RecordedPhase], now: ContactCases) -> None:
    """Raise what is wrong with the start of a motion, or of its last phase.

    Raises
    ------
    ValueInputError, InitialStateError
    """
    modes = request.modes
    for phase in phases[-1:]:
        model = modes.serving(phase.mode)
        p = parameters_of_phases(modes, [phase], request.parameters)[0]
        own = dict(zip(model.layout.parameters, p.tolist(), strict=True))
        x = dict(zip(model.layout.variables, phase.x.tolist(), strict=True))
        model.for_segments.state(x, own, t=phase.t0)
    raise modes.decisions.start_error(now) or InitialStateError("the initial state contradicts the contacts")


def _note(
    modes: ModeModels,
    phases: Sequence[RecordedPhase],
    now: ContactCases,
    status: Status,
    first: FloatArray | None,
) -> str:
    """Return where a motion ended that its contacts stopped, or that grew without bound; nothing for others.

    `first` (1, n_x) is the state in which it began.
    """
    values = zip(modes.equations.symbols.variables, now.x[0], strict=True)
    where = f"at t = {float(now.t[0]):.6g} with {', '.join(f'{name} = {value:.6g}' for name, value in values)}"
    if status in (Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS):
        return where
    if status is Status.CONTACT_UNSUPPORTED:
        return (
            f"a gap of {list_names(modes.kinked_contacts(phases[-1].mode))} has a kink {where}: end the span before it"
        )
    if status is Status.DIVERGED and first is not None:
        free, names = free_places(modes.layout), modes.layout.state
        return growth_note([names[i] for i in free], float(now.t[0]), first[0, free], now.x[0, free])
    if status is not Status.EVENTS_ACCUMULATE:
        return ""
    before, after = (modes.named(phases[-k].mode) for k in (min(2, len(phases)), 1))
    return f"contact {', '.join(_changing(before, after))} {where}"


def _shared_impacts(modes: ModeModels, now: ContactCases) -> str:
    """Return that impacts shared an instant, when they did first, and by what law they were solved for."""
    count, when = int(now.shared[0]), f"t = {float(now.shared_at[0]):.6g}"
    if count == 0:
        return ""
    if modes.automaton.impacts == "sequence":
        return (
            f"impacts shared an instant, first at {when}, and were solved for one after the other (impacts='sequence')"
        )
    law = {"newton": "Newton", "poisson": "Poisson"}[modes.automaton.impacts]
    return (
        f"several contacts took part in {count} impact{'s' if count > 1 else ''}, first at {when}, all at once by"
        f" {law}'s law; compile_model(..., impacts='sequence') solves for one after the other"
    )


def _changing(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return which contacts differ in two modes; all where none does."""
    return [name for name in before if before[name] != after.get(name)] or list(before)


def _start(request: MotionRequest[SimulateOptions], now: ContactCases) -> tuple[list[Trajectory], list[Part]]:
    """Return the start of a motion that cannot continue, in the mode in which all touching contacts slip."""
    modes = request.modes
    gaps, noise = modes.decisions.gaps(now.t, now.x, now.p)
    mode, t = modes.automaton.sliding_mode(np.flatnonzero(gaps > noise).tolist()), float(request.t0[0])
    model = modes.model(mode)
    initial = dict(zip(model.layout.variables, now.x[0].tolist(), strict=True))
    options = SimulateOptions(method=request.options.method)
    run = simulate_in_own_time(model, (t, t), initial, request.parameters, options)
    return [run], [_part(run, t, t, modes.named(mode), modes.opened(mode))]
