"""Runs with events taken one step at a time, for exports: the loop over lanes with the one lane of a run alone.

They are the runs of `dalembert.codegen.llvm.recorded`. The record has room for one step, so that the loop returns after
each one, and is what the state within that step is computed from.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ..arrays import FloatArray
from ..events.lane_events import restart
from ..lanes.lane_stops import end_of_case, pass_lane_stops, watch_constants
from ..lanes.step_records import END_AT, FIRST_AT, START_AT
from ..lanes.sweep_arguments import SweepArguments
from ..lanes.workspace import ATTEMPTS, END, NOW, REJECTIONS
from ..methods.status import RUNNING, Status
from ..methods.step_constants import RESOLUTION
from ..steps.projection import FAILED, PENDING, correct
from ..stops.instants import (
    InstantTable,
    begin_instants,
    continue_breaks,
    has_stops,
    keep_constants,
    list_instants,
)
from ..stops.stops import take_stops
from ..subset.arguments import Record, Vector
from ..subset.compiled_subset import compiled_subset, flat, fma, row
from .lane_loop import EVENT_LOOP, IMPLICIT_LOOP, STOP_EVENT_LOOP

_MOST_UPDATES = 100
"""Maps of a state at one time after which more of them count as without end."""


class EventPlace(Record):
    """Where the last step began and ended, the direction of time, 1 or -1, and the number of steps."""

    begin: float
    time: float
    direction: float
    steps: int


class EventSteps(NamedTuple):
    """A run with events; ``sampled`` (n_y,) gets a state, ``instants`` are those of controllers."""

    runner: SweepArguments
    sampled: Vector
    place: EventPlace
    instants: InstantTable


@compiled_subset
def _end(runner: SweepArguments) -> float:
    """Return the end of a run, which may have taken no step."""
    return runner.rows.times[0, 1] if runner.state.progress.paused == 0 else end_of_case(runner, 0)


@compiled_subset
def settle_run(steps: EventSteps) -> None:
    """Let controllers act that are due at the present time, and have not acted."""
    runner, rows, n, clock = steps.runner, steps.runner.rows, steps.runner.shape.n, steps.instants.clock
    if clock.due == 0:
        return
    clock.due = 0
    list_instants(steps.instants, runner.stops, _end(runner), False)
    if runner.state.progress.paused != 0:
        watch_constants(runner, pass_lane_stops(runner))
        return
    times, states, constants = flat(rows.times), flat(rows.states), flat(rows.constants)
    forward = steps.place.direction > 0.0
    take_stops(runner.stops, runner.kernels.prepare, times, states, 0, constants, n, forward)
    for m in range(n):
        runner.state.states[m, 0] = rows.states[0, m]


def event_step(loop: Callable[[SweepArguments], int]) -> Callable[[EventSteps], int]:
    """Return a function that takes a step by a loop over lanes, up to an event in it, and returns a status."""

    def take_step(steps: EventSteps) -> int:
        runner, place = steps.runner, steps.place
        state, progress = runner.state, runner.state.progress
        progress.recorded, runner.workspace.occurrences[0, 0] = 0, 0.0
        if runner.stops.inputs.ends.shape[0] > 0:
            for e in range(runner.events.directions.size):
                runner.workspace.ends[0, e] = math.nan
        if has_stops(steps.instants):
            settle_run(steps)
            list_instants(steps.instants, runner.stops, _end(runner), False)
            if progress.paused != 0:
                keep_constants(steps.instants.breaks, state.constants)
            else:
                keep_constants(steps.instants.breaks, flat(runner.rows.constants))
        if loop(runner) == 0:  # it has ended without a further step
            place.time = runner.ends[0, 0]
            return int(runner.ends[0, 1])
        if has_stops(steps.instants):
            watch_constants(runner, pass_lane_stops(runner))
        place.begin, place.time = runner.steps[0, START_AT], state.clock[NOW, 0]
        place.steps = int(state.tally[ATTEMPTS, 0] - state.tally[REJECTIONS, 0])
        return state.numbers.status[0]

    return compiled_subset(take_step)


@compiled_subset
def begin_run_instants(steps: EventSteps, t0: float) -> bool:
    """Take the periods of controllers in a run that begins at a time; return whether they make sense."""
    return begin_instants(steps.instants, row(steps.runner.rows.constants, 0), t0)


take_step, take_implicit_step = event_step(EVENT_LOOP), event_step(IMPLICIT_LOOP)
take_step_with_stops = event_step(STOP_EVENT_LOOP)


@compiled_subset
def cut_run(steps: EventSteps) -> None:
    """Continue a run with other inputs from its present time on, as behind a knot of these."""
    state = steps.runner.state
    if state.numbers.status[0] == RUNNING:
        state.clock[END, 0] = state.clock[NOW, 0]


@compiled_subset
def continue_run(steps: EventSteps, t1: float) -> None:
    """Continue a run behind its end up to another, as behind a knot of inputs.

    There its end was looked at, and signs were taken. Those before count, unless an event has occurred.
    """
    runner, state, space = steps.runner, steps.runner.state, steps.runner.workspace
    if has_stops(steps.instants):
        steps.instants.clock.due = 1
    if state.progress.paused == 0:  # it has taken no time
        runner.rows.times[0, 0], runner.rows.times[0, 1], runner.turn[0] = steps.place.time, t1, 0
        return
    if space.occurrences[0, 0] > 0.0:
        restart(runner, 0)
    else:
        for e in range(runner.events.directions.size):
            if abs(space.ends[0, e]) > 0.0:
                space.signs[0, e], space.zero[0, e], space.seen[0, e] = space.ends[0, e], 0.0, 1.0
    runner.stops.inputs.ends[0, 0], state.numbers.status[0] = t1, RUNNING
    state.tally[ATTEMPTS, 0] = state.tally[REJECTIONS, 0] = 0.0


@compiled_subset
def resume_run(steps: EventSteps, t1: float) -> bool:
    """Find the breaks of a run that continues, and decide conditions; return whether there is room for them."""
    runner, t, prepare = steps.runner, steps.place.time, steps.runner.kernels.prepare
    if runner.state.progress.paused == 0:  # it has taken no time
        return continue_breaks(steps.instants, runner.stops, prepare, flat(runner.rows.constants), t, t1)
    if not continue_breaks(steps.instants, runner.stops, prepare, runner.state.constants, t, t1):
        return False
    watch_constants(runner, 1)
    return True


@compiled_subset
def act_run(steps: EventSteps, t1: float) -> None:
    """Let controllers act that are due at the present time, which is the end of a run up to a time."""
    runner, state = steps.runner, steps.runner.state
    list_instants(steps.instants, runner.stops, t1, True)
    if state.progress.paused == 0:  # it has taken no time
        return
    runner.stops.inputs.ends[0, 0] = math.inf
    watch_constants(runner, pass_lane_stops(runner))
    runner.stops.inputs.ends[0, 0] = state.clock[END, 0] = t1
    state.numbers.status[0] = Status.SUCCESS


@compiled_subset
def correct_run(steps: EventSteps, t: float) -> int:
    """Project a state, ``sampled``, onto the constraints; return the status."""
    runner, status = steps.runner, RUNNING
    runner.part.clock[0, 0] = t
    for m in range(runner.shape.n):
        runner.part.states[m, 0] = steps.sampled[m]
    if not corrects(runner):
        status = Status.PROJECTION_FAILED
    for m in range(runner.shape.n):
        steps.sampled[m] = runner.part.states[m, 0]
    return status


def event_update(step: Callable[[EventSteps], int]) -> Callable[[EventSteps, float, float], int]:
    """Return a function that lets events happen at a time, in a state ``sampled`` that others have integrated.

    It begins runs of no length but rounding, that of ``least`` near time 0, with the signs of the last one: what has
    changed its sign since then occurs at once. It returns RUNNING where no event maps the state, SUCCESS where one has,
    and the status of a run that ends.
    """

    def update(steps: EventSteps, t: float, least: float) -> int:
        runner, n, outcome = steps.runner, steps.runner.shape.n, RUNNING
        for _ in range(_MOST_UPDATES):
            runner.rows.times[0, 0], runner.rows.times[0, 1] = t, t + RESOLUTION * max(abs(t), least)
            for m in range(n):
                runner.rows.states[0, m] = steps.sampled[m]
            runner.turn[0], runner.state.progress.paused = 0, 0
            status = step(steps)
            while status == RUNNING and not _was_mapped(runner):
                status = step(steps)
            if not _was_mapped(runner):
                return outcome if status == Status.SUCCESS else status
            for m in range(n):
                steps.sampled[m] = runner.state.states[runner.state.progress.old + m, 0]
            for e in range(runner.events.directions.size):
                runner.workspace.carried[0, 2 * e] = math.nan
            if status != RUNNING and status != Status.SUCCESS:
                return status
            outcome = Status.SUCCESS
        return Status.EVENTS_ACCUMULATE

    return compiled_subset(update)


@compiled_subset
def _was_mapped(runner: SweepArguments) -> bool:
    """Return whether an event in the last step has stopped the motion."""
    occurrences, mapped = runner.workspace.occurrences, False
    for k in range(int(occurrences[0, 0])):
        mapped = mapped or occurrences[1 + k, 3] >= 1.0
    return mapped


@compiled_subset
def sample_step(steps: EventSteps, t: float) -> None:
    """Compute the state at a time within the last step; at its end, the state that events have left."""
    runner, n = steps.runner, steps.runner.shape.n
    if t == steps.place.time:
        for m in range(n):
            steps.sampled[m] = runner.state.states[runner.state.progress.old + m, 0]
        return
    runner.part.clock[0, 0] = t
    _interpolate(runner, t)
    if not _corrects_within(steps):  # it stays as it is
        _interpolate(runner, t)
    for m in range(n):
        steps.sampled[m] = runner.part.states[m, 0]


@compiled_subset
def _interpolate(runner: SweepArguments, t: float) -> None:
    """Compute the state at a time within the step that is recorded."""
    n, terms, x = runner.shape.n, runner.shape.degree + 1, t - runner.steps[0, START_AT]
    if runner.shape.memory > 0:
        x /= runner.steps[0, END_AT] - runner.steps[0, START_AT]
    for m in range(n):
        value = 0.0
        for k in range(terms - 1, -1, -1):
            value = fma(value, x, runner.steps[0, FIRST_AT + 2 * n + m * terms + k])
        runner.part.states[m, 0] = value


@compiled_subset
def _corrects_within(steps: EventSteps) -> bool:
    """Project the state in ``part``, which lies within the last step; return whether that succeeds."""
    if steps.instants.breaks.before.shape[0] > 0:
        return _corrects_by(steps.runner, steps.instants.breaks.before)
    return corrects(steps.runner)


@compiled_subset
def corrects(runner: SweepArguments) -> bool:
    """Project the state in ``part`` onto the constraints; return whether that succeeds."""
    return _corrects_by(runner, runner.state.constants)


@compiled_subset
def _corrects_by(runner: SweepArguments, constants: FloatArray) -> bool:
    part, state, lone = runner.part, runner.state, runner.state.numbers.lone
    tolerances = state.settings.shape[0] - 2
    rtol, atol = state.settings[tolerances, 0], state.settings[tolerances + 1, 0]
    lone[0] = PENDING
    correct(
        runner.kernels.position, runner.kernels.velocity, part.clock, part.states, 0, part.states, 0,
        constants, state.delta, lone, rtol, atol,
    )  # fmt: skip
    return lone[0] != FAILED


update, implicit_update, update_with_stops = map(event_update, (take_step, take_implicit_step, take_step_with_stops))
