"""Copies of equations of motion, on a copy of their graph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from ..ir.graph import Graph
from ..ir.node import Node
from .equations import EquationsOfMotion

__all__ = ["copied"]


def copied(equations: EquationsOfMotion) -> EquationsOfMotion:
    """Return equal equations on a graph of their own, which has the same values in the same forms and order.

    Derivations from the copy leave the original unchanged. Nodes of other graphs, as that of the potential energy
    of loads, are shared.
    """
    graph = equations.graph.copy()
    changed = {
        field.name: _moved(getattr(equations, field.name), equations.graph, graph)
        for field in fields(equations)
        if field.name not in ("graph", "symbols")  # names have no nodes
    }
    return replace(equations, graph=graph, **changed)


def _moved(value: Any, old: Graph, new: Graph) -> Any:
    """Return a value whose nodes are those of a copied graph."""
    if isinstance(value, Node):
        return new.nodes[value.index] if value.graph is old else value
    if isinstance(value, tuple | list):
        moved = [_moved(each, old, new) for each in value]
        return value if all(a is b for a, b in zip(value, moved, strict=True)) else type(value)(moved)
    if isinstance(value, Mapping):
        table = {key: _moved(each, old, new) for key, each in value.items()}
        return value if all(value[key] is each for key, each in table.items()) else table
    if is_dataclass(value) and not isinstance(value, type):
        changed = {field.name: _moved(getattr(value, field.name), old, new) for field in fields(value)}
        different = {name: each for name, each in changed.items() if each is not getattr(value, name)}
        return replace(value, **different) if different else value
    return value
