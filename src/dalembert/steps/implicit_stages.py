"""Error estimate, first step and dense polynomial of one step of Radau IIA, whose vectors are rows as in `newton`."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..methods.collocation import BETWEEN, ERROR_WEIGHTS, INVERSE_POWERS, NODES
from ..subset.compiled_subset import compiled_subset, fma, sqrt, square
from .lu import solve
from .newton import ERROR, SCALE, SLOPE, NewtonWorkspace, P, Z
from .packed_tableaus import ALLOWED, DELTA, POINT
from .projection import end_polynomial
from .recorded_runs import Run, evaluate
from .step_control import error_scale


@compiled_subset
def estimate(
    rhs: int,
    t: float,
    h: float,
    differential: int,
    run: Run,
    y: int,
    y_new: int,
    space: NewtonWorkspace,
    rtol: float,
    careful: bool,
) -> tuple[float, int]:
    """Return the RMS norm of the error over the tolerances, and the evaluations of the right-hand side.

    ``careful`` filters an estimate that is too large once more, as stiff components demand after a first step and
    after a rejection.
    """
    work, vector = run.work, space.first
    n = work.shape[1]
    error, evaluations = 0.0, 0
    for attempt in range(2):
        source = SLOPE if attempt == 0 else DELTA
        for m in range(n):
            vector[m] = work[source, m]
            if m < differential:
                for i in range(3):
                    vector[m] += ERROR_WEIGHTS[i] * work[Z + i, m] / h
        solve(space.real, space.real_pivots, vector)
        total = 0.0
        for m in range(n):
            work[ERROR, m] = vector[m]
            if m < differential:
                scale = error_scale(rtol, work[ALLOWED, m], max(abs(work[y, m]), abs(work[y_new, m])))
                total += square(vector[m] / scale)
        error = sqrt(total / differential)
        if error <= 1.0 or not careful or attempt == 1 or not error < np.inf:
            break
        for m in range(n):
            work[POINT, m] = work[y, m] + work[ERROR, m]
        evaluate(rhs, t, run, POINT, DELTA)
        evaluations += 1
    return error, evaluations


@compiled_subset
def between(work: FloatArray, y: int, y_new: int, differential: int, ratio: float, rtol: float) -> float:
    """Return the RMS norm over the tolerances of the error of the step's polynomial between its nodes.

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
        there = x * fma(x, fma(x, third, fma(3.0, third, second)), fma(3.0, third, fma(2.0, second, first)))
        here = 0.0
        for k in range(2, -1, -1):
            value = 0.0
            for i in range(3):
                value = fma(INVERSE_POWERS[k, i], work[Z + i, m], value)
            here = theta * (value + here)
        scale = error_scale(rtol, work[ALLOWED, m], max(abs(work[y, m]), abs(work[y_new, m])))
        total += square((there - here) / (scope * scale))
    return BETWEEN * sqrt(total / differential)


@compiled_subset
def scale_of(
    work: FloatArray,
    y: int,
    differential: int,
    paired: int,
    h: float,
    rtol: float,
    tolerance: float,
) -> None:
    """Write the scales of Newton corrections.

    Multipliers count the less the smaller the step is. No component is asked for more digits than rounding leaves: of
    systems with multipliers the state is positions and then velocities, each as exact as the largest of its kind, and
    what rounding leaves of either the multipliers take up within a step. First-order states, behind the ``paired``
    components, are each of a kind of its own.
    """
    n = work.shape[1]
    kinds = 1 if differential == n else 2
    count, largest = (differential if kinds == 1 else paired) // kinds, 0.0
    for kind in range(kinds):
        size = 0.0
        for m in range(kind * count, (kind + 1) * count):
            size = max(size, abs(work[y, m]))
        largest = max(largest, size)
        noise = 1e-15 * size / tolerance
        for m in range(kind * count, (kind + 1) * count):
            work[SCALE, m] = max(noise, error_scale(rtol, work[ALLOWED, m], abs(work[y, m])))
    for m in range(kinds * count, differential):
        size = abs(work[y, m])
        largest = max(largest, size)
        work[SCALE, m] = max(1e-15 * size / tolerance, error_scale(rtol, work[ALLOWED, m], size))
    noise = 1e-15 * largest / tolerance
    for m in range(differential, n):
        work[SCALE, m] = max(noise, error_scale(rtol, work[ALLOWED, m], abs(work[y, m]))) / min(1.0, abs(h))


@compiled_subset
def first_step(work: FloatArray, y: int, differential: int, span: float, limit: float, rtol: float) -> float:
    """Size of the first step, at most ``limit``, from the sizes of the state and of its slope."""
    size = slope = 0.0
    for m in range(differential):
        scale = 1.0 / error_scale(rtol, work[ALLOWED, m], abs(work[y, m]))
        size += square(work[y, m] * scale)
        slope += square(work[SLOPE, m] * scale)
    if size < 1e-10 * differential or slope < 1e-10 * differential:
        return min(1e-6 * span, limit)
    # the share of a time scale of the state over which a method whose estimate has order 3 errs by the tolerance
    return min(sqrt(size / slope) * min(0.01, sqrt(sqrt(max(rtol, 1e-14)))), limit)


@compiled_subset
def keep_polynomial(work: FloatArray) -> None:
    """Write the coefficients of the collocation polynomial through the increments."""
    for m in range(work.shape[1]):
        for k in range(3):
            value = 0.0
            for i in range(3):
                value = fma(INVERSE_POWERS[k, i], work[Z + i, m], value)
            work[P + k, m] = value


@compiled_subset
def write_polynomial(work: FloatArray, y: int, y_new: int, pieces: FloatArray, piece: int, n: int) -> None:
    """Write the polynomial of a step into a row of ``pieces``, behind its first entry, lowest power first.

    It ends in ``work[y_new]`` (`end_polynomial`).
    """
    for m in range(n):
        first, second, third = work[P, m], work[P + 1, m], work[P + 2, m]
        difference = work[y_new, m] - work[y, m] - (first + second + third)
        terms = abs(work[y, m]) + abs(first) + abs(second) + abs(third)
        pieces[piece, 1 + m] = work[y, m]
        pieces[piece, 1 + n + m] = first
        pieces[piece, 1 + 2 * n + m] = second
        pieces[piece, 1 + 3 * n + m] = third
        end_polynomial(pieces, piece, 1 + m, n, difference, terms)
