"""Starts at rest on a knot where rates jump: [state, rates] -> [state on the side that the motion takes].

A table of kind "hold" in a load jumps at its knots. A motion that begins there at rest goes to one of two sides, and
the rates at the knot itself are those of the side above. Steps that begin on the wrong side are off by the jump times
the time in which rounding is left behind, some 1e-8 s, and Runge-Kutta steps cannot leave at all. So the start is moved
by rounding to the side that it leaves to, which the derivatives of the argument on either side decide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from ..ir.graph import Graph, Node
from ..ir.kernel import Kernel
from ..ir.tables import LOWER, Table
from ..methods.step_constants import EPSILON
from ..transforms.derivatives import GUARDED, cotangents, tangents
from ..transforms.knot_limits import table_nodes
from ..transforms.lower_kernels import lower_kernel
from ..transforms.pipelines import PassRecord
from .base import ReducedSystem

__all__ = ["KnotStarts", "jumping_arguments", "knot_sides"]

_MARGIN = 8.0 * EPSILON
"""Share of the largest knot within which an argument counts as at a knot; steps at knots have the same."""

_TINY = 1e-30
_DEAREST = 3000.0
"""Cost of a second derivative whose own derivative is not taken."""


def jumping_arguments(system: ReducedSystem) -> list[tuple[Node, Table]]:
    """Return the arguments of tables at whose knots the rates jump, each with its table; all depend on the state."""
    graph = system.equations.graph
    state = graph.mask(str(node.payload) for node in system.inputs)
    found = {
        (x, table.edges.tobytes()): (x, table)  # one table for all with the same knots
        for x, table, order in table_nodes(graph, system.rhs)
        if table.smoothness < order and x.deps & state
    }
    return list(found.values())


@final
class KnotStarts:
    """Moves of a start off the knots of tables.

    Parameters
    ----------
    graph : Graph
        Takes the nodes.
    system : ReducedSystem
        Its rates, on a graph of their own.
    state : sequence of Node
        The start, in terms of what is given.
    direction : Node, optional
        1 or -1, the direction of time; forwards without it. The state may then be one that was moved before, for a run
        forwards.

    Attributes
    ----------
    state : list of Node
        The start, by rounding on the side that the motion goes to.
    sliding : list of (str, Node)
        Name of a table, and a node that is 1 where neither side lets the motion go, else 0.
    """

    def __init__(
        self, graph: Graph, system: ReducedSystem, state: Sequence[Node], direction: Node | None = None
    ) -> None:
        self.graph, self.state = graph, list(state)
        self.direction, self.reach = (graph.one, _MARGIN) if direction is None else (direction, 2.0 * _MARGIN)
        self.sliding: list[tuple[str, Node]] = []
        arguments = jumping_arguments(system)
        if not arguments:
            return
        self.inputs = graph.adopt(list(system.inputs))
        (time,) = graph.adopt([system.equations.time])
        self.flow = dict(zip(self.inputs, graph.adopt(list(system.rhs)), strict=True)) | {time: graph.one}
        for x, table in arguments:
            self._move(graph.adopt([x])[0], table)

    def _at(self, nodes: Sequence[Node], state: Sequence[Node]) -> list[Node]:
        return self.graph.substitute(nodes, dict(zip(self.inputs, state, strict=True)))

    def _move(self, x: Node, table: Table) -> None:
        """Move the start to the side of one knot, where it is at one."""
        g = self.graph
        size = max(abs(table.first), abs(table.last), table.spacing)
        margin = g.const(_MARGIN * size)
        key = g.const(table.key)
        here, within = self._at([x], self.state)[0], g.const(self.reach * size)
        edge = g.call("entry", g.call("piece", here + within, key), key, g.const(LOWER))
        near = g.call("less_equal", here - within, edge)
        to_edge = g.call("select", near, edge - here, g.zero)
        to_side = g.call("select", near, edge - here - margin, g.zero)
        slopes = self._at(cotangents(g, [x], [g.one], self.inputs), self.state)
        square = g.sum(slope * slope for slope in slopes)
        ways = [slope / g.call("max", square, g.const(_TINY)) for slope in slopes]
        above, below = ([y + way * far for y, way in zip(self.state, ways, strict=True)] for far in (to_edge, to_side))
        derivatives = self._derivatives(x)
        up = self._leading(self._at(derivatives, above), margin)
        down = self._leading(self._at(derivatives, below), margin)
        leaves = near * g.call("less", up, g.zero)  # the side above
        lower = leaves * g.call("less_equal", down, g.zero)
        self.sliding.append((table.name, leaves * g.call("less", g.zero, down)))
        higher = near * g.call("less_equal", g.zero, up) * g.call("less", here, edge)
        far = g.call("select", lower, to_side, to_edge)
        moves = g.call("max", lower, higher)
        self.state = [g.call("select", moves, y + way * far, y) for y, way in zip(self.state, ways, strict=True)]

    def _derivatives(self, x: Node) -> list[Node]:
        """Return the first three derivatives of an argument along the motion; the third is 0 where it is dear.

        They are those by the time that the motion takes, whichever way it runs.
        """
        found = [x]
        for _ in range(3):
            dear = found[-1].cost > _DEAREST and len(found) > 2
            found += [self.graph.zero] if dear else tangents(self.graph, found[-1:], self.flow, GUARDED)
        slope, bend, third = found[1:]
        return [self.direction * slope, bend, self.direction * third]

    def _leading(self, derivatives: Sequence[Node], margin: Node) -> Node:
        """Return the derivative that takes an argument out of a margin first: its sign is that of the motion."""
        g = self.graph
        slope, bend, third = derivatives
        slopes, bends, thirds = (g.call("abs", node) for node in derivatives)
        fast = g.call("less", 2 * bends * margin, slopes * slopes)
        fast = fast * g.call("less", margin * margin * thirds, 6 * slopes * slopes * slopes)
        bent = g.call("less", 2 * margin * thirds * thirds, 9 * bends * bends * bends)
        return g.call("select", fast, slope, g.call("select", bent, bend, third))


def knot_sides(
    system: ReducedSystem, places: Mapping[Node, tuple[str, int | None]], records: list[PassRecord] | None = None
) -> Kernel | None:
    """Return the kernel ``knot_sides`` from a state to that on the sides of knots to which its motion goes.

    None where no motion needs it. Its outputs are the state of a motion forwards in time and backwards (n_y each), and
    for each table 1 where neither side lets the motion go backwards, else 0. It stands where the conditions of a motion
    change in its course, as at knots of inputs: one that rests on the knot of a table may leave it then.

    Parameters
    ----------
    system : ReducedSystem
        In any formulation.
    places : mapping of Node to (str, int or None)
        Array and index of each input of the graph.
    """
    if not jumping_arguments(system):
        return None
    graph = Graph()  # of its own: forms of other kernels do not depend on it
    state = graph.adopt(list(system.inputs))
    ahead, back = (KnotStarts(graph, system, state, turned) for turned in (graph.one, -graph.one))
    inputs = {graph.input(str(node.payload)): place for node, place in places.items()}
    outputs = [*ahead.state, *back.state, *(slides for _, slides in back.sliding)]
    return lower_kernel(graph, "knot_sides", outputs, inputs, records=records)
