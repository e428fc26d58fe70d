"""Laws of contact: by which share of the forces a combination of what contacts do obeys them.

Closed contacts push and do not pull, open ones do not approach, what sticks needs no more friction than there is, and
friction opposes the slip that it lets begin. After an impact the same holds of impulses and of rates.
"""

from __future__ import annotations

from ...methods.step_constants import EPSILON
from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_system import OPEN, SLIP, STICK, ContactSystem, inertia_of, inertial_size
from .contact_forces import compliance
from .dead_centres import motionless
from .mode_candidates import FREE, LIFTING, SHARE, STOP, Candidates, broken, rests, turned
from .slip_direction import held_by_others, turns_back, uneven

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

TOGETHER = 1e-9
"""Share to which the slips of two contacts may differ from being multiples of each other."""


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
def all_forces(system: ContactSystem) -> float:
    """Return the sum of the sizes of the forces of all contacts; those of further laws by what they do beside these."""
    total = 0.0
    for i in range(system.contacts):
        total += (abs(system.press[i]) if system.leader[i] == i else 0.0) + system.weight[i] * _friction(system, i)
    return total


@compiled_subset
def _speed(system: ContactSystem, row: int) -> float:
    """Return the largest acceleration along a row, or rate after an impact, that the size of the motion allows."""
    total = 0.0
    for j in range(system.coordinates):
        inertia = inertia_of(system, j)
        total += (inertia if inertia > 0.0 else 1.0) * system.motion[j] * system.motion[j]
    return sqrt(total) * inertial_size(system, system.jacobian[row])


@compiled_subset
def _pushed(system: ContactSystem, i: int) -> float:
    """Return the size of the accelerations along a contact that a unit of its normal reaction may cause.

    A given load causes none itself: then it is a unit of the friction forces.
    """
    size, pushing = 0.0, inertial_size(system, system.power[system.normal[i]])
    if system.constraint[i] >= 0:
        size = inertial_size(system, system.jacobian[system.constraint[i]])
    for a in range(system.width[i]):
        size = max(size, inertial_size(system, system.jacobian[system.row[i] + a]))
        if system.given[i] != 0:
            pushing = max(pushing, inertial_size(system, system.power[system.tangential[system.first[i] + a]]))
    return size * pushing


@compiled_subset
def friction_limit(system: ContactSystem, pick: Candidates, i: int) -> float:
    """Return the coefficient of friction up to which a contact sticks."""
    return system.mu[i] if pick.slides[i] != 0 else system.mu_static[i]


@compiled_subset
def _forward(system: ContactSystem, pick: Candidates, i: int) -> float:
    """Return by which share of the motion, and of what friction does to it, slip begins along its direction."""
    first, most, forward = system.first[i], 0.0, 0.0
    for a in range(system.width[i]):
        most = max(most, _speed(system, system.row[i] + a))
        forward += system.slip[first + a] * pick.now.along[i, a]
    if pick.found.backwards != 0 and system.width[i] == 1:
        forward = -forward
    ease = abs(compliance(system, first, first))
    noise = ease * system.weight[i] * friction_limit(system, pick, i) * pick.least[i]
    return _share(forward, most + ease * _friction(system, i), noise)


@compiled_subset
def coupled(system: ContactSystem, i: int, j: int) -> bool:
    """Return whether two contacts can only slip together."""
    a, b = system.first[i], system.first[j]
    own = compliance(system, a, a) * compliance(system, b, b)
    return abs(own - compliance(system, a, b) * compliance(system, b, a)) <= TOGETHER * abs(own)


@compiled_subset
def _held_by_friction(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Return whether friction holds a contact along a line now, and it either sticks or begins to slip afterwards."""
    return rests(system, pick, i) and system.width[i] == 1 and (pick.now.mode[i] == STICK or pick.now.mode[i] == SLIP)


@compiled_subset
def _has_own_slip(system: ContactSystem, i: int) -> bool:
    """Return whether a contact along a line slips beyond rounding in the present combination."""
    r = system.first[i]
    size = _speed(system, system.row[i]) + abs(compliance(system, r, r)) * all_forces(system)
    return abs(system.slip[r]) > _GRAZING * size


@compiled_subset
def splits(system: ContactSystem, pick: Candidates, i: int, j: int) -> bool:
    """Return whether contact j sticks, or slips the other way, although it can only slip together with i, which slips.

    Both are at rest so far. One that slips although the other sticks has a slip of its own, as on a belt that runs
    while a wall stands still; so do both where they slip in opposite ways.
    """
    if i == j or pick.now.mode[i] != SLIP:
        return False
    if _held_by_friction(system, pick, i) and _held_by_friction(system, pick, j):
        if pick.now.mode[j] == SLIP:
            way = pick.now.along[i, 0] * pick.now.along[j, 0]
            apart = way * compliance(system, system.first[i], system.first[j]) < 0.0 and coupled(system, i, j)
            return apart and not (_has_own_slip(system, i) and _has_own_slip(system, j))
        return not _has_own_slip(system, i) and coupled(system, i, j)
    return False


@compiled_subset
def slips_in_vain(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Return whether a law that has another beside it slips, which others that stick do not let it."""
    if pick.now.mode[i] != SLIP or system.several == 0 or not _held_by_friction(system, pick, i):
        return False
    return not _has_own_slip(system, i) and held_by_others(system, pick.now, system.first[i])


@compiled_subset
def splits_coupled_contacts(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether contacts part that can only slip together."""
    for i in range(system.contacts):
        if slips_in_vain(system, pick, i):
            return True
        for j in range(system.contacts):
            if splits(system, pick, i, j):
                return True
    return False


@compiled_subset
def unchanged(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether contacts that can no longer share a load keep their states."""
    parted, same = False, True
    for i in range(system.contacts):
        parted = parted or pick.fired[i] & SHARE != 0
        same = same and pick.now.mode[i] == pick.given.mode[i]
        same = same and (system.sided[i] == 0 or pick.now.sides[i] == pick.given.sides[i])
    return parted and same


@compiled_subset
def push_margin(system: ContactSystem, pick: Candidates, i: int, force: float) -> float:
    """Return by which share of all forces a closed contact pushes; 1 where nothing is required of it.

    One that returns an impulse pushes more than that, or separates.
    """
    if turned(pick, i) or (system.constraint[i] < 0 and system.sided[i] == 0):
        return 1.0
    if pick.now.released[i] != 0:
        return _share(system.opening[i], _speed(system, system.constraint[i]), pick.still[i])
    return _share(pick.now.sides[i] * system.press[i] - system.restored[i], force, pick.least[i])


@compiled_subset
def contact_margin(system: ContactSystem, pick: Candidates, i: int, force: float) -> float:
    """Return the margin of the laws of one contact; `force` is the size of all forces."""
    least, state = 1.0, pick.now.mode[i]
    if state == OPEN:
        if pick.kind[i] == FREE or pick.kind[i] == LIFTING or system.leader[i] != i:
            return 1.0
        return _share(system.opening[i], _speed(system, system.constraint[i]), pick.still[i])
    least = min(least, push_margin(system, pick, i, force))
    if state == STICK:
        used = 0.0
        for r in range(system.first[i], system.first[i] + system.width[i]):
            size = _speed(system, system.constraints + r) + force * _pushed(system, i)
            if abs(system.slip[r]) > _POWERLESS * size:
                return -1.0
            used += system.forces[r, 0] * system.forces[r, 0]
        if turns_back(system, pick.now, i):
            return -1.0
        press = pick.now.sides[i] * system.press[i]
        if turned(pick, i):
            press = max(press, 0.0)  # it is zero, and its sign is rounding
        weight = system.weight[i]
        limit, used = weight * friction_limit(system, pick, i) * press, weight * sqrt(used)
        least = min(least, _share(limit - used, force, max(weight * pick.least[i], _TIED * (abs(limit) + used))))
    if state == SLIP and rests(system, pick, i):
        share = _forward(system, pick, i)
        turns = pick.fired[i] & STOP != 0 or motionless(system, system.constraints + system.first[i])
        if broken(pick, i) != 0 and (share >= -_GRAZING or turns):
            share = max(share, 0.0)
        if pick.begins[i] != 0 and uneven(system, pick, i):
            share = -1.0
        least = min(least, share)
    return least


@compiled_subset
def all_laws(system: ContactSystem, pick: Candidates) -> float:
    """Return the margin of the laws of all contacts, with the present forces."""
    force, least = all_forces(system), 1.0
    for i in range(system.contacts):
        least = min(least, contact_margin(system, pick, i, force))
    return least
