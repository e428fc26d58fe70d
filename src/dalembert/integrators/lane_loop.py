"""Many cases side by side: every lane of a pack is a case with its own time, step and status.

A lane whose case has ended takes the next one at once, so cases of unequal length do not wait for each
other. Lanes never mix: what a case computes does not depend on its neighbours, to the last bit.

One loop serves every step kernel. A Taylor step chooses its size, never fails to reach it and remembers at most that
size, which is 0 in the beginning; an attempt of a Runge-Kutta step may be rejected, and what it remembers travels
behind the state (`dalembert.transforms.runge_kutta`). Threads run the loop on the same arrays, and take a few cases
at a time from a count that they share.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..interrupts import STOPPED
from ..methods.status import Status
from ..methods.step_constants import REDUCTION_BLIND
from .arguments import FlagMatrix, IntVector, Matrix, Vector
from .case_loading import CaseShape, Columns, SweepKernels, enter_lane, load_cases
from .compiled_subset import call_code, call_test, compiled_subset, fma, lowest, row, take
from .event_search import BROKEN, NOTHING, begin_signs, resolve, scan, starts, state_at, zeros_at_end
from .event_series import calm, follow, keeps_signs, plain
from .projection import FAILED, NONE, WANTED, correct
from .step_control import smallest_step
from .step_reductions import accumulate, advance
from .workspace import (
    ATTEMPTS,
    BEFORE,
    END,
    FIRST,
    IDLE,
    NEXT,
    NOW,
    POINT_LANES,
    REFUSED,
    RUNNING,
    EventKernels,
    EventWorkspace,
    LaneState,
)

__all__ = ["LOOP", "SweepArguments", "sweeping"]

_SUCCESS, _MAX_STEPS = int(Status.SUCCESS), int(Status.MAX_STEPS)
_NON_FINITE, _STEP_TOO_SMALL = int(Status.NON_FINITE), int(Status.STEP_TOO_SMALL)
_PROJECTION_FAILED, _EVENT_NON_FINITE = int(Status.PROJECTION_FAILED), int(Status.EVENT_NON_FINITE)


class SweepArguments(NamedTuple):
    """Arguments of the loop over lanes.

    Attributes
    ----------
    limits : (1, ...)
        The largest step, the number of steps, and what else the step reads behind step and direction.
    turn : (1,)
        The next case, shared by threads.
    t_eval : (m,)
        Times to record.
    out, ends, samples : (k, n_y), (k, 3), (k, m * n_y)
        Get final states; final time, status and steps; states at the times to record.
    inside : (k, m) or (0, 0)
        Gets the samples that were interpolated.
    kept_constants : (k, n_c) or (0, 0)
        Gets the constants.
    happened : (k, 3 n_events)
        Gets numbers of the events, and the times of the first and the last.
    totals : (k, n_running)
        Minima, maxima and integrals are continued in it. With events or any of these, a step writes its polynomials.
    """

    kernels: SweepKernels
    shape: CaseShape
    limits: Matrix
    columns: Columns
    turn: IntVector
    t_eval: Vector
    out: Matrix
    ends: Matrix
    samples: Matrix
    inside: FlagMatrix
    kept_constants: Matrix
    state: LaneState
    events: EventKernels
    workspace: EventWorkspace
    happened: Matrix
    totals: Matrix


@compiled_subset
def _follow(series: FloatArray, lane: int, states: FloatArray, first: int, scale: float, end: int) -> None:
    """Copy the polynomials of a lane's step, in the fraction of the step, made to end in the state that it ended in."""
    n, terms = series.shape
    for m in range(n):
        power, total = 1.0, 0.0
        for k in range(terms):
            value = states[first + m * terms + k, lane] * power
            series[m, k] = value
            total += value
            power *= scale
        gap = states[end + m, lane] - total
        series[m, 2] += 3.0 * gap
        series[m, 3] -= 2.0 * gap


def sweeping(watched: bool, projected: bool) -> Callable[[SweepArguments], None]:
    """Return the loop, with or without events and reductions, and with or without projections."""

    def loop(arguments: SweepArguments) -> None:
        kernels, shape, limits, columns = arguments.kernels, arguments.shape, arguments.limits, arguments.columns
        turn, t_eval, out, ends = arguments.turn, arguments.t_eval, arguments.out, arguments.ends
        samples, inside, kept_constants = arguments.samples, arguments.inside, arguments.kept_constants
        lane_state, events, space = arguments.state, arguments.events, arguments.workspace
        happened, totals = arguments.happened, arguments.totals
        step, begin, position, velocity = kernels.step, kernels.begin, kernels.position, kernels.velocity
        advance_lanes = kernels.advance
        degree, memory, checks, count, share = shape.degree, shape.memory, shape.checks, shape.cases, shape.share
        clock, settings, constants = lane_state.clock, lane_state.settings, lane_state.constants
        states, tally, numbers = lane_state.states, lane_state.tally, lane_state.numbers
        lanes, n = clock.shape[1], lane_state.delta.shape[0]
        time, end_of, upcoming = clock[NOW], clock[END], clock[NEXT]
        attempts, refused, before_of, first_of = tally[ATTEMPTS], tally[REFUSED], tally[BEFORE], tally[FIRST]
        case, status, mark, fresh_of = numbers.case, numbers.status, numbers.mark, numbers.fresh
        sampled_of, sampled_before = numbers.sampled, numbers.sampled_before
        reach, direction = settings[0], settings[1]
        n_c, wanted = kept_constants.shape[1], t_eval.size
        largest, budget = limits[0, 0], limits[0, 1]
        followed = events.followed if watched else 0
        points = 0 if watched and followed > 0 and events.kinds.size == 0 else POINT_LANES
        size_at = n + followed
        held, rows = size_at + 2 + memory, states.shape[0] // 2
        from_, copied = (n + checks, held) if begin != 0 else (0, n)
        marked, pause = inside.size > 0, lane_state.pause
        coming = last = loaded = filled = place = 0
        active, old, new, every = 0, 0, rows, (1 << lanes) - 1
        look, rounds, patience = every, -1, pause.patience
        if pause.going != 0:
            coming, last, loaded, filled = pause.coming, pause.last, pause.loaded, pause.filled
            place, active, old, look = pause.place, pause.active, pause.old, pause.look
            new = rows - old
            pause.going = 0
        else:
            for lane in range(lanes):
                case[lane], status[lane] = -1, IDLE
                for m in range(constants.shape[0]):
                    constants[m, lane] = 1.0
                for m in range(2, limits.shape[1]):
                    settings[m, lane] = lane_state.settings_ahead[m, lane] = limits[0, m]
        while True:
            rounds += 1
            if rounds == patience:
                rounds = 0
                if pause.returns != 0 or turn[0] >= STOPPED:
                    pause.coming, pause.last, pause.loaded, pause.filled = coming, last, loaded, filled
                    pause.place, pause.active, pause.old, pause.look = place, active, old, look
                    pause.going = 1
                    break
            left = look
            while left != 0:
                lane = lowest(left)
                left &= left - 1
                if watched and wanted == 0 and status[lane] == RUNNING:
                    reach[lane] = min(largest, abs(end_of[lane] - time[lane]))
                    continue
                while True:
                    if case[lane] >= 0:
                        i = case[lane]
                        sampled = sampled_of[lane]
                        while sampled < wanted and t_eval[sampled] == time[lane]:
                            for m in range(n):
                                samples[i, sampled * n + m] = states[old + m, lane]
                            sampled += 1
                        sampled_of[lane] = sampled
                        if status[lane] == RUNNING:
                            reach[lane] = min(largest, abs(end_of[lane] - time[lane]))
                            if sampled < wanted:
                                upcoming[lane] = t_eval[sampled]
                            else:
                                upcoming[lane] = end_of[lane]
                            break
                        for m in range(n):  # a case has ended: hand it in
                            out[i, m] = states[old + m, lane]
                        ends[i, 0], ends[i, 1] = time[lane], status[lane]
                        ends[i, 2] = attempts[lane] - refused[lane]
                        case[lane], status[lane] = -1, IDLE
                        reach[lane] = 0.0
                        active -= 1
                    if place == filled:  # all that were made ahead have been taken
                        if coming == last < count:
                            coming = min(take(turn, share), count)
                            last = min(coming + share, count)
                        if coming == last:
                            break
                        loaded, filled, place = coming, min(lanes, last - coming), 0
                        load_cases(kernels, shape, limits, columns, loaded, filled, lane_state)
                        coming += filled
                    i = loaded + place
                    if kept_constants.shape[0] > 0:
                        for m in range(n_c):
                            kept_constants[i, m] = lane_state.constants_ahead[m, place]
                    if numbers.loaded[place] != RUNNING:
                        for m in range(n):
                            out[i, m] = np.nan
                        ends[i, 0], ends[i, 1], ends[i, 2] = (
                            lane_state.clock_ahead[0, place],
                            numbers.loaded[place],
                            0.0,
                        )
                        place += 1
                        continue
                    states[old + size_at, lane] = 0.0
                    enter_lane(lane_state, lane, place, i, old, from_, copied)
                    if begin != 0:
                        for m in range(n):
                            states[old + m, lane] = lane_state.begun[m, place]
                    active += 1
                    if watched:
                        fresh_of[lane] = 1
                        for m in range(constants.shape[0]):
                            space.own[lane, m] = lane_state.constants_ahead[m, place]
                            for point in range(points):
                                space.constants[lane * constants.shape[0] + m, point] = space.own[lane, m]
                        for m in range(n):
                            space.one_point[0, m] = lane_state.begun[m, place]
                        starts(events, space, lane, time[lane], direction[lane], row(space.own, lane))
                    place += 1
            if active == 0:
                break
            call_code(step, row(clock, 0), row(states, old), row(constants, 0), row(settings, 0), row(states, new))
            look = every
            if advance_lanes != 0:
                if watched:
                    at, rest_of_it, setting = row(clock, 0), row(constants, 0), row(settings, 0)
                    call_code(events.quiet, at, row(states, new), rest_of_it, setting, row(space.over, 0))
                    for lane in range(lanes):
                        mark[lane], upcoming[lane] = NONE, end_of[lane]
                        if fresh_of[lane] != 0 or not keeps_signs(space, lane):
                            upcoming[lane] = time[lane]  # so that it is looked at
                look = call_test(
                    advance_lanes,
                    row(clock, 0),
                    row(states, new + size_at),
                    row(tally, 0),
                    row(settings, 0),
                    row(limits, 0),
                )
                if look == 0:
                    old, new = new, old
                    continue
            left = look
            while left != 0:
                lane = lowest(left)
                left &= left - 1
                mark[lane] = NONE
                if status[lane] != RUNNING:
                    continue
                now, size = time[lane], states[new + size_at, lane]
                rest = abs(end_of[lane] - now)
                broken = states[new + size_at + 1, lane] != 0.0
                smallest = smallest_step(now, rest)
                attempts[lane] += 1.0
                if memory > 0:
                    kept = size != 0.0
                    stuck = not kept and not states[new + n + 2, lane] >= smallest
                else:
                    stuck = broken or (size < rest and size < smallest)
                    kept = not stuck
                if not kept:
                    refused[lane] += 1.0
                if stuck:
                    status[lane] = _NON_FINITE if broken else _STEP_TOO_SMALL
                    for m in range(n):
                        states[new + m, lane] = states[old + m, lane]
                    continue
                if not kept:
                    if attempts[lane] >= budget:
                        status[lane] = _MAX_STEPS
                    continue
                t = end_of[lane] if size == rest else now + direction[lane] * size
                sampled = sampled_before[lane] = sampled_of[lane]
                while sampled < wanted and (t_eval[sampled] - t) * direction[lane] < 0.0:
                    x = t_eval[sampled] - now
                    if memory > 0:
                        x /= direction[lane] * size
                    for m in range(n):
                        value = 0.0
                        for k in range(degree, -1, -1):
                            value = fma(value, x, states[new + held + m * (degree + 1) + k, lane])
                        samples[case[lane], sampled * n + m] = value
                    if marked:
                        inside[case[lane], sampled] = True
                    sampled += 1
                sampled_of[lane] = sampled
                before_of[lane], time[lane], mark[lane] = now, t, WANTED
                if size == rest:
                    status[lane] = _SUCCESS
                elif attempts[lane] >= budget:
                    status[lane] = _MAX_STEPS
            old, new = new, old
            if not projected and not watched:
                continue
            if projected and (position != 0 or velocity != 0):
                correct(position, velocity, clock, states, old, constants, lane_state.delta, mark)
                for lane in range(lanes):
                    if mark[lane] != FAILED:
                        continue
                    # Go back to the state before the step, and try a smaller one where the step can.
                    before = before_of[lane]
                    size = REDUCTION_BLIND * abs(time[lane] - before)
                    for m in range(held):
                        states[old + m, lane] = states[new + m, lane]
                    time[lane], sampled_of[lane] = before, sampled_before[lane]
                    refused[lane] += 1.0
                    status[lane] = _PROJECTION_FAILED
                    if memory > 0 and size >= smallest_step(before, abs(end_of[lane] - before)):
                        status[lane] = RUNNING if attempts[lane] < budget else _MAX_STEPS
                        states[old + n + 2, lane], states[old + n + 4, lane] = size, 1.0
            if not watched:
                continue
            for lane in range(lanes):
                space.earlier[0, lane] = before_of[lane]
            at, rest_of_it, setting = row(space.earlier, 0), row(constants, 0), row(settings, 0)
            if space.over.shape[0] > 0 and advance_lanes == 0:
                call_code(events.quiet, at, row(states, old), rest_of_it, setting, row(space.over, 0))
            if space.quick.shape[0] > 0:
                call_code(events.quick, at, row(states, old), rest_of_it, setting, row(space.quick, 0))
            for lane in range(lanes):
                if mark[lane] != WANTED:
                    continue
                i, now, fresh = case[lane], before_of[lane], fresh_of[lane] != 0
                one, many = row(space.own, lane), row(space.constants, lane * constants.shape[0])
                h, scale = time[lane] - now, 1.0 if memory > 0 else time[lane] - now
                quiet, plainly, found, theta = True, False, NOTHING, 1.0
                for e in range(space.over.shape[0]):
                    keeps = space.over[e, lane] * space.signs[lane, e] > 0.0
                    keeps = keeps and not (fresh and space.zero[lane, e] != 0.0)
                    quiet = quiet and keeps
                    space.seen[lane, e] = 1.0 if quiet or (followed > 0 and keeps) else space.seen[lane, e]
                    space.open[0, e] = 0.0 if followed > 0 and keeps else 1.0
                if not quiet and followed > 0:
                    follow(space, lane, states, old + held + n * (degree + 1), h)
                    plainly = plain(space, lane, fresh)
                    quiet = plainly and calm(space, lane, now, h, fresh)
                if not quiet:
                    _follow(space.series, lane, states, old + held, scale, old)
                    found, theta = scan(events, space, lane, many, one, now, h, fresh, plainly, happened, i)
                fresh_of[lane] = 0
                ready = not quiet
                for e in range(events.kinds.size):
                    decided, total = advance(events.kinds[e], totals[i, e], space.quick, e, lane, h)
                    if found != NOTHING or not decided:
                        if not ready:
                            _follow(space.series, lane, states, old + held, scale, old)
                        ready = True
                        total = accumulate(events, space, many, one, now, h, theta, e, events.kinds[e], totals[i, e])
                    totals[i, e] = total
                if quiet:
                    continue
                if found == NOTHING:
                    if status[lane] != _SUCCESS:
                        continue
                    for m in range(n):
                        space.one_point[0, m] = states[old + m, lane]
                    end, forward = end_of[lane], direction[lane]
                    if not zeros_at_end(events, space, lane, end, forward, one, happened, i):
                        continue
                elif theta < 1.0:
                    state_at(space, n, theta, 0)
                    time[lane] = now + theta * h
                    for m in range(n):
                        states[old + m, lane] = space.one_point[0, m]
                    if projected:
                        for other in range(lanes):
                            numbers.lone[other] = WANTED if other == lane else NONE
                        correct(position, velocity, clock, states, old, constants, lane_state.delta, numbers.lone)
                        if numbers.lone[lane] == FAILED:
                            status[lane] = _PROJECTION_FAILED
                            continue
                for m in range(n):
                    space.one_point[0, m] = states[old + m, lane]
                t, forward = time[lane], direction[lane]
                sampled = sampled_of[lane]
                while sampled > 0 and (t_eval[sampled - 1] - t) * forward >= 0.0:
                    sampled -= 1
                    for m in range(n):
                        samples[i, sampled * n + m] = np.nan
                    if marked:
                        inside[i, sampled] = False
                sampled_of[lane] = sampled
                if found == BROKEN:
                    status[lane] = _EVENT_NON_FINITE
                    continue
                span = abs(end_of[lane] - first_of[lane])
                outcome = resolve(events, space, lane, n, t, forward, span, one, happened, i, theta)
                for m in range(n):
                    states[old + m, lane] = space.one_point[0, m]
                if outcome >= 0:
                    status[lane] = outcome
                    continue
                rest = abs(end_of[lane] - t)
                status[lane] = RUNNING if attempts[lane] < budget else _MAX_STEPS
                if rest == 0.0:
                    status[lane] = _SUCCESS
                if status[lane] != RUNNING:
                    continue
                fresh_of[lane] = 1
                begin_signs(events, space, lane, t, forward, one)
                if memory > 0:
                    space.setting[0, 0], space.setting[0, 1] = min(largest, rest), forward
                    for m in range(2, limits.shape[1]):
                        space.setting[0, m] = limits[0, m]
                    at, first = row(space.one_clock, 0), row(space.one_point, 0)
                    space.one_clock[0, 0] = t
                    call_code(events.refill, at, first, one, row(space.setting, 0), row(space.one_out, 0))
                    for m in range(held):
                        states[old + m, lane] = space.one_out[0, m]

    return compiled_subset(loop)


LOOP = sweeping(watched=False, projected=False)
