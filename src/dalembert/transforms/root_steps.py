"""Ends of Taylor steps at zeros of square roots: [series of a root] -> [size of the step].

A length sqrt(x^2 + y^2) that passes through zero has a kink there. Its power series has none: it continues to
negative values, as that of sqrt(x^2) is the series of x. A force along the line between two points then keeps its
direction where it ought to turn round, and nothing in the coefficients shows it. The same holds for lengths that come
so close to zero that their kink is below the tolerance.

The series of each root is therefore evaluated at the middle and at the end of the step. Where it is negative at one of
them, or where the parabola through the three values dips below zero, the step is cut to the share `_SHARE` of the time
for which the root is certainly positive, by its slope and a bound of its second derivative. So steps approach the zero.
The last one goes past it by a time in which the wrong force changes the state by the share `_PASSING` of the tolerance.
None ends nearer to it than that.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.kernel import Operand
from ..ir.lines import Lines
from ..methods.step_constants import SMALLEST_OF_TIME
from .expansion import Series, coefficient
from .table_steps import CLOCK, time_to_change

__all__ = ["before_zeros"]

_SHARE = 0.8
"""Share of the time to a zero that a step takes: what remains of a series that ends there decays by this factor."""

_PASSING, _NEAREST = 0.01, 1e-13
"""Change of the state while a zero is passed, in tolerances, and the least of it: coefficients of forces that go with
the inverse of a length grow by that from order to order, and must not overflow."""

_SPACING = 4.0 * SMALLEST_OF_TIME
_HALF_TERMS = 7
"""Terms of a series at half of a step, of which each is halved once more often than at the end."""
_MARGIN, _WITHIN = 0.06, 2.2
"""Second differences of three values that a cubic dips below the parabola through them; twice how far from the middle
one, in distances of two of them, its lowest point may be."""
_TINY = 1e-300


def before_zeros(
    lines: Lines,
    roots: Sequence[Series],
    rates: Sequence[Series],
    order: int,
    size: Operand,
    direction: Operand,
    scale: Operand,
    tolerance: float,
) -> Operand:
    """Return the largest step before a square root vanishes, or past the zero where one is about to vanish.

    Parameters
    ----------
    roots, rates : sequence of Series
        Of the square roots that may vanish, and of all components of the state, in powers of time.
    size, direction : Operand
        Of the step that is proposed, and that of time.
    scale, tolerance
        Scale of errors, and the tolerance of the step as a share of it.
    """
    if not roots:
        return size
    h = lines.mul(size, direction)
    above, below = _certain(lines, roots[0], order, h)
    for series in roots[1:]:
        other = _certain(lines, series, order, h)
        sooner = lines.op("less", lines.mul(other[0], below), lines.mul(above, other[1]))
        above, below = (lines.op("select", sooner, a, b) for a, b in zip(other, (above, below), strict=True))
    certain = lines.mul(size, lines.op("div", lines.mul(above, 0.5), lines.add(below, _TINY)))
    least = lines.op(
        "max",
        time_to_change(lines, rates, scale, max(_PASSING * tolerance, _NEAREST), certain, size),
        lines.mul(lines.op("abs", CLOCK), _SPACING),
    )
    last = lines.op("less", lines.mul(certain, 0.5 * (1.0 - _SHARE)), least)
    share = lines.op("select", last, 1.0, _SHARE)
    return lines.op("min", lines.fma(certain, share, least), size)


def _certain(lines: Lines, series: Series, order: int, h: Operand) -> tuple[Operand, Operand]:
    """Return for which share of half of a step a root is certainly positive, as numerator and denominator.

    The share is 1 at most; where the root is positive all over the step, the denominator is zero.
    """
    first = series[0]
    middle, falls, bends = _first_half(lines, series, lines.mul(h, 0.5))
    end = coefficient(series, order - 1)
    for k in range(order - 2, -1, -1):
        end = lines.fma(end, h, coefficient(series, k))
    positive = lines.mul(lines.op("less", 0.0, middle), lines.op("less", 0.0, end))
    positive = lines.mul(positive, lines.sub(1.0, _dips(lines, first, middle, end)))
    # first - falls x - bends x^2 is positive up to first / (falls + bends y) for any y that this is below
    near = lines.op("less", first, falls)
    above = lines.op("select", near, lines.mul(first, falls), first)
    product, total = lines.fma(bends, first, lines.mul(falls, falls)), lines.add(falls, bends)
    below = lines.op("select", near, product, lines.op("max", total, first))
    return lines.op("select", positive, 1.0, above), lines.op("select", positive, 0.0, below)


def _first_half(lines: Lines, series: Series, half: Operand) -> tuple[Operand, Operand, Operand]:
    """Return a series at half of a step, and what its term of order 1 and its later terms take away until then."""
    power: Operand = half
    term = lines.mul(coefficient(series, 1), half)
    value = lines.add(series[0], term)
    falls = lines.op("max", lines.neg(term), 0.0)
    bends: Operand = 0.0
    for k in range(2, min(_HALF_TERMS, len(series))):
        power = lines.mul(power, half)
        term = lines.mul(coefficient(series, k), power)
        value = lines.add(value, term)
        bends = lines.sub(bends, lines.op("min", term, 0.0))
    return value, falls, bends


def _dips(lines: Lines, first: Operand, middle: Operand, end: Operand) -> Operand:
    """Return whether the parabola through three values at equal distances is negative between them, or nearly so."""
    second = lines.add(lines.fma(middle, -2.0, end), first)
    turn = lines.sub(end, first)
    lowest = lines.fma(second, -_MARGIN, middle)
    within = lines.op("less", lines.op("abs", turn), lines.mul(second, _WITHIN))
    return lines.mul(within, lines.op("less", lines.mul(lines.mul(second, 8.0), lowest), lines.mul(turn, turn)))
