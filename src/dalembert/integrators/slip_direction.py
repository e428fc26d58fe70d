"""Directions in which slip in a plane begins: those in which the acceleration of slip points.

Friction opposes the direction, and the slip acceleration depends on it. For one contact, the angle is a root of the
component of the slip acceleration across the direction; several contacts are solved for in turn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .compiled_subset import compiled_subset, sqrt
from .contact_system import compliance, solve_mode
from .contact_table import STICK, ContactSpace, ContactTable

if TYPE_CHECKING:
    from .mode_candidates import Candidates

__all__ = ["steady_directions", "uneven"]

_UNEVEN = 1e-7
"""Share of the slip acceleration, and of what friction does to it, that may be left across the direction."""

_EXACT = 1e-15
"""The same, below which a direction is not improved."""

_ROUNDS, _HALVINGS, _SECTORS = 60, 80, 24
"""Rounds over several contacts; halvings of an angle; angles at which a root is looked for."""

_ANGLES = 2.0 * np.pi * np.arange(_SECTORS + 1) / _SECTORS
_COSINES, _SINES = np.cos(_ANGLES), np.sin(_ANGLES)


@compiled_subset
def _turn(pick: Candidates, i: int, x: float, y: float) -> None:
    """Write a direction, made a unit vector; a vector of length zero has none."""
    size = sqrt(x * x + y * y)
    if size > 0.0:
        pick.along[i, 0], pick.along[i, 1] = x / size, y / size


@compiled_subset
def _across(table: ContactTable, space: ContactSpace, pick: Candidates, i: int, x: float, y: float) -> float:
    """Return the slip acceleration across a direction, which is written; friction opposes that direction."""
    _turn(pick, i, x, y)
    solve_mode(table, space, pick.mode, pick.along, pick.sides)
    return _slip_across(table, space, pick, i)


@compiled_subset
def _slip_across(table: ContactTable, space: ContactSpace, pick: Candidates, i: int) -> float:
    """Return the component of the slip acceleration across the direction, for the solution at hand."""
    first = table.first[i]
    return pick.along[i, 0] * space.slip[first + 1] - pick.along[i, 1] * space.slip[first]


@compiled_subset
def _scale(table: ContactTable, space: ContactSpace, place: int, i: int) -> float:
    """Return the size of the slip acceleration, and of what friction does to it."""
    first, total = table.first[i], 0.0
    for a in range(first, first + 2):
        total += abs(space.slip[a])
        for b in range(first, first + 2):
            total += abs(compliance(table, space, place, a, b) * space.forces[b, 0])
    return total


@compiled_subset
def _along_slip(table: ContactTable, space: ContactSpace, pick: Candidates, i: int) -> bool:
    """Return whether the slip acceleration points along the direction and not against it."""
    first = table.first[i]
    return pick.along[i, 0] * space.slip[first] + pick.along[i, 1] * space.slip[first + 1] >= 0.0


@compiled_subset
def _bisect(
    table: ContactTable,
    space: ContactSpace,
    pick: Candidates,
    i: int,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    fa: float,
) -> None:
    """Write the direction between two, less than half a turn apart, across which the slip acceleration vanishes."""
    for _ in range(_HALVINGS):
        x, y = ax + bx, ay + by
        size = sqrt(x * x + y * y)
        x, y = x / size, y / size
        f = _across(table, space, pick, i, x, y)
        if f == 0.0 or (x == ax and y == ay) or (x == bx and y == by):
            break
        if (f > 0.0) == (fa > 0.0):
            ax, ay = x, y
        else:
            bx, by = x, y


@compiled_subset
def _steady(table: ContactTable, space: ContactSpace, pick: Candidates, place: int, i: int) -> None:
    """Write the direction of one contact, the nearest to the present one; the others keep theirs."""
    x0, y0 = pick.along[i, 0], pick.along[i, 1]
    f0 = _across(table, space, pick, i, x0, y0)
    if abs(f0) <= _EXACT * _scale(table, space, place, i) and _along_slip(table, space, pick, i):
        return
    for step in range(_SECTORS // 2):
        for side in (1.0, -1.0):
            ax, ay = x0 * _COSINES[step] - side * y0 * _SINES[step], y0 * _COSINES[step] + side * x0 * _SINES[step]
            bx = x0 * _COSINES[step + 1] - side * y0 * _SINES[step + 1]
            by = y0 * _COSINES[step + 1] + side * x0 * _SINES[step + 1]
            fa = _across(table, space, pick, i, ax, ay)
            fb = _across(table, space, pick, i, bx, by)
            if fa * fb <= 0.0:
                _bisect(table, space, pick, i, ax, ay, bx, by, fa)
                if _along_slip(table, space, pick, i):
                    return
    _across(table, space, pick, i, x0, y0)


@compiled_subset
def steady_directions(table: ContactTable, space: ContactSpace, pick: Candidates) -> None:
    """Write the directions in which slip in a plane begins in a combination."""
    k = table.constraint.size
    for i in range(k):
        pick.sticking[i] = STICK if pick.begins[i] != 0 else pick.mode[i]
    place = solve_mode(table, space, pick.sticking, pick.along, pick.sides)
    count = 0
    for i in range(k):
        if pick.begins[i] != 0:
            first = table.first[i]
            _turn(pick, i, -space.forces[first, 0], -space.forces[first + 1, 0])
            count += 1
    for _ in range(_ROUNDS):
        change = 0.0
        for i in range(k):
            if pick.begins[i] != 0:
                x, y = pick.along[i, 0], pick.along[i, 1]
                _steady(table, space, pick, place, i)
                change = max(change, abs(pick.along[i, 0] - x), abs(pick.along[i, 1] - y))
        if count == 1 or change <= _EXACT:
            break


@compiled_subset
def uneven(table: ContactTable, space: ContactSpace, pick: Candidates, place: int, i: int) -> bool:
    """Return whether slip does not begin along the direction that friction opposes, for the solution at hand."""
    return not abs(_slip_across(table, space, pick, i)) <= _UNEVEN * _scale(table, space, place, i)
