"""Search for a mode that contradicts no law of contact, where there are too many combinations to try all.

From the combination that is preferred, the contacts whose laws are violated do what these call for: one that pulls
opens, one that approaches closes, one that friction cannot hold slips, one that slips backwards sticks. All of them
change at once as long as fewer and fewer laws are violated; where that does not help, the first of them alone, so that
no cycle arises where the laws have one solution (J. J. Judice and F. M. Pires, Computers and Operations Research 21
(1994) 587-596; K. G. Murty, Linear Algebra and its Applications 9 (1974) 65-108). Where that ends nowhere, iterations
on the forces suggest a combination to begin from, and then complementary pivots do (`guessed_forces`). A combination
counts only where it obeys the laws of `mode_laws`.
"""

from __future__ import annotations

from ...subset.compiled_subset import compiled_subset
from ..contact_system import OPEN, SLIP, STICK, ContactSystem, inertial_size
from .contact_forces import compliance, gap_compliance, solve_mode
from .guessed_forces import choose_complementary, guess_forces
from .mode_candidates import RELEASED, TOUCHING, Candidates, choose_all, combine, find_option, list_options
from .mode_laws import ROUNDING, all_forces, contact_margin, push_margin, slips_in_vain, splits, unchanged
from .mode_trials import take, try_combination

_PATIENCE = 4
"""Steps of all violated contacts at once that may fail to leave fewer violated laws."""

_STEPS, _STEPS_EACH, _PROBING = 20, 20, 8
"""Most steps of a search, those for each contact in addition, and most steps of a search for another solution."""

_POWERLESS = 1e-12
"""Share of the acceleration of a gap that a friction force could cause, up to which it causes none."""


@compiled_subset
def _closed_option(pick: Candidates, i: int) -> int:
    """Return the number of the first option of a contact in which it is closed; -1 where it has none."""
    for n in range(pick.option_count[i]):
        if pick.options[i, 3 * n] != OPEN:
            return n
    return -1


@compiled_subset
def _remedy(system: ContactSystem, pick: Candidates, i: int, force: float, least: float) -> int:
    """Return the number of the option that the violated law of a contact calls for; -1 where it has none."""
    place, state = 3 * pick.choice[i], pick.now.mode[i]
    side, way = pick.options[i, place + 1], pick.options[i, place + 2]
    if state == OPEN:
        return _closed_option(pick, i)
    if push_margin(system, pick, i, force) < least:
        if system.restored[i] > 0.0:
            return find_option(pick, i, state, 1 if side == RELEASED else RELEASED, way)
        opened = find_option(pick, i, OPEN, 0, 0)
        return opened if opened >= 0 or system.sided[i] == 0 else find_option(pick, i, state, -side, way)
    if state == STICK:
        return find_option(pick, i, SLIP, side, _way_of_slip(system, pick, i, force))
    sticking = find_option(pick, i, STICK, side, 0)
    return sticking if sticking >= 0 or way == 0 else find_option(pick, i, SLIP, side, -way)


@compiled_subset
def _way_of_slip(system: ContactSystem, pick: Candidates, i: int, force: float) -> int:
    """Return the direction in which a contact along a line slips that friction fails to hold; 0 in a plane."""
    first = system.first[i]
    if system.width[i] != 1:
        return 0
    if contact_margin(system, pick, i, force) == -1.0 and system.slip[first] != 0.0:  # friction has no hold on it
        return 1 if system.slip[first] > 0.0 else -1
    return -1 if system.forces[first, 0] > 0.0 else 1


@compiled_subset
def _violated(system: ContactSystem, pick: Candidates, least: float) -> int:
    """Write the options that violated laws call for; return the number of laws that are violated."""
    count, force, tightest, weakest = 0, all_forces(system), 2.0, -1
    for i in range(system.contacts):
        pick.wanted[i] = -1
        margin = contact_margin(system, pick, i, force)
        if margin < least:
            count += 1
            pick.wanted[i] = _remedy(system, pick, i, force, least)
        if pick.now.mode[i] == STICK and margin < tightest:
            tightest, weakest = margin, i
    if count == 0 and weakest >= 0 and unchanged(system, pick):
        count = 1
        pick.wanted[weakest] = _remedy(system, pick, weakest, force, least)
    for i in range(system.contacts if count == 0 else 0):
        if weakest >= 0 and slips_in_vain(system, pick, i):
            count += 1
            pick.wanted[weakest] = _remedy(system, pick, weakest, force, least)
        for j in range(system.contacts):
            if splits(system, pick, i, j):
                count += 1
                _join(system, pick, i, j)
    return count


@compiled_subset
def _join(system: ContactSystem, pick: Candidates, i: int, j: int) -> None:
    """Let a contact j slip that sticks although it can only slip together with i; or let both stick."""
    a, b = system.first[i], system.first[j]
    same = compliance(system, b, a) * compliance(system, a, a) * pick.now.along[i, 0] > 0.0
    pick.wanted[j] = find_option(pick, j, SLIP, pick.options[j, 3 * pick.choice[j] + 1], 1 if same else -1)
    if pick.wanted[j] < 0:
        pick.wanted[i] = find_option(pick, i, STICK, pick.options[i, 3 * pick.choice[i] + 1], 0)


@compiled_subset
def _change(pick: Candidates, together: bool) -> bool:
    """Let contacts do what violated laws call for, all ``together`` or only the first; return whether any does."""
    changed = False
    for i in range(pick.choice.size):
        if pick.wanted[i] >= 0 and (together or not changed):
            pick.choice[i], changed = pick.wanted[i], True
    return changed


@compiled_subset
def _search(system: ContactSystem, pick: Candidates, meets: bool, steps: int) -> bool:
    """Go from the chosen combination to one that holds; return whether one was found, within rounding at least."""
    fewest, failures, left, met = system.contacts + 1, 0, steps, False
    while left > 0:
        grade = try_combination(system, pick, meets)
        if grade == 2:
            return True
        if grade == 1 and not met:
            met, fewest, left = True, system.contacts + 1, min(left, system.contacts)
        count = _violated(system, pick, 0.0 if grade == 1 else -ROUNDING)
        if count < fewest:
            fewest, failures = count, 0
        else:
            failures += 1
        if not _change(pick, failures <= _PATIENCE):
            return met
        left -= 1
    return met


@compiled_subset
def _prefer(system: ContactSystem, pick: Candidates, meets: bool) -> None:
    """Let contacts in turn do what they prefer to what the taken combination has, where that holds no less."""
    for i in range(system.contacts):
        for n in range(pick.taken[i]):
            for j in range(system.contacts):
                pick.choice[j] = pick.taken[j]
            pick.choice[i] = n
            before = pick.found.best
            if try_combination(system, pick, meets) >= before:
                take(pick)
                break


@compiled_subset
def friction_decides(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether friction may decide which contacts open: it moves gaps, or constraints have two sides.

    Otherwise the accelerations of the gaps follow from the normal reactions alone, and have one solution.
    """
    for i in range(system.contacts):
        if system.constraint[i] < 0 and system.leader[i] == i:
            return True
        pick.now.mode[i] = OPEN
    solve_mode(system, pick.now)
    for i in range(system.contacts):
        if pick.kind[i] < TOUCHING or system.leader[i] != i:
            continue
        gap = inertial_size(system, system.jacobian[system.constraint[i]])
        for j in range(system.contacts):
            rough = pick.kind[j] >= TOUCHING and system.mu_static[j] > 0.0
            for r in range(system.first[j], system.first[j] + (system.width[j] if rough else 0)):
                size = gap * inertial_size(system, system.power[system.tangential[r]])
                if abs(gap_compliance(system, i, r)) > _POWERLESS * size:
                    return True
    return False


@compiled_subset
def _exclude(pick: Candidates, i: int) -> int:
    """Leave out the options of a contact with which it is open, or closed to a side, as taken; return how many stay."""
    place, left = 3 * pick.taken[i], 0
    opened, side = pick.options[i, place] == OPEN, pick.options[i, place + 1]
    for n in range(pick.option_count[i]):
        if (pick.options[i, 3 * n] == OPEN) != opened or pick.options[i, 3 * n + 1] != side:
            for part in range(3):
                pick.options[i, 3 * left + part] = pick.options[i, 3 * n + part]
            left += 1
    pick.option_count[i] = left
    return left


@compiled_subset
def search_modes(system: ContactSystem, pick: Candidates, expected: bool, meets: bool, several: bool) -> None:
    """Search for combinations of the listed options that hold.

    Where the laws may have ``several`` solutions, others are then looked for in which one of the contacts is open
    instead of closed, or the reverse. ``expected`` is that of `list_options`.
    """
    steps = _STEPS + _STEPS_EACH * system.contacts
    for start in range(3):
        if start == 1:
            guess_forces(system, pick)
        else:
            choose_all(pick, start == 2)
        if _search(system, pick, meets, steps):
            break
    if pick.found.best == 0 and pick.table.shape[0] > 0:
        choose_all(pick, False)
        combine(system, pick)
        if choose_complementary(system, pick):
            _search(system, pick, meets, steps)
    if pick.found.best > 0:
        _prefer(system, pick, meets)
    if pick.found.best == 0 or not several:
        return
    best = pick.found.best
    for i in range(system.contacts):
        list_options(system, pick, expected)
        for n in range(_exclude(pick, i)):
            if pick.found.ambiguous == 0 and pick.found.best == best:
                for j in range(system.contacts):
                    pick.choice[j] = n if j == i else pick.taken[j]
                _search(system, pick, meets, _PROBING)
                if pick.found.ambiguous == 0:
                    choose_all(pick, True)
                    pick.choice[i] = n
                    _search(system, pick, meets, _PROBING)
