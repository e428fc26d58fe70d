"""Solutions of the equations of reactions: by normal equations, of minimum norm, and of least elastic energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion
from ..transforms.linear import SET_ASIDE, Matrix, factorize, guarded_pivot, matmul, matvec, transpose

_ORDINARY = 1e-2, 1e2
"""Squares of radii of gyration for which forces and torques are compared as they are."""

_SHIFT, _IMPROVEMENTS = 1e-7, 2
"""Share of the trace, or of the diagonal, that is added to it, and how often what it leaves of energies is improved."""


def reaction_solver(equations: EquationsOfMotion, reactions: Matrix) -> Callable[[Sequence[Node]], list[Node]]:
    """Return the function from what reactions have to supply (n_q,) to these (k,), by normal equations.

    `reactions` are independent columns (n_q, k) of power coefficients.
    """
    graph, columns = equations.graph, weighted_columns(equations, reactions)
    normal = factorize(graph, matmul(graph, columns, reactions))
    return lambda supplied: normal.solve(matvec(graph, columns, supplied))


def weighted_columns(equations: EquationsOfMotion, matrix: Matrix) -> Matrix:
    """Return the columns of power coefficients (n_q, k) for normal equations, rows of angles by an inverse square.

    It is that of the radius of gyration, by the entries of the mass matrix that are functions of the parameters: beside
    forces, the torques of supports a micrometre apart would be lost in rounding. It is one where the radius is of the
    size of one, or where nothing is mixed.
    """
    graph, columns = equations.graph, transpose(matrix)
    angles = [name in equations.angles for name in equations.symbols.coordinates]
    kinds = {angle for angle, row in zip(angles, matrix, strict=True) if any(not entry.is_zero for entry in row)}
    if len(columns) < 2 or len(kinds) < 2:
        return columns
    moving = ~graph.mask(equations.symbols.parameters)
    diagonal = equations.diagonal
    known = [(entry, angle) for entry, angle in zip(diagonal, angles, strict=True) if not entry.deps & moving]
    inertia = graph.sum(entry for entry, angle in known if angle)
    mass = graph.sum(entry for entry, angle in known if not angle)
    if inertia.is_zero or mass.is_zero:
        return columns
    turns = graph.call("less", graph.zero, inertia)
    square = mass / graph.call("select", turns, inertia, mass)
    low, high = (graph.node(bound) for bound in _ORDINARY)
    above = graph.call("select", graph.call("less", square, high), graph.one, square)
    weight = graph.call("select", graph.call("less", low, square), above, square)
    return [[entry * weight if angle else entry for entry, angle in zip(c, angles, strict=True)] for c in columns]


def minimum_norm(
    equations: EquationsOfMotion,
    matrix: Matrix,
    residual: Sequence[Node],
    improvements: int = 1,
    *,
    throughout: bool,
) -> list[Node]:
    """Return the solution of minimum norm of equations whose columns come to depend on each other.

    Of the normal equations with a small part of their trace on the diagonal, improved so often by what they leave. The
    equations are then off by the power of that part with one more than the improvements: 1e-14 or more after one.

    Columns depend on each other `throughout`, or at some places alone. Then that part is left out everywhere else: a
    reaction that grows towards such a place would be off by the more the nearer it comes. Where something slides, none
    is known at the place: the work of friction that grows with it is not either.
    """
    graph, columns = equations.graph, weighted_columns(equations, matrix)
    normal = matmul(graph, columns, matrix)
    lost = graph.one if throughout else _lost(graph, normal)
    small = graph.node(_SHIFT) * graph.sum(normal[i][i] for i in range(len(normal))) * lost
    for i in range(len(normal)):
        normal[i][i] = normal[i][i] + small
    factors = factorize(graph, normal)
    solution = factors.solve(matvec(graph, columns, residual))
    for _ in range(improvements):
        rest = [r - v for r, v in zip(residual, matvec(graph, matrix, solution), strict=True)]
        more = factors.solve(matvec(graph, columns, rest))
        solution = [a + b for a, b in zip(solution, more, strict=True)]
    if not throughout and any(guard.kind == "paradox" for guard in equations.guards):
        known = graph.call("sqrt", graph.one - graph.node(2) * lost)  # 1 or NaN
        solution = [known * x for x in solution]
    return solution


def _lost(graph: Graph, normal: Matrix) -> Node:
    """Return 1 where columns with these products depend on each other, and 0 elsewhere."""
    one_or_huge = graph.one
    for pivot in factorize(graph, normal, guarded_pivot).pivots:
        kept = graph.call("less", pivot, graph.node(SET_ASIDE))
        one_or_huge = one_or_huge * graph.call("select", kept, graph.one, graph.node(SET_ASIDE))
    return graph.one - graph.one / one_or_huge


def least_energy(
    equations: EquationsOfMotion, rows: Matrix, unknowns: Sequence[Node], demands: Sequence[Node]
) -> list[Node]:
    """Return the reactions x with A x = b of the least elastic energy, 1/2 sum c_i x_i^2.

    They are those of supports on rigid bodies that move: x = W A^T y, with W = diag(1 / c) and A W A^T y = b. Unknowns
    without a compliance are determined, so that any weight serves for them. Rows that come to depend on each other have
    a small part of the diagonal beside it; what that leaves is improved, and is 1e-14 or less of the reactions.
    """
    graph = equations.graph
    names = [str(node.payload) for node in unknowns]
    given = [equations.compliances[name] for name in names if name in equations.compliances]
    mean = graph.sum(given) / graph.node(float(len(given))) if given else graph.one
    weighted = [
        [entry / equations.compliances.get(name, mean) for entry, name in zip(row, names, strict=True)] for row in rows
    ]
    normal, across = matmul(graph, weighted, transpose(rows)), transpose(weighted)
    small = graph.node(_SHIFT**2) * graph.sum(normal[i][i] for i in range(len(normal)))
    for i in range(len(normal)):
        normal[i][i] = normal[i][i] * graph.node(1.0 + _SHIFT) + small
    factors = factorize(graph, normal)
    solution = matvec(graph, across, factors.solve(demands))
    for _ in range(_IMPROVEMENTS):
        rest = [b - a for a, b in zip(matvec(graph, rows, solution), demands, strict=True)]
        more = matvec(graph, across, factors.solve(rest))
        solution = [a + b for a, b in zip(solution, more, strict=True)]
    return solution
