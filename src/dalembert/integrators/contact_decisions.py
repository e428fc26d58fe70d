"""Transitions of contacts: impacts (`contact_impacts`), then the next mode of the motion.

A case comes here when a guard has fired, or when it starts. What is known of its contacts follows from the mode that
ended and from the guards. Where contacts are struck, the impact is solved for first; the case then comes here again
with the numbers of the contacts for its new rates.
"""

from __future__ import annotations

from typing import NamedTuple

from ..methods.status import Status
from ..methods.step_constants import EPSILON
from .arguments import IntVector, Matrix, Vector
from .compiled_subset import compiled_subset, sqrt
from .contact_cases import (
    TURN,
    UNDECIDED,
    ContactCases,
    approaches,
    gap_allowance,
    known_of,
    refused,
    returns,
    sign,
    slip_speed,
    slip_terms,
    strikes,
    touching,
)
from .contact_impacts import hold, moves_in_mode, strike
from .contact_sizes import slow_terms
from .contact_system import compliance, load_accelerations, solve_mode
from .contact_table import (
    OPEN,
    SLIP,
    STICK,
    ContactSpace,
    ContactTable,
    bias,
    mass,
    opening_power,
    slope,
    velocity,
)
from .mode_candidates import FREE, GRIPPED, HOVERING, TOUCHING, Candidates
from .mode_selection import select_mode

__all__ = [
    "LOOP",
    "SOON",
    "SOON_IN_A_ROW",
    "DecisionArguments",
    "decide",
]

SHORT_LOOPS = True
"""Loops over coordinates and contacts have a few rounds: they are not unrolled."""

_REST, _REST_TOLERANCES, _REST_OF_SPAN, _LEAST_REST = 1e-6, 10.0, 1e-7, 1e-8
"""Rest speed in a plane: a share of the slip speeds so far, at least so many relative tolerances of the run; or
a share of what friction and the motion do within the span; and of the least terms of a slip velocity."""

SOON, SOON_IN_A_ROW = 1e-11, 1000
"""Share of the span below which a phase ends too soon, and how often that may happen in a row."""

_ENORMOUS = 1e300
_LOADS = 1024.0 * EPSILON
"""Share of the terms of a gap's acceleration that rounding of positions and forces leaves of one that is zero."""

_SUCCESS, _INITIAL_STATE = int(Status.SUCCESS), int(Status.INITIAL_STATE)
_AMBIGUOUS = int(Status.CONTACT_AMBIGUOUS)


class DecisionArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    table, space, candidates, demand
        The contacts of the scene, and working memory.
    cases : ContactCases
    wanted : (n,)
        The cases to decide; negative numbers are left out.
    values : (n, n_values)
        Outputs of the kernel of the contact data for each of them.
    after_impact : (n,)
        Gets 1 where there was an impact, else 0.
    tolerance : float
        Relative tolerance of the integration.
    """

    table: ContactTable
    space: ContactSpace
    candidates: Candidates
    demand: Vector
    cases: ContactCases
    t: Vector
    values: Matrix
    wanted: IntVector
    after_impact: IntVector
    tolerance: float


@compiled_subset
def _remember(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Record slip speeds so far, with their losses in the last phase, and directions of slip."""
    sliding, planar = 0, False
    for i in range(table.constraint.size):
        planar = planar or table.width[i] > 1
        if cases.modes[case, i] == SLIP:
            sliding += 1
    # where the only slip along a line ends, its guard says so, and no size is needed
    losing = cases.after[case, 0] == UNDECIDED and (sliding > 1 or (planar and sliding > 0))
    if losing:
        load_accelerations(table, space)
        for i in range(table.constraint.size):
            pick.mode[i], pick.sides[i] = cases.modes[case, i], sign(table, cases, case, i)
            pick.along[i, 0], pick.along[i, 1] = cases.directions[case, 2 * i], cases.directions[case, 2 * i + 1]
        solve_mode(table, space, pick.mode, pick.along, pick.sides)
    for i in range(table.constraint.size):
        change = 0.0
        for a in range(table.width[i]):
            change += space.slip[table.first[i] + a] * space.slip[table.first[i] + a]
        lost = sqrt(change) * abs(cases.passed[case]) if losing and cases.modes[case, i] == SLIP else 0.0
        speed = slip_speed(table, space, i)
        largest = max(cases.speeds[case, i], speed)
        cases.speeds[case, i] = max(largest, lost) if lost < _ENORMOUS else largest
        pick.given_sides[i] = sign(table, cases, case, i)
        for a in range(2):
            pick.given_along[i, a] = cases.directions[case, 2 * i + a]
        for a in range(2):
            if speed > 0.0:
                pick.given_along[i, a] = 0.0
                if a < table.width[i]:
                    row = table.constraints + table.first[i] + a
                    pick.given_along[i, a] = velocity(table, space, row) / speed


@compiled_subset
def _rest_speed(arguments: DecisionArguments, case: int, i: int, place: int) -> None:
    """Choose the slip speed in a plane below which a contact counts as at rest."""
    table, space, cases = arguments.table, arguments.space, arguments.cases
    first, change, moved = table.first[i], 0.0, 0.0
    force = 0.0
    for a in range(first, first + 2):
        change = max(change, abs(compliance(table, space, place, a, a)))
        force += abs(space.forces[a, 0])
        moved += abs(space.slip[a])
    speed = max(cases.speeds[case, i], change * force * abs(cases.passed[case]))
    rest = max(_REST, _REST_TOLERANCES * arguments.tolerance) * speed
    if rest == 0.0:
        terms = _REST * slip_terms(table, space, i)
        rest = max(terms, _REST_OF_SPAN * (change * force + moved) * abs(cases.span[case]))
    rest = max(rest, _LEAST_REST * slow_terms(table, space, cases.x, case, table.constraints + first))
    cases.rest[case, i] = rest if arguments.candidates.kind[i] == GRIPPED else -rest


@compiled_subset
def _learn(arguments: DecisionArguments, case: int, begins: bool) -> bool:
    """Find out what is known of each contact; return whether one is struck. It ``begins`` unless after an impact.

    What is struck at the end of a motion was open before: backwards in time it opens.
    """
    table, space, pick, cases = arguments.table, arguments.space, arguments.candidates, arguments.cases
    struck, t = False, arguments.t[case]
    if begins:
        cases.impacts[case] = 0
    for i in range(table.constraint.size):
        pick.struck[i] = 0
        if begins:
            cases.flight[case, i] += abs(cases.passed[case]) if cases.modes[case, i] == OPEN else 0.0
            pick.kind[i] = known_of(table, space, pick, cases, case, i, t)
        else:
            pick.kind[i] = cases.after[case, i]
            pick.broken[i] = pick.turned[i] = pick.slides[i] = pick.parted[i] = 0
        sent_back = not begins and (pick.kind[i] == FREE or pick.kind[i] == HOVERING)
        if sent_back:
            pick.kind[i] = returns(table, space, cases, case, i, t)
        if pick.kind[i] >= TOUCHING and (begins or sent_back):
            pick.struck[i] = 1 if strikes(table, space, cases, case, i, begins) else 0
            if pick.struck[i] == 1 and cases.span[case] < 0.0:
                pick.struck[i], pick.kind[i] = 0, FREE
            struck = struck or pick.struck[i] != 0
    for i in range(table.constraint.size):
        if not begins and not struck and cases.after[case, i] == HOVERING:
            pick.kind[i] = touching(table, space, cases, case, i)
        if pick.kind[i] >= TOUCHING:
            cases.flight[case, i] = 0.0
    return struck


@compiled_subset
def _weigh(arguments: DecisionArguments, case: int) -> None:
    """Find the gap accelerations and normal reactions of closed contacts up to which rounding may make them.

    Both follow from the terms of the gap's acceleration so far. The terms of a body at rest are those of its loads,
    which reactions balance.
    """
    table, space, pick, cases = arguments.table, arguments.space, arguments.candidates, arguments.cases
    for i in range(table.constraint.size):
        pick.still[i] = pick.least[i] = 0.0
        if table.constraint[i] < 0 or pick.kind[i] == FREE:
            continue
        square, ease, power, terms = 0.0, 0.0, opening_power(table, space, i), 0.0
        for j in range(table.coordinates):
            entry, inertia = slope(table, space, table.constraint[i], j), mass(table, space, j, j)
            square += entry * entry
            if inertia > 0.0:
                ease += entry * entry / inertia
                terms += abs(entry * space.load[j]) / inertia
        pick.still[i] = _LOADS * max(cases.loads[case, i], terms)
        if ease > 0.0 and power > 0.0:
            pick.least[i] = _LOADS * cases.loads[case, i] * square / (ease * power)


@compiled_subset
def _joined(arguments: DecisionArguments, case: int, begins: bool) -> tuple[bool, bool, bool]:
    """Return whether signs of reactions are known, a contact that was open touches, and rates may have to be held."""
    pick, cases = arguments.candidates, arguments.cases
    known, meets, closing = begins, False, False
    for i in range(pick.kind.size):
        was, touches = cases.modes[case, i], pick.kind[i] >= TOUCHING
        known = known and was != UNDECIDED
        meets = meets or (touches and was == OPEN)
        closing = closing or pick.kind[i] == TOUCHING
        closing = closing or (touches and (not begins or was == UNDECIDED or was == OPEN))
    return known, meets, closing


@compiled_subset
def _enter(arguments: DecisionArguments, case: int) -> bool:
    """Let a case enter the selected mode; return whether a contact sticks in it."""
    table, space, pick, cases = arguments.table, arguments.space, arguments.candidates, arguments.cases
    sticking, t = False, arguments.t[case]
    for j in range(pick.best_motion.size):
        cases.motion[case, j] = pick.best_motion[j]
    for i in range(pick.kind.size):
        if table.constraint[i] >= 0:
            opens, terms = pick.best_mode[i] == OPEN, abs(bias(table, space, table.constraint[i]))
            cases.sides[case, i] = gap_allowance(table, space, cases, case, i, t) if opens else pick.least[i]
            for j in range(table.coordinates):
                terms += abs(slope(table, space, table.constraint[i], j) * pick.best_motion[j])
            if terms < _ENORMOUS:
                cases.loads[case, i] = max(cases.loads[case, i], terms)
        else:
            cases.sides[case, i] = pick.best_sides[i]
        cases.after[case, i], cases.modes[case, i] = UNDECIDED, pick.best_mode[i]
        cases.directions[case, 2 * i], cases.directions[case, 2 * i + 1] = pick.best_along[i, 0], pick.best_along[i, 1]
        sticking = sticking or pick.best_mode[i] == STICK
    return sticking


@compiled_subset
def _stopped(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Find contacts that touch, approach too slowly to be struck, and are to open; return whether there are any.

    Nothing but an impact without restitution keeps them from going on.
    """
    stopped = False
    for i in range(table.constraint.size):
        if pick.kind[i] >= TOUCHING and pick.best_mode[i] == OPEN:
            if approaches(table, space, cases, case, i):
                pick.struck[i], stopped = 2, True
    return stopped


@compiled_subset
def _choose_rest_speeds(arguments: DecisionArguments, case: int) -> None:
    """Choose the rest speeds of contacts that slip in a plane."""
    table, space, pick = arguments.table, arguments.space, arguments.candidates
    planar = False
    for i in range(pick.kind.size):
        planar = planar or (pick.best_mode[i] == SLIP and table.width[i] > 1)
    if planar:
        place = solve_mode(table, space, pick.best_mode, pick.best_along, pick.best_sides)
        for i in range(pick.kind.size):
            if pick.best_mode[i] == SLIP and table.width[i] > 1:
                _rest_speed(arguments, case, i, place)


@compiled_subset
def _past_unknown(pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Return whether a contact of a case that goes backwards in time has changed: different pasts lead there.

    Where only a normal reaction turns, the contact slips on.
    """
    unknown = False
    if cases.span[case] < 0.0:
        for i in range(pick.kind.size):
            fired, former = cases.fired[case, i], cases.modes[case, i]
            unknown = unknown or (fired != 0 and fired != TURN)
            unknown = unknown or (former != UNDECIDED and former != pick.best_mode[i])
    return unknown


@compiled_subset
def decide(arguments: DecisionArguments, case: int) -> bool:
    """Select the next mode of a case, whose numbers are in ``space``; return whether there was an impact.

    After an impact the numbers are to be computed for the new rates, and the case comes here again. A case that goes
    backwards in time ends where contacts change.
    """
    table, space, pick, cases = arguments.table, arguments.space, arguments.candidates, arguments.cases
    for j in range(table.coordinates):
        space.rates[j] = cases.x[case, table.coordinates + j]
    if refused(table, space, cases, case):
        cases.status[case] = _INITIAL_STATE
        return False
    _remember(table, space, pick, cases, case)
    begins = cases.after[case, 0] == UNDECIDED
    if _learn(arguments, case, begins):
        cases.status[case] = strike(table, space, pick, cases, arguments.demand, case)
        return cases.status[case] == _SUCCESS
    known, meets, closing = _joined(arguments, case, begins)
    load_accelerations(table, space)
    _weigh(arguments, case)
    cases.status[case] = select_mode(table, space, pick, known, meets)
    if cases.status[case] == _SUCCESS and _past_unknown(pick, cases, case):
        cases.status[case] = _AMBIGUOUS
    if cases.status[case] != _SUCCESS:
        return False
    if cases.span[case] >= 0.0 and _stopped(table, space, pick, cases, case):
        cases.status[case] = strike(table, space, pick, cases, arguments.demand, case)
        return cases.status[case] == _SUCCESS
    sticking = _enter(arguments, case)
    _choose_rest_speeds(arguments, case)
    if (closing or sticking) and moves_in_mode(table, space, pick, cases, case):
        hold(table, space, pick, cases, arguments.demand, case)
    return False


@compiled_subset
def LOOP(arguments: DecisionArguments) -> None:
    """Select the next modes of the marked cases, by their numbers in ``values``."""
    for place in range(arguments.wanted.size):
        case = arguments.wanted[place]
        if case < 0:
            continue
        for v in range(arguments.space.values.size):
            arguments.space.values[v] = arguments.values[place, v]
        arguments.after_impact[place] = 1 if decide(arguments, case) else 0
