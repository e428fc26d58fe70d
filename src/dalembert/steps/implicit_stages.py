"""Error estimate, first step and dense polynomial of one step of Radau IIA, whose vectors are rows as in `newton`."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..methods.collocation import BETWEEN, END_SLOPES, ERROR_WEIGHTS, INVERSE_POWERS, NODES, REAL
from ..subset.compiled_subset import call_code, compiled_subset, fma, lane_count, lanes, row, sqrt, square
from .lane_progress import (
    AGAIN,
    BEFORE,
    ENDED,
    LAST_SIZE,
    NORM,
    OF_STATE,
    RESULT,
    RETRIED,
    RUNS,
    STEP,
    STEPS,
    TOTAL,
    marked,
)
from .lu import solve
from .newton import CONVERGED, ERROR, SCALE, SLOPE, NewtonWorkspace, P, Z, set_times
from .packed_tableaus import ALLOWED, DELTA, POINT
from .projection import end_polynomial
from .recorded_runs import Run
from .step_control import error_scale


@compiled_subset
def estimate(rhs: int, differential: int, run: Run, y: int, y_new: int, space: NewtonWorkspace, rtol: float) -> int:
    """Write the RMS norm of the error over the tolerances to `NORM`; return the evaluations of the right-hand side.

    An estimate that is too large is filtered once more after a first step and after a rejection, as stiff components
    demand.
    """
    work, numbers, flags, count = run.work, space.numbers, space.flags, lane_count()
    for lane in lanes():
        flags[AGAIN, lane] = 1
    _filter(work, SLOPE, differential, y, y_new, space, rtol)
    for lane in range(count):
        careful = numbers[RETRIED, lane] != 0.0 or numbers[STEPS, lane] == 0.0
        large = not numbers[NORM, lane] <= 1.0 and numbers[NORM, lane] < np.inf
        going = flags[RUNS, lane] != 0 and flags[ENDED, lane] == CONVERGED
        flags[AGAIN, lane] = 1 if careful and large and going else 0
    if not marked(flags, AGAIN):
        return 0
    for m in range(work.shape[1]):
        work[POINT, m] = work[y, m] + work[ERROR, m]
    set_times(run, space, 0.0)
    call_code(rhs, row(run.clock, 0), row(work, POINT), row(run.constants, 0), 0, row(work, DELTA))
    _filter(work, DELTA, differential, y, y_new, space, rtol)
    return 1


@compiled_subset
def _filter(
    work: FloatArray, source: int, differential: int, y: int, y_new: int, space: NewtonWorkspace, rtol: float
) -> None:
    """Write the error by a row of slopes, and its norm, of the lanes to filter `AGAIN`."""
    numbers, vector, count = space.numbers, space.first, lane_count()
    for m in range(differential):
        for lane in lanes():
            at = m * count + lane
            total = ERROR_WEIGHTS[0] * work[Z, at] + ERROR_WEIGHTS[1] * work[Z + 1, at]
            vector[at] = work[source, at] + (total + ERROR_WEIGHTS[2] * work[Z + 2, at]) / numbers[STEP, lane]
    for m in range(differential, work.shape[1] // count):
        for lane in lanes():
            vector[m * count + lane] = work[source, m * count + lane]
    solve(space.real, space.real_pivots, vector)
    for lane in lanes():
        numbers[TOTAL, lane] = 0.0
    for m in range(differential):
        for lane in lanes():
            at = m * count + lane
            scale = error_scale(rtol, work[ALLOWED, at], max(abs(work[y, at]), abs(work[y_new, at])))
            numbers[TOTAL, lane] += square(vector[at] / scale)
    for m in range(work.shape[1]):
        work[ERROR, m] = vector[m]
    for lane in lanes():
        norm = numbers[NORM, lane]
        numbers[NORM, lane] = sqrt(numbers[TOTAL, lane] / differential) if space.flags[AGAIN, lane] != 0 else norm


@compiled_subset
def between(work: FloatArray, y: int, y_new: int, differential: int, space: NewtonWorkspace, rtol: float) -> None:
    """Raise `NORM` to the RMS norm over the tolerances of the error of the step's polynomial between its nodes.

    The error at the end says nothing of it in components that are slaved to others by stiffness, because it is damped
    there. A point of the step before, whose polynomial is still kept, gives the term of degree four.
    """
    numbers, count = space.numbers, lane_count()
    x = NODES[1] - 1.0  # in fractions of the step before, then of this one
    for lane in lanes():
        # theta, and its product of distances from the nodes
        theta = x * numbers[LAST_SIZE, lane] / abs(numbers[STEP, lane])
        numbers[BEFORE, lane], numbers[TOTAL, lane] = theta, 0.0
        numbers[OF_STATE, lane] = theta * (theta - NODES[0]) * (theta - NODES[1]) * (theta - NODES[2])
    for m in range(differential):
        for lane in lanes():
            at, theta = m * count + lane, numbers[BEFORE, lane]
            first, second, third = work[P, at], work[P + 1, at], work[P + 2, at]
            there = x * fma(x, fma(x, third, fma(3.0, third, second)), fma(3.0, third, fma(2.0, second, first)))
            z0, z1, z2 = work[Z, at], work[Z + 1, at], work[Z + 2, at]
            here = theta * _power_of(2, z0, z1, z2)
            here = theta * (_power_of(1, z0, z1, z2) + here)
            here = theta * (_power_of(0, z0, z1, z2) + here)
            scale = error_scale(rtol, work[ALLOWED, at], max(abs(work[y, at]), abs(work[y_new, at])))
            numbers[TOTAL, lane] += square((there - here) / (numbers[OF_STATE, lane] * scale))
    for lane in lanes():
        norm, error = numbers[NORM, lane], BETWEEN * sqrt(numbers[TOTAL, lane] / differential)
        numbers[NORM, lane] = max(norm, error) if numbers[LAST_SIZE, lane] != 0.0 else norm


@compiled_subset
def end_corrections(work: FloatArray, y: int, y_new: int, differential: int, space: NewtonWorkspace) -> None:
    """Write to `OF_STATE` the RMS norm of what Newton's iteration would still correct at the ends of steps.

    ``work[DELTA]`` has the slopes there. A projection that has moved the ends is no error of the iteration: its moves
    count as corrections that are made.
    """
    numbers, vector, count = space.numbers, space.first, lane_count()
    for m in range(work.shape[1] // count):
        for lane in lanes():
            vector[m * count + lane] = work[DELTA, m * count + lane]
        if m >= differential:
            continue
        for lane in lanes():
            at, inverse = m * count + lane, 1.0 / numbers[STEP, lane]
            moved = work[y_new, at] - (work[y, at] + work[Z + 2, at])
            slope = END_SLOPES[0] * work[Z, at] + END_SLOPES[1] * work[Z + 1, at] + END_SLOPES[2] * work[Z + 2, at]
            vector[at] -= (slope + REAL * moved) * inverse
    solve(space.real, space.real_pivots, vector)
    for lane in lanes():
        numbers[OF_STATE, lane] = 0.0
    for m in range(differential):
        for lane in lanes():
            at = m * count + lane
            moved = work[y_new, at] - (work[y, at] + work[Z + 2, at])
            numbers[OF_STATE, lane] += square((vector[at] + moved) / work[SCALE, at])
    for lane in lanes():
        numbers[OF_STATE, lane] = sqrt(numbers[OF_STATE, lane] / differential)


@compiled_subset
def _power_of(k: int, z0: float, z1: float, z2: float) -> float:
    """Return a coefficient of the collocation polynomial through increments."""
    return fma(INVERSE_POWERS[k, 2], z2, fma(INVERSE_POWERS[k, 1], z1, INVERSE_POWERS[k, 0] * z0))


@compiled_subset
def scale_of(
    work: FloatArray, y: int, differential: int, space: NewtonWorkspace, rtol: float, tolerance: float
) -> None:
    """Write the scales of Newton corrections.

    Multipliers count the less the smaller the step is. No component is asked for more digits than rounding leaves: of
    systems with multipliers the state is positions and then velocities, each as exact as the largest of its kind, and
    what rounding leaves of either the multipliers take up within a step. First-order states, behind the ``paired``
    components, are each of a kind of its own.
    """
    numbers, lanes_ = space.numbers, lane_count()
    n = work.shape[1] // lanes_
    kinds = 1 if differential == n else 2
    count = (differential if kinds == 1 else space.paired) // kinds
    for lane in lanes():
        numbers[BEFORE, lane] = 0.0
    for kind in range(kinds):
        for lane in lanes():
            numbers[TOTAL, lane] = 0.0
        for m in range(kind * count, (kind + 1) * count):
            for lane in lanes():
                numbers[TOTAL, lane] = max(numbers[TOTAL, lane], abs(work[y, m * lanes_ + lane]))
        for lane in lanes():
            numbers[BEFORE, lane] = max(numbers[BEFORE, lane], numbers[TOTAL, lane])
            numbers[TOTAL, lane] *= 1e-15 / tolerance
        for m in range(kind * count, (kind + 1) * count):
            for lane in lanes():
                noise, at = numbers[TOTAL, lane], m * lanes_ + lane
                work[SCALE, at] = max(noise, error_scale(rtol, work[ALLOWED, at], abs(work[y, at])))
    for m in range(kinds * count, differential):
        for lane in lanes():
            at = m * lanes_ + lane
            size = abs(work[y, at])
            numbers[BEFORE, lane] = max(numbers[BEFORE, lane], size)
            work[SCALE, at] = max(1e-15 * size / tolerance, error_scale(rtol, work[ALLOWED, at], size))
    for m in range(differential, n):
        for lane in lanes():
            at, noise = m * lanes_ + lane, 1e-15 * numbers[BEFORE, lane] / tolerance
            scale = max(noise, error_scale(rtol, work[ALLOWED, at], abs(work[y, at])))
            work[SCALE, at] = scale / min(1.0, abs(numbers[STEP, lane]))


@compiled_subset
def first_step(work: FloatArray, y: int, lane: int, differential: int, span: float, limit: float, rtol: float) -> float:
    """Size of the first step, at most ``limit``, from the sizes of the state of a lane and of its slope."""
    size, slope, count = 0.0, 0.0, lane_count()
    for m in range(differential):
        at = m * count + lane
        scale = 1.0 / error_scale(rtol, work[ALLOWED, at], abs(work[y, at]))
        size += square(work[y, at] * scale)
        slope += square(work[SLOPE, at] * scale)
    if size < 1e-10 * differential or slope < 1e-10 * differential:
        return min(1e-6 * span, limit)
    # the share of a time scale of the state over which a method whose estimate has order 3 errs by the tolerance
    return min(sqrt(size / slope) * min(0.01, sqrt(sqrt(max(rtol, 1e-14)))), limit)


@compiled_subset
def keep_polynomials(work: FloatArray, space: NewtonWorkspace, accepted: int) -> None:
    """Write the coefficients of the collocation polynomials through the increments, of lanes with a result."""
    count, flags = lane_count(), space.flags
    for m in range(work.shape[1] // count):
        for k in range(3):
            for lane in lanes():
                at = m * count + lane
                value, old = _power_of(k, work[Z, at], work[Z + 1, at], work[Z + 2, at]), work[P + k, at]
                work[P + k, at] = value if flags[RESULT, lane] == accepted else old


@compiled_subset
def write_polynomial(work: FloatArray, y: int, y_new: int, lane: int, pieces: FloatArray, piece: int, n: int) -> None:
    """Write the polynomial of a step of a lane into a row of ``pieces``, behind its first entry, lowest power first.

    It ends in ``work[y_new]`` (`end_polynomial`).
    """
    count = lane_count()
    for m in range(n):
        at = m * count + lane
        first, second, third = work[P, at], work[P + 1, at], work[P + 2, at]
        difference = work[y_new, at] - work[y, at] - (first + second + third)
        terms = abs(work[y, at]) + abs(first) + abs(second) + abs(third)
        pieces[piece, 1 + m] = work[y, at]
        pieces[piece, 1 + n + m] = first
        pieces[piece, 1 + 2 * n + m] = second
        pieces[piece, 1 + 3 * n + m] = third
        end_polynomial(pieces, piece, 1 + m, n, difference, terms)
