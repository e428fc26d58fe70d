"""A run of one case by generated steps: prepared calls, of which nothing is recorded, and recorded Taylor runs.

It takes the step kernels of `dalembert.loops.lane_loop` on one lane: a Taylor step chooses its size and
remembers nothing; an attempt of a Runge-Kutta step may be rejected, and what it remembers travels behind the state.

A recorded run keeps what each of its steps writes in a row of its own, and returns where the rows are used up. It sums
time and state with compensation (Kahan; N. J. Higham, Accuracy and Stability of Numerical Algorithms, section 4.3):
what rounding takes from a sum is kept and added to the next increment, so that the phase of a long run, and angles that
wind up, keep the digits of the steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..lanes.step_records import exact_sum, move_compensated
from ..methods.status import RUNNING, Status
from ..steps.projection import project_row
from ..steps.step_control import ACCEPTED, REJECTED, attempt_test, blind_retry, end_of_step, largest_step, status_after
from ..stops.stops import StopTable, begin_stops, end_of_steps, is_due, pass_stops, take_stops
from ..subset.arguments import NO_CODE, Address, IntVector, Matrix, Record, Vector
from ..subset.compiled_subset import call_code, compiled_subset, flat, row
from ..transforms.runge_kutta_parts import CONTROLS, GROWTH_AT, PROPOSAL_AT


class PreparedKernels(NamedTuple):
    """Addresses of what the loop calls, 0 for what there is not.

    Constants from parameters, the step, what fills in its memory before the first step, the projections, and the tests
    of what the run is given (`dalembert.reduction.admission`).
    """

    prepare: Address
    step: Address
    start: Address
    position: Address
    velocity: Address
    admission: Address = NO_CODE


class PreparedLimits(NamedTuple):
    """Start, end and largest step [s], and numbers of attempts.

    After ``attempts`` the run ends; after ``patience`` of them, or where all rows are filled, it pauses, with the
    status `RUNNING`. ``going`` says whether it continues one that has paused. ``slack`` is by how many times a start
    may exceed the residuals of constraints that given initial values may have.
    """

    t0: float
    t1: float
    largest: float
    attempts: int
    patience: int
    going: bool
    slack: float


class PreparedProgress(Record):
    """The point at which a run pauses: time, where steps must end next, steps, attempts, and row of the state.

    After an attempt whose end could not be projected, also the size of the next one if the step does not remember it.
    """

    t: float
    end: float
    steps: int
    attempts: int
    row: int
    shortened: float


class PreparedArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    n, memory : int
        Number of components of the state, and of what a step remembers.
    parameters, constants : (1, n_p), (n_c, 1)
        Parameters; gets the constants.
    settings : (1, ...)
        Gets the largest step; the direction of time, what else a step reads, and last the tolerances.
    clock, delta, mark, tests : (1, 1), (n_y, 1), (1,), (n_tests, 1)
        Are overwritten.
    states : (2, ...) or (m + 2, ...)
        The first row begins with the state, and gets the last one. In a recorded run, of so many steps at most, each
        following row gets the outputs of a step or, behind a stop that is none of a knot alone, the state from which
        the motion continues, with the size 0.
    times : (m + 2,) or (0,)
        Gets the times of the rows.
    low : (n_y + 1,) or (0,)
        Rounding errors of the state and of the time so far, in a recorded run.
    stops : StopTable
        Times at which steps end, knots of inputs among them.
    """

    kernels: PreparedKernels
    limits: PreparedLimits
    n: int
    memory: int
    parameters: Matrix
    constants: Matrix
    settings: Matrix
    clock: Matrix
    states: Matrix
    times: Vector
    low: Vector
    delta: Matrix
    mark: IntVector
    tests: Matrix
    progress: PreparedProgress
    stops: StopTable


def running(recorded: bool) -> Callable[[PreparedArguments], int]:
    """Return the loop, with or without records; it returns the status.

    A recorded run is one of Taylor steps, whose constants are given.
    """
    begin, step = _beginning(recorded), _attempting(recorded)

    def loop(arguments: PreparedArguments) -> int:
        """Run from the first row of the states; return the status."""
        limits, progress, states = arguments.limits, arguments.progress, arguments.states
        status = RUNNING if limits.going else begin(arguments)
        if recorded:
            progress.row = 0
            while status == RUNNING and progress.row < states.shape[0] - 2:
                status = step(arguments)
            return status
        pause = min(limits.attempts, progress.attempts + limits.patience)
        while status == RUNNING and progress.attempts < pause:
            status = step(arguments)
        if status != RUNNING and progress.row == 1:
            for m in range(arguments.n):
                states[0, m] = states[1, m]
        return status

    return compiled_subset(loop)


def _beginning(recorded: bool) -> Callable[[PreparedArguments], int]:
    """Return a function that begins a run, of which steps are recorded or not."""

    @compiled_subset
    def begin(arguments: PreparedArguments) -> int:
        """Compute the constants and the memory of the first step; return the status."""
        kernels, limits, progress = arguments.kernels, arguments.limits, arguments.progress
        constants, clock, settings, states = arguments.constants, arguments.clock, arguments.settings, arguments.states
        progress.t, progress.steps, progress.attempts, progress.row = limits.t0, 0, 0, 0
        if not recorded:
            call_code(kernels.prepare, row(arguments.parameters, 0), 0, 0, 0, row(constants, 0))
        states[0, arguments.n] = 0.0
        progress.end = limits.t1
        stops, forward = arguments.stops, limits.t1 >= limits.t0
        if stops.inputs.ends.shape[0] > 0:
            progress.end = begin_stops(stops, constants, 0, 0, limits.t0, limits.t1, forward)
        refusal = _admit(arguments)
        if refusal != RUNNING:
            return refusal
        if is_due(stops, 0, limits.t0, forward):
            clock[0, 0] = limits.t0
            take_stops(stops, kernels.prepare, clock, flat(states), 0, constants, arguments.n, forward)
        progress.end = end_of_steps(stops, 0, progress.end, forward)
        status = status_after(limits.t0 == limits.t1, 0.0, limits.attempts)
        if kernels.start != 0 and status == RUNNING:
            clock[0, 0], settings[0, 0] = limits.t0, largest_step(limits.t0, progress.end, limits.largest)
            call_code(kernels.start, row(clock, 0), row(states, 0), row(constants, 0), row(settings, 0), row(states, 1))
            progress.row = 1
        return status

    return begin


@compiled_subset
def _admit(arguments: PreparedArguments) -> int:
    """Return the status of a run that may not start, with a state that is not a number; `RUNNING` where it may."""
    states, clock, tests = arguments.states, arguments.clock, arguments.tests
    if arguments.kernels.admission == 0:
        return RUNNING
    clock[0, 0] = arguments.limits.t0
    code, target = arguments.kernels.admission, row(tests, 0)
    call_code(code, row(clock, 0), row(states, 0), row(arguments.constants, 0), 0, target)
    status = admission_status(tests, arguments.limits.slack)
    if status != RUNNING:
        for m in range(arguments.n):
            states[0, m] = np.nan
    return status


@compiled_subset
def admission_status(tests: FloatArray, slack: float) -> int:
    """Return the status that the outputs (n_tests, 1) of an admission kernel give a run, `RUNNING` where it may start.

    `slack` times the residuals of given initial values are allowed. What is not a number is left to the run.
    """
    if tests[0, 0] > 0.0:
        return Status.ASSUMPTION
    for k in range(tests.shape[0] // 2):
        if abs(tests[1 + 2 * k, 0]) > slack * tests[2 + 2 * k, 0]:
            return Status.INITIAL_STATE
    return RUNNING


def _attempting(recorded: bool) -> Callable[[PreparedArguments], int]:
    """Return a function that takes a step, in a recorded run with compensation."""
    pass_stop = _passing(recorded)

    @compiled_subset
    def attempt(arguments: PreparedArguments) -> int:
        """Attempt a step, and accept or reject it; return the status."""
        limits, progress, states, low = arguments.limits, arguments.progress, arguments.states, arguments.low
        constants, settings, clock, n = arguments.constants, arguments.settings, arguments.clock, arguments.n
        t, old, retries = progress.t, progress.row, arguments.memory > 0
        new = old + 1 if recorded else 1 - old
        rest = abs(progress.end - t - low[n]) if recorded else abs(progress.end - t)
        clock[0, 0], settings[0, 0] = t, min(limits.largest, rest)
        if progress.shortened > 0.0:
            settings[0, 0], progress.shortened = min(settings[0, 0], progress.shortened), 0.0
        step, c = arguments.kernels.step, row(constants, 0)
        call_code(step, row(clock, 0), row(states, old), c, row(settings, 0), row(states, new))
        progress.attempts += 1
        size, proposed = states[new, n], 0.0
        if retries:
            proposed = states[new, n + PROPOSAL_AT]
        outcome = attempt_test(size, states[new, n + 1] != 0.0, proposed, retries, t, rest)
        if outcome != ACCEPTED and outcome != REJECTED:
            return outcome
        if outcome == ACCEPTED:
            end = end_of_step(t, progress.end, settings[0, 1], size, rest)
            if recorded:
                h = settings[0, 1] * size
                move_compensated(states, old, new, h, low)
                moved, left = exact_sum(t, h + low[n])
                low[n] = left
                if size == rest:
                    low[n] = 0.0
                else:
                    end = moved
            position, velocity = arguments.kernels.position, arguments.kernels.velocity
            delta, mark, last = arguments.delta, arguments.mark, settings.shape[1] - 1
            rtol, atol = settings[0, last - 1], settings[0, last]
            if not project_row(
                position, velocity, end, clock, states, new, states, old, constants, delta, mark, rtol, atol
            ):
                smaller = blind_retry(size, t, rest)
                if smaller == 0.0:
                    return Status.PROJECTION_FAILED
                if retries:
                    states[old, n + PROPOSAL_AT], states[old, n + GROWTH_AT] = smaller, 1.0
                else:
                    progress.shortened = smaller
                    for m in range(low.shape[0]):
                        low[m] = 0.0  # what rounding took from the end of the attempt
                return status_after(False, progress.attempts, limits.attempts)
            progress.t = end
            progress.steps += 1
            if recorded:
                arguments.times[new] = end
        progress.row = new
        at_end = outcome == ACCEPTED and size == rest
        status = status_after(at_end and progress.t == limits.t1, progress.attempts, limits.attempts)
        passes = status == RUNNING
        if recorded:  # of a run that has used up its steps knots are passed: another run may continue it
            passes = passes or (status == Status.MAX_STEPS and arguments.stops.first.size == 0)
        if at_end and passes:
            pass_stop(arguments, old, new)
        return status

    return attempt


def _passing(recorded: bool) -> Callable[[PreparedArguments, int, int], None]:
    """Return a function that passes what is at the end of a step; in a recorded run, states behind stops have rows."""

    @compiled_subset
    def pass_stop(arguments: PreparedArguments, old: int, new: int) -> None:
        """Take the stops at the end of a step, and set what the next step remembers of it."""
        limits, progress, states, stops = arguments.limits, arguments.progress, arguments.states, arguments.stops
        constants, settings, clock, n = arguments.constants, arguments.settings, arguments.clock, arguments.n
        forward, here = limits.t1 >= limits.t0, new
        taken = is_due(stops, 0, progress.t, forward)
        if recorded and taken:
            here = new + 1
            continue_in(arguments, new, here)
        clock[0, 0], place = progress.t, here * states.shape[1]
        progress.end = pass_stops(stops, arguments.kernels.prepare, clock, flat(states), place, constants, n, forward)
        if arguments.memory == 0:
            if recorded:
                for m in range(n):
                    if states[here, m] != states[new, m]:
                        arguments.low[m] = 0.0  # what rounding took from another value
            elif taken:
                states[new, n] = 0.0  # its size would limit the next
            return
        # the stop cut the step, not its error
        states[new, n + PROPOSAL_AT] = max(states[new, n + PROPOSAL_AT], states[old, n + PROPOSAL_AT])
        if arguments.memory > CONTROLS:
            remembered = stops.inputs.remembered
            settings[0, 0] = largest_step(progress.t, progress.end, limits.largest)
            code, target = arguments.kernels.start, row(remembered, 0)
            call_code(code, row(clock, 0), row(states, new), row(constants, 0), row(settings, 0), target)
            for m in range(n + 2 + CONTROLS, n + 2 + arguments.memory):
                states[new, m] = remembered[m, 0]

    return pass_stop


@compiled_subset
def continue_in(arguments: PreparedArguments, new: int, here: int) -> None:
    """Begin another row with the state at a stop, from which the motion will continue without a step before."""
    states, n = arguments.states, arguments.n
    for m in range(n):
        states[here, m] = states[new, m]
    states[here, n], states[here, n + 1] = 0.0, 0.0  # the size of the last step would limit the next
    arguments.times[here] = arguments.progress.t
    arguments.progress.row = here


LOOP, RECORDED_LOOP = running(recorded=False), running(recorded=True)
