"""Removal of inputs on which values do not depend."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node, UnitName

__all__ = ["drop_independent"]


def drop_independent(graph: Graph, nodes: Sequence[Node], inputs: Sequence[Node], limit: int = 3000) -> list[Node]:
    """Return `nodes`, each freed of those `inputs` that it does not depend on in value.

    A node such as (m b sin(a)) sin(a) u + (m b cos(a)) cos(a) u becomes m b u. Nodes whose expressions
    together have more than `limit` operations are returned as they are. The components of a unit quaternion are
    independent of each other in no value, so that a node is freed of all four or of none.
    """
    if sum(1 for node in graph.topological(nodes) if node.args) > limit:
        return list(nodes)
    groups: dict[str, list[Node]] = {}
    for source in inputs:
        key = source.payload.quaternion if isinstance(source.payload, UnitName) else str(source.payload)
        groups.setdefault(key, []).append(source)
    for group in groups.values():
        mask = sum(source.deps for source in group)
        for node in nodes:
            if node.args and node.deps & mask:
                graph.freed_of(node, group)
    return list(nodes)
