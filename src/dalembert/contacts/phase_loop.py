"""Motions with contacts, phase after phase, as compiled code: single runs and sweeps.

A thread takes some cases at a time. Those that are in one mode run side by side up to the guard that ends it for each;
then mode selection (`dalembert.contacts.contact_decisions`) selects their next modes. A case leaves the loop when it
ends, or when it enters a mode that has not been compiled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..events.event_rules import recorded_after
from ..lanes.sweep_arguments import SweepArguments
from ..methods.status import RUNNING, Status
from ..subset.arguments import place_of
from ..subset.compiled_subset import call_code, call_test, compiled_subset, row, take
from ..threads import STOPPED
from .contact_cases import UNDECIDED, slip_begins
from .phase_ends import count_phase, ended, may_meet
from .phase_stops import begin_stops, goes_to, load_case, pass_stops
from .phase_tables import (
    JUMPS,
    NO_RUNNER,
    NOT_STARTED,
    CaseTable,
    PhasePlan,
    PhaseProgress,
    ThreadWorkspace,
)


class PhaseArguments(NamedTuple):
    """Arguments of the loop."""

    plan: PhasePlan
    table: CaseTable
    space: ThreadWorkspace


_SUCCESS, _INITIAL_STATE = int(Status.SUCCESS), int(Status.INITIAL_STATE)
_COUNT = place_of(SweepArguments, "shape.cases")


# -- running -----------------------------------------------------------------------------------


@compiled_subset
def _gather(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace, runner: int, size: int) -> None:
    """Write what the chosen cases are made from to the columns of the loop over lanes."""
    gathered, cases, cut = space.gathered, table.cases, plan.runners.inside[runner] == 0
    p, added, last = cases.p.shape[1], cases.added.shape[1], gathered.shape[0] - 1
    for place in range(size):
        i = space.chosen[place]
        following = space.sampled[place] = table.numbers.next[i]
        begin_stops(table, i)
        goal = table.t_eval[following] if cut and following < table.t_eval.size else table.t1[i]
        gathered[0, place], gathered[1, place] = cases.t[i], goes_to(table, i, goal)
        gathered[last, place] = 1.0 if table.t1[i] >= cases.t[i] else -1.0
        for m in range(p):
            gathered[2 + m, place] = cases.p[i, m]
        for m in range(added):
            gathered[2 + p + m, place] = cases.added[i, m]
        for m in range(cases.x.shape[1]):
            gathered[2 + p + added + m, place] = cases.x[i, m]
        for m in range(table.totals.shape[1]):
            space.totals[place, m] = table.totals[i, m]


@compiled_subset
def _reset(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace, runner: int, size: int) -> None:
    """Prepare a run of the gathered cases: events of users continue to be counted, and no guard has fired."""
    requested, events = 3 * plan.terminal.size, plan.runners.events[runner]
    for place in range(size):
        first, i = place * 3 * events, space.chosen[place]
        for m in range(requested):
            space.happened[first + m] = table.occurred[i, m]
        for m in range(requested, 3 * events, 3):
            space.happened[first + m] = 0.0
            space.happened[first + m + 1] = space.happened[first + m + 2] = math.nan
        if table.carried.shape[0] > 0:
            for m in range(2 * events):
                space.carried[place * 2 * events + m] = table.carried[i, m]
    space.turns[runner] = 0
    space.packed_args[runner, _COUNT] = size


@compiled_subset
def _expand(plan: PhasePlan, space: ThreadWorkspace, runner: int, first: int, size: int) -> None:
    """Compute coordinates and rates of as many cases from one on as there are lanes, at the ends of their runs."""
    n, expand = plan.runners.size[runner], plan.runners.expand[runner]
    for lane in range(space.clock.shape[1]):
        place = min(first + lane, size - 1)
        space.clock[0, lane] = space.ends[place, 0]
        for m in range(n):
            space.states[m, lane] = space.y[place * n + m]
            if expand == 0:
                space.posed[m, lane] = space.states[m, lane]
        for m in range(plan.runners.parameters[runner]):
            space.constants[m, lane] = space.gathered[plan.columns[runner, m], place]
    if expand != 0:
        call_code(expand, row(space.clock, 0), row(space.states, 0), row(space.constants, 0), 0, row(space.posed, 0))


# -- decisions ---------------------------------------------------------------------------------


@compiled_subset
def _decide(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace) -> None:
    """Put the marked cases into their next modes: again after an impact, with the numbers for the new rates."""
    lanes, pending = space.clock.shape[1], True
    while pending:
        for lane in range(lanes):
            if space.deciding[lane] >= 0:
                load_case(table, space, space.deciding[lane], lane)
        clock, posed, scene = row(space.clock, 0), row(space.posed, 0), row(space.scene, 0)
        call_code(plan.contact_data, clock, posed, scene, 0, row(space.data, 0))
        for lane in range(lanes):
            if space.deciding[lane] >= 0:
                for m in range(space.data.shape[0]):
                    space.values[lane, m] = space.data[m, lane]
        call_test(plan.decide, row(space.decision, 0), 0, 0, 0, 0)
        pending = False
        for lane in range(lanes):
            if space.deciding[lane] >= 0 and space.ending[lane] != 0:  # a contact has met at the end
                count_phase(table, space.deciding[lane], space.ending[lane] - 1)
            space.ending[lane] = 0
            if space.deciding[lane] >= 0 and space.after_impact[lane] == 0:
                _enter_phase(plan, table, space.deciding[lane])
                space.deciding[lane] = NO_RUNNER
            pending = pending or space.deciding[lane] >= 0


@compiled_subset
def _runner(plan: PhasePlan, table: CaseTable, i: int) -> int:
    """Return the runner of the mode and phase of a case; -1 where there is none."""
    begins = 1 if slip_begins(table.cases, i) else 0
    for runner in range(plan.runners.mode.size):
        if plan.runners.mode[runner] == table.cases.number[i] and plan.runners.begins[runner] != 1 - begins:
            return runner
    return NO_RUNNER


@compiled_subset
def _enter_phase(plan: PhasePlan, table: CaseTable, i: int) -> None:
    """Start a phase of a case in the selected mode; one that cannot start is not counted."""
    numbers, table.t0[i], failed = table.numbers, table.cases.t[i], table.cases.status[i] != _SUCCESS
    for m in range(0, table.carried.shape[1], 2):
        table.carried[i, m] = math.nan
    if failed or table.cases.t[i] == table.t1[i]:
        numbers.state[i] = table.cases.status[i]
        if table.cases.passed[i] != 0.0:
            numbers.phases[i] -= 1
    if not failed:
        numbers.runner[i] = _runner(plan, table, i)
        if table.log.shape[0] > 0:
            _log(table, i)


@compiled_subset
def _log(table: CaseTable, i: int) -> None:
    """Record the start of a phase of the only case."""
    log, numbers, cases, line = table.log, table.numbers, table.cases, table.numbers.logged[i]
    numbers.logged[i] += 1
    added, n = cases.added.shape[1], cases.x.shape[1]
    log[line, 0], log[line, 1] = cases.t[i], float(cases.number[i])
    for m in range(added):
        log[line, 2 + m] = cases.added[i, m]
    for m in range(n):
        log[line, 2 + added + m] = cases.x[i, m]
    if line + 1 == log.shape[0]:
        numbers.runner[i] = NO_RUNNER


@compiled_subset
def _place_sample(table: CaseTable, i: int, t: float) -> int:
    """Record time and mode of the next sample of a case; return its place."""
    numbers, cases, samples = table.numbers, table.cases, table.samples
    place = i * table.t_eval.size + numbers.next[i]
    samples.t[place], samples.number[place], samples.history[place] = t, cases.number[i], numbers.history[i]
    for m in range(cases.added.shape[1]):
        samples.added[place, m] = cases.added[i, m]
    numbers.next[i] += 1
    return place


@compiled_subset
def _take_samples(table: CaseTable, space: ThreadWorkspace, place: int) -> None:
    """Complete the samples that the run of a case has recorded before its end."""
    i = space.chosen[place]
    while table.numbers.next[i] < space.sampled[place]:
        _place_sample(table, i, table.t_eval[table.numbers.next[i]])


@compiled_subset
def _drop_samples(table: CaseTable, i: int) -> None:
    """Drop the samples of a case that show its motion from the present time on: something occurs at it."""
    numbers, samples, count = table.numbers, table.samples, table.t_eval.size
    forward, t = 1.0 if table.cases.span[i] >= 0.0 else -1.0, table.cases.t[i]
    while numbers.next[i] > 0 and recorded_after(table.t_last[numbers.next[i] - 1], t, forward):
        numbers.next[i] -= 1
        place = i * count + numbers.next[i]
        samples.t[place], samples.number[place] = math.nan, UNDECIDED
        for m in range(samples.x.shape[1]):
            samples.x[place, m] = math.nan


@compiled_subset
def _sample(table: CaseTable, i: int) -> None:
    """Record the samples that a case has reached, those at the present time anew: it may be that of an impact."""
    numbers, count, cases = table.numbers, table.t_eval.size, table.cases
    forward, t = 1.0 if cases.span[i] >= 0.0 else -1.0, cases.t[i]
    _drop_samples(table, i)
    while numbers.next[i] < count and (table.t_eval[numbers.next[i]] - t) * forward <= 0.0:
        place = _place_sample(table, i, t)
        for m in range(cases.x.shape[1]):
            table.samples.x[place, m] = cases.x[i, m]


# -- cases ---------------------------------------------------------------------------------------


@compiled_subset
def _choose(table: CaseTable, space: ThreadWorkspace, begin: int, end: int) -> int:
    """Choose those of some cases that are to begin, or that continue in one mode, the first found; return how many."""
    size, runner, numbers = 0, NO_RUNNER, table.numbers
    for place in range(begin, end):
        i = table.order[place]
        able = numbers.runner[i] >= 0 or numbers.runner[i] == NOT_STARTED
        if numbers.state[i] == RUNNING and able and (size == 0 or numbers.runner[i] == runner):
            runner = numbers.runner[i]
            space.chosen[size] = i
            size += 1
    return size


@compiled_subset
def _conclude(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace, runner: int, first: int, size: int) -> None:
    """Record how a pack of cases ended their runs, if they had any, and select their next modes."""
    changes, starts, here = False, runner == NOT_STARTED, min(space.clock.shape[1], size - first)
    if not starts:
        _expand(plan, space, runner, first, size)
    for lane in range(space.clock.shape[1]):
        space.deciding[lane] = space.reaching[0, lane] = NO_RUNNER
        space.ending[lane] = 0
        if lane < here:
            i = space.chosen[first + lane]
            if starts:
                begin_stops(table, i)
            else:
                _take_samples(table, space, first + lane)
            if starts or ended(plan, table, space, runner, first + lane, lane):
                space.deciding[lane], changes = i, True
            elif may_meet(table, i):
                space.deciding[lane], space.ending[lane], changes = i, 1 + table.cases.number[i], True
            if table.numbers.state[i] == RUNNING:
                space.reaching[0, lane] = i
    pass_stops(table, space)
    if changes:
        _decide(plan, table, space)
    for lane in range(here):
        i = space.chosen[first + lane]
        state, jumps = table.numbers.state[i], table.numbers.runner[i] == JUMPS
        if state == _SUCCESS or (state == RUNNING and not jumps) or (starts and state != _INITIAL_STATE):
            _sample(table, i)
        elif jumps:
            _drop_samples(table, i)


@compiled_subset
def _run(plan: PhasePlan, table: CaseTable, space: ThreadWorkspace) -> int:
    """Run a phase of the chosen cases, or start them; return 1 where that has paused, and is to be continued."""
    progress, runner = space.progress, table.numbers.runner[space.chosen[0]]
    if runner != NOT_STARTED:
        if progress.paused == 0:
            _gather(plan, table, space, runner, progress.size)
            _reset(plan, table, space, runner, progress.size)
        paused = call_test(space.entries[runner], row(space.packed_args, runner), 0, 0, 0, 0)
        if space.turns[runner] >= STOPPED or paused != 0:  # a run that was stopped leaves no valid results
            return 1
    first = 0
    while first < progress.size:
        _conclude(plan, table, space, runner, first, progress.size)
        first += space.clock.shape[1]
    return 0


@compiled_subset
def _take(table: CaseTable, progress: PhaseProgress, share: int) -> bool:
    """Take the next cases; return whether there are any."""
    progress.first = take(table.turn, share)
    progress.last = min(progress.first + share, table.turn[1])
    return progress.first < table.turn[1]


@compiled_subset
def LOOP(arguments: PhaseArguments) -> int:
    """Run cases until all have ended, or have no runner; return 1 where it has paused."""
    plan, table, space = arguments.plan, arguments.table, arguments.space
    share, progress = space.gathered.shape[1], space.progress
    while progress.paused != 0 or _take(table, progress, share):
        while True:
            if progress.paused != 1:
                progress.paused = 0
                progress.size = _choose(table, space, progress.first, progress.last)
            if progress.size == 0:
                break
            progress.paused = _run(plan, table, space)
            if progress.paused != 0:
                return 1
            progress.phases += 1
            if progress.phases == progress.patience:
                progress.phases, progress.paused = 0, 2
                return 1
    return 0
