"""Many cases side by side: every lane of a pack is a case with its own time, step and status.

A lane whose case has ended takes the next one at once, so cases of unequal length do not wait for each
other. Lanes never mix: what a case computes does not depend on its neighbours, to the last bit.

One loop serves every step kernel. A Taylor step chooses its size, never fails to reach it and remembers at most that
size, which is 0 in the beginning; an attempt of a Runge-Kutta step may be rejected, and what it remembers travels
behind the state (`dalembert.transforms.runge_kutta`). Threads run the loop on the same arrays, and take a few cases
at a time from a count that they share.
"""

from __future__ import annotations

from collections.abc import Callable

from ..events.lane_events import handle_events, watch_case
from ..events.lane_tests import hold_for_events, take_totals, test_steps
from ..lanes.case_loading import begin_lanes, enter_next, next_case_is_loaded, resumes, runs_on
from ..lanes.implicit_steps import begin_implicit_step, implicit_steps
from ..lanes.lane_steps import (
    accept_steps,
    advance_together,
    project_lanes,
    record_part,
    swap_states,
    take_step,
)
from ..lanes.lane_stops import begin_lane_stops, end_of_case, pass_lane_stops, run_on_at_stops, watch_constants
from ..lanes.step_records import compensate_steps, record_cases, record_steps, records_are_full
from ..lanes.sweep_arguments import SweepArguments
from ..subset.compiled_subset import compiled_subset, lane_count, lowest
from ..threads import STOPPED


@compiled_subset
def _pauses(arguments: SweepArguments) -> bool:
    """Count a round; return whether the loop is to return to Python."""
    progress = arguments.state.progress
    progress.rounds += 1
    if records_are_full(arguments):
        return True
    if progress.rounds != progress.patience:
        return False
    progress.rounds = 0
    return progress.returns != 0 or arguments.turn[0] >= STOPPED


def _loading(watched: bool, stops: bool) -> Callable[[SweepArguments], bool]:
    """Return a function that fills lanes whose cases have ended, with or without events and stops."""

    @compiled_subset
    def load(arguments: SweepArguments) -> bool:
        """Store the results of cases that have ended and load others; return whether there are any."""
        if stops:
            passed = pass_lane_stops(arguments)
            if watched:
                watch_constants(arguments, passed)
        left = arguments.state.progress.look
        while left != 0:
            lane = lowest(left)
            left &= left - 1
            if runs_on(arguments, lane):
                continue
            while not resumes(arguments, lane) and next_case_is_loaded(arguments):
                entered = enter_next(arguments, lane)
                if stops and entered:
                    begin_lane_stops(arguments, lane)
                if watched and entered:
                    watch_case(arguments, lane)
        return arguments.state.progress.active != 0

    return load


def _following(watched: bool, projected: bool, stops: bool, recorded: bool) -> Callable[[SweepArguments], None]:
    """Return a function for accepted steps: their projection, records and events, and stops."""

    @compiled_subset
    def follow(arguments: SweepArguments) -> None:
        """Project and record the steps of lanes that were looked at, and find events in them."""
        if watched:
            compensate_steps(arguments)
        if projected:
            project_lanes(arguments)
        if recorded:
            record_cases(arguments)
        if watched and stops:
            run_on_at_stops(arguments)
        if watched:
            test_steps(arguments)
            record_steps(arguments)
            handle_events(arguments)
            record_part(arguments)

    return follow


@compiled_subset
def take_implicit_steps(arguments: SweepArguments) -> None:
    """Attempt a step of the implicit method in every lane."""
    state, jumped = arguments.state, arguments.workspace.jumped
    for lane in range(lane_count()):
        fresh, behind = state.numbers.fresh[lane] != 0, jumped[lane, 2] != 0.0
        begin_implicit_step(arguments.implicit, state, lane, end_of_case(arguments, lane), fresh, behind)
    implicit_steps(arguments.implicit, state)


def sweeping(
    watched: bool,
    projected: bool,
    stops: bool = False,
    recorded: bool = False,
    step: Callable[[SweepArguments], None] = take_step,
) -> Callable[[SweepArguments], int]:
    """Return the loop, with or without events and reductions, projections, stops, and records of all cases.

    It returns 1 where it has paused.
    """
    load, follow = _loading(watched, stops), _following(watched, projected, stops, recorded)

    def loop(arguments: SweepArguments) -> int:
        progress, every = arguments.state.progress, (1 << arguments.state.clock.shape[1]) - 1
        if progress.paused == 0:
            begin_lanes(arguments)
        progress.paused, progress.rounds = 0, -1
        while True:
            if _pauses(arguments):
                progress.paused = 1
                break
            if not load(arguments):
                break
            step(arguments)
            progress.look = every
            if arguments.kernels.advance != 0:
                if watched:
                    hold_for_events(arguments)
                progress.look = advance_together(arguments)
                if watched:
                    take_totals(arguments, progress.look)
            if progress.look != 0:
                accept_steps(arguments)
            swap_states(arguments)
            if progress.look != 0:
                follow(arguments)
        return progress.paused

    return compiled_subset(loop)


LOOP = sweeping(watched=False, projected=False)
PROJECTED_LOOP = sweeping(watched=False, projected=True)
RECORDED_LOOP = sweeping(watched=False, projected=True, recorded=True)
STOP_LOOP = sweeping(watched=False, projected=True, stops=True)
EVENT_LOOP = sweeping(watched=True, projected=True)
STOP_EVENT_LOOP = sweeping(watched=True, projected=True, stops=True)
IMPLICIT_LOOP = sweeping(watched=True, projected=False, stops=True, step=take_implicit_steps)
