"""Sizes of rows of the constraint Jacobian that vanish at some angles, beside which they count as zero.

Where the links of a mechanism fold onto one line, the row of a constraint in angles alone, (l cos(a), l cos(b)), may
vanish as a whole. It has no angle to other rows there, and what rounding leaves of the constraint is a curve that
turns, within a hundred millionth of a radian, from one branch of the motion to the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from ..ir.graph import Graph, Node

__all__ = ["row_scale"]

_PERIODIC = "sin", "cos"

_MOST_ENTRIES = 8
"""Entries of a row among which unit vectors are looked for."""


def row_scale(graph: Graph, row: Sequence[Node], inertias: Sequence[Node]) -> Node:
    """Return a lower bound of row M^-1 row^T at angles that make each entry large; zero where the row never vanishes.

    Parameters
    ----------
    graph
        Of the nodes.
    row
        Row of the constraint Jacobian, an entry for each coordinate.
    inertias
        Diagonal of M: the diagonal of its inverse is at least its reciprocal.
    """
    if _never_vanishes(graph, row):
        return graph.zero
    entries = [(entry, inertia) for entry, inertia in zip(row, inertias, strict=True) if not entry.is_zero]
    sizes = _sizes_at_any_angle(graph, [entry for entry, _ in entries])
    known = [size * size / inertia for size, (_, inertia) in zip(sizes, entries, strict=True) if size is not None]
    return graph.sum(known) if len(known) == len(entries) else graph.zero


def _never_vanishes(graph: Graph, row: Sequence[Node]) -> bool:
    """Return whether the squares of some entries, up to three, add up to what no angle makes zero: a unit vector."""
    squares = [entry * entry for entry in row if not entry.is_zero]
    sums = (graph.sum(some) for size in (1, 2, 3) for some in combinations(squares[:_MOST_ENTRIES], size))
    return any(all(node.op not in _PERIODIC for node in graph.topological([total])) for total in sums)


def _sizes_at_any_angle(graph: Graph, nodes: Sequence[Node]) -> list[Node | None]:
    """Return bounds of values with sines and cosines taken to be one; None for values that have none in all terms."""
    done: dict[int, Node] = {}
    periodic: dict[int, bool] = {}

    def size(node: Node) -> Node:
        a, of = [done[arg.index] for arg in node.args], [periodic[arg.index] for arg in node.args]
        known = {"add": all(of), "sub": all(of), "mul": any(of), "div": any(of[:1]), "neg": any(of)}
        periodic[node.index] = node.op in _PERIODIC or known.get(node.op, False)
        if node.op in _PERIODIC:
            return graph.one
        if node.op in ("add", "sub"):
            return a[0] + a[1]
        if node.op in ("mul", "div"):
            return a[0] * a[1] if node.op == "mul" else a[0] / a[1]
        return a[0] if node.op == "neg" else graph.call("abs", node)

    graph.visit(nodes, done, size)
    return [done[node.index] if periodic[node.index] else None for node in nodes]
