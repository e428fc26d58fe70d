"""Rank of the constraints at a state: redundant ones, and singular configurations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import list_names
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..once import once_property
from ..reduction.dependent_rows import MOST_RANK, Groups, Redundancy, amplified_rounding
from ..stops.segments import Constants, constants_at
from .constraint_rows import (
    LOST,
    group_shares,
    groups_of_rows,
    jacobians,
    jacobians_at,
    left_of_groups,
    lengths_along,
    rank_of,
    row_lengths,
    shares,
)
from .state_sizes import distance_sizes, gyration_sizes

_ROUNDED = 1e-11
"""Share below which a constraint follows from the others up to rounding; larger differences are meant."""

_MUCH = 0.5
"""Share of what is new of the best row from which on another is taken before it."""

_MANY = 30
"""Constraints from which on their singular values are computed before dependent ones are looked for."""

_VANISHED = 1e-13
"""Share of the longest column of power coefficients, whatever their units, below which another may be rounding."""

_COARSE = 4
"""Rows are scaled by powers of two of this one, so that nearly all starts of a scene share their code."""

_CONSTANT = 1e-9
"""Change of weights at nearby configurations that rounding explains."""

_AMPLIFIED = 1e-5
"""Rounding of dependent rows that are enforced together, beyond which they are not."""

_SETTLED = 1e-13
"""Correction of coordinates, in their sizes, after which another would be rounding."""

_NEARBY = 1e-3
"""Distance, in sizes of coordinates, of the configurations around a start at which the rank is measured too."""


def _dependent(j: FloatArray, share: float = LOST) -> list[int]:
    """Return the rows of a Jacobian with rows of length one of which less than a share is new beside the others.

    Those that are taken before it are far from vanishing, so that they enforce the others around the state: of rows
    that are left, the first of which about as much is new as of any. Of each row at least the least singular value is
    new beside all others, which spares the search among many.
    """
    if len(j) > _MANY and len(j) <= j.shape[1] and np.linalg.svd(j, compute_uv=False)[-1] >= 2.0 * share:
        return []
    rest, left, basis = j.copy(), list(range(len(j))), np.zeros((0, j.shape[1]))
    while left:
        new = np.linalg.norm(rest[left], axis=1)
        if np.max(new) < share:
            break
        place = left.pop(int(np.argmax(new >= _MUCH * np.max(new))))
        direction = rest[place] - basis.T @ (basis @ rest[place])
        basis = np.vstack([basis, direction / np.linalg.norm(direction)])
        rest[left] -= np.outer(rest[left] @ basis[-1], basis[-1])
    return left


class StartRows:
    """Constraints at a start y (n_y,), and how their Jacobian is there and all around it, which is computed once.

    Parameters
    ----------
    program : Program
    t : float
        Time.
    y : (n_y,)
        State.
    c : (n_c,)
        Constants.
    rows : sequence of int
        Numbers of the constraints.
    """

    def __init__(self, program: Program, t: float, y: FloatArray, c: FloatArray, rows: Sequence[int]) -> None:
        self.program, self.t, self.y, self.c, self.rows = program, t, y, c, list(rows)
        self._holonomic = sum(row < program.layout.holonomic for row in rows)

    @once_property
    def _jacobian(self) -> FloatArray:
        """The Jacobian (n_rows, n_q) at the start, for coordinates in their sizes."""
        return jacobians_at(self.program, np.array([self.t]), self.y[np.newaxis], self.c, self.rows)[0]

    @once_property
    def _lengths(self) -> FloatArray:
        """The lengths of its rows (n_rows, 1)."""
        at = self.program, np.array([self.t]), self.y[np.newaxis], self.c
        return lengths_along(*at, self._jacobian[np.newaxis], self.rows)[:, np.newaxis]

    @once_property
    def _unit(self) -> FloatArray:
        """The Jacobian with rows of length one."""
        return self._jacobian / self._lengths

    @once_property
    def _near(self) -> list[FloatArray]:
        """Jacobians at configurations that all constraints allow."""
        return self._at_configurations(len(self.rows))

    @once_property
    def _near_by_positions(self) -> list[FloatArray]:
        """Jacobians at configurations that holonomic constraints allow: rates may lead to any of them."""
        return self._near if self._holonomic == len(self.rows) else self._at_configurations(self._holonomic)

    def _at_configurations(self, count: int) -> list[FloatArray]:
        """Return Jacobians at configurations around the start that the first constraints allow, of length one there."""
        times, found = np.array([self.t]), []
        for x in _around(self.program, self.t, self.y, self.c, self._unit[:count]):
            found.append(jacobians(self.program, times, x[np.newaxis], self.c, self.rows)[0] / self._lengths)
        return found

    def redundant(self) -> tuple[int, ...] | None:
        """Return the constraints that follow from others at the start and all around it.

        Returns
        -------
        tuple of int or None
            Their numbers; none for constraints that are independent. None where the start alone is singular.
        """
        if not np.all(np.isfinite(self._jacobian)):
            return ()
        lost = _dependent(self._unit)
        if not lost:
            return ()
        if any(np.all(np.isfinite(near)) and len(_dependent(near)) < len(lost) for near in self._near):
            return None
        return tuple(self.rows[i] for i in lost)

    def together(self, following: Sequence[int]) -> Redundancy | None:
        """Return what it takes to enforce constraints together, some of which follow from others.

        None where they need not be, because some follow by weights that do not vary, and where they cannot be: groups
        with many independent constraints, and rows that rounding would tell from each other no more.
        """
        rank = len(self.rows) - len(following)
        if rank <= 0 or self._constant_weights(following):
            return None
        lengths = self._lengths[:, 0]
        powers = np.rint(np.log2(lengths / np.max(lengths)) / _COARSE) * _COARSE
        scaled = self._jacobian * 2.0 ** -powers[:, np.newaxis] / np.max(lengths)
        groups: Groups = ()
        if rank > MOST_RANK or self._holonomic < len(self.rows):
            groups = groups_of_rows(np.array([self._unit, *self._near_by_positions]), self._holonomic)
            if rank_of(groups) != rank:
                return None
        for left, count in left_of_groups(scaled, groups or ((tuple(range(len(self.rows))), rank),)):
            if count and not amplified_rounding(left, count) < _AMPLIFIED:
                return None
        return Redundancy(rank, tuple(-int(power) for power in powers), tuple(following), groups)

    def _constant_weights(self, following: Sequence[int]) -> bool:
        """Return whether constraints follow from the others by the same weights all around the start."""
        kept = [place for place, row in enumerate(self.rows) if row not in following]
        others = [place for place, row in enumerate(self.rows) if row in following]
        everywhere = self._unit, *self._near_by_positions
        weights = [j[others] @ np.linalg.pinv(j[kept]) for j in everywhere]
        return bool(np.max(np.ptp(np.array(weights), axis=0), initial=0.0) < _CONSTANT)

    def nearly_redundant(self) -> str:
        """Return where constraints are dependent up to double precision; empty where none are.

        They do not follow from each other: what they differ by is more than rounding, and is lost when it is squared.
        """
        program, c, times = self.program, self.c, np.array([self.t])
        x = interpret_rows(program.kernel("expand"), times, self.y[np.newaxis], c)[0]
        closed = _closed(program, self.t, x, c)[np.newaxis]
        j = jacobians(program, times, closed, c, self.rows)
        if not np.all(np.isfinite(j)):
            return ""
        j = j[0] / row_lengths(program, times, closed, c, self.rows)[0][:, np.newaxis]
        if len(_dependent(j, _ROUNDED)) == len(_dependent(j)):
            return ""
        return (
            f"{self.where_dependent()}, by more than rounding: allowed motions cannot be determined with this"
            " formulation in double precision. Make them equal or more different, or use formulation='minimal'"
        )

    def where_dependent(self) -> str:
        """Return which constraints come to depend on each other, and where."""
        return where_dependent(self.program, self.t, self.y, self.c, self.rows)


def unlike(
    program: Program,
    t: FloatArray,
    y: FloatArray,
    c: FloatArray,
    rows: Sequence[int],
    *,
    lost: bool,
    rank: int | Groups | None = None,
) -> NDArray[np.bool_]:
    """Return which starts t (k,), y (k, n_y), c (k, n_c) have constraints that depend on each other, or do not.

    Parameters
    ----------
    rows : sequence of int
        The constraints.
    lost : bool
        Whether some of them are expected to follow from others.
    rank : int or Groups, optional
        The rank that is expected of them instead, or the groups with their ranks.
    """
    found = np.zeros(len(t), bool)
    fine = np.flatnonzero(np.all(np.isfinite(np.column_stack([t, y, c])), axis=1))
    if not len(fine):
        return found
    t, c = t[fine], c[fine]
    x = interpret_rows(program.kernel("expand"), t, y[fine], c)
    lengths = row_lengths(program, t, x, c, rows)[:, :, np.newaxis]
    j, ones = jacobians(program, t, x, c, rows) / lengths, np.ones(len(rows))
    if rank is not None:
        below = shares(j, ones, rank)
        whole = rank_of(rank)
        above = shares(j, ones, whole + 1) if whole < min(j.shape[1:]) else np.zeros(len(j))
        found[fine] = np.isfinite(below) & ((below < LOST) | (above >= LOST))
        return found
    least = shares(j, ones)
    found[fine] = np.isfinite(least) & ((least < LOST) != lost)
    return found


def _around(program: Program, t: float, y: FloatArray, c: FloatArray, j: FloatArray) -> list[FloatArray]:
    """Return coordinates and rates at some configurations near a start that fulfil the constraints."""
    times, n = np.array([t]), len(program.layout.coordinates)
    x0 = interpret_rows(program.kernel("expand"), times, y[np.newaxis], c)[0]
    _, values, directions = np.linalg.svd(j)
    free = directions[int(np.sum(values > LOST)) :]
    found, sizes = [], distance_sizes(program, t, x0, c)
    for direction in [*free, np.sum(free, axis=0)]:
        x = x0.copy()
        x[:n] += _NEARBY * sizes * direction
        found.append(_closed(program, t, x, c))
    return found


def _closed(program: Program, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return coordinates and rates x (2 n_q,) with the coordinates moved onto the constraints."""
    times, n = np.array([t]), len(program.layout.coordinates)
    if "position_residual" not in program:
        return x
    x = x.copy()
    sizes = gyration_sizes(program, times, x[np.newaxis], c)
    for _ in range(8):
        left = interpret_rows(program.kernel("position_residual"), times, x[np.newaxis], c)[0]
        whole = interpret_rows(program.kernel("constraint_jacobian"), times, x[np.newaxis], c)[0]
        rows = whole.reshape(-1, n)[: len(left)]
        if not (np.all(np.isfinite(left)) and np.all(np.isfinite(rows))):
            break
        rows = rows * sizes
        lengths = row_lengths(program, times, x[np.newaxis], c, range(len(left)))[0]
        step = np.linalg.pinv(rows / lengths[:, np.newaxis], rcond=1e-5) @ (left / lengths)
        x[:n] -= sizes * step
        if np.linalg.norm(step) < _SETTLED:
            break
    return x


def where_dependent(
    program: Program, t: float, y: FloatArray, c: Constants, enforced: Sequence[int], rank: int | Groups | None = None
) -> str:
    """Return which constraints come to depend on each other, and where; of a rank that they have elsewhere."""
    layout = program.layout
    times, rows = np.array([t]), y[np.newaxis]
    c = constants_at(c, times)
    j = jacobians_at(program, times, rows, c, enforced)
    unit = j[0] / lengths_along(program, times, rows, c, j, enforced)[:, np.newaxis]
    what = ""
    if isinstance(rank, tuple):
        found = group_shares(unit[np.newaxis], rank)[0]
        number = int(np.argmin(found))
        enforced = [enforced[i] for i in rank[number][0]]
        unit, rank = left_of_groups(unit, rank)[number]
        what = "are enforced in groups, and these add less to the others there than elsewhere"
    left, values, _ = np.linalg.svd(unit)
    least = len(values) - 1 if rank is None else rank - 1
    weights = np.abs(left[:, least])
    labels = [layout.constraints[enforced[i]] for i in range(len(weights)) if weights[i] > 0.2 * weights.max()]
    x = interpret_rows(program.kernel("expand"), times, rows, c)[0]
    place = ", ".join(f"{name} = {x[i]:.6g}" for i, name in enumerate(layout.coordinates))
    where = f"at t = {t:.6g} ({place})"
    if len(labels) == 1 and not what:
        return f"{where} the derivatives of {labels[0]} by the coordinates vanish, or nearly so"
    what = what or "depend on each other, or nearly so"
    return f"{where} the constraints {list_names(labels)} {what} (smallest singular value {values[least]:.1e})"


def indeterminate(program: Program, t: float, y: FloatArray, c: FloatArray) -> str:
    """Return which of the requested reactions the equations do not determine at a state, as a note."""
    if "reaction_matrix" not in program:
        return ""
    layout = program.layout
    x = interpret_rows(program.kernel("expand"), np.array([t]), y[np.newaxis], c)
    rows = interpret_rows(program.kernel("reaction_matrix"), np.array([t]), x, c)
    matrix = rows.reshape(len(layout.coordinates), len(layout.unknowns))
    if not np.all(np.isfinite(matrix)):
        return ""
    matrix = matrix * gyration_sizes(program, np.array([t]), x, c)[:, np.newaxis]
    lengths = np.linalg.norm(matrix, axis=0)
    lengths = np.maximum(lengths, _VANISHED * np.max(lengths, initial=0.0))
    _, values, directions = np.linalg.svd(matrix / np.where(lengths > 0.0, lengths, 1.0))
    loose = directions[int(np.sum(values > LOST * np.max(values, initial=0.0))) :]
    weights = np.max(np.abs(loose), axis=0, initial=0.0)
    from_bodies = {n for n, column in zip(layout.unknowns, matrix.T, strict=True) if not column.any()}
    from_bodies &= {*layout.undetermined}  # what no coordinate determines comes from balances of bodies
    asked = [name for name in layout.outputs if name not in from_bodies]
    names = [n for n, weight in zip(layout.unknowns, weights, strict=True) if weight > LOST and n in asked]
    return f"the reactions {list_names(names)} are not determined here, and the least ones are given" if names else ""
