"""Rounding errors of states that are projected onto constraints.

A projected state is off by what rounding makes of the residuals of the constraints: a component that is zero in exact
arithmetic is then off by the rounding of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..transforms.derivatives import tangents
from .base import ReducedSystem
from .saddle import SaddlePoint, velocity_residuals


def terms(system: ReducedSystem, graph: Graph, y: Sequence[Node], time: Node, nodes: Sequence[Node]) -> list[Node]:
    """Return the sizes of the terms that make up values: their rounding errors are small multiples of these.

    They are those of the components of the state and of time and, where steps of formulation "projected" end on
    constraints, those of the residuals of these.

    Parameters
    ----------
    system : ReducedSystem
    graph : Graph
        The graph of the other nodes.
    y : sequence of Node
        Components of the state of the system.
    time : Node
    nodes : sequence of Node
        The values.
    """
    residuals, changes = _residuals(system, graph)
    values = [*nodes, *residuals]
    sizes = [graph.zero for _ in values]
    for place in (*y, time):
        slopes = tangents(graph, values, {place: graph.one})
        sizes = [size + graph.call("abs", slope * place) for size, slope in zip(sizes, slopes, strict=True)]
    found, of_residuals = sizes[: len(nodes)], sizes[len(nodes) :]
    for residual, change in zip(of_residuals, changes, strict=True):
        slopes = tangents(graph, nodes, dict(zip(y, change, strict=False)))
        found = [size + graph.call("abs", slope) * residual for size, slope in zip(found, slopes, strict=True)]
    return found


@final
@frozen
class Slopes:
    """Derivatives of values along one direction, from which the sizes of `terms` follow by evaluation alone.

    Attributes
    ----------
    direction : tuple of Node
        Inputs: the direction in the state (n_y,), then in time.
    along : tuple of Node
        Derivatives of the values, then of the residuals of the constraints (k + n_residuals,).
    changes : tuple of tuple of Node
        For each residual the direction in the state (n_y,) by which it changes by 1, the others by 0.
    varying : tuple of int
        Places in the direction on which any derivative depends.
    """

    direction: tuple[Node, ...]
    along: tuple[Node, ...]
    changes: tuple[tuple[Node, ...], ...]
    varying: tuple[int, ...]


def slopes(system: ReducedSystem, graph: Graph, y: Sequence[Node], time: Node, nodes: Sequence[Node]) -> Slopes:
    """Return the derivatives along a direction for values as in `terms`.

    They are a few times as long as the values, where those by each component of the state are so many times longer.
    """
    residuals, changes = _residuals(system, graph)
    values, places = [*nodes, *residuals], [*y, time]
    direction = [graph.input(f"direction {i}") for i in range(len(places))]
    used = 0
    for node in values:
        used |= node.deps
    varying = [i for i, place in enumerate(places) if place.deps & used]
    along = tangents(graph, values, {places[i]: direction[i] for i in varying})
    padded = [(*change, *[graph.zero] * (len(y) - len(change))) for change in changes]
    return Slopes(tuple(direction), tuple(along), tuple(padded), tuple(varying))


def summands(graph: Graph, node: Node, products: int = 0) -> Node:
    """Return the sum of the sizes of the summands of a value: small multiples of it are rounding errors of the sum.

    Those of selected values, and of the factors of so many `products` in each other, are summed in them.
    """
    if node.op in ("add", "sub", "neg"):
        return graph.sum(summands(graph, arg, products) for arg in node.args)
    if node.op == "mul" and products > 0:
        first, second = (summands(graph, arg, products - 1) for arg in node.args)
        return first * second
    if node.op == "select":
        condition, *values = node.args
        return graph.call("select", condition, *(summands(graph, value, products) for value in values))
    return graph.call("abs", node)


def _residuals(system: ReducedSystem, graph: Graph) -> tuple[list[Node], list[list[Node]]]:
    """Return the residuals of positions and velocities, and the changes of q and q_dot that change one of each by 1.

    There are none where steps do not end on constraints.
    """
    if system.formulation != "projected" or not system.equations.constraints:
        return [], []
    whole = system.equations
    kept = tuple(row for i, row in enumerate(whole.constraints) if i not in system.left_out)
    redundancy = system.redundancy
    equations = replace(whole, constraints=kept if redundancy is None else redundancy.scaled(kept))
    nothing = [equations.graph.zero] * len(equations.q)
    saddle = SaddlePoint.of(equations, guarded=not system.regular, redundancy=redundancy)
    positions = [row.position for row in equations.constraints if row.position is not None]
    moves = [[*change, *nothing] for change in _changes(saddle, len(positions), equations.name)]
    rates = [[*nothing, *change] for change in _changes(saddle, len(equations.constraints), equations.name)]
    residuals = graph.adopt([*positions, *velocity_residuals(equations)])
    return residuals, [graph.adopt(change) for change in (*moves, *rates)]


def _changes(saddle: SaddlePoint, count: int, scene: str) -> list[list[Node]]:
    """Return the displacements (n_q,) by which one of the first `count` constraints changes by 1, the others by 0."""
    if count == 0:
        return []
    graph, factors = saddle.graph, saddle.schur(count, scene)
    nothing = [graph.zero] * len(saddle.forcing)
    units = [[graph.one if i == k else graph.zero for i in range(count)] for k in range(count)]
    return [saddle.combine(nothing, factors.solve(unit)) for unit in units]
