"""Expressions whose switches, tables and steep functions are independent of the state.

A rate that vanishes around a state need not vanish elsewhere: a damper that begins to act later, or beyond a stop, has
no power before. Where decisions and arguments of such functions are free, any state shows all of their branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..ir.graph import Graph, Node
from ..ir.tables import table_of

__all__ = ["FreeArgument", "free_arguments", "has_branches"]

_DECIDING = frozenset({"abs", "sign", "min", "max", "less", "less_equal"})
_OF_ARGUMENTS = frozenset({"floor", "table", "exp", "sinh", "cosh", "tanh"})
"""Functions with many pieces, and such as may be below rounding at one state and large at another."""


@final
@dataclass(frozen=True)
class FreeArgument:
    """Distribution of a free value, around `centre` and within `width` for the most part."""

    centre: float = 0.0
    width: float = 1.0

    def draw(self, random: np.random.Generator, count: int) -> FloatArray:
        """Return random values (count,), some much closer to the centre and some farther away."""
        sizes = 10.0 ** random.uniform(-1.0, 1.0, count)
        return self.centre + self.width * sizes * random.standard_normal(count)


def free_arguments(
    graph: Graph, nodes: Sequence[Node], variables: int
) -> tuple[list[Node], list[tuple[Node, FreeArgument]]]:
    """Return `nodes` with free decisions and arguments, and these as inputs.

    Decisions by one expression, or by its negative, are one input; and so is an argument, wherever it stands.

    Parameters
    ----------
    graph : Graph
    nodes : sequence of Node
    variables : int
        The inputs that change in a run, as `Node.deps` has them. What depends on none of them stays.
    """
    rebuilding = _Rebuilding(graph, variables)
    done: dict[int, Node] = {}
    graph.visit(nodes, done, lambda node: rebuilding.rebuilt(node, [done[arg.index] for arg in node.args]))
    return [done[node.index] for node in nodes], list(rebuilding.free.values())


def has_branches(graph: Graph, nodes: Sequence[Node], variables: int) -> bool:
    """Return whether a function with free decisions or arguments is among what nodes depend on."""
    return any(_branches(node, variables) for node in graph.topological(nodes))


def _branches(node: Node, variables: int) -> bool:
    return node.op in _DECIDING | _OF_ARGUMENTS and bool(node.deps & variables)


@final
@dataclass(frozen=True)
class _Rebuilding:
    """Inputs that replace decisions and arguments, by the number of the node that each stands for."""

    graph: Graph
    variables: int
    free: dict[int, tuple[Node, FreeArgument]] = field(default_factory=dict)

    def rebuilt(self, node: Node, args: list[Node]) -> Node:
        """Return a node of rebuilt operands."""
        if not node.args:
            return node
        if _branches(node, self.variables):
            if node.op in _DECIDING:
                return self._decided(node, args)
            args = [self._input(node.args[0], _range(node)), *args[1:]]
        return self.graph.call(node.op, *args)

    def _decided(self, node: Node, args: list[Node]) -> Node:
        """Return the value of a function on the side of its switch that a free number decides."""
        graph = self.graph
        sign = self._sign(node.args[0] - node.args[1] if len(node.args) == 2 else node.args[0])
        if node.op in ("less", "less_equal"):
            return graph.call("less", sign, graph.zero)
        if node.op in ("sign", "abs"):
            return sign if node.op == "sign" else sign * args[0]
        return graph.call("select", graph.call("less", sign, graph.zero), *args[:: 1 if node.op == "min" else -1])

    def _sign(self, node: Node) -> Node:
        opposite = -node
        first = node if node.index < opposite.index else opposite
        sign = self.graph.call("sign", self._input(first, FreeArgument()))
        return sign if first is node else -sign

    def _input(self, node: Node, where: FreeArgument) -> Node:
        if node.index not in self.free:
            self.free[node.index] = self.graph.input(f"free argument {len(self.free)}"), where
        return self.free[node.index][0]


def _range(node: Node) -> FreeArgument:
    """Return where the argument of a function has to be, so that its pieces are met."""
    if node.op != "table":
        return FreeArgument()
    table = table_of(float(node.args[1].payload))  # type: ignore[arg-type]
    return FreeArgument((table.first + table.last) / 2, (table.last - table.first) / 2 or 1.0)
