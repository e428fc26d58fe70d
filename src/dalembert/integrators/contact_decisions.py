"""Transitions of contacts: impacts, then the mode in which the motion goes on.

A case comes here when a guard has fired, or when it starts. What is known of its contacts follows from the mode that
ended and from the guards. Where contacts are struck, the impact is solved for first; the case then comes here again
with the numbers of the contacts for its new rates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..methods.status import Status
from .arguments import IntMatrix, IntVector, Matrix, Vector
from .compiled_subset import compiled_subset, sqrt
from .contact_system import (
    CLOSED,
    GAP,
    MU,
    MU_STATIC,
    OPEN,
    RESTITUTION,
    SLIP,
    STICK,
    ContactSpace,
    ContactTable,
    drift,
    load_accelerations,
    load_impact,
    mass,
    number,
    opening_power,
    slope,
    solve_mode,
    velocity,
)
from .mode_selection import FREE, GRIPPED, LIFTING, SLIDING, TOUCHING, Candidates, select_mode

__all__ = [
    "BREAK_DOWN",
    "BREAK_PLANE",
    "BREAK_UP",
    "LIFT",
    "LOOP",
    "MEET",
    "NOISE",
    "SOON",
    "SOON_IN_A_ROW",
    "STOP",
    "TURN",
    "UNDECIDED",
    "ContactCases",
    "DecisionArguments",
    "contact_cases",
    "decide",
]

LIFT, TURN, MEET, STOP, BREAK_UP, BREAK_DOWN, BREAK_PLANE = 1, 2, 4, 8, 16, 32, 64
"""Guards of a contact that have fired, as bits: the normal reaction vanishes; it changes its sign; the gap closes; slip
ends; friction fails to hold against slip forwards, backwards, or in a plane."""

SHORT_LOOPS = True
"""Loops over coordinates and contacts have a few rounds: they are not unrolled."""

NOISE = 1e-8
"""Share of a velocity, or of a position, below which it counts as zero."""

UNDECIDED = -1
"""Mode of a contact before the first decision, and `ContactCases.after` without an impact."""

_LENGTH = 1.0001
"""What gaps are compared with beside their own size."""

_STILL = 1e-12
"""Share of the rate that a gap could have with the kinetic energy there is, up to which it has none."""

_RESTING = 1e-7
"""Share of the largest approach speed of a contact so far, below which an impact is none: the contact stays closed.

So infinitely many impacts within a finite time end."""

_SLOW, _EXCURSION = 1e-4, 64.0 * 2.220446049250313e-16
"""The same for an impact after a gap opened no further than rounding: a share of the largest approach speed so far,
and of the terms of the gap."""

_ROUNDED = 1e-14
"""Share of the largest speed so far that rounding leaves of one that is zero."""

_STOPPED = 2.0
"""Slip speed in a plane, as a multiple of the rest speed, below which a contact has stopped when its guard fires."""

_REST, _REST_TOLERANCES, _REST_OF_SPAN, _LEAST_REST = 1e-6, 10.0, 1e-7, 1e-12
"""Rest speed in a plane: a share of the slip speeds so far, at least so many relative tolerances of the run; or
a share of what friction and the motion do within the span; and the least one [m/s]."""

SOON, SOON_IN_A_ROW = 1e-11, 1000
"""Share of the span below which a phase ends too soon, and how often that may happen in a row."""

_SUCCESS, _INITIAL_STATE = int(Status.SUCCESS), int(Status.INITIAL_STATE)


class ContactCases(NamedTuple):
    """Cases at an instant; of k cases with c contacts each.

    Attributes
    ----------
    x : (k, 2 n_q)
        Coordinates and rates; the rates change.
    directions, sides : (k, 2 c), (k, c)
        Directions of slip; signs of normal reactions, or of contacts that open 1 where they are determined and 0 where
        contacts that stick share a load in several ways.
    speeds, approach : (k, c)
        Largest slip speed, and largest speed at which the gap closed, so far.
    rest : (k, c)
        Slip speed in a plane below which a contact counts as at rest; negative in phases that do not begin at rest.
    flight : (k, c)
        How long each contact has been open [s].
    span, passed : (k,)
        Duration of the whole motion, and of the last phase [s].
    modes, fired : (k, c)
        What each contact does, `UNDECIDED` before the start; guards that have fired, as bits.
    after : (k, c)
        What is known of each contact after an impact, else `UNDECIDED`.
    status : (k,)
        SUCCESS where a mode was selected.
    motion : (k, n_q)
        Accelerations in the mode.
    """

    x: Matrix
    directions: Matrix
    sides: Matrix
    speeds: Matrix
    approach: Matrix
    rest: Matrix
    flight: Matrix
    span: Vector
    passed: Vector
    modes: IntMatrix
    fired: IntMatrix
    after: IntMatrix
    status: IntVector
    motion: Matrix


def contact_cases(x: NDArray[np.float64], span: NDArray[np.float64], contacts: int) -> ContactCases:
    """Return cases that start from states x (k, 2 n_q), which change, with signed spans (k,)."""
    k, n = len(x), x.shape[1] // 2
    directions = np.tile(np.array([1.0, 0.0]), (k, contacts))
    undecided = np.full((2, k, contacts), UNDECIDED)
    return ContactCases(
        x=x,
        directions=directions,
        sides=np.ones((k, contacts)),
        speeds=np.zeros((k, contacts)),
        approach=np.zeros((k, contacts)),
        rest=np.ones((k, contacts)),
        flight=np.zeros((k, contacts)),
        span=span,
        passed=np.zeros(k),
        modes=undecided[0],
        fired=np.zeros((k, contacts), np.int64),
        after=undecided[1],
        status=np.zeros(k, np.int64),
        motion=np.zeros((k, n)),
    )


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
    values: Matrix
    wanted: IntVector
    after_impact: IntVector
    tolerance: float


# -- what is known of a contact ----------------------------------------------------------------


@compiled_subset
def _slip_speed(table: ContactTable, space: ContactSpace, i: int) -> float:
    total = 0.0
    for a in range(table.width[i]):
        slip = velocity(table, space, table.constraints + table.first[i] + a)
        total += slip * slip
    return sqrt(total)


@compiled_subset
def _slip_terms(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the sum of the sizes of the terms of a slip velocity, the larger of two."""
    largest = 0.0
    for a in range(table.width[i]):
        row = table.constraints + table.first[i] + a
        total = abs(drift(table, space, row))
        for j in range(table.coordinates):
            total += abs(slope(table, space, row, j) * space.rates[j])
        largest = max(largest, total)
    return largest


@compiled_subset
def _gap_rate(table: ContactTable, space: ContactSpace, i: int) -> float:
    return float(table.sense[i]) * velocity(table, space, table.constraint[i])


@compiled_subset
def _rate_noise(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the size below which the rate of a gap counts as zero."""
    row, terms, energy, ease = table.constraint[i], 0.0, 0.0, 0.0
    for j in range(table.coordinates):
        entry, inertia = slope(table, space, row, j), mass(table, space, j, j)
        terms += abs(entry * space.rates[j])
        if inertia > 0.0:
            ease += entry * entry / inertia
        for m in range(table.coordinates):
            energy += space.rates[j] * mass(table, space, j, m) * space.rates[m]
    return NOISE * terms + _STILL * sqrt(max(energy * ease, 0.0))


@compiled_subset
def _gap_noise(table: ContactTable, space: ContactSpace, i: int) -> float:
    return NOISE * (abs(number(table, space, i, GAP)) + _LENGTH)


@compiled_subset
def _laws_of_sliding(table: ContactTable, i: int) -> bool:
    return table.width[i] > 0 and table.smooth[i] == 0


@compiled_subset
def _closed(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact if it is closed."""
    if not _laws_of_sliding(table, i):
        return TOUCHING
    fired, before, scale = cases.fired[case, i], cases.modes[case, i], cases.speeds[case, i]
    if fired >= BREAK_UP:
        # where the normal reaction vanishes, so does the friction that it allows: nothing is known of the direction
        alone = fired == BREAK_UP or fired == BREAK_DOWN or fired == BREAK_PLANE
        if alone:
            pick.broken[i] = 2 if fired == BREAK_PLANE else 1 if fired == BREAK_UP else -1
        return GRIPPED
    if before == STICK or (fired & STOP != 0 and table.width[i] == 1):
        return GRIPPED
    speed, limit = _slip_speed(table, space, i), NOISE * scale
    if before == UNDECIDED:
        limit = NOISE * max(scale, _slip_terms(table, space, i))
    if fired & STOP != 0:
        limit = max(limit, _STOPPED * abs(cases.rest[case, i]))
    return GRIPPED if speed <= limit else SLIDING


@compiled_subset
def _unresolved(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether a contact that was open has opened no further than rounding, and hardly moves."""
    speed, terms = abs(_gap_rate(table, space, i)), 0.0
    for j in range(table.coordinates):
        terms += abs(slope(table, space, table.constraint[i], j) * cases.x[case, j])
    slow = speed <= _SLOW * cases.approach[case, i]
    return slow and speed * cases.flight[case, i] <= _EXCURSION * terms


@compiled_subset
def _opening(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact; ``turned`` and ``broken`` are written, and ``struck`` is in the sign."""
    fired, before = cases.fired[case, i], cases.modes[case, i]
    pick.broken[i] = pick.slides[i] = 0
    pick.turned[i] = 1 if fired & TURN != 0 else 0
    if table.constraint[i] < 0 or not (before == UNDECIDED or before == OPEN):
        return LIFTING if fired & LIFT != 0 else _closed(table, space, pick, cases, case, i)
    if before == OPEN and fired & MEET == 0:
        return FREE
    rate, noise = _gap_rate(table, space, i), _rate_noise(table, space, i)
    far = before == UNDECIDED and number(table, space, i, GAP) > _gap_noise(table, space, i)
    if far or (rate > noise and (before == UNDECIDED or not _unresolved(table, space, cases, case, i))):
        return FREE
    return _closed(table, space, pick, cases, case, i)


@compiled_subset
def _strikes(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether a contact that touches, and was open, is struck; its approach speed is remembered."""
    before = cases.modes[case, i]
    if table.constraint[i] < 0 or not (before == UNDECIDED or before == OPEN):
        return False
    speed = -_gap_rate(table, space, i)
    largest = max(cases.approach[case, i], speed)
    cases.approach[case, i] = largest
    if before == OPEN and _unresolved(table, space, cases, case, i):
        return False
    return speed > max(_rate_noise(table, space, i), _RESTING * largest)


@compiled_subset
def _refused(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int) -> bool:
    """Return whether a case cannot start, or its coefficients make no sense."""
    bad = False
    for i in range(table.constraint.size):
        mu, static = number(table, space, i, MU), number(table, space, i, MU_STATIC)
        restitution = number(table, space, i, RESTITUTION)
        bad = bad or mu < 0.0 or static < mu or restitution < 0.0 or restitution > 1.0
        if table.constraint[i] >= 0 and cases.modes[case, i] == UNDECIDED:
            bad = bad or number(table, space, i, GAP) < -_gap_noise(table, space, i)
            bad = bad or not opening_power(table, space, i) > 0.0
    return bad


@compiled_subset
def _sign(table: ContactTable, cases: ContactCases, case: int, i: int) -> float:
    """Return the sign of the normal reaction of a contact, 1 where it has only one."""
    return cases.sides[case, i] if table.sided[i] != 0 else 1.0


@compiled_subset
def _determined(table: ContactTable, space: ContactSpace, place: int, i: int) -> float:
    """Return 1 where the equations of motion determine the normal reaction of a contact, in the solution at hand."""
    n, width = table.coordinates, 1 + table.slips
    for a in range(space.undetermined[0]):
        change, size = 0.0, 0.0
        for r in range(table.slips):
            term = space.responses[place, (n + i) * width + 1 + r] * space.free[a, r]
            change += term
            size = max(size, abs(term), abs(space.free[a, r]))
        if abs(change) > NOISE * size:
            return 0.0
    return 1.0


@compiled_subset
def _remember(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Take down slip speeds so far, with what they have lost in the last phase, and directions of slip."""
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
            pick.mode[i], pick.sides[i] = cases.modes[case, i], _sign(table, cases, case, i)
            pick.along[i, 0], pick.along[i, 1] = cases.directions[case, 2 * i], cases.directions[case, 2 * i + 1]
        solve_mode(table, space, pick.mode, pick.along, pick.sides, False)
    for i in range(table.constraint.size):
        change = 0.0
        for a in range(table.width[i]):
            change += space.slip[table.first[i] + a] * space.slip[table.first[i] + a]
        lost = sqrt(change) * abs(cases.passed[case]) if losing and cases.modes[case, i] == SLIP else 0.0
        speed = _slip_speed(table, space, i)
        largest = max(cases.speeds[case, i], speed)
        cases.speeds[case, i] = max(largest, lost) if lost < 1e300 else largest
        pick.given_sides[i] = _sign(table, cases, case, i)
        for a in range(2):
            pick.given_along[i, a] = cases.directions[case, 2 * i + a]
        for a in range(2):
            if speed > 0.0:
                pick.given_along[i, a] = 0.0
                if a < table.width[i]:
                    row = table.constraints + table.first[i] + a
                    pick.given_along[i, a] = velocity(table, space, row) / speed


# -- impacts -----------------------------------------------------------------------------------


@compiled_subset
def _impact(arguments: DecisionArguments, case: int) -> int:
    """Solve for the rates after an impact and take them; return a status."""
    table, space, pick = arguments.table, arguments.space, arguments.candidates
    cases, demand = arguments.cases, arguments.demand
    for row in range(table.constraints):
        demand[row] = 0.0
    for i in range(table.constraint.size):
        if pick.struck[i] != 0:
            row = table.constraint[i]
            demand[row] = -number(table, space, i, RESTITUTION) * velocity(table, space, row)
        if pick.kind[i] == SLIDING:
            pick.kind[i], pick.slides[i] = GRIPPED, 1
        pick.broken[i] = pick.turned[i] = 0
    load_impact(table, space, demand)
    status = select_mode(table, space, pick, False, False)
    if status != _SUCCESS:
        return status
    n = table.coordinates
    for i in range(table.constraint.size):
        cases.after[case, i] = _kind_after(table, space, pick, cases, case, i)
    for j in range(n):
        cases.x[case, n + j] = pick.best_motion[j]
    for i in range(table.constraint.size):
        cases.directions[case, 2 * i], cases.directions[case, 2 * i + 1] = pick.best_along[i, 0], pick.best_along[i, 1]
        cases.sides[case, i] = pick.best_sides[i]
    return status


@compiled_subset
def _kind_after(
    table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int, i: int
) -> int:
    """Return what is known of a contact after an impact."""
    if pick.kind[i] == FREE:
        return FREE
    if table.constraint[i] >= 0:
        row = table.constraint[i]
        rate, terms = drift(table, space, row), 0.0
        for j in range(table.coordinates):
            rate += slope(table, space, row, j) * pick.best_motion[j]
            terms += abs(slope(table, space, row, j) * pick.best_motion[j])
        rate *= float(table.sense[i])
        least = max(_rate_noise(table, space, i), NOISE * terms)
        if rate > max(least, _RESTING * cases.approach[case, i]):
            return FREE
    if not _laws_of_sliding(table, i):
        return TOUCHING
    if pick.best_mode[i] == STICK:
        return GRIPPED
    total = 0.0
    for a in range(table.width[i]):
        row = table.constraints + table.first[i] + a
        slip = drift(table, space, row)
        for j in range(table.coordinates):
            slip += slope(table, space, row, j) * pick.best_motion[j]
        total += slip * slip
    return GRIPPED if sqrt(total) <= NOISE * cases.speeds[case, i] else SLIDING


# -- decisions ---------------------------------------------------------------------------------


@compiled_subset
def _moves(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Return whether a contact that is closed, or sticks, in the selected mode moves more than rounding makes of it."""
    moves = False
    for i in range(table.constraint.size):
        if pick.best_mode[i] == STICK:
            moves = moves or not _slip_speed(table, space, i) <= _ROUNDED * cases.speeds[case, i]
        if pick.best_mode[i] != OPEN and table.constraint[i] >= 0:
            moves = moves or not abs(_gap_rate(table, space, i)) <= _ROUNDED * cases.approach[case, i]
    return moves


@compiled_subset
def _hold(arguments: DecisionArguments, case: int) -> None:
    """Give a case the rates nearest to the present ones, by kinetic energy, that its mode allows."""
    table, space, pick = arguments.table, arguments.space, arguments.candidates
    n, cases = table.coordinates, arguments.cases
    for row in range(table.constraints):
        arguments.demand[row] = 0.0
    load_impact(table, space, arguments.demand)
    for i in range(table.constraint.size):
        state = pick.best_mode[i]
        pick.mode[i] = state if state == OPEN or state == STICK else CLOSED
    solve_mode(table, space, pick.mode, pick.best_along, pick.best_sides, False)
    for j in range(n):
        cases.x[case, n + j] = space.motion[j]


@compiled_subset
def _rest_speed(arguments: DecisionArguments, case: int, i: int, place: int) -> None:
    """Choose the slip speed in a plane below which a contact counts as at rest."""
    table, space, cases = arguments.table, arguments.space, arguments.cases
    first, change, moved = table.first[i], 0.0, 0.0
    for a in range(first, first + 2):
        n, k = table.coordinates, table.normal.size
        change = max(change, abs(space.responses[place, (n + 2 * k + a) * (1 + table.slips) + 1 + a]))
    force = 0.0
    for a in range(first, first + 2):
        force += abs(space.forces[a, 0])
        moved += abs(space.slip[a])
    speed = max(cases.speeds[case, i], change * force * abs(cases.passed[case]))
    rest = max(_REST, _REST_TOLERANCES * arguments.tolerance) * speed
    if rest == 0.0:
        terms = _REST * _slip_terms(table, space, i)
        rest = max(terms, _REST_OF_SPAN * (change * force + moved) * abs(cases.span[case]))
    rest = max(rest, _LEAST_REST)
    cases.rest[case, i] = rest if arguments.candidates.kind[i] == GRIPPED else -rest


@compiled_subset
def decide(arguments: DecisionArguments, case: int) -> bool:
    """Decide how a case goes on, whose numbers are in ``space``; return whether there was an impact.

    After an impact the numbers are to be computed for the new rates, and the case comes here again.
    """
    table, space, pick = arguments.table, arguments.space, arguments.candidates
    cases, n, k = arguments.cases, arguments.table.coordinates, arguments.table.constraint.size
    for j in range(n):
        space.rates[j] = cases.x[case, n + j]
    if _refused(table, space, cases, case):
        cases.status[case] = _INITIAL_STATE
        return False
    _remember(table, space, pick, cases, case)
    begins, known, struck, closing, meets = cases.after[case, 0] == UNDECIDED, True, False, False, False
    for i in range(k):
        known = known and begins and cases.modes[case, i] != UNDECIDED
        if begins:
            cases.flight[case, i] += abs(cases.passed[case]) if cases.modes[case, i] == OPEN else 0.0
            pick.kind[i] = _opening(table, space, pick, cases, case, i)
        else:
            pick.kind[i] = cases.after[case, i]
            pick.broken[i] = pick.turned[i] = pick.slides[i] = 0
        pick.struck[i] = 0
        if begins and pick.kind[i] >= TOUCHING and _strikes(table, space, cases, case, i):
            pick.struck[i], struck = 1, True
        if pick.kind[i] >= TOUCHING:
            cases.flight[case, i] = 0.0
        was = cases.modes[case, i]
        closing = closing or (pick.kind[i] >= TOUCHING and (not begins or was == UNDECIDED or was == OPEN))
        closing = closing or pick.kind[i] == TOUCHING
        meets = meets or (pick.kind[i] >= TOUCHING and was == OPEN)
    if struck:
        status = _impact(arguments, case)
        cases.status[case] = status
        return status == _SUCCESS
    load_accelerations(table, space)
    status = select_mode(table, space, pick, known, meets)
    cases.status[case] = status
    if status != _SUCCESS:
        return False
    sticking = 0
    for j in range(n):
        cases.motion[case, j] = pick.best_motion[j]
    for i in range(k):
        cases.after[case, i] = UNDECIDED
        cases.modes[case, i], cases.sides[case, i] = pick.best_mode[i], pick.best_sides[i]
        sticking += 1 if pick.best_mode[i] == STICK else 0
        cases.directions[case, 2 * i], cases.directions[case, 2 * i + 1] = pick.best_along[i, 0], pick.best_along[i, 1]
        closing = closing or pick.best_mode[i] == STICK
    planar = False
    for i in range(k):
        planar = planar or (pick.best_mode[i] == SLIP and table.width[i] > 1)
    if planar or sticking > 1:
        place = solve_mode(table, space, pick.best_mode, pick.best_along, pick.best_sides, False)
        for i in range(k):
            if pick.best_mode[i] == SLIP and table.width[i] > 1:
                _rest_speed(arguments, case, i, place)
            if table.sided[i] == 0:
                cases.sides[case, i] = _determined(table, space, place, i)
    if closing and _moves(table, space, pick, cases, case):
        _hold(arguments, case)
    return False


@compiled_subset
def LOOP(arguments: DecisionArguments) -> None:
    """Decide how the wanted cases go on, by their numbers in ``values``."""
    for place in range(arguments.wanted.size):
        case = arguments.wanted[place]
        if case < 0:
            continue
        for v in range(arguments.space.values.size):
            arguments.space.values[v] = arguments.values[place, v]
        arguments.after_impact[place] = 1 if decide(arguments, case) else 0
