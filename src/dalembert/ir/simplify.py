"""Forms offered to the graph, which keeps them where they are cheaper."""

from __future__ import annotations

from collections.abc import Sequence

from .graph import Graph, Node

__all__ = ["drop_independent"]


def drop_independent(graph: Graph, nodes: Sequence[Node], inputs: Sequence[Node], limit: int = 3000) -> list[Node]:
    """Return `nodes`, each freed of those `inputs` that it does not depend on in value.

    A node such as (m b sin(a)) sin(a) u + (m b cos(a)) cos(a) u becomes m b u. Nodes whose expressions
    together have more than `limit` operations are returned as they are.
    """
    if sum(1 for node in graph.topological(nodes) if node.args) > limit:
        return list(nodes)
    for source in inputs:
        for node in nodes:
            if node.args and node.deps & source.deps:
                graph.freed_of(node, [source])
    return list(nodes)
