"""Projection of states onto the constraints, and polynomials of steps made to end in the projected states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..methods.step_constants import (
    ADMITTED_ENERGY,
    BRANCH,
    EPSILON,
    LINEAR_CHANGE,
    LINEAR_CORRECTIONS,
    MOST_CORRECTIONS,
    QUADRATIC_CHANGE,
    SMALL_COMPONENT,
    SMALLEST_OF_TIME,
)
from ..stops.segments import Constants, constants_at
from ..subset.compiled_subset import call_code, compiled_subset, flat, row, sqrt

NONE, PENDING, FAILED = 0, 1, 3
_CONVERGED = 2


@compiled_subset
def add_correction(
    states: FloatArray, first: int, earlier: FloatArray, before: int, delta: FloatArray, lane: int, atol: float
) -> tuple[float, float, float, bool]:
    """Add a correction to the state of a lane, which begins in row `first`; before the step it is in `earlier`.

    Returns the relative change, the largest entry of the correction, the largest that both states have where one is
    corrected, and whether the correction is finite. Where it brings these entries nearer than its own size to those
    before the step, the largest difference from them counts: a body that rests stays at rest, however small rounding
    of its accelerations is.
    """
    change = finite = size = moved = magnitude = 0.0
    for m in range(delta.shape[0]):
        if delta[m, lane] != 0.0:
            size = max(size, abs(delta[m, lane]))
            moved = max(moved, abs(states[first + m, lane] + delta[m, lane] - earlier[before + m, lane]))
            magnitude = max(magnitude, max(abs(states[first + m, lane]), abs(earlier[before + m, lane])))
    least = SMALL_COMPONENT * magnitude + atol
    for m in range(delta.shape[0]):
        states[first + m, lane] += delta[m, lane]
        if delta[m, lane] != 0.0:
            change = max(change, abs(delta[m, lane]) / (least + abs(states[first + m, lane])))
        finite += 0.0 * delta[m, lane]
    return change, min(size, moved), magnitude, finite == 0.0


@compiled_subset
def largest_change(magnitude: float, rtol: float, atol: float) -> float:
    """Return the largest change of velocities of a magnitude that corrects the error of a step.

    A projection takes the energy of its correction from the motion, because it is orthogonal in the norm of the masses.
    """
    error = atol + max(rtol, SMALLEST_OF_TIME) * magnitude
    return min(BRANCH * magnitude, sqrt(ADMITTED_ENERGY * error * magnitude)) + sqrt(ADMITTED_ENERGY) * atol


@compiled_subset
def correction_test(
    attempt: int, tries: int, change: float, size: float, magnitude: float, finite: bool, rtol: float, atol: float
) -> int:
    """Return whether a state needs another correction (`PENDING`), none, or cannot be projected (`FAILED`).

    ``attempt`` is the number of the correction, ``tries`` the most corrections. After the last one, a small change is
    accepted. The first correction of velocities must not take them to another branch of their constraints. For the
    other parameters see `add_correction`.
    """
    first_of_velocities = attempt == 0 and tries == LINEAR_CORRECTIONS
    if not finite or (first_of_velocities and not size <= largest_change(magnitude, rtol, atol)):
        return FAILED
    if not change > QUADRATIC_CHANGE:
        return _CONVERGED
    return FAILED if attempt == tries - 1 and not change <= LINEAR_CHANGE else PENDING


@compiled_subset
def correct(
    position: int,
    velocity: int,
    clock: FloatArray,
    states: FloatArray,
    first: int,
    earlier: FloatArray,
    before: int,
    constants: FloatArray,
    delta: FloatArray,
    mark: NDArray[np.int64],
    rtol: float,
    atol: float,
) -> None:
    """Project the states of the lanes that are `PENDING` in ``mark`` (lanes,), which becomes `FAILED` where that fails.

    ``states`` holds the states from row `first` on, ``earlier`` from row `before` on those before the step;
    ``delta`` (n, lanes) is overwritten.
    """
    lanes = clock.shape[1]
    for kernel, tries in ((position, MOST_CORRECTIONS), (velocity, LINEAR_CORRECTIONS)):
        left = 0
        for lane in range(lanes):
            left += 1 if mark[lane] == PENDING else 0
        if kernel == 0:
            left = 0
        for attempt in range(tries):
            if left == 0:
                break
            call_code(kernel, row(clock, 0), row(states, first), row(constants, 0), 0, row(delta, 0))
            for lane in range(lanes):
                if mark[lane] == PENDING:
                    change, size, magnitude, finite = add_correction(states, first, earlier, before, delta, lane, atol)
                    mark[lane] = correction_test(attempt, tries, change, size, magnitude, finite, rtol, atol)
                    left -= 1 if mark[lane] != PENDING else 0
        for lane in range(lanes):
            if mark[lane] == _CONVERGED:
                mark[lane] = PENDING


@compiled_subset
def project_row(
    position: int,
    velocity: int,
    t: float,
    clock: FloatArray,
    states: FloatArray,
    number: int,
    earlier: FloatArray,
    before: int,
    constants: FloatArray,
    delta: FloatArray,
    mark: NDArray[np.int64],
    rtol: float,
    atol: float,
) -> bool:
    """Project the state that begins a row of ``states``, where there are projections; return whether that succeeded.

    Before the step it begins the row `before` of ``earlier``.
    ``clock`` (1, 1), ``delta`` (n, 1) and ``mark`` (1,) are overwritten.
    """
    if position == 0 and velocity == 0:
        return True
    clock[0, 0], mark[0] = t, PENDING
    first, second = number * states.shape[1], before * earlier.shape[1]
    correct(position, velocity, clock, flat(states), first, flat(earlier), second, constants, delta, mark, rtol, atol)
    return mark[0] == PENDING


# Interpolated states projected onto the constraints.


def projected(program: Program, c: Constants, t: FloatArray, y: FloatArray) -> FloatArray:
    """Return interpolated states (k, n_y) at times t (k,) on the constraints, where the formulation projects."""
    c = constants_at(c, t)
    for kernel in ("project_position", "project_velocity"):
        if kernel in program:
            for _ in range(2):
                y = y + interpret_rows(program.kernel(kernel), t, y, c)
    return y


# Polynomials of steps made to end in the states that the steps ended in, by rounding, compensation or a projection.
#
# ``3*theta**2 - 2*theta**3`` times the difference is added, which leaves the start and the slopes at both ends alone.
# A difference of rounding is left: it would bend polynomials that begin with slope zero, so that they change their
# sign where the motion does not.

ROUNDING_OF_POLYNOMIALS = 16.0 * EPSILON
"""Difference at the end of a step, relative to the terms of its polynomial, that rounding explains."""


@compiled_subset
def end_polynomial(
    polynomials: FloatArray, number: int, first: int, stride: int, difference: float, terms: float
) -> None:
    """Correct a polynomial by the `difference` at its end; `terms` is the sum of the sizes of its terms.

    Its coefficients, lowest power first, lie in a row from `first` on, so many columns apart.
    """
    if abs(difference) <= ROUNDING_OF_POLYNOMIALS * terms:
        return
    polynomials[number, first + 2 * stride] += 3.0 * difference
    polynomials[number, first + 3 * stride] -= 2.0 * difference


def end_in(states: FloatArray, polynomials: FloatArray) -> None:
    """Correct polynomials (k, degree + 1, n), in the fraction of each step, to end in states (k, n)."""
    differences = end_differences(states - polynomials.sum(axis=1), np.abs(polynomials).sum(axis=1))
    polynomials[:, 2] += 3.0 * differences
    polynomials[:, 3] -= 2.0 * differences


def end_differences(differences: FloatArray, terms: FloatArray) -> FloatArray:
    """Return differences at the ends of polynomials, 0 where rounding of terms of these sizes explains them."""
    return np.where(np.abs(differences) <= ROUNDING_OF_POLYNOMIALS * terms, 0.0, differences)
