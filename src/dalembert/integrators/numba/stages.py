"""Stages, error estimate, first step and dense polynomial of one explicit Runge-Kutta step.

All vectors are rows of one array ``work`` (n_rows, width), in the order that ``packing`` gives. The width is
n_y rounded up to a multiple of ``LANES`` and the padding stays 0, so that inner loops have no remainder.
"""

import math

import numpy as np

from dalembert.integrators.gains import SECOND_ERROR_WEIGHT
from dalembert.integrators.numba.jit import call_kernel, compiled
from dalembert.integrators.numba.packing import POINT, PackedTableau
from dalembert.integrators.tableau import FloatArray

LANES = 8
WATCHED_FROM, HELD_STEPS = 1000, 15
"""Steps after which a run is watched for stiffness, and steps in a row at the boundary that say so."""

_BOUNDARY = 3.0


@compiled
def evaluate_stages(
    rhs: int,
    tableau: PackedTableau,
    numbers: tuple[int, int],
    t: float,
    h: float,
    work: FloatArray,
    constants: FloatArray,
    y: int,
    y_new: int,
    n: int,
) -> None:
    """Evaluate the stages ``numbers[0]`` to ``numbers[1] - 1`` of a step from ``work[y]``.

    Sums are written out for ``LANES`` components at a time, which keeps them in registers, and indices are
    unsigned, which spares numba's test for negative ones. The state of stage ``end`` is kept in
    ``work[y_new]``; it is evaluated only if the error estimate needs it.
    """
    for i in range(numbers[0], numbers[1]):
        out = y_new if i == tableau.end else POINT
        first, last = tableau.starts[i], tableau.starts[i + 1]
        for block in range(work.shape[1] // LANES):
            m0 = np.uintp(LANES * block)
            m1 = m0 + np.uintp(1)
            m2 = m0 + np.uintp(2)
            m3 = m0 + np.uintp(3)
            m4 = m0 + np.uintp(4)
            m5 = m0 + np.uintp(5)
            m6 = m0 + np.uintp(6)
            m7 = m0 + np.uintp(7)
            s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
            for entry in range(first, last):
                weight, stage = tableau.weights[entry], tableau.stages[entry]
                s0 += weight * work[stage, m0]
                s1 += weight * work[stage, m1]
                s2 += weight * work[stage, m2]
                s3 += weight * work[stage, m3]
                s4 += weight * work[stage, m4]
                s5 += weight * work[stage, m5]
                s6 += weight * work[stage, m6]
                s7 += weight * work[stage, m7]
            work[out, m0] = work[y, m0] + h * s0
            work[out, m1] = work[y, m1] + h * s1
            work[out, m2] = work[y, m2] + h * s2
            work[out, m3] = work[y, m3] + h * s3
            work[out, m4] = work[y, m4] + h * s4
            work[out, m5] = work[y, m5] + h * s5
            work[out, m6] = work[y, m6] + h * s6
            work[out, m7] = work[y, m7] + h * s7
        if i != tableau.end or tableau.fsal:
            call_kernel(rhs, t + tableau.nodes[i] * h, work, out, constants, tableau.first + i, n)


@compiled
def error_norm(
    tableau: PackedTableau, h: float, work: FloatArray, y: int, y_new: int, rtol: float, atol: float, n: int
) -> float:
    """RMS norm of the error estimate over the tolerances (combined as in DOP853 if there are two rows)."""
    row = tableau.total
    first, second, last = tableau.starts[row], tableau.starts[row + 1], tableau.starts[row + 2]
    total = total_second = 0.0
    for component in range(n):
        m = np.uintp(component)
        estimate = estimate_second = 0.0
        for entry in range(first, second):
            estimate += tableau.weights[entry] * work[tableau.stages[entry], m]
        for entry in range(second, last):
            estimate_second += tableau.weights[entry] * work[tableau.stages[entry], m]
        scale = 1.0 / (atol + rtol * max(abs(work[y, m]), abs(work[y_new, m])))
        total += (estimate * scale) ** 2
        total_second += (estimate_second * scale) ** 2
    if total == 0.0 and total_second == 0.0:
        return 0.0
    return abs(h) * total / math.sqrt((total + SECOND_ERROR_WEIGHT * total_second) * n)


@compiled
def at_boundary(tableau: PackedTableau, h: float, work: FloatArray, y_new: int, n: int) -> bool:
    """Whether a step is near the limit of stability, from slopes at its end and at the last stage before it.

    Source: Hairer and Wanner, section IV.2; both points are at the end of the step, and ``work[POINT]`` is the latter.
    """
    slopes = states = 0.0
    for m in range(n):
        slopes += (work[tableau.first + tableau.end, m] - work[tableau.first + tableau.end - 1, m]) ** 2
        states += (work[y_new, m] - work[POINT, m]) ** 2
    return h * h * slopes > _BOUNDARY * _BOUNDARY * states


@compiled
def all_finite(work: FloatArray, first: int, second: int) -> bool:
    """Whether every entry of two rows is finite."""
    total = 0.0
    for m in range(work.shape[1]):
        total += 0.0 * work[first, m] + 0.0 * work[second, m]
    return total == 0.0


@compiled
def first_step_size(
    rhs: int,
    tableau: PackedTableau,
    t: float,
    direction: float,
    limit: float,
    work: FloatArray,
    constants: FloatArray,
    y: int,
    rtol: float,
    atol: float,
    n: int,
) -> float:
    """Size of the first step, at most ``limit``; the first stage must have been evaluated, one more is.

    Source: Hairer, Norsett, Wanner, section II.4, "Starting step size".
    """
    size = slope = curvature = 0.0
    for m in range(n):
        scale = 1.0 / (atol + rtol * abs(work[y, m]))
        size += (work[y, m] * scale) ** 2
        slope += (work[tableau.first, m] * scale) ** 2
    size, slope = math.sqrt(size / n), math.sqrt(slope / n)
    h = 1e-6 if size < 1e-5 or slope < 1e-5 else 0.01 * size / slope
    h = min(h, limit)
    for m in range(n):
        work[POINT, m] = work[y, m] + direction * h * work[tableau.first, m]
    call_kernel(rhs, t + direction * h, work, POINT, constants, tableau.first + 1, n)
    for m in range(n):
        scale = 1.0 / (atol + rtol * abs(work[y, m]))
        curvature += ((work[tableau.first + 1, m] - work[tableau.first, m]) * scale) ** 2
    curvature = math.sqrt(curvature / n) / h
    if not math.isfinite(curvature):
        return h
    largest = max(slope, curvature)
    improved = max(1e-6, 1e-3 * h) if largest <= 1e-15 else (0.01 / largest) ** tableau.exponent
    return min(100.0 * h, improved, limit)


@compiled
def dense_polynomial(
    tableau: PackedTableau,
    h: float,
    work: FloatArray,
    y: int,
    y_new: int,
    pieces: FloatArray,
    piece: int,
    n: int,
) -> None:
    """Write the polynomial of a step into a row of ``pieces``, behind its first entry, lowest power first.

    What its end lacks of ``work[y_new]``, be it rounding or a projection, is added as ``3*theta**2 -
    2*theta**3`` times the difference, which makes it continuous and leaves the slopes at both ends alone.
    """
    for m in range(n):
        pieces[piece, 1 + m] = work[y, m]
        gap = work[y_new, m] - work[y, m]
        for power in range(1, tableau.degree + 1):
            row = tableau.total + 1 + power
            value = 0.0
            for entry in range(tableau.starts[row], tableau.starts[row + 1]):
                value += tableau.weights[entry] * work[tableau.stages[entry], m]
            pieces[piece, 1 + power * n + m] = h * value
            gap -= h * value
        pieces[piece, 1 + 2 * n + m] += 3.0 * gap
        pieces[piece, 1 + 3 * n + m] -= 2.0 * gap


@compiled
def evaluate_polynomial(pieces: FloatArray, piece: int, degree: int, theta: float, work: FloatArray, n: int) -> None:
    """Evaluate a polynomial that ``dense_polynomial`` wrote, by Horner's scheme, into ``work[POINT]``."""
    for m in range(n):
        value = pieces[piece, 1 + degree * n + m]
        for power in range(degree - 1, -1, -1):
            value = value * theta + pieces[piece, 1 + power * n + m]
        work[POINT, m] = value


@compiled
def store(rows: FloatArray, number: int, t: float, work: FloatArray, source: int) -> FloatArray:
    """Write ``t`` and a state into a row of ``rows`` (capacity, 1 + n_y); return the array, grown if full."""
    rows = with_room(rows, number)
    rows[number, 0] = t
    for m in range(rows.shape[1] - 1):
        rows[number, 1 + m] = work[source, m]
    return rows


@compiled
def with_room(rows: FloatArray, number: int) -> FloatArray:
    """Return the array itself if it has a row ``number``, else a copy with twice the rows."""
    if number < rows.shape[0]:
        return rows
    larger = np.empty((2 * rows.shape[0], rows.shape[1]))
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            larger[i, j] = rows[i, j]
    return larger
