"""Limits of steps that are no Taylor steps at zeros of lengths: [rates on the graph] -> [sizes of the next step].

A force along a line turns round where its length sqrt(x^2 + y^2) passes through zero. Runge-Kutta methods notice that
where a stage lies behind the zero. A passage so slow that the length comes back between two stages would not be seen.
So a step goes no farther than a little beyond the time that the length has left at its present rate: near a turning
point that halves the way to it, so that a step ends behind the zero if there is one. A near miss is passed in steps as
they are, because there the rate vanishes before the length does. Taylor steps have bounds (`root_steps`).
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from .derivatives import GUARDED, tangents

__all__ = ["zero_limits"]

_BEYOND = 1.1
"""Share of the time left to a zero that a step may take; more than 1, so that steps pass it."""

_NEVER = 1e30


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
    never = graph.const(_NEVER)
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
