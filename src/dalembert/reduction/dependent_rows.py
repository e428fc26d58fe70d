"""Rows of constraints that depend on each other wherever the others hold, all enforced together.

A = J M^-1 J^T has the rank r < m on the motion. The multipliers are lam = G b / e, where e, the sum of the principal
minors of A of size r, is the product of its eigenvalues that do not vanish, and G the gradient of e by A (H. P. Decell,
SIAM Review 7 (1965) 526-528; the coefficients by U. J. J. Le Verrier and D. K. Faddeev). It is the mean of the
solutions with r rows each, weighted by their minors (A. Ben-Israel, Linear Algebra and its Applications 173 (1992)
87-111): rows that vanish somewhere weigh nothing there. Both are polynomials of A: beside the motion, where A has a
larger rank, they vary as slowly as A does, no pivot is chosen, and series stay smooth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import ConstraintRow
from ..transforms.linear import Matrix, matmul, matvec

Groups = tuple[tuple[tuple[int, ...], int], ...]
"""Groups of rows by their places, and the rank that each adds to those before it."""

MOST_RANK = 5
"""Largest rank of a group that is served: rounding grows with the condition of A to this power, less one."""

_MOST_IMPROVEMENTS = 2
_TINY = 1e-300


@final
@frozen
class Redundancy:
    """Constraints that are enforced together, though some follow from others wherever all hold.

    Attributes
    ----------
    rank : int
        The number of independent ones.
    scales : tuple of int
        Powers of two that make their rows about equally long.
    following : tuple of int
        Those that follow from the others around the start that was looked at, for messages.
    groups : Groups
        Where not all rows are one group: those of positions come first.
    """

    rank: int
    scales: tuple[int, ...]
    following: tuple[int, ...]
    groups: Groups = ()

    @property
    def ranks(self) -> int | Groups:
        """The rank, or the groups with their ranks."""
        return self.groups or self.rank

    def groups_of(self, count: int) -> Groups:
        """Return the groups of the first rows, all or those of positions."""
        whole = self.groups or ((tuple(range(len(self.scales))), self.rank),)
        return tuple(group for group in whole if max(group[0]) < count)

    def scaled(self, rows: Sequence[ConstraintRow]) -> tuple[ConstraintRow, ...]:
        """Return the rows, about equally long."""
        return tuple(_times(row, 2.0**power) if power else row for row, power in zip(rows, self.scales, strict=True))


def _times(row: ConstraintRow, factor: float) -> ConstraintRow:
    by = row.drift.graph.node(factor)
    position = None if row.position is None else row.position * by
    return replace(
        row,
        position=position,
        jacobian=tuple(entry * by for entry in row.jacobian),
        drift=row.drift * by,
        bias=row.bias * by,
    )


@final
@frozen
class RankSolver:
    """Solutions x of A x = b for a positive semidefinite A of known rank, and b in its range.

    Attributes
    ----------
    graph : Graph
    matrix : Matrix
        A.
    gradient : Matrix
        G.
    product : Node
        e.
    rank : int
    """

    graph: Graph
    matrix: Matrix
    gradient: Matrix
    product: Node
    rank: int

    @staticmethod
    def of(graph: Graph, matrix: Matrix, rank: int) -> RankSolver:
        """Return the solver for a matrix (m, m) of some rank, 0 < rank <= m."""
        size = range(len(matrix))
        gradient = [[graph.one if i == j else graph.zero for j in size] for i in size]
        for k in range(1, rank):
            further = matmul(graph, matrix, gradient)
            share = graph.sum(further[i][i] for i in size) / graph.node(float(k))
            gradient = [[(share - further[i][j]) if i == j else -further[i][j] for j in size] for i in size]
            gradient = [[gradient[max(i, j)][min(i, j)] for j in size] for i in size]
        traces = (matrix[i][j] * gradient[i][j] for i in size for j in size)
        return RankSolver(graph, matrix, gradient, graph.sum(traces) / graph.node(float(rank)), rank)

    def solve(self, b: Sequence[Node]) -> list[Node]:
        """Return a solution, improved by what rounding leaves of the equations."""
        solution = self._once(b)
        for _ in range(min(self.rank - 1, _MOST_IMPROVEMENTS)):
            rest = [x - y for x, y in zip(b, matvec(self.graph, self.matrix, solution), strict=True)]
            solution = [x + y for x, y in zip(solution, self._once(rest), strict=True)]
        return solution

    def _once(self, b: Sequence[Node]) -> list[Node]:
        return [value / self.product for value in matvec(self.graph, self.gradient, b)]

    def within(self, b: Sequence[Node]) -> list[Node]:
        """Return the part of b in the range of the matrix."""
        return matvec(self.graph, self.matrix, self._once(b))


def least_share(graph: Graph, gram: Matrix, rank: int) -> Node:
    """Return e_r / e_(r-1) of a matrix of some rank: the least eigenvalue that does not vanish, or up to r-th of it."""
    largest = RankSolver.of(graph, gram, rank)
    below = RankSolver.of(graph, gram, rank - 1).product if rank > 1 else graph.one
    return largest.product / (below + graph.node(_TINY))


def amplified_rounding(rows: FloatArray, rank: int) -> float:
    """Return the share of a right-hand side in the range of J J^T that `RankSolver` gets wrong, for J (m, n)."""
    matrix = rows @ rows.T
    size = len(matrix)
    gradient = np.eye(size)
    for k in range(1, rank):
        further = matrix @ gradient
        gradient = np.trace(further) / k * np.eye(size) - further
    product = float(np.trace(matrix @ gradient)) / rank
    if not product > 0.0:
        return np.inf
    basis = np.linalg.svd(matrix)[0][:, :rank]
    return float(np.linalg.norm(basis - matrix @ (gradient @ basis) / product, 2))
