"""Polynomials of steps made to end in the states that the steps ended in, by rounding, compensation or a projection.

``3*theta**2 - 2*theta**3`` times the difference is added, which leaves the start and the slopes at both ends alone. A
difference of rounding is left: it would bend polynomials that begin with slope zero, so that they change their sign
where the motion does not.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..methods.step_constants import EPSILON
from .compiled_subset import compiled_subset

__all__ = ["end_differences", "end_in", "end_polynomial"]

_ROUNDING = 16.0 * EPSILON
"""Difference at the end of a step, relative to the terms of its polynomial, that rounding explains."""


@compiled_subset
def end_polynomial(
    polynomials: FloatArray, number: int, first: int, stride: int, difference: float, terms: float
) -> None:
    """Correct a polynomial by the `difference` at its end; `terms` is the sum of the sizes of its terms.

    Its coefficients, lowest power first, lie in a row from `first` on, so many columns apart.
    """
    if abs(difference) <= _ROUNDING * terms:
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
    return np.where(np.abs(differences) <= _ROUNDING * terms, 0.0, differences)
