"""Stops in lanes: the end of a lane's next steps is its next stop, from which its case continues."""

from __future__ import annotations

from ..ir.program import WIDTH
from ..methods.status import RUNNING, Status
from ..steps.step_control import largest_step, status_after
from ..stops.input_records import pass_knots, take_sides
from ..stops.stops import act, begin_stops, end_of_steps, is_due, prepare_lanes, take_next
from ..subset.compiled_subset import call_code, compiled_subset, lowest, row
from ..transforms.runge_kutta_parts import CONTROLS, PROPOSAL_AT
from .step_records import drop_compensation
from .sweep_arguments import SweepArguments
from .workspace import ATTEMPTS, END, NEXT, NOW


@compiled_subset
def end_of_case(arguments: SweepArguments, lane: int) -> float:
    """Return the time at which the case of a lane ends; its next steps may end before."""
    if arguments.stops.inputs.ends.shape[0] > 0:
        return arguments.stops.inputs.ends[0, lane]
    return arguments.state.clock[END, lane]


@compiled_subset
def begin_lane_stops(arguments: SweepArguments, lane: int) -> None:
    """Begin with the stops of the case that has entered a lane, where its actions at the start happen."""
    if arguments.stops.inputs.ends.shape[0] == 0:
        return
    state, forward = arguments.state, arguments.state.settings[1, lane] > 0.0
    t, t1, case = state.clock[NOW, lane], state.clock[END, lane], state.numbers.case[lane]
    end = begin_stops(arguments.stops, state.constants, lane, case, t, t1, forward)
    if is_due(arguments.stops, lane, t, forward):
        state.settings[0, lane] = largest_step(t, t1, arguments.limits[0, 0])
        _take_stops(arguments, 1 << lane)
        _refill(arguments, 1 << lane, 0)
    end = end_of_steps(arguments.stops, lane, end, forward)
    state.clock[END, lane], state.clock[NEXT, lane] = end, end


@compiled_subset
def pass_lane_stops(arguments: SweepArguments) -> int:
    """Let the cases that have reached a stop continue from it; return a bit for each lane."""
    state, stops = arguments.state, arguments.stops
    left, passed = state.progress.look, 0
    if stops.inputs.ends.shape[0] == 0:
        return 0
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        if _continues(arguments, lane):
            passed += 1 << lane
            _pass_knots(arguments, lane)
    if passed == 0 or (stops.first.size == 0 and stops.inputs.sides == 0 and arguments.shape.memory == 0):
        return passed
    _take_stops(arguments, passed)
    _refill(arguments, passed, CONTROLS)
    left = passed
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        end = end_of_steps(stops, lane, state.clock[END, lane], state.settings[1, lane] > 0.0)
        state.clock[END, lane], state.clock[NEXT, lane] = end, end
    return passed


@compiled_subset
def _continues(arguments: SweepArguments, lane: int) -> bool:
    """Return whether the case of a lane has reached a stop before its end, from which it continues."""
    numbers, t = arguments.state.numbers, arguments.state.clock[NOW, lane]
    if (numbers.status[lane] != Status.SUCCESS and numbers.status[lane] != RUNNING) or t == end_of_case(
        arguments, lane
    ):
        return False
    if t != arguments.state.clock[END, lane]:
        return False
    numbers.status[lane] = status_after(False, arguments.state.tally[ATTEMPTS, lane], arguments.limits[0, 1])
    return numbers.status[lane] == RUNNING


@compiled_subset
def _pass_knots(arguments: SweepArguments, lane: int) -> None:
    """Write the inputs that follow the present time of a lane, and where the first of these pieces ends."""
    state, stops = arguments.state, arguments.stops
    for m in range(stops.before.shape[0] - 1):
        stops.before[1 + m, lane] = state.constants[m, lane]
    t, case, forward = state.clock[NOW, lane], state.numbers.case[lane], state.settings[1, lane] > 0.0
    end = pass_knots(stops.inputs, state.constants, lane, case, t, forward)
    state.clock[END, lane], state.clock[NEXT, lane] = end, end
    if arguments.shape.memory > 0:
        place, old = arguments.shape.n + PROPOSAL_AT, state.progress.old
        before = state.states.shape[0] // 2 - old
        # the stop cut the step, not its error
        state.states[old + place, lane] = max(state.states[old + place, lane], state.states[before + place, lane])


@compiled_subset
def _take_stops(arguments: SweepArguments, lanes: int) -> None:
    """Take all stops at the present times of some lanes (a bit for each), and move states to the sides that follow."""
    state, stops, old = arguments.state, arguments.stops, arguments.state.progress.old
    due = _take_due(arguments, lanes)
    while due != 0:
        act(stops, state.clock, state.states, old, state.constants)
        due = _take_due(arguments, due)
    take_sides(stops.inputs, state.clock, state.states, old, state.constants, arguments.shape.n, lanes)


@compiled_subset
def _take_due(arguments: SweepArguments, lanes: int) -> int:
    """Take the next stops of those of some lanes that have reached them; return a bit for each of these."""
    state, stops, shape = arguments.state, arguments.stops, arguments.shape
    left, due, decided = lanes, 0, 0
    for lane in range(stops.acting.size):
        stops.acting[lane] = 0
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        if is_due(stops, lane, state.clock[NOW, lane], state.settings[1, lane] > 0.0):
            due += 1 << lane
            if shape.memory == 0:  # the size of the step that the stop has cut, which would limit the next
                state.states[state.progress.old + shape.n + shape.events_with_series, lane] = 0.0
            if take_next(stops, state.constants, lane):
                decided += 1 << lane
    if decided != 0:
        prepare_lanes(stops, arguments.kernels.prepare, state.constants, decided)
    return due


@compiled_subset
def _refill(arguments: SweepArguments, lanes: int, kept: int) -> None:
    """Compute what the next steps of some lanes (a bit for each) remember, but for the first numbers, which are kept.

    Slopes that were carried are those before the stop.
    """
    state, shape, left = arguments.state, arguments.shape, lanes
    if shape.memory <= kept or arguments.kernels.begin == 0:
        return
    old, remembered = state.progress.old, arguments.stops.inputs.remembered
    clock, states, settings = row(state.clock, 0), row(state.states, old), row(state.settings, 0)
    call_code(arguments.kernels.begin, clock, states, row(state.constants, 0), settings, row(remembered, 0))
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        for m in range(shape.n + 2 + kept, shape.n + 2 + shape.memory):
            state.states[old + m, lane] = remembered[m, lane]


@compiled_subset
def run_on_at_stops(arguments: SweepArguments) -> None:
    """Mark cases that have reached a stop, and not the end of their run, as running.

    Events and reductions do not end there: what has changed its sign by a stop occurs in the next step, at once.
    """
    numbers, clock = arguments.state.numbers, arguments.state.clock
    for lane in range(clock.shape[1]):
        if numbers.status[lane] == Status.SUCCESS and clock[NOW, lane] != end_of_case(arguments, lane):
            numbers.status[lane] = RUNNING


@compiled_subset
def watch_constants(arguments: SweepArguments, lanes: int) -> None:
    """Copy the constants that have changed in some lanes (a bit for each) to those of event functions."""
    stops, left = arguments.stops, lanes
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        arguments.workspace.jumped[lane, 2] = 1.0
        drop_compensation(arguments, lane)
        for m in range(0 if stops.place < 0 else arguments.state.constants.shape[0]):
            _watch_constant(arguments, lane, m)
        for r in range(stops.inputs.places.size if stops.place < 0 else 0):
            for m in range(WIDTH):
                _watch_constant(arguments, lane, stops.inputs.places[r] + m)


@compiled_subset
def _watch_constant(arguments: SweepArguments, lane: int, m: int) -> None:
    """Copy a constant of a lane to the constants of event functions."""
    state, space = arguments.state, arguments.workspace
    value, place = state.constants[m, lane], lane * state.constants.shape[0] + m
    space.own[lane, m] = value
    for point in range(space.constants.shape[1]):
        space.constants[place, point] = value
