"""Table of the operations of the graph and of programs.

Everything that treats operations one by one (derivatives, printers, the reference
interpreter) is a table keyed by the names below, and a test asserts that each table
covers all of them.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, replace

from . import calls, ieee, surfaces, tables


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


def _sign(a: float) -> float:
    return float((a > 0.0) - (a < 0.0))


OPERATIONS: dict[str, Operation] = {
    operation.name: operation
    for operation in (
        Operation("add", 2, 1.0, 1, operator.add),
        Operation("sub", 2, 1.0, 1, operator.sub),
        Operation("mul", 2, 1.0, 1, operator.mul),
        Operation("div", 2, 4.0, 1, ieee.divide),
        Operation("neg", 1, 0.5, 0, operator.neg),
        Operation("sqrt", 1, 5.0, 1, ieee.sqrt),
        Operation("pow", 2, 30.0, 0, ieee.pow),
        Operation("sin", 1, 15.0, 0, ieee.sin),
        Operation("cos", 1, 15.0, 0, ieee.cos),
        Operation("tan", 1, 35.0, 0, ieee.tan),
        Operation("asin", 1, 25.0, 0, ieee.asin),
        Operation("acos", 1, 25.0, 0, ieee.acos),
        Operation("atan", 1, 25.0, 0, ieee.atan),
        Operation("atan2", 2, 30.0, 0, ieee.atan2),
        Operation("exp", 1, 15.0, 0, ieee.exp),
        Operation("log", 1, 15.0, 0, ieee.log),
        Operation("sinh", 1, 25.0, 0, ieee.sinh),
        Operation("cosh", 1, 25.0, 0, ieee.cosh),
        Operation("tanh", 1, 25.0, 0, ieee.tanh),
        Operation("abs", 1, 1.0, 0, abs),
        Operation("sign", 1, 2.0, 0, _sign),
        Operation("floor", 1, 2.0, 0, ieee.floor),
        Operation("min", 2, 1.0, 1, min),
        Operation("max", 2, 1.0, 1, max),
        Operation("less", 2, 1.0, 0, lambda a, b: float(a < b)),
        Operation("less_equal", 2, 1.0, 0, lambda a, b: float(a <= b)),
        Operation("select", 3, 1.0, 0, lambda c, a, b: a if c != 0.0 else b),
    )
}
"""Every operation of the graph. Comparisons give 1.0 or 0.0; ``select(c, a, b)`` is ``a`` where c is not 0."""

STEP_OPERATIONS: dict[str, Operation] = {
    operation.name: operation
    for operation in (
        Operation("fma", 3, 1.0, 2, lambda a, b, c: a * b + c),
        Operation("rough_log2", 1, 6.0, 0, lambda a: math.log2(a) if a > 0.0 else -math.inf),
        Operation("rough_exp2", 1, 6.0, 0, lambda a: 2.0**a if a < 1024.0 else math.inf),
    )
}
"""Further operations, of the steps of integrators. ``fma(a, b, c)`` is a*b + c, rounded once where the target can;
the rough functions are good to 0.005 and to a share of 1e-4, enough to choose a step."""

TABLE_OPERATIONS: dict[str, Operation] = {
    operation.name: operation
    for operation in (
        Operation("table", 3, 30.0, 0, tables.generic),
        Operation("surface", 5, 60.0, 0, surfaces.generic_surface),
        Operation("piece", 2, 20.0, 0, tables.piece),
        Operation("entry", 3, 2.0, 0, tables.entry),
    )
}
"""Operations on tables and surfaces, whose operands but the first (for a surface the first two) are numbers (see
`dalembert.ir.tables` and `dalembert.ir.surfaces`). Kernels have pieces and entries in place of ``table`` and
``surface``, which at random points are functions of which nothing is known."""

TABLE_ARGUMENTS: dict[str, int] = {name: 2 if name == "surface" else 1 for name in TABLE_OPERATIONS} | calls.CALLS
"""Number of operands that are values, of each operation on tables, and of each call."""

CALL_OPERATIONS: dict[str, Operation] = {
    name: Operation(name, count + 1, 30.0, 0, calls.generic_call) for name, count in calls.CALLS.items()
}
"""Calls of compiled functions, whose last operand is the number of the function (see `dalembert.ir.calls`); at random
points they are functions of which nothing is known."""

GRAPH_OPERATIONS: dict[str, Operation] = OPERATIONS | TABLE_OPERATIONS | CALL_OPERATIONS

OSCILLATING_OPERATIONS = frozenset({"sin", "cos", "tan", *TABLE_OPERATIONS, *CALL_OPERATIONS})
"""Operations that may oscillate while their operand only grows."""
"""Everything that a graph may contain."""

ALL_OPERATIONS: dict[str, Operation] = (
    GRAPH_OPERATIONS
    | STEP_OPERATIONS
    | {name: replace(operation, evaluate=calls.call) for name, operation in CALL_OPERATIONS.items()}
)
"""Everything that a kernel may contain."""
