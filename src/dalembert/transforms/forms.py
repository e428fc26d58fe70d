"""Forms chosen for values in place of those of the graph, and their costs along a motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import final

from ..ir.graph import Graph, Node
from ..ir.ops import GRAPH_OPERATIONS
from .polynomial import Form

__all__ = ["Forms"]

_PRODUCT, _SQUARE = 12.0, 7.0
"""Cost of a product of varying values in a Taylor step of usual order, relative to a sum."""


@final
class Forms:
    """Values of a graph and the form chosen for each; those without one keep the form that the graph has.

    Attributes
    ----------
    moving : int
        Dependency bits of the inputs that vary along a motion.
    uses : mapping of int to int
        Number of uses of the value with an index: as an operand of values in use, or as an output.
    """

    def __init__(self, graph: Graph, moving: int = 0) -> None:
        self.graph, self.moving = graph, moving
        self.uses: Counter[int] = Counter()
        self._chosen: dict[int, Form] = {}
        self._moving_args: dict[int, tuple[int, ...]] = {}
        self._weights: dict[int, float] = {}

    def of(self, node: Node) -> Form:
        """Return the operation and operands of a value."""
        found = self._chosen.get(node.index)
        return (node.op, node.args) if found is None or not node.deps & self.moving else found

    def args(self, node: Node) -> tuple[Node, ...]:
        """Return the operands of a value."""
        return self.of(node)[1]

    def choose(self, node: Node, form: Form) -> None:
        """Set the form of a value. The caller counts its uses."""
        index, moving = node.index, self.moving
        self._chosen[index] = form
        self._moving_args[index] = tuple([arg.index for arg in form[1] if arg.deps & moving])
        self._weights[index] = self.weigh(form)

    def weight(self, node: Node) -> float:
        """Return the cost of the one operation of a value that varies."""
        return self._weights[node.index]

    def weigh(self, form: Form) -> float:
        """Return the cost of one operation."""
        op, args = form
        if not args:
            return 0.0
        if op in ("add", "sub", "neg"):
            return GRAPH_OPERATIONS[op].cost
        if op == "mul" and args[0].deps & self.moving and args[1].deps & self.moving:
            return _SQUARE if args[0] is args[1] else _PRODUCT
        if op == "mul" or (op == "div" and not args[1].deps & self.moving):
            return 1.0
        return GRAPH_OPERATIONS[op].cost + _PRODUCT

    def work(self, nodes: Sequence[Node]) -> float:
        """Return the cost of `nodes` and all that they depend on, shared values counted once."""
        return sum(self.weigh(self.of(n)) for n in self.graph.topological(nodes, self.args) if n.deps & self.moving)

    def acquire(self, node: Node) -> float:
        """Count the uses that the form of `node` makes, and return the cost of what was not used before."""
        uses, added, stack = self.uses, 0.0, [node.index]
        while stack:
            for arg in self._moving_args[stack.pop()]:
                uses[arg] += 1
                if uses[arg] == 1:
                    added += self._weights[arg]
                    stack.append(arg)
        return added

    def release(self, node: Node) -> float:
        """Undo `acquire`."""
        uses, freed, stack = self.uses, 0.0, [node.index]
        while stack:
            for arg in self._moving_args[stack.pop()]:
                uses[arg] -= 1
                if not uses[arg]:
                    freed += self._weights[arg]
                    stack.append(arg)
        return freed
