"""Guesses of contact forces: iterations on one contact after the other, the others being as they are.

Each contact is pushed by what its gap misses, and rubbed by what it slips; its friction is then brought back into the
cone (M. Jean, Computer Methods in Applied Mechanics and Engineering 177 (1999) 235-257). Forces that stay as they are
obey Coulomb's law: in a plane both components of a step have one length.
"""

from __future__ import annotations

from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_system import OPEN, SLIP, STICK, ContactSystem
from .contact_responses import load_compliances, normal_load
from .mode_candidates import GRIPPED, RELEASED, Candidates, choose_all, combine, find_option
from .mode_laws import friction_limit

_SWEEPS, _LEAST_SHARE, _CLOSE = 400, 0.25, 1e-10
"""Most iterations over all contacts with steps of one length; the least of these for friction in a plane, halved where
longer ones do not converge; and the change of the forces, relative to the largest, at which iterations end."""

_FULL = 1.0 - 1e-6
"""Share of the most friction from which iterations on the forces let a contact slip."""


@compiled_subset
def _excess(system: ContactSystem, pick: Candidates, row: int) -> float:
    """Return the acceleration of slip, or of a gap, that the present guess of the forces leaves."""
    value = system.compliances[row, 0]
    for j in range(pick.guessed.size):
        value += system.compliances[row, 1 + j] * pick.guessed[j]
    return value


@compiled_subset
def _guessed_press(system: ContactSystem, pick: Candidates, i: int) -> float:
    """Return the present guess of the normal reaction of a contact, or of the one whose further law it is."""
    leader = system.leader[i]
    return pick.guessed[system.slips + leader] + system.restored[leader]


@compiled_subset
def _step_of_friction(system: ContactSystem, pick: Candidates, i: int, share: float) -> None:
    """Let the guessed friction of a contact oppose its slip. In a plane one step length keeps the direction of slip."""
    guessed, first, last, ease = pick.guessed, system.first[i], system.first[i] + system.width[i] - 1, 0.0
    for r in range(first, last + 1):
        ease += system.compliances[r, 1 + r]
    if ease > 0.0:
        one, other = _excess(system, pick, first) / ease, _excess(system, pick, last) / ease
        if first == last:
            guessed[first] -= one
        else:
            guessed[first] -= share * one
            guessed[last] -= share * other


@compiled_subset
def _guess_contact(system: ContactSystem, pick: Candidates, i: int, share: float) -> float:
    """Improve the guess of the forces of one contact; return the largest change."""
    guessed, row, first = pick.guessed, system.slips + i, system.first[i]
    ease, press, last = system.compliances[row, 1 + row], guessed[row], first + system.width[i] - 1
    if ease > 0.0:
        guessed[row] = max(press - _excess(system, pick, row) / ease, 0.0)
    if system.given[i] != 0:
        guessed[row] = normal_load(system, i)
    change, sticks = abs(guessed[row] - press), find_option(pick, i, STICK, 0, 0) >= 0
    pressing = _guessed_press(system, pick, i)
    if system.width[i] == 0:
        return change
    before, other = guessed[first], guessed[last]
    if sticks:
        _step_of_friction(system, pick, i, share)
        used = 0.0
        for r in range(first, last + 1):
            used += guessed[r] * guessed[r]
        most = friction_limit(system, pick, i) * pressing
        if used > most * most:
            for r in range(first, last + 1):
                guessed[r] *= most / sqrt(used)
    else:
        for a in range(system.width[i]):
            guessed[first + a] = -system.mu[i] * pressing * pick.now.along[i, a]
    return max(change, abs(guessed[first] - before), abs(guessed[last] - other))


@compiled_subset
def _iterate(system: ContactSystem, pick: Candidates, share: float) -> bool:
    """Improve the guess of all forces, one contact after the other; return whether it converges."""
    for _ in range(_SWEEPS):
        change, largest = 0.0, 0.0
        for i in range(system.contacts):
            if pick.now.mode[i] != OPEN:
                change = max(change, _guess_contact(system, pick, i, share))
                largest = max(largest, pick.guessed[system.slips + i])
        if change <= _CLOSE * largest:
            return True
    return False


@compiled_subset
def guess_forces(system: ContactSystem, pick: Candidates) -> None:
    """Choose the combination that iterations on the forces suggest: one contact at a time, the others as they are."""
    for j in range(pick.guessed.size):
        pick.guessed[j] = 0.0
    choose_all(pick, False)
    combine(system, pick)
    load_compliances(system)
    share, least = 1.0, 1.0
    for i in range(system.contacts):
        least = _LEAST_SHARE if system.width[i] > 1 else least
    while share >= least and not _iterate(system, pick, share):
        share *= 0.5
    for i in range(system.contacts):
        press, opened, used = pick.guessed[system.slips + i], find_option(pick, i, OPEN, 0, 0), 0.0
        for r in range(system.first[i], system.first[i] + system.width[i]):
            used += pick.guessed[r] * pick.guessed[r]
        side = 0 if system.restored[i] == 0.0 else 1 if press > 0.0 else RELEASED
        sticks, most = find_option(pick, i, STICK, side, 0), friction_limit(system, pick, i)
        if press == 0.0 and opened >= 0:
            pick.choice[i] = opened
        elif sticks >= 0 and sqrt(used) >= _FULL * most * _guessed_press(system, pick, i):
            way = 0 if system.width[i] != 1 else -1 if pick.guessed[system.first[i]] > 0.0 else 1
            pick.choice[i] = max(find_option(pick, i, SLIP, side, way), 0)
        elif side != 0:
            pick.choice[i] = sticks if sticks >= 0 else max(find_option(pick, i, system.closed[i], side, 0), 0)


@compiled_subset
def guess_directions(system: ContactSystem, pick: Candidates) -> bool:
    """Write the directions in which iterations on the forces let contacts in a plane begin to slip; return if any."""
    guess_forces(system, pick)
    for i in range(system.contacts):
        r, slipping = system.first[i], pick.kind[i] == GRIPPED and system.width[i] > 1
        size = sqrt(pick.guessed[r] * pick.guessed[r] + pick.guessed[r + 1] * pick.guessed[r + 1]) if slipping else 0.0
        if size > 0.0:
            pick.found.guided = 1
            for a in range(2):
                pick.given.along[i, a] = -pick.guessed[r + a] / size
    return pick.found.guided != 0
