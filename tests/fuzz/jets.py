"""Jets of second order in time, by which the reference differentiates, and expressions evaluated on them.

A jet holds a value and its first and second rates along a motion. Leading axes are free: the reference runs several
cases side by side (last axis of scalars), and several second rates of the coordinates at once (axis before it), so
that the linear dependence on them, which is the Jacobian, is read off exactly. Nothing here imports dalembert.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

__all__ = ["Jet", "Kinks", "bilinear", "compiled", "moving"]


class Jet:
    """A value with its first and second rate; the second is None where it is not known."""

    __array_priority__ = 1000
    __slots__ = ("d", "dd", "v")

    def __init__(self, v: Any, d: Any, dd: Any) -> None:
        self.v, self.d, self.dd = v, d, dd

    def __add__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            second = None if self.dd is None or other.dd is None else self.dd + other.dd
            return Jet(self.v + other.v, self.d + other.d, second)
        return Jet(self.v + other, self.d, self.dd)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.v, -self.d, None if self.dd is None else -self.dd)

    def __sub__(self, other: Any) -> Jet:
        return self + (-other)

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    def __mul__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            return bilinear(np.multiply, self, other)
        return Jet(self.v * other, self.d * other, None if self.dd is None else self.dd * other)

    __rmul__ = __mul__

    def chain(self, f: Any, first: Any, second: Any) -> Jet:
        """Return the jet of a function with this value and these derivatives at `v`."""
        dd = None if self.dd is None else second * self.d * self.d + first * self.dd
        return Jet(f, first * self.d, dd)


def bilinear(f: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """Return the jet of a product f(a, b); a factor that is no jet is constant."""
    if not isinstance(a, Jet):
        if not isinstance(b, Jet):
            return f(a, b)
        return Jet(f(a, b.v), f(a, b.d), None if b.dd is None else f(a, b.dd))
    if not isinstance(b, Jet):
        return Jet(f(a.v, b), f(a.d, b), None if a.dd is None else f(a.dd, b))
    known = a.dd is not None and b.dd is not None
    dd = f(a.dd, b.v) + 2 * f(a.d, b.d) + f(a.v, b.dd) if known else None
    return Jet(f(a.v, b.v), f(a.d, b.v) + f(a.v, b.d), dd)


def _power(a: Any, n: float) -> Any:
    x = a.v if isinstance(a, Jet) else a
    value = np.power(x, int(n)) if n == int(n) and n > 0 else np.power(np.asarray(x, dtype=float), n)
    if not isinstance(a, Jet):
        return value
    if n == 2:
        return a.chain(value, 2 * x, 2.0)
    first = n * np.power(np.asarray(x, dtype=float), n - 1)
    second = 0.0 if n == 1 else n * (n - 1) * np.power(np.asarray(x, dtype=float), n - 2)
    return a.chain(value, first, second)


def _sin(x: Any) -> Any:
    return np.sin(x), np.cos(x), -np.sin(x)


def _cos(x: Any) -> Any:
    return np.cos(x), -np.sin(x), -np.cos(x)


def _tan(x: Any) -> Any:
    t = np.tan(x)
    return t, 1 + t * t, 2 * t * (1 + t * t)


def _exp(x: Any) -> Any:
    e = np.exp(x)
    return e, e, e


def _tanh(x: Any) -> Any:
    t = np.tanh(x)
    return t, 1 - t * t, -2 * t * (1 - t * t)


def _asin(x: Any) -> Any:
    r = 1 / np.sqrt(1 - x * x)
    return np.arcsin(x), r, x * r**3


def _acos(x: Any) -> Any:
    r = 1 / np.sqrt(1 - x * x)
    return np.arccos(x), -r, -x * r**3


def _cot(x: Any) -> Any:
    c = 1 / np.tan(x)
    return c, -(1 + c * c), 2 * c * (1 + c * c)


def _sec(x: Any) -> Any:
    s, t = 1 / np.cos(x), np.tan(x)
    return s, s * t, s * (2 * t * t + 1)


def _csc(x: Any) -> Any:
    s, c = 1 / np.sin(x), 1 / np.tan(x)
    return s, -s * c, s * (2 * c * c + 1)


_SMOOTH: dict[str, Callable[[Any], Any]] = {
    "sin": _sin,
    "cos": _cos,
    "tan": _tan,
    "exp": _exp,
    "tanh": _tanh,
    "asin": _asin,
    "acos": _acos,
    "cot": _cot,
    "sec": _sec,
    "csc": _csc,
    "log": lambda x: (np.log(x), 1 / x, -1 / x**2),
    "sqrt": lambda x: (np.sqrt(x), 0.5 / np.sqrt(x), -0.25 / x**1.5),
    "atan": lambda x: (np.arctan(x), 1 / (1 + x * x), -2 * x / (1 + x * x) ** 2),
    "sinh": lambda x: (np.sinh(x), np.cosh(x), np.sinh(x)),
    "cosh": lambda x: (np.cosh(x), np.sinh(x), np.cosh(x)),
}
"""Name -> value, first and second derivative."""


class Kinks:
    """What changes where an expression has a kink or jump: indicators that depend on time alone, and whether others."""

    def __init__(self) -> None:
        self.indicators: list[Callable[[Any], Any]] = []
        self.of_state = False
        self.jumps = False
        self.time_jumps = False


def moving(tree: Any) -> bool:
    """Whether an expression depends on coordinates or rates."""
    return tree[0] in ("q", "u") or any(isinstance(item, tuple) and moving(item) for item in tree[1:])


def _plain(a: Any) -> Any:
    return a.v if isinstance(a, Jet) else a


def _split(a: Any, b: Any, where: Any) -> Any:
    """Return a where a condition holds, else b."""
    if not isinstance(a, Jet) and not isinstance(b, Jet):
        return np.where(where, a, b)
    a = a if isinstance(a, Jet) else Jet(a, 0.0, 0.0)
    b = b if isinstance(b, Jet) else Jet(b, 0.0, 0.0)
    dd = None if a.dd is None or b.dd is None else np.where(where, a.dd, b.dd)
    return Jet(np.where(where, a.v, b.v), np.where(where, a.d, b.d), dd)


def compiled(tree: Any, kinks: Kinks) -> Callable[[Any], Any]:
    """Return a function of an environment with `q`, `u`, `t`, `parameters` and `middle`.

    `middle` is an environment in the middle of the interval between two kinks of time, where such branches are chosen.
    """
    kind = tree[0]
    if kind == "num":
        value = float(Fraction(tree[1])) if "/" in tree[1] else float(tree[1])
        return lambda env: value
    if kind == "par":
        return lambda env: env.parameters[tree[1]]
    if kind == "t":
        return lambda env: env.t
    if kind in ("q", "u"):
        return (lambda env: env.q[tree[1]]) if kind == "q" else (lambda env: env.u[tree[1]])
    if kind in ("abs", "sign", "floor", "ceiling", "max", "min", "mod", "heaviside", "piecewise"):
        return _branching(tree, kinks)
    if kind == "pow" and tree[2][0] == "num":
        base, exponent = compiled(tree[1], kinks), compiled(tree[2], kinks)(None)
        return lambda env: _power(base(env), exponent)
    parts = [compiled(item, kinks) for item in tree[1:]]
    return _smooth(kind, parts)


def _smooth(kind: str, parts: list[Callable[[Any], Any]]) -> Callable[[Any], Any]:
    first = parts[0]
    if kind == "neg":
        return lambda env: -first(env)
    if kind in ("add", "mul"):

        def folded(env: Any) -> Any:
            value = first(env)
            for part in parts[1:]:
                value = value + part(env) if kind == "add" else value * part(env)
            return value

        return folded
    if kind == "div":
        return lambda env: first(env) * _power(parts[1](env), -1.0)
    if kind == "pow":
        return lambda env: _apply(_exp, parts[1](env) * _apply(_SMOOTH["log"], first(env)))
    if kind == "atan2":
        return lambda env: _atan2(first(env), parts[1](env))
    return lambda env: _apply(_SMOOTH[kind], first(env))


def _apply(function: Callable[[Any], Any], a: Any) -> Any:
    values = function(_plain(a))
    return a.chain(*values) if isinstance(a, Jet) else values[0]


def _atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y): its rates are those of twice the arc tangent of half the angle, so that no x = 0."""
    value = np.arctan2(_plain(y), _plain(x))
    if not isinstance(y, Jet) and not isinstance(x, Jet):
        return value
    c, s = np.cos(value), np.sin(value)  # in axes turned by the value, the angle is atan(across / along)
    along, across = x * c + y * s, y * c - x * s
    turned = _apply(_SMOOTH["atan"], across * _power(along, -1.0))
    return Jet(value + turned.v, turned.d, turned.dd)


def _branching(tree: Any, kinks: Kinks) -> Callable[[Any], Any]:
    """Return a function that chooses its branch in the middle of an interval where its condition knows only time."""
    kind, (first, *rest) = tree[0], [compiled(item, kinks) for item in tree[1:]]
    second = rest[0] if rest else None

    def quantity(env: Any) -> Any:
        a = _plain(first(env))
        if kind in ("floor", "ceiling"):
            return np.floor(a) if kind == "floor" else np.ceil(a)
        if kind == "mod":
            assert second is not None
            return np.floor(a / _plain(second(env)))
        if kind in ("max", "min", "piecewise"):
            assert second is not None
            a = a - _plain(second(env)) if kind != "piecewise" else _plain(second(env)) - a
        return np.sign(a)

    conditions = tree[1:3] if kind in ("max", "min", "piecewise", "mod") else tree[1:2]
    timed = not any(map(moving, conditions))
    jump = kind not in ("abs", "max", "min")
    if timed:
        kinks.indicators.append(quantity)
        kinks.time_jumps |= jump
    else:
        kinks.of_state = True
        kinks.jumps |= jump

    def value(env: Any) -> Any:
        level = quantity(env.middle if timed else env)
        if kind in ("sign", "floor", "ceiling"):
            return level
        if kind == "heaviside":
            return (1 + level) / 2
        a = first(env)
        if kind == "abs":
            return a * level
        assert second is not None
        if kind == "mod":
            return a - second(env) * level
        if kind == "piecewise":
            return _split(rest[1](env), rest[2](env), level > 0)
        return _split(a, second(env), level > 0 if kind == "max" else level < 0)

    return value
