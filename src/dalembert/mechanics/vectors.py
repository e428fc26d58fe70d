"""Three-component vectors of graph nodes."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from ..scene.model import Components

__all__ = ["add", "cross", "dot", "is_zero", "rotate", "rotate_back", "scale", "subtract", "zero"]


def zero(graph: Graph) -> Components:
    """Return the zero vector."""
    return graph.zero, graph.zero, graph.zero


def is_zero(a: Components) -> bool:
    """Whether all components are identically zero."""
    return all(x.is_zero for x in a)


def add(a: Components, b: Components) -> Components:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Components, b: Components) -> Components:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(factor: Node, a: Components) -> Components:
    """Return factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


def cross(a: Components, b: Components) -> Components:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Components, b: Components) -> Node:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def rotate(matrix: Sequence[Components], a: Components) -> Components:
    """Return matrix a."""
    return dot(matrix[0], a), dot(matrix[1], a), dot(matrix[2], a)


def rotate_back(matrix: Sequence[Components], a: Components) -> Components:
    """Return the transposed matrix times a."""
    return (
        matrix[0][0] * a[0] + matrix[1][0] * a[1] + matrix[2][0] * a[2],
        matrix[0][1] * a[0] + matrix[1][1] * a[1] + matrix[2][1] * a[2],
        matrix[0][2] * a[0] + matrix[1][2] * a[1] + matrix[2][2] * a[2],
    )
