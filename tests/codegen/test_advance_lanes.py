"""What most steps of a sweep need, in vector instructions: against the same in plain Python, lane by lane."""

import ctypes
import math

import numpy as np
import pytest

from dalembert.codegen.lane_runs import advance_lanes_assembly
from dalembert.codegen.llvm.assembly import compile_object, load_object
from dalembert.codegen.llvm.target import native_lanes
from dalembert.methods.status import RUNNING, Status
from dalembert.steps import step_control as control

LARGEST, BUDGET = 2.0, 10.0
# time, end, next time to record, size of the step, its check, attempts, direction, and whether there is nothing else
STEPS = {
    "on": (0.0, 5.0, 5.0, 1.0, 0.0, 3.0, 1.0, True),
    "back": (0.0, -5.0, -5.0, 1.0, 0.0, 3.0, -1.0, True),
    "the end": (4.0, 5.0, 5.0, 1.0, 0.0, 3.0, 1.0, False),
    "past a time to record": (0.0, 5.0, 0.5, 1.0, 0.0, 3.0, 1.0, False),
    "at a time to record": (0.0, 5.0, 1.0, 1.0, 0.0, 3.0, 1.0, False),
    "past one on the way back": (0.0, -5.0, -0.5, 1.0, 0.0, 3.0, -1.0, False),
    "not finite": (0.0, 5.0, 5.0, 1.0, np.nan, 3.0, 1.0, False),
    "a size that is not a number": (0.0, 5.0, 5.0, np.nan, 0.0, 3.0, 1.0, False),
    "too small": (1.0, 5.0, 5.0, 1e-17, 0.0, 3.0, 1.0, False),
    "rejected": (1.0, 5.0, 5.0, 0.0, 0.0, 3.0, 1.0, False),
    "the last attempt": (1.0, 5.0, 5.0, 1.0, 0.0, 9.0, 1.0, False),
    "idle": (5.0, 5.0, 5.0, 0.0, 0.0, 3.0, 1.0, False),
}


def run(lanes, steps):
    """Return the mask, and clock, tally and settings afterwards, of steps side by side."""
    now, end, ahead, size, check, attempts, direction, _ = np.array(steps, dtype=float).T
    clock, step, tally = np.array([now, end, ahead]), np.array([size, check]), np.array([attempts])
    settings, limits = np.array([np.full(lanes, 7.0), direction]), np.array([LARGEST, BUDGET])
    code = load_object(compile_object(advance_lanes_assembly(lanes)))
    function = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 5)(code.address("advance_lanes"))
    mask = function(*(array.ctypes.data for array in (clock, step, tally, settings, limits)))
    return mask, clock, tally, settings


@pytest.mark.parametrize("name", STEPS)
@pytest.mark.parametrize("lanes", sorted({1, 2, native_lanes()}))
def test_lanes_move_on_or_are_left_as_they_are(lanes, name):
    rows = [name, *list(STEPS)[: lanes - 1]]
    mask, clock, tally, settings = run(lanes, [STEPS[row] for row in rows])
    for lane, row in enumerate(rows):
        now, end, ahead, size, _, attempts, direction, moves = STEPS[row]
        assert bool(mask >> lane & 1) is not moves
        then = now + direction * size if moves else now
        assert tuple(clock[:, lane]) == (then, end, ahead)
        assert tally[0, lane] == attempts + moves
        assert tuple(settings[:, lane]) == (min(LARGEST, abs(end - then)) if moves else 7.0, direction)
    assert mask >> lanes == 0


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("t", [0.0, 1.0, -3.0])
def test_lanes_that_move_are_those_that_step_control_accepts(t, direction):
    """A step of the least size moves, one just below does not: as the functions decide that other lanes go through."""
    end = direction * 5.0
    rest = abs(end - t)
    least = control.smallest_step(t, rest)
    for size, outcome in ((least, control.ACCEPTED), (math.nextafter(least, 0.0), Status.STEP_TOO_SMALL)):
        assert control.attempt_test(size, False, 0.0, False, t, rest) == outcome
        mask, clock, tally, settings = run(1, [(t, end, end, size, 0.0, BUDGET - 2.0, direction, True)])
        assert (mask == 0) == (outcome == control.ACCEPTED)
        if mask == 0:
            assert clock[0, 0] == control.end_of_step(t, end, direction, size, rest)
            assert settings[0, 0] == control.largest_step(clock[0, 0], end, LARGEST)
            assert control.status_after(size == rest, tally[0, 0], BUDGET) == RUNNING
    assert run(1, [(t, end, end, 1.0, 0.0, BUDGET - 1.0, direction, True)])[0] == 1
    assert control.status_after(False, BUDGET, BUDGET) == Status.MAX_STEPS
