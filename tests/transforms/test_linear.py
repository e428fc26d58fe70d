"""Unrolled linear algebra against numpy, with the sparsity that it promises."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dalembert.ir.graph import Graph
from dalembert.transforms.linear import SingularMatrix, factorize, matmul, matvec, transpose
from ir.trees import evaluate


def inputs(graph, pattern):
    """Return a symmetric matrix of inputs a_i_j where the pattern has entries."""
    size = len(pattern)
    return [
        [graph.input(f"a_{max(i, j)}_{min(i, j)}") if pattern[i][j] else graph.zero for j in range(size)]
        for i in range(size)
    ]


def values(matrix):
    return {f"a_{i}_{j}": matrix[i, j] for i in range(len(matrix)) for j in range(i + 1) if matrix[i, j]}


def random_symmetric(pattern, rng):
    matrix = rng.uniform(-1, 1, pattern.shape) * pattern
    matrix = np.tril(matrix) + np.tril(matrix, -1).T
    return matrix + np.diag(np.abs(matrix).sum(1) + 1.0)


@st.composite
def patterns(draw):
    size = draw(st.integers(1, 7))
    entries = draw(st.lists(st.booleans(), min_size=size * size, max_size=size * size))
    pattern = np.array(entries).reshape(size, size)
    return pattern | pattern.T | np.eye(size, dtype=bool)


@settings(max_examples=80)
@given(patterns(), st.integers(0, 2**32 - 1))
def test_solution_is_that_of_numpy_for_any_pattern(pattern, seed):
    rng = np.random.default_rng(seed)
    matrix, b = random_symmetric(pattern, rng), rng.uniform(-1, 1, len(pattern))
    graph = Graph()
    a = inputs(graph, pattern)
    rhs = [graph.input(f"b_{i}") for i in range(len(b))]
    factors = factorize(graph, a)
    x = factors.solve(rhs)
    inner = factors.inner(factors.half_solve(rhs), factors.half_solve(list(a[0])))
    point = {**values(matrix), **{f"b_{i}": value for i, value in enumerate(b)}}
    *solution, product = evaluate(graph, [*x, inner], point)
    np.testing.assert_allclose(solution, np.linalg.solve(matrix, b), rtol=1e-11, atol=1e-13)
    assert product == pytest.approx(b @ np.linalg.solve(matrix, matrix[0]), rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("size", range(1, 7))
def test_factors_multiply_back_to_the_matrix(size):
    rng = np.random.default_rng(size)
    pattern = np.ones((size, size), dtype=bool)
    matrix = random_symmetric(pattern, rng)
    graph = Graph()
    factors = factorize(graph, inputs(graph, pattern))
    entries = [(i, j, node) for i, row in enumerate(factors.lower) for j, node in row.items()]
    found = evaluate(graph, [node for _, _, node in entries] + list(factors.pivots), values(matrix))
    L = np.eye(size)
    for (i, j, _), value in zip(entries, found, strict=False):
        L[i, j] = value
    D = np.diag(found[len(entries) :])
    order = list(factors.order)
    np.testing.assert_allclose(L @ D @ L.T, matrix[np.ix_(order, order)], rtol=1e-12, atol=1e-13)
    assert sorted(order) == list(range(size))


def fill(pattern):
    """Return the entries of L beyond those of the matrix's lower triangle."""
    graph = Graph()
    factors = factorize(graph, inputs(graph, pattern))
    return sum(map(len, factors.lower)) - int(np.tril(pattern, -1).sum())


@pytest.mark.parametrize("hub", [0, 3, 7])
def test_arrow_matrices_do_not_fill(hub):
    pattern = np.eye(8, dtype=bool)
    pattern[hub, :] = pattern[:, hub] = True
    assert fill(pattern) == 0


@pytest.mark.parametrize("size", [2, 5, 20])
def test_tridiagonal_matrices_do_not_fill(size):
    pattern = np.eye(size, dtype=bool) | np.eye(size, k=1, dtype=bool) | np.eye(size, k=-1, dtype=bool)
    assert fill(pattern) == 0


def test_trees_do_not_fill():
    """Branched mechanisms: an entry for every pair on one path to the root, the leaves eliminated first."""
    parent = [None, 0, 1, 1, 0, 4, 4]
    pattern = np.eye(7, dtype=bool)
    for i in range(7):
        j = parent[i]
        while j is not None:
            pattern[i, j] = pattern[j, i] = True
            j = parent[j]
    assert fill(pattern) == 0


def test_diagonal_matrices_cost_one_division_an_unknown():
    graph = Graph()
    pattern = np.eye(6, dtype=bool)
    x = factorize(graph, inputs(graph, pattern)).solve([graph.input(f"b_{i}") for i in range(6)])
    assert [node.op for node in x] == ["div"] * 6
    assert sum(bool(node.args) for node in graph.topological(x)) == 6


@pytest.mark.parametrize(
    ("rows", "index"),
    [
        ([[0]], 0),
        ([[1, 0, 0], [0, 0, 0], [0, 0, 2]], 1),
        ([["a", 0], [0, 0]], 1),
        ([[0, 0], [0, "a"]], 0),
    ],
)
def test_zero_pivots_are_named(rows, index):
    graph = Graph()
    matrix = [[graph.input(e) if isinstance(e, str) else graph.const(e) for e in row] for row in rows]
    with pytest.raises(SingularMatrix) as caught:
        factorize(graph, matrix)
    assert caught.value.index == index


def test_symbolically_singular_matrix_is_found_after_elimination():
    graph = Graph()
    u, v = graph.sin(graph.input("x")), graph.cos(graph.input("x"))
    with pytest.raises(SingularMatrix):
        factorize(graph, [[u * u, u * v], [u * v, v * v]])


def test_only_the_lower_triangle_is_read():
    graph = Graph()
    a, b, c = (graph.input(name) for name in "abc")
    poisoned = [[a, graph.input("never")], [b, c]]
    x = factorize(graph, poisoned).solve([graph.one, graph.zero])
    (first, second) = evaluate(graph, x, {"a": 2.0, "b": 0.5, "c": 1.0})
    np.testing.assert_allclose([first, second], np.linalg.solve([[2.0, 0.5], [0.5, 1.0]], [1.0, 0.0]))


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 4), st.integers(0, 1000))
@settings(max_examples=25)
def test_products_are_those_of_numpy(n, m, k, seed):
    rng = np.random.default_rng(seed)
    a, b, x = rng.integers(-3, 4, (n, m)), rng.integers(-3, 4, (m, k)), rng.integers(-3, 4, m)
    graph = Graph()
    nodes = [[[graph.const(int(e)) for e in row] for row in matrix] for matrix in (a, b)]
    product = matmul(graph, *nodes)
    assert [[int(e.number) for e in row] for row in product] == (a @ b).tolist()
    assert [int(e.number) for e in matvec(graph, nodes[0], [graph.const(int(e)) for e in x])] == (a @ x).tolist()
    assert transpose(nodes[0]) == [list(column) for column in zip(*nodes[0], strict=True)]
