"""Newton's iteration for the increments of one step of Radau IIA.

All vectors are rows of one array ``work`` (ROWS, n); the first rows are those of ``packed_tableaus``. For the system
E y' = f(t, y), E the identity in the first ``differential`` components and zero in the rest, the increments
Z = y(t + c h) - y(t) at the three nodes c solve A^-1 E Z = h f(y + Z); transformed by W = T^-1 Z, a simplified Newton
step is one real and one complex system with the matrices REAL/h E - J and COMPLEX/h E - J.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..methods.collocation import COMPLEX, FROM_MODES, NODES, REAL, TO_MODES
from ..methods.step_constants import SMALLEST_NORMAL
from ..subset.arguments import IntVector, Matrix, Vector
from ..subset.compiled_subset import call_code, compiled_subset, fma, row, sqrt, square
from .lu import factor, factor_pair, solve, solve_pair
from .packed_tableaus import POINT
from .recorded_runs import Run, evaluate

# Rows of the working array behind those of ``packed_tableaus``: slope at the start, error, scale, increments, slopes
# at the nodes, modes, and coefficients of the last step's polynomial.
SLOPE, ERROR, SCALE, Z, F, W, P = 5, 6, 7, 8, 11, 14, 17
ROWS = 20

MAX_ITERATIONS = 7
_NEGLIGIBLE = 0.1
"""Corrections of the state, in tolerances, that need not become smaller."""
CONVERGED, DIVERGED, BROKEN = 0, 1, 2

_A, _B = COMPLEX.real, -COMPLEX.imag


class NewtonWorkspace(NamedTuple):
    """Matrices for the Newton systems of n unknowns: the Jacobian, both factored matrices, pivots, and vectors.

    ``wide`` (2, max(n*n, 2*n)) holds what a kernel of the Jacobian reads and writes; ``re`` and ``im`` are the parts of
    the complex matrix, as ``second`` and ``third`` are those of its vector. Of systems with multipliers, the first
    ``paired`` unknowns are positions and then velocities; behind them come first-order states, then multipliers.
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
    paired: int


def newton_workspace(n: int, paired: int) -> NewtonWorkspace:
    """Return the arrays for n unknowns."""
    j, real, re, im = (np.zeros((n, n)) for _ in range(4))
    first, second, third = (np.zeros(n) for _ in range(3))
    pivots = np.zeros(n, np.int64), np.zeros(n, np.int64)
    return NewtonWorkspace(j, np.zeros((2, max(n * n, 2 * n))), real, re, im, *pivots, first, second, third, paired)


@compiled_subset
def _power(x: float, k: int) -> float:
    result = 1.0
    for _ in range(k):
        result *= x
    return result


@compiled_subset
def evaluate_jacobian(jacobian: int, tangent: int, t: float, run: Run, y: int, space: NewtonWorkspace) -> None:
    """Write the Jacobian at ``work[y]`` into ``j``: at once, or column by column where it is too long for that.

    Entries that are not finite, as of a root that vanishes there, count as zero: the iteration converges without them,
    or takes a smaller step.
    """
    j, wide, n = space.j, space.wide, run.work.shape[1]
    run.clock[0, 0] = t
    clock, point, c, out = row(run.clock, 0), row(wide, 0), row(run.constants, 0), row(wide, 1)
    for m in range(n):
        wide[0, m] = run.work[y, m]
    if jacobian != 0:
        call_code(jacobian, clock, point, c, 0, out)
        for m in range(n):
            for k in range(n):
                j[m, k] = wide[1, m * n + k] if math.isfinite(wide[1, m * n + k]) else 0.0
        return
    for k in range(n):
        wide[0, n + k] = 0.0
    for k in range(n):
        wide[0, n + k] = 1.0
        call_code(tangent, clock, point, c, 0, out)
        wide[0, n + k] = 0.0
        for m in range(n):
            j[m, k] = wide[1, m] if math.isfinite(wide[1, m]) else 0.0


@compiled_subset
def factor_matrices(h: float, differential: int, space: NewtonWorkspace) -> bool:
    """Factor the two matrices of the Newton steps; return whether both are regular."""
    n = space.j.shape[0]
    for m in range(n):
        for k in range(n):
            space.real[m, k] = space.re[m, k] = -space.j[m, k]
            space.im[m, k] = 0.0
        if m < differential:
            space.real[m, m] += REAL / h
            space.re[m, m] += _A / h
            space.im[m, m] -= _B / h
    return factor(space.real, space.real_pivots) and factor_pair(space.re, space.im, space.pair_pivots)


@compiled_subset
def predict(work: FloatArray, ratio: float) -> None:
    """Start the iteration from the last step's polynomial, continued; ``ratio`` is h over the last h, 0 for none."""
    for m in range(work.shape[1]):
        for i in range(3):
            x = ratio * NODES[i]
            # the polynomial at 1 + x less its value at 1
            first, second, third = work[P, m], work[P + 1, m], work[P + 2, m]
            work[Z + i, m] = x * fma(
                x, fma(x, third, fma(3.0, third, second)), fma(3.0, third, fma(2.0, second, first))
            )
    for m in range(work.shape[1]):
        for i in range(3):
            value = 0.0
            for k in range(3):
                value = fma(TO_MODES[i, k], work[Z + k, m], value)
            work[W + i, m] = value


@compiled_subset
def _residuals(work: FloatArray, space: NewtonWorkspace, h: float, differential: int) -> float:
    """Write the residuals of the modes to the workspace; return 0, or NaN where slopes are not finite."""
    finite = 0.0
    for m in range(work.shape[1]):
        f0, f1, f2 = work[F, m], work[F + 1, m], work[F + 2, m]
        finite += 0.0 * (f0 + f1 + f2)
        a = fma(TO_MODES[0, 2], f2, fma(TO_MODES[0, 0], f0, TO_MODES[0, 1] * f1))
        b = fma(TO_MODES[1, 2], f2, fma(TO_MODES[1, 0], f0, TO_MODES[1, 1] * f1))
        c = fma(TO_MODES[2, 2], f2, fma(TO_MODES[2, 0], f0, TO_MODES[2, 1] * f1))
        if m < differential:
            w1, w2, w3 = work[W, m], work[W + 1, m], work[W + 2, m]
            a -= REAL / h * w1
            b -= (_A * w2 + _B * w3) / h
            c -= (_A * w3 - _B * w2) / h
        space.first[m], space.second[m], space.third[m] = a, b, c
    return finite


@compiled_subset
def _correct(work: FloatArray, space: NewtonWorkspace, differential: int) -> tuple[float, float]:
    """Add the corrections to modes and increments; return the sums of their squares in units of ``work[SCALE]``.

    The first sum is that of all components, the second that of the state.
    """
    first, second, third = space.first, space.second, space.third
    total, of_state = 0.0, 0.0
    for m in range(work.shape[1]):
        work[W, m] += first[m]
        work[W + 1, m] += second[m]
        work[W + 2, m] += third[m]
        weight = 1.0 / work[SCALE, m]
        total += square(first[m] * weight) + square(second[m] * weight) + square(third[m] * weight)
        of_state = total if m < differential else of_state
        for i in range(3):
            work[Z + i, m] = fma(
                FROM_MODES[i, 2],
                work[W + 2, m],
                fma(FROM_MODES[i, 0], work[W, m], FROM_MODES[i, 1] * work[W + 1, m]),
            )
    return total, of_state


@compiled_subset
def newton(
    rhs: int,
    t: float,
    h: float,
    differential: int,
    run: Run,
    y: int,
    space: NewtonWorkspace,
    tolerance: float,
    known_rate: float,
) -> tuple[int, int, float]:
    """Iterate for the increments of a step; return how that ended, the iterations and the rate of convergence.

    ``tolerance`` is in units of ``work[SCALE]``; ``known_rate`` is rate/(1 - rate) of the last step, from which the
    first correction is judged.
    """
    work, n = run.work, run.work.shape[1]
    rate, before, size_of_state, factor_ = 0.0, 0.0, 0.0, known_rate
    # With multipliers every other iteration gains little: they follow what the one before has done to the state.
    most = MAX_ITERATIONS if differential == n else MAX_ITERATIONS + 3
    for iteration in range(most):
        for i in range(3):
            for m in range(n):
                work[POINT, m] = work[y, m] + work[Z + i, m]
            evaluate(rhs, t + NODES[i] * h, run, POINT, F + i)
        if _residuals(work, space, h, differential) != 0.0:
            return BROKEN, iteration + 1, rate
        solve(space.real, space.real_pivots, space.first)
        solve_pair(space.re, space.im, space.pair_pivots, space.second, space.third)
        total, of_state = _correct(work, space, differential)
        size, size_of_state = sqrt(total / (3 * n)), sqrt(of_state / (3 * n))
        if not size < np.inf:
            return BROKEN, iteration + 1, rate
        if iteration > 0:
            quotient = size / before if before > 0.0 else 0.0
            rate = quotient if iteration == 1 else sqrt(quotient * rate)
            rate_is_known = iteration > 1 or differential == n
            if rate >= 0.99:
                return _undecided(size_of_state) if rate_is_known else DIVERGED, iteration + 1, rate
            factor_ = rate / (1.0 - rate)
            hopeless = factor_ * size * _power(rate, max(most - 2 - iteration, 0)) > tolerance
            if hopeless and rate_is_known:
                return _undecided(size_of_state), iteration + 1, rate
        before = max(size, SMALLEST_NORMAL)
        if factor_ * size <= tolerance:
            return CONVERGED, iteration + 1, rate
    return _undecided(size_of_state), most, rate


@compiled_subset
def _undecided(size_of_state: float) -> int:
    """Return how an iteration ends whose corrections do not become smaller, from those of the state.

    Beside a jump, stages go from side to side. Where constraints are nearly dependent, rounding moves multipliers far
    along a direction that hardly moves the state.
    """
    return CONVERGED if size_of_state <= _NEGLIGIBLE else DIVERGED
