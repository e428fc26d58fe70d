"""Newton's iteration for the increments of one step of Radau IIA, of every case side by side.

All vectors are rows of one array ``work`` (ROWS, n * lanes), component m of a lane at m * lanes + lane; the first rows
are those of ``packed_tableaus``. What a lane has for itself is in ``numbers`` and ``flags``. Lanes do not wait for each
other in what they compute: a case has the same bits alone.

For the system E y' = f(t, y), E the identity in the first ``differential`` components and zero in the rest, the
increments Z = y(t + c h) - y(t) at the three nodes c solve A^-1 E Z = h f(y + Z); transformed by W = T^-1 Z, a
simplified Newton step is one real and one complex system with the matrices REAL/h E - J and COMPLEX/h E - J.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..methods.collocation import COMPLEX, FROM_MODES, NODES, REAL, TO_MODES
from ..methods.step_constants import SMALLEST_NORMAL
from ..subset.arguments import IntMatrix, IntVector, Matrix, Vector
from ..subset.compiled_subset import call_code, compiled_subset, fma, lane_count, lanes, row, sqrt, square
from .lane_progress import (
    BEFORE,
    BEGINS,
    ENDED,
    FACTORED,
    FINITE,
    FLAGS,
    ITERATES,
    ITERATIONS,
    JUDGED,
    NUMBERS,
    OF_STATE,
    RATE,
    RATIO,
    REGULAR,
    RENEWS,
    RUNS,
    STEP,
    TIME,
    TOTAL,
)
from .lu import factor, factor_pair, solve, solve_pair
from .packed_tableaus import POINT
from .recorded_runs import Run

# Rows of the working array behind those of ``packed_tableaus``: slope at the start, error, scale, increments, slopes
# at the nodes, modes, and coefficients of the last step's polynomial.
SLOPE, ERROR, SCALE, Z, F, W, P = 5, 6, 7, 8, 11, 14, 17
ROWS = 20

MAX_ITERATIONS = 7
NEGLIGIBLE = 0.1
"""Corrections of the state, in tolerances, that need not become smaller."""
CONVERGED, DIVERGED, BROKEN = 0, 1, 2

_A, _B = COMPLEX.real, -COMPLEX.imag


class NewtonWorkspace(NamedTuple):
    """Matrices for the Newton systems of n unknowns: the Jacobian, both factored matrices, pivots, and vectors.

    ``wide`` (2, max(n*n, 2*n) * lanes) holds what a kernel of the Jacobian reads and writes; ``re`` and ``im`` are the
    parts of the complex matrix, as ``second`` and ``third`` are those of its vector. Of systems with multipliers, the
    first ``paired`` unknowns are positions and then velocities; behind them come first-order states, then multipliers.
    ``numbers`` and ``flags`` have a column for each lane.
    """

    j: Matrix
    wide: Matrix
    real: Matrix
    re: Matrix
    im: Matrix
    real_pivots: IntVector
    pair_pivots: IntVector
    first: Vector
    second: Vector
    third: Vector
    numbers: Matrix
    flags: IntMatrix
    paired: int


def newton_workspace(n: int, paired: int, lanes: int = 1) -> NewtonWorkspace:
    """Return the arrays for n unknowns of so many cases side by side; in a single one, steps are attempted."""
    j, real, re, im = (np.zeros((n, n * lanes)) for _ in range(4))
    first, second, third = (np.zeros(n * lanes) for _ in range(3))
    pivots = np.zeros(n * (lanes + 2), np.int64), np.zeros(n * (lanes + 2), np.int64)
    wide = np.zeros((2, max(n * n, 2 * n) * lanes))
    flags = np.zeros((FLAGS, lanes), np.int64)
    flags[[BEGINS, RUNS]] = 1
    numbers = np.zeros((NUMBERS, lanes))
    return NewtonWorkspace(j, wide, real, re, im, *pivots, first, second, third, numbers, flags, paired)


@compiled_subset
def set_times(run: Run, space: NewtonWorkspace, node: float) -> None:
    """Set the times of the lanes to a node of their steps."""
    for lane in lanes():
        run.clock[0, lane] = space.numbers[TIME, lane] + node * space.numbers[STEP, lane]


@compiled_subset
def _power(x: float, k: int) -> float:
    result = 1.0
    for _ in range(k):
        result *= x
    return result


@compiled_subset
def renew_jacobians(jacobian: int, tangent: int, run: Run, y: int, space: NewtonWorkspace) -> None:
    """Write the Jacobians at ``work[y]`` of lanes to renew into ``j``: at once, or by columns where that is too long.

    Entries that are not finite, as of a root that vanishes there, count as zero: the iteration converges without them,
    or takes a smaller step.
    """
    wide, n, count = space.wide, space.j.shape[0], lane_count()
    clock, point, c, out = row(run.clock, 0), row(wide, 0), row(run.constants, 0), row(wide, 1)
    for lane in lanes():
        run.clock[0, lane] = space.numbers[TIME, lane]
    for m in range(n):
        for lane in lanes():
            wide[0, m * count + lane] = run.work[y, m * count + lane]
    if jacobian != 0:
        call_code(jacobian, clock, point, c, 0, out)
        for k in range(n):
            _renew_column(space, n, k)
        return
    for k in range(n):
        for lane in lanes():
            wide[0, (n + k) * count + lane] = 0.0
    for k in range(n):
        for lane in lanes():
            wide[0, (n + k) * count + lane] = 1.0
        call_code(tangent, clock, point, c, 0, out)
        for lane in lanes():
            wide[0, (n + k) * count + lane] = 0.0
        _renew_column(space, 1, k)


@compiled_subset
def _renew_column(space: NewtonWorkspace, width: int, k: int) -> None:
    """Copy column k of the Jacobians, from rows of a width, which is 1 where there is no other column."""
    j, n, count = space.j, space.j.shape[0], lane_count()
    place = k if width == n else 0
    for m in range(n):
        for lane in lanes():
            value, old = space.wide[1, (m * width + place) * count + lane], j[m, k * count + lane]
            value = value if math.isfinite(value) else 0.0
            j[m, k * count + lane] = value if space.flags[RENEWS, lane] != 0 else old


@compiled_subset
def factor_matrices(differential: int, space: NewtonWorkspace) -> None:
    """Factor the two matrices of the Newton steps, of every lane for the step that it has `FACTORED` for.

    Those of a lane that need not be factored become what they were.
    """
    n, count, numbers, flags = space.j.shape[0], lane_count(), space.numbers, space.flags
    for m in range(n):
        for k in range(n):
            for lane in lanes():
                entry = -space.j[m, k * count + lane]
                space.real[m, k * count + lane] = space.re[m, k * count + lane] = entry
                space.im[m, k * count + lane] = 0.0
        if m < differential:
            for lane in lanes():
                h = numbers[FACTORED, lane]
                space.real[m, m * count + lane] += REAL / h
                space.re[m, m * count + lane] += _A / h
                space.im[m, m * count + lane] -= _B / h
    for lane in lanes():
        flags[REGULAR, lane] = 1
    factor(space.real, space.real_pivots, numbers, TOTAL, flags, REGULAR)
    factor_pair(space.re, space.im, space.pair_pivots, numbers, TOTAL, flags, REGULAR)


@compiled_subset
def predict(work: FloatArray, space: NewtonWorkspace) -> None:
    """Start the iteration from the last step's polynomial, continued; where there is none, from no increments."""
    numbers, count = space.numbers, lane_count()
    for m in range(work.shape[1] // count):
        for i in range(3):
            for lane in lanes():
                # RATIO is 1 over the last h
                x = numbers[RATIO, lane] * abs(numbers[STEP, lane]) * NODES[i]
                # the polynomial at 1 + x less its value at 1
                first, second = work[P, m * count + lane], work[P + 1, m * count + lane]
                third = work[P + 2, m * count + lane]
                work[Z + i, m * count + lane] = x * fma(
                    x, fma(x, third, fma(3.0, third, second)), fma(3.0, third, fma(2.0, second, first))
                )
    for m in range(work.shape[1] // count):
        for i in range(3):
            for lane in lanes():
                value = TO_MODES[i, 0] * work[Z, m * count + lane]
                value = fma(TO_MODES[i, 1], work[Z + 1, m * count + lane], value)
                work[W + i, m * count + lane] = fma(TO_MODES[i, 2], work[Z + 2, m * count + lane], value)


@compiled_subset
def _residuals(work: FloatArray, space: NewtonWorkspace, differential: int) -> None:
    """Write the residuals of the modes to the workspace, and 0 to `FINITE`, or NaN where slopes are not finite."""
    numbers, count = space.numbers, lane_count()
    for lane in lanes():
        numbers[FINITE, lane] = 0.0
    for m in range(work.shape[1] // count):
        share = 1.0 if m < differential else 0.0
        for lane in lanes():
            at = m * count + lane
            f0, f1, f2 = work[F, at], work[F + 1, at], work[F + 2, at]
            numbers[FINITE, lane] += 0.0 * (f0 + f1 + f2)
            space.first[at] = fma(TO_MODES[0, 2], f2, fma(TO_MODES[0, 0], f0, TO_MODES[0, 1] * f1))
            space.second[at] = fma(TO_MODES[1, 2], f2, fma(TO_MODES[1, 0], f0, TO_MODES[1, 1] * f1))
            space.third[at] = fma(TO_MODES[2, 2], f2, fma(TO_MODES[2, 0], f0, TO_MODES[2, 1] * f1))
        if share == 0.0:
            continue
        for lane in lanes():
            at, inverse = m * count + lane, 1.0 / numbers[STEP, lane]
            w1, w2, w3 = work[W, at], work[W + 1, at], work[W + 2, at]
            space.first[at] -= REAL * inverse * w1
            space.second[at] -= (_A * w2 + _B * w3) * inverse
            space.third[at] -= (_A * w3 - _B * w2) * inverse


@compiled_subset
def _correct(work: FloatArray, space: NewtonWorkspace, differential: int) -> None:
    """Add the corrections to modes and increments of lanes that iterate.

    `TOTAL` gets the sum of their squares in units of ``work[SCALE]``, `OF_STATE` that of the state alone.
    """
    first, second, third, count = space.first, space.second, space.third, lane_count()
    numbers, flags = space.numbers, space.flags
    for lane in lanes():
        numbers[TOTAL, lane] = numbers[OF_STATE, lane] = 0.0
    for m in range(work.shape[1] // count):
        for lane in lanes():
            at, share = m * count + lane, 1.0 if flags[ITERATES, lane] != 0 else 0.0
            a, b, c = work[W, at], work[W + 1, at], work[W + 2, at]
            a = a + first[at] if share != 0.0 else a
            b = b + second[at] if share != 0.0 else b
            c = c + third[at] if share != 0.0 else c
            work[W, at], work[W + 1, at], work[W + 2, at] = a, b, c
            weight = 1.0 / work[SCALE, at]
            numbers[TOTAL, lane] += (
                square(first[at] * weight) + square(second[at] * weight) + square(third[at] * weight)
            )
            work[Z, at] = fma(FROM_MODES[0, 2], c, fma(FROM_MODES[0, 0], a, FROM_MODES[0, 1] * b))
            work[Z + 1, at] = fma(FROM_MODES[1, 2], c, fma(FROM_MODES[1, 0], a, FROM_MODES[1, 1] * b))
            work[Z + 2, at] = fma(FROM_MODES[2, 2], c, fma(FROM_MODES[2, 0], a, FROM_MODES[2, 1] * b))
        if m == differential - 1:
            for lane in lanes():
                numbers[OF_STATE, lane] = numbers[TOTAL, lane]


@compiled_subset
def newton(rhs: int, differential: int, run: Run, y: int, space: NewtonWorkspace, tolerance: float) -> None:
    """Iterate for the increments of steps; `ENDED`, `ITERATIONS` and `RATE` say how that ended in each lane.

    ``tolerance`` is in units of ``work[SCALE]``; `JUDGED` is rate/(1 - rate) of the last step, from which the first
    correction is judged.
    """
    work, flags, n, count = run.work, space.flags, space.j.shape[0], lane_count()
    clock, constants = row(run.clock, 0), row(run.constants, 0)
    # With multipliers every other iteration gains little: they follow what the one before has done to the state.
    most = MAX_ITERATIONS if differential == n else MAX_ITERATIONS + 3
    for iteration in range(most):
        for i in range(3):
            for m in range(n):
                for lane in lanes():
                    work[POINT, m * count + lane] = work[y, m * count + lane] + work[Z + i, m * count + lane]
            set_times(run, space, NODES[i])
            call_code(rhs, clock, row(work, POINT), constants, 0, row(work, F + i))
        _residuals(work, space, differential)
        solve(space.real, space.real_pivots, space.first)
        solve_pair(space.re, space.im, space.pair_pivots, space.second, space.third)
        _correct(work, space, differential)
        left = 0
        for lane in range(count):
            if flags[ITERATES, lane] != 0:
                _judge(space, lane, iteration, most, n, differential == n, tolerance)
                left += flags[ITERATES, lane]
        if left == 0:
            break


@compiled_subset
def _judge(space: NewtonWorkspace, lane: int, iteration: int, most: int, n: int, alone: bool, tolerance: float) -> None:
    """Decide whether the iteration of a lane ends; ``alone`` says that there are no multipliers."""
    numbers, flags = space.numbers, space.flags
    size, size_of_state = sqrt(numbers[TOTAL, lane] / (3 * n)), sqrt(numbers[OF_STATE, lane] / (3 * n))
    flags[ITERATIONS, lane], ended, goes_on = iteration + 1, CONVERGED, False
    if numbers[FINITE, lane] != 0.0 or not size < np.inf:
        ended = BROKEN
    else:
        if iteration > 0:
            before = numbers[BEFORE, lane]
            quotient = size / before if before > 0.0 else 0.0
            numbers[RATE, lane] = quotient if iteration == 1 else sqrt(quotient * numbers[RATE, lane])
        rate, rate_is_known = numbers[RATE, lane], iteration > 1 or alone
        if iteration > 0 and rate >= 0.99:
            ended = _undecided(size_of_state) if rate_is_known else DIVERGED
        else:
            if iteration > 0:
                numbers[JUDGED, lane] = rate / (1.0 - rate)
            predicted = numbers[JUDGED, lane] * size
            hopeless = iteration > 0 and predicted * _power(rate, max(most - 2 - iteration, 0)) > tolerance
            numbers[BEFORE, lane] = max(size, SMALLEST_NORMAL)
            if hopeless and rate_is_known:
                ended = _undecided(size_of_state)
            elif not predicted <= tolerance:
                ended, goes_on = _undecided(size_of_state), iteration + 1 < most
    flags[ENDED, lane], flags[ITERATES, lane] = ended, 1 if goes_on else 0


@compiled_subset
def _undecided(size_of_state: float) -> int:
    """Return how an iteration ends whose corrections do not become smaller, from those of the state.

    Beside a jump, stages go from side to side. Where constraints are nearly dependent, rounding moves multipliers far
    along a direction that hardly moves the state.
    """
    return CONVERGED if size_of_state <= NEGLIGIBLE else DIVERGED
