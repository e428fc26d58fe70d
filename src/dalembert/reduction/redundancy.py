"""Redundant constraints: those that follow from others at every state, found and removed on the graph.

A row of the constraint Jacobian that is a combination of others is redundant. It is removed where the rest
of the constraint is the same combination. Its reactions are not determined. Where the weights of a combination vary,
a constraint may not follow everywhere, and rows that are kept may vanish: runs watch that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..errors import ConstraintError
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import magnitude, vanishes
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..transforms.derivatives import tangents
from ..transforms.linear import SingularMatrix, factorize, guarded_pivot, matmul, transpose


@final
@frozen
class Independent:
    """Equations with independent constraints only, and the redundant constraints.

    Attributes
    ----------
    equations : EquationsOfMotion
    dropped : tuple of ConstraintRow
        Constraints that follow from the others.
    unproven : tuple of ConstraintRow
        Those of `dropped` that follow by weights that vary.
    """

    equations: EquationsOfMotion
    dropped: tuple[ConstraintRow, ...]
    unproven: tuple[ConstraintRow, ...]

    @property
    def decided(self) -> bool:
        """Whether anything was decided that the equations did not say before."""
        return bool(self.dropped) or any(row.undecided for row in self.equations.constraints)


@final
@frozen
class _Reduced:
    """A row of the constraint Jacobian less multiples of others, so that it is zero at their pivots.

    Attributes
    ----------
    entries : list of Node, length n_q
    weights : list of Node
        Its share of every constraint that is kept.
    pivot : int
    """

    entries: list[Node]
    weights: list[Node]
    pivot: int


def independent_constraints(equations: EquationsOfMotion) -> Independent:
    """Return the equations without the constraints that follow from others at every state.

    Rows are eliminated themselves, not their scalar products: those of rows that differ by a share of 1e-9, which is
    more than the rounding of decimals makes, differ by 1e-18.

    Raises
    ------
    ConstraintError
        For a constraint that contradicts the others, or of which neither can be shown.
    """
    graph = equations.graph
    kept: list[ConstraintRow] = []
    reduced: list[_Reduced] = []
    found: list[ConstraintRow] = []
    dropped: list[ConstraintRow] = []
    unproven: list[ConstraintRow] = []
    for row in equations.constraints:
        entries, weights = _eliminated(graph, row, reduced)
        pivots = [i for i, entry in enumerate(entries) if not entry.is_zero]
        if pivots:
            found.append(row)
            kept.append(row)
            reduced.append(_Reduced(entries, [*weights, graph.one], max(pivots, key=lambda i: magnitude(entries[i]))))
            continue
        weights = [-weight for weight in weights]
        varying = _vary(equations, weights)
        if varying and row.position is not None and not _exactly_dependent(equations, kept, row):
            found.append(replace(row, undecided=True))
            continue
        _refuse_unless_it_follows(equations, kept, row, weights, varying=varying)
        dropped.append(row)
        unproven += [row] if varying else []
    return Independent(replace(equations, constraints=tuple(found)), tuple(dropped), tuple(unproven))


def _eliminated(graph: Graph, row: ConstraintRow, reduced: Sequence[_Reduced]) -> tuple[list[Node], list[Node]]:
    """Return a row of the Jacobian without what others span, and its weights."""
    entries, weights = list(row.jacobian), [graph.zero] * len(reduced)
    for other in reduced:
        if not entries[other.pivot].is_zero:
            share = entries[other.pivot] / other.entries[other.pivot]
            entries = [_less(a, share * b) for a, b in zip(entries, other.entries, strict=True)]
            entries[other.pivot] = graph.zero
            for i, weight in enumerate(other.weights):
                weights[i] = weights[i] - share * weight
    return entries, weights


def _less(a: Node, b: Node) -> Node:
    """Return a - b, exactly zero where only the rounding of decimals is left of it."""
    rest = a - b
    return a.graph.zero if vanishes(rest) else rest


def _exactly_dependent(equations: EquationsOfMotion, kept: Sequence[ConstraintRow], row: ConstraintRow) -> bool:
    """Return whether guarded pivots of a row and independent ones show the dependence without sampling decimals."""
    graph, rows = equations.graph, [each.jacobian for each in (*kept, row)]
    try:
        factorize(graph, matmul(graph, rows, transpose(rows)), guarded_pivot)
    except SingularMatrix as singular:
        return singular.exact
    return False


def _vary(equations: EquationsOfMotion, weights: Sequence[Node]) -> bool:
    """Return whether weights depend on anything that moves."""
    return not all(vanishes(slope) for weight in weights for slope in _slopes(equations, weight))


def _refuse_unless_it_follows(
    equations: EquationsOfMotion,
    kept: Sequence[ConstraintRow],
    row: ConstraintRow,
    weights: Sequence[Node],
    *,
    varying: bool,
) -> None:
    graph = equations.graph

    def rest(value: Node, values: Sequence[Node | None]) -> Node:
        return value - graph.sum(w * v for w, v in zip(weights, values, strict=True) if v is not None)

    left = [rest(row.drift, [r.drift for r in kept])]
    if row.position is not None:
        nonholonomic = any(r.position is None and not vanishes(w) for r, w in zip(kept, weights, strict=True))
        if nonholonomic or varying:
            raise ConstraintError(
                f"scene {equations.name!r}: {row.label} depends on the other constraints at every state: it"
                " follows from them or contradicts them. Remove it, or correct the one that it repeats"
            )
        left.append(rest(row.position, [r.position for r in kept]))
    if all(vanishes(node) or _depends_on_parameters_alone(equations, node) for node in left):
        return  # whether parameters contradict each other is seen in the residuals at the start of a run
    raise ConstraintError(
        f"scene {equations.name!r}: {row.label} contradicts the other constraints at every state."
        " Remove it, or correct the one that it contradicts"
    )


def _depends_on_parameters_alone(equations: EquationsOfMotion, node: Node) -> bool:
    """Return whether a value depends on parameters and, up to the rounding of decimals, on nothing that moves."""
    graph, moving = equations.graph, equations.moving
    free = graph.freed_of(node, moving)
    if free is not None:
        return bool(free.deps)
    if not all(vanishes(slope) for slope in _slopes(equations, node)):
        return False
    parameters = [x for x in graph.topological([node]) if x.op == "input" and x not in moving]
    return not all(vanishes(tangents(graph, [node], {x: graph.one})[0]) for x in parameters)


def _slopes(equations: EquationsOfMotion, node: Node) -> list[Node]:
    """Return the derivatives of a value by all moving inputs, without those that are identically zero."""
    graph = equations.graph
    if graph.freed_of(node, equations.moving) is not None:
        return []
    return [tangents(graph, [node], {x: graph.one})[0] for x in equations.moving]
