"""Stages, error estimate, first step and dense polynomial of one explicit Runge-Kutta step.

All vectors are rows of one array ``work`` (n_rows, width), in the order that ``packing`` gives. The width is
n_y rounded up to a multiple of ``LANES`` and the padding stays 0, so that inner loops have no remainder.
"""

from __future__ import annotations

import math

from ..arrays import FloatArray
from ..methods.step_constants import (
    FIRST_BLIND,
    FIRST_GROWTH,
    FIRST_NEGLIGIBLE,
    FIRST_SHARE,
    FIRST_SLOPE,
    SECOND_ERROR_WEIGHT,
)
from ..subset.compiled_subset import compiled_subset, exp, fma, log, sqrt, square
from .packed_tableaus import ALLOWED, POINT, PackedTableau
from .projection import end_polynomial
from .recorded_runs import Run, evaluate
from .step_control import error_scale

LANES = 8
STIFFNESS_FROM, STIFF_STEPS = 1000, 15
"""Steps after which a run is tested for stiffness, and steps in a row at the boundary of stability that show it."""

_BOUNDARY = 3.0


@compiled_subset
def evaluate_stages(
    rhs: int, tableau: PackedTableau, begin: int, end: int, t: float, h: float, run: Run, y: int, y_new: int
) -> None:
    """Evaluate the stages `begin` to `end` - 1 of a step from ``work[y]``.

    Sums are written out for ``LANES`` components at a time, which keeps them in registers. The state of stage ``end``
    of the tableau is kept in ``work[y_new]``; it is evaluated only if the error estimate needs it.
    """
    work = run.work
    for i in range(begin, end):
        out = y_new if i == tableau.end else POINT
        for block in range(work.shape[1] // LANES):
            m = LANES * block
            s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
            for entry in range(tableau.starts[i], tableau.starts[i + 1]):
                weight, stage = tableau.weights[entry], tableau.stages[entry]
                s0 = fma(weight, work[stage, m], s0)
                s1 = fma(weight, work[stage, m + 1], s1)
                s2 = fma(weight, work[stage, m + 2], s2)
                s3 = fma(weight, work[stage, m + 3], s3)
                s4 = fma(weight, work[stage, m + 4], s4)
                s5 = fma(weight, work[stage, m + 5], s5)
                s6 = fma(weight, work[stage, m + 6], s6)
                s7 = fma(weight, work[stage, m + 7], s7)
            work[out, m] = fma(h, s0, work[y, m])
            work[out, m + 1] = fma(h, s1, work[y, m + 1])
            work[out, m + 2] = fma(h, s2, work[y, m + 2])
            work[out, m + 3] = fma(h, s3, work[y, m + 3])
            work[out, m + 4] = fma(h, s4, work[y, m + 4])
            work[out, m + 5] = fma(h, s5, work[y, m + 5])
            work[out, m + 6] = fma(h, s6, work[y, m + 6])
            work[out, m + 7] = fma(h, s7, work[y, m + 7])
        if i != tableau.end or tableau.fsal:
            evaluate(rhs, t + tableau.nodes[i] * h, run, out, tableau.first + i)


@compiled_subset
def error_norm(tableau: PackedTableau, h: float, work: FloatArray, y: int, y_new: int, rtol: float, n: int) -> float:
    """RMS norm of the error estimate over the tolerances (combined as in DOP853 if there are two rows)."""
    row = tableau.total
    first, second, last = tableau.starts[row], tableau.starts[row + 1], tableau.starts[row + 2]
    total = total_second = 0.0
    for m in range(n):
        estimate = estimate_second = 0.0
        for entry in range(first, second):
            estimate = fma(tableau.weights[entry], work[tableau.stages[entry], m], estimate)
        for entry in range(second, last):
            estimate_second = fma(tableau.weights[entry], work[tableau.stages[entry], m], estimate_second)
        scale = 1.0 / error_scale(rtol, work[ALLOWED, m], max(abs(work[y, m]), abs(work[y_new, m])))
        total += square(estimate * scale)
        total_second += square(estimate_second * scale)
    below = (total + SECOND_ERROR_WEIGHT * total_second) * n
    if below == 0.0:  # also where squares of tiny estimates underflow
        return 0.0
    return abs(h) * total / sqrt(below)


@compiled_subset
def polynomial_error(
    tableau: PackedTableau, h: float, work: FloatArray, y: int, y_new: int, rtol: float, n: int
) -> float:
    """RMS norm of the error of the dense output over what is allowed (see `Tableau.bounded`); needs all stages."""
    row, total = tableau.total + 2 + tableau.degree, 0.0
    for m in range(n):
        estimate = 0.0
        for entry in range(tableau.starts[row], tableau.starts[row + 1]):
            estimate = fma(tableau.weights[entry], work[tableau.stages[entry], m], estimate)
        total += square(estimate / error_scale(rtol, work[ALLOWED, m], max(abs(work[y, m]), abs(work[y_new, m]))))
    return abs(h) * sqrt(total / n)


@compiled_subset
def at_boundary(tableau: PackedTableau, h: float, work: FloatArray, y_new: int, n: int) -> bool:
    """Whether a step is near the limit of stability, from slopes at its end and at the last stage before it.

    Source: Hairer and Wanner, section IV.2; both points are at the end of the step, and ``work[POINT]`` is the latter.
    """
    slopes = states = 0.0
    for m in range(n):
        slopes += square(work[tableau.first + tableau.end, m] - work[tableau.first + tableau.end - 1, m])
        states += square(work[y_new, m] - work[POINT, m])
    return h * h * slopes > _BOUNDARY * _BOUNDARY * states


@compiled_subset
def first_step_size(
    rhs: int,
    tableau: PackedTableau,
    t: float,
    direction: float,
    limit: float,
    run: Run,
    y: int,
    rtol: float,
    n: int,
) -> float:
    """Size of the first step, at most ``limit``; the first stage must have been evaluated, one more is.

    Source: Hairer, Norsett, Wanner, section II.4, "Starting step size".
    """
    work = run.work
    size = slope = curvature = 0.0
    for m in range(n):
        scale = 1.0 / error_scale(rtol, work[ALLOWED, m], abs(work[y, m]))
        size += square(work[y, m] * scale)
        slope += square(work[tableau.first, m] * scale)
    size, slope = sqrt(size / n), sqrt(slope / n)
    h = FIRST_BLIND if size < FIRST_NEGLIGIBLE or slope < FIRST_NEGLIGIBLE else FIRST_SHARE * size / slope
    h = min(h, limit)
    for m in range(n):
        work[POINT, m] = fma(direction * h, work[tableau.first, m], work[y, m])
    evaluate(rhs, t + direction * h, run, POINT, tableau.first + 1)
    for m in range(n):
        scale = 1.0 / error_scale(rtol, work[ALLOWED, m], abs(work[y, m]))
        curvature += square((work[tableau.first + 1, m] - work[tableau.first, m]) * scale)
    curvature = sqrt(curvature / n) / h
    if not math.isfinite(curvature):
        return h
    largest = max(slope, curvature)
    improved = max(FIRST_BLIND, 1e-3 * h)
    if largest > FIRST_SLOPE:
        improved = exp(tableau.exponent * log(FIRST_SHARE / largest))
    return min(FIRST_GROWTH * h, improved, limit)


@compiled_subset
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

    It ends in ``work[y_new]`` (`end_polynomial`).
    """
    for m in range(n):
        pieces[piece, 1 + m] = work[y, m]
        difference, terms = work[y_new, m] - work[y, m], abs(work[y, m])
        for power in range(1, tableau.degree + 1):
            row = tableau.total + 1 + power
            value = 0.0
            for entry in range(tableau.starts[row], tableau.starts[row + 1]):
                value = fma(tableau.weights[entry], work[tableau.stages[entry], m], value)
            pieces[piece, 1 + power * n + m] = h * value
            difference = fma(-h, value, difference)
            terms += abs(h * value)
        end_polynomial(pieces, piece, 1 + m, n, difference, terms)
