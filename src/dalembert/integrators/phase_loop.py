"""Many motions with contacts, phase after phase: what `dalembert.runtime.hybrid.sweeping` does, as compiled code.

A thread takes some cases at a time. Those that are in one mode run side by side up to what ends it for each; then the
verdict of a kernel (`dalembert.reduction.verdicts`) says how each goes on. A case stays here as long as that is sure;
what is not, and what has no kernel, is left to the caller.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..interrupts import STOPPED
from ..methods.status import Status
from .arguments import place_of
from .compiled_subset import call_code, call_test, compiled_subset, lowest, row, take
from .events import SOON as SOON_SHARE
from .events import SOON_IN_A_ROW
from .lane_loop import SweepArguments
from .mode_selection import NOISE, chosen, go_on, pose
from .phase_tables import NOTHING_FIRED, Bench, Fleet, Plan
from .workspace import RUNNING

__all__ = ["LOOP", "PhaseArguments"]


class PhaseArguments(NamedTuple):
    """Arguments of the loop."""

    plan: Plan
    fleet: Fleet
    bench: Bench


_SUCCESS, _EVENT = int(Status.SUCCESS), int(Status.EVENT)
_IMPOSSIBLE, _ACCUMULATE = int(Status.CONTACT_IMPOSSIBLE), int(Status.EVENTS_ACCUMULATE)
_NOBODY = -1
_COUNT = place_of(SweepArguments, "shape.cases")


@compiled_subset
def _goes_on(fleet: Fleet, i: int) -> bool:
    """Return whether a case can run on here."""
    numbers = fleet.numbers
    return numbers.state[i] == RUNNING and numbers.station[i] >= 0 and numbers.fired[i] == NOTHING_FIRED


@compiled_subset
def _gather(fleet: Fleet, bench: Bench, size: int) -> None:
    """Write what the chosen cases are made from to the columns of the loop over lanes."""
    gathered = bench.gathered
    p, k, n = fleet.p.shape[1], fleet.sides.shape[1], fleet.x.shape[1]
    for place in range(size):
        i = bench.chosen[place]
        following = fleet.numbers.next[i]
        gathered[0, place] = fleet.t[i]
        gathered[1, place] = fleet.t1[i]
        if following < fleet.t_eval.size:
            gathered[1, place] = fleet.t_eval[following]
        for m in range(p):
            gathered[2 + m, place] = fleet.p[i, m]
        for m in range(2 * k):
            gathered[2 + p + m, place] = fleet.directions[i, m]
        for m in range(k):
            gathered[2 + p + 2 * k + m, place] = fleet.sides[i, m]
        for m in range(n):
            gathered[2 + p + 3 * k + m, place] = fleet.x[i, m]


@compiled_subset
def _run(plan: Plan, bench: Bench, station: int, size: int) -> None:
    """Run the gathered cases up to what ends the mode of each."""
    for e in range(size * plan.stations.events[station]):
        bench.happened[3 * e] = 0.0
        bench.happened[3 * e + 1] = bench.happened[3 * e + 2] = math.nan
    bench.turns[station] = 0
    bench.packed_args[station, _COUNT] = size
    call_test(bench.entries[station], row(bench.packed_args, station), 0, 0, 0, 0)


@compiled_subset
def _expanded(plan: Plan, bench: Bench, station: int, first: int, size: int) -> None:
    """Compute coordinates, rates and slip velocities of as many cases from one on as there are lanes."""
    n = plan.stations.size[station]
    for lane in range(bench.clock.shape[1]):
        place = min(first + lane, size - 1)
        bench.clock[0, lane] = bench.ends[place, 0]
        for m in range(n):
            bench.states[m, lane] = bench.y[place * n + m]
        for m in range(plan.stations.parameters[station]):
            bench.constants[m, lane] = bench.gathered[plan.columns[station, m], place]
        for m in range(bench.scene.shape[0]):
            bench.scene[m, lane] = bench.gathered[2 + m, place]
    clock, posed = row(bench.clock, 0), row(bench.posed, 0)
    expand = plan.stations.expand[station]
    call_code(expand, clock, row(bench.states, 0), row(bench.constants, 0), 0, posed)
    call_code(plan.slips, clock, posed, row(bench.scene, 0), 0, row(bench.slips, 0))


@compiled_subset
def _happened(plan: Plan, fleet: Fleet, bench: Bench, i: int, first: int, t: float) -> bool:
    """Join the events that were asked for to those before; return whether one of them ends the case at a time."""
    over = False
    for e in range(plan.terminal.size):
        count, last = bench.happened[first + 3 * e], bench.happened[first + 3 * e + 2]
        fleet.occurred[i, 3 * e] += count
        if count > 0.0:
            if math.isnan(fleet.occurred[i, 3 * e + 1]):
                fleet.occurred[i, 3 * e + 1] = bench.happened[first + 3 * e + 1]
            fleet.occurred[i, 3 * e + 2] = last
            over = over or (plan.terminal[e] != 0 and last == t)
    return over


@compiled_subset
def _ended(plan: Plan, fleet: Fleet, bench: Bench, station: int, place: int, lane: int) -> int:
    """Take down how a case ended its run; return the rule for how it goes on, or -1 where there is none, or no need."""
    i, t, status = bench.chosen[place], bench.ends[place, 0], int(bench.ends[place, 1])
    numbers, events, asked = fleet.numbers, plan.stations.events[station], plan.terminal.size
    numbers.steps[i] += int(bench.ends[place, 2])
    numbers.cause[i] = 0
    for m in range(fleet.x.shape[1]):
        fleet.x[i, m] = bench.posed[m, lane]
    fleet.passed[i], fleet.t[i] = t - fleet.t[i], t
    first = place * 3 * events
    over = _happened(plan, fleet, bench, i, first, t)
    if status == _SUCCESS:
        numbers.station[i] = plan.stations.plain[station]
        if t == fleet.t1[i]:
            numbers.state[i] = _SUCCESS
        return _NOBODY
    if status != _EVENT or over:
        numbers.state[i] = status
        return _NOBODY
    fired = 0
    for e in range(asked, events):
        if bench.happened[first + 3 * e + 2] == t:
            fired += 1 << (e - asked)
    if fired & plan.stations.paradox[station] != 0:
        numbers.state[i] = _IMPOSSIBLE
        return _NOBODY
    numbers.soon[i] = numbers.soon[i] + 1 if abs(fleet.passed[i]) <= SOON_SHARE * abs(fleet.span[i]) else 0
    if numbers.soon[i] >= SOON_IN_A_ROW:
        numbers.state[i] = _ACCUMULATE
        return _NOBODY
    numbers.phases[i] += 1
    numbers.fired[i] = fired
    return _rule(plan, fleet, bench, station, fired, i, lane)


@compiled_subset
def _rule(plan: Plan, fleet: Fleet, bench: Bench, station: int, fired: int, i: int, lane: int) -> int:
    """Return the rule for a case, -1 where there is none."""
    sliding = 0
    for m in range(fleet.sides.shape[1]):
        slip = abs(bench.slips[m, lane])
        fleet.speeds[i, m] = max(fleet.speeds[i, m], slip)
        if not slip <= NOISE * fleet.speeds[i, m]:
            sliding += 1 << m
    for rule in range(plan.rules.station.size):
        if plan.rules.station[rule] == station and plan.rules.fired[rule] == fired:
            if plan.rules.sliding[rule] == sliding:
                return rule
    return _NOBODY


@compiled_subset
def _sample(fleet: Fleet, i: int) -> None:
    """Take down the samples that a case has reached."""
    numbers, wanted = fleet.numbers, fleet.t_eval.size
    forward = 1.0 if fleet.span[i] >= 0.0 else -1.0
    while numbers.next[i] < wanted and (fleet.t_eval[numbers.next[i]] - fleet.t[i]) * forward <= 0.0:
        place = i * wanted + numbers.next[i]
        fleet.sampled_t[place], fleet.sampled_mode[place] = fleet.t[i], numbers.mode[i]
        for m in range(fleet.x.shape[1]):
            fleet.sampled_x[place, m] = fleet.x[i, m]
        for m in range(fleet.sides.shape[1]):
            fleet.sampled_directions[place, 2 * m] = fleet.directions[i, 2 * m]
            fleet.sampled_directions[place, 2 * m + 1] = fleet.directions[i, 2 * m + 1]
            fleet.sampled_sides[place, m] = fleet.sides[i, m]
        numbers.next[i] += 1


@compiled_subset
def _decide(plan: Plan, fleet: Fleet, bench: Bench, first: int, pending: int) -> None:
    """Decide how those lanes go on, given as bits, that have a rule: all that have the same together."""
    while pending != 0:
        rule, left, mine = bench.rules[lowest(pending)], pending, 0
        while left != 0:
            lane = lowest(left)
            left &= left - 1
            if bench.rules[lane] == rule:
                mine += 1 << lane
                pose(plan, fleet, bench, rule, bench.chosen[first + lane], lane)
        clock, posed, scene = row(bench.clock, 0), row(bench.posed, 0), row(bench.scene, 0)
        call_code(plan.rules.code[rule], clock, posed, scene, 0, row(bench.verdict, 0))
        pending -= mine
        while mine != 0:
            lane = lowest(mine)
            mine &= mine - 1
            i, attempt = bench.chosen[first + lane], chosen(plan, bench, rule, lane)
            if attempt < 0:
                continue
            go_on(plan, fleet, bench, attempt, i, lane)
            fleet.numbers.mode[i] = plan.attempts.mode[attempt]
            fleet.numbers.station[i] = plan.attempts.station[attempt]
            fleet.numbers.cause[i], fleet.numbers.fired[i] = plan.rules.cause[rule], NOTHING_FIRED
            if fleet.log.shape[0] > 0:
                _log(fleet, i)
            if fleet.t[i] == fleet.t1[i]:
                fleet.numbers.state[i] = _SUCCESS
                fleet.numbers.phases[i] -= 1


@compiled_subset
def _log(fleet: Fleet, i: int) -> None:
    """Take down how the only case begins a phase."""
    log, numbers, line = fleet.log, fleet.numbers, fleet.numbers.phases[i] - 1
    k, n = fleet.sides.shape[1], fleet.x.shape[1]
    log[line, 0], log[line, 1] = fleet.t[i], float(numbers.mode[i])
    log[line, 2], log[line, 3] = float(numbers.cause[i]), float(numbers.soon[i])
    for m in range(k):
        log[line, 4 + m], log[line, 4 + k + m] = fleet.directions[i, 2 * m], fleet.sides[i, m]
        log[line, 4 + 2 * k + m] = fleet.speeds[i, m]
    for m in range(n):
        log[line, 4 + 3 * k + m] = fleet.x[i, m]
    if line + 1 == log.shape[0]:
        numbers.station[i] = _NOBODY


@compiled_subset
def LOOP(arguments: PhaseArguments) -> None:
    """Carry cases on until all have ended, or wait for a decision, or have no station."""
    plan, fleet, bench = arguments.plan, arguments.fleet, arguments.bench
    share, count, lanes = bench.gathered.shape[1], fleet.order.size, bench.clock.shape[1]
    while True:
        begin = take(fleet.turn, share)
        if begin >= count:
            break
        end = min(begin + share, count)
        while True:
            station, size = _NOBODY, 0
            for place in range(begin, end):
                i = fleet.order[place]
                if _goes_on(fleet, i) and (size == 0 or fleet.numbers.station[i] == station):
                    station = fleet.numbers.station[i]
                    bench.chosen[size] = i
                    size += 1
            if size == 0:
                break
            _gather(fleet, bench, size)
            _run(plan, bench, station, size)
            if bench.turns[station] >= STOPPED:  # what the run left is nothing to go by
                break
            first = 0
            while first < size:
                _expanded(plan, bench, station, first, size)
                pending, here = 0, min(lanes, size - first)
                for lane in range(here):
                    bench.rules[lane] = _ended(plan, fleet, bench, station, first + lane, lane)
                    if bench.rules[lane] >= 0:
                        pending += 1 << lane
                _decide(plan, fleet, bench, first, pending)
                for lane in range(here):
                    i = bench.chosen[first + lane]
                    state = fleet.numbers.state[i]
                    if (state == RUNNING or state == _SUCCESS) and fleet.numbers.fired[i] == NOTHING_FIRED:
                        _sample(fleet, i)
                first += lanes
