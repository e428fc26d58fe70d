"""Attempts of steps of Radau IIA of order 5, of every case side by side: Newton systems, errors, and sizes of steps.

Lanes take their decisions one by one, as the loop over one case does, and their vectors together. Sources are those of
`implicit_loop`.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..methods.status import Status
from ..methods.step_constants import LARGEST_GROWTH, LARGEST_REDUCTION, SAFETY
from ..subset.compiled_subset import call_code, compiled_subset, exp, flat, lane_count, lanes, log, row, sqrt
from .implicit_stages import between, end_corrections, estimate, keep_polynomials, scale_of
from .lane_progress import (
    AGAIN,
    ENDED,
    FACTORED,
    FINITE,
    ITERATES,
    ITERATIONS,
    JUDGED,
    KNOWN_RATE,
    NORM,
    OF_STATE,
    QUOTIENT,
    RATE,
    REGULAR,
    RENEWS,
    RESULT,
    RUNS,
    STEP,
    T_NEW,
    TIME,
    enter_lane,
    leave_lane,
    marked,
)
from .newton import (
    BROKEN,
    CONVERGED,
    DIVERGED,
    MAX_ITERATIONS,
    NEGLIGIBLE,
    SLOPE,
    NewtonWorkspace,
    Z,
    factor_matrices,
    newton,
    predict,
    renew_jacobians,
)
from .packed_tableaus import DELTA
from .projection import NONE, PENDING, correct
from .recorded_runs import Run, RunCodes, RunSettings, find_limits, planned_step, proposed_after, retry, status_of
from .step_control import ACCEPTED, error_test, growth_limit

_RATE_TO_KEEP_JACOBIAN, _GROWTH_TO_KEEP_FACTORS = 1e-3, 1.2
"""Rate of convergence up to which the Jacobian is kept, and growth up to which a step keeps its size and factors."""

SMALLEST_PREVIOUS = 1e-2
"""Least error norm that the predictive controller remembers of a step."""

_UNIT = 2.2e-16
"""Rounding in the tolerance and the rate of Newton's iteration, two digits of it as in RADAU5."""


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
            enter_lane(space.numbers, run, lane)
            progress = run.progress
            numbers[STEP, lane], numbers[T_NEW, lane] = planned_step(settings, run, limited, lane)
            if progress.fresh == 0 and progress.rate > _RATE_TO_KEEP_JACOBIAN:
                progress.fresh, progress.factored, flags[RENEWS, lane] = 1, 0.0, 1
            # without a polynomial that predicts the stages, the first correction is the whole of the increments
            judged = 1.0 if progress.ratio == 0.0 else exp(0.8 * log(max(progress.known_rate, _UNIT)))
            numbers[JUDGED, lane], flags[ITERATES, lane] = judged, 1
            leave_lane(space.numbers, run, lane)


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
    end_corrections(work, run.progress.row, y_new, settings.kept, space)
    for lane in range(count):
        if flags[RESULT, lane] == ACCEPTED and flags[RUNS, lane] != 0 and flags[ENDED, lane] == CONVERGED:
            if mark[lane] != PENDING:
                flags[RESULT, lane] = Status.PROJECTION_FAILED
            elif numbers[FINITE, lane] != 0.0:
                flags[RESULT, lane] = Status.NON_FINITE
            elif numbers[OF_STATE, lane] > NEGLIGIBLE:
                flags[RESULT, lane], flags[ENDED, lane] = Status.STEP_TOO_SMALL, DIVERGED
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
    progress, work, flags, count = run.progress, run.work, space.flags, lane_count()
    y, y_new, left = progress.row, 1 - progress.row, 0
    if count == 1:
        leave_lane(space.numbers, run, 0)
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
    enter_lane(space.numbers, run, lane)
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
            flags[RESULT, lane] = retry(settings, run, abs(h) / max(quotient, 1.0 / SAFETY), flags[RESULT, lane])
        numbers[QUOTIENT, lane] = quotient
    leave_lane(space.numbers, run, lane)


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
    progress.last_size, progress.previous, progress.ratio = abs(h), max(error, SMALLEST_PREVIOUS), 1.0 / abs(h)
    if progress.unlimited != 0.0:  # the polynomial of so short a step does not predict a longer one
        progress.ratio = progress.last_size = 0.0
    progress.retried = progress.fresh = 0
