"""Keys of kernels that are remembered.

A scene is often compiled several times in a process: for backends, for outputs, for models that a run derives.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import NamedTuple

from ..ir.graph import Graph
from ..ir.node import Node, UnitName


class ValuesKey(NamedTuple):
    """A key of values: whether products stay as they are, a row for each node, and which rows are the values.

    Its text is the same in every process.
    """

    plain: bool
    rows: tuple[Hashable, ...]
    values: tuple[int, ...]


def values_key(
    graph: Graph, nodes: Sequence[Node], inputs: Mapping[Node, tuple[str, int | None]], fixed: Sequence[Node] | None
) -> ValuesKey:
    """Return a key of values: equal for equal forms of nodes, from inputs of the same names at the same places.

    The arguments are those of `lower_kernel`.
    """
    places = {str(node.payload): place for node, place in inputs.items()}
    still = frozenset(str(node.payload) for node in fixed or ())
    numbers: dict[int, int] = {}
    rows: list[Hashable] = []
    for node in graph.topological(nodes):
        numbers[node.index] = len(rows)
        if node.op == "input":
            own = str(node.payload)
            unit = (node.payload.quaternion, node.payload.place) if isinstance(node.payload, UnitName) else None
            rows.append((own, places.get(own), own in still, unit))
        elif node.op == "const":
            value = node.payload if node.number is None else (node.number.numerator, node.number.denominator)
            rows.append((node.fingerprint, value, graph.decimals.get(node.index)))
        else:
            rows.append((node.op, node.deps == 0, *[numbers[arg.index] for arg in node.args]))
    return ValuesKey(fixed is None, tuple(rows), tuple([numbers[node.index] for node in nodes]))
