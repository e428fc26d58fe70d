"""Newton's iteration, error estimate, first step and dense polynomial of one step of Radau IIA.

All vectors are rows of one array ``work`` (ROWS, n); the first rows are those of ``packing``. For the system
E y' = f(t, y), E the identity in the first ``differential`` components and zero in the rest, the increments
Z = y(t + c h) - y(t) at the three nodes c solve A^-1 E Z = h f(y + Z); transformed by W = T^-1 Z, a simplified Newton
step is one real and one complex system with the matrices REAL/h E - J and COMPLEX/h E - J.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dalembert.integrators.collocation import (
    BETWEEN,
    COMPLEX,
    ERROR_WEIGHTS,
    FROM_MODES,
    INVERSE_POWERS,
    NODES,
    REAL,
    TO_MODES,
)
from dalembert.integrators.numba.jit import call_kernel, compiled
from dalembert.integrators.numba.lu import factor, solve
from dalembert.integrators.numba.packing import DELTA, POINT
from dalembert.integrators.problem import FloatArray

# Rows of the working array behind those of ``packing``: slope at the start, error, scale, increments, slopes at the
# nodes, modes, and coefficients of the last step's polynomial.
SLOPE, ERROR, SCALE, Z, F, W, P = 4, 5, 6, 7, 10, 13, 16
ROWS = 19

MAX_ITERATIONS = 7
CONVERGED, DIVERGED, BROKEN = 0, 1, 2

_A, _B = COMPLEX.real, -COMPLEX.imag


@compiled
def evaluate_jacobian(
    jacobian: int,
    tangent: int,
    t: float,
    work: FloatArray,
    y: int,
    constants: FloatArray,
    j: FloatArray,
    wide: FloatArray,
) -> None:
    """Write the Jacobian at ``work[y]`` into ``j`` (n, n): at once, or column by column where it is too long for that.

    ``wide`` is (2, max(n*n, 2*n)).
    """
    n = work.shape[1]
    for m in range(n):
        wide[0, m] = work[y, m]
    if jacobian != 0:
        call_kernel(jacobian, t, wide, 0, constants, 1, n * n)
        for m in range(n):
            for k in range(n):
                j[m, k] = wide[1, m * n + k]
        return
    for k in range(n):
        wide[0, n + k] = 0.0
    for k in range(n):
        wide[0, n + k] = 1.0
        call_kernel(tangent, t, wide, 0, constants, 1, 2 * n)
        wide[0, n + k] = 0.0
        for m in range(n):
            j[m, k] = wide[1, m]


@compiled
def factor_matrices(
    h: float,
    differential: int,
    j: FloatArray,
    real: FloatArray,
    pair: NDArray[Any],
    real_pivots: NDArray[np.intp],
    pair_pivots: NDArray[np.intp],
) -> bool:
    """Factor the two matrices of the Newton steps; return whether both are regular."""
    n = j.shape[0]
    for m in range(n):
        for k in range(n):
            real[m, k] = -j[m, k]
            pair[m, k] = -j[m, k]
        if m < differential:
            real[m, m] += REAL / h
            pair[m, m] += COMPLEX / h
    return factor(real, real_pivots) and factor(pair, pair_pivots)


@compiled
def predict(work: FloatArray, ratio: float) -> None:
    """Start the iteration from the last step's polynomial, continued; ``ratio`` is h over the last h, 0 for none."""
    for m in range(work.shape[1]):
        for i in range(3):
            x = ratio * NODES[i]
            # the polynomial at 1 + x less its value at 1
            first, second, third = work[P, m], work[P + 1, m], work[P + 2, m]
            work[Z + i, m] = x * (first + 2.0 * second + 3.0 * third + x * (second + 3.0 * third + x * third))
    for m in range(work.shape[1]):
        for i in range(3):
            value = 0.0
            for k in range(3):
                value += TO_MODES[i, k] * work[Z + k, m]
            work[W + i, m] = value


@compiled
def newton(
    rhs: int,
    t: float,
    h: float,
    differential: int,
    work: FloatArray,
    y: int,
    constants: FloatArray,
    real: FloatArray,
    pair: NDArray[Any],
    real_pivots: NDArray[np.intp],
    pair_pivots: NDArray[np.intp],
    tolerance: float,
    known_rate: float,
) -> tuple[int, int, float]:
    """Iterate for the increments of a step; return how that ended, the iterations and the rate of convergence.

    ``tolerance`` is in units of ``work[SCALE]``; ``known_rate`` is rate/(1 - rate) of the last step, from which the
    first correction is judged.
    """
    n = work.shape[1]
    rate, before, factor_ = 0.0, 0.0, known_rate
    first = np.empty(n)
    second = np.empty(n, np.complex128)
    # With multipliers every other iteration gains little: they follow what the one before has done to the state.
    most = MAX_ITERATIONS if differential == n else MAX_ITERATIONS + 3
    for iteration in range(most):
        for i in range(3):
            for m in range(n):
                work[POINT, m] = work[y, m] + work[Z + i, m]
            call_kernel(rhs, t + NODES[i] * h, work, int(np.intp(POINT)), constants, int(np.intp(F)) + i, n)
        finite = 0.0
        for m in range(n):
            f0, f1, f2 = work[F, m], work[F + 1, m], work[F + 2, m]
            finite += 0.0 * (f0 + f1 + f2)
            a = TO_MODES[0, 0] * f0 + TO_MODES[0, 1] * f1 + TO_MODES[0, 2] * f2
            b = TO_MODES[1, 0] * f0 + TO_MODES[1, 1] * f1 + TO_MODES[1, 2] * f2
            c = TO_MODES[2, 0] * f0 + TO_MODES[2, 1] * f1 + TO_MODES[2, 2] * f2
            if m < differential:
                w1, w2, w3 = work[W, m], work[W + 1, m], work[W + 2, m]
                a -= REAL / h * w1
                b -= (_A * w2 + _B * w3) / h
                c -= (_A * w3 - _B * w2) / h
            first[m] = a
            second[m] = complex(b, c)
        if finite != 0.0:
            return BROKEN, iteration + 1, rate
        solve(real, real_pivots, first)
        solve(pair, pair_pivots, second)
        total = 0.0
        for m in range(n):
            work[W, m] += first[m]
            work[W + 1, m] += second[m].real
            work[W + 2, m] += second[m].imag
            weight = 1.0 / work[SCALE, m]
            total += (first[m] * weight) ** 2 + (second[m].real * weight) ** 2 + (second[m].imag * weight) ** 2
            for i in range(3):
                work[Z + i, m] = (
                    FROM_MODES[i, 0] * work[W, m]
                    + FROM_MODES[i, 1] * work[W + 1, m]
                    + FROM_MODES[i, 2] * work[W + 2, m]
                )
        size = math.sqrt(total / (3 * n))
        if not size < np.inf:
            return BROKEN, iteration + 1, rate
        if iteration > 0:
            quotient = size / before if before > 0.0 else 0.0
            rate = quotient if iteration == 1 else math.sqrt(quotient * rate)
            if rate >= 0.99:
                return DIVERGED, iteration + 1, rate
            factor_ = rate / (1.0 - rate)
            hopeless = factor_ * size * rate ** max(most - 2 - iteration, 0) > tolerance
            if hopeless and (iteration > 1 or differential == n):
                return DIVERGED, iteration + 1, rate
        before = max(size, 1e-300)
        if factor_ * size <= tolerance:
            return CONVERGED, iteration + 1, rate
    return DIVERGED, most, rate


@compiled
def estimate(
    rhs: int,
    t: float,
    h: float,
    differential: int,
    work: FloatArray,
    y: int,
    y_new: int,
    constants: FloatArray,
    real: FloatArray,
    real_pivots: NDArray[np.intp],
    rtol: float,
    atol: float,
    careful: bool,
) -> tuple[float, int]:
    """Return the RMS norm of the error over the tolerances, and the evaluations of the right-hand side.

    ``careful`` filters an estimate that is too large once more, as stiff components demand after a first step and
    after a rejection.
    """
    n = work.shape[1]
    vector = np.empty(n)
    error, evaluations = 0.0, 0
    for attempt in range(2):
        source = int(np.intp(SLOPE)) if attempt == 0 else int(np.intp(DELTA))
        for m in range(n):
            vector[m] = work[source, m]
            if m < differential:
                for i in range(3):
                    vector[m] += ERROR_WEIGHTS[i] * work[Z + i, m] / h
        solve(real, real_pivots, vector)
        total = 0.0
        for m in range(n):
            work[ERROR, m] = vector[m]
            if m < differential:
                scale = atol + rtol * max(abs(work[y, m]), abs(work[y_new, m]))
                total += (vector[m] / scale) ** 2
        error = math.sqrt(total / differential)
        if error <= 1.0 or not careful or attempt == 1 or not error < np.inf:
            break
        for m in range(n):
            work[POINT, m] = work[y, m] + work[ERROR, m]
        call_kernel(rhs, t, work, int(np.intp(POINT)), constants, int(np.intp(DELTA)), n)
        evaluations += 1
    return error, evaluations


@compiled
def between(work: FloatArray, y: int, y_new: int, differential: int, ratio: float, rtol: float, atol: float) -> float:
    """RMS norm over the tolerances of what the step's polynomial errs by between its nodes.

    The error at the end says nothing of it in components that are slaved to others by stiffness, because it is damped
    there. A point of the step before, whose polynomial is still kept, gives the term of degree four. ``ratio`` is the
    size of this step over that of the one before.
    """
    x = NODES[1] - 1.0  # in fractions of the step before, then of this one
    theta = x / ratio
    scope = theta * (theta - NODES[0]) * (theta - NODES[1]) * (theta - NODES[2])
    total = 0.0
    for m in range(differential):
        first, second, third = work[P, m], work[P + 1, m], work[P + 2, m]
        there = x * (first + 2.0 * second + 3.0 * third + x * (second + 3.0 * third + x * third))
        here = 0.0
        for k in range(2, -1, -1):
            value = 0.0
            for i in range(3):
                value += INVERSE_POWERS[k, i] * work[Z + i, m]
            here = theta * (value + here)
        scale = atol + rtol * max(abs(work[y, m]), abs(work[y_new, m]))
        total += ((there - here) / (scope * scale)) ** 2
    return BETWEEN * math.sqrt(total / differential)


@compiled
def scale_of(work: FloatArray, y: int, differential: int, h: float, rtol: float, atol: float, tolerance: float) -> None:
    """Write what Newton corrections are measured by.

    Multipliers count the less the smaller the step is. No component is asked for more digits than rounding leaves: of
    systems with multipliers the state is positions and then velocities, each as exact as the largest of its kind, and
    what rounding leaves of either the multipliers take up within a step.
    """
    n = work.shape[1]
    kinds = 1 if differential == n else 2
    count, largest = differential // kinds, 0.0
    for kind in range(kinds):
        size = 0.0
        for m in range(kind * count, (kind + 1) * count):
            size = max(size, abs(work[y, m]))
        largest = max(largest, size)
        noise = 1e-15 * size / tolerance
        for m in range(kind * count, (kind + 1) * count):
            work[SCALE, m] = max(noise, atol + rtol * abs(work[y, m]))
    noise = 1e-15 * largest / tolerance
    for m in range(differential, n):
        work[SCALE, m] = max(noise, atol + rtol * abs(work[y, m])) / min(1.0, abs(h))


@compiled
def first_step(
    work: FloatArray, y: int, differential: int, span: float, limit: float, rtol: float, atol: float
) -> float:
    """Size of the first step, at most ``limit``, from the sizes of the state and of its slope."""
    size = slope = 0.0
    for m in range(differential):
        scale = 1.0 / (atol + rtol * abs(work[y, m]))
        size += (work[y, m] * scale) ** 2
        slope += (work[SLOPE, m] * scale) ** 2
    if size < 1e-10 * differential or slope < 1e-10 * differential:
        return min(1e-6 * span, limit)
    # the share of a time scale of the state over which a method whose estimate has order 3 errs by the tolerance
    return min(math.sqrt(size / slope) * min(0.01, max(rtol, 1e-14) ** 0.25), limit)


@compiled
def keep_polynomial(work: FloatArray) -> None:
    """Write the coefficients of the collocation polynomial through the increments."""
    for m in range(work.shape[1]):
        for k in range(3):
            value = 0.0
            for i in range(3):
                value += INVERSE_POWERS[k, i] * work[Z + i, m]
            work[P + k, m] = value


@compiled
def write_polynomial(work: FloatArray, y: int, y_new: int, pieces: FloatArray, piece: int, n: int) -> None:
    """Write the polynomial of a step into a row of ``pieces``, behind its first entry, lowest power first.

    What its end lacks of ``work[y_new]`` is added as in ``stages.dense_polynomial``.
    """
    for m in range(n):
        first, second, third = work[P, m], work[P + 1, m], work[P + 2, m]
        gap = work[y_new, m] - work[y, m] - (first + second + third)
        pieces[piece, 1 + m] = work[y, m]
        pieces[piece, 1 + n + m] = first
        pieces[piece, 1 + 2 * n + m] = second + 3.0 * gap
        pieces[piece, 1 + 3 * n + m] = third - 2.0 * gap
