"""Cases with contacts, and what is known of each contact before a decision."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..methods.event_constants import RESOLUTION, TOGETHER
from ..methods.step_constants import EPSILON
from .arguments import IntMatrix, IntVector, Matrix, Vector
from .compiled_subset import compiled_subset, sqrt
from .contact_sizes import NOISE, gap_noise
from .contact_table import (
    GAP,
    MU,
    MU_STATIC,
    OPEN,
    RESTITUTION,
    STICK,
    ContactSpace,
    ContactTable,
    drift,
    mass,
    number,
    opening_power,
    slope,
    velocity,
)
from .mode_candidates import FREE, GRIPPED, LIFTING, SLIDING, TOUCHING, Candidates

__all__ = [
    "BREAK_DOWN",
    "BREAK_PLANE",
    "BREAK_UP",
    "LIFT",
    "MEET",
    "RESTING",
    "ROUNDED",
    "SHARE",
    "STILL",
    "STOP",
    "TURN",
    "UNDECIDED",
    "ContactCases",
    "approaches",
    "contact_cases",
    "gap_allowance",
    "gap_rate",
    "known_of",
    "laws_of_sliding",
    "rate_noise",
    "rate_terms",
    "refused",
    "returns",
    "sign",
    "slip_speed",
    "slip_terms",
    "strikes",
    "touching",
]

LIFT, TURN, MEET, STOP, BREAK_UP, BREAK_DOWN, BREAK_PLANE, SHARE = 1, 2, 4, 8, 16, 32, 64, 128
"""Guards of a contact that have fired, as bits: the normal reaction vanishes; it changes its sign; the gap closes; slip
ends; friction fails to hold against slip forwards, backwards, or in a plane; contacts can no longer share a load."""

UNDECIDED = -1
"""Mode of a contact before the first decision, and `ContactCases.after` without an impact."""

_MOTIONLESS = 1e-12
"""Share of the rate that a gap could have with the kinetic energy there is, up to which it has none."""

RESTING = 1e-7
"""Share of the largest approach speed of a contact so far, below which an impact has no restitution.

So infinitely many impacts within a finite time end."""

STILL = 1e-11
"""The same for impacts that follow others at the same instant."""

ROUNDED = 1e-14
"""Share of the largest speed so far that rounding leaves of one that is zero."""

_SLOW, _EXCURSION = 1e-4, 64.0 * EPSILON
"""The same for an impact after a gap opened no further than rounding: a share of the largest approach speed so far,
and of the terms of the gap."""

_STOPPED = 2.0
"""Slip speed in a plane, as a multiple of the rest speed, below which a contact has stopped when its guard fires."""


class ContactCases(NamedTuple):
    """Cases at an instant; of k cases with c contacts each.

    Attributes
    ----------
    x : (k, 2 n_q + n_z)
        Coordinates, rates and first-order states; the rates change.
    directions, sides : (k, 2 c), (k, c)
        Directions of slip; signs of normal reactions, or of contacts that open what is added to their guards.
    speeds, approach : (k, c)
        Largest slip speed, and largest speed at which the gap closed, so far.
    rest : (k, c)
        Slip speed in a plane below which a contact counts as at rest; negative in phases that do not begin at rest.
    flight : (k, c)
        How long each contact has been open [s].
    loads : (k, c)
        Largest size of the terms of each gap's acceleration so far.
    impacts : (k,)
        Impacts at the instant so far.
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
    loads: Matrix
    impacts: IntVector
    span: Vector
    passed: Vector
    modes: IntMatrix
    fired: IntMatrix
    after: IntMatrix
    status: IntVector
    motion: Matrix


def contact_cases(x: NDArray[np.float64], span: NDArray[np.float64], contacts: int, states: int = 0) -> ContactCases:
    """Return cases that start from x (k, 2 n_q + n_z), which changes, with signed spans (k,).

    `states` is n_z, the number of first-order states.
    """
    k, n = len(x), (x.shape[1] - states) // 2
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
        loads=np.zeros((k, contacts)),
        impacts=np.zeros(k, np.int64),
        span=span,
        passed=np.zeros(k),
        modes=undecided[0],
        fired=np.zeros((k, contacts), np.int64),
        after=undecided[1],
        status=np.zeros(k, np.int64),
        motion=np.zeros((k, n)),
    )


@compiled_subset
def slip_speed(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the size of the slip velocity of a contact."""
    total = 0.0
    for a in range(table.width[i]):
        slip = velocity(table, space, table.constraints + table.first[i] + a)
        total += slip * slip
    return sqrt(total)


@compiled_subset
def rate_terms(table: ContactTable, space: ContactSpace, row: int) -> float:
    """Return the sum of the sizes of the terms of a slip velocity, or of the rate of a constraint."""
    total = abs(drift(table, space, row))
    for j in range(table.coordinates):
        total += abs(slope(table, space, row, j) * space.rates[j])
    return total


@compiled_subset
def slip_terms(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the sum of the sizes of the terms of a slip velocity, the larger of two."""
    largest = 0.0
    for a in range(table.width[i]):
        largest = max(largest, rate_terms(table, space, table.constraints + table.first[i] + a))
    return largest


@compiled_subset
def gap_rate(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the rate of the gap of a contact."""
    return float(table.sense[i]) * velocity(table, space, table.constraint[i])


@compiled_subset
def rate_noise(table: ContactTable, space: ContactSpace, i: int) -> float:
    """Return the size below which the rate of a gap counts as zero."""
    row, terms, energy, ease = table.constraint[i], 0.0, 0.0, 0.0
    for j in range(table.coordinates):
        entry, inertia = slope(table, space, row, j), mass(table, space, j, j)
        terms += abs(entry * space.rates[j])
        if inertia > 0.0:
            ease += entry * entry / inertia
        for m in range(table.coordinates):
            energy += space.rates[j] * mass(table, space, j, m) * space.rates[m]
    return NOISE * terms + _MOTIONLESS * sqrt(max(energy * ease, 0.0))


@compiled_subset
def _gap_terms(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int) -> float:
    """Return the sum of the sizes of what coordinates add to a gap, to first order."""
    terms = 0.0
    for j in range(table.coordinates):
        terms += abs(slope(table, space, table.constraint[i], j) * cases.x[case, j])
    return terms


@compiled_subset
def _rounding_of_rate(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int) -> float:
    """Return what rounding leaves of the rate of a gap that is zero, by the largest speeds so far.

    It is at least what rounding of the gap amounts to in the whole span.
    """
    fastest = _gap_terms(table, space, cases, case, i) / max(abs(cases.span[case]), 1e-300)
    for j in range(table.constraint.size):
        fastest = max(fastest, cases.approach[case, j], cases.speeds[case, j])
    return max(rate_noise(table, space, i), ROUNDED * fastest)


@compiled_subset
def approaches(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether the gap of a contact closes, beyond rounding."""
    return -gap_rate(table, space, i) > _rounding_of_rate(table, space, cases, case, i)


@compiled_subset
def laws_of_sliding(table: ContactTable, i: int) -> bool:
    """Return whether a contact slips or sticks while it is closed."""
    return table.width[i] > 0 and table.smooth[i] == 0


@compiled_subset
def _closed(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact if it is closed."""
    if not laws_of_sliding(table, i):
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
    speed, limit = slip_speed(table, space, i), NOISE * scale
    if before == UNDECIDED:
        limit = NOISE * max(scale, slip_terms(table, space, i))
    if fired & STOP != 0:
        limit = max(limit, _STOPPED * abs(cases.rest[case, i]))
    return GRIPPED if speed <= limit else SLIDING


@compiled_subset
def _unresolved(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether a contact that was open has opened no further than rounding, and hardly moves."""
    speed = abs(gap_rate(table, space, i))
    slow, height = speed <= _SLOW * cases.approach[case, i], 0.25 * speed * cases.flight[case, i]
    return slow and height <= _EXCURSION * _gap_terms(table, space, cases, case, i)


@compiled_subset
def _arrives(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int, t: float) -> bool:
    """Return whether the gap of an open contact closes at the instant, as far as positions and times can tell."""
    if not approaches(table, space, cases, case, i):
        return False
    speed, terms = -gap_rate(table, space, i), _gap_terms(table, space, cases, case, i)
    return number(table, space, i, GAP) <= TOGETHER * (terms + abs(t) * speed)


@compiled_subset
def gap_allowance(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int, t: float) -> float:
    """Return what is added to the gap of a contact that is to be open, so that it is not closed already.

    Nothing is where it approaches: a guard that counts as zero where a mode begins could miss that.
    """
    if approaches(table, space, cases, case, i):
        return 0.0
    gap = number(table, space, i, GAP)
    most = RESOLUTION * (_gap_terms(table, space, cases, case, i) + abs(t) * cases.approach[case, i])
    if gap <= most:
        return min(-gap, most)
    return cases.sides[case, i] if cases.modes[case, i] == OPEN else 0.0


@compiled_subset
def known_of(
    table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int, i: int, t: float
) -> int:
    """Return what is known of a contact before a decision at time t; what its guards say of it is written too."""
    fired, before = cases.fired[case, i], cases.modes[case, i]
    pick.former[i], pick.parted[i] = before, 1 if fired & SHARE != 0 else 0
    pick.broken[i] = pick.slides[i] = 0
    pick.turned[i] = 1 if fired & TURN != 0 else 0
    if table.constraint[i] < 0 or not (before == UNDECIDED or before == OPEN):
        return LIFTING if fired & LIFT != 0 else _closed(table, space, pick, cases, case, i)
    if before == OPEN and fired & MEET == 0 and not _arrives(table, space, cases, case, i, t):
        return FREE
    rate, noise = gap_rate(table, space, i), rate_noise(table, space, i)
    if before == OPEN:  # of a body that has come to rest, rates are what rounding left of them
        noise = _rounding_of_rate(table, space, cases, case, i)
    far = before == UNDECIDED and number(table, space, i, GAP) > gap_noise(table, space, cases.x, case, i)
    if far or (rate > noise and (before == UNDECIDED or not _unresolved(table, space, cases, case, i))):
        return FREE
    return _closed(table, space, pick, cases, case, i)


@compiled_subset
def touching(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact that touches after an impact."""
    if not laws_of_sliding(table, i):
        return TOUCHING
    return GRIPPED if slip_speed(table, space, i) <= NOISE * cases.speeds[case, i] else SLIDING


@compiled_subset
def returns(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int, t: float) -> int:
    """Return what is known of a contact that an impact has left open, and that others may have sent back at once."""
    if table.constraint[i] < 0 or not _arrives(table, space, cases, case, i, t):
        return FREE
    return touching(table, space, cases, case, i)


@compiled_subset
def strikes(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int, i: int, begins: bool) -> bool:
    """Return whether a contact that touches, and was open, is struck; its approach speed is remembered.

    It ``begins`` unless after another impact at the same instant.
    """
    before = cases.modes[case, i]
    if table.constraint[i] < 0 or (begins and not (before == UNDECIDED or before == OPEN)):
        return False
    speed = -gap_rate(table, space, i)
    largest = max(cases.approach[case, i], speed)
    cases.approach[case, i] = largest
    if begins and before == OPEN and _unresolved(table, space, cases, case, i):
        return False
    return speed > max(rate_noise(table, space, i), (RESTING if begins else STILL) * largest)


@compiled_subset
def refused(table: ContactTable, space: ContactSpace, cases: ContactCases, case: int) -> bool:
    """Return whether a case cannot start, or its coefficients make no sense."""
    bad = False
    for i in range(table.constraint.size):
        mu, static = number(table, space, i, MU), number(table, space, i, MU_STATIC)
        restitution = number(table, space, i, RESTITUTION)
        bad = bad or mu < 0.0 or static < mu or restitution < 0.0 or restitution > 1.0
        if table.constraint[i] >= 0 and cases.modes[case, i] == UNDECIDED:
            bad = bad or number(table, space, i, GAP) < -gap_noise(table, space, cases.x, case, i)
            bad = bad or not opening_power(table, space, i) > 0.0
    return bad


@compiled_subset
def sign(table: ContactTable, cases: ContactCases, case: int, i: int) -> float:
    """Return the sign of the normal reaction of a contact, 1 where it has only one."""
    return cases.sides[case, i] if table.sided[i] != 0 else 1.0
