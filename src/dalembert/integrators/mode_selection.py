"""Mode selection: the mode of the contacts that contradicts no law of contact.

Every combination of what contacts may do is tried. Closed contacts push and do not pull, open ones do not approach,
what sticks needs no more friction than there is, and friction opposes the slip that it lets begin. After an impact the
same holds of impulses and of rates. Where no combination is left, or one with a contact open and one with it closed,
the laws have no solution or several.
"""

from __future__ import annotations

import math

from ..methods.status import Status
from .compiled_subset import compiled_subset, sqrt
from .contact_system import compliance, shift_forces, solve_mode
from .contact_table import (
    MU,
    MU_STATIC,
    OPEN,
    SLIP,
    STICK,
    ContactSpace,
    ContactTable,
    mass,
    number,
    power_size,
    row_size,
)
from .mode_candidates import FREE, GRIPPED, LIFTING, TOUCHING, Candidates, combine, list_options, next_combination
from .slip_direction import steady_directions, uneven

__all__ = [
    "ROUNDING",
    "select_mode",
]

ROUNDING = 1e-9
"""Share of the forces, or rates, within which a comparison may go either way."""

_GRAZING = 1e-6
"""Share of the motion within which slip that friction has just failed to hold may seem to go backwards."""

_POWERLESS = 1e-6
"""Share of the motion, and of the forces, up to which a contact that sticks may have a slip acceleration left; friction
holds nothing where a point turns back."""

_TOGETHER = 1e-9
"""Share to which the slips of two contacts may differ from being multiples of each other."""

_GOLDEN, _SECTIONS, _SHARE_ROUNDS = 0.6180339887498949, 60, 4
"""Golden section; sections of a direction in which forces are not determined; rounds over several such directions."""

_SUCCESS, _NON_FINITE = int(Status.SUCCESS), int(Status.NON_FINITE)

_IMPOSSIBLE, _AMBIGUOUS = int(Status.CONTACT_IMPOSSIBLE), int(Status.CONTACT_AMBIGUOUS)


@compiled_subset
def _share(value: float, scale: float) -> float:
    """Return a value in terms of a scale; zero stays zero where there is none."""
    if value == 0.0:
        return 0.0
    return value / (scale if scale > 0.0 else 1.0)


@compiled_subset
def _beyond(value: float, noise: float) -> float:
    """Return a value, or zero where rounding may have made it."""
    return 0.0 if abs(value) <= noise else value


@compiled_subset
def _friction(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the sum of the sizes of the friction forces of a contact."""
    total = 0.0
    for a in range(table.width[i]):
        total += abs(space.forces[table.first[i] + a, 0])
    return total


@compiled_subset
def _speed(table: ContactTable, space: ContactSpace) -> float:
    """Return the size of the accelerations, or of the rates after an impact, in the same terms as `row_size`."""
    total = 0.0
    for j in range(space.motion.size):
        inertia = mass(table, space, j, j)
        total += (inertia if inertia > 0.0 else 1.0) * space.motion[j] * space.motion[j]
    return sqrt(total)


@compiled_subset
def _pushed(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the size of the accelerations along a contact that a unit of its normal reaction may cause."""
    size = 0.0
    if table.constraint[i] >= 0:
        size = row_size(table, space, table.constraint[i])
    for a in range(table.width[i]):
        size = max(size, row_size(table, space, table.constraints + table.first[i] + a))
    return size * power_size(table, space, table.normal[i])


@compiled_subset
def _forward(
    table: ContactTable, space: ContactSpace, pick: Candidates, place: int, i: int, x: float, y: float
) -> float:
    """Return by which share of the motion, and of what friction does to it, slip begins along a direction."""
    first, rows = table.first[i], 0.0
    forward = space.slip[first] * x
    if table.width[i] > 1:
        forward += space.slip[first + 1] * y
    for a in range(table.width[i]):
        rows = max(rows, row_size(table, space, table.constraints + first + a))
    held = abs(compliance(table, space, place, first, first)) * _friction(table, space, i)
    return _share(forward, _speed(table, space) * rows + held)


@compiled_subset
def _held_by_friction(table: ContactTable, space: ContactSpace, pick: Candidates, i: int) -> bool:
    """Return whether friction holds a contact along a line now, and it either sticks or begins to slip afterwards."""
    rests = pick.kind[i] == GRIPPED and table.width[i] == 1 and number(table, space, i, MU_STATIC) > 0.0
    return rests and (pick.mode[i] == STICK or pick.mode[i] == SLIP)


@compiled_subset
def _coupled(table: ContactTable, space: ContactSpace, place: int, i: int, j: int) -> bool:
    """Return whether two contacts can only slip together."""
    a, b = table.first[i], table.first[j]
    own = compliance(table, space, place, a, a) * compliance(table, space, place, b, b)
    mixed = compliance(table, space, place, a, b) * compliance(table, space, place, b, a)
    return abs(own - mixed) <= _TOGETHER * abs(own)


@compiled_subset
def _both_held_by_friction(table: ContactTable, space: ContactSpace, pick: Candidates, i: int, j: int) -> bool:
    """Return whether two contacts stick now, at least one of which keeps sticking."""
    sticks = pick.mode[i] == STICK or pick.mode[j] == STICK
    return sticks and _held_by_friction(table, space, pick, i) and _held_by_friction(table, space, pick, j)


@compiled_subset
def _has_own_slip(table: ContactTable, space: ContactSpace, place: int, i: int) -> bool:
    """Return whether a contact along a line slips beyond rounding in the present combination."""
    r, force = table.first[i], 0.0
    for j in range(table.constraint.size):
        force += abs(space.normal[j]) + _friction(table, space, j)
    size = _speed(table, space) * row_size(table, space, table.constraints + r)
    return abs(space.slip[r]) > _GRAZING * (size + abs(compliance(table, space, place, r, r)) * force)


@compiled_subset
def _splits_coupled_contacts(table: ContactTable, space: ContactSpace, pick: Candidates, place: int) -> bool:
    """Return whether a contact sticks that can only slip together with one that begins to slip.

    One that slips although the other sticks has a slip of its own, as on a belt that runs while a wall stands still.
    """
    splits = False
    for i in range(table.constraint.size):
        for j in range(i + 1, table.constraint.size):
            if pick.mode[i] != pick.mode[j] and _both_held_by_friction(table, space, pick, i, j):
                own = _has_own_slip(table, space, place, i if pick.mode[i] == SLIP else j)
                splits = splits or (not own and _coupled(table, space, place, i, j))
    return splits


@compiled_subset
def _unchanged(table: ContactTable, pick: Candidates) -> bool:
    """Return whether contacts that can no longer share a load keep their states."""
    parted, same = False, True
    for i in range(table.constraint.size):
        parted = parted or pick.parted[i] != 0
        same = same and pick.mode[i] == pick.former[i]
        same = same and (table.sided[i] == 0 or pick.sides[i] == pick.given_sides[i])
    return parted and same


@compiled_subset
def _law(table: ContactTable, space: ContactSpace, pick: Candidates, place: int, i: int, force: float) -> float:
    """Return the margin of the laws of one contact; `force` is the size of all forces."""
    least, state = 1.0, pick.mode[i]
    press = pick.sides[i] * space.normal[i]
    if state == OPEN:
        if pick.kind[i] == FREE or pick.kind[i] == LIFTING:
            return 1.0
        size = _speed(table, space) * row_size(table, space, table.constraint[i])
        return _share(_beyond(space.gap[i], pick.still[i]), size)
    if pick.turned[i] == 0 and (table.constraint[i] >= 0 or table.sided[i] != 0):
        least = min(least, _share(_beyond(press, pick.least[i]), force))
    if state == STICK:
        used = 0.0
        for a in range(table.width[i]):
            row = table.constraints + table.first[i] + a
            size = _speed(table, space) * row_size(table, space, row) + force * _pushed(table, space, i)
            if abs(space.slip[table.first[i] + a]) > _POWERLESS * size:
                return -1.0
            used += space.forces[table.first[i] + a, 0] * space.forces[table.first[i] + a, 0]
        if pick.turned[i] != 0:
            press = max(press, 0.0)  # it is zero, and its sign is rounding
        limit = number(table, space, i, MU if pick.slides[i] != 0 else MU_STATIC) * press
        least = min(least, _share(_beyond(limit - sqrt(used), pick.least[i]), force))
    if state == SLIP and pick.kind[i] == GRIPPED and number(table, space, i, MU_STATIC) > 0.0:
        share = _forward(table, space, pick, place, i, pick.along[i, 0], pick.along[i, 1])
        if pick.broken[i] != 0 and share >= -_GRAZING:
            share = max(share, 0.0)
        if pick.begins[i] != 0 and uneven(table, space, pick, place, i):
            share = -1.0
        least = min(least, share)
    return least


@compiled_subset
def _laws(table: ContactTable, space: ContactSpace, pick: Candidates, place: int) -> float:
    """Return the margin of the laws of all contacts, with the present forces."""
    force, least = 0.0, 1.0
    for i in range(table.constraint.size):
        force += abs(space.normal[i]) + _friction(table, space, i)
    for i in range(table.constraint.size):
        least = min(least, _law(table, space, pick, place, i, force))
    return least


@compiled_subset
def _best_share(table: ContactTable, space: ContactSpace, pick: Candidates, place: int, least: float) -> float:
    """Return the largest margin that friction forces have which the equations of motion do not determine.

    Contacts that can only slip together stick as long as there is any way to share the load that breaks no law. The
    margin is a concave function along each direction, whose maximum is found by golden sections.
    """
    scale = 0.0
    for i in range(table.constraint.size):
        scale += abs(space.normal[i]) + _friction(table, space, i)
    for _ in range(_SHARE_ROUNDS if space.undetermined[0] > 1 else 1):
        for a in range(space.undetermined[0]):
            low, high, at = -4.0 * scale, 4.0 * scale, 0.0
            for _ in range(_SECTIONS):
                left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
                shift_forces(table, space, place, a, left - at)
                first = _laws(table, space, pick, place)
                shift_forces(table, space, place, a, right - left)
                second = _laws(table, space, pick, place)
                at = right
                least = max(least, first, second)
                if first < second:
                    low = left
                else:
                    high = right
            shift_forces(table, space, place, a, 0.5 * (low + high) - at)
            least = max(least, _laws(table, space, pick, place))
    return least


@compiled_subset
def _margin(table: ContactTable, space: ContactSpace, pick: Candidates, place: int) -> float:
    """Return by which share of the forces, at least, a combination contradicts nothing; below zero it does."""
    total = 0.0
    for j in range(space.motion.size):
        total += 0.0 * space.motion[j]
    if total != 0.0:
        return math.nan
    if _splits_coupled_contacts(table, space, pick, place) or _unchanged(table, pick):
        return -1.0
    least = _laws(table, space, pick, place)
    if space.undetermined[0] > 0:
        least = _best_share(table, space, pick, place, least)
    return least


@compiled_subset
def _select_combination(pick: Candidates) -> None:
    """Select the present combination; its motion is recorded already."""
    for i in range(pick.mode.size):
        pick.best_mode[i], pick.best_sides[i] = pick.mode[i], pick.sides[i]
        pick.best_along[i, 0], pick.best_along[i, 1] = pick.along[i, 0], pick.along[i, 1]
    for j in range(pick.best_motion.size):
        pick.best_motion[j] = pick.motion[j]


@compiled_subset
def _excludes_first(table: ContactTable, pick: Candidates, first: bool) -> bool:
    """Return whether the combination excludes the first clear one; the first one is recorded."""
    excludes = False
    for i in range(pick.mode.size):
        if first:
            pick.clear_mode[i], pick.clear_sides[i] = pick.mode[i], pick.sides[i]
        opens = (pick.mode[i] == OPEN) != (pick.clear_mode[i] == OPEN)
        excludes = excludes or opens or (table.sided[i] != 0 and pick.sides[i] != pick.clear_sides[i])
    return excludes


@compiled_subset
def _try_all(
    table: ContactTable, space: ContactSpace, pick: Candidates, expected: bool, meets: bool
) -> tuple[int, int]:
    """Try all combinations; return a status, and 2 where one holds, 1 where one does within rounding, else 0.

    Where a contact ``meets``, rounding is no reason to leave it open: a guard fires at once where that was wrong.
    """
    list_options(table, space, pick, expected)
    for i in range(table.constraint.size):
        pick.choice[i] = 0
        keep = expected or pick.turned[i] != 0
        pick.base_sides[i] = pick.given_sides[i] if keep else 1.0
    best, clear, lost, ambiguous = 0, 0, False, False
    while True:
        if combine(table, space, pick):
            steady_directions(table, space, pick)
        place = solve_mode(table, space, pick.mode, pick.along, pick.sides)
        for j in range(pick.motion.size):
            pick.motion[j] = space.motion[j]
        margin = _margin(table, space, pick, place)
        lost = lost or math.isnan(margin)
        grade = 0
        if margin >= -ROUNDING:
            grade = 2 if margin >= 0.0 or meets else 1
        if grade > best:
            best = grade
            _select_combination(pick)
        if margin > ROUNDING:
            ambiguous = ambiguous or _excludes_first(table, pick, clear == 0)
            clear += 1
        if not next_combination(pick):
            break
    if ambiguous:
        return _AMBIGUOUS, best
    if best > 0:
        return _SUCCESS, best
    return _NON_FINITE if lost else _IMPOSSIBLE, best


@compiled_subset
def select_mode(table: ContactTable, space: ContactSpace, pick: Candidates, known: bool, meets: bool) -> int:
    """Select the mode of the contacts into ``best_mode``, ``best_sides``, ``best_along`` and ``best_motion``.

    The forces and demands are those of `load_accelerations` or `load_impact`. What has just failed to hold, or to
    push, is taken at its word first; where all contacts together then contradict something, it is tried as well
    (several contacts may change at one instant, each of them because of the others).

    Parameters
    ----------
    known : bool
        Whether the signs of normal reactions just before are known: others are tried where these contradict something.
    meets : bool
        Whether a contact that was open touches.

    Returns
    -------
    int
        SUCCESS, CONTACT_IMPOSSIBLE, CONTACT_AMBIGUOUS or NON_FINITE.
    """
    sided, status, best = False, _IMPOSSIBLE, 0
    for i in range(table.constraint.size):
        sided = sided or table.sided[i] != 0
    for attempt in range(2):
        if known and sided:
            status, best = _try_all(table, space, pick, True, meets)
            if best == 2:
                return status
        status, best = _try_all(table, space, pick, False, meets)
        if status != _IMPOSSIBLE:
            return status
        relaxed = False
        for i in range(table.constraint.size):
            relaxed = relaxed or pick.broken[i] != 0 or pick.kind[i] == LIFTING or pick.turned[i] != 0
            relaxed = relaxed or pick.struck[i] != 0 or pick.parted[i] != 0
            pick.broken[i] = pick.turned[i] = pick.struck[i] = pick.parted[i] = 0
            if pick.kind[i] == LIFTING:
                slides = table.width[i] > 0 and table.smooth[i] == 0
                pick.kind[i] = GRIPPED if slides else TOUCHING
        if attempt > 0 or not relaxed:
            return status
    return status
