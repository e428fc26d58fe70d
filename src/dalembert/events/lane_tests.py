"""Tests of the steps of all lanes at once: which of them events and reductions have to look at."""

from __future__ import annotations

from ..lanes.lane_steps import next_record
from ..lanes.sweep_arguments import SweepArguments
from ..lanes.workspace import BEFORE, END, NEXT, NOW, POINT_LANES, EventWorkspace
from ..steps.projection import NONE
from ..subset.arguments import Matrix
from ..subset.compiled_subset import call_code, compiled_subset, row


@compiled_subset
def expect_signs(arguments: SweepArguments, lane: int) -> None:
    """Set the signs that the test of steps has to find in a lane; 0 where the case begins, or one was not seen."""
    space = arguments.workspace
    fresh = arguments.state.numbers.fresh[lane] != 0
    for e in range(space.expected.shape[0]):
        space.expected[e, lane] = 0.0 if fresh or space.seen[lane, e] == 0.0 else space.signs[lane, e]


@compiled_subset
def hold_for_events(arguments: SweepArguments) -> None:
    """Mark the lanes in whose last step an expression may change its sign, or a reduction needs more than bounds."""
    state, space, clock = arguments.state, arguments.workspace, arguments.state.clock
    new = state.states.shape[0] // 2 - state.progress.old
    size = row(state.states, new + arguments.shape.n + arguments.shape.events_with_series)
    _test(arguments, row(clock, 0), row(state.states, new))
    settings = row(state.settings, 0)
    call_code(arguments.events.held, row(clock, 0), row(space.tests, 0), size, settings, row(space.held, 0))
    for lane in range(clock.shape[1]):
        state.numbers.mark[lane] = NONE
        clock[NEXT, lane] = clock[END, lane] if space.held[0, lane] != 0.0 else clock[NOW, lane]
    for lane in range(clock.shape[1] if arguments.part.times.size > 0 else 0):
        clock[NEXT, lane] = next_record(arguments, lane) if space.held[0, lane] != 0.0 else clock[NOW, lane]


@compiled_subset
def take_totals(arguments: SweepArguments, looked: int) -> None:
    """Continue the reductions of all lanes but those that are looked at, the bits of `looked`."""
    space = arguments.workspace
    for e in range(space.totals.shape[0]):
        for lane in range(space.totals.shape[1]):
            if looked & (1 << lane) == 0:
                space.totals[e, lane] = space.held[1 + e, lane]


@compiled_subset
def _test(arguments: SweepArguments, time: int, states: int) -> None:
    """Test expressions over the steps of all lanes, which begin at times and have outputs at two addresses."""
    state, events, space = arguments.state, arguments.events, arguments.workspace
    constants, settings = row(state.constants, 0), row(state.settings, 0)
    if events.step_points != 0:
        call_code(events.step_points, time, states, constants, settings, row(space.step_points, 0))
    if events.step_values != 0:
        _evaluate(space, events.step_values, constants, space.step_values)
        call_code(events.step_signs, time, row(space.step_values, 0), constants, settings, row(space.step_signs, 0))
    elif space.step_signs.shape[0] > 0:
        call_code(events.step_signs, time, states, constants, settings, row(space.step_signs, 0))
    if events.step_running != 0:
        _evaluate(space, events.step_running, constants, space.step_running)
        call_code(events.step_bounds, time, row(space.step_running, 0), constants, settings, row(space.step_bounds, 0))
    elif space.step_bounds.shape[0] > 0:
        call_code(events.step_bounds, time, states, constants, settings, row(space.step_bounds, 0))


@compiled_subset
def _evaluate(space: EventWorkspace, code: int, constants: int, values: Matrix) -> None:
    """Evaluate expressions at the points of the steps of all lanes."""
    count, width = values.shape[0] // POINT_LANES, space.step_points.shape[0] // POINT_LANES
    for point in range(POINT_LANES):
        clock, state = row(space.step_points, point * width), row(space.step_points, point * width + 1)
        call_code(code, clock, state, constants, 0, row(values, point * count))


@compiled_subset
def test_steps(arguments: SweepArguments) -> None:
    """Test over the steps of all lanes which expressions keep their sign, and bound those that are reduced."""
    state, space = arguments.state, arguments.workspace
    if arguments.kernels.advance != 0:
        return  # they have been
    for lane in range(state.clock.shape[1]):
        space.step_begins[0, lane] = state.tally[BEFORE, lane]
    _test(arguments, row(space.step_begins, 0), row(state.states, state.progress.old))
