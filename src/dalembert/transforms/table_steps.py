"""Ends of Taylor steps at knots of tables: [series of the argument] -> [size of the step].

Within a piece a table is a polynomial, and so is the series of a step that begins there; beyond the knot it is another.
A step therefore ends where the series of the argument leaves the piece that it began in. It is found by steps of
Newton's kind that never pass it: from a point where the argument is within, its slope there and a bound of its second
derivative over the whole step say how far it certainly stays within. Near a knot they converge quadratically. What
they have not reached is left to the next step. A little more is always taken, the share `_LEAST` of the step or a few
times the spacing of times: so steps make progress, and the argument is past the knot when the next one begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from ..ir.kernel import Operand
from ..ir.lines import Lines
from ..ir.tables import LOWER, UPPER, table_of
from ..methods.step_constants import EPSILON, SMALLEST_OF_TIME
from .expansion import Series, coefficient

__all__ = [
    "CLOCK",
    "Side",
    "in_shares_of_step",
    "shortest",
    "time_to_change",
    "value_and_slope",
    "within_piece",
]

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
@dataclass(frozen=True)
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
        rise: Operand = 0.0
        bend: Operand = 0.0
        for k, term in enumerate(terms[1:], 1):
            if term == 0.0:
                continue
            forward = lines.op("max", lines.neg(term) if turned else term, 0.0)
            rise = lines.add(rise, forward)
            bend = lines.fma(forward, float(k * (k - 1)), bend)
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
