"""Mode selection forwards and backwards in time: backwards, where contacts change, a motion may have several pasts."""

from __future__ import annotations

from ...methods.status import Status
from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_cases import ADDED, UNDECIDED, ContactCases
from ..contact_system import SLIP, STICK, ContactSystem
from .contact_forces import solve_mode
from .mode_candidates import GRIPPED, STOP, TURN, Candidates, copy_combination
from .mode_laws import all_forces, contact_margin
from .mode_selection import select_mode

_NEARLY = 10.0
"""Multiple of the root of the relative tolerance: a share of all forces within which friction may have held."""

_SUCCESS, _AMBIGUOUS = int(Status.SUCCESS), int(Status.CONTACT_AMBIGUOUS)


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
