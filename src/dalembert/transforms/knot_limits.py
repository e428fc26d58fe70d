"""Limits of steps that are no Taylor steps at knots of tables: [rates on the graph] -> [sizes of the next step].

A step that begins before a knot shall end just before it, the next one just behind it. When an argument x meets the
knot follows from its slope and its second derivative along the motion; the farther off, the less exactly, so that a
step ends the farther before it. A step may pass the knot when that is short: the smoother the table, the longer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..ir.graph import Graph, Node
from ..ir.tables import LOWER, UPPER, Table, table_of
from .derivatives import tangents

__all__ = ["knot_limits", "table_nodes"]

_PASSED = {-1: 1e-11, 0: 1e-6, 1: 1e-4}
"""Share of the time between two knots that a step may take which passes one, by how many derivatives are continuous."""
_SMOOTH = 1e-3

_INEXACT = 0.05
"""Share of the way that a prediction is off which goes as far as to the knot after the next."""

_NEVER, _TINY = 1e100, 1e-300
_DEAREST = 3000.0
"""Cost of a slope whose own derivative is not taken."""


def table_nodes(graph: Graph, nodes: Sequence[Node]) -> list[tuple[Node, Table, int]]:
    """Return the tables that values depend on: argument, table, and order of the derivative."""
    found: list[tuple[Node, Table, int]] = []
    if not any(node.op == "table" for node in graph.nodes):
        return found
    for node in graph.topological(nodes):
        if node.op == "table":
            x, key, order = node.args
            assert key.number is not None and order.number is not None
            found.append((x, table_of(float(key.number)), int(order.number)))
    return found


def knot_limits(
    graph: Graph, rates: Sequence[Node], state: Sequence[Node], time: Node, moving: int
) -> tuple[Node, Node] | None:
    """Return the largest size of the next step, forward and backward in time; None where no table limits it.

    Parameters
    ----------
    graph : Graph
        Of all nodes.
    rates, state : sequence of Node
        Of the state, and its components.
    time : Node
        The time.
    moving : int
        Dependency bits of what changes along a motion.
    """
    smoothness: dict[tuple[Node, int], int] = {}
    with_edges: dict[bytes, int] = {}  # one table for all with the same knots
    for x, table, order in table_nodes(graph, rates):
        if x.deps & moving:
            same = x, with_edges.setdefault(table.edges.tobytes(), table.key)
            smoothness[same] = min(smoothness.get(same, 9), table.smoothness - order)
    if not smoothness:
        return None
    flow = dict(zip(state, rates, strict=True)) | {time: graph.one}
    limits: list[list[Node]] = [[], []]
    for (x, key), smooth in smoothness.items():
        (slope,) = tangents(graph, [x], flow)
        plain = slope.cost < _DEAREST and not table_nodes(graph, [slope])
        bend = tangents(graph, [slope], flow)[0] if plain else graph.zero
        course = _Course(graph, x, table_of(key), _PASSED.get(max(smooth, -1), _SMOOTH))
        limits[0].append(course.limit(slope, bend))
        limits[1].append(course.limit(-slope, bend))
    least = []
    for several in limits:
        first, *rest = several
        for other in rest:
            first = graph.call("min", first, other)
        least.append(first)
    return least[0], least[1]


@final
class _Course:
    """The way of an argument through the pieces of a table."""

    def __init__(self, graph: Graph, x: Node, table: Table, passed: float) -> None:
        self.graph, self.passed = graph, graph.const(passed)
        key = graph.const(table.key)
        place = graph.call("piece", x, key)
        self.up = graph.call("entry", place, key, graph.const(UPPER)) - x
        self.down = x - graph.call("entry", place, key, graph.const(LOWER))
        self.width = graph.const(table.spacing)

    def limit(self, slope: Node, bend: Node) -> Node:
        """Return the largest size of a step, from the slope and the second derivative in the direction of time."""
        g = self.graph
        arrival = g.call("min", self._arrival(slope, bend, self.up), self._arrival(-slope, -bend, self.down))
        size = g.call("abs", slope)
        root = g.call("sqrt", slope * slope + 2 * g.call("abs", bend) * self.width)
        between = 2 * self.width / (size + root + g.const(_TINY))
        least = self.passed * between
        before = g.call("min", g.const(_INEXACT) * arrival * arrival / between, g.const(0.5) * arrival)
        before = g.call("max", before, g.const(0.5) * least)
        return g.call("select", g.call("less", least, arrival), arrival - before, arrival + g.const(0.5) * least)

    def _arrival(self, slope: Node, bend: Node, gap: Node) -> Node:
        """Return the first time at which slope t + bend t^2/2 is the gap, `_NEVER` where there is none."""
        g = self.graph
        square = slope * slope + 2 * bend * gap
        root = g.call("sqrt", g.call("max", square, g.zero))
        away = g.call("less", slope, g.zero)
        over = g.call("select", away, root - slope, 2 * gap)
        under = g.call("select", away, bend, slope + root)
        possible = g.call("less_equal", g.zero, square) * g.call("less", g.zero, under)
        found = over / g.call("select", possible, under, g.one)
        return g.call("select", possible, g.call("min", found, g.const(_NEVER)), g.const(_NEVER))
