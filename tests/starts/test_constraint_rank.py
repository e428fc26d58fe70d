"""Rows of a Jacobian that follow from the others, among many."""

import numpy as np
import pytest

from dalembert.starts import constraint_rank
from dalembert.starts.constraint_rows import LOST


def _rows(count, seed, share=None):
    """Return random rows of length one, the last a combination of two others but for a share, if any."""
    rng = np.random.default_rng(seed)
    j = rng.normal(size=(count, count + 7))
    j /= np.linalg.norm(j, axis=1)[:, np.newaxis]
    if share is not None:
        new = j[-1] - np.linalg.lstsq(j[:-1].T, j[-1], rcond=None)[0] @ j[:-1]
        j[-1] = (j[3] + j[5]) / np.linalg.norm(j[3] + j[5]) + share * new / np.linalg.norm(new)
        j[-1] /= np.linalg.norm(j[-1])
    return j


@pytest.mark.parametrize(("share", "lost"), [(None, 0), (1e2 * LOST, 0), (3 * LOST, 0), (1e-2 * LOST, 1), (0.0, 1)])
def test_many_rows_have_those_that_the_search_finds(share, lost, monkeypatch):
    """The least singular value decides where it can, and never against the search."""
    j = _rows(40, 3, share)
    found = constraint_rank._dependent(j)
    monkeypatch.setattr(constraint_rank, "_MANY", 1000)
    assert found == constraint_rank._dependent(j)
    assert len(found) == lost


def test_independent_rows_are_not_searched(monkeypatch):
    """The search among 763 rows took seconds of every run of a net."""
    j = _rows(200, 5)

    def search(*_):
        raise AssertionError("searched")

    monkeypatch.setattr(constraint_rank.np, "vstack", search)
    assert constraint_rank._dependent(j) == []
    with pytest.raises(AssertionError, match="searched"):
        constraint_rank._dependent(_rows(200, 5, 0.0))


def test_more_rows_than_columns_are_searched():
    """Of 50 rows in 45 columns five follow from others, whatever the singular values of the 45 are."""
    j = np.random.default_rng(1).normal(size=(50, 45))
    assert len(constraint_rank._dependent(j / np.linalg.norm(j, axis=1)[:, np.newaxis])) == 5
