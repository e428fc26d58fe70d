"""Expressions that are zero where a motion begins: whether they leave zero to one side, as far as a step can tell.

Near its beginning such an expression is slope x + bend x^2 + r(x) x^3, with x the fraction of the step. Its slope is
known from the kernel of its rates, r from values along the polynomials of the step. These may be off by E x^2, and so
may its bend; rates along the polynomials give it without that error, and the difference of both is E. Eight values of
an expression that oscillates within the step do not give its bend: E is bounded by what values near the start show.
"""

from __future__ import annotations

import math

from ..methods.step_constants import BENT, DOUBT, FLAT, LIKELY, RESOLVED, SHORT_SHARE
from ..subset.compiled_subset import compiled_subset, sqrt, square


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
