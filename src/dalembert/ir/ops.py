"""The operations of the graph and of programs: one row an operation.

Everything that treats operations one by one (derivatives, printers, the reference
interpreter) is a table keyed by the names below, and a test asserts that each table
covers all of them.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["OPERATIONS", "Operation"]


@dataclass(frozen=True, slots=True)
class Operation:
    """One operation of the graph.

    Attributes
    ----------
    name : str
        Its key in every table.
    arity : int
        Number of operands.
    cost : float
        Cost relative to one addition; decides between equal forms of a value.
    flops : int
        Floating-point operations that `explain()` counts for it (transcendental
        functions are counted by name instead and carry 0).
    evaluate : callable
        The operation on Python floats.
    """

    name: str
    arity: int
    cost: float
    flops: int
    evaluate: Callable[..., float]


def _divide(a: float, b: float) -> float:
    try:
        return a / b
    except ZeroDivisionError:
        return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)


def _sign(a: float) -> float:
    return float((a > 0.0) - (a < 0.0))


OPERATIONS: dict[str, Operation] = {
    operation.name: operation
    for operation in (
        Operation("add", 2, 1.0, 1, operator.add),
        Operation("sub", 2, 1.0, 1, operator.sub),
        Operation("mul", 2, 1.0, 1, operator.mul),
        Operation("div", 2, 4.0, 1, _divide),
        Operation("neg", 1, 0.5, 0, operator.neg),
        Operation("sqrt", 1, 5.0, 1, math.sqrt),
        Operation("pow", 2, 30.0, 0, math.pow),
        Operation("sin", 1, 15.0, 0, math.sin),
        Operation("cos", 1, 15.0, 0, math.cos),
        Operation("tan", 1, 35.0, 0, math.tan),
        Operation("asin", 1, 25.0, 0, math.asin),
        Operation("acos", 1, 25.0, 0, math.acos),
        Operation("atan", 1, 25.0, 0, math.atan),
        Operation("atan2", 2, 30.0, 0, math.atan2),
        Operation("exp", 1, 15.0, 0, math.exp),
        Operation("log", 1, 15.0, 0, math.log),
        Operation("sinh", 1, 25.0, 0, math.sinh),
        Operation("cosh", 1, 25.0, 0, math.cosh),
        Operation("tanh", 1, 25.0, 0, math.tanh),
        Operation("abs", 1, 1.0, 0, abs),
        Operation("sign", 1, 2.0, 0, _sign),
        Operation("floor", 1, 2.0, 0, math.floor),
        Operation("min", 2, 1.0, 1, min),
        Operation("max", 2, 1.0, 1, max),
        Operation("less", 2, 1.0, 0, lambda a, b: float(a < b)),
        Operation("less_equal", 2, 1.0, 0, lambda a, b: float(a <= b)),
        Operation("select", 3, 1.0, 0, lambda c, a, b: a if c != 0.0 else b),
    )
}
"""Every operation by name. Comparisons give 1.0 or 0.0; ``select(c, a, b)`` is ``a`` where c is not 0."""
