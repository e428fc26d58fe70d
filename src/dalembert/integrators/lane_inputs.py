"""Inputs with knots in lanes: the end of a lane's next steps is its next knot, from which its case continues."""

from __future__ import annotations

from ..ir.input_parameters import WIDTH
from ..methods.status import RUNNING, Status
from ..transforms.runge_kutta_parts import CONTROLS, PROPOSAL_AT
from .compiled_subset import call_code, compiled_subset, lowest, row
from .input_steps import begin_inputs, pass_knots
from .step_control import status_after
from .sweep_arguments import SweepArguments
from .workspace import ATTEMPTS, END, NEXT, NOW

__all__ = ["begin_lane_inputs", "pass_lane_knots", "run_on_at_knots", "watch_inputs"]


@compiled_subset
def begin_lane_inputs(arguments: SweepArguments, lane: int) -> None:
    """Set the inputs of the case that has entered a lane, and where its first steps must end."""
    state = arguments.state
    t, t1, forward = state.clock[NOW, lane], state.clock[END, lane], state.settings[1, lane] > 0.0
    case = state.numbers.case[lane]
    end = begin_inputs(arguments.inputs, state.constants, lane, case, t, t1, forward)
    state.clock[END, lane], state.clock[NEXT, lane] = end, end


@compiled_subset
def pass_lane_knots(arguments: SweepArguments) -> int:
    """Set the inputs of the cases that have reached a knot, so that they continue; return a bit for each lane."""
    state, shape = arguments.state, arguments.shape
    left, passed = state.progress.look, 0
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        if _passes(arguments, lane):
            passed += 1 << lane
    moved = passed
    if passed != 0 and arguments.inputs.sides != 0:
        _take_lane_sides(arguments, passed)
    if passed == 0 or shape.memory <= CONTROLS:
        return moved
    old, remembered = state.progress.old, arguments.inputs.remembered  # slopes that were carried are of other inputs
    clock, states, settings = row(state.clock, 0), row(state.states, old), row(state.settings, 0)
    call_code(arguments.kernels.begin, clock, states, row(state.constants, 0), settings, row(remembered, 0))
    while passed != 0:
        lane = lowest(passed)
        passed &= passed - 1
        for m in range(shape.n + 2 + CONTROLS, shape.n + 2 + shape.memory):
            state.states[old + m, lane] = remembered[m, lane]
    return moved


@compiled_subset
def _take_lane_sides(arguments: SweepArguments, lanes: int) -> None:
    """Move the states of some lanes (a bit for each) to the sides of knots and switches that their motions go to."""
    state, inputs, n, left = arguments.state, arguments.inputs, arguments.shape.n, lanes
    old = state.progress.old
    clock, states, constants = row(state.clock, 0), row(state.states, old), row(state.constants, 0)
    call_code(inputs.near, clock, states, constants, 0, row(inputs.sided, 0))
    found = 0.0
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        found += inputs.sided[0, lane]
    if found == 0.0:
        return
    left = lanes
    call_code(inputs.sides, clock, states, constants, 0, row(inputs.sided, 0))
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        first = 0 if state.settings[1, lane] > 0.0 else n
        for m in range(n):
            state.states[old + m, lane] = inputs.sided[first + m, lane]


@compiled_subset
def run_on_at_knots(arguments: SweepArguments) -> None:
    """Mark cases that have reached a knot, and not the end of their run, as running.

    Events and reductions do not end at a knot, where they are as smooth as the motion.
    """
    numbers, clock = arguments.state.numbers, arguments.state.clock
    for lane in range(clock.shape[1]):
        if numbers.status[lane] == Status.SUCCESS and clock[NOW, lane] != arguments.inputs.ends[0, lane]:
            numbers.status[lane] = RUNNING


@compiled_subset
def watch_inputs(arguments: SweepArguments, lanes: int) -> None:
    """Copy the new coefficients of inputs in some lanes (a bit for each) to the constants of event functions."""
    state, space, inputs = arguments.state, arguments.workspace, arguments.inputs
    count, left = state.constants.shape[0], lanes
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        for r in range(inputs.places.size):
            for m in range(WIDTH):
                place = inputs.places[r] + m
                space.own[lane, place] = state.constants[place, lane]
                for point in range(space.constants.shape[1]):
                    space.constants[lane * count + place, point] = state.constants[place, lane]


@compiled_subset
def _passes(arguments: SweepArguments, lane: int) -> bool:
    """Return whether the case of a lane has reached a knot; the inputs and the end of its next steps are set then."""
    state, inputs, numbers = arguments.state, arguments.inputs, arguments.state.numbers
    t = state.clock[NOW, lane]
    if (numbers.status[lane] != Status.SUCCESS and numbers.status[lane] != RUNNING) or t == inputs.ends[0, lane]:
        return False
    if t != state.clock[END, lane]:
        return False
    end = pass_knots(inputs, state.constants, lane, numbers.case[lane], t, state.settings[1, lane] > 0.0)
    state.clock[END, lane], state.clock[NEXT, lane] = end, end
    numbers.status[lane] = status_after(False, state.tally[ATTEMPTS, lane], arguments.limits[0, 1])
    if arguments.shape.memory > 0:
        place, old = arguments.shape.n + PROPOSAL_AT, state.progress.old
        before = state.states.shape[0] // 2 - old
        # the knot cut the step, not its error
        state.states[old + place, lane] = max(state.states[old + place, lane], state.states[before + place, lane])
    return True
