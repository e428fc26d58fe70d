"""Ways to share a load that the equations of motion do not determine, and the one that obeys laws by most.

Where all laws are linear in the friction forces, the largest of the least margins is that of a linear program, which
the simplex method finds by its dual: the weights of the laws that are tightest (V. Chvatal, Linear Programming, 1983,
chapter 5). Bounds on the shares are further columns, and make the first basis.
"""

from __future__ import annotations

import math

from ...subset.compiled_subset import compiled_subset, sqrt, square
from ..contact_system import OPEN, STICK, ContactSystem
from .contact_forces import press_compliance, shift_forces
from .dense_solve import solve_dense
from .mode_candidates import Candidates, turned
from .mode_laws import TOGETHER, all_forces, friction_limit

_GOLDEN, _SECTIONS = 0.6180339887498949, 80
"""Golden section, and sections of a direction in which forces are not determined."""

_MOST_SHARE = 1e4
"""Largest share, in terms of all forces: a rod between rough walls needs 1/(2 (mu - tan a)) of its weight."""

_PIVOTS, _FIRST_BY_NUMBER, _TINY = 400, 60, 1e-12
"""Most exchanges; those after which the first law that is violated enters and not the most violated, so that no cycle
arises; and margins, and entries, that count as zero."""


@compiled_subset
def aim(system: ContactSystem, pick: Candidates, direction: int) -> float:
    """Find out which contacts have forces that change along a direction in which forces are not determined.

    Returns the largest of these changes.
    """
    size = 0.0
    for i in range(system.contacts):
        pushed, most = 0.0, 0.0
        for r in range(system.slips):
            pushed += press_compliance(system, i, r) * system.free[direction, r]
        for r in range(system.first[i], system.first[i] + system.width[i]):
            most = max(most, system.weight[i] * abs(system.free[direction, r]))
        size = max(size, most, abs(pushed))
        pick.pushed[i], pick.shares[i] = pushed, 1 if max(most, abs(pushed)) > TOGETHER else 0
    return size


@compiled_subset
def shared_margin(system: ContactSystem, pick: Candidates, direction: int, amount: float) -> float:
    """Return the least of what pushes, and of what friction may be beyond what it is, after a change of the forces.

    It is that of the contacts whose forces change along the direction.
    """
    least = math.inf
    for i in range(system.contacts):
        if pick.shares[i] != 0 and pick.now.mode[i] != OPEN:
            press = pick.now.sides[i] * (system.press[i] + amount * pick.pushed[i])
            presses = system.constraint[i] >= 0 or system.sided[i] != 0
            if presses and not turned(pick, i) and pick.now.released[i] == 0:
                least = min(least, press - system.restored[i])
            if pick.now.mode[i] == STICK:
                used = 0.0
                for r in range(system.first[i], system.first[i] + system.width[i]):
                    used += square(system.forces[r, 0] + amount * system.free[direction, r])
                least = min(least, system.weight[i] * (friction_limit(system, pick, i) * press - sqrt(used)))
    return least


@compiled_subset
def _is_linear(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether no contact sticks in a plane, whose law is a cone."""
    for i in range(system.contacts):
        if pick.now.mode[i] == STICK and system.width[i] > 1:
            return False
    return True


@compiled_subset
def _add_law(pick: Candidates, column: int, value: float, scale: float) -> None:
    """Complete the column of a law whose slopes are written: its value, and one for the sum of the weights."""
    pick.lawful[column, 0], pick.lawful[column, 1] = value / scale, 1.0


@compiled_subset
def _write_laws(system: ContactSystem, pick: Candidates, scale: float) -> int:
    """Write the columns of the linear program: value, one, and minus the slopes along the directions; their number.

    The first are a margin as large as all forces, and both bounds of each share.
    """
    table, count, last = pick.lawful, system.solved.undetermined, 1 + 2 * system.solved.undetermined
    for column in range(table.shape[0]):
        for j in range(2 + count):
            table[column, j] = 0.0
    table[0, 0] = table[0, 1] = 1.0
    for a in range(count):
        size, number = aim(system, pick, a), 1 + 2 * count
        pick.sizes[a] = size if size > 0.0 else 1.0
        for sign in (1, -1):
            bound = 1 + 2 * a + (1 - sign) // 2
            table[bound, 0], table[bound, 2 + a] = _MOST_SHARE, float(sign)
        for i in range(system.contacts):
            press = pick.now.sides[i] * pick.pushed[i] / pick.sizes[a]
            table[number, 2 + a] = -press
            for r in range(system.first[i], system.first[i] + system.width[i]):
                weight, change = system.weight[i], system.free[a, r] / pick.sizes[a]
                for sign in (1, -1):
                    place = number + 1 + 2 * (r - system.first[i]) + (1 - sign) // 2
                    table[place, 2 + a] = -weight * (friction_limit(system, pick, i) * press + float(sign) * change)
            number += 1 + 2 * system.width[i]
    number = last
    for i in range(system.contacts):
        press, closed = pick.now.sides[i] * system.press[i], pick.now.mode[i] != OPEN
        presses = (system.constraint[i] >= 0 or system.sided[i] != 0) and not turned(pick, i)
        if closed and presses and pick.now.released[i] == 0 and _changes(pick, number, count):
            _add_law(pick, number, press - system.restored[i], scale)
        for r in range(system.first[i], system.first[i] + system.width[i]):
            for sign in (1, -1):
                place = number + 1 + 2 * (r - system.first[i]) + (1 - sign) // 2
                if pick.now.mode[i] == STICK and _changes(pick, place, count):
                    most = friction_limit(system, pick, i) * press
                    _add_law(pick, place, system.weight[i] * (most + float(sign) * system.forces[r, 0]), scale)
        number += 1 + 2 * system.width[i]
    return number


@compiled_subset
def _changes(pick: Candidates, column: int, count: int) -> bool:
    """Return whether a law changes along any of the directions."""
    largest = 0.0
    for a in range(count):
        largest = max(largest, abs(pick.lawful[column, 2 + a]))
    return largest > TOGETHER


@compiled_subset
def _solve_basis(system: ContactSystem, pick: Candidates, size: int, transposed: bool) -> None:
    """Solve with the matrix of the basis, or its transpose, for ``square_right``."""
    for a in range(size):
        for b in range(size):
            entry = pick.lawful[pick.sharing[b if not transposed else a], 1 + (a if not transposed else b)]
            system.square[a, b] = entry
    solve_dense(system.square, system.square_right, size, 1, system.dense)


@compiled_subset
def _entering(system: ContactSystem, pick: Candidates, columns: int, size: int, first: bool) -> int:
    """Return the law that the shares at hand violate most, or the first of these; -1 where they violate none."""
    worst, found = -_TINY, -1
    for column in range(columns):
        used = pick.lawful[column, 1] != 0.0 or (0 < column and column < 2 * size - 1)
        margin = pick.lawful[column, 0]
        for j in range(size):
            margin -= system.square_right[j, 0] * pick.lawful[column, 1 + j]
        if used and margin < worst:
            found = column
            if first:
                break
            worst = margin
    return found


@compiled_subset
def _leaving(system: ContactSystem, pick: Candidates, size: int) -> int:
    """Return the place in the basis whose weight vanishes first as another grows; -1 where none does."""
    best, least = -1, math.inf
    for a in range(size):
        if system.square_right[a, 0] > _TINY:
            ratio = max(pick.weights[a], 0.0) / system.square_right[a, 0]
            before = best < 0 or ratio < least - _TINY
            if before or (ratio <= least + _TINY and pick.sharing[a] < pick.sharing[best]):
                best, least = a, min(ratio, least)
    return best


@compiled_subset
def share_out(system: ContactSystem, pick: Candidates) -> bool:
    """Change the forces to those that obey the laws by most; return whether all laws are linear, so that they can be.

    Only laws count that some share changes.
    """
    scale, count = all_forces(system), system.solved.undetermined
    if scale == 0.0 or not math.isfinite(scale) or not _is_linear(system, pick):
        return False
    columns, size = _write_laws(system, pick, scale), 1 + count
    for a in range(size):
        pick.sharing[a] = 0 if a == 0 else 2 * a - 1
    for pivot in range(_PIVOTS):
        for a in range(size):
            system.square_right[a, 0] = 1.0 if a == 0 else 0.0
        _solve_basis(system, pick, size, False)
        for a in range(size):
            pick.weights[a] = system.square_right[a, 0]
            system.square_right[a, 0] = pick.lawful[pick.sharing[a], 0]
        _solve_basis(system, pick, size, True)
        for a in range(count):
            pick.amounts[a] = system.square_right[1 + a, 0]
        entering = _entering(system, pick, columns, size, pivot >= _FIRST_BY_NUMBER)
        if entering < 0:
            break
        for a in range(size):
            system.square_right[a, 0] = pick.lawful[entering, 1 + a]
        _solve_basis(system, pick, size, False)
        leaving = _leaving(system, pick, size)
        if leaving < 0:
            break
        pick.sharing[leaving] = entering
    for a in range(count):
        shift_forces(system, a, pick.amounts[a] * scale / pick.sizes[a])
    return True


@compiled_subset
def section(system: ContactSystem, pick: Candidates, direction: int, scale: float) -> None:
    """Change the forces along a direction so that the least of the margins is largest: a concave function."""
    aim(system, pick, direction)
    low, high = -_MOST_SHARE * scale, _MOST_SHARE * scale
    for _ in range(_SECTIONS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if shared_margin(system, pick, direction, left) < shared_margin(system, pick, direction, right):
            low = left
        else:
            high = right
    shift_forces(system, direction, 0.5 * (low + high))
