"""Solutions of systems of known rank, without a choice of rows."""

import numpy as np
import pytest

from dalembert.ir.graph import Graph
from dalembert.reduction.dependent_rows import MOST_RANK, RankSolver, amplified_rounding, least_share

LARGEST = 1e-12


def psd(size, rank, condition, seed=0):
    """Return J of a rank, singular values between 1 and 1 / condition, and J J^T as nodes."""
    rng, graph = np.random.default_rng(seed), Graph()
    left, right = (np.linalg.qr(rng.normal(size=(n, n)))[0][:, :rank] for n in (size, rank + 1))
    rows = left * np.geomspace(1.0, 1.0 / condition, rank) @ right.T
    return graph, rows, [[graph.node(float(x)) for x in row] for row in rows @ rows.T]


@pytest.mark.parametrize("rank", range(1, MOST_RANK + 1))
@pytest.mark.parametrize("more", [1, 3])
def test_solutions_within_the_range_are_exact(rank, more):
    graph, rows, matrix = psd(rank + more, rank, 30.0)
    wanted = rows @ np.random.default_rng(1).normal(size=rows.shape[1])
    solution = RankSolver.of(graph, matrix, rank).solve([graph.node(float(x)) for x in wanted])
    np.testing.assert_allclose(rows @ rows.T @ [float(x.number) for x in solution], wanted, atol=LARGEST)


def test_the_part_beside_the_range_is_left_out():
    graph, rows, matrix = psd(4, 2, 3.0)
    basis = np.linalg.svd(rows)[0]
    beside = [graph.node(float(x)) for x in basis[:, 2] + basis[:, 0]]
    found = [float(x.number) for x in RankSolver.of(graph, matrix, 2).within(beside)]
    np.testing.assert_allclose(found, basis[:, 0], atol=LARGEST)


def test_least_share_follows_the_least_eigenvalue():
    for condition in (1.0, 10.0, 1e4):
        graph, _, matrix = psd(4, 3, condition)
        ratio = float(least_share(graph, matrix, 3).number) * condition**2
        assert 1 / 3.0001 < ratio < 1.0001


def test_rounding_that_is_amplified_is_known_before():
    assert amplified_rounding(psd(4, 2, 10.0)[1], 2) < 1e-12
    assert amplified_rounding(psd(8, 5, 1e5)[1], 5) > 1e-5
