"""Exponential, logarithm, power, circular and hyperbolic functions in lanes, good to about a unit in the last place.

They are written as operations on numbers, printed for as many lanes as the kernel has that calls them: a case computes
the same bits alone and beside others. Reduction and polynomial of log are those of fdlibm (Sun Microsystems, 1993), of
tanh those of Cephes (S. Moshier, Methods and Programs for Mathematical Functions, 1989); that of sinh is Taylor's,
those of exp and pow are near minimax. What is infinite or far out is left to the C library, lane by lane. Circular
functions are in `circular_functions`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ..ir.kernel import Assignment, Operand
from .circular_functions import arccosine, arcsine, arctangent, arctangent_of_two, tangent
from .formula import Formula, Value

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
_SINH = tuple(1.0 / math.factorial(n) for n in range(3, 18, 2))
"""(sinh(x) - x) / x^3 in powers of x^2, to 2^-57 of sinh(1)."""
_MOST_EXP = 708.0
"""Exponent up to whose size powers are normal numbers."""
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


def _halves(f: Formula, a: Operand) -> tuple[Operand, Operand, Operand, Operand]:
    """Return exp(a) / 2 and exp(-a) / 2, each in two parts, for an a that is not negative."""
    power, power_low, k = _exponential(f, a)
    inverse, inverse_low = f.quotient(1.0, power, power_low)
    up, down = f.sub(k, 1.0), f.sub(-1.0, k)
    high, low = f.op("scale", power, up), f.op("scale", power_low, up)
    return high, low, f.op("scale", inverse, down), f.op("scale", inverse_low, down)


def hyperbolic_sine(f: Formula, x: Operand) -> Value:
    """Return sinh(x)."""
    a = f.op("abs", x)
    z = f.mul(a, a)
    near = f.fma(f.mul(a, z), f.polynomial(_SINH, z), a)
    high, low, other, other_low = _halves(f, a)
    total, rest = f.sum(high, f.neg(other))
    far = f.add(total, f.add(rest, f.sub(low, other_low)))
    value = f.op("copysign", f.op("select", f.op("less", a, 1.0), near, far), x)
    return Value(value, f.op("less", a, _MOST_EXP))


def hyperbolic_cosine(f: Formula, x: Operand) -> Value:
    """Return cosh(x)."""
    a = f.op("abs", x)
    high, low, other, other_low = _halves(f, a)
    total, rest = f.sum(high, other)
    return Value(f.add(total, f.add(rest, f.add(low, other_low))), f.op("less", a, _MOST_EXP))


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
    "sinh": hyperbolic_sine,
    "cosh": hyperbolic_cosine,
    "tanh": hyperbolic_tangent,
    "asin": arcsine,
    "acos": arccosine,
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
