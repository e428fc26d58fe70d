"""Limits of steps that are no Taylor steps: at knots of tables, at kinks and jumps, and at zeros of lengths.

A step that begins before a knot shall end just before it, the next one just behind it. When an argument x meets the
knot follows from its slope and its second derivative along the motion; the farther off, the less exactly, so that a
step ends the farther before it. A step may pass the knot when that is short: the smoother the table, the longer.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import final

from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.ops import TABLE_ARGUMENTS
from ..ir.surfaces import surface_of
from ..ir.tables import LOWER, UPPER, Table, table_of
from .derivatives import GUARDED, tangents
from .linear import SET_ASIDE

_PASSED = {-1: 1e-11, 0: 1e-6, 1: 1e-4}
"""Share of the time between two knots that a step may take which passes one, by how many derivatives are continuous."""
_SMOOTH = 1e-3

_INEXACT = 0.05
"""Share of the way that a prediction is off which goes as far as to the knot after the next."""

_NEVER, _TINY = 1e100, 1e-300
_DEAREST = 3000.0
"""Cost of a slope whose own derivative is not taken."""


def table_nodes(graph: Graph, nodes: Sequence[Node]) -> list[tuple[Node, Table, int]]:
    """Return the tables, and axes of surfaces, that values depend on: argument, table, order of the derivative."""
    found: list[tuple[Node, Table, int]] = []
    if not any(node.op in ("table", "surface") for node in graph.nodes):
        return found
    for node in graph.topological(nodes):
        found += own_tables(node)
    return found


def own_tables(node: Node) -> list[tuple[Node, Table, int]]:
    """Return the table of a node, or the axes of its surface, as `table_nodes`; nothing for other operations."""
    if node.op not in ("table", "surface"):
        return []
    count = TABLE_ARGUMENTS[node.op]
    key, *orders = node.args[count:]
    number = float(key.number or 0)
    axes = (table_of(number),) if node.op == "table" else surface_of(number).axes
    return [(x, axis, int(n.number or 0)) for x, axis, n in zip(node.args[:count], axes, orders, strict=True)]


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


# Limits of steps that are no Taylor steps at kinks and jumps: [rates on the graph] -> [sizes of the next step].
#
# Runge-Kutta methods notice that a comparison, a sign or an absolute value switches where a stage lies behind the zero
# of what decides it. An excursion so short that it ends between two stages would not be seen. It has a turning point
# behind the zero, so that a step which ends between here and there is enough: it goes no farther than a little beyond
# the time that the value has left at its present rate, which halves the way to the turning point.
#
# Two things set no limit. Where the value falls as an exponential function does, or more slowly, it is about to stay
# away from zero; a limit would be one of stiff decay. And where it is about to pass zero with hardly any curvature, no
# turning point is near: what sticks at a jump would make shorter and shorter steps there. Taylor steps have bounds
# (`dalembert.transforms.taylor.switch_steps`).

_BEYOND = 1.1
"""Share of the time left to a zero that a step may take; more than 1, so that steps pass it."""
_DECAYS = 0.99
"""Value times second derivative over the square of the slope, which is 1 for an exponential function and less for
everything that comes to zero."""
_STRAIGHT, _TURN = 0.2, 0.5
"""The same where the value counts as straight up to its zero, and the share of the time to the turning point that a
step may take then."""

_FAR, _SMALLEST = 1e30, 1e-300


def switch_limits(
    graph: Graph, rates: Sequence[Node], state: Sequence[Node], time: Node, moving: int, aside: Collection[Node] = ()
) -> tuple[Node, Node] | None:
    """Return the largest size of the next step, forward and backward in time; None where nothing limits it.

    Parameters are those of `knot_limits`, and the values `aside`, whose zeros set no limit.
    """
    gaps = [gap for gap in _distances(graph, rates, moving) if gap not in aside and -gap not in aside]
    if not gaps:
        return None
    flow = dict(zip(state, rates, strict=True)) | {time: graph.one}
    slopes = tangents(graph, gaps, flow, GUARDED)
    bends = tangents(graph, slopes, flow, GUARDED)
    forward = backward = never = graph.const(_FAR)
    for gap, slope, bend in zip(gaps, slopes, bends, strict=True):
        side = graph.call("sign", gap)
        limit = _limit(graph, side * gap, slope, side * bend)
        for falls in (True, False):
            falling = (
                graph.call("less", side * slope, graph.zero) if falls else graph.call("less", graph.zero, side * slope)
            )
            own = graph.call("select", falling, limit, never)
            if falls:
                forward = graph.call("min", forward, own)
            else:
                backward = graph.call("min", backward, own)
    return forward, backward


def _distances(graph: Graph, rates: Sequence[Node], moving: int) -> list[Node]:
    """Return the distances of values from where an operation on them has a kink or a jump, guards of pivots aside."""
    found: dict[Node, None] = {}
    nodes = list(graph.topological(rates))
    guards = {node.args[0] for node in nodes if node.op == "select" and node.args[2].number == SET_ASIDE}
    for node in nodes:
        if node in guards:
            continue
        if node.op in ("abs", "sign"):
            values = [node.args[0]]
        elif node.op in ("less", "less_equal", "min", "max"):
            values = [node.args[0] - node.args[1]]
        elif node.op == "floor":
            below = node.args[0] - node
            values = [below, 1 - below]
        else:
            continue
        for value in values:
            if value.deps & moving and -value not in found:
                found[value] = None
    return list(found)


def _limit(graph: Graph, gap: Node, slope: Node, bend: Node) -> Node:
    """Return the largest size of a step at a distance from a zero that is approached, its rate and its second rate."""
    square, speed, steep = slope * slope, graph.call("abs", slope), graph.call("abs", bend)
    straight = graph.call("less", gap * steep, graph.const(_STRAIGHT) * square)
    decays = graph.call("less", graph.const(_DECAYS) * square, gap * bend)
    way = graph.call("select", straight, graph.const(_TURN) * speed, graph.const(_BEYOND) * gap)
    rate = graph.call("select", straight, steep, graph.call("select", decays, graph.zero, speed))
    return way / (rate + graph.const(_SMALLEST))


# Limits of steps that are no Taylor steps at zeros of lengths: [rates on the graph] -> [sizes of the next step].
#
# A force along a line turns round where its length sqrt(x^2 + y^2) passes through zero. Runge-Kutta methods notice
# that where a stage lies behind the zero. A passage so slow that the length comes back between two stages would not be
# seen. So a step goes no farther than a little beyond the time that the length has left at its present rate: near a
# turning point that halves the way to it, so that a step ends behind the zero if there is one. A near miss is passed
# in steps as they are, because there the rate vanishes before the length does. Taylor steps have bounds
# (`root_steps`).

_NO_ZERO = 1e30


def zero_limits(
    graph: Graph, rates: Sequence[Node], state: Sequence[Node], time: Node, moving: int
) -> tuple[Node, Node] | None:
    """Return the largest size of the next step, forward and backward in time; None where nothing limits it.

    Parameters are those of `knot_limits`, with dependency bits `moving` of the components of the state alone.
    """
    lengths = [node for node in _vanishing(graph, rates) if node.deps & moving]
    if not lengths:
        return None
    flow = dict(zip(state, rates, strict=True)) | {time: graph.one}
    never = graph.const(_NO_ZERO)
    forward = backward = never
    for length, slope in zip(lengths, tangents(graph, lengths, flow, GUARDED), strict=True):
        for falls in (slope, -slope):
            falling = graph.call("less", falls, graph.zero)
            time_left = length / graph.call("select", falling, -falls, graph.one)
            limit = graph.call("select", falling, graph.const(_BEYOND) * time_left, never)
            if falls is slope:
                forward = graph.call("min", forward, limit)
            else:
                backward = graph.call("min", backward, limit)
    return forward, backward


def _vanishing(graph: Graph, rates: Sequence[Node]) -> list[Node]:
    """Return the square roots that may vanish: of all but sums of squares and a positive number."""
    least: dict[int, float] = {}  # lower bounds of values that are positive or zero
    found = []
    for node in graph.topological(rates):
        args = node.args
        bounds = [least.get(arg.index) if arg.number is None else float(arg.number) for arg in args]
        if node.op in ("abs", "sqrt", "exp", "cosh") or (node.op == "mul" and args[0] is args[1]):
            least[node.index] = 0.0
        elif node.op in ("add", "mul") and all(bound is not None and bound >= 0.0 for bound in bounds):
            first, second = (bound or 0.0 for bound in bounds)
            least[node.index] = first + second if node.op == "add" else first * second
        if node.op == "sqrt" and not least.get(args[0].index, 0.0) > 0.0:
            found.append(node)
    return found


# Limits of steps that are no Taylor steps: at knots of tables, at zeros of lengths, at kinks and jumps.


def step_limits(
    graph: Graph,
    rates: Sequence[Node],
    state: Sequence[Node],
    time: Node,
    parameters: Sequence[str],
    aside: Collection[Node] = (),
) -> tuple[Node, ...] | None:
    """Return the largest size of a step, forward and backward in time; None where nothing limits it.

    Parameters
    ----------
    graph : Graph
        Of all nodes.
    rates, state : sequence of Node
        Of the state, and its components.
    time : Node
        The time.
    parameters : sequence of str
        Names of all inputs that do not change along a motion.
    aside : collection of Node
        Values at whose zeros kinks and jumps set no limit.
    """
    own, moving = (rates, state, time), ~graph.mask(parameters)
    inputs = graph.mask(str(node.payload) for node in state)
    found = [knot_limits(graph, *own, moving), zero_limits(graph, *own, inputs)]
    found.append(switch_limits(graph, *own, moving, aside))
    least: tuple[Node, ...] | None = None
    for limits in found:
        if least is None or limits is None:
            least = limits if least is None else least
        else:
            least = tuple(graph.call("min", a, b) for a, b in zip(least, limits, strict=True))
    return least
