"""Exponential, logarithm, power, tangents and arctangents in lanes, good to about a unit in the last place.

They are written as operations on numbers, printed for as many lanes as the kernel has that calls them: a case computes
the same bits alone and beside others. Reductions and polynomials of log, atan and atan2 are those of fdlibm (Sun
Microsystems, 1993), of tanh those of Cephes (S. Moshier, Methods and Programs for Mathematical Functions, 1989);
polynomials of exp and pow are near minimax. What is infinite or far out is left to the C library, lane by lane.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, final

from ..ir.kernel import Assignment, Lines, Operand
from .llvm.vector_functions import COSINE, HALF_PI, LARGEST_ANGLE, SINE, TWO_OVER_PI

LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
"""Two parts of log(2), whose first has so few digits that products with whole numbers up to 2^20 are exact."""
_PER_LN2 = 1.44269504088896338700e00
_EXP = (
    0.5,
    0.1666666666666667,
    0.04166666666666667,
    0.008333333333326136,
    0.0013888888888883748,
    0.00019841269874820627,
    2.4801587325547743e-05,
    2.7557255400206422e-06,
    2.75572736431103e-07,
    2.5105217004720745e-08,
    2.0914686968086876e-09,
)
"""(exp(r) - 1 - r) / r^2 for r from -log(2)/2 to log(2)/2, to 2^-60."""
_LOG = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)
_TANH = (-1.61468768441708447952e3, -9.92877231001918586564e1, -9.64399179425052238628e-1)
_TANH_BELOW = (4.84406305325125486048e3, 2.23548839060100448583e3, 1.12811678491632931402e2, 1.0)
_TANH_SMALL, _MOST_TANH = 0.625, 64.0
_MOST_EXP = 708.0
"""Exponent up to whose size powers are normal numbers."""
_ATAN = (
    3.33333333333329318027e-01,
    -1.99999999998764832476e-01,
    1.42857142725034663711e-01,
    -1.11111104054623557880e-01,
    9.09088713343650656196e-02,
    -7.69187620504482999495e-02,
    6.66107313738753120669e-02,
    -5.83357013379057348645e-02,
    4.97687799461593236017e-02,
    -3.65315727442169155270e-02,
    1.62858201153657823623e-02,
)
_ATAN_REDUCTIONS = (
    (0.4375, 0.5, 4.63647609000806093515e-01, 2.26987774529616870924e-17),
    (0.6875, 1.0, 7.85398163397448278999e-01, 3.06161699786838301793e-17),
    (1.1875, 1.5, 9.82793723247329054082e-01, 1.39033110312309984516e-17),
    (2.4375, math.inf, 1.57079632679489655800e00, 6.12323399573676603587e-17),
)
"""From which tangent on which one is taken off, with its arctangent in two parts."""
_PI_LOW = 1.2246467991473531772e-16
_THIRDS = 0.6666666666666666, 3.700743415417188e-17
_POW = (
    0.4,
    0.2857142857142937,
    0.2222222222165554,
    0.18181818335471234,
    0.15384594954138783,
    0.13334805149566298,
    0.11706224136681292,
    0.11723306221321021,
)
"""(log((1 + s) / (1 - s)) - 2 s - 2/3 s^3) / s^5 in powers of s^2."""
_SMALLEST_NORMAL, _TWO_54 = 2.0**-1022, 2.0**54
_FAR, _TINY = 2.0**500, 2.0**-27


class Value(NamedTuple):
    """A value, and where it is good: elsewhere the C library computes it. That is None where it is good everywhere."""

    value: Operand
    usual: Operand | None = None


@final
class Formula:
    """Operations on numbers, one after the other; comparisons give flags.

    Parameters
    ----------
    fused : bool
        Whether products and sums are rounded once.
    """

    def __init__(self, *, fused: bool) -> None:
        lines = Lines()
        self.body, self.fused = lines.body, fused
        self.op, self.add, self.sub = lines.op, lines.add, lines.sub
        self.mul, self.neg, self.fma = lines.mul, lines.neg, lines.fma

    def polynomial(self, coefficients: Sequence[float], x: Operand) -> Operand:
        """Return a polynomial by Estrin's scheme."""
        terms: list[Operand] = list(coefficients)
        while len(terms) > 1:
            terms = [self.fma(high, x, low) for low, high in zip(terms[::2], [*terms[1::2], 0.0], strict=False)]
            x = self.mul(x, x)
        return terms[0]

    def sum(self, a: Operand, b: Operand) -> tuple[Operand, Operand]:
        """Return a + b, and what rounding took off it, where a is larger or 0."""
        total = self.add(a, b)
        return total, self.sub(b, self.sub(total, a))

    def quotient(
        self, top: Operand, below: Operand, below_low: Operand = 0.0, top_low: Operand = 0.0
    ) -> tuple[Operand, Operand]:
        """Return a quotient of numbers in two parts, and what rounding took off it where products are fused."""
        if not self.fused:
            return self.op("div", top, below), 0.0
        inverse = self.op("div", 1.0, below)
        found = self.mul(top, inverse)
        minus = self.neg(found)
        rest = self.add(self.fma(minus, below_low, self.fma(minus, below, top)), top_low)
        return found, self.mul(rest, inverse)


def _exponential(f: Formula, x: Operand, further: Operand = 0.0) -> tuple[Operand, Operand, Operand]:
    """Return (a, b, k) with exp(x + further) = (a + b) 2^k, where the second is a rounding of the first."""
    k = f.op("round", f.mul(x, _PER_LN2))
    minus = f.neg(k)
    high, low = f.fma(minus, LN2_HIGH, x), f.sub(f.mul(k, LN2_LOW), further)
    r = f.sub(high, low)
    rest = f.sub(f.sub(high, r), low)
    r2 = f.mul(r, r)
    return *f.sum(1.0, f.add(r, f.fma(r2, f.polynomial(_EXP, r), rest))), k


def exponential(f: Formula, x: Operand) -> Value:
    """Return exp(x)."""
    value, _, k = _exponential(f, x)
    return Value(f.op("scale", value, k), f.op("less", f.op("abs", x), _MOST_EXP))


def logarithm(f: Formula, x: Operand) -> Value:
    """Return log(x)."""
    tiny = f.op("less", x, _SMALLEST_NORMAL)
    normal = f.op("select", tiny, f.mul(x, _TWO_54), x)
    k = f.sub(f.op("exponent", normal), f.op("select", tiny, 54.0, 0.0))
    m = f.sub(f.op("significand", normal), 1.0)
    s = f.op("div", m, f.add(2.0, m))
    z = f.mul(s, s)
    series = f.mul(z, f.polynomial(_LOG, z))
    half = f.mul(f.mul(0.5, m), m)
    low = f.fma(k, LN2_LOW, f.mul(s, f.add(half, series)))
    value = f.fma(k, LN2_HIGH, f.neg(f.sub(f.sub(half, low), m)))
    value = f.op("select", f.op("less", x, math.inf), value, x)
    value = f.op("select", f.op("less", 0.0, x), value, -math.inf)
    return Value(f.op("select", f.op("less_equal", 0.0, x), value, math.nan))


def hyperbolic_tangent(f: Formula, x: Operand) -> Value:
    """Return tanh(x)."""
    a = f.op("abs", x)
    z, small = f.mul(a, a), f.op("less", a, _TANH_SMALL)
    above = f.mul(f.mul(a, z), f.polynomial(_TANH, z))
    twice = f.mul(2.0, a)
    power, power_low, k = _exponential(f, f.op("select", f.op("less", _MOST_TANH, twice), _MOST_TANH, twice))
    power, power_low = f.op("scale", power, k), f.op("scale", power_low, k)
    more, more_low = f.sum(power, 1.0)
    top, below_low = f.op("select", small, above, -2.0), f.op("select", small, 0.0, f.add(more_low, power_low))
    below = f.op("select", small, f.polynomial(_TANH_BELOW, z), more)
    quotient, rest = f.quotient(top, below, below_low)
    value = f.add(f.op("select", small, a, 1.0), f.add(quotient, rest))
    return Value(f.op("copysign", value, x))


def tangent(f: Formula, x: Operand) -> Value:
    """Return tan(x), by the polynomials of sine and cosine."""
    k = f.op("round", f.mul(x, TWO_OVER_PI))
    minus, half = f.neg(k), f.mul(0.5, k)
    far = f.fma(minus, HALF_PI[0], x)
    near = f.fma(minus, HALF_PI[1], far)
    near_low = f.fma(minus, HALF_PI[1], f.sub(far, near))
    r = f.fma(minus, HALF_PI[2], near)
    r_low = f.add(f.fma(minus, HALF_PI[2], f.sub(near, r)), near_low)
    z = f.mul(r, r)
    sine, sine_low = f.sum(r, f.fma(f.mul(r, z), f.polynomial(SINE, z), r_low))
    whole, rest = f.sum(1.0, f.mul(-0.5, z))
    rest = f.fma(f.mul(z, z), f.polynomial(COSINE, z), rest)
    cosine, cosine_low = f.sum(whole, f.fma(f.neg(r), r_low, rest))
    odd = f.op("less", 0.25, f.op("abs", f.sub(half, f.op("round", half))))
    top, top_low = f.op("select", odd, f.neg(cosine), sine), f.op("select", odd, f.neg(cosine_low), sine_low)
    below, below_low = f.op("select", odd, sine, cosine), f.op("select", odd, sine_low, cosine_low)
    value, rest = f.quotient(top, below, below_low, top_low)
    value = f.op("select", f.op("less", f.op("abs", x), _TINY), x, f.add(value, rest))
    return Value(value, f.op("less", f.op("abs", x), LARGEST_ANGLE))


def _arctangent(f: Formula, a: Operand, b: Operand) -> tuple[Operand, Operand]:
    """Return two numbers whose difference is the arctangent of a / b, neither of which is negative."""
    top, below = a, b
    high: Operand = 0.0
    low: Operand = 0.0
    for bound, tangent, angle, angle_low in _ATAN_REDUCTIONS:
        beyond = f.op("less_equal", f.mul(bound, b), a)
        whole = tangent == math.inf
        other = f.neg(b) if whole else f.fma(-tangent, b, a)
        under = a if whole else f.fma(tangent, a, b)
        top, below = f.op("select", beyond, other, top), f.op("select", beyond, under, below)
        high, low = f.op("select", beyond, angle, high), f.op("select", beyond, angle_low, low)
    t, rest = f.quotient(top, below)
    z = f.mul(t, t)
    series = f.mul(z, f.polynomial(_ATAN, z))
    return high, f.sub(f.sub(f.mul(t, series), f.add(low, rest)), t)


def arctangent(f: Formula, x: Operand) -> Value:
    """Return atan(x)."""
    a = f.op("abs", x)
    huge = f.op("less", _FAR, a)
    high, rest = _arctangent(f, f.op("select", huge, _FAR, a), 1.0)
    return Value(f.op("copysign", f.sub(high, rest), x))


def arctangent_of_two(f: Formula, y: Operand, x: Operand) -> Value:
    """Return atan2(y, x)."""
    a, b = f.op("abs", y), f.op("abs", x)
    high, rest = _arctangent(f, a, b)
    whole, low = f.sum(math.pi, f.neg(high))
    back = f.add(whole, f.add(rest, f.add(low, _PI_LOW)))
    value = f.op("copysign", f.op("select", f.op("less", x, 0.0), back, f.sub(high, rest)), y)
    largest = f.op("select", f.op("less", a, b), b, a)
    usual = f.op("both", f.op("less", 1.0 / _FAR, largest), f.op("less", largest, _FAR))
    return Value(value, f.op("both", usual, f.op("less", b, _FAR)))


def power(f: Formula, x: Operand, y: Operand) -> Value:
    """Return x**y, by a logarithm with 11 more digits than a number has."""
    k, m = f.op("exponent", x), f.op("significand", x)
    top, below = f.sub(m, 1.0), f.add(m, 1.0)
    lost = f.sub(m, f.sub(below, 1.0))
    s, s_low = f.quotient(top, below, lost)
    z = f.mul(s, s)
    z_low = f.fma(s, s, f.neg(z))
    z_low = f.fma(f.mul(2.0, s), s_low, z_low)
    cube = f.mul(z, s)
    cube_low = f.fma(z, s_low, f.fma(z_low, s, f.fma(z, s, f.neg(cube))))
    third = f.mul(cube, _THIRDS[0])
    third_low = f.fma(cube_low, _THIRDS[0], f.fma(cube, _THIRDS[1], f.fma(cube, _THIRDS[0], f.neg(third))))
    rest = f.fma(f.mul(cube, z), f.polynomial(_POW, z), f.fma(2.0, s_low, third_low))
    first = f.mul(2.0, s)
    near, near_low = f.sum(first, third)
    near, near_low = f.sum(near, f.add(near_low, rest))
    log, log_low = f.sum(f.mul(k, LN2_HIGH), near)
    log, log_low = f.sum(log, f.add(log_low, f.fma(k, LN2_LOW, near_low)))
    found = f.mul(y, log)
    found_low = f.fma(y, log_low, f.fma(y, log, f.neg(found)))
    usual = f.op("both", f.op("less_equal", _SMALLEST_NORMAL, x), f.op("less", x, math.inf))
    usual = f.op("both", usual, f.op("less", f.op("abs", found), _MOST_EXP))
    safe = f.op("select", usual, found, 0.0)
    value, _, k = _exponential(f, safe, found_low)
    return Value(f.op("scale", value, k), usual)


ELEMENTARY: dict[str, Callable[..., Value]] = {
    "tan": tangent,
    "exp": exponential,
    "log": logarithm,
    "tanh": hyperbolic_tangent,
    "atan": arctangent,
    "atan2": arctangent_of_two,
    "pow": power,
}
"""Functions of as many operands as the C library's of the same name."""


def formula_of(name: str, arguments: Sequence[str], *, fused: bool) -> tuple[list[Assignment], Value]:
    """Return the operations of a function and its value; see `Formula` for `fused`."""
    formula = Formula(fused=fused)
    made = ELEMENTARY[name](formula, *arguments)
    needed, lines = {*made}, []
    for line in reversed(formula.body):
        if line.target in needed:
            needed |= {*line.args}
            lines.append(line)
    return lines[::-1], made
