"""Trials of combinations of what contacts do: by which share of the forces each contradicts no law."""

from __future__ import annotations

import math

from ...subset.compiled_subset import compiled_subset
from ..contact_system import OPEN, ContactSystem
from .contact_forces import solve_mode
from .load_shares import aim, section, share_out
from .mode_candidates import Candidates, combine, copy_combination
from .mode_laws import ROUNDING, all_forces, all_laws, contact_margin, splits_coupled_contacts, unchanged
from .slip_direction import hold_beginning, steady_directions

_SHARE_ROUNDS = 4
"""Rounds over several directions in which forces are not determined."""


@compiled_subset
def _violated_anyhow(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether a law is violated beyond rounding that no share of the load changes."""
    force = all_forces(system)
    for i in range(system.contacts):
        if contact_margin(system, pick, i, force) < -ROUNDING:
            shares = False
            for a in range(system.solved.undetermined):
                aim(system, pick, a)
                shares = shares or pick.shares[i] != 0
            if not shares:
                return True
    return False


@compiled_subset
def _best_share(system: ContactSystem, pick: Candidates, least: float) -> float:
    """Return the largest margin that friction forces have which the equations of motion do not determine.

    Contacts that can only slip together stick as long as there is any way to share the load that breaks no law. The
    margin is a concave function along each direction, whose maximum is found by golden sections. It is not looked for
    where the combination is clear, or contradicts a law with every share.
    """
    scale, count = all_forces(system), system.solved.undetermined
    if least > ROUNDING or _violated_anyhow(system, pick):
        return least
    if (count > 1 or system.several != 0) and share_out(system, pick):
        return max(least, all_laws(system, pick))
    for _ in range(_SHARE_ROUNDS if count > 1 else 1):
        for a in range(count):
            section(system, pick, a, scale)
        least = max(least, all_laws(system, pick))
        if least > ROUNDING:
            break
    return least


@compiled_subset
def _margin(system: ContactSystem, pick: Candidates) -> float:
    """Return by which share of the forces, at least, a combination contradicts nothing; below zero it does."""
    for j in range(system.coordinates):
        if not math.isfinite(system.motion[j]):
            return math.nan
    if splits_coupled_contacts(system, pick) or unchanged(system, pick):
        return -1.0
    least, shares = all_laws(system, pick), system.slips > 0 and system.solved.undetermined > 0
    return _best_share(system, pick, least) if shares else least


@compiled_subset
def _excludes_first(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether the combination excludes the first clear one."""
    excludes, now, clear = False, pick.now, pick.clear
    for i in range(system.contacts):
        excludes = excludes or (now.mode[i] == OPEN) != (clear.mode[i] == OPEN) or now.released[i] != clear.released[i]
        excludes = excludes or (system.sided[i] != 0 and now.sides[i] != clear.sides[i])
    return excludes


@compiled_subset
def take(pick: Candidates) -> None:
    """Take the combination that has been tried."""
    copy_combination(pick.now, pick.best)
    for i in range(pick.choice.size):
        pick.taken[i] = pick.choice[i]


@compiled_subset
def try_combination(system: ContactSystem, pick: Candidates, meets: bool) -> int:
    """Solve for the combination that is chosen; return 2 if it holds, 1 if it does within rounding, else 0.

    The first of the best is taken. Where a contact ``meets``, rounding is no reason to leave it open: a guard fires at
    once where that was wrong.
    """
    if combine(system, pick):
        hold_beginning(system, pick)
        if system.solved.undetermined == 1:  # points of one link: both are at their limits with one share alone
            section(system, pick, 0, all_forces(system))
        steady_directions(system, pick)
    solve_mode(system, pick.now)
    for j in range(system.coordinates):
        pick.now.motion[j] = system.motion[j]
    found, grade, margin = pick.found, 0, _margin(system, pick)
    for i in range(system.contacts):
        pick.now.press[i] = system.press[i]
    if math.isnan(margin):
        found.lost = 1
    if margin >= -ROUNDING:
        grade = 2 if margin >= 0.0 or meets else 1
    if grade > found.best:
        found.best = grade
        take(pick)
    if margin > ROUNDING:
        if found.clear == 0:
            copy_combination(pick.now, pick.clear)
        if _excludes_first(system, pick):
            found.ambiguous = 1
        found.clear += 1
    return grade
