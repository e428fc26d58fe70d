"""Limits of steps that are no Taylor steps: at knots of tables, at zeros of lengths, at kinks and jumps."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from ..transforms.knot_limits import knot_limits
from ..transforms.switch_limits import switch_limits
from ..transforms.zero_limits import zero_limits

__all__ = ["step_limits"]


def step_limits(
    graph: Graph, rates: Sequence[Node], state: Sequence[Node], time: Node, parameters: Sequence[str]
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
    """
    own, moving = (rates, state, time), ~graph.mask(parameters)
    inputs = graph.mask(str(node.payload) for node in state)
    found = [knot_limits(graph, *own, moving), zero_limits(graph, *own, inputs), switch_limits(graph, *own, moving)]
    least: tuple[Node, ...] | None = None
    for limits in found:
        if least is None or limits is None:
            least = limits if least is None else least
        else:
            least = tuple(graph.call("min", a, b) for a, b in zip(least, limits, strict=True))
    return least
