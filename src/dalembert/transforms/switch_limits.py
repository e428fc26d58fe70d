"""Limits of steps that are no Taylor steps at kinks and jumps: [rates on the graph] -> [sizes of the next step].

Runge-Kutta methods notice that a comparison, a sign or an absolute value switches where a stage lies behind the zero of
what decides it. An excursion so short that it ends between two stages would not be seen. It has a turning point behind
the zero, so that a step which ends between here and there is enough: it goes no farther than a little beyond the time
that the value has left at its present rate, which halves the way to the turning point.

Two things set no limit. Where the value falls as an exponential function does, or more slowly, it is about to stay away
from zero; a limit would be one of stiff decay. And where it is about to pass zero with hardly any curvature, no turning
point is near: what sticks at a jump would make shorter and shorter steps there. Taylor steps have bounds
(`dalembert.transforms.switch_steps`).
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from .derivatives import GUARDED, tangents
from .linear import SET_ASIDE

__all__ = ["switch_limits"]

_BEYOND = 1.1
"""Share of the time left to a zero that a step may take; more than 1, so that steps pass it."""
_DECAYS = 0.99
"""Value times second derivative over the square of the slope, which is 1 for an exponential function and less for
everything that comes to zero."""
_STRAIGHT, _TURN = 0.2, 0.5
"""The same where the value counts as straight up to its zero, and the share of the time to the turning point that a
step may take then."""

_NEVER, _TINY = 1e30, 1e-300


def switch_limits(
    graph: Graph, rates: Sequence[Node], state: Sequence[Node], time: Node, moving: int
) -> tuple[Node, Node] | None:
    """Return the largest size of the next step, forward and backward in time; None where nothing limits it.

    Parameters are those of `knot_limits`.
    """
    gaps = _distances(graph, rates, moving)
    if not gaps:
        return None
    flow = dict(zip(state, rates, strict=True)) | {time: graph.one}
    slopes = tangents(graph, gaps, flow, GUARDED)
    bends = tangents(graph, slopes, flow, GUARDED)
    forward = backward = never = graph.const(_NEVER)
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
    return way / (rate + graph.const(_TINY))
