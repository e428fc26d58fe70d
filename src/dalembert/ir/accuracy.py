"""Rounding errors of equal forms of a value, estimated at probing points.

A form of a value may cancel where another does not: 1 - cos(x) has no digit left at x = 1e-8, 2 sin(x/2)**2 has all.
Whether a form loses accuracy is decided by what rounding makes of it, to first order, at points near which things
cancel: every input is near 0, a right or a straight angle, or a number that other inputs are near to as well, or its
opposite. The inputs themselves count as exact. Points where a value is not finite are ignored.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .calls import CALLS, generic_call
from .node import Node, UnitName
from .ops import GRAPH_OPERATIONS

Probed = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Values at the points (n,), and bounds of their errors."""

LOSS = 32.0
"""Largest ratio of the error of a form to that of another form of the same value."""

_NEAR = 1e-5
"""Largest distance of the inputs from each other and from special values."""
_OTHER = 0.8349
_CENTRES = np.array([0.0, np.pi / 2, np.pi, _OTHER, -_OTHER])
_ALLOWED = [
    *([0], [3], [1], [2]) * 2,
    *([0, 3], [3, 4], [0, 1], [0, 2], [1, 3], [2, 3]) * 2,
    *([0, 1, 2, 3, 4],) * 20,
]
"""The centres that inputs may be near to, at each point: where there are few, many inputs are near to one."""
_COUNT = len(_ALLOWED)
_EPSILON = 2.0**-53
_HARMLESS = 32.0 * _EPSILON
"""Relative error up to which a form loses nothing, however good another one is."""

Forms = Callable[[Node], tuple[str, tuple[Node, ...]]]


def _own_form(node: Node) -> tuple[str, tuple[Node, ...]]:
    return node.op, node.args


def loses(new: Probed, old: Probed) -> bool:
    """Return whether a form has lost digits, somewhere, that another form of the same value has."""
    with np.errstate(all="ignore"):
        larger = new[1] > LOSS * old[1]
        if not np.count_nonzero(larger):  # in a fifth of the time of `any`
            return False
        size = np.minimum(np.abs(new[0]) + new[1], np.abs(old[0]) + old[1])
        return bool((larger & (new[1] > _HARMLESS * size)).any())


def probed(node: Node, known: dict[int, Probed], forms: Forms = _own_form) -> Probed:
    """Return the values of a node at the points, with their errors; those of all that it depends on go to `known`."""
    if node.index in known:
        return known[node.index]
    stack = [node]
    with np.errstate(all="ignore"):
        while stack:
            last = stack[-1]
            if last.index in known:
                stack.pop()
                continue
            op, args = forms(last)
            waiting = [arg for arg in args if arg.index not in known]
            if waiting:
                stack += waiting
            else:
                known[last.index] = _leaf(last) if not args else _form(op, args, known)
                stack.pop()
    return known[node.index]


def probed_form(op: str, args: tuple[Node, ...], known: Mapping[int, Probed]) -> Probed:
    """Return the values of an operation on nodes that are `known`, with their errors."""
    with np.errstate(all="ignore"):
        return _form(op, args, known)


def _form(op: str, args: tuple[Node, ...], known: Mapping[int, Probed]) -> Probed:
    operands = [known[arg.index] for arg in args]
    factors = args if op == "mul" else args[1:] if op == "div" else ()
    for arg in factors:
        if arg.number is not None and _power_of_two(arg.number):
            return _scaled(op, *operands)
    return _RULES[op](*operands)


def _power_of_two(number: Fraction) -> bool:
    top, bottom = abs(number.numerator), number.denominator
    return top != 0 and top & (top - 1) == 0 and bottom & (bottom - 1) == 0


def _leaf(node: Node) -> Probed:
    if node.op == "input":
        name = node.payload
        values = _unit(name.quaternion)[name.place] if isinstance(name, UnitName) else _near(str(name))
        return values, np.zeros(_COUNT)
    assert isinstance(node.payload, Fraction | float)
    try:
        value = float(node.payload)
    except OverflowError:
        value = np.inf
    exact = isinstance(node.payload, Fraction) and np.isfinite(value) and Fraction(value) == node.payload
    return np.full(_COUNT, value), np.full(_COUNT, 0.0 if exact else _EPSILON * abs(value))


def _draw(name: str, count: int) -> NDArray[np.float64]:
    """Return numbers between 0 and 1 drawn from a name, the same in every process."""
    words = b"".join(hashlib.sha256(f"{name}\x1f{i}".encode()).digest() for i in range(-(-count // 8)))
    return np.asarray(np.frombuffer(words, dtype="<u4")[:count] / 2.0**32)


@functools.lru_cache(maxsize=4096)
def _near(name: str) -> NDArray[np.float64]:
    """Return the values of the input called `name` at the points."""
    draws = _draw(name, 3 * _COUNT).reshape(3, _COUNT)
    centres = _CENTRES[[allowed[int(draw * len(allowed))] for draw, allowed in zip(draws[0], _ALLOWED, strict=True)]]
    return np.asarray(centres + _NEAR * (0.5 + draws[1]) * np.where(draws[2] < 0.5, -1.0, 1.0))


@functools.lru_cache(maxsize=256)
def _unit(name: str) -> NDArray[np.float64]:
    """Return unit quaternions, near the identity at half of the points."""
    parts = 2.0 * _draw(name, 4 * _COUNT).reshape(4, _COUNT) - 1.0
    parts[1:, ::2] *= _NEAR
    parts[0, ::2] = 1.0
    return np.asarray(parts / np.sqrt((parts**2).sum(axis=0)))


def _scaled(op: str, a: Probed, b: Probed) -> Probed:
    """Return a product with a power of two, or a quotient by one, which is not rounded."""
    if op == "mul":
        return a[0] * b[0], np.abs(a[0]) * b[1] + np.abs(b[0]) * a[1]
    return a[0] / b[0], a[1] / np.abs(b[0])


def _rounded(value: Any, carried: Any) -> Probed:
    """Return a value with the error of its own rounding and the propagated errors of its operands."""
    return value, carried + _EPSILON * np.abs(value)


def _quotient(a: Probed, b: Probed) -> Probed:
    value = a[0] / b[0]
    return _rounded(value, (a[1] + np.abs(value) * b[1]) / np.abs(b[0]))


def _sum(a: Probed, b: Probed) -> Probed:
    return _rounded(a[0] + b[0], a[1] + b[1])


def _power(a: Probed, b: Probed) -> Probed:
    value = np.power(a[0], b[0])
    along = np.abs(value) * (np.abs(b[0] / a[0]) * a[1] + np.where(b[1] > 0.0, np.abs(np.log(a[0])) * b[1], 0.0))
    return _rounded(value, along)


def _angle(a: Probed, b: Probed) -> Probed:
    carried = (np.abs(b[0]) * a[1] + np.abs(a[0]) * b[1]) / (a[0] ** 2 + b[0] ** 2)
    return _rounded(np.arctan2(a[0], b[0]), carried)


def _function(function: Callable[[Any], Any], slope: Callable[[Any, Any], Any]) -> Callable[[Probed], Probed]:
    """Return the rule of a function from the function and its derivative in terms of operand and value."""

    def rule(a: Probed) -> Probed:
        value = function(a[0])
        return _rounded(value, np.abs(slope(a[0], value)) * a[1])

    return rule


def _chosen(name: str) -> Callable[..., Probed]:
    """Return the rule of an operation that takes one of its operands or a number that is not rounded."""

    def rule(*operands: Probed) -> Probed:
        (a, *rest) = operands
        match name:
            case "select":
                return tuple(np.where(a[0] != 0.0, x, y) for x, y in zip(*rest, strict=True))
            case "min" | "max":
                (b,) = rest
                first = a[0] <= b[0] if name == "min" else a[0] >= b[0]
                return np.where(first, a[0], b[0]), np.where(first, a[1], b[1])
            case _:
                values = [operand[0] for operand in operands]
                evaluate = GRAPH_OPERATIONS[name].evaluate
                value = np.array([evaluate(*map(float, row)) for row in zip(*values, strict=True)])
                return value, np.zeros(_COUNT)

    return rule


def _table(x: Probed, key: Probed, order: Probed) -> Probed:
    def at(more: float) -> NDArray[np.float64]:
        rows = zip(x[0], key[0], order[0], strict=True)
        return np.array([GRAPH_OPERATIONS["table"].evaluate(a, k, o + more) for a, k, o in rows])

    return _rounded(at(0.0), np.abs(at(1.0)) * x[1])


def _surface(x: Probed, y: Probed, key: Probed, i: Probed, j: Probed) -> Probed:
    def at(a: int, b: int) -> NDArray[np.float64]:
        rows = zip(x[0], y[0], key[0], i[0] + a, j[0] + b, strict=True)
        return np.array([GRAPH_OPERATIONS["surface"].evaluate(*row) for row in rows])

    return _rounded(at(0, 0), np.abs(at(1, 0)) * x[1] + np.abs(at(0, 1)) * y[1])


_STEP = 1e-6
"""Step of differences of calls."""


def _called(*operands: Probed) -> Probed:
    """Return a call: at random points, differences say how errors of arguments change it."""
    *args, key = operands

    def at(points: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.array([generic_call(*row) for row in zip(*points, key[0], strict=True)])

    points = [arg[0] for arg in args]
    value, error = at(points), np.zeros(len(key[0]))
    for place, arg in enumerate(args):
        moved = [*points[:place], points[place] + _STEP, *points[place + 1 :]]
        error = error + np.abs(at(moved) - value) / _STEP * arg[1]
    return _rounded(value, error)


_RULES: dict[str, Callable[..., Probed]] = {
    "add": _sum,
    "sub": lambda a, b: _sum(a, (-b[0], b[1])),
    "mul": lambda a, b: _rounded(a[0] * b[0], np.abs(a[0]) * b[1] + np.abs(b[0]) * a[1]),
    "div": _quotient,
    "neg": lambda a: (-a[0], a[1]),
    "sqrt": _function(np.sqrt, lambda x, y: 0.5 / y),
    "pow": _power,
    "sin": _function(np.sin, lambda x, y: np.cos(x)),
    "cos": _function(np.cos, lambda x, y: np.sin(x)),
    "tan": _function(np.tan, lambda x, y: 1.0 + y * y),
    "asin": _function(np.arcsin, lambda x, y: 1.0 / np.sqrt(1.0 - x * x)),
    "acos": _function(np.arccos, lambda x, y: 1.0 / np.sqrt(1.0 - x * x)),
    "atan": _function(np.arctan, lambda x, y: 1.0 / (1.0 + x * x)),
    "atan2": _angle,
    "exp": _function(np.exp, lambda x, y: y),
    "log": _function(np.log, lambda x, y: 1.0 / x),
    "sinh": _function(np.sinh, lambda x, y: np.cosh(x)),
    "cosh": _function(np.cosh, lambda x, y: np.sinh(x)),
    "tanh": _function(np.tanh, lambda x, y: 1.0 - y * y),
    "abs": lambda a: (np.abs(a[0]), a[1]),
    **{
        name: _chosen(name)
        for name in ("sign", "floor", "less", "less_equal", "min", "max", "select", "piece", "entry")
    },
    "table": _table,
    "surface": _surface,
    **dict.fromkeys(CALLS, _called),
}
