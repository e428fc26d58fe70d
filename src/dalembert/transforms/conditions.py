"""Conditions on time and parameters alone, each constant within a segment of a run.

Between the times at which such a condition changes, the breaks, it is decided once, at one time within, which is a
further parameter of the scene. So what is computed along a segment is smooth in time, whichever side of a break it is
asked for, and steps end at breaks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import final

from ..frozen import frozen
from ..ir.conditions import NARROW, WHOLE, ZERO
from ..ir.graph import Graph
from ..ir.node import Node
from .derivatives import tangents


@final
@frozen
class Condition:
    """A condition that makes breaks where `function`, of time and parameters, is zero or whole.

    Of a narrow one, `sharpness` is the inverse square of the time [1/s^2] within which it happens, if that is positive.
    """

    function: Node
    kind: str
    sharpness: Node | None = None


def decide(conditions: Iterable[Condition]) -> bool:
    """Return whether any condition has breaks."""
    return any(condition.kind != NARROW for condition in conditions)


def condition_on(graph: Graph, function: Node, kind: str) -> Condition:
    """Return a condition on a function; the zeros of a sine or cosine are found from its argument."""
    node = min(function, -function, key=lambda value: value.fingerprint)
    node = node.args[0] if node.op == "neg" else node
    if kind == ZERO and node.op in ("sin", "cos"):
        half_turns = node.args[0] / graph.named_constant("pi", math.pi)
        return Condition(half_turns if node.op == "sin" else half_turns + graph.node(0.5), WHOLE)
    return Condition(node, kind)


def narrow_conditions(graph: Graph, op: str, node: Node, time: Node, exponent: float = -1.0) -> list[Condition]:
    """Return where an operation on a function of time and parameters may have a pulse or a smooth step, and how short.

    Pulses are where the logarithm of the result has a maximum, and as wide as its second derivative says; steps are
    where an exponential or hyperbolic function passes through its argument 0.

    Parameters
    ----------
    op : str
        ``exp``, ``tanh``, ``atan``, ``sinh``, ``cosh``, or ``pow`` for a power with a fixed `exponent` other than 0.
    """
    (rate,) = tangents(graph, [node], {time: graph.one})
    if rate.is_zero:
        return []
    (bend,) = tangents(graph, [rate], {time: graph.one})
    found: list[Condition] = []
    if op == "pow":
        sharpness = -graph.node(exponent) * bend / node
    elif op == "exp":
        sharpness = -bend
    else:
        sharpness = graph.call("abs", bend) / (1 + node * node)
    if rate.deps & time.deps and not sharpness.is_zero:
        found.append(Condition(rate, NARROW, sharpness))
    if op != "pow":
        found.append(Condition(node, NARROW, rate * rate))
    return found
