"""Rows of constraints that depend on each other wherever the others hold, all enforced together.

A = J M^-1 J^T has the rank r < m on the motion. The multipliers are lam = G b / e, where e, the sum of the principal
minors of A of size r, is the product of its eigenvalues that do not vanish, and G the gradient of e by A (H. P. Decell,
SIAM Review 7 (1965) 526-528; the coefficients by U. J. J. Le Verrier and D. K. Faddeev). It is the mean of the
solutions with r rows each, weighted by their minors (A. Ben-Israel, Linear Algebra and its Applications 173 (1992)
87-111): rows that vanish somewhere weigh nothing there. Both are polynomials of A: beside the motion, where A has a
larger rank, they vary as slowly as A does, no pivot is chosen, and series stay smooth.

Rows that vanish at some angles count as zero beside what they are at others (`row_scale`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
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


# Sizes of rows of the constraint Jacobian that vanish at some angles, beside which they count as zero.
#
# Where the links of a mechanism fold onto one line, the row of a constraint in angles alone, (l cos(a), l cos(b)), may
# vanish as a whole. It has no angle to other rows there, and what rounding leaves of the constraint is a curve that
# turns, within a hundred millionth of a radian, from one branch of the motion to the other.

_PERIODIC = "sin", "cos"

_MOST_ENTRIES = 8
"""Entries of a row among which unit vectors are looked for."""

_TURNED = 12
"""Entries of a row from which on x cos(a) + y sin(a) is bounded by the larger of x and y, the length of what turns: a
bound by their sum doubles with each rotation of a chain, and all rows would count as zero beside it."""


def row_scale(graph: Graph, row: Sequence[Node], inertias: Sequence[Node]) -> Node:
    """Return a lower bound of row M^-1 row^T at angles that make each entry large; zero where the row never vanishes.

    Parameters
    ----------
    graph
        Of the nodes.
    row
        Row of the constraint Jacobian, an entry for each coordinate.
    inertias
        Diagonal of M: the diagonal of its inverse is at least its reciprocal.
    """
    if _never_vanishes(graph, row):
        return graph.zero
    entries = [(entry, inertia) for entry, inertia in zip(row, inertias, strict=True) if not entry.is_zero]
    sizes = _sizes_at_any_angle(graph, [entry for entry, _ in entries], turned=len(entries) > _TURNED)
    known = [size * size / inertia for size, (_, inertia) in zip(sizes, entries, strict=True) if size is not None]
    return graph.sum(known) if len(known) == len(entries) else graph.zero


def _never_vanishes(graph: Graph, row: Sequence[Node]) -> bool:
    """Return whether the squares of some entries, up to three, add up to what no angle makes zero: a unit vector."""
    squares = [entry * entry for entry in row if not entry.is_zero]
    sums = (graph.sum(some) for size in (1, 2, 3) for some in combinations(squares[:_MOST_ENTRIES], size))
    return any(all(node.op not in _PERIODIC for node in graph.topological([total])) for total in sums)


def _sizes_at_any_angle(graph: Graph, nodes: Sequence[Node], *, turned: bool) -> list[Node | None]:
    """Return bounds of values with sines and cosines taken to be one; None for values that have none in all terms."""
    done: dict[int, Node] = {}
    periodic: dict[int, bool] = {}

    def size(node: Node) -> Node:
        a, of = [done[arg.index] for arg in node.args], [periodic[arg.index] for arg in node.args]
        known = {"add": all(of), "sub": all(of), "mul": any(of), "div": any(of[:1]), "neg": any(of)}
        periodic[node.index] = node.op in _PERIODIC or known.get(node.op, False)
        if node.op in _PERIODIC:
            return graph.one
        if node.op in ("add", "sub"):
            turns = turned and all(arg.op == "mul" and any(x.op in _PERIODIC for x in arg.args) for arg in node.args)
            return graph.call("max", a[0], a[1]) if turns else a[0] + a[1]
        if node.op in ("mul", "div"):
            return a[0] * a[1] if node.op == "mul" else a[0] / a[1]
        return a[0] if node.op == "neg" else graph.call("abs", node)

    graph.visit(nodes, done, size)
    return [done[node.index] if periodic[node.index] else None for node in nodes]
