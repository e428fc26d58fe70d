"""Columns of power coefficients of reactions: which are independent, and their normal equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import vanishes
from ..mechanics.equations import EquationsOfMotion
from ..transforms.linear import Matrix, dependence, factorize, matmul, matvec, transpose

_ORDINARY = 1e-2, 1e2
"""Squares of radii of gyration for which forces and torques are compared as they are."""


def independent_columns(matrix: Matrix) -> tuple[list[int], set[int]]:
    """Return columns that are independent for almost every state, and those whose weight is not determined.

    A graph of its own decides it: it keeps the form in which a value was computed first, and weights computed here add
    lengths to angles, so that they lose their digits in small and large units.
    """
    graph = Graph()
    columns = [graph.adopt(column) for column in transpose(matrix)] if matrix and matrix[0] else []
    independent: list[int] = []
    free: set[int] = set()
    for number, column in enumerate(columns):
        if all(vanishes(entry) for entry in column):
            free.add(number)
            continue
        weights = dependence(graph, [columns[i] for i in independent], column)
        if weights is None:
            independent.append(number)
        else:
            free |= {number} | {i for i, weight in zip(independent, weights, strict=True) if not vanishes(weight)}
    return independent, free


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
    diagonal = [row[i] for i, row in enumerate(equations.mass_matrix)]
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
