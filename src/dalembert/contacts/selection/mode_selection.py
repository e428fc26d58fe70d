"""Mode selection: the mode of the contacts that contradicts no law of contact (`mode_laws`).

Every combination of what contacts may do is tried. Of more than three contacts a search tries some (`mode_search`),
where combinations are many or where friction cannot make several of them hold. Where no combination is left, or one
with a contact open and one with it closed, the laws have no solution or several. Backwards in time, where contacts
change, a motion may have several pasts.
"""

from __future__ import annotations

from ...methods.status import Status
from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_cases import ADDED, UNDECIDED, ContactCases
from ..contact_system import SLIP, STICK, ContactSystem
from .contact_forces import solve_mode
from .guessed_forces import guess_directions
from .mode_candidates import (
    ALL,
    GRIPPED,
    LIFTING,
    STOP,
    TURN,
    Candidates,
    closed_kind,
    combinations,
    copy_combination,
    list_options,
    next_combination,
)
from .mode_laws import all_forces, contact_margin
from .mode_search import friction_decides, search_modes
from .mode_trials import try_combination

_SUCCESS, _NON_FINITE = int(Status.SUCCESS), int(Status.NON_FINITE)

_IMPOSSIBLE, _AMBIGUOUS = int(Status.CONTACT_IMPOSSIBLE), int(Status.CONTACT_AMBIGUOUS)

_MOST_TRIED = 2**16
"""Most combinations that are all tried where a search has found none that holds."""


@compiled_subset
def _try_all(system: ContactSystem, pick: Candidates, meets: bool) -> None:
    """Try all combinations of the listed options."""
    going = True
    while going:
        try_combination(system, pick, meets)
        going = next_combination(pick)


@compiled_subset
def _status(pick: Candidates) -> int:
    """Return the status that belongs to what has been found."""
    if pick.found.ambiguous != 0:
        return _AMBIGUOUS
    if pick.found.best > 0:
        return _SUCCESS
    return _NON_FINITE if pick.found.lost != 0 else _IMPOSSIBLE


@compiled_subset
def _find(system: ContactSystem, pick: Candidates, expected: bool, meets: bool) -> int:
    """Find the combinations that hold; return a status."""
    list_options(system, pick, expected)
    found = pick.found
    found.best = found.clear = found.lost = found.ambiguous = 0
    several = found.most == ALL or friction_decides(system, pick)
    if several and combinations(pick) <= float(found.most):
        _try_all(system, pick, meets)
    else:
        search_modes(system, pick, expected, meets, several)
    return _status(pick)


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
    sided, status, relaxed = False, _IMPOSSIBLE, True
    pick.found.guided = 0
    for i in range(system.contacts):
        sided = sided or system.sided[i] != 0
    while relaxed:
        if known and sided:
            status = _find(system, pick, True, meets)
            if pick.found.best == 2:
                return status
        status = _find(system, pick, False, meets)
        if status == _IMPOSSIBLE and pick.found.guided == 0 and guess_directions(system, pick):
            status = _find(system, pick, False, meets)
        if status != _IMPOSSIBLE:
            return status
        relaxed = False
        for i in range(system.contacts):
            relaxed = relaxed or pick.fired[i] != 0 or pick.kind[i] == LIFTING or pick.struck[i] != 0
            pick.fired[i] = pick.struck[i] = 0
            if pick.kind[i] == LIFTING:
                pick.kind[i] = closed_kind(system, i, 0.0, 0.0)
    list_options(system, pick, False)
    if combinations(pick) > float(pick.found.most) and combinations(pick) <= float(_MOST_TRIED):
        _try_all(system, pick, meets)
        status = _status(pick)
    return status


_NEARLY = 10.0
"""Multiple of the root of the relative tolerance: a share of all forces within which friction may have held."""


@compiled_subset
def _begins_to_slip(system: ContactSystem, pick: Candidates) -> bool:
    """Return whether a contact along a line begins to slip in the selected mode."""
    begins = False
    for i in range(system.contacts):
        begins = begins or (pick.kind[i] == GRIPPED and pick.best.mode[i] == SLIP and system.width[i] == 1)
    return begins


@compiled_subset
def _may_have_stuck(system: ContactSystem, pick: Candidates, tolerance: float) -> bool:
    """Return whether friction nearly holds contacts along a line that begin to slip in the selected mode.

    Where a contact breaks away, slip begins without acceleration, and the time of that is uncertain by the root of the
    tolerance.
    """
    held, least = False, -_NEARLY * sqrt(tolerance)
    copy_combination(pick.best, pick.now)
    for i in range(system.contacts):
        if pick.kind[i] == GRIPPED and system.width[i] == 1:
            pick.now.mode[i] = STICK
    solve_mode(system, pick.now)
    force = all_forces(system)
    for i in range(system.contacts):
        begins = pick.kind[i] == GRIPPED and pick.best.mode[i] == SLIP and system.width[i] == 1
        held = held or (begins and contact_margin(system, pick, i, force) >= least)
    return held


@compiled_subset
def _past_unknown(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Return whether a contact of a case that goes backwards in time has changed: different pasts lead there.

    Where only a normal reaction turns, the contact slips on. Where slip along a line ends and friction could not have
    held it, it slipped the other way.
    """
    unknown = False
    for i in range(system.contacts):
        fired, former = cases.fired[case, i], cases.modes[case, i]
        slips = pick.best.along[i, 0] * cases.added[case, ADDED * i] < 0.0 or cases.passed[case] == 0.0
        passes = fired == STOP and system.width[i] == 1 and slips
        unknown = unknown or (fired != 0 and fired != TURN and not passes)
        unknown = unknown or (former != UNDECIDED and former != pick.best.mode[i])
    return unknown


@compiled_subset
def select_at(
    system: ContactSystem,
    pick: Candidates,
    cases: ContactCases,
    case: int,
    known: bool,
    meets: bool,
    tolerance: float,
) -> int:
    """Select the next mode, or backwards in time the last one; return a status.

    What rests has rested before, too, if friction holds it. Else it has come to rest just now, against its slip.
    """
    past, again = cases.span[case] < 0.0, cases.passed[case] == 0.0 and cases.number[case] != UNDECIDED
    pick.found.backwards = 1 if past and again else 0
    status = select_mode(system, pick, known, meets)
    if past and not again and status == _SUCCESS and _begins_to_slip(system, pick):
        if _may_have_stuck(system, pick, tolerance):
            return _AMBIGUOUS
        pick.found.backwards = 1
        status = select_mode(system, pick, known, meets)
    if past and status == _SUCCESS and _past_unknown(system, pick, cases, case):
        return _AMBIGUOUS
    return status
