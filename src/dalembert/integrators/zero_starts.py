"""Expressions that are zero where a motion begins: whether they leave zero to one side, as far as a step can tell.

Near its beginning such an expression is slope x + bend x^2 + r(x) x^3, with x the fraction of the step. Its slope is
known from the kernel of its rates, r from values along the polynomials of the step. These may be off by E x^2, and so
may its bend; rates along the polynomials give it without that error, and the difference of both is E. Eight values of
an expression that oscillates within the step do not give its bend: E is bounded by what values near the start show.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.chebyshev import BEND, COUNT, DIVIDED, MISSED, TAIL
from ..methods.event_constants import BENT, DOUBT, FLAT, LIKELY, RESOLVED, SHORT_SHARE, STEEP
from .compiled_subset import compiled_subset, sqrt, square

__all__ = [
    "ZeroStarts",
    "bend_agrees",
    "bend_from_rates",
    "deepest_dip",
    "error_limit",
    "least_doubt",
    "least_sizes",
    "leaves_zero",
    "short_share",
    "slope_agrees",
    "unresolved",
]


_AT_START = (-1.0) ** np.arange(COUNT)
"""Values of the Chebyshev polynomials where a piece begins."""


@compiled_subset
def short_share(t: float, h: float) -> float:
    """Return a share of a step from time t, as doubles tell it, over which differences of rates give a bend."""
    return ((t + SHORT_SHARE * h) - t) / h


@compiled_subset
def bend_from_rates(first: float, second: float, third: float, share: float) -> float:
    """Return half the second derivative over a step from rates where it begins, after a share of it, and after two.

    It is NaN where there is no share.
    """
    return (4.0 * second - 3.0 * first - third) / (4.0 * share) if share > 0.0 else math.nan


@compiled_subset
def error_limit(values: float, bend: float, noise: float, share: float) -> float:
    """Return a bound of the error of a bend along polynomials, from values where a step begins.

    `values` are 8 f(s) - f(2 s) - 7 f(0) - 6 s f'(0) of an expression f, for the share s; its half of the second
    derivative along the polynomials is a quarter of that over s^2. `bend` is the one without their error.
    """
    area = square(share)
    return LIKELY * (abs(0.25 * values / area - bend) + 4.0 * noise / area)


@compiled_subset
def deepest_dip(slope: float, bend: float, least: float) -> float:
    """Return how far least x^3 - bend x^2 - slope x falls below zero, for a slope of at least 0 and least above 0.

    At its minimum 3 least x^2 = 2 bend x + slope.
    """
    root = sqrt(square(bend) + 3.0 * least * slope)
    if bend >= 0.0:
        x = (bend + root) / (3.0 * least)
    else:
        x = slope / (root - bend)
    return x * (2.0 * slope + bend * x) / 3.0


@compiled_subset
def leaves_zero(
    slope: float, bend: float, twice: float, thrice: float, largest: float, noise: float, known: bool
) -> bool:
    """Return whether an expression keeps its sign on a piece that begins in its zero, but for what is next to nothing.

    Parameters
    ----------
    slope, bend : float
        Size of the slope, and the bend away from the side where the expression ends, over the piece.
    twice, thrice : float
        Least sizes of the expression divided by the second and third power of the distance, not above 0 where that may
        change its sign.
    largest, noise : float
        Its largest size, and the size below which it counts as zero.
    known : bool
        Whether it is known to leave zero to the side where it ends. Then it may dip to the other side by its noise, or
        by the share `BENT` of its largest size; else slope and bend must be nothing.
    """
    flat = slope <= FLAT * largest
    nothing = max(noise, BENT * largest)
    leaves = twice > 0.0 and (flat or (known and square(slope) <= 4.0 * twice * nothing))
    if thrice > 0.0:
        leaves = leaves or (flat and abs(bend) <= BENT * largest)
        leaves = leaves or (known and deepest_dip(slope, bend, thrice) <= nothing)
    return leaves


@compiled_subset
def slope_agrees(slope: float, last: float, largest: float) -> bool:
    """Return whether an expression leaves zero to the side where its values lie.

    It does not where it oscillates between the points.
    """
    return slope * last >= 0.0 or abs(slope) <= FLAT * largest


@compiled_subset
def bend_agrees(bend: float, last: float, twice: float) -> bool:
    """Return whether an expression that begins flat bends to where its values lie, if these say that it bends."""
    return twice <= 0.0 or (bend * last > 0.0 and 2.0 * abs(bend) >= twice)


@compiled_subset
def least_doubt(doubt: float, error: float, tail: float, limit: float) -> float:
    """Return the least error of a bend by the polynomials, as pieces tell it that become shorter.

    `tail` are the last coefficients of the expression divided by the square of the distance; where they are no small
    part of the error, the values do not tell the bend. `limit` is the `error_limit`.
    """
    return min(doubt, error, limit) if tail <= RESOLVED * error else doubt


@compiled_subset
def unresolved(value: float, theta: float, doubt: float) -> bool:
    """Return whether the error of the polynomials may have made a value at a fraction of the step that begins in zero.

    `doubt` is the error of the bend over the step, not finite where it is not known.
    """
    return doubt < math.inf and abs(value) <= DOUBT * doubt * square(theta)


def least_sizes(series: FloatArray) -> FloatArray:
    """Return the least sizes of functions that keep their signs, from the sizes of their coefficients (k, 8, n)."""
    tail = series[:, -2:].sum(axis=1)
    return np.asarray(series[:, 0] - (series[:, 1:].sum(axis=1) + TAIL * tail))


@final
class ZeroStarts:
    """Functions of which some are zero where the first of some steps begins.

    Parameters
    ----------
    slopes : (n,)
        Rates there over the step; NaN for functions that are not zero there.
    sides : (n,)
        Signs with which functions leave zero, where that is known by construction; 0 for others.
    share, near
        A short share of the step (`short_share`), and the function from such shares to the values and rates (n,) over
        the step.
    """

    def __init__(
        self,
        slopes: FloatArray,
        sides: FloatArray,
        share: float,
        near: Callable[[float], tuple[FloatArray, FloatArray]],
    ) -> None:
        self._slopes, self._share, self._near = slopes, share, near
        self._sides = np.where(np.isnan(slopes), 0.0, sides)
        self._bends: FloatArray | None = None
        self._limits = np.full(len(slopes), math.inf)
        self._doubts = np.full(len(slopes), math.inf)

    def simple(self, values: FloatArray, points: FloatArray, noise: FloatArray, good: NDArray[np.bool_]) -> bool:
        """Return whether a piece that begins there need not be cut.

        Parameters
        ----------
        values : (8, n)
            Of the functions, at `points` (8,), fractions of the step.
        noise : (n,)
            Sizes below which they count as zero.
        good : (n,)
            Those for which the piece need not be cut by itself.
        """
        left = np.flatnonzero(~good & ~np.isnan(self._slopes))
        if len(left) < np.count_nonzero(~good):
            return False
        if all(self._leaves(int(i), values[:, i], points, float(noise[i])) for i in left):
            return True
        flat = np.abs(self._slopes[left]) <= STEEP * np.abs(values[:, left]).max(axis=0)
        if self._bends is not None or not np.any(flat & (self._sides[left] != 0.0)):
            return False
        self._bends = self._find_bends(noise)
        return all(self._leaves(int(i), values[:, i], points, float(noise[i])) for i in left)

    def agree(self, values: FloatArray, high: float) -> NDArray[np.bool_]:
        """Return which functions (n,) leave zero to the side where their values (8, n) on a piece end."""
        rows = zip(self._slopes.tolist(), values[-1].tolist(), np.abs(values).max(axis=0).tolist(), strict=True)
        return np.array([math.isnan(slope) or slope_agrees(slope * high, *row) for slope, *row in rows], np.bool_)

    def keep_sides(
        self,
        resolved: NDArray[np.bool_],
        last: FloatArray,
        between: FloatArray,
        points: FloatArray,
        noise: FloatArray,
    ) -> None:
        """Set which functions (n,) that begin in zero have no value (8, n) at points between beyond the other side."""
        largest = np.maximum(np.abs(between).max(axis=0), np.abs(last))
        for i in np.flatnonzero(~np.isnan(self._slopes)):
            beyond = (between[:, i] * last[i] < 0.0) & (np.abs(between[:, i]) > max(noise[i], BENT * largest[i]))
            places = zip(between[beyond, i].tolist(), points[beyond].tolist(), strict=True)
            resolved[i] = all(unresolved(value, x, self._doubts[i]) for value, x in places)

    def _find_bends(self, noise: FloatArray) -> FloatArray:
        """Return bends without the errors of the polynomials, and set the limits of these errors."""
        share, slopes = self._share, self._slopes
        (begin, _), (once, first), (twice, second) = (self._near(x * share) for x in (0.0, 1.0, 2.0))
        rates = zip(slopes.tolist(), first.tolist(), second.tolist(), strict=True)
        bends = np.array([bend_from_rates(a, b, c, share) for a, b, c in rates])
        values = 8.0 * once - twice - 7.0 * begin - 6.0 * share * slopes
        if share > 0.0:
            rows = zip(values.tolist(), bends.tolist(), noise.tolist(), strict=True)
            self._limits = np.array([error_limit(*row, share) for row in rows])
        return bends

    def _leaves(self, i: int, values: FloatArray, points: FloatArray, noise: float) -> bool:
        """Return whether a piece need not be cut for a function that is zero where it begins."""
        high, last, slope = float(points[-1]), float(values[-1]), float(self._slopes[i])
        with np.errstate(all="ignore"):
            series = [np.abs(matrix @ values)[np.newaxis] for matrix in DIVIDED]
            once, twice, thrice = (float(least_sizes(part)[0]) for part in series)
            begin = float(_AT_START @ (DIVIDED[0] @ values))
            bend, largest = float(BEND @ (values - slope * points)), float(np.abs(values).max())
        if once > MISSED * abs(begin - slope * high) or abs(slope) * high > STEEP * largest:
            return once > MISSED * abs(begin - slope * high) and slope_agrees(slope * high, last, largest)
        beyond = float(self._sides[i]) * last < 0.0
        if beyond and self._bends is None:
            return False
        if self._bends is not None and self._sides[i] != 0.0 and math.isfinite(self._bends[i]):
            exact = float(self._bends[i]) * high * high
            error, tail = abs(bend - exact) / (high * high), float(series[1][0, -2:].sum()) / (high * high)
            doubt = self._doubts[i] = least_doubt(self._doubts[i], error, tail, self._limits[i])
            bend = exact
            if all(unresolved(v, x, doubt) for v, x in zip(values.tolist(), points.tolist(), strict=True)):
                return True
            if beyond and not bend_agrees(bend, last, twice):
                return False
        known = float(self._sides[i]) * last > 0.0
        return leaves_zero(abs(slope) * high, bend if last < 0.0 else -bend, twice, thrice, largest, noise, known)

    def drop_unresolved(self, low: FloatArray, high: FloatArray, first: FloatArray, last: FloatArray) -> None:
        """Set what the error of the polynomials may have made of values at the ends of pieces of the step to zero.

        Parameters
        ----------
        low, high : (k,)
            The ends, fractions of the step.
        first, last : (k, n)
            Values at them, in the order of time; those of a function are left after the first that is resolved.
        """
        for i in np.flatnonzero(self._sides):
            for k in range(len(low)):
                if not unresolved(float(first[k, i]), float(low[k]), self._doubts[i]):
                    break
                first[k, i] = 0.0
                if not unresolved(float(last[k, i]), float(high[k]), self._doubts[i]):
                    break
                last[k, i] = 0.0
