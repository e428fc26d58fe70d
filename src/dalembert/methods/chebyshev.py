"""Chebyshev points, coefficients and bounds of functions on a piece of a step."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray

COUNT = 8
"""Points of a piece."""


BOUNDS = 2
"""Numbers that say what an expression does over a step, see `dalembert.transforms.step_bounds.point_bounds_kernel`."""


_ANGLES = np.pi * np.arange(COUNT) / (COUNT - 1)


_HALVES = np.where(np.isin(np.arange(COUNT), (0, COUNT - 1)), 0.5, 1.0)


POINTS: FloatArray = np.concatenate([[0.0], 0.5 - 0.5 * np.cos(_ANGLES[1:-1]), [1.0]])
"""The Chebyshev points of an interval of length 1."""


COEFFICIENTS: FloatArray = (
    2.0 / (COUNT - 1) * np.cos(np.outer(np.arange(COUNT), _ANGLES[::-1])) * _HALVES * _HALVES[:, np.newaxis]
)
"""From values at the points to Chebyshev coefficients."""


CHECKS: FloatArray = np.array([*(0.5 - 0.5 * np.cos(_ANGLES[1:] - 0.5 * _ANGLES[1])), 1.5 - 0.5 * np.sqrt(5.0)])
"""Points between those of an interval, as many: a function that oscillates leaves its polynomial there."""


BETWEEN: FloatArray = np.polynomial.chebyshev.chebvander(2.0 * CHECKS - 1.0, COUNT - 1) @ COEFFICIENTS
"""From values at the points to those of their polynomial at the points between them."""


MISSED = 4.0
"""Multiple of the largest difference of a function and its polynomial between the points that it may have elsewhere."""


CONVERGED, UNSEEN = 1e-3, 1e3
"""Share of the last two coefficients in all but the first, up to which a function does not oscillate between the
points, and multiple of all but the first by which it may vary if it does. Of a million sines with 3 to 160 periods,
none whose values at the points show one sign converges so."""


SLOPES: FloatArray = np.array([[*np.polynomial.chebyshev.chebder(row), 0.0] for row in np.eye(COUNT)]).T @ COEFFICIENTS
"""From values at the points to the Chebyshev coefficients of the derivative, over half the length of the interval."""


_REST = POINTS[1:]


_TOWARDS: FloatArray = np.array([np.prod([other / (other - x) for other in _REST if other != x]) for x in _REST])
"""From values at the other points to that of their polynomial at zero."""


def _divided(power: int) -> FloatArray:
    """Return the matrix from values at the points to the coefficients of f(x) / x^power, with f(0) = 0."""
    matrix = COEFFICIENTS[:, 1:] + np.outer(COEFFICIENTS[:, 0], _TOWARDS)
    return np.hstack([np.zeros((COUNT, 1)), matrix / _REST**power])


DIVIDED: FloatArray = np.array([_divided(power) for power in (1, 2, 3)])
"""The same for a function that is zero where the interval begins, divided by a power of the distance from there."""


BEND: FloatArray = np.concatenate([[0.0], _TOWARDS / _REST**2])
"""From values at the points to half the second derivative where the interval begins, with value and slope zero."""


TAIL, SLOPE_TAIL = 2.0, 2.0 * (COUNT - 1) ** 2
"""Factors of the last two coefficients that make them a bound of all that follow."""


_DERIVATIVE = np.array([[*np.polynomial.chebyshev.chebder(row), 0.0] for row in np.eye(COUNT)]).T


BENDS: FloatArray = _DERIVATIVE @ SLOPES
"""From values at the points to the Chebyshev coefficients of the second derivative."""


INTEGRAL: FloatArray = np.array([1.0 / (1.0 - k * k) if k % 2 == 0 else 0.0 for k in range(COUNT)])
"""From Chebyshev coefficients to the mean over the piece (Clenshaw and Curtis, Numerische Mathematik 2, 1960)."""


BEND_TAIL = 2.0 * (COUNT - 1) ** 2 * ((COUNT - 1) ** 2 - 1) / 3.0
"""Factor of the last two coefficients that makes them a bound of what the second derivative leaves out."""


SMOOTH, CLOSE = 3e-11, 1e-8
"""For an integral, share in all coefficients of the last two times their ratio to the two before them, which is what
the first two that are left out may be; for an extremum, share of the last two in what varies."""


NEGLIGIBLE = 1e-13
"""Share of the last two coefficients in all, below which their ratio to others is rounding."""
