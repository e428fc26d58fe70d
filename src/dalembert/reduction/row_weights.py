"""Weights of constraints beside a singular mass matrix M: J^T W J has the size of M in any unit."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from ..mechanics.equations import EquationsOfMotion

__all__ = ["row_weights"]

_TINY = 1e-300


def row_weights(equations: EquationsOfMotion) -> list[Node]:
    """Return W, an entry for each constraint: 1 / (J_i D^-1 J_i^T).

    D has the sum of the diagonal entries of M for angles where a coordinate is an angle, and that for all others
    elsewhere, where coordinates are 1/2. W is a function of the parameters for constraints of angles alone, such as
    those of unit quaternions.
    """
    graph, typical = equations.graph, _typical(equations)
    angles = [name in equations.angles for name in equations.symbols.coordinates]
    inverses = _inverses(equations, angles, typical)
    weights = []
    for row in equations.constraints:
        slopes = [*row.jacobian]
        if all(angle or slope.is_zero for angle, slope in zip(angles, slopes, strict=True)):
            slopes = graph.substitute(slopes, typical)
        size = graph.sum(slope * slope * by for slope, by in zip(slopes, inverses, strict=True))
        weights.append(graph.one if size.is_zero else graph.one / (size + graph.node(_TINY)))
    return weights


def _typical(equations: EquationsOfMotion) -> dict[Node, Node]:
    """Return the values of inputs at which sizes are computed; components of quaternions are those of a unit one."""
    half = equations.graph.node(0.5)
    return {node: half for node in equations.moving if node.op == "input"}


def _inverses(equations: EquationsOfMotion, angles: Sequence[bool], typical: dict[Node, Node]) -> list[Node]:
    """Return the diagonal of D^-1, zeros where nothing has a mass."""
    graph = equations.graph
    diagonal = graph.substitute([row[i] for i, row in enumerate(equations.mass_matrix)], typical)
    found = {}
    for kind in (True, False):
        total = graph.sum(entry for entry, angle in zip(diagonal, angles, strict=True) if angle is kind)
        found[kind] = total if total.is_zero else _inverse(graph, total)
    return [found[angle] for angle in angles]


def _inverse(graph: Graph, value: Node) -> Node:
    positive = graph.call("less", graph.zero, value)
    return graph.call("select", positive, graph.one, graph.zero) / graph.call("select", positive, value, graph.one)
