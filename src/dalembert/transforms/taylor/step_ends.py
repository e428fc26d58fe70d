"""Ends of Taylor steps at knots of tables and zeros of square roots: [series of the argument] -> [size of the step].

Within a piece a table is a polynomial, and so is the series of a step that begins there; beyond the knot it is another.
A step therefore ends where the series of the argument leaves the piece that it began in. It is found by steps of
Newton's kind that never pass it: from a point where the argument is within, its slope there and a bound of its second
derivative over the whole step say how far it certainly stays within. Near a knot they converge quadratically. What
they have not reached is left to the next step. A little more is always taken, the share `_LEAST` of the step or a few
times the spacing of times: so steps make progress, and the argument is past the knot when the next one begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ...frozen import frozen
from ...ir.kernel import Lines, Operand
from ...ir.tables import LOWER, UPPER, table_of
from ...methods.step_constants import EPSILON, SMALLEST_OF_TIME
from .expansion import Series, coefficient

CLOCK = "clock_"
"""The time at the beginning of a step."""

_ROUNDS = 5
_LEAST = 1e-13
_SPACING = 4.0 * SMALLEST_OF_TIME
_MARGIN = 8.0 * EPSILON
"""Share of the largest knot by which an argument may leave a piece: one that rests at a knot has to move first."""
_TINY = 1e-300


def within_piece(lines: Lines, series: Series, key: float, order: int, size: Operand, direction: Operand) -> Operand:
    """Return the largest step before the argument of a table leaves its piece.

    Parameters
    ----------
    series : Series
        Of the argument, in powers of time.
    key : float
        Of the table.
    size, direction : Operand
        Of the step that is proposed, and that of time.
    """
    place = lines.op("piece", series[0], key)
    terms = in_shares_of_step(lines, series, order, lines.mul(size, direction))
    table = table_of(key)
    margin = _MARGIN * max(abs(table.first), abs(table.last), table.spacing)
    gaps = (
        lines.add(lines.op("sub", lines.op("entry", place, key, float(UPPER)), series[0]), margin),
        lines.add(lines.op("sub", series[0], lines.op("entry", place, key, float(LOWER))), margin),
    )
    up, down = (Side.of(lines, terms, turned) for turned in (False, True))
    share: Operand = 0.0
    for number in range(_ROUNDS):
        moved, slope = (0.0, terms[1]) if number == 0 else value_and_slope(lines, terms, share)
        above = up.certain(lines, lines.sub(gaps[0], moved), slope)
        below = down.certain(lines, lines.add(gaps[1], moved), lines.neg(slope))
        share = lines.op("min", lines.add(share, lines.op("min", above, below)), 1.0)
    least = shortest(lines, size)
    stays = lines.mul(lines.op("less", up.rise, gaps[0]), lines.op("less_equal", down.rise, gaps[1]))
    return lines.op("select", stays, size, lines.op("min", lines.fma(size, share, least), size))


def in_shares_of_step(lines: Lines, series: Series, order: int, h: Operand) -> Series:
    """Return the terms of a series whose variable is the share of a step h, with its sign."""
    power: Operand = 1.0
    terms: Series = []
    for k in range(order):
        terms.append(lines.mul(coefficient(series, k), power))
        power = lines.mul(power, h)
    return terms


def shortest(lines: Lines, size: Operand) -> Operand:
    """Return the least size of a step, so that it makes progress."""
    return lines.op("max", lines.mul(size, _LEAST), lines.mul(lines.op("abs", CLOCK), _SPACING))


def time_to_change(
    lines: Lines, rates: Sequence[Series], scale: Operand, share: float, passed: Operand, size: Operand
) -> Operand:
    """Return a time, at most `size`, in which rates change the state by no more than a share of the scale of errors.

    It begins when the time `passed` of the step is over. The rates at the beginning of the step do not suffice: where
    a motion begins at rest in equilibrium, all of them are zero.
    """
    largest: Series = []
    for k in range(max(map(len, rates))):
        term: Operand = _TINY if k == 0 else 0.0
        for rate in rates:
            if coefficient(rate, k) != 0.0:
                term = lines.op("max", term, lines.op("abs", rate[k]))
        largest.append(term)
    change = lines.mul(scale, share)
    most = lines.op("min", lines.op("div", change, largest[0]), size)
    until = lines.add(passed, most)
    fastest = largest[-1]
    for term in largest[-2::-1]:
        fastest = lines.fma(fastest, until, term)
    return lines.op("min", lines.op("div", change, fastest), most)


def value_and_slope(lines: Lines, terms: Series, share: Operand) -> tuple[Operand, Operand]:
    """Return how far the argument has moved after a share of the step, and its slope there, by Horner's scheme."""
    value: Operand = terms[-1]
    slope: Operand = 0.0
    for term in terms[-2:0:-1]:
        slope = lines.fma(slope, share, value)
        value = lines.fma(value, share, term)
    return lines.mul(value, share), lines.fma(slope, share, value)


@final
@frozen
class Side:
    """Bounds over the whole step of the motion towards one end of a piece.

    Attributes
    ----------
    rise, bend : Operand
        How far the argument moves at most, and its largest second derivative, in shares of the step.
    most : Operand
        A distance that it does not move in a step, whatever its slope at a point of the step.
    """

    rise: Operand
    bend: Operand
    most: Operand

    @classmethod
    def of(cls, lines: Lines, terms: Series, turned: bool) -> Side:
        """Return the bounds towards the upper end, or the lower where `turned`."""
        forward = [lines.neg(term) if turned else term for term in terms]
        rise = _at_most(lines, forward[1:])
        bend = _at_most(lines, [lines.mul(term, float(k * (k - 1))) for k, term in enumerate(forward[2:], 2)])
        most = lines.op("fma", lines.op("add", lines.op("abs", terms[1]), bend), 4.0, _TINY)
        return cls(rise, bend, most)

    def certain(self, lines: Lines, gap: Operand, slope: Operand) -> Operand:
        """Return the time for which the end is certainly not reached: the root d of slope d + bend d^2/2 = gap."""
        gap = lines.op("max", lines.op("min", gap, self.most), 0.0)
        twice = lines.mul(gap, 2.0)
        root = lines.op("sqrt", lines.fma(slope, slope, lines.mul(self.bend, twice)))
        leaves = lines.op("less", slope, 0.0)
        above = lines.op("select", leaves, lines.sub(root, slope), twice)
        below = lines.op("select", leaves, self.bend, lines.add(slope, root))
        return lines.op("div", above, lines.op("add", below, _TINY))


def _at_most(lines: Lines, terms: Series) -> Operand:
    """Return a bound of a polynomial with these coefficients, from the lowest order up, between 0 and 1.

    A negative term takes from all later positive ones, which are nowhere larger than their share at 1 times its power.
    """
    most: Operand = 0.0
    spare: Operand = 0.0
    for term in terms:
        if term == 0.0:
            continue
        left = lines.add(term, spare)
        most = lines.add(most, lines.op("max", left, 0.0))
        spare = lines.op("min", left, 0.0)
    return most


# Ends of Taylor steps at zeros of square roots: [series of a root] -> [size of the step].
#
# A length sqrt(x^2 + y^2) that passes through zero has a kink there. Its power series has none: it continues to
# negative values, as that of sqrt(x^2) is the series of x. A force along the line between two points then keeps its
# direction where it ought to turn round, and nothing in the coefficients shows it. The same holds for lengths that
# come so close to zero that their kink is below the tolerance.
#
# The series of each root is therefore evaluated at the middle and at the end of the step. Where it is negative at one
# of them, or where the parabola through the three values dips below zero, the step is cut to the share `_SHARE` of the
# time for which the root is certainly positive, by its slope and a bound of its second derivative. So steps approach
# the zero. The last one goes past it by a time in which the wrong force changes the state by the share `_PASSING` of
# the tolerance. None ends nearer to it than that.

_SHARE = 0.8
"""Share of the time to a zero that a step takes: what remains of a series that ends there decays by this factor."""

_PASSING, _NEAREST = 0.01, 1e-13
"""Change of the state while a zero is passed, in tolerances, and the least of it: coefficients of forces that go with
the inverse of a length grow by that from order to order, and must not overflow."""

_HALF_TERMS = 7
"""Terms of a series at half of a step, of which each is halved once more often than at the end."""
_ROOT_MARGIN, _WITHIN = 0.06, 2.2
"""Second differences of three values that a cubic dips below the parabola through them; twice how far from the middle
one, in distances of two of them, its lowest point may be."""


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
        Of the square roots, and of all components of the state, in powers of time.
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
    size = lines.op("min", size, lines.op("max", _resolved(lines, roots, order, size, tolerance), least))
    return lines.op("min", lines.fma(certain, share, least), size)


def _resolved(lines: Lines, roots: Sequence[Series], order: int, size: Operand, tolerance: float) -> Operand:
    """Return the step, at most `size`, up to which rounding errors of the series of roots stay below the tolerance.

    Terms of sqrt(x^2) cancel but for the first two. What rounding leaves of the others grows from order to order by the
    root's own rate, and the last ones may be zero all the same.
    """
    most, growth = size, max((tolerance / EPSILON) ** (1.0 / order), 1.0)
    for series in roots:
        rate = lines.op("max", lines.op("abs", coefficient(series, 1)), _TINY)
        most = lines.op("min", lines.op("div", lines.mul(series[0], growth), rate), most)
    return most


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
    lowest = lines.fma(second, -_ROOT_MARGIN, middle)
    within = lines.op("less", lines.op("abs", turn), lines.mul(second, _WITHIN))
    return lines.mul(within, lines.op("less", lines.mul(lines.mul(second, 8.0), lowest), lines.mul(turn, turn)))
