"""Impacts of contacts: the rates after them, what is known of each contact then, and rates that a mode allows."""

from __future__ import annotations

from ..arrays import FloatArray
from ..methods.status import Status
from ..subset.compiled_subset import compiled_subset, sqrt
from .contact_cases import (
    ADDED,
    NOISE,
    SIDE,
    ContactCases,
    gap_noise,
    gap_rate,
    motionless_rate,
    rate_noise,
    rate_terms,
    slow_terms,
)
from .contact_kinds import RESTING, ROUNDED, STILL
from .contact_system import CLOSED, OPEN, POISSON, SEQUENCE, SLIP, STICK, ContactSystem, dot, drift, terms
from .selection.contact_forces import load_correction, load_impact, load_restitution, solve_mode
from .selection.mode_candidates import FREE, GRIPPED, HOVERING, LIFTING, SLIDING, TOUCHING, Candidates, closed_kind
from .selection.mode_selection import select_mode

_MOST_IMPACTS = 10_000
"""Impacts at one instant, after which they accumulate."""

_MAY_MOVE = 1e-9
"""Share of the terms of a velocity up to which it counts as zero where a phase starts: a tenth of what
`dalembert.reduction.start_limits` allows."""

_FASTER = 1.0 + 1e-9
"""Factor by which a contact approaches faster than those before it, where impacts are solved for one by one."""

_PUSHES = 1e-9
"""Share of the largest normal impulse above which a contact takes part in an impact."""

_MAY_MISS = 0.1
"""Share of the noise of a gap that a closed contact may miss: the same tenth."""

_SUCCESS, _ACCUMULATE = int(Status.SUCCESS), int(Status.EVENTS_ACCUMULATE)


@compiled_subset
def strike(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> int:
    """Solve for the rates after an impact of the contacts that are struck, and take them; return a status."""
    cases.impacts[case] += 1
    if cases.impacts[case] > _MOST_IMPACTS:
        return _ACCUMULATE
    if system.impacts == SEQUENCE:
        _single_out(system, pick, cases, case)
    load_impact(system)
    struck = False
    for i in range(system.contacts):
        row = system.constraint[i]
        struck = struck or pick.struck[i] == 1
        pick.rebounds[i] = 1 if row >= 0 and pick.struck[i] != 2 else 0
        if pick.struck[i] == 1 and system.impacts != POISSON:
            system.demand[row] -= system.restitution[i] * system.velocity[row]
        if pick.kind[i] == LIFTING:  # it still touches, and may be pushed
            pick.kind[i] = closed_kind(system, i, 0.0, 0.0)
            pick.slides[i] = 1 if pick.kind[i] == GRIPPED and pick.given.mode[i] == SLIP else 0
        if pick.kind[i] == SLIDING:
            pick.kind[i], pick.slides[i] = GRIPPED, 1
        pick.fired[i] = 0
        pick.still[i], pick.least[i] = motionless_rate(system, i) if row >= 0 else 0.0, 0.0
    status = select_mode(system, pick, False, False)
    if status != _SUCCESS:
        return status
    _remember_shared(system, pick, cases, case)
    if system.impacts == POISSON and struck and _gives_back(system, pick):
        status = select_mode(system, pick, False, False)
        _keep(system)
        if status != _SUCCESS:
            return status
    for j in range(system.coordinates):
        cases.x[case, system.coordinates + j] = pick.best.motion[j]
    for i in range(system.contacts):
        cases.after[case, i] = _kind_after(system, pick, cases, case, i)
        along = pick.best.along
        cases.added[case, ADDED * i], cases.added[case, ADDED * i + 1] = along[i, 0], along[i, 1]
        if system.sided[i] != 0:
            cases.added[case, ADDED * i + SIDE] = pick.best.sides[i]
    return status


@compiled_subset
def _gives_back(system: ContactSystem, pick: Candidates) -> bool:
    """Have the second part of an impact by Poisson's law solved for; return whether any contact returns an impulse.

    Each contact that was pushed during the compression returns at least its restitution times that impulse, and more
    where it would be pressed together otherwise; friction is that of these impulses.
    """
    gives = False
    for i in range(system.contacts):
        if pick.rebounds[i] != 0 and pick.kind[i] != FREE and pick.best.mode[i] != OPEN:
            system.restored[i] = system.restitution[i] * max(pick.best.press[i], 0.0)
            gives = gives or system.restored[i] > 0.0
        if pick.best.mode[i] == SLIP:
            pick.slides[i] = 1
        pick.struck[i] = 0
    if gives:
        load_restitution(system, pick.best.motion)
    return gives


@compiled_subset
def _keep(system: ContactSystem) -> None:
    """End the second part of an impact: nothing is returned any more."""
    for i in range(system.contacts):
        system.restored[i] = 0.0


@compiled_subset
def _single_out(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Let the contact that approaches fastest be struck alone, as if all others were a little open.

    These have no part in the impact; they may separate, or be struck after it.
    """
    fastest, chosen = 0.0, -1
    for i in range(system.contacts):
        if pick.struck[i] != 0 and (chosen < 0 or -gap_rate(system, i) > _FASTER * fastest):
            fastest, chosen = -gap_rate(system, i), i
    for i in range(system.contacts):
        if i != chosen and system.constraint[i] >= 0 and (pick.kind[i] >= TOUCHING or pick.kind[i] == LIFTING):
            pick.kind[i], pick.struck[i], cases.after[case, i] = FREE, 0, HOVERING


@compiled_subset
def _remember_shared(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Record an impact in which several contacts take part, or that follows others at the same instant."""
    touching, pushing, largest = 0, 0, 0.0
    for i in range(system.contacts):
        touching += 1 if system.constraint[i] >= 0 and pick.best.mode[i] != OPEN else 0
    if touching > 1:
        solve_mode(system, pick.best)
        for i in range(system.contacts):
            largest = max(largest, system.press[i])
        for i in range(system.contacts):
            closed = system.constraint[i] >= 0 and pick.best.mode[i] != OPEN
            pushing += 1 if closed and system.press[i] > _PUSHES * largest else 0
    if pushing > 1 or cases.impacts[case] > 1:
        if cases.shared[case] == 0:
            cases.shared_at[case] = cases.t[case]
        cases.shared[case] += 1


@compiled_subset
def _rate_after(system: ContactSystem, pick: Candidates, row: int) -> float:
    """Return the rate of a constraint, or a slip velocity, after an impact."""
    return dot(system.jacobian[row], pick.best.motion, drift(system, row))


@compiled_subset
def _kind_after(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact after an impact."""
    if pick.kind[i] == FREE and cases.after[case, i] != HOVERING:
        return FREE
    if system.constraint[i] >= 0:
        row = system.constraint[i]
        rate = float(system.sense[i]) * _rate_after(system, pick, row)
        least = max(rate_noise(system, i), NOISE * terms(system.jacobian[row], pick.best.motion, 0.0))
        if rate > max(least, RESTING * cases.approach[case, i]):
            return FREE
        if pick.kind[i] == FREE or rate > max(least, STILL * cases.approach[case, i]):
            return HOVERING
    total = 0.0
    if pick.best.mode[i] != STICK:
        for a in range(system.width[i]):
            slip = _rate_after(system, pick, system.row[i] + a)
            total += slip * slip
    return closed_kind(system, i, sqrt(total), NOISE * cases.speeds[case, i])


@compiled_subset
def _row_moves(system: ContactSystem, x: FloatArray, row: int, fastest: float) -> bool:
    """Return whether a velocity that is to vanish does not; `fastest` is the largest there was of its contact.

    The start of a phase compares each velocity with its own terms: those of another direction of slip excuse nothing.
    """
    size = max(rate_terms(system, row), slow_terms(system, x, row))
    return not abs(system.velocity[row]) <= min(ROUNDED * fastest, _MAY_MOVE * size)


@compiled_subset
def moves_in_mode(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Return whether a contact that is closed, or sticks, in the selected mode moves more than rounding makes of it.

    What is rounding of fast motions may be all that is left of them: beside the present rates, too, it must be small,
    or the phase could not start.
    """
    moves = False
    for i in range(system.contacts):
        if pick.best.mode[i] == STICK:
            for row in range(system.row[i], system.row[i] + system.width[i]):
                moves = moves or _row_moves(system, cases.x[case], row, cases.speeds[case, i])
        if pick.best.mode[i] != OPEN and system.constraint[i] >= 0:
            moves = moves or _row_moves(system, cases.x[case], system.constraint[i], cases.approach[case, i])
    return moves


@compiled_subset
def hold(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Give a case the rates nearest to the present ones, by kinetic energy, that its mode allows.

    A contact that begins to slip in a plane is at rest, and stays so: else this would choose the direction of its slip.
    """
    load_impact(system)
    for i in range(system.contacts):
        if pick.best.mode[i] != OPEN and pick.best.mode[i] != STICK:
            pick.best.mode[i] = STICK if pick.kind[i] == GRIPPED and system.width[i] > 1 else CLOSED
    solve_mode(system, pick.best)
    for j in range(system.coordinates):
        cases.x[case, system.coordinates + j] = system.motion[j]


@compiled_subset
def _misses(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Return whether gaps of closed contacts miss zero by more than a phase may start with, from rounding alone.

    Coordinates that are small now may have been large before: rounding is a share of how far the contacts may have
    moved, and what the location of an event leaves is one of how far in the last phase.
    """
    fastest, misses = 0.0, False
    for i in range(system.contacts):
        fastest = max(fastest, cases.approach[case, i], cases.speeds[case, i])
    most = fastest * (NOISE * abs(cases.passed[case]) + ROUNDED * abs(cases.t[case]))
    for i in range(system.contacts):
        if pick.best.mode[i] != OPEN and system.constraint[i] >= 0:
            if abs(system.gap[i]) > most:
                return False
            misses = misses or abs(system.gap[i]) > _MAY_MISS * gap_noise(system, cases.x[case], i)
    return misses


@compiled_subset
def close_gaps(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Move a case to where the gaps of its closed contacts are zero, if the present coordinates make rounding of it."""
    if not _misses(system, pick, cases, case):
        return
    load_correction(system)
    for i in range(system.contacts):
        if pick.best.mode[i] != OPEN:
            pick.best.mode[i] = CLOSED
    solve_mode(system, pick.best)
    for j in range(system.coordinates):
        cases.x[case, j] += system.motion[j]
