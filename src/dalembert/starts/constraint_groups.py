"""Groups of constraints that are enforced together: of each, those before it leave a small rank.

The rows of long mechanisms are solved group by group (`dalembert.reduction.grouped_rows`). What the groups before leave
of the rows of one is their part across to these, and its rank is to be the same all along a motion: a run ends where
it falls, though all groups together may have their rank there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray
from ..reduction.dependent_rows import MOST_RANK, Groups

LOST = 1e-7
"""Share below which rank is lost."""

Group = tuple[tuple[int, ...], int]


def rank_of(ranks: int | Groups) -> int:
    """Return the rank of rows, from their groups where they have some."""
    return ranks if isinstance(ranks, int) else sum(rank for _, rank in ranks)


def shares(j: FloatArray, lengths: FloatArray, rank: int | Groups | None = None) -> FloatArray:
    """Return the smallest singular values (k,) of Jacobians (k, n_enforced, n_q), NaN where they are not finite.

    Of rows of a smaller rank, those that do not vanish; of rows in groups, the least of what each adds.
    """
    if isinstance(rank, tuple):
        return np.min(group_shares(j / lengths[:, np.newaxis], rank), axis=1)
    found = np.full(len(j), np.nan)
    fine = np.all(np.isfinite(j), axis=(1, 2))
    if rank is not None:
        if np.any(fine):
            found[fine] = np.linalg.svd(j[fine] / lengths[:, np.newaxis], compute_uv=False)[:, rank - 1]
    elif j.shape[1] == 1:
        found = np.linalg.norm(j[:, 0], axis=1) / lengths[0]
    elif j.shape[1] > j.shape[2]:
        found[fine] = 0.0
    elif np.any(fine):
        found[fine] = np.linalg.svd(j[fine] / lengths[:, np.newaxis], compute_uv=False)[:, -1]
    return found


def group_shares(j: FloatArray, groups: Groups) -> FloatArray:
    """Return the least singular value (k, n_groups) of what each group adds to those before it, by its rank.

    One for a group that adds nothing; NaN where Jacobians are not finite.
    """
    found = np.full((len(j), len(groups)), np.nan)
    fine = np.flatnonzero(np.all(np.isfinite(j), axis=(1, 2)))
    for number, (rest, rank) in enumerate(left_of_groups(j[fine], groups)):
        found[fine, number] = np.linalg.svd(rest, compute_uv=False)[:, rank - 1] if rank else 1.0
    return found


def groups_of_rows(j: FloatArray, holonomic: int) -> Groups:
    """Return groups of rows of unit Jacobians (k, n_rows, n_q) of the same ranks in all; none where these are large.

    First those of positions, of which the first number is given, then those of rates. Each kind is one group, or else
    rows are grouped that have the same coordinates.
    """
    kinds = [kind for kind in (range(holonomic), range(holonomic, j.shape[1])) if len(kind)]
    moving = np.any(np.abs(j) > LOST, axis=0)
    found: list[Group] = []
    for kind in kinds:
        alike: dict[bytes, list[int]] = {}
        for row in kind:
            alike.setdefault(moving[row].tobytes(), []).append(row)
        for some in ([list(kind)], list(alike.values())):
            tried = list(found)
            for rows in some:
                left = left_of_groups(j, [*tried, (tuple(rows), 0)])[-1][0]
                ranks = {int(np.sum(values > LOST)) for values in np.linalg.svd(left, compute_uv=False)}
                tried.append((tuple(rows), ranks.pop() if len(ranks) == 1 else MOST_RANK + 1))
            if all(rank <= MOST_RANK for _, rank in tried):
                break
        else:
            return ()
        found = tried
    return tuple(found)


def left_of_groups(j: FloatArray, groups: Sequence[Group]) -> list[tuple[FloatArray, int]]:
    """Return for each group what those before it leave of its rows of Jacobians (..., n_rows, n_q), and its rank."""
    rest, found = j, []
    for rows, rank in groups:
        own = rest[..., list(rows), :]
        found.append((own, rank))
        across = np.linalg.svd(own, full_matrices=False)[2][..., :rank, :]
        rest = rest - (rest @ np.swapaxes(across, -1, -2)) @ across
    return found
