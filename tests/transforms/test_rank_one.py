"""Diagonal less a dyad: recognised by value, and solved to what the factorization gives."""

import pytest

from dalembert.ir.graph import Graph
from dalembert.transforms.linear import factorize
from dalembert.transforms.rank_one import diagonal_less_dyad

PARAMETERS = ("a", "b", "c", "d", "k", "w")


@pytest.fixture
def g():
    return Graph()


def moving(graph):
    return ~graph.mask(PARAMETERS)


def matrix(graph, diagonal, scale, vector):
    """Return diag(diagonal) - scale vector vector^T."""
    size = range(len(vector))
    return [[(diagonal[i] if i == j else 0) - scale * (vector[i] * vector[j]) for j in size] for i in size]


def parameters(graph):
    return [graph.input(name) for name in PARAMETERS]


def vertical(graph):
    """Return the vertical along the axes of a body turned by three angles."""
    theta, phi = graph.input("theta"), graph.input("phi")
    return [graph.sin(theta) * graph.sin(phi), graph.sin(theta) * graph.cos(phi), graph.cos(theta)]


def weighted(graph):
    return [x * weight for x, weight in zip(vertical(graph), (1, graph.input("w"), 3), strict=True)]


def four(graph):
    return [*vertical(graph), graph.input("q") * graph.input("q")]


@pytest.mark.parametrize("vector", [vertical, weighted, four])
def test_the_solution_is_that_of_the_factorization(g, vector):
    *diagonal, k, _ = parameters(g)
    values = vector(g)
    rows = matrix(g, diagonal, k, values)
    parts = diagonal_less_dyad(g, rows, moving(g))
    assert parts is not None
    b = [g.input(f"b{i}") for i in range(len(values))]
    found = parts.solve(b)
    for row, entry in zip(rows, b, strict=True):
        assert g.sum(x * y for x, y in zip(row, found, strict=True)) is entry
    assert found == factorize(g, rows).solve(b)


def test_a_common_factor_that_is_no_square_stays_outside(g):
    a, b, c, *_ = parameters(g)
    h, values = g.input("q"), vertical(g)
    rows = matrix(g, [a, b, c], h, values)
    rhs = [g.input("x"), g.input("y"), g.one]
    parts = diagonal_less_dyad(g, [[-e if i != j else e for j, e in enumerate(row)] for i, row in enumerate(rows)], 0)
    assert parts is None  # nothing varies: there are no terms to tell apart
    parts = diagonal_less_dyad(g, rows, moving(g))
    assert parts is not None
    assert parts.solve(rhs) == factorize(g, rows).solve(rhs)


def test_written_otherwise_it_is_recognised_all_the_same(g):
    a, b, c, _, k, _ = parameters(g)
    theta, phi = g.input("theta"), g.input("phi")
    first, second, third = vertical(g)
    s, c2 = g.sin(theta), g.cos(theta)
    rows = matrix(g, [a, b, c], k, [first, second, third])
    rows[2][2] = c - k + k * (s * s)
    rows[1][0] = k * (c2 * c2) * (g.sin(phi) * g.cos(phi)) - k * (g.sin(phi) * g.cos(phi))
    assert diagonal_less_dyad(g, rows, moving(g)) is not None


def _added(g, a, k, v):
    return matrix(g, a, -k, v)


def _of_two_rows(g, a, k, v):
    return matrix(g, a[:2], k, v[:2])


def _with_a_zero(g, a, k, v):
    return matrix(g, a, k, [v[0], g.zero, v[2]])


def _on_a_varying_diagonal(g, a, k, v):
    return matrix(g, [a[0], a[1] * g.input("q"), a[2]], k, v)


def _of_rank_two(g, a, k, v):
    rows = matrix(g, a, k, v)
    rows[1][0] = rows[1][0] * g.input("q")
    return rows


@pytest.mark.parametrize("build", [_added, _of_two_rows, _with_a_zero, _on_a_varying_diagonal, _of_rank_two])
def test_other_matrices_are_left_to_the_factorization(g, build):
    *diagonal, k, _ = parameters(g)
    rows = build(g, diagonal[:3], k, vertical(g))
    assert diagonal_less_dyad(g, rows, moving(g)) is None
