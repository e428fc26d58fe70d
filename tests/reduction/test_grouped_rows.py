"""Solutions group by group of systems whose rows have known ranks."""

import numpy as np
import pytest

from dalembert.ir.graph import Graph
from dalembert.reduction.dependent_rows import RankSolver, Redundancy
from dalembert.reduction.grouped_rows import GroupSolver, solver_of
from dalembert.starts.constraint_rows import group_shares, groups_of_rows, left_of_groups, rank_of

LARGEST = 1e-12
SIZES = (2, 3, 1, 2, 4)
RANKS = (1, 2, 1, 0, 3)
"""Rows of groups, and the rank that each adds; the fourth follows from those before."""


def grouped(seed=0):
    """Return J with such groups, and the groups: a loop of its own for each, coupled to the one before."""
    rng, rows, width, groups = np.random.default_rng(seed), [], sum(RANKS) + 2, []
    spanned = np.zeros((0, width))
    for size, rank in zip(SIZES, RANKS, strict=True):
        own = np.zeros((rank, width))
        own[:, len(spanned) : len(spanned) + rank + 2] = rng.normal(size=(rank, rank + 2))
        mixed = rng.normal(size=(size, rank)) @ own
        if rank == 0:
            mixed = rng.normal(size=(size, len(spanned))) @ spanned
        groups.append((tuple(range(len(rows), len(rows) + size)), rank))
        rows, spanned = [*rows, *mixed], np.vstack([spanned, own])
    return np.array(rows), tuple(groups)


def solver(j, groups):
    graph, matrix = Graph(), j @ j.T
    return graph, GroupSolver.of(graph, [[graph.node(float(x)) for x in row] for row in matrix], groups)


def numbers(nodes):
    return np.array([float(x.number) for x in nodes])


@pytest.mark.parametrize("seed", range(3))
def test_solutions_within_the_range_are_exact(seed):
    j, groups = grouped(seed)
    graph, found = solver(j, groups)
    wanted = j @ np.random.default_rng(9).normal(size=j.shape[1])
    solution = numbers(found.solve([graph.node(float(x)) for x in wanted]))
    np.testing.assert_allclose(j @ j.T @ solution, wanted, atol=LARGEST * np.abs(wanted).max())


def test_what_lies_beside_the_range_is_left_out_by_a_projector():
    j, groups = grouped()
    graph, found = solver(j, groups)
    b = np.random.default_rng(1).normal(size=len(j))
    once = numbers(found.within([graph.node(float(x)) for x in b]))
    twice = numbers(found.within([graph.node(float(x)) for x in once]))
    np.testing.assert_allclose(twice, once, atol=1e-9)
    basis = np.linalg.svd(j)[0][:, : sum(RANKS)]
    np.testing.assert_allclose(basis @ (basis.T @ once), once, atol=1e-9)


def test_the_least_share_bounds_the_least_eigenvalue():
    j, groups = grouped()
    _, found = solver(j, groups)
    least = min(np.linalg.svd(rest)[1][rank - 1] ** 2 for rest, rank in left_of_groups(j, groups) if rank)
    share = float(found.least_share().number)
    assert least / (len(groups) * max(RANKS)) < share < least


def test_rows_of_positions_are_solved_by_their_own_groups():
    j, groups = grouped()
    graph, redundancy = Graph(), Redundancy(sum(RANKS), (0,) * len(j), (), groups)
    count = sum(SIZES[:2])
    matrix = [[graph.node(float(x)) for x in row[:count]] for row in (j @ j.T)[:count]]
    assert [group.rows for group in solver_of(graph, matrix, redundancy).groups] == [(0, 1), (2, 3, 4)]
    alone = solver_of(graph, [row[:2] for row in matrix[:2]], redundancy)
    assert isinstance(alone, RankSolver) and alone.rank == 1


def test_groups_are_found_by_the_coordinates_of_rows():
    ladder = np.zeros((2, 12, 7))
    for place, angle in enumerate((0.3, 0.301)):
        for i in range(6):
            for row, slope in ((2 * i, np.cos(angle)), (2 * i + 1, np.sin(angle))):
                ladder[place, row, [i, i + 1]] = -slope, slope
    groups = groups_of_rows(ladder, 12)
    assert groups == tuple(((2 * i, 2 * i + 1), 1) for i in range(6)) and rank_of(groups) == 6
    assert groups_of_rows(ladder[:, :8], 8) == ((tuple(range(8)), 4),)
    assert groups_of_rows(ladder[:, :8], 4) == (((0, 1, 2, 3), 2), ((4, 5, 6, 7), 2))
    assert groups_of_rows(np.random.default_rng(0).normal(size=(2, 7, 9)), 7) == ()


def test_a_group_that_loses_rank_shows_though_the_whole_does_not():
    angle = np.array([0.5, np.pi / 2])
    j = np.zeros((2, 3, 4))
    j[:, 0, 0], j[:, 1, :2], j[:, 2, 1] = np.cos(angle), np.column_stack([np.sin(angle), [1.0, 1.0]]), 1.0
    shares = group_shares(j, (((0,), 1), ((1,), 1), ((2,), 0)))
    assert shares[0].min() > 0.4 and shares[1, 0] < 1e-15
    assert np.all(np.linalg.matrix_rank(j) == 2)
