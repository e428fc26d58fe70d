"""Antiderivatives of elementary functions and tables by their arguments."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from ..ir.graph import Graph
from ..ir.node import Node


def _unary(g: Graph, name: str, u: Node) -> Node | None:
    """Return the antiderivative of an elementary function by its argument."""
    one = g.one
    table: dict[str, Callable[[], Node]] = {
        "sin": lambda: -g.cos(u),
        "cos": lambda: g.sin(u),
        "tan": lambda: -g.call("log", g.call("abs", g.cos(u))),
        "exp": lambda: g.call("exp", u),
        "sinh": lambda: g.call("cosh", u),
        "cosh": lambda: g.call("sinh", u),
        "tanh": lambda: g.call("log", g.call("cosh", u)),
        "log": lambda: u * g.call("log", u) - u,
        "sqrt": lambda: u * g.call("sqrt", u) * g.const(Fraction(2, 3)),
        "atan": lambda: u * g.call("atan", u) - g.call("log", one + u * u) / 2,
        "asin": lambda: u * g.call("asin", u) + g.call("sqrt", one - u * u),
        "acos": lambda: u * g.call("acos", u) - g.call("sqrt", one - u * u),
        "abs": lambda: u * g.call("abs", u) / 2,
        "sign": lambda: g.call("abs", u),
    }
    return table[name]() if name in table else None


def elementary_antiderivative(g: Graph, op: str, args: tuple[Node, ...]) -> Node | None:
    """Return the antiderivative of an elementary function, or of a table, by its argument."""
    if op != "table":
        return _unary(g, op, args[0])
    x, key, order = args
    return None if order.number == -1 else g.call("table", x, key, order - 1)
