"""Checks of constraints for kinks, and of tables for smoothness: [constraints on the graph] -> [faults].

Where the gradient of a holonomic constraint jumps in a configuration, as that of ``Abs(x) - y`` at x = 0, velocities
that obey it would have to jump too: an impact without a law. So with coefficients of nonholonomic constraints. Whether
they jump is measured: between two points on either side of what a switch decides by, which halving brings together.
The root of a product of squares is that of absolute values, and decides by their signs. The gap of a contact may have
kinks: where they are, a run ends while it is closed. There, other roots count as well, whose argument may vanish where
it is least.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import reduce
from operator import mul
from typing import TYPE_CHECKING

import numpy as np

from ...arrays import FloatArray
from ...ir.graph import Graph
from ...ir.interpret import interpret_rows
from ...ir.node import Node
from ...naming import rate_name
from ...transforms.derivatives import GUARDED, cotangents
from ...transforms.lower_kernels import lower_kernel
from ...transforms.step_limits import table_nodes

if TYPE_CHECKING:
    from ..model import ConstraintModel, ContactModel

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
_FEWER, _KINK = 28, 0.1
"""The same for roots of what is least at zero: next to that, rounding is all that is left of it."""
_LATER, _LASTING = 8, 0.5
"""Halvings in which a jump does not get smaller than by this share, which steep slopes do."""


def kinked_constraints(
    graph: Graph,
    coordinates: Sequence[str],
    holonomic: Sequence[ConstraintModel],
    nonholonomic: Sequence[ConstraintModel],
) -> list[str]:
    """Return a fault for every constraint whose gradient, or whose coefficients, jump in some configuration.

    `graph` has all nodes, and `coordinates` are their names.
    """
    faults = []
    moving, rates = ([graph.input(name) for name in names] for names in (coordinates, map(rate_name, coordinates)))
    for rows, by, what in ((holonomic, moving, "gradient jumps"), (nonholonomic, rates, "coefficients jump")):
        for row in rows:
            name = next((_NAMES.get(n.op, n.op) for n in _jumping(graph, row.expression, moving, by, hidden=False)), "")
            if name:
                faults.append(
                    f"{row.label}: its {what} at a kink or a jump of {name} in the coordinates, where velocities would"
                    " have to jump too: an impact without a law. Write it without (sqrt(x**2 + eps**2) in place of"
                    " Abs(x), a cubic table), or on one branch alone; a body that hits something has a contact"
                    " (add_contacts)"
                )
    return faults


def contacts_with_kinks(
    graph: Graph, coordinates: Sequence[str], contacts: Sequence[ContactModel]
) -> tuple[list[ContactModel], list[str]]:
    """Return contacts with what changes its sign at kinks of their gaps, and a fault for each that is not known.

    `graph` has all nodes, and `coordinates` are their names.
    """
    moving = [graph.input(name) for name in coordinates]
    made: list[ContactModel] = []
    faults: list[str] = []
    for contact in contacts:
        jumping = () if contact.gap is None else _jumping(graph, contact.gap, moving, moving, hidden=True)
        found = [(node, _turning(graph, node, moving)) for node in jumping]
        made.append(replace(contact, kinks=tuple(dict.fromkeys(value for _, value in found if value is not None))))
        faults += [
            f"contact {contact.name!r}: the gradient of its gap jumps at a kink or a jump of"
            f" {_NAMES.get(node.op, node.op)} in the coordinates. While it is closed, velocities would have to jump"
            " there, too, and the run would have to end: write it so that this can be seen, Abs(x) or sqrt(x**2) with"
            " an x that changes its sign"
            for node, value in found
            if value is None
        ]
    return made, faults


def _jumping(graph: Graph, row: Node, moving: Sequence[Node], by: Sequence[Node], *, hidden: bool) -> Iterator[Node]:
    """Yield the operations on coordinates across which the derivatives of a constraint, or a gap, jump.

    With `hidden` also roots of what is no product of squares, such as that of 1 - cos(x)**2, and only what is seen to
    jump; else also what has a value at too few points to tell.
    """
    mask = graph.mask(str(node.payload) for node in moving)
    roots = (lambda node: node.op == "sqrt") if hidden else _squares
    switches = [n for n in graph.topological([row]) if n.deps & mask and (n.op in _DECIDING or roots(n))]
    if not switches:
        return
    own = Graph()  # forms of the scene's graph do not depend on it
    (whole,), adopted = own.adopt([row]), own.adopt(switches)
    names, varied = [str(node.payload) for node in by], [own.input(str(node.payload)) for node in moving]
    decisions = [(number, each) for number, node in enumerate(adopted) for each in _decisions(own, node, varied)]
    slopes = cotangents(own, [whole], [own.one], [own.input(name) for name in names], GUARDED)
    nodes = [*slopes, whole, *(node for _, node in decisions)]
    inputs = sorted({str(n.payload) for n in own.topological(nodes) if n.op == "input"})
    values = lower_kernel(own, "values", nodes, {own.input(name): ("y", i) for i, name in enumerate(inputs)})
    points = _points(inputs, [str(node.payload) for node in moving])

    def at(y: FloatArray) -> tuple[FloatArray, FloatArray]:
        with np.errstate(all="ignore"):
            found = interpret_rows(values, np.zeros(len(y)), y, np.zeros(0))
        return found[:, : len(slopes) + 1], found[:, len(slopes) + 1 :]

    _, decided = at(points)
    jumping = set()
    for place, (number, _) in enumerate(decisions):
        fine = np.flatnonzero(np.isfinite(decided[:, place]))
        exact = switches[number].op != "sqrt" or _squares(switches[number])
        jump, halvings = (_JUMP, _HALVINGS) if exact else (_KINK, _FEWER)
        if (len(fine) < _LEAST and not hidden) or _jumps(at, points[fine], decided[fine, place], place, jump, halvings):
            jumping.add(number)
    yield from (switches[number] for number in sorted(jumping))


def _decisions(graph: Graph, node: Node, moving: Sequence[Node]) -> list[Node]:
    """Return values that are constant on either side of a kink or a jump of an operation.

    The root of what is no product of squares has a kink where that is least, and zero: its slopes change their signs.
    """
    if node.op in ("less", "less_equal"):
        return [node]
    if node.op == "sqrt" and not _squares(node):
        slopes = cotangents(graph, [node.args[0]], [graph.one], moving, GUARDED)
        return [graph.call("sign", slope) for slope in slopes if not slope.is_zero]
    value = node.args[0] if node.op == "floor" else _turning(graph, node, moving)
    return [] if value is None else [graph.call(_DECIDING.get(node.op, "sign"), value)]


def _turning(graph: Graph, node: Node, moving: Sequence[Node]) -> Node | None:
    """Return a value that changes its sign at the kink or the jump of an operation; None where it is not known."""
    if node.op == "floor":
        return None
    if node.op == "sqrt":
        squares = _squares(node)
        return reduce(mul, squares) if squares else _root(graph, node.args[0], moving)
    return node.args[0] - node.args[1] if len(node.args) == 2 else node.args[0]


def _root(graph: Graph, value: Node, moving: Sequence[Node]) -> Node | None:
    """Return what is squared in a value like 2 - 2*cos(x)**2, but for a factor that does not move; None if not known.

    It is the slope of what the value subtracts the square of.
    """
    for node in Graph.topological([value]):
        if node.op == "mul" and node.args[0] is node.args[1]:
            for slope in cotangents(graph, [node.args[0]], [graph.one], moving):
                if not slope.is_zero and graph.freed_of(value / (slope * slope), list(moving)) is not None:
                    return slope
    return None


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


def _jumps(at: _Values, points: FloatArray, decided: FloatArray, number: int, jump: float, halvings: int) -> bool:
    """Return whether derivatives jump between points (k, n) between which a decision (k,) changes."""
    changes = np.flatnonzero(decided[1:] != decided[:-1])[:_PAIRS]
    if not len(changes):
        return False
    low, high, first = points[changes], points[changes + 1], decided[changes]
    before = np.zeros(len(changes))
    for halved in range(halvings):
        if halved == halvings - _LATER:
            before = _apart(at(low)[0], at(high)[0])
        middle = 0.5 * (low + high)
        same = (at(middle)[1][:, number] == first)[:, np.newaxis]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    apart = _apart(at(low)[0], at(high)[0])
    return bool(np.any((apart > jump) & (apart > _LASTING * before)))


def _apart(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return by which share derivatives (k, n_q) and values, the last column, differ; 0 where they are not finite."""
    with np.errstate(all="ignore"):
        sizes = np.maximum(np.abs(one), np.abs(other))
        sizes = np.maximum(sizes, np.max(sizes[:, :-1], axis=1, keepdims=True))
        shares = np.max(np.where(sizes > 0.0, np.abs(one - other) / sizes, 0.0), axis=1)
    return np.nan_to_num(shares, nan=0.0, posinf=0.0)


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
