"""Impacts of contacts: the rates after them, what is known of each contact then, and rates that a mode allows."""

from __future__ import annotations

from ..methods.status import Status
from .arguments import Vector
from .compiled_subset import compiled_subset, sqrt
from .contact_cases import (
    RESTING,
    ROUNDED,
    STILL,
    ContactCases,
    gap_rate,
    laws_of_sliding,
    rate_noise,
    rate_terms,
    slip_speed,
    slip_terms,
)
from .contact_sizes import NOISE, slow_terms
from .contact_system import load_impact, solve_mode
from .contact_table import (
    CLOSED,
    OPEN,
    RESTITUTION,
    SLIP,
    STICK,
    ContactSpace,
    ContactTable,
    drift,
    number,
    slope,
    velocity,
)
from .mode_candidates import FREE, GRIPPED, HOVERING, LIFTING, SLIDING, TOUCHING, Candidates
from .mode_selection import select_mode

__all__ = ["hold", "moves_in_mode", "strike"]

_MOST_IMPACTS = 10_000
"""Impacts at one instant, after which they accumulate."""

_MAY_MOVE = 1e-9
"""Share of the terms of a velocity up to which it counts as zero where a phase starts: a tenth of what
`dalembert.reduction.start_limits` allows."""

_SUCCESS, _ACCUMULATE = int(Status.SUCCESS), int(Status.EVENTS_ACCUMULATE)


@compiled_subset
def strike(
    table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, demand: Vector, case: int
) -> int:
    """Solve for the rates after an impact of the contacts that are struck, and take them; return a status.

    `demand` is memory for a number a constraint.
    """
    cases.impacts[case] += 1
    if cases.impacts[case] > _MOST_IMPACTS:
        return _ACCUMULATE
    for row in range(table.constraints):
        demand[row] = 0.0
    for i in range(table.constraint.size):
        if pick.struck[i] == 1:
            row = table.constraint[i]
            demand[row] = -number(table, space, i, RESTITUTION) * velocity(table, space, row)
        if pick.kind[i] == LIFTING:  # it still touches, and may be pushed
            pick.kind[i] = TOUCHING
            if laws_of_sliding(table, i):
                pick.kind[i], pick.slides[i] = GRIPPED, 1 if pick.former[i] == SLIP else 0
        if pick.kind[i] == SLIDING:
            pick.kind[i], pick.slides[i] = GRIPPED, 1
        pick.broken[i] = pick.turned[i] = pick.parted[i] = 0
        pick.still[i] = pick.least[i] = 0.0
    load_impact(table, space, demand)
    status = select_mode(table, space, pick, False, False)
    if status != _SUCCESS:
        return status
    n = table.coordinates
    for j in range(n):
        cases.x[case, n + j] = pick.best_motion[j]
    for i in range(table.constraint.size):
        cases.after[case, i] = _kind_after(table, space, pick, cases, case, i)
        cases.directions[case, 2 * i], cases.directions[case, 2 * i + 1] = pick.best_along[i, 0], pick.best_along[i, 1]
        if table.sided[i] != 0:
            cases.sides[case, i] = pick.best_sides[i]
    return status


@compiled_subset
def _rate_after(table: ContactTable, space: ContactSpace, pick: Candidates, row: int) -> float:
    """Return the rate of a constraint, or a slip velocity, after an impact."""
    rate = drift(table, space, row)
    for j in range(table.coordinates):
        rate += slope(table, space, row, j) * pick.best_motion[j]
    return rate


@compiled_subset
def _kind_after(
    table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int, i: int
) -> int:
    """Return what is known of a contact after an impact."""
    if pick.kind[i] == FREE and cases.after[case, i] != HOVERING:
        return FREE
    if table.constraint[i] >= 0:
        row = table.constraint[i]
        terms, rate = 0.0, float(table.sense[i]) * _rate_after(table, space, pick, row)
        for j in range(table.coordinates):
            terms += abs(slope(table, space, row, j) * pick.best_motion[j])
        least = max(rate_noise(table, space, i), NOISE * terms)
        if rate > max(least, RESTING * cases.approach[case, i]):
            return FREE
        if pick.kind[i] == FREE or rate > max(least, STILL * cases.approach[case, i]):
            return HOVERING
    if not laws_of_sliding(table, i):
        return TOUCHING
    if pick.best_mode[i] == STICK:
        return GRIPPED
    total = 0.0
    for a in range(table.width[i]):
        slip = _rate_after(table, space, pick, table.constraints + table.first[i] + a)
        total += slip * slip
    return GRIPPED if sqrt(total) <= NOISE * cases.speeds[case, i] else SLIDING


@compiled_subset
def moves_in_mode(table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, case: int) -> bool:
    """Return whether a contact that is closed, or sticks, in the selected mode moves more than rounding makes of it.

    What is rounding of fast motions may be all that is left of them: beside the present rates, too, it must be small,
    or the phase could not start.
    """
    moves = False
    for i in range(table.constraint.size):
        if pick.best_mode[i] == STICK:
            terms, row = slip_terms(table, space, i), table.constraints + table.first[i]
            for a in range(table.width[i]):
                terms = max(terms, slow_terms(table, space, cases.x, case, row + a))
            most = min(ROUNDED * cases.speeds[case, i], _MAY_MOVE * terms)
            moves = moves or not slip_speed(table, space, i) <= most
        if pick.best_mode[i] != OPEN and table.constraint[i] >= 0:
            row = table.constraint[i]
            terms = max(rate_terms(table, space, row), slow_terms(table, space, cases.x, case, row))
            most = min(ROUNDED * cases.approach[case, i], _MAY_MOVE * terms)
            moves = moves or not abs(gap_rate(table, space, i)) <= most
    return moves


@compiled_subset
def hold(
    table: ContactTable, space: ContactSpace, pick: Candidates, cases: ContactCases, demand: Vector, case: int
) -> None:
    """Give a case the rates nearest to the present ones, by kinetic energy, that its mode allows.

    `demand` is memory for a number a constraint.
    """
    n = table.coordinates
    for row in range(table.constraints):
        demand[row] = 0.0
    load_impact(table, space, demand)
    for i in range(table.constraint.size):
        state = pick.best_mode[i]
        pick.mode[i] = state if state == OPEN or state == STICK else CLOSED
    solve_mode(table, space, pick.mode, pick.best_along, pick.best_sides)
    for j in range(n):
        cases.x[case, n + j] = space.motion[j]
