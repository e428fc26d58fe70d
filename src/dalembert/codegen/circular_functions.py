"""Tangent, arcsine, arccosine and arctangents in lanes; see `dalembert.codegen.elementary`.

Reductions and polynomials are those of fdlibm (Sun Microsystems, 1993).
"""

from __future__ import annotations

import math

from ..ir.kernel import Operand
from .formula import Formula, Value
from .llvm.vector_functions import COSINE, HALF_PI, LARGEST_ANGLE, SINE, TWO_OVER_PI

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
_ASIN = (
    1.66666666666666657415e-01,
    -3.25565818622400915405e-01,
    2.01212532134862925881e-01,
    -4.00555345006794114027e-02,
    7.91534994289814532176e-04,
    3.47933107596021167570e-05,
)
_ASIN_BELOW = (
    1.0,
    -2.40339491173441421878e00,
    2.02094576023350569471e00,
    -6.88283971605453293030e-01,
    7.70381505559019352791e-02,
)
"""Their quotient is (asin(x) - x) / x^3 in powers of x^2, up to x = 1/2."""
_FAR, _TINY = 2.0**500, 2.0**-27


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


def _arcsine(f: Formula, a: Operand) -> tuple[Operand, Operand, Operand, Operand]:
    """Return (small, r, s, c) for an a that is not negative.

    Its arcsine is a + a r where a is `small`, below 1/2, and that of the root of (1 - a) / 2 is (s + s r + c) / 2 where
    it is not.
    """
    small, half = f.op("less", a, 0.5), f.mul(0.5, f.sub(1.0, a))
    root = f.op("sqrt", half)
    lost: Operand = f.fma(f.neg(root), root, half) if f.fused else 0.0
    twice_lost = f.op("div", lost, f.op("select", f.op("less", 0.0, root), root, 1.0))
    z = f.op("select", small, f.mul(a, a), half)
    r = f.op("div", f.mul(z, f.polynomial(_ASIN, z)), f.polynomial(_ASIN_BELOW, z))
    return small, r, f.mul(2.0, root), twice_lost


def _taken_off(f: Formula, angle: Operand, low: Operand, s: Operand, c: Operand, r: Operand) -> Operand:
    """Return angle + low - (s + s r + c), where the angle is larger than s or 0."""
    total, rest = f.sum(angle, f.neg(s))
    return f.add(total, f.sub(rest, f.sub(f.fma(s, r, c), low)))


def arcsine(f: Formula, x: Operand) -> Value:
    """Return asin(x)."""
    a = f.op("abs", x)
    small, r, s, c = _arcsine(f, a)
    angle, low = f.op("select", small, 0.0, 0.5 * math.pi), f.op("select", small, 0.0, 0.5 * _PI_LOW)
    value = _taken_off(f, angle, low, f.op("select", small, f.neg(a), s), f.op("select", small, 0.0, c), r)
    return Value(f.op("copysign", value, x))


def arccosine(f: Formula, x: Operand) -> Value:
    """Return acos(x)."""
    small, r, s, c = _arcsine(f, f.op("abs", x))
    back = f.op("less", x, 0.0)
    angle, low = f.op("select", back, math.pi, 0.0), f.op("select", back, _PI_LOW, 0.0)
    angle, low = f.op("select", small, 0.5 * math.pi, angle), f.op("select", small, 0.5 * _PI_LOW, low)
    s, c = f.op("select", back, s, f.neg(s)), f.op("select", back, c, f.neg(c))
    s, c = f.op("select", small, x, s), f.op("select", small, 0.0, c)
    return Value(_taken_off(f, angle, low, s, c, r))
