"""Checks of constraints for kinks, and of tables for smoothness: [constraints on the graph] -> [faults].

Where the gradient of a holonomic constraint jumps in a configuration, as that of ``Abs(x) - y`` at x = 0, velocities
that obey it would have to jump too: an impact without a law. So with coefficients of nonholonomic constraints. Whether
they jump is measured: between two points on either side of what a switch decides by, which halving brings together.
The root of a product of squares is that of absolute values, and decides by their signs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from operator import mul

import numpy as np

from ...arrays import FloatArray
from ...ir.graph import Graph
from ...ir.interpret import interpret_rows
from ...ir.node import Node
from ...transforms.derivatives import GUARDED, cotangents
from ...transforms.lower_kernels import lower_kernel
from ...transforms.step_limits import table_nodes

_Values = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

_DECIDING = {
    "abs": "sign",
    "sign": "sign",
    "floor": "floor",
    "less": "",
    "less_equal": "",
    "min": "sign",
    "max": "sign",
}
_NAMES = {"abs": "Abs", "min": "Min", "max": "Max", "less": "a condition", "less_equal": "a condition"}
_NAMES |= {"sqrt": "the root of a square"}
_POINTS, _LEAST, _HALVINGS = 512, 32, 64
_PAIRS = 24
_JUMP = 1e-6
"""Share of the gradient that counts as a jump."""


def kinked_constraints(
    graph: Graph, rows: Sequence[tuple[str, Node]], moving: Sequence[Node], rates: Sequence[Node]
) -> list[str]:
    """Return a fault for every constraint whose gradient, or whose coefficients, jump in some configuration.

    Parameters
    ----------
    graph : Graph
        Of all nodes.
    rows : sequence of (str, Node)
        Constraints with their labels.
    moving : sequence of Node
        The coordinates.
    rates : sequence of Node
        Those by which the constraints are differentiated: coordinates of holonomic ones, rates of nonholonomic ones.
    """
    mask = graph.mask(str(node.payload) for node in moving)
    faults = []
    what = "gradient jumps" if moving == rates else "coefficients jump"
    for label, node in rows:
        switches = [n for n in graph.topological([node]) if n.deps & mask and (n.op in _DECIDING or _squares(n))]
        name = _first_jump(graph, node, switches, [str(x.payload) for x in moving], [str(x.payload) for x in rates])
        if name:
            faults.append(
                f"{label}: its {what} at a kink or a jump of {name} in the coordinates, where velocities would have to"
                " jump too: an impact without a law. Write it without (sqrt(x**2 + eps**2) in place of Abs(x), a cubic"
                " table), or on one branch alone; a body that hits something has a contact (add_contacts)"
            )
    return faults


def _first_jump(graph: Graph, row: Node, switches: Sequence[Node], moving: list[str], by: list[str]) -> str:
    """Return the name of a switch across which the derivatives of a constraint jump; empty where none do."""
    if not switches:
        return ""
    own = Graph()  # forms of the scene's graph do not depend on it
    (whole,), decisions = own.adopt([row]), [_decision(own, node) for node in own.adopt(switches)]
    slopes = cotangents(own, [whole], [own.one], [own.input(name) for name in by], GUARDED)
    names = sorted({str(n.payload) for n in own.topological([whole, *slopes, *decisions]) if n.op == "input"})
    places = {own.input(name): ("y", i) for i, name in enumerate(names)}
    values = lower_kernel(own, "values", [*slopes, whole, *decisions], places)
    points = _points(names, moving)

    def at(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        with np.errstate(all="ignore"):
            found = interpret_rows(values, np.zeros(len(y)), y, np.zeros(0))
        return found[:, : len(slopes) + 1], found[:, len(slopes) + 1 :]

    _, decided = at(points)
    for number, node in enumerate(switches):
        fine = np.flatnonzero(np.isfinite(decided[:, number]))
        if len(fine) < _LEAST or _jumps(at, points[fine], decided[fine, number], number):
            return _NAMES.get(node.op, node.op)
    return ""


def _decision(graph: Graph, node: Node) -> Node:
    """Return a value that is constant on either side of a kink or a jump of an operation."""
    if node.op in ("less", "less_equal"):
        return node
    if node.op == "sqrt":
        return graph.call("sign", reduce(mul, _squares(node)))
    value = node.args[0] - node.args[1] if node.op in ("min", "max") else node.args[0]
    return graph.call(_DECIDING[node.op], value)


def _squares(node: Node) -> list[Node]:
    """Return what is squared in the root of a product of squares, an empty list for all else."""
    if node.op != "sqrt":
        return []
    found, left = list[Node](), [node.args[0]]
    while left:
        factor = left.pop()
        if factor.op == "mul" and factor.args[0] is factor.args[1]:
            found.append(factor.args[0])
        elif factor.op == "mul":
            left += factor.args
        elif factor.number is None:
            return []
    return found


def _points(names: Sequence[str], moving: Sequence[str]) -> FloatArray:
    """Return points (k, n) of many sizes; of what is no coordinate, positive ones."""
    draw = np.random.default_rng(0)
    size = 10.0 ** draw.uniform(-2.0, 2.0, (_POINTS, len(names)))
    sign = np.where(draw.uniform(size=size.shape) < 0.5, -1.0, 1.0)
    return np.where(np.isin(names, list(moving)), sign, 1.0) * size


def _jumps(at: _Values, points: FloatArray, decided: FloatArray, number: int) -> bool:
    """Return whether derivatives jump between points (k, n) between which a decision (k,) changes."""
    changes = np.flatnonzero(decided[1:] != decided[:-1])[:_PAIRS]
    if not len(changes):
        return False
    low, high, first = points[changes], points[changes + 1], decided[changes]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        same = (at(middle)[1][:, number] == first)[:, np.newaxis]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    one, other = at(low)[0], at(high)[0]
    fine = np.all(np.isfinite(one) & np.isfinite(other), axis=1)
    sizes = np.maximum(np.abs(one), np.abs(other))
    far = np.abs(one - other) > _JUMP * np.maximum(sizes, np.max(sizes[:, :-1], axis=1, keepdims=True))
    return bool(np.any(far[fine]))


# Check of the smoothness of tables in positions and constraints.


def rough_tables(graph: Graph, requirements: Sequence[tuple[int, str, Sequence[Node]]]) -> list[str]:
    """Return a fault for every table that is not smooth enough for its place.

    Parameters
    ----------
    graph : Graph
        Of all nodes.
    requirements : sequence of (int, str, sequence of Node)
        How many derivatives must be continuous, of what, and its values.
    """
    faults: list[str] = []
    if not any(node.op in ("table", "surface") for node in graph.nodes):
        return faults
    for least, place, nodes in requirements:
        for _, table, order in table_nodes(graph, nodes):
            if table.smoothness - order < least:
                what = "jumps" if table.smoothness - order < 0 else "has a slope that jumps"
                needs = "positions need two derivatives" if least else "velocities need a derivative"
                faults.append(
                    f"{place}: the table {table.name!r} {what} at knots, and {needs}; use"
                    ' kind="cubic" with extrapolate="error" or "linear"'
                )
    return list(dict.fromkeys(faults))
