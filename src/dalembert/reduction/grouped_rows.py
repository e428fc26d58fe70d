"""Solutions of A x = b for a positive semidefinite A of known rank, group by group of its rows.

Rounding limits the formula of `dalembert.reduction.dependent_rows` to small ranks. Rows of long mechanisms, and those
of velocity constraints beside those of positions, come in groups: of each the rows before leave a part S_gg of A, with
a rank r_g that is small. A generalized inverse X_g of it by that formula takes the place of the inverse in the block
elimination L D L^T, S_hk - S_hg X_g S_gk, which is exact for a semidefinite A (F. Burns, D. Carlson, E. Haynsworth and
T. Markham, SIAM Journal on Applied Mathematics 26 (1974) 254-259). No pivot is chosen within a group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import ConstraintRow
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix, matmul, matvec
from .dependent_rows import RankSolver, Redundancy, least_share

_IMPROVEMENTS = 1


@final
@frozen
class _Group:
    """Rows of a group, the solver of what the groups before leave of them, and X_g S_gj by the rows j that come later.

    Without a solver, the rows follow from those of the groups before.
    """

    rows: tuple[int, ...]
    solver: RankSolver | None
    later: Mapping[int, list[Node]]


@final
@frozen
class GroupSolver:
    """Solutions x of A x = b for a positive semidefinite A whose rows have known ranks by groups, and b in its range.

    Attributes
    ----------
    graph : Graph
    matrix : Matrix
        A.
    groups : tuple of _Group
    """

    graph: Graph
    matrix: Matrix
    groups: tuple[_Group, ...]

    @staticmethod
    def of(graph: Graph, matrix: Matrix, groups: Sequence[tuple[tuple[int, ...], int]]) -> GroupSolver:
        """Return the solver for a matrix (m, m) with groups of rows, each with the rank that it adds."""
        left = [list(row) for row in matrix]
        found: list[_Group] = []
        for number, (rows, rank) in enumerate(groups):
            if rank == 0:
                found.append(_Group(rows, None, {}))
                continue
            solver = RankSolver.of(graph, [[left[i][j] for j in rows] for i in rows], rank)
            beside = [j for others, _ in groups[number + 1 :] for j in others]
            coupled = [j for j in beside if any(not left[i][j].is_zero for i in rows)]
            later = {j: solver.solve([left[i][j] for i in rows]) for j in coupled}
            for a in coupled:
                for b in coupled:
                    if b <= a:
                        taken = graph.sum(left[a][i] * x for i, x in zip(rows, later[b], strict=True))
                        left[a][b] = left[b][a] = left[a][b] - taken
            found.append(_Group(rows, solver, later))
        return GroupSolver(graph, matrix, tuple(found))

    def solve(self, b: Sequence[Node]) -> list[Node]:
        """Return a solution, improved by what rounding leaves of the equations."""
        solution = self._once(b)
        for _ in range(_IMPROVEMENTS):
            rest = [x - y for x, y in zip(b, matvec(self.graph, self.matrix, solution), strict=True)]
            solution = [x + y for x, y in zip(solution, self._once(rest), strict=True)]
        return solution

    def _once(self, b: Sequence[Node]) -> list[Node]:
        graph, left, found = self.graph, list(b), [self.graph.zero] * len(b)
        for group in self.groups:
            for j, weights in group.later.items():
                left[j] = left[j] - graph.sum(w * left[i] for w, i in zip(weights, group.rows, strict=True))
        for group in reversed(self.groups):
            if group.solver is None:
                continue
            own = group.solver.solve([left[i] for i in group.rows])
            for place, i in enumerate(group.rows):
                found[i] = own[place] - graph.sum(w[place] * found[j] for j, w in group.later.items())
        return found

    def within(self, b: Sequence[Node]) -> list[Node]:
        """Return b without a part beside the range of the matrix, by a projector that need not be orthogonal."""
        return matvec(self.graph, self.matrix, self._once(b))

    def least_share(self) -> Node:
        """Return a lower bound of the least eigenvalue that does not vanish of any S_gg, by the number of groups."""
        graph = self.graph
        inverse = [
            graph.one / least_share(graph, group.solver.matrix, group.solver.rank)
            for group in self.groups
            if group.solver is not None
        ]
        return graph.one / graph.sum(inverse)


Solver = RankSolver | GroupSolver


def solver_of(graph: Graph, matrix: Matrix, redundancy: Redundancy) -> Solver:
    """Return the solver for the rows of a matrix that constraints have, or the first of them."""
    groups = redundancy.groups_of(len(matrix))
    if len(groups) == 1:
        return RankSolver.of(graph, matrix, groups[0][1])
    return GroupSolver.of(graph, matrix, groups)


def turning_demand(
    graph: Graph, rows: Sequence[ConstraintRow], solver: Solver, flow: Mapping[Node, Node]
) -> list[Node]:
    """Return what is demanded of J q_ddot besides the bias, so that violations do not grow by turns of the range of J.

    The equations fulfil P phi_ddot, with a projector P onto the range, which `solver` has. A violation phi = U z, U
    being a basis of the range with P U_dot = 0, has P phi_ddot = U z_ddot - P_dot^2 phi. With -P_dot^2 phi demanded of
    it, z_ddot is zero. Rates have no such turns.
    """
    positions = [graph.zero if row.position is None else row.position for row in rows]
    if isinstance(solver, RankSolver):
        gram = [[graph.sum(a * b for a, b in zip(x.jacobian, y.jacobian, strict=True)) for y in rows] for x in rows]
        own = RankSolver.of(graph, gram, solver.rank)
        product, size = matmul(graph, gram, own.gradient), range(len(rows))
        turned = tangents(graph, [entry / own.product for row in product for entry in row], flow)
        rates = [turned[i * len(rows) : (i + 1) * len(rows)] for i in size]
        return [-value for value in matvec(graph, rates, matvec(graph, rates, positions))]
    constant = [graph.input(f"violation {i}") for i in range(len(rows))]
    turning = tangents(graph, solver.within(constant), flow)
    for _ in range(2):
        positions = graph.substitute(turning, dict(zip(constant, positions, strict=True)))
    return [-value for value in positions]
