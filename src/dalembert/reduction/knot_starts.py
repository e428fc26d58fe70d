"""States on knots and switches, where rates jump: [state, rates] -> [state on the side that the motion takes].

A table of kind "hold" in a load jumps at its knots. A motion that begins there at rest goes to one of two sides, and
the rates at the knot itself are those of the side above. Steps that begin on the wrong side are off by the jump times
the time in which rounding is left behind, some 1e-8 s, and Runge-Kutta steps cannot leave at all. So the start is moved
by rounding to the side that it leaves to, which the derivatives of the argument on either side decide. The same holds
for switches of the state (`switch_sides`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from ..ir.graph import Graph, Node
from ..ir.kernel import Kernel
from ..ir.tables import Table
from ..transforms.conditions import decide
from ..transforms.derivatives import cotangents
from ..transforms.lower_kernels import lower_kernel
from ..transforms.pipelines import PassRecord
from .base import ReducedSystem
from .departures import Departures
from .jumps import Jump, has_jumps, jumps_of
from .switch_sides import SwitchSides

__all__ = ["KnotStarts", "knot_sides"]

_TINY = 1e-30
_AT_START = 5
"""Order of the derivatives that decide at a start."""
_ORDER = 8
"""Order of the derivatives that decide in the course of a run: a force that begins as t^6 shows in that of a
coordinate."""
_REACH = 2.0
"""Margins within which a state is on a jump that may have been moved before."""
_LEAST = 3
"""Number of derivatives of the argument of a table that decide at least, however dear."""


@final
class KnotStarts:
    """Moves of a start off the knots of tables and off switches.

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
        self,
        graph: Graph,
        system: ReducedSystem,
        state: Sequence[Node],
        direction: Node | None = None,
        order: int = _AT_START,
    ) -> None:
        self.graph, self.state = graph, list(state)
        self.sliding: list[tuple[str, Node]] = []
        jumps = jumps_of(graph, system)
        if not jumps:
            return
        self.reach = graph.const(1.0 if direction is None else _REACH)
        self.departures = Departures(graph, system, graph.one if direction is None else direction, order)
        for jump in jumps:
            if jump.table is not None:
                self._move(jump, jump.table)
        switches = [jump for jump in jumps if jump.table is None]
        if switches:
            self.state = SwitchSides(self.departures, switches, self.reach).left_to(self.state)

    def _move(self, jump: Jump, table: Table) -> None:
        """Move the start to a side of one knot, where it is at one."""
        g, at = self.graph, self.departures.at
        here, margin = at([jump.argument, jump.margin], self.state)
        within = self.reach * margin
        gap = here - jump.place(g, here, within)
        near = g.call("less_equal", gap, within)
        to_edge = g.call("select", near, -gap, g.zero)
        to_side = g.call("select", near, -gap - margin, g.zero)
        slopes = at(cotangents(g, [jump.argument], [g.one], self.departures.inputs), self.state)
        square = g.sum(slope * slope for slope in slopes)
        ways = [slope / g.call("max", square, g.const(_TINY)) for slope in slopes]
        above, below = ([y + way * far for y, way in zip(self.state, ways, strict=True)] for far in (to_edge, to_side))
        (derivatives,) = self.departures.derivatives([jump.argument], _LEAST)
        up, down = (self.departures.leading(at(derivatives, side), margin) for side in (above, below))
        leaves = near * g.call("less", up, g.zero)  # the side above
        lower = leaves * g.call("less_equal", down, g.zero)
        self.sliding.append((table.name, leaves * g.call("less", g.zero, down)))
        higher = near * g.call("less_equal", g.zero, up) * g.call("less", gap, g.zero)
        far = g.call("select", lower, to_side, to_edge)
        moves = g.call("max", lower, higher)
        self.state = [g.call("select", moves, y + way * far, y) for y, way in zip(self.state, ways, strict=True)]


def knot_sides(
    system: ReducedSystem, places: Mapping[Node, tuple[str, int | None]], records: list[PassRecord] | None = None
) -> list[Kernel]:
    """Return the kernels ``near_knots`` and ``knot_sides``, none where no motion needs them.

    The first is 1 where a state is on a knot or a switch, else 0. The outputs of the second are the state on the sides
    to which a motion goes, forwards in time and backwards (n_y each), and for each table 1 where neither side lets the
    motion go backwards, else 0. They stand where the conditions of a motion change in its course, as at knots of
    inputs: one that rests may leave then. Switches count in scenes with inputs, conditions on time or controllers.

    Parameters
    ----------
    system : ReducedSystem
        In any formulation.
    places : mapping of Node to (str, int or None)
        Array and index of each input of the graph.
    """
    equations = system.equations
    stops = bool(equations.symbols.input_names or equations.controllers or decide(equations.conditions))
    if not has_jumps(system, switches=stops):
        return []
    graph = Graph()  # of its own: forms of other kernels do not depend on it
    state = graph.adopt(list(system.inputs))
    ahead, back = (KnotStarts(graph, system, state, turned, _ORDER) for turned in (graph.one, -graph.one))
    inputs = {graph.input(str(node.payload)): place for node, place in places.items()}
    outputs = [*ahead.state, *back.state, *(slides for _, slides in back.sliding)]
    near = graph.zero
    for jump in jumps_of(graph, system):
        near = graph.call("max", near, jump.near(graph, graph.const(_REACH)))
    return [
        lower_kernel(graph, name, nodes, inputs, records=records)
        for name, nodes in (("near_knots", [near]), ("knot_sides", outputs))
    ]
