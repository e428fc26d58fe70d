"""Symmetric matrices of the form diagonal less dyad, such as the inertia of a rolling body about its contact.

diag(d) - k h g g^T with d and k fixed along a motion is solved by Sherman and Morrison's formula (Annals of
Mathematical Statistics 21, 1950): 3 n products and one quotient of varying values, where L D L^T needs O(n**3).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import vanishes
from .polynomial import Monomial, Polynomials, pythagorean, sign, times

_NODES = 400


@final
@frozen
class DiagonalLessDyad:
    """diag(diagonal) - scale vector vector^T, vector = weights * values, with fixed diagonal and weights."""

    graph: Graph
    diagonal: tuple[Node, ...]
    scale: Node
    weights: tuple[Node, ...]
    values: tuple[Node, ...]

    @property
    def regular(self) -> bool:
        """Whether the matrix is not singular at every place, up to the rounding of decimals."""
        return not any(vanishes(pivot) for pivot in (*self.diagonal, self._determinant_factor()))

    def _determinant_factor(self) -> Node:
        """Return the determinant divided by the product of the diagonal."""
        terms = zip(self.weights, self.diagonal, self.values, strict=True)
        return 1 - self.scale * self.graph.sum(w / d * w * (g * g) for w, d, g in terms)

    def solve(self, b: Sequence[Node]) -> list[Node]:
        """Return A^-1 b."""
        graph = self.graph
        shares = [w / d for w, d in zip(self.weights, self.diagonal, strict=True)]
        along = graph.sum(s * (g * x) for s, g, x in zip(shares, self.values, b, strict=True))
        lift = self.scale * along / self._determinant_factor()
        return [x / d + s * (g * lift) for x, d, s, g in zip(b, self.diagonal, shares, self.values, strict=True)]


def diagonal_less_dyad(graph: Graph, a: Sequence[Sequence[Node]], moving: int) -> DiagonalLessDyad | None:
    """Return the parts of a symmetric matrix of three rows or more, or None where it is not of this kind.

    `moving` holds the dependency bits of what varies along a motion. Only a dyad that is taken away will do: then a
    positive definite matrix has a positive diagonal, whatever the numbers. Entries off the diagonal are products, which
    vanish with none of the numbers that a body has: no division by zero can occur.
    """
    size = range(len(a))
    below = [a[i][j] for i in size for j in range(i)]
    if len(a) < 3 or any(entry.is_zero for entry in below):
        return None
    if sum(1 for _ in islice(graph.topological(below), _NODES + 1)) > _NODES:
        return None
    values = Polynomials(graph, moving)
    terms: dict[tuple[int, int], tuple[Monomial, Node]] = {}
    for i in size:
        for j in range(i):
            p = pythagorean(graph, values.of(a[i][j]), _form, canonical=True)
            if len(p) != 1:
                return None
            ((monomial, c),) = p.items()
            if _may_cancel(graph, c):
                return None
            terms[i, j] = terms[j, i] = monomial, c
    squares = []
    for i in size:
        square = _square(terms, i, [j for j in size if j != i])
        if square is None:
            return None
        squares.append(square)
    return _parts(graph, a, values, terms, squares)


def _may_cancel(graph: Graph, c: Node) -> bool:
    """Return whether a coefficient, which others are divided by, has terms that may cancel, such as A - B."""
    return any(node.op in ("add", "sub") for node in graph.topological([c]))


def _form(node: Node) -> tuple[str, tuple[Node, ...]]:
    return node.op, node.args


def _square(
    terms: dict[tuple[int, int], tuple[Monomial, Node]], i: int, others: Sequence[int]
) -> tuple[Monomial, Node] | None:
    """Return entry i, i of the dyad that has the entries off the diagonal, or None where they are of no dyad."""
    found: tuple[Monomial, Node] | None = None
    for place, j in enumerate(others):
        for k in others[place + 1 :]:
            (m, c), (n, d), (o, e) = terms[i, j], terms[i, k], terms[j, k]
            entry = times(times(m, n), o, -1), c * d / e
            if found is not None and (found[0] != entry[0] or found[1] is not entry[1]):
                return None
            found = entry
    return found


def _parts(
    graph: Graph,
    a: Sequence[Sequence[Node]],
    values: Polynomials,
    terms: dict[tuple[int, int], tuple[Monomial, Node]],
    squares: Sequence[tuple[Monomial, Node]],
) -> DiagonalLessDyad | None:
    common = [tuple((atom, 1) for atom, e in monomial if e % 2) for monomial, _ in squares]
    if any(odd != common[0] for odd in common) or not all(sign(c)[0] for _, c in squares):
        return None
    diagonal = []
    for i, (monomial, c) in enumerate(squares):
        dyad = _value(graph, monomial) * c
        rest = pythagorean(graph, values.of(a[i][i] - dyad), _form, canonical=True)
        if rest.keys() != {()}:
            return None
        diagonal.append(rest[()])
    size = range(len(a))
    roots = [times(monomial, common[0], -1) for monomial, _ in squares]
    vector = [_value(graph, tuple((atom, e // 2) for atom, e in root)) for root in roots]
    weights = [graph.one, *(terms[0, i][1] / squares[0][1] for i in size[1:])]
    scale = -squares[0][1] * _value(graph, common[0])
    return DiagonalLessDyad(graph, tuple(diagonal), scale, tuple(weights), tuple(vector))


def _value(graph: Graph, monomial: Monomial) -> Node:
    result = graph.one
    for atom, exponent in monomial:
        for _ in range(abs(exponent)):
            node = graph.nodes[atom]
            result = result * node if exponent > 0 else result / node
    return result
