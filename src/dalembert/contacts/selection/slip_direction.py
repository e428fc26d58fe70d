"""Directions in which slip in a plane begins, and dead centres, at which slip turns back.

Slip begins in the direction in which its acceleration points.

Friction opposes the direction, and the slip acceleration depends on it. For one contact, the angle is a root of the
component of the slip acceleration across the direction; several contacts are solved for in turn.
"""

from __future__ import annotations

import numpy as np

from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_system import SLIP, STICK, Combination, ContactSystem, inertia_of, inertial_size
from .contact_forces import compliance, open_contacts, solve_mode
from .contact_responses import hold_constraints
from .dead_centres import motionless
from .dense_solve import solve_dense
from .mode_candidates import Candidates

_UNEVEN = 1e-7
"""Share of the slip acceleration, and of what friction does to it, that may be left across the direction."""

_EXACT = 1e-15
"""The same, below which a direction is not improved."""

_ROUNDS, _HALVINGS, _SECTORS = 60, 80, 24
"""Rounds over several contacts; halvings of an angle; angles at which a root is looked for."""

_NEWTON_STEPS, _ANGLE = 20, 1e-6
"""Steps of Newton's method on several directions, and the angle of its differences."""

_ANGLES = 2.0 * np.pi * np.arange(_SECTORS + 1) / _SECTORS
_COSINES, _SINES = np.cos(_ANGLES), np.sin(_ANGLES)


@compiled_subset
def _turn(pick: Candidates, i: int, x: float, y: float) -> None:
    """Write a direction, made a unit vector; a vector of length zero has none."""
    size = sqrt(x * x + y * y)
    if size > 0.0:
        pick.now.along[i, 0], pick.now.along[i, 1] = x / size, y / size


@compiled_subset
def _slip_across(system: ContactSystem, pick: Candidates, i: int) -> float:
    """Return the component of the slip acceleration across the direction, for the solution at hand."""
    first, along = system.first[i], pick.now.along
    return along[i, 0] * system.slip[first + 1] - along[i, 1] * system.slip[first]


@compiled_subset
def _across(system: ContactSystem, pick: Candidates, i: int, x: float, y: float) -> float:
    """Return the slip acceleration across a direction, which is written; friction opposes that direction.

    It has the sign of the normal reaction, too: where steep friction makes both infinite, both change their signs.
    """
    _turn(pick, i, x, y)
    solve_mode(system, pick.now)
    across = _slip_across(system, pick, i)
    return -across if system.press[i] < 0.0 else across


@compiled_subset
def _along_slip(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Return whether the slip acceleration points along the direction and not against it."""
    first, along = system.first[i], pick.now.along
    return along[i, 0] * system.slip[first] + along[i, 1] * system.slip[first + 1] >= 0.0


@compiled_subset
def _even(system: ContactSystem, pick: Candidates, i: int, share: float) -> bool:
    """Return whether next to nothing is left of the slip acceleration across the direction.

    Next to nothing is a share of the slip acceleration, and of what friction does to it.
    """
    first, total = system.first[i], 0.0
    for a in range(first, first + 2):
        total += abs(system.slip[a])
        for b in range(first, first + 2):
            total += abs(compliance(system, a, b) * system.forces[b, 0])
    return abs(_slip_across(system, pick, i)) <= share * total


@compiled_subset
def _bisect(
    system: ContactSystem, pick: Candidates, i: int, ax: float, ay: float, bx: float, by: float, fa: float
) -> None:
    """Write the direction between two, less than half a turn apart, across which the slip acceleration vanishes."""
    for _ in range(_HALVINGS):
        x, y = ax + bx, ay + by
        size = sqrt(x * x + y * y)
        x, y = x / size, y / size
        f = _across(system, pick, i, x, y)
        if f == 0.0 or (x == ax and y == ay) or (x == bx and y == by):
            break
        if (f > 0.0) == (fa > 0.0):
            ax, ay = x, y
        else:
            bx, by = x, y


@compiled_subset
def _steady(system: ContactSystem, pick: Candidates, i: int) -> None:
    """Write the direction of one contact, the nearest to the present one; the others keep theirs.

    Steep friction may make a contact pull where it slips in the nearest: then another is taken if there is one. What is
    not even is no root: where constraints leave one direction, signs change at ends of sectors, too.
    """
    x0, y0 = pick.now.along[i, 0], pick.now.along[i, 1]
    pulling_x = pulling_y = 0.0
    _across(system, pick, i, x0, y0)
    if _even(system, pick, i, _EXACT) and _along_slip(system, pick, i):
        if pick.now.sides[i] * system.press[i] >= 0.0:
            return
        pulling_x, pulling_y = x0, y0
    for step in range(_SECTORS // 2):
        for side in (1.0, -1.0):
            ax, ay = x0 * _COSINES[step] - side * y0 * _SINES[step], y0 * _COSINES[step] + side * x0 * _SINES[step]
            bx = x0 * _COSINES[step + 1] - side * y0 * _SINES[step + 1]
            by = y0 * _COSINES[step + 1] + side * x0 * _SINES[step + 1]
            fa = _across(system, pick, i, ax, ay)
            if fa * _across(system, pick, i, bx, by) <= 0.0:
                _bisect(system, pick, i, ax, ay, bx, by, fa)
                if _even(system, pick, i, _UNEVEN) and _along_slip(system, pick, i):
                    if pick.now.sides[i] * system.press[i] >= 0.0:
                        return
                    if pulling_x == 0.0 and pulling_y == 0.0:
                        pulling_x, pulling_y = pick.now.along[i, 0], pick.now.along[i, 1]
    if pulling_x != 0.0 or pulling_y != 0.0:
        x0, y0 = pulling_x, pulling_y
    _across(system, pick, i, x0, y0)


@compiled_subset
def _improve(system: ContactSystem, pick: Candidates, count: int) -> bool:
    """Write the directions of so many contacts, one contact after the other; return whether all are found."""
    for _ in range(_ROUNDS):
        change = 0.0
        for i in range(system.contacts):
            if pick.begins[i] != 0:
                x, y = pick.now.along[i, 0], pick.now.along[i, 1]
                _steady(system, pick, i)
                change = max(change, abs(pick.now.along[i, 0] - x), abs(pick.now.along[i, 1] - y))
        if count == 1 or change <= _EXACT:
            break
    return _all_found(system, pick)


@compiled_subset
def _all_found(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether all contacts that begin to slip do so along their directions, and push."""
    found = True
    for i in range(system.contacts):
        if pick.begins[i] != 0:
            found = found and _even(system, pick, i, _UNEVEN) and _along_slip(system, pick, i)
            found = found and pick.now.sides[i] * system.press[i] >= 0.0
    return found


@compiled_subset
def _shift(system: ContactSystem, pick: Candidates, i: int, change: float) -> None:
    """Turn a direction by an angle whose tangent is given."""
    x, y = pick.now.along[i, 0], pick.now.along[i, 1]
    _turn(pick, i, x - change * y, y + change * x)


@compiled_subset
def _write_slips_across(system: ContactSystem, pick: Candidates, column: int) -> int:
    """Write the slip accelerations across all directions to ``square_right``; return their number."""
    count = 0
    solve_mode(system, pick.now)
    for i in range(system.contacts):
        if pick.begins[i] != 0:
            system.square_right[count, column] = _slip_across(system, pick, i)
            count += 1
    return count


@compiled_subset
def _refine(system: ContactSystem, pick: Candidates) -> None:
    """Improve the directions of several contacts together, by Newton's method: one after the other may diverge."""
    for _ in range(_NEWTON_STEPS):
        count, j = _write_slips_across(system, pick, 0), 0
        for i in range(system.contacts):
            if pick.begins[i] != 0:
                x, y = pick.now.along[i, 0], pick.now.along[i, 1]
                _shift(system, pick, i, _ANGLE)
                _write_slips_across(system, pick, 1)
                pick.now.along[i, 0], pick.now.along[i, 1] = x, y
                for k in range(count):
                    system.square[k, j] = (system.square_right[k, 1] - system.square_right[k, 0]) / _ANGLE
                j += 1
        solve_dense(system.square, system.square_right, count, 1, system.dense)
        j, change = 0, 0.0
        for i in range(system.contacts):
            if pick.begins[i] != 0:
                _shift(system, pick, i, -system.square_right[j, 0])
                change = max(change, abs(system.square_right[j, 0]))
                j += 1
        if change <= _EXACT:
            break
    solve_mode(system, pick.now)


@compiled_subset
def hold_beginning(system: ContactSystem, pick: Candidates) -> None:
    """Solve for the forces that would hold the contacts in a plane that begin to slip in a combination."""
    for i in range(system.contacts):
        if pick.begins[i] != 0:
            pick.now.mode[i] = STICK
    solve_mode(system, pick.now)


@compiled_subset
def _take_given(system: ContactSystem, pick: Candidates) -> None:
    """Write the directions in which contacts slide into an impact, or guesses."""
    for i in range(system.contacts):
        if pick.begins[i] != 0 and (pick.found.guided != 0 or pick.slides[i] != 0):
            _turn(pick, i, pick.given.along[i, 0], pick.given.along[i, 1])


@compiled_subset
def _improve_given(system: ContactSystem, pick: Candidates, count: int) -> bool:
    """Write directions near the given ones; return whether all are found."""
    _take_given(system, pick)
    found = _improve(system, pick, count)
    if not found and count > 1:
        _take_given(system, pick)
        _refine(system, pick)
        found = _all_found(system, pick)
    return found


@compiled_subset
def steady_directions(system: ContactSystem, pick: Candidates) -> None:
    """Write the directions in which slip in a plane begins in a combination.

    They are looked for from those against the forces of `hold_beginning`, and where that does not find them, from those
    in which contacts slide into an impact. Guesses come first: where there are any, no others have been lawful.
    """
    count, slides = 0, False
    for i in range(system.contacts):
        if pick.begins[i] != 0:
            first, count = system.first[i], count + 1
            pick.now.mode[i], slides = SLIP, slides or pick.slides[i] != 0
            _turn(pick, i, -system.forces[first, 0], -system.forces[first + 1, 0])
    if pick.found.guided != 0:
        _improve_given(system, pick, count)
    elif not _improve(system, pick, count) and slides:
        _improve_given(system, pick, count)


@compiled_subset
def uneven(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Return whether slip does not begin along the direction that friction opposes, for the solution at hand."""
    return not _even(system, pick, i, _UNEVEN)


_MOVES = 1e-9
"""Share of a motion that the constraints allow, up to which rounding makes what it does to a coordinate."""


@compiled_subset
def _add_held(system: ContactSystem, row: int) -> None:
    """Add the products of a row's entries to ``square``: those of the row of unit length, in terms of the inertia."""
    size = inertial_size(system, system.jacobian[row])
    if size > 0.0:
        for a in range(system.coordinates):
            for b in range(system.coordinates):
                product = (system.jacobian[row, a] / size) * (system.jacobian[row, b] / size)
                system.square[a, b] += product / (_root_of_inertia(system, a) * _root_of_inertia(system, b))


@compiled_subset
def _root_of_inertia(system: ContactSystem, j: int) -> float:
    inertia = inertia_of(system, j)
    return sqrt(inertia) if inertia > 0.0 else 1.0


@compiled_subset
def _left_free(system: ContactSystem, chosen: Combination) -> int:
    """Find the motions that the rows leave which hold in a mode, by the roots of inertias; return their number."""
    n, held = system.coordinates, hold_constraints(system, open_contacts(chosen))
    for a in range(n):
        for b in range(n):
            system.square[a, b] = 0.0
    for h in range(held):
        _add_held(system, system.held[h])
    for row in range(system.constraints, system.constraints + system.slips):
        if chosen.mode[system.row_owner[row]] == STICK and not motionless(system, row):
            _add_held(system, row)
    return solve_dense(system.square, system.square_right, n, 0, system.dense)


@compiled_subset
def held_by_others(system: ContactSystem, chosen: Combination, r: int) -> bool:
    """Return whether a slip velocity cannot change in a mode, because of what holds in it besides."""
    slopes = system.jacobian[system.constraints + r]
    for a in range(_left_free(system, chosen)):
        along, size = 0.0, 0.0
        for j in range(system.coordinates):
            term = slopes[j] / _root_of_inertia(system, j) * system.dense.free[a, j]
            along += term
            size = max(size, abs(term))
        if abs(along) > _MOVES * size:
            return False
    return True


@compiled_subset
def turns_back(system: ContactSystem, chosen: Combination, i: int) -> bool:
    """Return whether slip of a contact does not depend on the rates here, but will where the mode that is solved moves.

    So does that of a point at the dead centre of its path. Friction has no power on any motion there: it cannot hold
    the point, and the equations of the mode in which it sticks are singular. Where the mode holds all coordinates on
    which the slip depends, there is nothing to hold, and the point may stick.
    """
    first, after = system.first[i], system.first[i] + system.width[i]
    for r in range(first, after):
        if compliance(system, r, r) != 0.0 or not motionless(system, system.constraints + r):
            return False
    for a in range(_left_free(system, chosen)):
        for j in range(system.coordinates):
            for r in range(first, after):
                if system.slides_by[r, j] != 0 and abs(system.dense.free[a, j]) > _MOVES:
                    return True
    return False
