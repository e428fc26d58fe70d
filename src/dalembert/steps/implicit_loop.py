"""The adaptive loop of Radau IIA of order 5, for stiff systems and for index-2 systems with multipliers.

Source of the method, of its Newton iteration, error estimate and step control: E. Hairer, G. Wanner, Solving Ordinary
Differential Equations II, section IV.8; of the predictive control: K. Gustafsson, ACM Transactions on Mathematical
Software 20 (1994) 496-517.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..methods.collocation import NODES
from ..methods.status import RUNNING, Status
from ..methods.step_constants import LARGEST_GROWTH, LARGEST_REDUCTION, SAFETY
from ..subset.compiled_subset import call_code, compiled_subset, exp, flat, lane_count, lanes, log, row, sqrt
from .implicit_stages import between, estimate, first_step, keep_polynomials, scale_of, write_polynomial
from .newton import (
    AGAIN,
    BEGINS,
    BROKEN,
    CONVERGED,
    DIRECTION,
    END_OF_STEPS,
    ENDED,
    FACTORED,
    FINITE,
    FRESH,
    ITERATES,
    ITERATIONS,
    JUDGED,
    KNOWN_RATE,
    LAST,
    LAST_SIZE,
    MAX_ITERATIONS,
    NORM,
    PREVIOUS,
    QUOTIENT,
    RATE,
    RATIO,
    REGULAR,
    REJECTED,
    RENEWS,
    RESULT,
    RETRIED,
    ROWS,
    RUNS,
    SIZE,
    SLOPE,
    STEP,
    STEPS,
    T_NEW,
    TIME,
    UNLIMITED,
    NewtonWorkspace,
    Z,
    factor_matrices,
    marked,
    newton,
    newton_workspace,
    predict,
    renew_jacobians,
)
from .packed_tableaus import ALLOWED, DELTA, POINT
from .problem import IntegrationProblem, Solution
from .projection import NONE, PENDING, correct
from .recorded_runs import (
    Run,
    RunCodes,
    RunSettings,
    begin_status,
    block_is_full,
    find_limits,
    pass_first_stops,
    passes_stop,
    pending,
    planned_step,
    proposed_after,
    record,
    record_behind,
    retry,
    status_of,
)
from .run_blocks import run_in_blocks, settings_of, solution
from .step_control import ACCEPTED, error_test, growth_limit

DEGREE = 3

_RATE_TO_KEEP_JACOBIAN, _GROWTH_TO_KEEP_FACTORS = 1e-3, 1.2
"""Rate of convergence up to which the Jacobian is kept, and growth up to which a step keeps its size and factors."""

_SMALLEST_PREVIOUS = 1e-2
"""Least error norm that the predictive controller remembers of a step."""

_UNIT = 2.2e-16
"""Rounding in the tolerance and the rate of Newton's iteration, two digits of it as in RADAU5."""


class ImplicitArguments(NamedTuple):
    """Arguments of the loop."""

    codes: RunCodes
    settings: RunSettings
    workspace: NewtonWorkspace
    run: Run


def integrate(
    loop: Callable[[ImplicitArguments], int],
    codes: RunCodes,
    problem: IntegrationProblem,
    multipliers: int = 0,
    states: int = 0,
) -> Solution:
    """Integrate a problem with Radau IIA of order 5.

    Parameters
    ----------
    loop
        Compiled `LOOP`.
    codes
        What it calls.
    problem
        The problem; its arrays are copied.
    multipliers
        Number of components without rates, which the kernels take after those of the state.
    states
        Number of first-order states, the last with rates.

    Returns
    -------
    Solution
        Of the state alone. Numerical failure is its status, never an exception.
    """
    n, settings = len(problem.y0), settings_of(problem, DEGREE)
    work, space = implicit_work(problem, n + multipliers), newton_workspace(n + multipliers, n - states)
    work[0, :n] = problem.y0

    def of_block(run: Run) -> int:
        return loop(ImplicitArguments(codes, settings, space, run))

    status, run, pieces = run_in_blocks(of_block, problem, settings, work)
    return solution(problem, status, run, pieces)


def implicit_work(problem: IntegrationProblem, width: int) -> FloatArray:
    """Return the working array (ROWS, width) of a run with the tolerances of a problem."""
    work = np.zeros((ROWS, width))
    work[ALLOWED] = problem.absolute_tolerances(width)
    return work


@compiled_subset
def LOOP(arguments: ImplicitArguments) -> int:
    """Take steps until the end, or until a block of rows is full; return the status, `RUNNING` for the latter."""
    codes, settings, space, run = arguments.codes, arguments.settings, arguments.workspace, arguments.run
    progress, status = run.progress, RUNNING
    if progress.evaluations == 0:
        pass_first_stops(settings, run)
        begin_motions(codes, settings, space, run)
        status = begin_status(settings, progress, space.numbers[FINITE, 0] == 0.0)
    while status == RUNNING and not block_is_full(progress):
        status = _attempt(codes, settings, space, run)
    return status


@compiled_subset
def enter_lane(space: NewtonWorkspace, run: Run, lane: int) -> None:
    """Make the progress of the run that of a lane."""
    progress, numbers = run.progress, space.numbers
    if lane_count() == 1:
        return
    progress.t, progress.t1, progress.direction = numbers[TIME, lane], numbers[LAST, lane], numbers[DIRECTION, lane]
    progress.end, progress.size, progress.previous = (
        numbers[END_OF_STEPS, lane],
        numbers[SIZE, lane],
        numbers[PREVIOUS, lane],
    )
    progress.steps, progress.rejected = int(numbers[STEPS, lane]), int(numbers[REJECTED, lane])
    progress.retried, progress.fresh = int(numbers[RETRIED, lane]), int(numbers[FRESH, lane])
    progress.last_size, progress.ratio, progress.rate = (
        numbers[LAST_SIZE, lane],
        numbers[RATIO, lane],
        numbers[RATE, lane],
    )
    progress.known_rate, progress.factored, progress.unlimited = (
        numbers[KNOWN_RATE, lane],
        numbers[FACTORED, lane],
        numbers[UNLIMITED, lane],
    )


@compiled_subset
def leave_lane(space: NewtonWorkspace, run: Run, lane: int) -> None:
    """Write the progress of the run to a lane."""
    progress, numbers = run.progress, space.numbers
    numbers[TIME, lane], numbers[LAST, lane], numbers[DIRECTION, lane] = progress.t, progress.t1, progress.direction
    numbers[END_OF_STEPS, lane], numbers[SIZE, lane], numbers[PREVIOUS, lane] = (
        progress.end,
        progress.size,
        progress.previous,
    )
    numbers[STEPS, lane], numbers[REJECTED, lane] = float(progress.steps), float(progress.rejected)
    numbers[RETRIED, lane], numbers[FRESH, lane] = float(progress.retried), float(progress.fresh)
    numbers[LAST_SIZE, lane], numbers[RATIO, lane], numbers[RATE, lane] = (
        progress.last_size,
        progress.ratio,
        progress.rate,
    )
    numbers[KNOWN_RATE, lane], numbers[FACTORED, lane], numbers[UNLIMITED, lane] = (
        progress.known_rate,
        progress.factored,
        progress.unlimited,
    )


@compiled_subset
def begin_motions(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> None:
    """Evaluate the first slopes and choose the first steps of lanes that begin; `FINITE` is 0 where the former are."""
    evaluate_anew(codes, settings, space, run)
    for lane in range(lane_count()):
        if space.flags[BEGINS, lane] != 0 and space.numbers[FINITE, lane] == 0.0:
            enter_lane(space, run, lane)
            progress, span = run.progress, abs(run.progress.t1 - run.progress.t)
            if progress.size == 0.0 and span > 0.0:
                limit = min(span, settings.max_step)
                progress.size = first_step(run.work, progress.row, lane, settings.kept, span, limit, settings.rtol)
            leave_lane(space, run, lane)


@compiled_subset
def _limited(quotient: float) -> float:
    """Return the divisor of the step size, within the limits of growth and reduction."""
    return max(1.0 / LARGEST_GROWTH, min(1.0 / LARGEST_REDUCTION, quotient))


@compiled_subset
def _shrinkage(error: float, iterations: int) -> float:
    """Return the divisor of the next step size for the error of this step; larger after slow iterations."""
    share = (2 * MAX_ITERATIONS + 1) / (2 * MAX_ITERATIONS + iterations)
    return _limited(sqrt(sqrt(error)) / (SAFETY * share))


@compiled_subset
def _predicted(quotient: float, h: float, last: float, error: float, previous: float) -> float:
    """Return the divisor of the next step size for an error that changes as it last did (predictive control)."""
    return max(quotient, _limited(last / abs(h) * sqrt(sqrt(error * error / previous)) / SAFETY))


@compiled_subset
def _plan(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> None:
    """Plan the steps of the lanes; mark those whose Jacobian is to be renewed."""
    numbers, flags = space.numbers, space.flags
    for lane in lanes():
        run.clock[0, lane] = numbers[TIME, lane]
    limited = find_limits(run, codes.knots)
    for lane in range(lane_count()):
        flags[RENEWS, lane] = flags[ITERATES, lane] = flags[REGULAR, lane] = 0
        flags[RESULT, lane], flags[ENDED, lane], flags[ITERATIONS, lane] = Status.NON_FINITE, BROKEN, 0
        if flags[RUNS, lane] != 0:
            enter_lane(space, run, lane)
            progress = run.progress
            numbers[STEP, lane], numbers[T_NEW, lane] = planned_step(settings, run, limited, lane)
            if progress.fresh == 0 and progress.rate > _RATE_TO_KEEP_JACOBIAN:
                progress.fresh, progress.factored, flags[RENEWS, lane] = 1, 0.0, 1
            # without a polynomial that predicts the stages, the first correction is the whole of the increments
            judged = 1.0 if progress.ratio == 0.0 else exp(0.8 * log(max(progress.known_rate, _UNIT)))
            numbers[JUDGED, lane], flags[ITERATES, lane] = judged, 1
            leave_lane(space, run, lane)


@compiled_subset
def _factor(settings: RunSettings, space: NewtonWorkspace) -> None:
    """Factor the matrices of lanes whose steps or Jacobians are others; those that are not regular do not iterate."""
    numbers, flags, some = space.numbers, space.flags, 0
    for lane in range(lane_count()):
        if flags[RUNS, lane] != 0 and numbers[FACTORED, lane] != numbers[STEP, lane]:
            numbers[FACTORED, lane] = numbers[STEP, lane]
            flags[AGAIN, lane] = 1
            some += 1
        else:
            flags[AGAIN, lane] = 0
    if some == 0:
        return
    factor_matrices(settings.kept, space)
    for lane in range(lane_count()):
        if flags[AGAIN, lane] != 0 and flags[REGULAR, lane] == 0:
            numbers[FACTORED, lane], flags[ITERATES, lane] = 0.0, 0


@compiled_subset
def _increments(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> None:
    """Solve for the increments of steps: `ENDED` and `ITERATIONS` say how that ended."""
    progress, rtol, numbers, flags = run.progress, settings.rtol, space.numbers, space.flags
    y, kept = progress.row, settings.kept
    if marked(flags, RENEWS):
        renew_jacobians(codes.jacobian, codes.tangent, run, y, space)
    _factor(settings, space)
    # Newton stops where its error does not show in the estimate of the step's.
    tolerance = max(10.0 * _UNIT / max(rtol, 1e-14), min(0.03, sqrt(max(rtol, 1e-14))))
    scale_of(run.work, y, kept, space, rtol, tolerance)
    if not marked(flags, ITERATES):
        return
    predict(run.work, space)
    for lane in range(lane_count()):
        if flags[ITERATES, lane] != 0:
            numbers[RATE, lane] = 0.0
            numbers[KNOWN_RATE, lane] = numbers[JUDGED, lane]
    newton(codes.rhs, kept, run, y, space, tolerance)
    for lane in range(lane_count()):
        progress.evaluations += 3 * flags[ITERATIONS, lane]
        if flags[ITERATIONS, lane] > 1:
            rate = numbers[RATE, lane]
            numbers[KNOWN_RATE, lane] = rate / (1.0 - rate) if rate < 0.99 else 1.0


@compiled_subset
def _diverged(settings: RunSettings, run: Run, h: float, outcome: int) -> int:
    """Retry with a new Jacobian or, where it is new already, with a smaller step; return the status."""
    progress = run.progress
    progress.known_rate = progress.rate = 1.0
    if run.progress.fresh == 0:
        run.progress.rejected += 1
        return status_of(settings, run.progress)
    progress.ratio = 0.0
    return retry(settings, run, 0.5 * abs(h), Status.NON_FINITE if outcome == BROKEN else Status.STEP_TOO_SMALL)


@compiled_subset
def _test_steps(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run, y_new: int) -> None:
    """Test the errors of steps, project their ends and evaluate the slopes there; `RESULT` gets the results."""
    work, numbers, flags, mark, count = run.work, space.numbers, space.flags, run.mark, lane_count()
    some, n = 0, work.shape[1] // count
    for lane in range(count):
        mark[lane] = NONE
        run.clock[0, lane] = numbers[T_NEW, lane]
        if flags[RUNS, lane] != 0 and flags[ENDED, lane] == CONVERGED:
            flags[RESULT, lane] = error_test(numbers[NORM, lane])
            if flags[RESULT, lane] == ACCEPTED:
                mark[lane] = PENDING
                some += 1
    if some == 0:
        return
    if codes.position != 0 or codes.velocity != 0:
        states, first, before = flat(work), y_new * n, run.progress.row * n
        rtol, atol = settings.rtol, settings.atol
        correct(
            codes.position, codes.velocity, run.clock, states, first, states, before, run.constants, run.delta, mark,
            rtol, atol,
        )  # fmt: skip
    call_code(codes.rhs, row(run.clock, 0), row(work, y_new), row(run.constants, 0), 0, row(work, DELTA))
    run.progress.evaluations += some
    check_finite(work, space, y_new, DELTA)
    for lane in range(count):
        if flags[RESULT, lane] == ACCEPTED and flags[RUNS, lane] != 0 and flags[ENDED, lane] == CONVERGED:
            if mark[lane] != PENDING:
                flags[RESULT, lane] = Status.PROJECTION_FAILED
            elif numbers[FINITE, lane] != 0.0:
                flags[RESULT, lane] = Status.NON_FINITE
    for m in range(n):
        for lane in lanes():
            at = m * count + lane
            work[SLOPE, at] = work[DELTA, at] if flags[RESULT, lane] == ACCEPTED else work[SLOPE, at]


@compiled_subset
def check_finite(work: FloatArray, space: NewtonWorkspace, first: int, second: int) -> None:
    """Write 0 to `FINITE` of lanes of which every entry of two rows is finite."""
    count = lane_count()
    for lane in lanes():
        space.numbers[FINITE, lane] = 0.0
    for m in range(work.shape[1] // count):
        for lane in lanes():
            at = m * count + lane
            space.numbers[FINITE, lane] += 0.0 * work[first, at] + 0.0 * work[second, at]


@compiled_subset
def attempt(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> None:
    """Attempt a step in each lane that `RUNS`, from one of the ends to the other.

    `RESULT` gets `ACCEPTED`, or the status of the run after a rejection; `STEP`, `T_NEW`, `NORM` and `QUOTIENT` the
    step, its end, its error and the divisor of the next size by this error.
    """
    progress, work, numbers, flags, count = run.progress, run.work, space.numbers, space.flags, lane_count()
    y, y_new, left = progress.row, 1 - progress.row, 0
    if count == 1:
        leave_lane(space, run, 0)
    _plan(codes, settings, space, run)
    _increments(codes, settings, space, run)
    for lane in range(count):
        if flags[RUNS, lane] != 0 and flags[ENDED, lane] == CONVERGED:
            left += 1
    if left != 0:
        for m in range(work.shape[1]):
            work[y_new, m] = work[y, m] + work[Z + 2, m]
        more = estimate(codes.rhs, settings.kept, run, y, y_new, space, settings.rtol)
        progress.evaluations += more
        between(work, y, y_new, settings.kept, space, settings.rtol)
        _test_steps(codes, settings, space, run, y_new)
        keep_polynomials(work, space, ACCEPTED)
    for lane in range(count):
        if flags[RUNS, lane] != 0:
            _end_attempt(settings, space, run, lane)


@compiled_subset
def _end_attempt(settings: RunSettings, space: NewtonWorkspace, run: Run, lane: int) -> None:
    """Choose the size of another attempt where a step is not accepted."""
    progress, numbers, flags = run.progress, space.numbers, space.flags
    enter_lane(space, run, lane)
    progress.rate, progress.known_rate = numbers[RATE, lane], numbers[KNOWN_RATE, lane]
    progress.factored = numbers[FACTORED, lane]
    h, error = numbers[STEP, lane], numbers[NORM, lane]
    if flags[ENDED, lane] != CONVERGED:
        flags[RESULT, lane] = _diverged(settings, run, h, flags[ENDED, lane])
    else:
        quotient = _shrinkage(error if error < np.inf else 1e4, flags[ITERATIONS, lane])
        if flags[RESULT, lane] != ACCEPTED:
            if error <= 1.0:
                quotient = 1.0 / LARGEST_REDUCTION
            progress.ratio = 0.0
            flags[RESULT, lane] = retry(settings, run, abs(h) / max(quotient, 1.0 / SAFETY), flags[RESULT, lane])
        numbers[QUOTIENT, lane] = quotient
    leave_lane(space, run, lane)


@compiled_subset
def propose(run: Run, h: float, t_new: float, error: float, quotient: float) -> None:
    """Propose the size of the step after an accepted one, which ends at a time; for the others see `attempt`."""
    progress = run.progress
    if progress.last_size != 0.0:
        quotient = _predicted(quotient, h, progress.last_size, error, progress.previous)
    growth = min(1.0 / quotient, growth_limit(progress.retried != 0))
    slow = progress.rate > _RATE_TO_KEEP_JACOBIAN
    if progress.unlimited != 0.0:
        progress.size = proposed_after(run, abs(h) * growth)
    elif slow or growth < 1.0 or growth > _GROWTH_TO_KEEP_FACTORS or t_new == progress.end:
        progress.size = abs(h) * growth
    progress.last_size, progress.previous, progress.ratio = abs(h), max(error, _SMALLEST_PREVIOUS), 1.0 / abs(h)
    if progress.unlimited != 0.0:  # the polynomial of so short a step does not predict a longer one
        progress.ratio = progress.last_size = 0.0
    progress.retried = progress.fresh = 0


@compiled_subset
def _attempt(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> int:
    """Attempt a step, and record it where it is accepted; return the status."""
    progress, numbers, y = run.progress, space.numbers, run.progress.row
    attempt(codes, settings, space, run)
    if space.flags[RESULT, 0] != ACCEPTED:
        return space.flags[RESULT, 0]
    h, t_new, error, quotient = numbers[STEP, 0], numbers[T_NEW, 0], numbers[NORM, 0], numbers[QUOTIENT, 0]
    y_new, proposed = 1 - y, progress.size
    piece = progress.steps - progress.begun if settings.dense else 0
    if settings.dense or pending(run, t_new):
        write_polynomial(run.work, y, y_new, 0, run.pieces, piece, settings.kept)
        run.pieces[piece, 0] = t_new
    status = record(codes.position, codes.velocity, settings, run, piece, y_new, t_new)
    propose(run, h, t_new, error, quotient)
    if passes_stop(settings, run, status):
        begin_piece(codes, settings, space, run, proposed)
    record_behind(settings, run)
    return status


@compiled_subset
def begin_piece(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run, proposed: float) -> None:
    """Begin the motion behind a stop, which cut the step that was proposed, not its error."""
    evaluate_anew(codes, settings, space, run)
    run.progress.size = max(run.progress.size, proposed)


@compiled_subset
def evaluate_anew(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> None:
    """Evaluate multipliers and slopes of lanes that begin; discard Jacobians and predictions, of the motion before.

    `FINITE` is 0 where states and slopes are finite.
    """
    work, numbers, flags, count, y = run.work, space.numbers, space.flags, lane_count(), run.progress.row
    if count == 1:
        leave_lane(space, run, 0)
    clock, state, constants, n = row(run.clock, 0), row(work, y), row(run.constants, 0), work.shape[1] // count
    for lane in lanes():
        run.clock[0, lane] = numbers[TIME, lane]
    if codes.multipliers != 0:  # of the components without rates
        call_code(codes.multipliers, clock, state, constants, 0, row(work, POINT))
        for m in range(settings.kept, n):
            for lane in lanes():
                new, old = work[POINT, (m - settings.kept) * count + lane], work[y, m * count + lane]
                work[y, m * count + lane] = new if flags[BEGINS, lane] != 0 else old
    call_code(codes.rhs, clock, state, constants, 0, row(work, DELTA))
    for m in range(n):
        for lane in lanes():
            at = m * count + lane
            work[SLOPE, at] = work[DELTA, at] if flags[BEGINS, lane] != 0 else work[SLOPE, at]
    check_finite(work, space, y, SLOPE)
    run.progress.evaluations += 1
    for lane in range(count):
        if flags[BEGINS, lane] != 0:
            enter_lane(space, run, lane)
            progress = run.progress
            progress.rate = progress.known_rate = 1.0
            progress.ratio = progress.last_size = 0.0
            progress.previous = _SMALLEST_PREVIOUS
            leave_lane(space, run, lane)


assert NODES[2] == 1.0
