"""Bounds of values and of their rates over intervals of time, by interval arithmetic on arrays.

All operations of the graph are supported. Values that do not depend on time are arrays of numbers, computed as by
`dalembert.ir.interpret`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from .bounds import Bounds, arc_slope, cosine, even, hull, one_plus, plus, reciprocal, root, sine, square, times, wider
from .calls import CALLS
from .interpret import ARRAY_OPERATIONS
from .tables import array_piece, numbers_of


@final
@frozen(eq=False)
class Interval:
    """Bounds (k,) of a value and of its rate over k intervals of time."""

    low: FloatArray
    high: FloatArray
    rate_low: FloatArray
    rate_high: FloatArray


def interval_of(value: Any) -> Interval:
    """Return the bounds of a value that may be one that does not depend on time."""
    if isinstance(value, Interval):
        return value
    number = value if hasattr(value, "__array_function__") else np.asarray(value, dtype=float)
    zero = np.zeros_like(number)
    return Interval(number, number, zero, zero)


def _value(x: Interval) -> Bounds:
    return x.low, x.high


def _rate(x: Interval) -> Bounds:
    return x.rate_low, x.rate_high


def _made(value: Bounds, rate: Bounds) -> Interval:
    return Interval(value[0], value[1], rate[0], rate[1])


def _add(a: Interval, b: Interval) -> Interval:
    return _made(plus(_value(a), _value(b)), plus(_rate(a), _rate(b)))


def _neg(a: Interval) -> Interval:
    return Interval(-a.high, -a.low, -a.rate_high, -a.rate_low)


def _mul(a: Interval, b: Interval) -> Interval:
    rate = plus(times(_rate(a), _value(b)), times(_value(a), _rate(b)))
    value = times(_value(a), _value(b))
    if a is b:
        value = np.where((a.low <= 0.0) & (a.high >= 0.0), 0.0, value[0]), value[1]
    return _made(value, rate)


def _div(a: Interval, b: Interval) -> Interval:
    over = reciprocal(_value(b))
    value = times(_value(a), over)
    rate = times(plus(_rate(a), _rate(_neg(_made(value, times(value, _rate(b)))))), over)
    return _made(value, rate)


def _monotone(function: Callable[[Any], Any], slope: Callable[[Bounds], Bounds]) -> Callable[[Interval], Interval]:
    """Return an increasing function of intervals, each cut to its domain."""

    def call(a: Interval) -> Interval:
        low, high = function(a.low), function(a.high)
        low = np.where(np.isnan(low) & ~np.isnan(high), -np.inf, low)
        steep = slope(_value(a))
        steep = np.where(np.isnan(steep[0]), -np.inf, steep[0]), np.where(np.isnan(steep[1]), np.inf, steep[1])
        return _made(wider(low, high), times(steep, _rate(a)))

    return call


def _sin(a: Interval) -> Interval:
    return _made(sine(_value(a)), times(cosine(_value(a)), _rate(a)))


def _cos(a: Interval) -> Interval:
    slope = sine(_value(a))
    return _made(cosine(_value(a)), times((-slope[1], -slope[0]), _rate(a)))


def _tan(a: Interval) -> Interval:
    return _div(_sin(a), _cos(a))


def _acos(a: Interval) -> Interval:
    half = np.full_like(a.low, 0.5 * np.pi)
    return _add(interval_of(half), _neg(_asin(a)))


def _abs(a: Interval) -> Interval:
    sign = np.where(a.low >= 0.0, 1.0, -1.0), np.where(a.high <= 0.0, -1.0, 1.0)
    return _made(even(np.abs)(_value(a)), times(sign, _rate(a)))


def _stepped(function: Callable[[Any], Any]) -> Callable[[Interval], Interval]:
    """Return a function with jumps that does not fall; its rate is known where it does not jump."""

    def call(a: Interval) -> Interval:
        low, high = function(a.low), function(a.high)
        rest = np.where(low == high, 0.0, np.inf)
        return Interval(low, high, -rest, rest)

    return call


def _pow(a: Interval, b: Interval) -> Interval:
    """Return a power with a positive base, or with a whole number for its exponent."""
    whole = (b.low == b.high) & (np.floor(b.low) == b.low) & (np.abs(b.low) < 1e6)
    positive = _exp(_mul(b, _log(a)))
    n = np.where(whole, b.low, 1.0)
    size = np.abs(a.low) ** np.abs(n), np.abs(a.high) ** np.abs(n)
    odd = np.mod(n, 2.0) == 1.0
    low = np.where(odd, np.sign(a.low) * size[0], np.minimum(*size))
    low = np.where(~odd & (a.low <= 0.0) & (a.high >= 0.0), 0.0, low)
    high = np.where(odd, np.sign(a.high) * size[1], np.maximum(*size))
    value = wider(low, high)
    under = reciprocal(value)
    value = np.where(n < 0.0, under[0], value[0]), np.where(n < 0.0, under[1], value[1])
    rate = times(times((n, n), times(value, reciprocal(_value(a)))), _rate(a))
    chosen = whole & ~(a.low > 0.0)
    parts = zip((*value, *rate), (*_value(positive), *_rate(positive)), strict=True)
    return Interval(*(np.where(chosen, own, other) for own, other in parts))


def _atan2(y: Interval, x: Interval) -> Interval:
    """Return the angle of (x, y); its whole range where the half line of its jump may be met."""
    right = x.low > 0.0
    ratio = _atan(_div(y, x))
    above, below = y.low > 0.0, y.high < 0.0
    flat = _atan(_div(x, y))
    half = np.where(above, 0.5 * np.pi, -0.5 * np.pi)
    turned = _add(interval_of(half), _neg(flat))
    known, side = right | above | below, above | below
    low = np.where(side, turned.low, np.where(right, ratio.low, -np.pi))
    high = np.where(side, turned.high, np.where(right, ratio.high, np.pi))
    rate_low = np.where(side, turned.rate_low, np.where(right, ratio.rate_low, -np.inf))
    rate_high = np.where(side, turned.rate_high, np.where(right, ratio.rate_high, np.inf))
    return _made(wider(low, high), (np.where(known, rate_low, -np.inf), np.where(known, rate_high, np.inf)))


def _extreme(
    function: Callable[[Any, Any], Any], first: Callable[[Interval, Interval], Any]
) -> Callable[..., Interval]:
    def call(a: Interval, b: Interval) -> Interval:
        rate = hull(_rate(a), _rate(b))
        only_a, only_b = first(a, b), first(b, a)
        rate = tuple(
            np.where(only_a, own, np.where(only_b, other, both))
            for own, other, both in zip(_rate(a), _rate(b), rate, strict=True)
        )
        return _made((function(a.low, b.low), function(a.high, b.high)), (rate[0], rate[1]))

    return call


def _less(a: Interval, b: Interval) -> Interval:
    low, high = np.where(a.high < b.low, 1.0, 0.0), np.where(a.low < b.high, 1.0, 0.0)
    rest = np.where(low == high, 0.0, np.inf)
    return Interval(low, high, -rest, rest)


def _select(c: Interval, a: Interval, b: Interval) -> Interval:
    first, second = (c.low > 0.0) | (c.high < 0.0), (c.low == 0.0) & (c.high == 0.0)
    whole = (*hull(_value(a), _value(b)), *hull(_rate(a), _rate(b)))
    parts = zip((*_value(a), *_rate(a)), (*_value(b), *_rate(b)), whole, strict=True)
    return Interval(*(np.where(first, x, np.where(second, y, z)) for x, y, z in parts))


def _number(a: Interval) -> float:
    """Return an operand that is a number."""
    return float(np.ravel(a.low)[0])


def _entry(place: Interval, key: Interval, row: Interval) -> Interval:
    """Return the bounds of a number of all pieces from the lowest to the highest."""
    numbers = numbers_of(_number(key)).row(int(_number(row)))
    ends = np.atleast_1d(place.low).astype(int), np.atleast_1d(place.high).astype(int)
    pairs = list(zip(*ends, strict=True))
    low = np.array([np.min(numbers[i : j + 1]) for i, j in pairs]).reshape(np.shape(place.low))
    high = np.array([np.max(numbers[i : j + 1]) for i, j in pairs]).reshape(np.shape(place.low))
    rest = np.where(low == high, 0.0, np.inf)
    return Interval(low, high, -rest, rest)


_exp = _monotone(np.exp, lambda a: (np.exp(a[0]), np.exp(a[1])))
_log = _monotone(np.log, lambda a: (1.0 / a[1], np.where(a[0] > 0.0, 1.0 / a[0], np.inf)))
_asin = _monotone(lambda x: np.arcsin(np.clip(x, -1.0, 1.0)), arc_slope)
_atan = _monotone(np.arctan, lambda a: reciprocal(one_plus(square(a))))


def _unknown(*args: Interval) -> Interval:
    """Return what is known of the value of a call: nothing."""
    far = np.full(np.broadcast_shapes(*(np.shape(interval_of(arg).low) for arg in args)), np.inf)
    return Interval(-far, far, -far, far)


_RULES: dict[str, Callable[..., Interval]] = {
    "add": _add,
    "sub": lambda a, b: _add(a, _neg(b)),
    "mul": _mul,
    "div": _div,
    "neg": _neg,
    "sqrt": _monotone(np.sqrt, lambda a: times((0.5, 0.5), reciprocal(root(a)))),
    "pow": _pow,
    "sin": _sin,
    "cos": _cos,
    "tan": _tan,
    "asin": _asin,
    "acos": _acos,
    "atan": _atan,
    "atan2": _atan2,
    "exp": _exp,
    "log": _log,
    "sinh": _monotone(np.sinh, even(np.cosh)),
    "cosh": lambda a: _made(even(np.cosh)(_value(a)), times((np.sinh(a.low), np.sinh(a.high)), _rate(a))),
    "tanh": _monotone(np.tanh, lambda a: reciprocal(square(even(np.cosh)(a)))),
    "abs": _abs,
    "sign": _stepped(np.sign),
    "floor": _stepped(np.floor),
    "min": _extreme(np.minimum, lambda a, b: a.high < b.low),
    "max": _extreme(np.maximum, lambda a, b: a.low > b.high),
    "less": _less,
    "less_equal": _less,
    "select": _select,
    "piece": lambda x, key: _stepped(lambda end: array_piece(end, _number(key)))(x),
    "entry": _entry,
    **dict.fromkeys(CALLS, _unknown),
}


def _either(op: str) -> Callable[..., Any]:
    plain, rule = ARRAY_OPERATIONS[op], _RULES[op]

    def call(*args: Any) -> Any:
        if any(isinstance(arg, Interval) for arg in args):
            return rule(*(args if args[0] is args[-1] else map(interval_of, args)))
        return plain(*args)

    return call


INTERVAL_OPERATIONS: dict[str, Callable[..., Any]] = {op: _either(op) for op in ARRAY_OPERATIONS}
"""The operations on intervals, and on arrays of numbers."""
