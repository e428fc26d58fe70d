"""Constraints that follow from others: found on the graph whatever the state, and left out where that is proved.

A row of the constraint Jacobian that is a combination of others constrains nothing more. It is left out where the rest
of the constraint is the same combination: then it holds wherever the others do. Its reactions are not determined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

from ..errors import ConstraintError
from ..ir.graph import Node
from ..ir.linear import SingularMatrix, factorize, matmul, matvec, transpose
from ..mechanics.equations import ConstraintRow, EquationsOfMotion

__all__ = ["Independent", "independent_constraints"]


@final
@dataclass(frozen=True)
class Independent:
    """Equations with independent constraints only, and those that follow from them."""

    equations: EquationsOfMotion
    dropped: tuple[ConstraintRow, ...]


def independent_constraints(equations: EquationsOfMotion) -> Independent:
    """Return the equations without the constraints that follow from others whatever the state.

    Raises
    ------
    ConstraintError
        For a constraint that contradicts the others, or of which neither can be shown.
    """
    graph = equations.graph
    kept: list[ConstraintRow] = []
    dropped: list[ConstraintRow] = []
    for row in equations.constraints:
        trial = [list(r.jacobian) for r in (*kept, row)]
        try:
            factorize(graph, matmul(graph, trial, transpose(trial)))
            kept.append(row)
        except SingularMatrix:
            base = trial[:-1]
            weights: list[Node] = []
            if base:
                normal = factorize(graph, matmul(graph, base, transpose(base)))
                weights = normal.solve(matvec(graph, base, row.jacobian))
            _refuse_unless_it_follows(equations, kept, row, weights)
            dropped.append(row)
    return Independent(replace(equations, constraints=tuple(kept)), tuple(dropped))


def _refuse_unless_it_follows(
    equations: EquationsOfMotion, kept: Sequence[ConstraintRow], row: ConstraintRow, weights: Sequence[Node]
) -> None:
    graph = equations.graph

    def rest(value: Node, values: Sequence[Node | None]) -> Node:
        return value - graph.sum(w * v for w, v in zip(weights, values, strict=True) if v is not None)

    left = [rest(row.drift, [r.drift for r in kept])]
    fixed = all(graph.freed_of(weight, equations.moving) is not None for weight in weights)
    if row.position is not None:
        nonholonomic = any(r.position is None and not w.is_zero for r, w in zip(kept, weights, strict=True))
        if not fixed or nonholonomic:
            raise ConstraintError(
                f"scene {equations.name!r}: {row.label} depends on the other constraints, whatever the state: it"
                " follows from them or contradicts them. Remove it, or correct the one that it repeats"
            )
        left.append(rest(row.position, [r.position for r in kept]))
    if all(node.is_zero for node in left):
        return
    raise ConstraintError(
        f"scene {equations.name!r}: {row.label} contradicts the other constraints, whatever the state."
        " Remove it, or correct the one that it contradicts"
    )
