"""Values of expressions with bounds of their rounding errors, and equality up to the rounding of decimals.

An expression of symbols and rationals is compared exactly, by its fingerprint. Where decimals occur, 0.7 * 0.3 and 0.21
are different doubles that mean one number: values at random points are compared instead, with a tolerance that follows
from the rounding errors of all their constants and operations.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence

from .graph import Graph, Node
from .ops import OPERATIONS

__all__ = ["agree", "evaluate", "has_decimals", "random_inputs"]

_EPSILON = 2.0**-53
_LONG = 64
"""Bits of numerator and denominator from which a constant is taken for a decimal: 0.1 has 108, 1/3000 has 13."""
_TIMES = 16.0
"""How many times its bound a difference may be: products of decimals are rounded before they get here."""
_STEP = 1e-7
_POINTS, _DRAWS = 3, 24

Bounded = tuple[float, float]
"""A value and a bound of its rounding error."""


def has_decimals(nodes: Sequence[Node]) -> bool:
    """Whether a constant in some expressions is a double that looks like a rounded decimal."""
    for node in Graph.topological(nodes):
        number = node.number
        if number is not None and number.numerator.bit_length() + number.denominator.bit_length() > _LONG:
            return True
    return False


def random_inputs(nodes: Sequence[Node], draw: random.Random) -> dict[Node, float]:
    """Return a positive number of moderate size for every input that some expressions depend on."""
    return {node: draw.uniform(0.4, 1.3) for node in Graph.topological(nodes) if node.op == "input"}


def evaluate(nodes: Sequence[Node], inputs: Mapping[Node, float]) -> list[Bounded]:
    """Return the values of some expressions, each with a bound of its rounding error.

    Parameters
    ----------
    nodes : sequence of Node
    inputs : mapping of Node to float
        Exact values of all inputs that they depend on.

    Returns
    -------
    list of (float, float)
        Values that are not finite have an infinite bound.
    """
    known: dict[int, Bounded] = {node.index: (value, 0.0) for node, value in inputs.items()}
    for node in Graph.topological(nodes):
        if node.index in known:
            continue
        if node.op == "const":
            value = float(node.payload)  # type: ignore[arg-type]
            whole = node.number is not None and node.number.denominator == 1 and abs(value) < 2.0**53
            known[node.index] = (value, 0.0 if whole else _EPSILON * abs(value))
        else:
            known[node.index] = _operation(node.op, [known[arg.index] for arg in node.args])
    return [known[node.index] for node in nodes]


def _operation(op: str, args: Sequence[Bounded]) -> Bounded:
    """Return an operation on values with bounds: the error of the result to first order."""
    function, x = OPERATIONS[op].evaluate, [value for value, _ in args]
    value = float(function(*x))
    error = _EPSILON * abs(value)
    if op in ("add", "sub"):
        error += args[0][1] + args[1][1]
    elif op == "mul":
        error += abs(x[0]) * args[1][1] + abs(x[1]) * args[0][1]
    else:
        for place, (point, bound) in enumerate(args):
            if bound:
                step = _STEP * max(1.0, abs(point))
                moved = float(function(*x[:place], point + step, *x[place + 1 :]))
                error += abs(moved - value) / step * bound
    return (value, error) if math.isfinite(value) and math.isfinite(error) else (math.nan, math.inf)


def agree(first: Sequence[Node], second: Sequence[Node]) -> bool:
    """Whether two vectors are equal, up to rounding where decimals occur in them and exactly elsewhere.

    Rounding is relative to the largest component of the vectors, so that components that cancel do not count.
    """
    if all((a - b).is_zero for a, b in zip(first, second, strict=True)):
        return True
    both = [*first, *second]
    if not has_decimals(both):
        return False
    found = 0
    for seed in range(_DRAWS):
        values = evaluate(both, random_inputs(both, random.Random(seed)))
        if any(math.isinf(bound) for _, bound in values):
            continue
        size = max(abs(value) for value, _ in values)
        bound = max(bound for _, bound in values) + 2.0 * _EPSILON * size
        half = len(first)
        if any(abs(a - b) > _TIMES * bound for (a, _), (b, _) in zip(values[:half], values[half:], strict=True)):
            return False
        found += 1
        if found == _POINTS:
            return True
    return False
