"""Directions in which functions of the state leave a place: signs of their first derivatives along the motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

from ..ir.graph import Graph, Node
from ..transforms.derivatives import GUARDED, tangents
from .base import ReducedSystem

__all__ = ["Departures"]

_LARGEST = {1: math.inf, 2: 1500, 3: 1000}
_LARGEST_BEYOND = 500
"""Number of nodes of all derivatives above which one of an order is not taken, and beyond these orders."""


@final
class Departures:
    """Derivatives of functions of the state along the motion of a system.

    Parameters
    ----------
    graph : Graph
        Takes the nodes.
    system : ReducedSystem
        Its rates, on a graph of their own.
    direction : Node
        1 or -1, the direction of time.
    order : int
        Largest order of derivatives that decide.

    Attributes
    ----------
    inputs : list of Node
        The state as the inputs of functions of it.
    rates : list of Node
        Of the state.
    """

    def __init__(self, graph: Graph, system: ReducedSystem, direction: Node, order: int) -> None:
        self.graph, self.direction, self._order = graph, direction, order
        self.inputs, self.rates = graph.adopt(list(system.inputs)), graph.adopt(list(system.rhs))
        (time,) = graph.adopt([system.equations.time])
        self._flow = dict(zip(self.inputs, self.rates, strict=True)) | {time: graph.one}

    def at(self, nodes: Sequence[Node], state: Sequence[Node]) -> list[Node]:
        """Return functions of the state at a state."""
        return self.graph.substitute(nodes, dict(zip(self.inputs, state, strict=True)))

    def derivatives(self, functions: Sequence[Node], least: int = 1) -> list[list[Node]]:
        """Return the first derivatives of functions, those of one function in a row, as far as they are not dear.

        They are those by the time that the motion takes, whichever way it runs; at least so many.
        """
        found: list[list[Node]] = [[] for _ in functions]
        last, known = list(functions), list(functions)
        for order in range(1, self._order + 1):
            last = tangents(self.graph, last, self._flow, GUARDED)
            largest = _LARGEST.get(order, _LARGEST_BEYOND)
            known += last
            if order > least and sum(1 for _ in self.graph.topological(known)) > largest:
                break
            for row, node in zip(found, last, strict=True):
                row.append(self.direction * node if order % 2 else node)
        return found

    def leading(self, derivatives: Sequence[Node], margin: Node) -> Node:
        """Return the derivative that takes a function out of a margin first: its sign is that of the motion."""
        g, fastest, leading = self.graph, self.graph.zero, self.graph.zero
        for order, derivative in enumerate(derivatives, 1):
            if derivative.is_zero:
                continue
            rate = g.call("abs", derivative) / (g.const(math.factorial(order)) * margin)
            if order > 1:  # the inverse of the time in which this derivative alone does so
                rate = g.call("sqrt", rate) if order == 2 else g.call("pow", rate, g.const(1.0 / order))
            leading = g.call("select", g.call("less", fastest, rate), derivative, leading)
            fastest = g.call("max", fastest, rate)
        return leading
