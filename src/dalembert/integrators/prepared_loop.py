"""A run of one case from start to end, for prepared calls: nothing is recorded, nothing is allocated.

It takes the step kernels of `dalembert.integrators.lane_loop` on one lane: a Taylor step chooses its size and
remembers nothing; an attempt of a Runge-Kutta step may be rejected, and what it remembers travels behind the state.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.status import Status
from ..methods.step_constants import REDUCTION_BLIND
from .compiled_subset import bare, call_code, row
from .kinds import INTEGER, INTEGER_MATRIX, INTEGERS, MATRIX, VECTOR, Group
from .projection import corrected

__all__ = ["KINDS", "LOOP"]

_SUCCESS, _MAX_STEPS = int(Status.SUCCESS), int(Status.MAX_STEPS)
_NON_FINITE, _STEP_TOO_SMALL = int(Status.NON_FINITE), int(Status.STEP_TOO_SMALL)
_PROJECTION_FAILED = int(Status.PROJECTION_FAILED)
_SMALLEST = 16.0 * 2.220446049250313e-16

KINDS = (
    Group((INTEGER,) * 5),
    Group((INTEGER,) * 5),
    VECTOR,
    *(MATRIX,) * 6,
    INTEGER_MATRIX,
    INTEGERS,
)


@bare
def LOOP(
    codes: tuple[int, int, int, int, int],
    shape: tuple[int, int, int, int, int],
    span: FloatArray,
    p: FloatArray,
    c: FloatArray,
    settings: FloatArray,
    clock: FloatArray,
    states: FloatArray,
    delta: FloatArray,
    mark: NDArray[np.int64],
    outcome: NDArray[np.int64],
) -> int:
    """Run from the state in row 0 of ``states`` (2, rows); the last state is left there. Return the status.

    Parameters
    ----------
    codes : addresses
        Constants from parameters, the step, what fills in its memory before the first step, and the projections; 0 for
        what there is not.
    shape : (int, int, int, int, int)
        Number of components of the state, of what a step remembers, and of attempts allowed; whether a run goes on
        that has paused; attempts after which it pauses, with the status -1.
    span : (4,)
        Start, end and largest step [s]; gets the time where the run pauses.
    p, c, settings, clock, delta, mark : (1, n_p), (1, n_c), (1, ...), (1, 1), (n_y, 1), (1, 1)
        Parameters, and room for what is computed; ``settings`` holds the direction and what a step reads behind it.
    outcome : (3,) int64
        Gets the numbers of steps and attempts, and the row of the state.
    """
    prepare, step, start, position, velocity = codes
    n, memory, budget, going, patience = shape
    t, t1, largest, direction = span[0], span[1], span[2], settings[0, 1]
    old = steps = attempts = 0
    status = -1
    if going != 0:
        t, steps, attempts, old = span[3], outcome[0], outcome[1], outcome[2]
    else:
        call_code(prepare, row(p, 0), 0, 0, 0, row(c, 0))
        states[0, n] = 0.0
        if t == t1:
            status = _SUCCESS
        if start != 0 and status < 0:
            clock[0, 0], settings[0, 0] = t, min(largest, abs(t1 - t))
            call_code(start, row(clock, 0), row(states, 0), row(c, 0), row(settings, 0), row(states, 1))
            old = 1
    limit = min(budget, attempts + patience)
    while status < 0:
        if attempts == limit:
            if attempts == budget:
                status = _MAX_STEPS
                break
            span[3], outcome[0], outcome[1], outcome[2] = t, steps, attempts, old
            return -1
        attempts += 1
        new, rest = 1 - old, abs(t1 - t)
        clock[0, 0], settings[0, 0] = t, min(rest, largest)
        call_code(step, row(clock, 0), row(states, old), row(c, 0), row(settings, 0), row(states, new))
        size, broken = states[new, n], states[new, n + 1] != 0.0
        smallest = _SMALLEST * abs(t) + 1e-30 * rest
        if memory > 0:
            kept = size != 0.0
            stuck = not kept and not states[new, n + 2] >= smallest
        else:
            stuck = broken or (size < rest and size < smallest)
            kept = not stuck
        if stuck:
            status = _NON_FINITE if broken else _STEP_TOO_SMALL
            break
        if kept:
            last = size == rest
            before, t = t, t1 if last else t + direction * size
            clock[0, 0] = t
            held = position != 0 or velocity != 0
            if held and not corrected(position, velocity, clock, states, new, c, delta, mark):
                # Go back, and try a smaller step where the step can.
                smaller, t = REDUCTION_BLIND * size, before
                if not (memory > 0 and smaller >= smallest):
                    status = _PROJECTION_FAILED
                    break
                states[old, n + 2], states[old, n + 4] = smaller, 1.0
                continue
            steps += 1
            if last:
                status = _SUCCESS
        old = new
    if old == 1:
        for m in range(n):
            states[0, m] = states[1, m]
    outcome[0] = steps
    return status
