"""Transitions of contacts: impacts (`contact_impacts`), then the next mode of the motion.

A case comes here when a guard has fired, or when it starts. What is known of its contacts follows from the mode that
ended and from the guards. Where contacts are struck, the impact is solved for first; the case then comes here again
with the numbers of the contacts for its new rates.
"""

from __future__ import annotations

from typing import NamedTuple

from ..methods.status import Status
from ..methods.step_constants import EPSILON
from ..subset.arguments import IntVector, Matrix
from ..subset.compiled_subset import compiled_subset, sqrt
from .contact_cases import ADDED, SIDE, UNDECIDED, ContactCases, set_mode, slip_speed
from .contact_impacts import close_gaps, hold, moves_in_mode, strike
from .contact_kinds import (
    approaches,
    arrives,
    gap_allowance,
    kind_at_end,
    meets_at_end,
    refused,
    sign,
    strikes,
    touching,
)
from .contact_system import OPEN, SLIP, STICK, ContactSystem, dot, inertial_terms, opening_power, terms
from .equations.dependent_slips import point_across
from .selection.contact_forces import load_accelerations, solve_mode
from .selection.mode_candidates import FREE, GRIPPED, HOVERING, TOUCHING, Candidates
from .selection.mode_selection import select_at
from .slip_begins import began_to_slip, forget_early_breaks, way_of_slip
from .slow_slip import begins_anew, choose_rest_speeds, jam, slides_slowly, take_as_rest

_ENORMOUS = 1e300
_LOADS = 1024.0 * EPSILON
"""Share of the terms of a gap's acceleration that rounding of positions and forces leaves of one that is zero."""

_TURNS = 1e-10
"""Share of the largest normal reaction so far up to which one that may have either sign counts as zero: what it changes
by within the least time that is resolved. A small force along the contact may exceed friction for as long."""

_SUCCESS, _INITIAL_STATE = int(Status.SUCCESS), int(Status.INITIAL_STATE)
_IMPOSSIBLE = int(Status.CONTACT_IMPOSSIBLE)
_NON_FINITE = int(Status.NON_FINITE)


class DecisionArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    system, candidates
        The contacts of the scene, and working memory.
    cases : ContactCases
    deciding : (n,)
        The cases to decide; negative numbers are left out.
    values : (n, n_values)
        Outputs of the kernel of the contact data for each of them.
    ending : (n,)
        Not 0 for cases that have come to their ends: these are left out, and get -1 in ``deciding``, unless a contact
        meets there.
    after_impact : (n,)
        Gets 1 where there was an impact, else 0.
    rtol, atol : float
        Relative and absolute tolerance of the integration.
    """

    system: ContactSystem
    candidates: Candidates
    cases: ContactCases
    values: Matrix
    deciding: IntVector
    ending: IntVector
    after_impact: IntVector
    rtol: float
    atol: float


@compiled_subset
def _remember(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Record what the last phase leaves: states, signs, directions, and slip speeds so far with their losses."""
    sliding, sized, given = 0, False, pick.given
    for i in range(system.contacts):
        sized = sized or system.width[i] > 1 or system.jumping[i] == 1
        sliding += 1 if cases.modes[case, i] == SLIP else 0
        given.mode[i], given.sides[i] = cases.modes[case, i], sign(system, cases, case, i)
        given.along[i, 0], given.along[i, 1] = cases.added[case, ADDED * i], cases.added[case, ADDED * i + 1]
    # where the only slip along a line ends, its guard says so, and no size is needed
    losing = cases.after[case, 0] == UNDECIDED and (sliding > 1 or (sized and sliding > 0))
    if losing:
        load_accelerations(system)
        solve_mode(system, given)
    for i in range(system.contacts):
        change, speed = 0.0, slip_speed(system, i)
        for r in range(system.first[i], system.first[i] + system.width[i]):
            change += system.slip[r] * system.slip[r]
        lost = sqrt(change) * abs(cases.passed[case]) if losing and given.mode[i] == SLIP else 0.0
        largest = max(cases.speeds[case, i], speed)
        cases.speeds[case, i] = max(largest, lost) if lost < _ENORMOUS else largest
        if speed > 0.0:
            given.along[i, 1] = 0.0
            for a in range(system.width[i]):
                given.along[i, a] = system.velocity[system.row[i] + a] / speed


@compiled_subset
def _learn(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int, begins: bool) -> bool:
    """Find out what is known of each contact; return whether one is struck. It ``begins`` unless after an impact.

    What is struck at the end of a motion was open before: backwards in time it opens. A contact that an impact has left
    open may be sent back by others at once, and be struck again.
    """
    struck = False
    for i in range(system.contacts):
        pick.struck[i] = pick.slides[i] = 0
        pick.fired[i] = cases.fired[case, i] if begins else 0
        pick.kind[i], closes = cases.after[case, i], begins
        if begins:
            cases.flight[case, i] += abs(cases.passed[case]) if cases.modes[case, i] == OPEN else 0.0
            pick.kind[i] = kind_at_end(system, cases, case, i)
            if pick.kind[i] == GRIPPED and system.width[i] == 1:
                pick.given.along[i, 0] = cases.added[case, ADDED * i]
            if pick.kind[i] == GRIPPED and began_to_slip(system, cases, case, i):
                pick.fired[i] = way_of_slip(system, cases, case, i)
        elif pick.kind[i] == FREE or pick.kind[i] == HOVERING:
            closes = arrives(system, cases, case, i)
            pick.kind[i] = touching(system, cases, case, i) if closes else FREE
        if closes and pick.kind[i] >= TOUCHING and strikes(system, cases, case, i, begins):
            if cases.span[case] < 0.0:
                pick.kind[i] = FREE
            else:
                pick.struck[i], struck = 1, True
    for i in range(system.contacts):
        if not struck and cases.after[case, i] == HOVERING:
            pick.kind[i] = touching(system, cases, case, i)
        if system.leader[i] != i:
            apart = pick.kind[system.leader[i]] == FREE
            pick.kind[i] = FREE if apart else touching(system, cases, case, i) if pick.kind[i] == FREE else pick.kind[i]
        if pick.kind[i] >= TOUCHING:
            cases.flight[case, i] = 0.0
    return struck


@compiled_subset
def _transmit(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Let a closed contact hold what rounding makes of the reactions of others; return whether that is much more."""
    if system.constraint[i] < 0 or pick.kind[i] == FREE:
        return False
    slopes, found = system.jacobian[system.constraint[i]], pick.least[i]
    ease = inertial_terms(system, slopes, system.power[system.normal[i]])
    for j in range(system.contacts):
        if pick.least[j] > 0.0 and ease > 0.0:
            found = max(found, inertial_terms(system, slopes, system.power[system.normal[j]]) / ease * pick.least[j])
    more = found > 2.0 * pick.least[i]
    pick.least[i] = found if more else pick.least[i]
    return more


@compiled_subset
def _weigh(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Find the gap accelerations and normal reactions of closed contacts up to which rounding may make them.

    Both follow from the terms of the gap's acceleration so far, or where there is no gap from the reaction so far. The
    terms of a body at rest are those of its loads, which reactions balance. A contact bears what rounding makes of the
    reactions of others that move the same.
    """
    for i in range(system.contacts):
        pick.still[i] = pick.least[i] = 0.0
        if system.constraint[i] >= 0 and pick.kind[i] != FREE:
            slopes, power, loads = system.jacobian[system.constraint[i]], opening_power(system, i), cases.loads[case, i]
            ease = inertial_terms(system, slopes, slopes)
            pick.still[i] = _LOADS * max(loads, inertial_terms(system, slopes, system.load))
            if ease > 0.0 and power > 0.0:
                pick.least[i] = _LOADS * loads * dot(slopes, slopes, 0.0) / (ease * power)
        elif system.leader[i] == i and system.sided[i] != 0:
            pick.least[i] = _TURNS * cases.loads[case, i]
    spreads = True
    while spreads:
        spreads = False
        for i in range(system.contacts):
            spreads = _transmit(system, pick, i) or spreads
    for i in range(system.contacts):
        if system.leader[i] != i and system.weight[i] > 0.0:
            pick.least[i] = pick.least[system.leader[i]] / system.weight[i]


@compiled_subset
def _what_is_known(pick: Candidates, cases: ContactCases, case: int, begins: bool) -> tuple[bool, bool, bool]:
    """Return whether signs of reactions are known, a contact that was open touches, and rates may have to be held."""
    known, meets, closing = begins, False, False
    for i in range(pick.kind.size):
        was, touches = cases.modes[case, i], pick.kind[i] >= TOUCHING
        known = known and was != UNDECIDED
        meets = meets or (touches and was == OPEN)
        closing = closing or pick.kind[i] == TOUCHING
        closing = closing or (touches and (not begins or was == UNDECIDED or was == OPEN))
    return known, meets, closing


@compiled_subset
def _overflows(pick: Candidates) -> bool:
    """Return whether accelerations are so large that steps with them overflow."""
    largest = 0.0
    for j in range(pick.best.motion.size):
        largest = max(largest, abs(pick.best.motion[j]))
    return largest >= _ENORMOUS


@compiled_subset
def _stopped(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Find contacts that touch and approach too slowly to be struck, but must be; return whether there are any.

    Where one is to open, nothing but an impact without restitution keeps it from going on. Where it stops slow slip of
    another, that is at rest after the impact.
    """
    stopped, slow = False, False
    for i in range(system.contacts):
        slow = slow or slides_slowly(system, pick, cases, case, i)
    for i in range(system.contacts):
        touches = pick.kind[i] >= TOUCHING and system.leader[i] == i
        meets = slow and cases.modes[case, i] == OPEN
        if touches and (meets or pick.best.mode[i] == OPEN) and approaches(system, cases, case, i):
            pick.struck[i], stopped = 2, True
    return stopped


@compiled_subset
def _enter(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int, rtol: float, atol: float) -> bool:
    """Let a case enter the selected mode; return whether a contact sticks in it."""
    sticking, best, added = False, pick.best, cases.added
    point_across(system, best)
    for j in range(system.coordinates):
        cases.motion[case, j] = best.motion[j]
    for i in range(system.contacts):
        row = system.constraint[i]
        if row < 0:
            added[case, ADDED * i + SIDE] = best.sides[i] if system.leader[i] == i else pick.least[i]
            cases.loads[case, i] = max(cases.loads[case, i], abs(best.press[i]))
        else:
            slopes, bias, least = system.jacobian[row], system.bias[row], pick.least[i]
            size = terms(slopes, best.motion, abs(bias))
            if best.mode[i] == OPEN:
                moved = max(size, inertial_terms(system, slopes, system.load))  # slip begins where loads balance
                rise = float(system.sense[i]) * dot(slopes, best.motion, -bias)
                # it was open and does not fall, or others hold it, as a leg of a table that has ceased to bear
                rests = system.soft[i] != 0 and rise <= _LOADS * moved
                stays = not rise < -_LOADS * moved and (cases.modes[case, i] == OPEN or rests)
                least = gap_allowance(system, cases, case, i, stays, rtol, atol)
            added[case, ADDED * i + SIDE] = least
            if size < _ENORMOUS:
                cases.loads[case, i] = max(cases.loads[case, i], size)
        cases.fired[case, i], cases.after[case, i] = 0, UNDECIDED
        added[case, ADDED * i], added[case, ADDED * i + 1] = best.along[i, 0], best.along[i, 1]
        sticking = sticking or best.mode[i] == STICK
    set_mode(cases, case, best.mode)
    return sticking


@compiled_subset
def decide(arguments: DecisionArguments, case: int) -> bool:
    """Select the next mode of a case, whose numbers are in ``system``; return whether there was an impact.

    After an impact the numbers are to be computed for the new rates, and the case comes here again. A case that goes
    backwards in time ends where contacts change.
    """
    system, pick, cases = arguments.system, arguments.candidates, arguments.cases
    for j in range(system.coordinates):
        system.rates[j] = cases.x[case, system.coordinates + j]
    if refused(system, cases, case):
        cases.status[case] = _INITIAL_STATE
        return False
    _remember(system, pick, cases, case)
    begins = cases.after[case, 0] == UNDECIDED
    if begins:
        cases.impacts[case] = 0
    if _learn(system, pick, cases, case, begins):
        cases.status[case] = strike(system, pick, cases, case)
        return cases.status[case] == _SUCCESS
    known, meets, closing = _what_is_known(pick, cases, case, begins)
    load_accelerations(system)
    if begins:
        forget_early_breaks(system, pick, cases, case)
    _weigh(system, pick, cases, case)
    if cases.status[case] != _IMPOSSIBLE:  # else the last mode has lost its reactions
        cases.status[case] = select_at(system, pick, cases, case, known, meets, arguments.rtol)
    slow = cases.status[case] == _IMPOSSIBLE and take_as_rest(system, pick, cases, case, arguments.rtol)
    if slow:
        cases.status[case] = select_at(system, pick, cases, case, known, meets, arguments.rtol)
    if cases.status[case] == _IMPOSSIBLE:
        cases.status[case] = jam(system, pick, cases, case)
        return cases.status[case] == _SUCCESS
    if cases.status[case] == _SUCCESS and _overflows(pick):
        cases.status[case] = _NON_FINITE
    if cases.status[case] != _SUCCESS:
        return False
    if cases.span[case] >= 0.0 and _stopped(system, pick, cases, case):
        cases.status[case] = strike(system, pick, cases, case)
        return cases.status[case] == _SUCCESS
    anew = slow or begins_anew(system, pick, cases, case)
    sticking = _enter(system, pick, cases, case, arguments.rtol, arguments.atol)
    choose_rest_speeds(system, pick, cases, case, arguments.rtol)
    if anew or ((closing or sticking) and moves_in_mode(system, pick, cases, case)):
        hold(system, pick, cases, case)
    if pick.given.mode[0] != UNDECIDED:
        close_gaps(system, pick, cases, case)
    return False


@compiled_subset
def LOOP(arguments: DecisionArguments) -> None:
    """Select the next modes of the marked cases, by their numbers in ``values``."""
    system = arguments.system
    for place in range(arguments.deciding.size):
        case = arguments.deciding[place]
        if case < 0:
            continue
        for v in range(system.values.size):
            system.values[v] = arguments.values[place, v]
        ends = arguments.ending[place] != 0
        if ends and not meets_at_end(system, arguments.cases, case, arguments.rtol, arguments.atol):
            arguments.deciding[place] = -1
            continue
        arguments.after_impact[place] = 1 if decide(arguments, case) else 0
