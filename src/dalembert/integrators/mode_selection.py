"""Mode selection: the mode of the contacts that contradicts no law of contact.

Every combination of what contacts may do is tried. Closed contacts push and do not pull, open ones do not approach,
what sticks needs no more friction than there is, and friction opposes the slip that it lets begin. After an impact the
same holds of impulses and of rates. Where no combination is left, or one with a contact open and one with it closed,
the laws have no solution or several.
"""

from __future__ import annotations

import math

from ..methods.status import Status
from ..methods.step_constants import EPSILON
from .compiled_subset import compiled_subset, sqrt
from .contact_forces import compliance, shift_forces, solve_mode
from .contact_system import OPEN, SLIP, STICK, ContactSystem, inertial_size
from .mode_candidates import (
    FREE,
    LIFTING,
    SHARE,
    Candidates,
    broken,
    closed_kind,
    combine,
    copy_combination,
    list_options,
    next_combination,
    rests,
    turned,
)
from .slip_direction import steady_directions, uneven

__all__ = ["ROUNDING", "select_mode"]

ROUNDING = 1e-9
"""Share of the forces, or rates, within which a comparison may go either way."""

_TIED = 64.0 * EPSILON
"""Share of a friction force up to which rounding decides whether it is beyond its limit: the contact sticks, and the
guard of its phase fires at once where the force grows."""

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
def _share(value: float, scale: float, noise: float) -> float:
    """Return a value in terms of a scale; zero where noise may have made it, and where there is no scale."""
    if value == 0.0 or abs(value) <= noise:
        return 0.0
    return value / (scale if scale > 0.0 else 1.0)


@compiled_subset
def _friction(system: ContactSystem, i: int) -> float:
    """Return the sum of the sizes of the friction forces of a contact."""
    total = 0.0
    for a in range(system.width[i]):
        total += abs(system.forces[system.first[i] + a, 0])
    return total


@compiled_subset
def _all_forces(system: ContactSystem) -> float:
    """Return the sum of the sizes of the forces of all contacts."""
    total = 0.0
    for i in range(system.contacts):
        total += abs(system.press[i]) + _friction(system, i)
    return total


@compiled_subset
def _speed(system: ContactSystem, row: int) -> float:
    """Return the largest acceleration along a row, or rate after an impact, that the size of the motion allows."""
    total = 0.0
    for j in range(system.coordinates):
        inertia = system.mass[j, j]
        total += (inertia if inertia > 0.0 else 1.0) * system.motion[j] * system.motion[j]
    return sqrt(total) * inertial_size(system, system.jacobian[row])


@compiled_subset
def _pushed(system: ContactSystem, i: int) -> float:
    """Return the size of the accelerations along a contact that a unit of its normal reaction may cause."""
    size = 0.0
    if system.constraint[i] >= 0:
        size = inertial_size(system, system.jacobian[system.constraint[i]])
    for a in range(system.width[i]):
        size = max(size, inertial_size(system, system.jacobian[system.row[i] + a]))
    return size * inertial_size(system, system.power[system.normal[i]])


@compiled_subset
def _forward(system: ContactSystem, pick: Candidates, i: int) -> float:
    """Return by which share of the motion, and of what friction does to it, slip begins along its direction."""
    first, most, forward = system.first[i], 0.0, 0.0
    for a in range(system.width[i]):
        most = max(most, _speed(system, system.row[i] + a))
        forward += system.slip[first + a] * pick.now.along[i, a]
    return _share(forward, most + abs(compliance(system, first, first)) * _friction(system, i), 0.0)


@compiled_subset
def _coupled(system: ContactSystem, i: int, j: int) -> bool:
    """Return whether two contacts can only slip together."""
    a, b = system.first[i], system.first[j]
    own = compliance(system, a, a) * compliance(system, b, b)
    return abs(own - compliance(system, a, b) * compliance(system, b, a)) <= _TOGETHER * abs(own)


@compiled_subset
def _held_by_friction(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Return whether friction holds a contact along a line now, and it either sticks or begins to slip afterwards."""
    return rests(system, pick, i) and system.width[i] == 1 and (pick.now.mode[i] == STICK or pick.now.mode[i] == SLIP)


@compiled_subset
def _has_own_slip(system: ContactSystem, i: int) -> bool:
    """Return whether a contact along a line slips beyond rounding in the present combination."""
    r = system.first[i]
    size = _speed(system, system.row[i]) + abs(compliance(system, r, r)) * _all_forces(system)
    return abs(system.slip[r]) > _GRAZING * size


@compiled_subset
def _splits_coupled_contacts(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether a contact sticks that can only slip together with one that begins to slip.

    One that slips although the other sticks has a slip of its own, as on a belt that runs while a wall stands still.
    """
    for i in range(system.contacts):
        for j in range(system.contacts):
            apart = pick.now.mode[i] == SLIP and pick.now.mode[j] == STICK
            if apart and _held_by_friction(system, pick, i) and _held_by_friction(system, pick, j):
                if not _has_own_slip(system, i) and _coupled(system, i, j):
                    return True
    return False


@compiled_subset
def _unchanged(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether contacts that can no longer share a load keep their states."""
    parted, same = False, True
    for i in range(system.contacts):
        parted = parted or pick.fired[i] & SHARE != 0
        same = same and pick.now.mode[i] == pick.given.mode[i]
        same = same and (system.sided[i] == 0 or pick.now.sides[i] == pick.given.sides[i])
    return parted and same


@compiled_subset
def _law(system: ContactSystem, pick: Candidates, i: int, force: float) -> float:
    """Return the margin of the laws of one contact; `force` is the size of all forces."""
    least, state, press = 1.0, pick.now.mode[i], pick.now.sides[i] * system.press[i]
    if state == OPEN:
        if pick.kind[i] == FREE or pick.kind[i] == LIFTING:
            return 1.0
        return _share(system.opening[i], _speed(system, system.constraint[i]), pick.still[i])
    if not turned(pick, i) and (system.constraint[i] >= 0 or system.sided[i] != 0):
        least = min(least, _share(press, force, pick.least[i]))
    if state == STICK:
        used = 0.0
        for r in range(system.first[i], system.first[i] + system.width[i]):
            size = _speed(system, system.constraints + r) + force * _pushed(system, i)
            if abs(system.slip[r]) > _POWERLESS * size:
                return -1.0
            used += system.forces[r, 0] * system.forces[r, 0]
        if turned(pick, i):
            press = max(press, 0.0)  # it is zero, and its sign is rounding
        limit, used = (system.mu[i] if pick.slides[i] != 0 else system.mu_static[i]) * press, sqrt(used)
        least = min(least, _share(limit - used, force, max(pick.least[i], _TIED * (abs(limit) + used))))
    if state == SLIP and rests(system, pick, i):
        share = _forward(system, pick, i)
        if broken(pick, i) != 0 and share >= -_GRAZING:
            share = max(share, 0.0)
        if pick.begins[i] != 0 and uneven(system, pick, i):
            share = -1.0
        least = min(least, share)
    return least


@compiled_subset
def _laws(system: ContactSystem, pick: Candidates) -> float:
    """Return the margin of the laws of all contacts, with the present forces."""
    force, least = _all_forces(system), 1.0
    for i in range(system.contacts):
        least = min(least, _law(system, pick, i, force))
    return least


@compiled_subset
def _best_share(system: ContactSystem, pick: Candidates, least: float) -> float:
    """Return the largest margin that friction forces have which the equations of motion do not determine.

    Contacts that can only slip together stick as long as there is any way to share the load that breaks no law. The
    margin is a concave function along each direction, whose maximum is found by golden sections.
    """
    scale, count = _all_forces(system), system.solved.undetermined
    for _ in range(_SHARE_ROUNDS if count > 1 else 1):
        for a in range(count):
            low, high, at = -4.0 * scale, 4.0 * scale, 0.0
            for _ in range(_SECTIONS):
                left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
                shift_forces(system, a, left - at)
                first = _laws(system, pick)
                shift_forces(system, a, right - left)
                second = _laws(system, pick)
                at = right
                least = max(least, first, second)
                if first < second:
                    low = left
                else:
                    high = right
            shift_forces(system, a, 0.5 * (low + high) - at)
            least = max(least, _laws(system, pick))
    return least


@compiled_subset
def _margin(system: ContactSystem, pick: Candidates) -> float:
    """Return by which share of the forces, at least, a combination contradicts nothing; below zero it does."""
    for j in range(system.coordinates):
        if not math.isfinite(system.motion[j]):
            return math.nan
    if _splits_coupled_contacts(system, pick) or _unchanged(system, pick):
        return -1.0
    least = _laws(system, pick)
    return _best_share(system, pick, least) if system.solved.undetermined > 0 else least


@compiled_subset
def _excludes_first(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether the combination excludes the first clear one."""
    excludes, now, clear = False, pick.now, pick.clear
    for i in range(system.contacts):
        excludes = excludes or (now.mode[i] == OPEN) != (clear.mode[i] == OPEN)
        excludes = excludes or (system.sided[i] != 0 and now.sides[i] != clear.sides[i])
    return excludes


@compiled_subset
def _try_all(system: ContactSystem, pick: Candidates, expected: bool, meets: bool) -> tuple[int, int]:
    """Try all combinations; return a status, and 2 where one holds, 1 where one does within rounding, else 0.

    Where a contact ``meets``, rounding is no reason to leave it open: a guard fires at once where that was wrong.
    """
    list_options(system, pick, expected)
    best, clear, lost, ambiguous, going = 0, 0, False, False, True
    while going:
        if combine(system, pick):
            steady_directions(system, pick)
        solve_mode(system, pick.now)
        for j in range(system.coordinates):
            pick.now.motion[j] = system.motion[j]
        margin = _margin(system, pick)
        lost = lost or math.isnan(margin)
        grade = 0
        if margin >= -ROUNDING:
            grade = 2 if margin >= 0.0 or meets else 1
        if grade > best:
            best = grade
            copy_combination(pick.now, pick.best)
        if margin > ROUNDING:
            if clear == 0:
                copy_combination(pick.now, pick.clear)
            ambiguous = ambiguous or _excludes_first(system, pick)
            clear += 1
        going = next_combination(pick)
    if ambiguous:
        return _AMBIGUOUS, best
    if best > 0:
        return _SUCCESS, best
    return _NON_FINITE if lost else _IMPOSSIBLE, best


@compiled_subset
def select_mode(system: ContactSystem, pick: Candidates, known: bool, meets: bool) -> int:
    """Select the mode of the contacts, which is the best of the candidates; return a status.

    The forces and demands are those of `load_accelerations` or `load_impact`. What has just failed to hold, or to
    push, is left out first; where all contacts together then contradict something, it is tried as well
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
    sided, status, best, relaxed = False, _IMPOSSIBLE, 0, True
    for i in range(system.contacts):
        sided = sided or system.sided[i] != 0
    while relaxed:
        if known and sided:
            status, best = _try_all(system, pick, True, meets)
            if best == 2:
                return status
        status, best = _try_all(system, pick, False, meets)
        if status != _IMPOSSIBLE:
            return status
        relaxed = False
        for i in range(system.contacts):
            relaxed = relaxed or pick.fired[i] != 0 or pick.kind[i] == LIFTING or pick.struck[i] != 0
            pick.fired[i] = pick.struck[i] = 0
            if pick.kind[i] == LIFTING:
                pick.kind[i] = closed_kind(system, i, 0.0, 0.0)
    return status
