"""Ends of phases in the loop over phases: events and guards that have occurred, and whether a decision is needed."""

from __future__ import annotations

from ..events.event_rules import happens_together
from ..methods.status import Status
from ..subset.compiled_subset import compiled_subset
from .contact_kinds import SOON, SOON_IN_A_ROW
from .contact_system import OPEN
from .phase_tables import JUMPS, NO_RUNNER, CaseTable, PhasePlan, ThreadWorkspace
from .slip_begins import forget_breaks

_SUCCESS, _EVENT = int(Status.SUCCESS), int(Status.EVENT)
_IMPOSSIBLE, _ACCUMULATE = int(Status.CONTACT_IMPOSSIBLE), int(Status.EVENTS_ACCUMULATE)
_MAX_STEPS, _INITIAL_STATE = int(Status.MAX_STEPS), int(Status.INITIAL_STATE)
_FAILED, _UNSUPPORTED = int(Status.PROJECTION_FAILED), int(Status.CONTACT_UNSUPPORTED)
BEYOND = -2
"""Number of the contact of guards at which a motion ends, because its equations do not continue it."""
_HISTORY, _HISTORIES = 31, 2_147_483_629
"""By which a history is multiplied for each phase, and how many there are."""


@compiled_subset
def next_history(history: int, mode: int) -> int:
    """Return the history of phases with one more, in a mode of a number."""
    return (_HISTORY * history + mode + 1) % _HISTORIES


@compiled_subset
def _happened(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace, i: int, first: int) -> bool:
    """Record the events of users in a phase; return whether one of them ends the case, or maps its state."""
    over, jumps = False, False
    for e in range(plan.terminal.size):
        count, before = space.happened[first + 3 * e], table.occurred[i, 3 * e]
        for m in range(3 * e, 3 * e + 3):
            table.occurred[i, m] = space.happened[first + m]
        if count == before:
            continue
        ends = plan.terminal[e] > 0 and count >= plan.terminal[e]
        over, jumps = over or (ends and plan.jumps[e] == 0), jumps or plan.jumps[e] != 0
    if jumps and not over:
        table.numbers.runner[i] = JUMPS
    return over


@compiled_subset
def _fire(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace, runner: int, i: int, first: int, t: float) -> int:
    """Record the guards that have fired; return the status with which the case ends by them, success for none."""
    requested, status, kinked = plan.terminal.size, _SUCCESS, False
    for m in range(table.cases.fired.shape[1]):
        table.cases.fired[i, m] = 0
    for e in range(requested, plan.runners.events[runner]):
        if space.happened[first + 3 * e + 2] == t:
            guard = plan.runners.first_guard[runner] + e - requested
            contact, bit = plan.guards[guard, 0], plan.guards[guard, 1]
            if contact == BEYOND:
                status = _UNSUPPORTED
            elif contact < 0:
                status = _IMPOSSIBLE if status == _SUCCESS else status
            elif table.cases.fired[i, contact] & bit == 0:
                table.cases.fired[i, contact] += bit
            kinked = kinked or plan.guards[guard, 2] != 0
    if kinked and not happens_together(table.cases.passed[i], t, t):
        forget_breaks(table.cases, i)
    return status


@compiled_subset
def begins_motion(table: CaseTable, i: int, t: float) -> bool:
    """Return whether a phase that begins at a time t is the first of a case: no guard has fired, and no time passed."""
    return table.numbers.phases[i] == 0 and table.cases.soon[i] == 0 and t == table.t0[i]


@compiled_subset
def _refuse(table: CaseTable, i: int, t: float) -> None:
    """End a case whose next phase cannot start, and is not counted, in the state that the last one left."""
    numbers = table.numbers
    numbers.state[i], numbers.runner[i] = _FAILED, NO_RUNNER
    if t == table.t0[i] and table.cases.passed[i] != 0.0:
        numbers.phases[i] -= 1


@compiled_subset
def count_phase(table: CaseTable, i: int, mode: int) -> None:
    """Count a phase of a case that has ended, in a mode of a number, if it took time."""
    if table.cases.passed[i] != 0.0:
        table.numbers.phases[i] += 1
        table.numbers.history[i] = next_history(table.numbers.history[i], mode)


@compiled_subset
def may_meet(table: CaseTable, i: int) -> bool:
    """Return whether a case has come to its end with a contact open."""
    opened = False
    for m in range(table.cases.modes.shape[1]):
        opened = opened or table.cases.modes[i, m] == OPEN
    return opened and table.numbers.state[i] == _SUCCESS and table.cases.span[i] > 0.0


@compiled_subset
def ended(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace, runner: int, place: int, lane: int) -> bool:
    """Record how a case ended its run; return whether a decision is needed."""
    i, t, status = space.chosen[place], space.ends[place, 0], int(space.ends[place, 1])
    numbers, cases = table.numbers, table.cases
    if status == _INITIAL_STATE and not begins_motion(table, i, t):
        _refuse(table, i, t)
        return False
    numbers.steps[i] += int(space.ends[place, 2])
    for m in range(cases.x.shape[1]):
        cases.x[i, m] = space.posed[m, lane]
    for m in range(table.totals.shape[1]):
        table.totals[i, m] = space.totals[place, m]
    cases.passed[i], cases.t[i] = t - table.t0[i], t
    first = place * 3 * plan.runners.events[runner]
    over = _happened(plan, table, space, i, first)
    if table.carried.shape[0] > 0:
        for m in range(2 * plan.runners.events[runner]):
            table.carried[i, m] = space.carried[place * 2 * plan.runners.events[runner] + m]
    if status == _SUCCESS:
        if table.carried.shape[0] > 0 and numbers.steps[i] >= plan.most_steps:
            numbers.state[i] = _MAX_STEPS
        if t == table.t1[i]:
            numbers.state[i] = _SUCCESS
        return False
    if status != _EVENT or over:
        numbers.state[i] = status
        return False
    if numbers.steps[i] >= plan.most_steps:
        numbers.state[i] = _MAX_STEPS
        return False
    jumps = numbers.runner[i] == JUMPS
    reason = _SUCCESS if jumps else _fire(plan, table, space, runner, i, first, t)
    if reason == _UNSUPPORTED:
        numbers.state[i] = reason
        return False
    if reason == _IMPOSSIBLE:
        cases.status[i] = reason
    cases.soon[i] = cases.soon[i] + 1 if abs(cases.passed[i]) <= SOON * abs(cases.span[i]) else 0
    if cases.soon[i] >= SOON_IN_A_ROW:
        numbers.state[i] = _ACCUMULATE
        return False
    count_phase(table, i, cases.number[i])
    return not jumps
