"""Slow slip in a plane: the speeds that count as rest, and slip that reactions without bound stop."""

from __future__ import annotations

from ..methods.status import Status
from ..subset.compiled_subset import compiled_subset
from .contact_cases import ADDED, NOISE, REST, ContactCases, slip_speed, slip_terms, slow_terms
from .contact_impacts import strike
from .contact_system import SLIP, STICK, ContactSystem
from .selection.contact_forces import compliance, solve_mode
from .selection.mode_candidates import GRIPPED, JAMS, LIFT, LIFTING, SLIDING, TOUCHING, Candidates

REST_SHARE, _REST_TOLERANCES = 1e-6, 10.0
"""Rest speed in a plane: a share of the slip speeds so far, at least so many relative tolerances of the run."""

_REST_OF_SPAN, _LEAST_REST = 1e-7, 1e-8
"""Rest speed in a plane where there was no slip so far: a share of what friction and the motion do within the span; and
of the least terms of a slip velocity."""

_SLOW = 1e-3
"""Share of the slip speeds so far up to which slip in a plane is slow: reactions without bound stop it at once."""

_IMPOSSIBLE = int(Status.CONTACT_IMPOSSIBLE)


@compiled_subset
def rest_share(tolerance: float) -> float:
    """Return the share of the slip speeds so far below which slip in a plane counts as rest."""
    return max(REST_SHARE, _REST_TOLERANCES * tolerance)


@compiled_subset
def choose_rest_speeds(
    system: ContactSystem, pick: Candidates, cases: ContactCases, case: int, tolerance: float
) -> None:
    """Choose the slip speeds below which contacts that slip in a plane count as at rest."""
    solved = False
    for i in range(system.contacts):
        if pick.best.mode[i] != SLIP or system.width[i] < 2:
            continue
        if not solved:
            solve_mode(system, pick.best)
        solved, change, moved, force = True, 0.0, 0.0, 0.0
        for r in range(system.first[i], system.first[i] + 2):
            change = max(change, abs(compliance(system, r, r)))
            force += abs(system.forces[r, 0])
            moved += abs(system.slip[r])
        speed = max(cases.speeds[case, i], change * force * abs(cases.passed[case]))
        rest = rest_share(tolerance) * speed
        if rest == 0.0:
            rest = max(
                REST_SHARE * slip_terms(system, i), _REST_OF_SPAN * (change * force + moved) * abs(cases.span[case])
            )
        rest = max(rest, _LEAST_REST * slow_terms(system, cases.x[case], system.row[i]))
        cases.added[case, ADDED * i + REST] = rest if pick.kind[i] == GRIPPED else -rest


@compiled_subset
def take_as_rest(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int, tolerance: float) -> bool:
    """Let contacts in a plane count as at rest whose slip is as slow as rest; return whether there are any."""
    stops = False
    for i in range(system.contacts):
        rest = rest_share(tolerance) * cases.speeds[case, i]
        closed = pick.kind[i] == SLIDING or pick.kind[i] == LIFTING
        if closed and system.width[i] > 1 and slip_speed(system, i) <= rest:
            pick.kind[i], stops = GRIPPED, True
    return stops


@compiled_subset
def _slows(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether a closed contact slips in a plane, but slowly."""
    closed = pick.kind[i] >= TOUCHING or pick.kind[i] == LIFTING
    if not closed or system.width[i] < 2:
        return False
    return NOISE * cases.speeds[case, i] < slip_speed(system, i) <= _SLOW * cases.speeds[case, i]


@compiled_subset
def slides_slowly(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether a closed contact slips so slowly that the end of its slip is near."""
    return pick.kind[i] == SLIDING and slip_speed(system, i) <= _SLOW * cases.speeds[case, i]


@compiled_subset
def jam(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> int:
    """Stop slow slip in a plane by an impulse, where no reactions satisfy the laws; return a status.

    Slow slip turns fast. Where it turns to directions in which steep friction has no reactions, these have grown
    without bound before, and stop it: an impact without collision (F. Genot and B. Brogliato, European Journal of
    Mechanics A 18 (1999) 653-677).
    """
    slows, stops = False, True
    for i in range(system.contacts):
        pick.struck[i] = JAMS if _slows(system, pick, cases, case, i) else 0
        slows = slows or pick.struck[i] == JAMS
    if not slows or cases.span[case] < 0.0:
        return _IMPOSSIBLE
    status = strike(system, pick, cases, case)
    for i in range(system.contacts):
        stops = stops and (pick.best.mode[i] == STICK or not _slows(system, pick, cases, case, i))
    return status if stops else _IMPOSSIBLE


@compiled_subset
def begins_anew(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Return whether a contact whose normal reaction has vanished is to begin to slip in a plane, as if at rest."""
    begins = False
    for i in range(system.contacts):
        anew = cases.fired[case, i] & LIFT != 0 and pick.kind[i] == GRIPPED and system.width[i] > 1
        begins = begins or (anew and pick.best.mode[i] == SLIP)
    return begins
