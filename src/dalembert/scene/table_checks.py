"""Check of the smoothness of tables in positions and constraints."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from ..transforms.knot_limits import table_nodes

__all__ = ["rough_tables"]


def rough_tables(graph: Graph, requirements: Sequence[tuple[int, str, Sequence[Node]]]) -> list[str]:
    """Return a fault for every table that is not smooth enough for its place.

    Parameters
    ----------
    graph : Graph
        Of all nodes.
    requirements : sequence of (int, str, sequence of Node)
        How many derivatives must be continuous, of what, and its values.
    """
    faults = []
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
