"""Rank margins of constraints: smooth event functions that vanish where the Jacobian loses rank.

The Gram determinant of the rows J_i of the constraint Jacobian, over the squares of their lengths s_i, is at most some
times the square of the smallest singular value. The singular value itself, or what follows it more closely, dips too
narrowly for the points at which a step is looked at; the determinant is as smooth as the Jacobian. A row that vanishes
is not to hide it: s_i^2 = |J_i|^2 + 0.01 sum |J_k|^2 / n + 1e-4 |dJ_i/dt|^2, the last with time in seconds.
"""

from __future__ import annotations

from ..ir.graph import Node
from ..transforms.derivatives import tangents
from ..transforms.linear import SingularMatrix, factorize
from .base import ReducedSystem

__all__ = ["rank_margins"]

_OTHERS, _RATES = 1e-2, 1e-4
_LEVELS = (1e-3, 1e-6, 1e-9, 1e-12)
"""A determinant that is small all along falls below the next of them where rank is lost."""


def rank_margins(system: ReducedSystem) -> dict[str, Node]:
    """Return functions of coordinates, rates and time by name, one of which changes its sign where rank is lost.

    None where the Jacobian is constant along motions, or of less than full rank whatever the state.
    """
    equations, graph = system.equations, system.equations.graph
    rows = [row.jacobian for i, row in enumerate(equations.constraints) if i not in system.left_out]
    flow = dict(zip(equations.q, equations.qdot, strict=True)) | {equations.time: graph.one}
    flow |= equations.state_flow
    gram = [[graph.sum(a * b for a, b in zip(x, y, strict=True)) for y in rows] for x in rows]
    mean = graph.node(_OTHERS / len(rows)) * graph.sum(gram[i][i] for i in range(len(rows)))
    try:
        pivots = factorize(graph, gram).pivots
    except SingularMatrix:
        return {}
    share = graph.one
    for pivot in pivots:
        share = share * pivot
    for i, row in enumerate(rows):
        rates = tangents(graph, row, flow)
        share = share / (gram[i][i] + mean + graph.node(_RATES) * graph.sum(rate * rate for rate in rates))
    if graph.freed_of(share, list(equations.moving)) is not None:
        return {}
    return {f"Gram determinant less {level:g}": share - graph.node(level) for level in _LEVELS}
