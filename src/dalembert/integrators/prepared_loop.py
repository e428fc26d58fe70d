"""A run of one case from start to end, for prepared calls: nothing is recorded, nothing is allocated.

It takes the step kernels of `dalembert.integrators.lane_loop` on one lane: a Taylor step chooses its size and
remembers nothing; an attempt of a Runge-Kutta step may be rejected, and what it remembers travels behind the state.
"""

from __future__ import annotations

from typing import NamedTuple

from ..methods.status import Status
from ..methods.step_constants import REDUCTION_BLIND
from .arguments import Address, IntVector, Matrix, Record
from .compiled_subset import call_code, compiled_subset, row
from .projection import corrected

__all__ = ["LOOP", "PreparedArguments", "PreparedKernels", "PreparedLimits", "PreparedProgress"]

_SUCCESS, _MAX_STEPS = int(Status.SUCCESS), int(Status.MAX_STEPS)
_NON_FINITE, _STEP_TOO_SMALL = int(Status.NON_FINITE), int(Status.STEP_TOO_SMALL)
_PROJECTION_FAILED = int(Status.PROJECTION_FAILED)
_SMALLEST = 16.0 * 2.220446049250313e-16


class PreparedKernels(NamedTuple):
    """Addresses of what the loop calls, 0 for what there is not.

    Constants from parameters, the step, what fills in its memory before the first step, and the projections.
    """

    prepare: Address
    step: Address
    start: Address
    position: Address
    velocity: Address


class PreparedLimits(NamedTuple):
    """Start, end and largest step [s], and numbers of attempts.

    After ``attempts`` the run ends; after ``patience`` of them it pauses, with the status -1. ``going`` says whether it
    continues one that has paused.
    """

    t0: float
    t1: float
    largest: float
    attempts: int
    patience: int
    going: bool


class PreparedProgress(Record):
    """The point at which a run pauses: time, number of steps and attempts, row of the state."""

    t: float
    steps: int
    attempts: int
    row: int


class PreparedArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    n, memory : int
        Number of components of the state, and of what a step remembers.
    p, c : (1, n_p), (1, n_c)
        Parameters; gets the constants.
    settings : (1, ...)
        Gets the largest step; the direction of time, and what else a step reads.
    clock, delta, mark : (1, 1), (n_y, 1), (1,)
        Are overwritten.
    states : (2, ...)
        The first row begins with the state, and gets the last one.
    """

    kernels: PreparedKernels
    limits: PreparedLimits
    n: int
    memory: int
    p: Matrix
    c: Matrix
    settings: Matrix
    clock: Matrix
    states: Matrix
    delta: Matrix
    mark: IntVector
    progress: PreparedProgress


@compiled_subset
def LOOP(arguments: PreparedArguments) -> int:
    """Run from the first row of the states, where the last state is left; return the status."""
    kernels, limits, progress = arguments.kernels, arguments.limits, arguments.progress
    prepare, step, start = kernels.prepare, kernels.step, kernels.start
    position, velocity = kernels.position, kernels.velocity
    n, memory, budget = arguments.n, arguments.memory, limits.attempts
    p, c, settings, clock = arguments.p, arguments.c, arguments.settings, arguments.clock
    states, delta, mark = arguments.states, arguments.delta, arguments.mark
    t, t1, largest, direction = limits.t0, limits.t1, limits.largest, settings[0, 1]
    old = steps = attempts = 0
    status = -1
    if limits.going:
        t, steps, attempts, old = progress.t, progress.steps, progress.attempts, progress.row
    else:
        call_code(prepare, row(p, 0), 0, 0, 0, row(c, 0))
        states[0, n] = 0.0
        if t == t1:
            status = _SUCCESS
        if start != 0 and status < 0:
            clock[0, 0], settings[0, 0] = t, min(largest, abs(t1 - t))
            call_code(start, row(clock, 0), row(states, 0), row(c, 0), row(settings, 0), row(states, 1))
            old = 1
    limit = min(budget, attempts + limits.patience)
    while status < 0:
        if attempts == limit:
            if attempts == budget:
                status = _MAX_STEPS
                break
            progress.t, progress.steps, progress.attempts, progress.row = t, steps, attempts, old
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
    progress.steps = steps
    return status
