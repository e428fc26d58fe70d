"""States on knots and switches, where rates jump: [state, rates] -> [state on the side that the motion takes].

A table of kind "hold" in a load jumps at its knots. A motion that begins there at rest goes to one of two sides, and
the rates at the knot itself are those of the side above. Steps that begin on the wrong side are off by the jump times
the time in which rounding is left behind, some 1e-8 s, and Runge-Kutta steps cannot leave at all. So the start is moved
by rounding to the side that it leaves to, which the derivatives of the argument on either side decide. The same holds
for switches of the state (`switch_sides`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import final

from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..ir.tables import Table
from ..transforms.conditions import decide
from ..transforms.derivatives import GUARDED, cotangents, tangents
from ..transforms.lower_kernels import lower_kernel
from ..transforms.pipelines import PassRecord
from .base import ReducedSystem
from .jumps import NEAREST, Jump, has_jumps, jumps_of

# Directions in which functions of the state leave a place: signs of their first derivatives along the motion.

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


# Sides of switches: [state on switches] -> [state on the sides to which the motion goes].
#
# A switch is an operation of the state with a jump or a kink: `sign`, `Heaviside`, `floor`, `Abs`, `Min`, `Max`, the
# conditions of a `Piecewise`. The rates at the switch itself may be those of neither side, as sign(0) is 0. They say
# whether a motion that is there rests, and which way it begins. It goes to that side if the rates there take it the
# same way, else to the other side if those there take it that way. Where both sides push it back, it stays. All
# switches that a state is on are decided at once, because forces at one may depend on the side of another.
#
# At a kink nothing has to be decided. The state is moved all the same: a coordinate that rests at 1.5 stays there by
# rounding for 1e-8 s, whatever moves it, and until then steps do not know the side. Rounding at 0 is not so coarse.

_TINY = 1e-30
_CONTINUOUS = 1e-9
"""Share of a rate within which its values on two sides of a switch are equal."""
_SWEEPS = 3
"""Rounds of moves where the arguments of two switches depend on the same components of the state."""


@final
class SwitchSides:
    """Moves of a state off switches.

    Parameters
    ----------
    departures : Departures
        Derivatives along the motion.
    switches : sequence of Jump
    reach : Node
        Distance within which a state is on a switch, in margins.
    """

    def __init__(self, departures: Departures, switches: Sequence[Jump], reach: Node) -> None:
        self.departures, self.switches, self.graph, self.reach = departures, switches, departures.graph, reach
        g = self.graph
        self._slopes = [cotangents(g, [switch.argument], [g.one], departures.inputs, GUARDED) for switch in switches]
        self._derivatives = departures.derivatives([switch.argument for switch in switches])

    def left_to(self, state: Sequence[Node]) -> list[Node]:
        """Return a state, moved to the sides to which the motion goes where it is on switches."""
        g, zero = self.graph, self.graph.zero
        at = [self.departures.at([switch.argument, switch.margin], state) for switch in self.switches]
        places = [
            switch.place(g, here, self.reach * margin) for switch, (here, margin) in zip(self.switches, at, strict=True)
        ]
        margins = [margin for _, margin in at]
        gaps = [here - place for (here, _), place in zip(at, places, strict=True)]
        near = [
            g.call("less_equal", g.call("abs", gap), self.reach * margin)
            for gap, margin in zip(gaps, margins, strict=True)
        ]
        ways = self._leading(state, margins)
        begins = [
            is_near * (g.call("less", zero, way) - g.call("less", way, zero))
            for is_near, way in zip(near, ways, strict=True)
        ]
        ahead, behind = (self._moved(state, places, margins, sides) for sides in (begins, [-side for side in begins]))
        jumps, taken = g.call("max", self._jump(ahead, behind), self._jump(ahead, state)), []
        there, back = self._leading(ahead, margins), self._leading(behind, margins)
        for side, gap, margin, first, second in zip(begins, gaps, margins, there, back, strict=True):
            goes = g.call("less_equal", zero, side * first)
            turns = (1 - goes) * g.call("less", side * second, zero)
            side = side * (goes - turns) * g.call("max", jumps, g.call("less", g.const(NEAREST), margin))
            taken.append(side * g.call("less_equal", side * gap, zero))  # 0 where it is on that side already
        return self._moved(state, places, margins, taken)

    def _leading(self, state: Sequence[Node], margins: Sequence[Node]) -> list[Node]:
        """Return what has the sign of the motion of each argument from a state."""
        flat = self.departures.at([node for row in self._derivatives for node in row], state)
        rows, first = [], 0
        for row, margin in zip(self._derivatives, margins, strict=True):
            rows.append(self.departures.leading(flat[first : first + len(row)], margin))
            first += len(row)
        return rows

    def _moved(
        self, state: Sequence[Node], places: Sequence[Node], margins: Sequence[Node], sides: Sequence[Node]
    ) -> list[Node]:
        """Return a state with each argument moved a margin to a side (1 or -1) of its place, or not at all (0)."""
        g, moved = self.graph, list(state)
        for _ in range(_SWEEPS if self._overlap() else 1):
            for i, switch in enumerate(self.switches):
                here, *slopes = self.departures.at([switch.argument, *self._slopes[i]], moved)
                far = places[i] + sides[i] * margins[i] - here
                far = far / g.call("max", g.sum(slope * slope for slope in slopes), g.const(_TINY))
                moved = [
                    y if slope.is_zero else g.call("select", sides[i], y + slope * far, y)
                    for y, slope in zip(moved, slopes, strict=True)
                ]
        return moved

    def _overlap(self) -> bool:
        """Return whether two arguments depend on the same component of the state."""
        used = [{m for m, slope in enumerate(slopes) if not slope.is_zero} for slopes in self._slopes]
        return sum(map(len, used)) > len(set().union(*used))

    def _jump(self, ahead: Sequence[Node], behind: Sequence[Node]) -> Node:
        """Return 1 where rates at two states differ by more than a smooth function of the state does, else 0."""
        g, excess = self.graph, self.graph.zero
        both = (self.departures.at(self.departures.rates, state) for state in (ahead, behind))
        for a, b in zip(*both, strict=True):
            size = g.call("abs", a) + g.call("abs", b)
            excess = g.call("max", excess, g.call("abs", a - b) - g.const(_CONTINUOUS) * size)
        return g.call("less", g.zero, excess)


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
        Name of a table, and a node that is 1 where neither branch continues the motion, else 0.
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
    to which a motion goes, forwards in time and backwards (n_y each), and for each table 1 where neither branch
    continues the motion backwards, else 0. They are where the conditions of a motion change, as at knots of
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
