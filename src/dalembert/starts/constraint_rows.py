"""Rows of the constraint Jacobian at states: their lengths, and how far each is from depending on the others.

Measured by the smallest singular value of the constraint Jacobian, its `share` below, with rows of length one: 1 for
constraints that are orthogonal to each other, 0 where one follows from others. A row that vanishes somewhere, or is
what rounding leaves of zero, is to count as dependent there, so that rows are measured by how long they are elsewhere
and by what changes when everything is rounded differently. Rows may have different units, and are not compared. Where
some coordinates are angles and others are lengths, lengths are measured by the radius of gyration.

The rows of long mechanisms are solved group by group (`dalembert.reduction.grouped_rows`). What the groups before leave
of the rows of one is their part across to these, and its rank is to be the same all along a motion: a run ends where
it falls, though all groups together may have their rank there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..reduction.dependent_rows import MOST_RANK, Groups
from ..stops.segments import Constants, constants_at
from .state_sizes import coordinate_sizes, gyration_sizes

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


_SHORT = 0.1
"""Share of the length that a row has elsewhere which it counts as having, and of the longest row, below which its own
length alone does not tell its scale."""

_NOISE, _ROUNDINGS, _UNIT = 1e8, 6, 4e-16
"""Inverse of the share of a row that may be rounding, and the number and the size of the roundings tried."""


def jacobians(program: Program, t: FloatArray, x: FloatArray, c: FloatArray, enforced: Sequence[int]) -> FloatArray:
    """Return constraint Jacobians (k, n_enforced, n_q) at coordinates and rates x (k, 2 n_q), by the sizes of both."""
    layout = program.layout
    rows = interpret_rows(program.kernel("constraint_jacobian"), t, x, c)
    rows = rows.reshape(len(t), len(layout.constraints), len(layout.coordinates))[:, list(enforced)]
    found: FloatArray = rows * gyration_sizes(program, t, x, c)
    return found


def jacobians_at(program: Program, t: FloatArray, y: FloatArray, c: Constants, enforced: Sequence[int]) -> FloatArray:
    """Return constraint Jacobians (k, n_enforced, n_q) at states y (k, n_y), for coordinates in their sizes."""
    c = constants_at(c, t)
    return jacobians(program, t, interpret_rows(program.kernel("expand"), t, y, c), c, enforced)


def row_lengths(program: Program, t: FloatArray, x: FloatArray, c: FloatArray, enforced: Sequence[int]) -> FloatArray:
    """Return the scales (k, n_enforced) of constraints at coordinates and rates x (k, 2 n_q).

    The lengths of their rows there, at least a tenth of those where coordinates differ by their sizes, and so long that
    rounding is not new.
    """
    return _scaled(program, t, x, c, enforced, _lengths(jacobians(program, t, x, c, enforced)))


def lengths_along(
    program: Program, t: FloatArray, y: FloatArray, c: Constants, j: FloatArray, enforced: Sequence[int]
) -> FloatArray:
    """Return the scales (n_enforced,) of constraints along states y (k, n_y), from their Jacobians j."""
    t, y = t[:1], y[:1]
    c = constants_at(c, t)
    x = interpret_rows(program.kernel("expand"), t, y, c)
    longest = np.fmax.reduce(_lengths(j), axis=0, keepdims=True)
    return _scaled(program, t, x, c, enforced, longest)[0]


def _lengths(j: FloatArray) -> FloatArray:
    lengths: FloatArray = np.linalg.norm(j, axis=2)
    return lengths


def _scaled(
    program: Program, t: FloatArray, x: FloatArray, c: FloatArray, enforced: Sequence[int], lengths: FloatArray
) -> FloatArray:
    """Return lengths of rows (k, n_enforced), raised where some are much shorter than others beside them."""
    found = np.nan_to_num(lengths, nan=0.0, posinf=0.0)
    uneven = np.flatnonzero(np.any(found < _SHORT * np.max(found, axis=1, keepdims=True), axis=1))
    if len(uneven):
        own = c if c.ndim == 1 else c[uneven]
        found[uneven] = np.fmax(found[uneven], _least_lengths(program, t[uneven], x[uneven], own, enforced))
    return np.where(found > 0.0, found, 1.0)


def _least_lengths(
    program: Program, t: FloatArray, x: FloatArray, c: FloatArray, enforced: Sequence[int]
) -> FloatArray:
    """Return the least scales (k, n_enforced) of constraints, from other and from otherwise rounded coordinates."""
    n, sizes = len(program.layout.coordinates), coordinate_sizes(program, t, x, c)
    pattern = 0.5 + np.modf(0.6180339887498949 * np.arange(1.0, n + 1.0))[0] / 2
    found = np.zeros((len(t), len(enforced)))
    for sign in (1.0, -1.0):
        moved = x.copy()
        moved[:, :n] += sizes * np.where(np.arange(n) % 2 == 0, 1.0, sign) * pattern
        found = np.fmax(found, _SHORT * _lengths(jacobians(program, t, moved, c, enforced)))
    rng, other = np.random.default_rng(0), []
    for _ in range(_ROUNDINGS):
        near, given = (v * (1.0 + _UNIT * rng.uniform(-1.0, 1.0, v.shape[-1])) for v in (x, c))
        other.append(jacobians(program, t, near, given, enforced))
    return np.fmax(found, _NOISE * _lengths(np.ptp(np.array(other), axis=0)))


def kept_shares(j: FloatArray, lengths: FloatArray, kept: Sequence[int]) -> FloatArray:
    """Return how well some rows of Jacobians (k, n_rows, n_q) enforce all of them: 1 exactly, 0 where they lose rank.

    The cosine of the angle between the combinations of all rows that do not vanish, and the rows that are kept; a
    violation of the others is as large as one of these over it. NaN where all rows lose rank, or are not finite.
    """
    found, rank = np.full(len(j), np.nan), len(kept)
    fine = np.flatnonzero(np.all(np.isfinite(j), axis=(1, 2)))
    if not 0 < rank <= min(j.shape[1:]) or not len(fine):
        return found
    left, values, _ = np.linalg.svd(j[fine] / lengths[:, np.newaxis], full_matrices=False)
    regular = values[:, rank - 1] > LOST * values[:, 0]
    chosen = left[regular][:, list(kept), :rank]
    found[fine[regular]] = np.linalg.svd(chosen, compute_uv=False)[:, -1]
    return found


def correction_turns(
    program: Program, t: FloatArray, x: FloatArray, c: FloatArray, enforced: Sequence[int], lengths: FloatArray
) -> FloatArray:
    """Return by how much (k,) the correction of coordinates onto the constraints turns Jacobians; NaN where unknown.

    It is one Newton step from coordinates and rates x (k, 2 n_q). Rows have the `lengths` (n_enforced,), and the norm
    is that of `shares`.
    """
    n, found = len(program.layout.coordinates), np.full(len(t), np.nan)
    holonomic = [(place, row) for place, row in enumerate(enforced) if row < program.layout.holonomic]
    places, rows = [place for place, _ in holonomic], [row for _, row in holonomic]
    left = interpret_rows(program.kernel("position_residual"), t, x, c)[:, rows] / lengths[places]
    j = jacobians(program, t, x, c, enforced) / lengths[:, np.newaxis]
    fine = np.flatnonzero(np.all(np.isfinite(left), axis=1) & np.all(np.isfinite(j), axis=(1, 2)))
    t, x, c = t[fine], x[fine], c if c.ndim == 1 else c[fine]
    moved = x.copy()
    moved[:, :n] -= gyration_sizes(program, t, x, c) * np.einsum(
        "kij,kj->ki", np.linalg.pinv(j[fine][:, places], rcond=LOST * LOST), left[fine]
    )
    turns = jacobians(program, t, moved, c, enforced) / lengths[:, np.newaxis] - j[fine]
    known = np.all(np.isfinite(turns), axis=(1, 2))
    found[fine[known]] = np.linalg.norm(turns[known], ord=2, axis=(1, 2))
    return found
