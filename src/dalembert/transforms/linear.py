"""Linear algebra and quaternions on the graph, without operations on structural zeros and without expansion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import vanishes

Matrix = list[list[Node]]


class SingularMatrix(ArithmeticError):
    """A pivot of a symmetric matrix is identically zero, up to the rounding of decimals.

    Attributes
    ----------
    index : int
        Its row.
    exact : bool
        Whether it is zero without any rounding.
    """

    def __init__(self, index: int, *, exact: bool = True) -> None:
        super().__init__(f"pivot {index} is identically zero")
        self.index, self.exact = index, exact


def transpose(a: Sequence[Sequence[Node]]) -> Matrix:
    """Return the transpose of a matrix with at least one row."""
    return [list(column) for column in zip(*a, strict=True)]


def matvec(graph: Graph, a: Sequence[Sequence[Node]], x: Sequence[Node]) -> list[Node]:
    """Return the product of a matrix and a vector."""
    return [product(graph, row, x) for row in a]


def product(graph: Graph, a: Sequence[Node], b: Sequence[Node]) -> Node:
    """Return the scalar product of two vectors."""
    nothing = graph.zero
    return graph.sum(u * v for u, v in zip(a, b, strict=True) if u is not nothing and v is not nothing)


def matmul(graph: Graph, a: Sequence[Sequence[Node]], b: Sequence[Sequence[Node]]) -> Matrix:
    """Return the product of two matrices."""
    columns = transpose(b)
    return [[product(graph, row, column) for column in columns] for row in a]


class Factors(ABC):
    """P A P^T = L D L^T of a symmetric matrix, L unit lower triangular, in any form that solves equations.

    Attributes
    ----------
    order : sequence of int
        Row of A that stands at each place.
    pivots : sequence of Node
        The diagonal D.
    """

    graph: Graph
    order: Sequence[int]
    pivots: Sequence[Node]

    @property
    @abstractmethod
    def reduced(self) -> Sequence[bool]:
        """Whether each pivot may differ from the entry of A that it came from."""

    @abstractmethod
    def half_solve(self, b: Sequence[Node]) -> list[Node]:
        """Return L^-1 P b."""

    @abstractmethod
    def finish(self, half: Sequence[Node]) -> list[Node]:
        """Return A^-1 b from the half solution L^-1 P b."""

    def solve(self, b: Sequence[Node]) -> list[Node]:
        """Return A^-1 b."""
        return self.finish(self.half_solve(b))

    def inner(self, a: Sequence[Node], b: Sequence[Node]) -> Node:
        """Return x . A^-1 y from the half solutions a = L^-1 P x and b = L^-1 P y."""
        terms = zip(a, b, self.pivots, strict=True)
        return self.graph.sum(x * y / pivot for x, y, pivot in terms if not (x.is_zero or y.is_zero))

    def inner_products(self, halves: Sequence[Sequence[Node]]) -> Matrix:
        """Return the lower triangle of B A^-1 B^T from half solutions, one a row of B."""
        places = [[k for k, value in enumerate(half) if not value.is_zero] for half in halves]
        meeting: list[list[int]] = [[] for _ in self.pivots]
        found: Matrix = []
        for i, (half, own) in enumerate(zip(halves, places, strict=True)):
            terms: dict[int, list[int]] = {}
            for k in own:
                meeting[k].append(i)
                for j in meeting[k]:
                    terms.setdefault(j, []).append(k)
            row = [self.graph.zero] * (i + 1)
            for j in sorted(terms):
                row[j] = self.graph.sum(half[k] * halves[j][k] / self.pivots[k] for k in terms[j])
            found.append(row)
        return found


@final
@frozen
class Factorization(Factors):
    """Factors whose L is stored without its zeros.

    Attributes
    ----------
    lower : tuple of dict
        Row i of L as {column: value}, columns < i.
    """

    graph: Graph
    order: tuple[int, ...]
    lower: tuple[dict[int, Node], ...]
    pivots: tuple[Node, ...]

    @property
    def reduced(self) -> Sequence[bool]:
        """See `Factors.reduced`."""
        return [bool(row) for row in self.lower]

    def half_solve(self, b: Sequence[Node]) -> list[Node]:
        """See `Factors.half_solve`."""
        x: list[Node] = []
        for place, row in enumerate(self.order):
            value = b[row]
            for column, entry in self.lower[place].items():
                value = value - entry * x[column]
            x.append(value)
        return x

    def finish(self, half: Sequence[Node]) -> list[Node]:
        """See `Factors.finish`."""
        x = [value / pivot for value, pivot in zip(half, self.pivots, strict=True)]
        for place in range(len(x) - 1, -1, -1):
            for column, entry in self.lower[place].items():
                x[column] = x[column] - entry * x[place]
        result = list(x)
        for place, row in enumerate(self.order):
            result[row] = x[place]
        return result


def _elimination_order(a: Sequence[Sequence[Node]]) -> list[int]:
    """Return a minimum-degree order; among equals the last row goes first, which follows a tree from its leaves."""
    size = len(a)
    neighbours = {i: {j for j in range(size) if j != i and not a[i][j].is_zero} for i in range(size)}
    order: list[int] = []
    while neighbours:
        pivot = min(neighbours, key=lambda i: (len(neighbours[i]), -i))
        order.append(pivot)
        clique = neighbours.pop(pivot)
        for i in sorted(clique):
            neighbours[i] = (neighbours[i] | clique) - {i, pivot}
    return order


Guard = Callable[[Node, Node, int], Node]
"""A pivot, the diagonal entry that it came from, and the row of that -> the pivot to divide by."""


SET_ASIDE = 1e300
"""Pivot in place of one that counts as zero. The comparison that selects it is a guard, not a switch of the motion: no
step ends at its zeros (`dalembert.transforms.taylor.nonsmooth`)."""


DEPENDENT = 1e-13
"""Square of the sine of the angle to the constraints before it below which a constraint counts as dependent, and share
of its size below which a row counts as zero."""


def guarded_pivot(pivot: Node, terms: Node, row: int = 0) -> Node:
    """Return a pivot, or `SET_ASIDE` where it is next to nothing beside the terms that it came from."""
    graph = pivot.graph
    enough = graph.call("less", graph.node(DEPENDENT) * terms, pivot)
    return graph.call("select", enough, pivot, graph.node(SET_ASIDE))


def factorize(
    graph: Graph, a: Sequence[Sequence[Node]], guard: Guard | None = None, *, set_aside: bool = False
) -> Factorization:
    """Return the sparse L D L^T of a symmetric matrix of which only the lower triangle is read.

    With `guard`, pivots are replaced by what it makes of them; with `set_aside`, those that are identically zero by
    `SET_ASIDE`.

    Raises
    ------
    SingularMatrix
        When a pivot is identically zero, up to the rounding of decimals (`dalembert.ir.zero_tests`).
    """
    size = len(a)
    full = [[a[max(i, j)][min(i, j)] for j in range(size)] for i in range(size)]
    order = _elimination_order(full)
    lower: list[dict[int, Node]] = [{} for _ in range(size)]
    pivots: list[Node] = []
    work = [[full[order[i]][order[j]] for j in range(i + 1)] for i in range(size)]
    for k in range(size):
        pivot = work[k][k]
        if vanishes(pivot):
            if not set_aside:
                raise SingularMatrix(order[k], exact=pivot.is_zero)
            pivot = graph.node(SET_ASIDE)
        elif guard is not None:
            pivot = guard(pivot, full[order[k]][order[k]], order[k])
        pivots.append(pivot)
        column = [(i, work[i][k]) for i in range(k + 1, size) if not vanishes(work[i][k])]
        for i, entry in column:
            lower[i][k] = entry / pivot
        for place, (i, _) in enumerate(column):
            for j, entry in column[: place + 1]:
                work[i][j] = work[i][j] - lower[i][k] * entry
    return Factorization(graph, tuple(order), tuple(lower), tuple(pivots))


def dependence(graph: Graph, base: Sequence[Sequence[Node]], row: Sequence[Node]) -> list[Node] | None:
    """Return the weights with which independent rows add up to another one; None where it does not depend on them."""
    trial = [*base, row]
    try:
        factorize(graph, matmul(graph, trial, transpose(trial)))
    except SingularMatrix:
        return factorize(graph, matmul(graph, base, transpose(base))).solve(matvec(graph, base, row)) if base else []
    return None


@final
class Elimination:
    """Factors of a matrix by elimination along the diagonal, without operations on structural zeros.

    With `guard`, pivots are replaced by what it makes of them.

    Raises
    ------
    SingularMatrix
        When a pivot is identically zero, up to the rounding of decimals (`dalembert.ir.zero_tests`).

    Attributes
    ----------
    pivots : list of Node
        Their product is the determinant.
    """

    def __init__(self, graph: Graph, a: Sequence[Sequence[Node]], guard: Guard | None = None) -> None:
        self.graph, self.pivots = graph, list[Node]()
        self._upper = [list(row) for row in a]
        self._lower: list[list[tuple[int, Node]]] = [[] for _ in a]
        for k, row in enumerate(self._upper):
            pivot = row[k]
            if vanishes(pivot):
                raise SingularMatrix(k)
            if guard is not None:
                pivot = guard(pivot, a[k][k], k)
            self.pivots.append(pivot)
            for i in range(k + 1, len(a)):
                below = self._upper[i]
                if not below[k].is_zero:
                    factor = below[k] / pivot
                    self._lower[i].append((k, factor))
                    below[k:] = [x - factor * y for x, y in zip(below[k:], row[k:], strict=True)]

    def solve(self, b: Sequence[Node]) -> list[Node]:
        """Return A^-1 b."""
        x, size = list(b), range(len(b))
        for i in size:
            for k, factor in self._lower[i]:
                x[i] = x[i] - factor * x[k]
        for i in reversed(size):
            rest = x[i] - self.graph.sum(self._upper[i][j] * x[j] for j in size[i + 1 :])
            x[i] = rest / self.pivots[i]
        return x


def determinant_and_solution(graph: Graph, a: Sequence[Sequence[Node]], b: Sequence[Node]) -> tuple[Node, list[Node]]:
    """Return det A and A^-1 b of a small matrix, by elimination along the diagonal.

    Raises
    ------
    SingularMatrix
        When a pivot is identically zero, up to the rounding of decimals (`dalembert.ir.zero_tests`).
    """
    size = len(a)
    rows = [[*row, value] for row, value in zip(a, b, strict=True)]
    determinant = graph.one
    for k in range(size):
        pivot = rows[k][k]
        if vanishes(pivot):
            raise SingularMatrix(k)
        determinant = determinant * pivot
        for i in range(k + 1, size):
            if not rows[i][k].is_zero:
                factor = rows[i][k] / pivot
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
    x: list[Node] = [graph.zero] * size
    for i in reversed(range(size)):
        rest = rows[i][size] - graph.sum(rows[i][j] * x[j] for j in range(i + 1, size))
        x[i] = rest / rows[i][i]
    return determinant, x


# Quaternions on the graph, scalar first, from components on a body to components on its reference frame.
#
# With e.e = 1 the rates are e_dot = 1/2 E omega, and omega = 2 E^T e_dot, which are regular everywhere (R.
# Featherstone, Rigid Body Dynamics Algorithms, section 4.5).


def rotation_entries(e: Sequence[Node]) -> list[list[Node]]:
    """Return the matrix (3, 3) from components on the body to those on its reference frame."""
    e0, e1, e2, e3 = e
    return [
        [e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3, 2 * (e1 * e2 - e0 * e3), 2 * (e0 * e2 + e1 * e3)],
        [2 * (e0 * e3 + e1 * e2), e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3, 2 * (e2 * e3 - e0 * e1)],
        [2 * (e1 * e3 - e0 * e2), 2 * (e0 * e1 + e2 * e3), e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3],
    ]


def spin_matrix(e: Sequence[Node], *, body: bool) -> list[list[Node]]:
    """Return E (4, 3), for components of the angular velocity on the body or on its reference frame."""
    e0, e1, e2, e3 = e
    if body:
        return [[-e1, -e2, -e3], [e0, -e3, e2], [e3, e0, -e1], [-e2, e1, e0]]
    return [[-e1, -e2, -e3], [e0, e3, -e2], [-e3, e0, e1], [e2, -e1, e0]]
