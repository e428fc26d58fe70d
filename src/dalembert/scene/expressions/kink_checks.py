"""Checks of motions for kinks, and of tables for smoothness: [constraints and positions on the graph] -> [faults].

Where the gradient of a holonomic constraint jumps in a configuration, as that of ``Abs(x) - y`` at x = 0, velocities
that obey it would have to jump too: an impact without a law. So with positions and orientations of bodies, and with
coefficients of nonholonomic constraints. Whether they jump is measured: between two points on either side of what a
switch decides by, which halving brings together. The root of a product of squares is that of absolute values, and
decides by their signs; other roots may have a kink where their argument is least, and zero. The gap of a contact may
have kinks: where they are, a run ends while it is closed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
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
    from ..model import ContactModel
    from ..symbols import Requirement

_Values = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

_DECIDING = {
    "abs": "sign",
    "sign": "sign",
    "floor": "floor",
    "less": "",
    "less_equal": "",
    "min": "sign",
    "max": "sign",
    "atan": "sign",
}
_FOLDING = ("sqrt", "pow", "asin", "acos")
"""Operations with an infinite slope at an end of what they are defined for: where a value only touches it, a kink."""
_NAMES = {"abs": "Abs", "min": "Min", "max": "Max", "less": "a condition", "less_equal": "a condition"}
_NAMES |= {"sqrt": "the root of a square", "pow": "a power"}
_POINTS, _LEAST, _HALVINGS = 512, 32, 64
_PAIRS = 24
_JUMP = 1e-6
"""Share of the gradient that counts as a jump."""
_FEWER, _KINK = 28, 0.1
"""The same for roots of what is least at zero: next to that, rounding is all that is left of it."""
_LEVEL = 1e-4
"""Share of the largest gradient that is met below which all counts as none: smooth ones pass zero, too."""
_LATER, _LASTING = 8, 0.5
"""Halvings in which a jump does not get smaller than by this share, which slopes do."""


def kinks_in_motion(
    graph: Graph, coordinates: Sequence[str], requirements: Iterable[Requirement]
) -> tuple[list[str], list[tuple[str, Node]]]:
    """Return a fault for every place at whose kinks, or jumps, in some configuration velocities would have to jump.

    Others are faults unless motions end where a value, given with the fault, changes its sign: those of roots such as
    that of 1 - cos(x)**2, which has a kink where sin(x) does. Some angles of a body lock there.

    `graph` has all nodes, and `coordinates` are their names.
    """
    faults: list[str] = []
    unless: list[tuple[str, Node]] = []
    moving, rates = ([graph.input(name) for name in names] for names in (coordinates, map(rate_name, coordinates)))
    for required in requirements:
        if required.across < 0:
            continue
        by, what = (moving, "gradient jumps") if required.across else (rates, "coefficients jump")
        for node in (n for row in required.nodes for n in _jumping(graph, row, moving, by, untold=True)):
            fault = (
                f"{required.place}: its {what} at a kink or a jump of {_NAMES.get(node.op, node.op)} in the"
                " coordinates, where velocities would have to jump too: an impact without a law. Write it without"
                " (sqrt(x**2 + eps**2) in place of Abs(x), a cubic table), or on one branch alone; a body that hits"
                " something has a contact (add_contacts)"
            )
            value = _turning(graph, node, moving) if node.op == "sqrt" else None
            if value is None:
                faults.append(fault)
                break
            unless.append((fault, value))
    return faults, unless


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
        jumping = () if contact.gap is None else _jumping(graph, contact.gap, moving, moving, untold=False)
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


def _jumping(graph: Graph, row: Node, moving: Sequence[Node], by: Sequence[Node], *, untold: bool) -> Iterator[Node]:
    """Yield the operations on coordinates across which the derivatives of a constraint, a position or a gap jump.

    Where `untold`, also operations with a value at too few points to tell, but roots of what is no product of squares.
    """
    mask = graph.mask(str(node.payload) for node in moving)
    switches = [n for n in graph.topological([row]) if n.deps & mask and (n.op in _DECIDING or n.op in _FOLDING)]
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
        exact = switches[number].op not in _FOLDING or _squares(switches[number])
        jump, halvings = (_JUMP, _HALVINGS) if exact else (_KINK, _FEWER)
        if (len(fine) < _LEAST and exact and untold) or _jumps(
            at, points[fine], decided[fine, place], place, jump, halvings
        ):
            jumping.add(number)
    yield from (switches[number] for number in sorted(jumping))


def _decisions(graph: Graph, node: Node, moving: Sequence[Node]) -> list[Node]:
    """Return values that are constant on either side of a kink or a jump of an operation.

    The root of what is no product of squares has a kink where that is least, and zero: its slopes change their signs.
    So have the inverse functions of sine and cosine where their operand is largest, and one; and that of the tangent
    jumps where its operand changes its sign at infinity. ``atan2`` jumps by a whole turn, of which angles show nothing.
    """
    if node.op in ("less", "less_equal"):
        return [node]
    if node.op in _FOLDING and not _squares(node):
        slopes = cotangents(graph, [node.args[0]], [graph.one], moving, GUARDED)
        return [graph.call("sign", slope) for slope in slopes if not slope.is_zero]
    value = node.args[0] if node.op in ("floor", "atan") else _turning(graph, node, moving)
    return [] if value is None else [graph.call(_DECIDING.get(node.op, "sign"), value)]


def _turning(graph: Graph, node: Node, moving: Sequence[Node]) -> Node | None:
    """Return a value that changes its sign at the kink or the jump of an operation; None where it is not known."""
    if node.op == "sqrt":
        squares = _squares(node)
        return reduce(mul, squares) if squares else _root(graph, node.args[0], moving)
    if node.op in ("floor", "atan", *_FOLDING):
        return None
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


@np.errstate(all="ignore")
def _jumps(at: _Values, points: FloatArray, decided: FloatArray, number: int, jump: float, halvings: int) -> bool:
    """Return whether derivatives jump between points (k, n) between which a decision (k,) changes."""
    changes = np.flatnonzero(decided[1:] != decided[:-1])[:_PAIRS]
    if not len(changes):
        return False
    low, high, first = points[changes], points[changes + 1], decided[changes]
    largest, before = np.zeros(len(changes)), np.zeros(1)
    for halved in range(halvings):
        if halved == halvings - _LATER:
            before = _finite(at(low)[0] - at(high)[0])
        middle = 0.5 * (low + high)
        values, found = at(middle)
        largest = np.maximum(largest, np.max(_finite(values)[:, :-1], axis=1))
        same = (found[:, number] == first)[:, np.newaxis]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    one, other = at(low)[0], at(high)[0]
    apart, sizes = _finite(one - other), np.maximum(_finite(one), _finite(other))
    least = np.maximum(np.max(sizes[:, :-1], axis=1), _LEVEL * largest)
    return bool(np.any((apart > jump * np.maximum(sizes, least[:, np.newaxis])) & (apart > _LASTING * before)))


def _finite(values: FloatArray) -> FloatArray:
    """Return absolute values, 0 for those that are not finite."""
    return np.nan_to_num(np.abs(values), nan=0.0, posinf=0.0)


# Check of the smoothness of tables in positions and constraints.


def rough_tables(graph: Graph, requirements: Iterable[Requirement]) -> list[str]:
    """Return a fault for every table that is not smooth enough for its place.

    `graph` has all nodes.
    """
    faults: list[str] = []
    if not any(node.op in ("table", "surface") for node in graph.nodes):
        return faults
    for least, place, nodes, _ in requirements:
        for _, table, order in table_nodes(graph, nodes):
            if table.smoothness - order < least:
                what = "jumps" if table.smoothness - order < 0 else "has a slope that jumps"
                needs = "positions need two derivatives" if least else "velocities need a derivative"
                faults.append(
                    f"{place}: the table {table.name!r} {what} at knots, and {needs}; use"
                    ' kind="cubic" with extrapolate="error" or "linear"'
                )
    return list(dict.fromkeys(faults))
