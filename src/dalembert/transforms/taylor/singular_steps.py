"""Taylor steps beside singular configurations: [series of the pivots] -> [size of the step].

Where constraints lose rank, a pivot p of J M^-1 J^T vanishes like the square of the time d that is left. The motion is
smooth there, but what is computed at a distance d has an error: rounding moves positions by 1/d of itself, velocities
by 1/d^2. A step passes over such a place without harm, because its series is of the state where it begins. So no step
ends much nearer to one than it begins.

Coefficients of high orders have an error that grows like 1/d^k, and steps that they limit would end before the place,
each nearer to it. That error is in directions that the constraints determine, and the projection at the end of the
step removes it. So a step that coefficients of lower orders allow passes over the place.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...ir.kernel import Lines, Operand
from .expansion import Series, coefficient

_NEARER = 1.0 / 64.0
"""Share of a pivot below which a step must not end: the eighth part of the distance."""

_SHORTER = 0.5
"""Factor to the size of a step that would."""

_BEYOND = 1.2
"""Size of a step that passes over a singular configuration, as a multiple of the time to it."""

_ADMITTED = 1e6
"""Factor by which the last terms of such a step may exceed their bound."""

_CLEAN = 0.5
"""Share of the step that coefficients in the middle allow up to which it passes: what turns the motion beside a place
where rank is nearly lost, and not rounding, shows in them."""

_VANISHES, _TERMS = 1e-3, 10
"""Share of a pivot below which its least value counts as none, and terms of its series that find where it is."""

_NEVER, _TINY = 1e100, 1e-300


def passing(
    lines: Lines, pivots: Sequence[Series], order: int, size: Operand, clean: Operand, direction: Operand
) -> Operand:
    """Return the size of a step that passes over a singular configuration, if there is one soon.

    `size` is what the last coefficients of the state allow, `clean` what those in the middle do.
    """
    if not pivots:
        return size
    way: Operand = _NEVER
    for series in pivots:
        terms = [coefficient(series, k) for k in range(min(order, _TERMS))]
        falls = lines.neg(lines.mul(terms[1], direction))
        time = lines.op("div", falls, lines.op("max", lines.mul(2.0, terms[2]), _TINY))
        _, slope, bend = _at(lines, terms, lines.mul(time, direction))
        time = lines.sub(time, lines.op("div", lines.mul(slope, direction), lines.op("max", bend, _TINY)))
        least, _, _ = _at(lines, terms, lines.mul(time, direction))
        meets = lines.mul(lines.op("less", 0.0, falls), lines.op("less", least, lines.mul(_VANISHES, terms[0])))
        meets = lines.mul(meets, lines.op("less", 0.0, time))
        way = lines.op("min", way, lines.op("select", meets, time, _NEVER))
    leap = lines.mul(way, _BEYOND)
    most = lines.op("min", lines.mul(size, _ADMITTED ** (1.0 / order)), lines.mul(clean, _CLEAN))
    return lines.op("select", lines.op("less", leap, most), lines.op("max", size, leap), size)


def beside(lines: Lines, pivots: Sequence[Series], order: int, size: Operand, direction: Operand) -> Operand:
    """Return the size of a step that does not end where a pivot nearly vanishes."""
    if not pivots:
        return size
    h = lines.op("mul", size, direction)
    near: Operand = 0.0
    for series in pivots:
        end = coefficient(series, order - 1)
        for k in range(order - 2, -1, -1):
            end = lines.fma(end, h, coefficient(series, k))
        near = lines.op("max", near, lines.op("less", end, lines.mul(_NEARER, series[0])))
    return lines.op("select", near, lines.mul(_SHORTER, size), size)


def _at(lines: Lines, terms: Series, x: Operand) -> tuple[Operand, Operand, Operand]:
    """Return a polynomial at x, its slope and its second derivative, by Horner's scheme."""
    value: Operand = terms[-1]
    slope: Operand = 0.0
    half: Operand = 0.0
    for term in terms[-2::-1]:
        half = lines.fma(half, x, slope)
        slope = lines.fma(slope, x, value)
        value = lines.fma(value, x, term)
    return value, slope, lines.mul(2.0, half)
