"""Arithmetic of bounds: pairs of arrays, the least and the largest value, rounded outwards."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

_SLACK = 4.0 * 2.220446049250313e-16
_LEAST = 1e-300

Bounds = tuple[Any, Any]


def wider(low: Any, high: Any) -> Bounds:
    """Return bounds that hold the rounded operation which gave them."""
    return low - (_SLACK * np.abs(low) + _LEAST), high + (_SLACK * np.abs(high) + _LEAST)


def plus(a: Bounds, b: Bounds) -> Bounds:
    """Return the bounds of sums."""
    return wider(a[0] + b[0], a[1] + b[1])


def times(a: Bounds, b: Bounds) -> Bounds:
    """Return the bounds of products; those of zero times infinity hold zero."""
    products = [x * y for x in a for y in b]
    products = [np.where(np.isnan(product), 0.0, product) for product in products]  # 0 times infinity
    lost = np.isnan(a[0]) | np.isnan(a[1]) | np.isnan(b[0]) | np.isnan(b[1])
    low = np.minimum(np.minimum(products[0], products[1]), np.minimum(products[2], products[3]))
    high = np.maximum(np.maximum(products[0], products[1]), np.maximum(products[2], products[3]))
    return wider(np.where(lost, -np.inf, low), np.where(lost, np.inf, high))


def reciprocal(b: Bounds) -> Bounds:
    """Return the bounds of reciprocals; infinite ones where zero is within."""
    crosses = ~((b[0] > 0.0) | (b[1] < 0.0))
    return wider(np.where(crosses, -np.inf, 1.0 / b[1]), np.where(crosses, np.inf, 1.0 / b[0]))


def hull(a: Bounds, b: Bounds) -> Bounds:
    """Return the bounds of two ranges together."""
    return np.minimum(a[0], b[0]), np.maximum(a[1], b[1])


def cosine(a: Bounds) -> Bounds:
    """Return bounds of the cosine, exact where extrema are within."""
    low, high = a
    ends = np.cos(low), np.cos(high)
    turns = 2.0 * np.pi
    slack = _SLACK * (np.abs(low) + np.abs(high)) + 1e-15
    top = np.floor((high + slack) / turns) >= np.ceil((low - slack) / turns)
    bottom = np.floor((high + slack) / turns - 0.5) >= np.ceil((low - slack) / turns - 0.5)
    wild = ~np.isfinite(low) | ~np.isfinite(high)
    least = np.where(bottom | wild, -1.0, np.minimum(*ends) - slack)
    most = np.where(top | wild, 1.0, np.maximum(*ends) + slack)
    return np.maximum(least, -1.0), np.minimum(most, 1.0)


def sine(a: Bounds) -> Bounds:
    """Return the bounds of the sine."""
    return cosine((a[0] - 0.5 * np.pi, a[1] - 0.5 * np.pi))


def square(a: Bounds) -> Bounds:
    """Return the bounds of squares."""
    value = times(a, a)
    return np.where((a[0] <= 0.0) & (a[1] >= 0.0), 0.0, np.maximum(value[0], 0.0)), value[1]


def one_plus(a: Bounds) -> Bounds:
    """Return the bounds of 1 + a."""
    return plus((1.0, 1.0), a)


def _minus(a: Bounds) -> Bounds:
    return -a[1], -a[0]


def root(a: Bounds) -> Bounds:
    """Return the bounds of square roots, of the part that has any."""
    return np.sqrt(np.maximum(a[0], 0.0)), np.sqrt(np.maximum(a[1], 0.0))


def arc_slope(a: Bounds) -> Bounds:
    """Return the bounds of the derivative of the arcsine."""
    return reciprocal(root(one_plus(_minus(square(a)))))


def even(function: Callable[[Any], Any]) -> Callable[[Bounds], Bounds]:
    """Return an even function that grows away from zero."""

    def call(a: Bounds) -> Bounds:
        ends = function(a[0]), function(a[1])
        within = (a[0] <= 0.0) & (a[1] >= 0.0)
        return wider(np.where(within, function(0.0), np.minimum(*ends)), np.maximum(*ends))

    return call
