"""Many motions with contacts, phase after phase: what `dalembert.runtime.hybrid.sweeping` does, as compiled code.

A thread takes some cases at a time. Those that are in one mode run side by side up to what ends it for each; then the
verdict of a kernel (`dalembert.reduction.verdicts`) says how each goes on. A case stays here as long as that is sure;
what is not, and what has no kernel, is left to the caller.
"""

from __future__ import annotations

import math

from ..interrupts import STOPPED
from ..methods.status import Status
from .compiled_subset import bare, call_code, call_test, lowest, row, take
from .events import SOON as SOON_SHARE
from .events import SOON_IN_A_ROW
from .mode_selection import NOISE, chosen, go_on, pose
from .phase_tables import (
    ATTEMPT_MODE,
    ATTEMPT_STATION,
    BENCH,
    CAUSE,
    CODE,
    EVENTS,
    EXPAND,
    FIRED,
    FLEET,
    MODE,
    NEXT,
    NOTHING_FIRED,
    PARADOX,
    PARAMETERS,
    PHASES,
    PLAIN,
    PLAN,
    RULE_CAUSE,
    RULE_FIRED,
    RULE_SLIDING,
    RULE_STATION,
    SIZE,
    SOON,
    STATE,
    STATION,
    STEPS,
    Bench,
    Fleet,
    Plan,
)
from .workspace import RUNNING

__all__ = ["KINDS", "LOOP"]

KINDS = (PLAN, FLEET, BENCH)

_SUCCESS, _EVENT = int(Status.SUCCESS), int(Status.EVENT)
_IMPOSSIBLE, _ACCUMULATE = int(Status.CONTACT_IMPOSSIBLE), int(Status.EVENTS_ACCUMULATE)
_NOBODY = -1


@bare
def _goes_on(fleet: Fleet, i: int) -> bool:
    """Return whether a case can run on here."""
    whole = fleet.whole
    return whole[STATE, i] == RUNNING and whole[STATION, i] >= 0 and whole[FIRED, i] == NOTHING_FIRED


@bare
def _gather(fleet: Fleet, bench: Bench, size: int) -> None:
    """Write what the chosen cases are made from to the columns of the loop over lanes."""
    gathered = bench.gathered
    p, k, n = fleet.p.shape[1], fleet.sides.shape[1], fleet.x.shape[1]
    for place in range(size):
        i = bench.chosen[place]
        following = fleet.whole[NEXT, i]
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


@bare
def _run(plan: Plan, bench: Bench, station: int, size: int) -> None:
    """Run the gathered cases up to what ends the mode of each."""
    for e in range(size * plan.stations[station, EVENTS]):
        bench.happened[3 * e] = 0.0
        bench.happened[3 * e + 1] = bench.happened[3 * e + 2] = math.nan
    bench.turns[station] = 0
    bench.words[station, plan.count_at] = size
    call_test(bench.entries[station], bench.addresses[station], 0, 0, 0, 0)


@bare
def _expanded(plan: Plan, bench: Bench, station: int, first: int, size: int) -> None:
    """Compute coordinates, rates and slip velocities of as many cases from one on as there are lanes."""
    n = plan.stations[station, SIZE]
    for lane in range(bench.clock.shape[1]):
        place = min(first + lane, size - 1)
        bench.clock[0, lane] = bench.ends[place, 0]
        for m in range(n):
            bench.states[m, lane] = bench.y[place * n + m]
        for m in range(plan.stations[station, PARAMETERS]):
            bench.constants[m, lane] = bench.gathered[plan.columns[station, m], place]
        for m in range(bench.scene.shape[0]):
            bench.scene[m, lane] = bench.gathered[2 + m, place]
    clock, posed = row(bench.clock, 0), row(bench.posed, 0)
    expand = plan.stations[station, EXPAND]
    call_code(expand, clock, row(bench.states, 0), row(bench.constants, 0), 0, posed)
    call_code(plan.slips, clock, posed, row(bench.scene, 0), 0, row(bench.slips, 0))


@bare
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


@bare
def _ended(plan: Plan, fleet: Fleet, bench: Bench, station: int, place: int, lane: int) -> int:
    """Take down how a case ended its run; return the rule for how it goes on, or -1 where there is none, or no need."""
    i, t, status = bench.chosen[place], bench.ends[place, 0], int(bench.ends[place, 1])
    whole, events, asked = fleet.whole, plan.stations[station, EVENTS], plan.terminal.size
    whole[STEPS, i] += int(bench.ends[place, 2])
    whole[CAUSE, i] = 0
    for m in range(fleet.x.shape[1]):
        fleet.x[i, m] = bench.posed[m, lane]
    fleet.passed[i], fleet.t[i] = t - fleet.t[i], t
    first = place * 3 * events
    over = _happened(plan, fleet, bench, i, first, t)
    if status == _SUCCESS:
        whole[STATION, i] = plan.stations[station, PLAIN]
        if t == fleet.t1[i]:
            whole[STATE, i] = _SUCCESS
        return _NOBODY
    if status != _EVENT or over:
        whole[STATE, i] = status
        return _NOBODY
    fired = 0
    for e in range(asked, events):
        if bench.happened[first + 3 * e + 2] == t:
            fired += 1 << (e - asked)
    if fired & plan.stations[station, PARADOX] != 0:
        whole[STATE, i] = _IMPOSSIBLE
        return _NOBODY
    whole[SOON, i] = whole[SOON, i] + 1 if abs(fleet.passed[i]) <= SOON_SHARE * abs(fleet.span[i]) else 0
    if whole[SOON, i] >= SOON_IN_A_ROW:
        whole[STATE, i] = _ACCUMULATE
        return _NOBODY
    whole[PHASES, i] += 1
    whole[FIRED, i] = fired
    return _rule(plan, fleet, bench, station, fired, i, lane)


@bare
def _rule(plan: Plan, fleet: Fleet, bench: Bench, station: int, fired: int, i: int, lane: int) -> int:
    """Return the rule for a case, -1 where there is none."""
    sliding = 0
    for m in range(fleet.sides.shape[1]):
        slip = abs(bench.slips[m, lane])
        fleet.speeds[i, m] = max(fleet.speeds[i, m], slip)
        if not slip <= NOISE * fleet.speeds[i, m]:
            sliding += 1 << m
    for rule in range(plan.rules.shape[0]):
        if plan.rules[rule, RULE_STATION] == station and plan.rules[rule, RULE_FIRED] == fired:
            if plan.rules[rule, RULE_SLIDING] == sliding:
                return rule
    return _NOBODY


@bare
def _sample(fleet: Fleet, i: int) -> None:
    """Take down the samples that a case has reached."""
    whole, wanted = fleet.whole, fleet.t_eval.size
    forward = 1.0 if fleet.span[i] >= 0.0 else -1.0
    while whole[NEXT, i] < wanted and (fleet.t_eval[whole[NEXT, i]] - fleet.t[i]) * forward <= 0.0:
        place = i * wanted + whole[NEXT, i]
        fleet.sampled_t[place], fleet.sampled_mode[place] = fleet.t[i], whole[MODE, i]
        for m in range(fleet.x.shape[1]):
            fleet.sampled_x[place, m] = fleet.x[i, m]
        for m in range(fleet.sides.shape[1]):
            fleet.sampled_directions[place, 2 * m] = fleet.directions[i, 2 * m]
            fleet.sampled_directions[place, 2 * m + 1] = fleet.directions[i, 2 * m + 1]
            fleet.sampled_sides[place, m] = fleet.sides[i, m]
        whole[NEXT, i] += 1


@bare
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
        call_code(plan.rules[rule, CODE], clock, posed, scene, 0, row(bench.verdict, 0))
        pending -= mine
        while mine != 0:
            lane = lowest(mine)
            mine &= mine - 1
            i, attempt = bench.chosen[first + lane], chosen(plan, bench, rule, lane)
            if attempt < 0:
                continue
            go_on(plan, fleet, bench, attempt, i, lane)
            fleet.whole[MODE, i] = plan.attempts[attempt, ATTEMPT_MODE]
            fleet.whole[STATION, i] = plan.attempts[attempt, ATTEMPT_STATION]
            fleet.whole[CAUSE, i], fleet.whole[FIRED, i] = plan.rules[rule, RULE_CAUSE], NOTHING_FIRED
            if fleet.log.shape[0] > 0:
                _log(fleet, i)
            if fleet.t[i] == fleet.t1[i]:
                fleet.whole[STATE, i] = _SUCCESS
                fleet.whole[PHASES, i] -= 1


@bare
def _log(fleet: Fleet, i: int) -> None:
    """Take down how the only case begins a phase."""
    log, whole, line = fleet.log, fleet.whole, fleet.whole[PHASES, i] - 1
    k, n = fleet.sides.shape[1], fleet.x.shape[1]
    log[line, 0], log[line, 1] = fleet.t[i], float(whole[MODE, i])
    log[line, 2], log[line, 3] = float(whole[CAUSE, i]), float(whole[SOON, i])
    for m in range(k):
        log[line, 4 + m], log[line, 4 + k + m] = fleet.directions[i, 2 * m], fleet.sides[i, m]
        log[line, 4 + 2 * k + m] = fleet.speeds[i, m]
    for m in range(n):
        log[line, 4 + 3 * k + m] = fleet.x[i, m]
    if line + 1 == log.shape[0]:
        whole[STATION, i] = _NOBODY


@bare
def LOOP(plan: Plan, fleet: Fleet, bench: Bench) -> None:
    """Carry cases on until all have ended, or wait for a decision, or have no station."""
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
                if _goes_on(fleet, i) and (size == 0 or fleet.whole[STATION, i] == station):
                    station = fleet.whole[STATION, i]
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
                    state = fleet.whole[STATE, i]
                    if (state == RUNNING or state == _SUCCESS) and fleet.whole[FIRED, i] == NOTHING_FIRED:
                        _sample(fleet, i)
                first += lanes
