"""Class of each contact before a decision: what is known of it by the phase that ended, its guards, gap and slip."""

from __future__ import annotations

from ..methods.step_constants import EPSILON, RESOLUTION, TOGETHER
from ..subset.compiled_subset import compiled_subset
from .contact_cases import (
    ADDED,
    NOISE,
    REST,
    SIDE,
    UNDECIDED,
    ContactCases,
    gap_noise,
    gap_rate,
    position_terms,
    rate_noise,
    slip_speed,
    slip_terms,
)
from .contact_system import OPEN, STICK, ContactSystem, drift, inertial_size, opening_power, terms
from .selection.mode_candidates import BREAK_UP, FREE, LIFT, LIFTING, MEET, STOP, closed_kind

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

SOON, SOON_IN_A_ROW, _ENOUGH_HOPS = 1e-11, 1000, 500
"""Share of the span below which a phase ends too soon, how often that may happen in a row, and after how many of them a
contact with a restitution below 1 rests that hops."""

_SPARE = 1e-3
"""Share of the tolerances by which the gap of a contact that touches and stays open may fall below zero."""

_JUMPED = 1e-4
"""Share of the slip speeds so far above which slip has not ended: its velocity has jumped through zero."""

_STOPPED = 2.0
"""Slip speed in a plane, as a multiple of the rest speed, below which a contact has stopped when its guard fires."""


@compiled_subset
def sign(system: ContactSystem, cases: ContactCases, case: int, i: int) -> float:
    """Return the sign of the normal reaction of a contact, 1 where it has only one."""
    return cases.added[case, ADDED * i + SIDE] if system.sided[i] != 0 else 1.0


@compiled_subset
def refused(system: ContactSystem, cases: ContactCases, case: int) -> bool:
    """Return whether a case cannot start, or its coefficients make no sense."""
    bad = False
    for i in range(system.contacts):
        bad = bad or system.mu[i] < 0.0 or system.mu_static[i] < system.mu[i]
        bad = bad or system.restitution[i] < 0.0 or system.restitution[i] > 1.0
        if system.constraint[i] >= 0 and cases.modes[case, i] == UNDECIDED:
            bad = bad or system.gap[i] < -gap_noise(system, cases.x[case], i)
            power = opening_power(system, i)  # none in the middle of a hollow, where no direction leads to the surface
            bad = bad or not (power > 0.0 or (power == 0.0 and system.gap[i] > 0.0))
    return bad


@compiled_subset
def _gap_terms(system: ContactSystem, cases: ContactCases, case: int, i: int) -> float:
    """Return the sum of the sizes of what coordinates add to a gap, to first order."""
    return terms(system.jacobian[system.constraint[i]], cases.x[case], 0.0)


@compiled_subset
def _slopes(system: ContactSystem, i: int) -> float:
    """Return the sum of the sizes of the slopes of a gap."""
    total = 0.0
    for j in range(system.coordinates):
        total += abs(system.jacobian[system.constraint[i], j])
    return total


@compiled_subset
def _rounding_of_rate(system: ContactSystem, cases: ContactCases, case: int, i: int) -> float:
    """Return what rounding leaves of the rate of a gap that is zero, by the largest speeds so far.

    It is at least what rounding of the gap amounts to in the whole span.
    """
    fastest = _gap_terms(system, cases, case, i) / max(abs(cases.span[case]), 1e-300)
    for j in range(system.contacts):
        fastest = max(fastest, cases.approach[case, j], cases.speeds[case, j])
    return max(rate_noise(system, i), ROUNDED * fastest)


@compiled_subset
def _rounding_of_rest(system: ContactSystem, cases: ContactCases, case: int, row: int) -> float:
    """Return what rounding leaves of the rate of a gap, or of a slip velocity, of a body at rest.

    It is what rounding of positions amounts to in the whole span, and no more than that of the speeds that the given
    forces cause in it.
    """
    slopes, span = system.jacobian[row], max(abs(cases.span[case]), 1e-300)
    pushed = inertial_size(system, slopes) * inertial_size(system, system.forcing) * span
    return ROUNDED * min(position_terms(system, cases.x[case], row, 0.0) / span, pushed)


@compiled_subset
def _slip_at_rest(system: ContactSystem, cases: ContactCases, case: int, i: int) -> float:
    """Return the slip speed of a contact up to which it is at rest where nothing is known of the motion before."""
    least = NOISE * slip_terms(system, i)
    for row in range(system.row[i], system.row[i] + system.width[i]):
        least = max(least, _rounding_of_rest(system, cases, case, row))
    return least


@compiled_subset
def _rate_at_start(system: ContactSystem, cases: ContactCases, case: int, i: int) -> float:
    """Return the rate of a gap up to which it is zero where nothing is known of the motion before."""
    return max(rate_noise(system, i), _rounding_of_rest(system, cases, case, system.constraint[i]))


@compiled_subset
def approaches(system: ContactSystem, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether the gap of a contact closes, beyond rounding."""
    return -gap_rate(system, i) > _rounding_of_rate(system, cases, case, i)


@compiled_subset
def arrives(system: ContactSystem, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether the gap of an open contact closes at the instant, as far as positions and times can tell."""
    if system.constraint[i] < 0 or not approaches(system, cases, case, i):
        return False
    passing = abs(cases.t[case]) * -gap_rate(system, i)
    return system.gap[i] <= TOGETHER * (_gap_terms(system, cases, case, i) + passing)


@compiled_subset
def meets_at_end(system: ContactSystem, cases: ContactCases, case: int, rtol: float, atol: float) -> bool:
    """Find the open contacts that meet at the end of a motion, as if their guards had fired; return whether any does.

    The last step of a motion is cut at its end. A longer motion locates the same impact on the polynomial of a longer
    step, which differs by no more than is allowed of the error of a step.
    """
    meets = False
    for i in range(system.contacts):
        if system.constraint[i] < 0 or cases.modes[case, i] != OPEN or not approaches(system, cases, case, i):
            continue
        passing = abs(cases.passed[case]) * -gap_rate(system, i)
        allowed = rtol * (_gap_terms(system, cases, case, i) + passing) + atol * _slopes(system, i)
        if system.gap[i] <= allowed:
            cases.fired[case, i], meets = MEET, True
    return meets


@compiled_subset
def gap_allowance(
    system: ContactSystem, cases: ContactCases, case: int, i: int, stays: bool, rtol: float, atol: float
) -> float:
    """Return what is added to the gap of a contact that is to be open, so that it is not closed already.

    Nothing is where it approaches: a guard that counts as zero where a mode begins could miss that. A contact that
    touches and ``stays`` so without an impact has a share of the tolerances, by which polynomials of a step may close
    it.
    """
    if approaches(system, cases, case, i):
        return 0.0
    most = RESOLUTION * (_gap_terms(system, cases, case, i) + abs(cases.t[case]) * cases.approach[case, i])
    if system.gap[i] < 0.0:  # a start, or an impact located within its noise, may have left more than rounding here
        most = max(most, gap_noise(system, cases.x[case], i))
    if system.gap[i] <= most:
        spare = _SPARE * (rtol * _gap_terms(system, cases, case, i) + atol * _slopes(system, i))
        return min(-system.gap[i], most) + (spare if stays and cases.impacts[case] == 0 else 0.0)
    return cases.added[case, ADDED * i + SIDE] if cases.modes[case, i] == OPEN else 0.0


@compiled_subset
def _excursion(system: ContactSystem, cases: ContactCases, case: int, i: int) -> float:
    """Return how far rounding may have opened the gap of a contact that touches, or closed it beyond zero.

    It is rounding of positions and of the time, or what that has left.
    """
    passing = abs(cases.t[case] * drift(system, system.constraint[i]))
    left = min(-system.gap[i], gap_noise(system, cases.x[case], i))
    return max(_EXCURSION * (_gap_terms(system, cases, case, i) + passing), left)


@compiled_subset
def _unresolved(system: ContactSystem, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether a contact that was open has opened no further than rounding, and hardly moves.

    It hardly moves, too, at a speed that its loads cause where it falls as far as rounding may open it, or in a phase
    that ends too soon: where it opens but has met again at once, or after many hops.
    """
    rate, passed = gap_rate(system, i), cases.passed[case]
    hops = cases.soon[case] >= _ENOUGH_HOPS and system.restitution[i] < 1.0
    if (hops or (rate > 0.0 and passed == 0.0)) and abs(rate) <= SOON * cases.loads[case, i] * abs(cases.span[case]):
        return True
    speed, least = abs(rate), _excursion(system, cases, case, i)
    slow, height = speed <= _SLOW * cases.approach[case, i], 0.25 * speed * cases.flight[case, i]
    return height <= least and (slow or speed * speed <= 2.0 * least * cases.loads[case, i])


@compiled_subset
def _closed_at_end(system: ContactSystem, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact at the end of a phase, or at the start, if it is closed."""
    fired, before, stopped = cases.fired[case, i], cases.modes[case, i], cases.fired[case, i] & STOP != 0
    # where the normal reaction vanishes, so does the friction that it allows: nothing is known of the direction
    at_once = system.jumping[i] == 1 and slip_speed(system, i) > _JUMPED * cases.speeds[case, i]
    if fired >= BREAK_UP or before == STICK or (stopped and system.width[i] == 1 and not at_once):
        return closed_kind(system, i, 0.0, 0.0)
    limit = NOISE * cases.speeds[case, i]
    if before == UNDECIDED:
        limit = max(limit, _slip_at_rest(system, cases, case, i))
    if stopped and system.width[i] > 1:
        limit = max(limit, _STOPPED * abs(cases.added[case, ADDED * i + REST]))
    return closed_kind(system, i, slip_speed(system, i), limit)


@compiled_subset
def kind_at_end(system: ContactSystem, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact at the end of a phase, or at the start."""
    fired, before = cases.fired[case, i], cases.modes[case, i]
    if system.constraint[i] < 0 or not (before == UNDECIDED or before == OPEN):
        return LIFTING if fired & LIFT != 0 else _closed_at_end(system, cases, case, i)
    if before == OPEN:  # of a body that has come to rest, rates are what rounding left of them
        free, noise = (
            fired & MEET == 0 and not arrives(system, cases, case, i),
            _rounding_of_rate(system, cases, case, i),
        )
    else:
        free, noise = system.gap[i] > gap_noise(system, cases.x[case], i), _rate_at_start(system, cases, case, i)
    if free or (gap_rate(system, i) > noise and (before == UNDECIDED or not _unresolved(system, cases, case, i))):
        return FREE
    return _closed_at_end(system, cases, case, i)


@compiled_subset
def touching(system: ContactSystem, cases: ContactCases, case: int, i: int) -> int:
    """Return what is known of a contact that touches after an impact."""
    return closed_kind(system, i, slip_speed(system, i), NOISE * cases.speeds[case, i])


@compiled_subset
def strikes(system: ContactSystem, cases: ContactCases, case: int, i: int, begins: bool) -> bool:
    """Return whether a contact that touches, and was open, is struck; its approach speed is remembered.

    It ``begins`` unless after another impact at the same instant.
    """
    before = cases.modes[case, i]
    if system.constraint[i] < 0 or (begins and not (before == UNDECIDED or before == OPEN)):
        return False
    speed = -gap_rate(system, i)
    largest = max(cases.approach[case, i], speed)
    cases.approach[case, i] = largest
    if begins and before == OPEN and _unresolved(system, cases, case, i):
        return False
    noise = _rate_at_start(system, cases, case, i) if before == UNDECIDED else rate_noise(system, i)
    return speed > max(noise, (RESTING if begins else STILL) * largest)
