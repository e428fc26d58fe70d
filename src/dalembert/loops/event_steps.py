"""Runs with events taken one step at a time, for exports: the loop over lanes with the one lane of a run alone.

They are the runs of `dalembert.codegen.llvm.recorded`. The record has room for one step, so that the loop returns after
each one, and is what the state within that step is computed from.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..lanes.step_records import END_AT, FIRST_AT, START_AT
from ..lanes.sweep_arguments import SweepArguments
from ..lanes.workspace import ATTEMPTS, NOW, REJECTIONS
from ..steps.projection import FAILED, PENDING, correct
from ..subset.arguments import Record, Vector
from ..subset.compiled_subset import compiled_subset, fma
from .lane_loop import EVENT_LOOP, IMPLICIT_LOOP


class EventPlace(Record):
    """Where the last step began and ended, the direction of time, 1 or -1, and the number of steps."""

    begin: float
    time: float
    direction: float
    steps: int


class EventSteps(NamedTuple):
    """A run with events; ``sampled`` (n_y,) gets a state."""

    runner: SweepArguments
    sampled: Vector
    place: EventPlace


def event_step(loop: Callable[[SweepArguments], int]) -> Callable[[EventSteps], int]:
    """Return a function that takes a step by a loop over lanes, up to an event in it, and returns a status."""

    def take_step(steps: EventSteps) -> int:
        runner, place = steps.runner, steps.place
        state, progress = runner.state, runner.state.progress
        progress.recorded, runner.workspace.occurrences[0, 0] = 0, 0.0
        if loop(runner) == 0:  # it has ended without a further step
            place.time = runner.ends[0, 0]
            return int(runner.ends[0, 1])
        place.begin, place.time = runner.steps[0, START_AT], state.clock[NOW, 0]
        place.steps = int(state.tally[ATTEMPTS, 0] - state.tally[REJECTIONS, 0])
        return state.numbers.status[0]

    return compiled_subset(take_step)


take_step, take_implicit_step = event_step(EVENT_LOOP), event_step(IMPLICIT_LOOP)


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
    if not corrects(runner):  # it stays as it is
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
def corrects(runner: SweepArguments) -> bool:
    """Project the state in ``part`` onto the constraints; return whether that succeeds."""
    part, state, lone = runner.part, runner.state, runner.state.numbers.lone
    tolerances = state.settings.shape[0] - 2
    rtol, atol = state.settings[tolerances, 0], state.settings[tolerances + 1, 0]
    lone[0] = PENDING
    correct(
        runner.kernels.position, runner.kernels.velocity, part.clock, part.states, 0, part.states, 0,
        state.constants, state.delta, lone, rtol, atol,
    )  # fmt: skip
    return lone[0] != FAILED
