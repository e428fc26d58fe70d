"""Many cases side by side: every lane of a pack is a case with its own time, step and status.

A lane whose case has ended takes the next one at once, so cases of unequal length do not wait for each
other. Lanes never mix: what a case computes does not depend on its neighbours, to the last bit.

One loop serves every step kernel. A Taylor step chooses its size, never fails to reach it and remembers nothing; an
attempt of a Runge-Kutta step may be rejected, and what it remembers travels behind the state
(`dalembert.ir.runge_kutta`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import types
from numpy.typing import NDArray

from ..digest import integrator_digest
from ..gains import BRANCH, REDUCTION_BLIND, SLOW
from ..problem import FloatArray
from ..status import Status
from .code import call_code, row
from .jit import MATRIX, VECTOR, compiled, compiled_and_cached
from .running import QUICK, accumulate, advance
from .scan import (
    BROKEN,
    NOTHING,
    POINT_LANES,
    WATCH,
    Scratch,
    Watch,
    begin_signs,
    resolve,
    scan,
    scratch,
    starts,
    state_at,
    zeros_at_end,
)

__all__ = ["sample_projection", "sweeping_loop"]

_SUCCESS, _MAX_STEPS = int(Status.SUCCESS), int(Status.MAX_STEPS)
_NON_FINITE, _STEP_TOO_SMALL = int(Status.NON_FINITE), int(Status.STEP_TOO_SMALL)
_PROJECTION_FAILED, _EVENT_NON_FINITE = int(Status.PROJECTION_FAILED), int(Status.EVENT_NON_FINITE)
_MAX_CORRECTIONS, _LINEAR_CORRECTIONS = 10, 2
_SMALLEST = 16.0 * 2.220446049250313e-16
_QUADRATIC = 1e-8
_LINEAR = 1e-4
_RUNNING, _IDLE = -1, -2
_NONE, _WANTED, _SETTLED, _FAILED = 0, 1, 2, 3
_FLAGS = types.Array(types.boolean, 2, "C")


@cache
def sweeping_loop(watched: bool) -> Callable[..., int]:
    """Return the loop, with or without events, compiled or loaded from numba's disk cache.

    ``loop(codes, limits, y, c, spans, t_eval, shape, out, ends, samples, inside, lanes, watch, happened, totals)`` runs
    the cases of y (k, n) with constants c (k or 1, n_c) over spans (k, 2). ``codes`` are four addresses: the step, what
    fills in its memory before the first step, and the projections (0 for none). ``limits`` are the largest step, the
    number of steps, and what else the step reads behind step and direction. ``shape`` is the degree of its polynomials
    and the number of outputs that it remembers; polynomials of a step with a memory are in the fraction of the step,
    others in time. The loop writes final states to ``out`` (k, n_y), states at the times ``t_eval`` (m,) to
    ``samples`` (k, m * n_y), and final time, status and steps to the rows of ``ends`` (k, 3). In ``inside`` (k, m) or
    (0, 0) it marks the samples that were interpolated. The events of ``watch`` are counted in the rows of ``happened``
    (k, 3 n_events): how many there were, and the time of the first and the last. Minima, maxima and integrals are
    taken on in ``totals`` (k, n_running). With any of these, a step must write its polynomials.
    """
    return _sweeping_loop(integrator_digest(), watched)


@cache
def sample_projection() -> Callable[..., None]:
    """Return a loop that projects samples onto the constraints, compiled or loaded from numba's disk cache.

    ``project(position, velocity, c, t_eval, inside, samples, lanes)`` corrects those of ``samples`` (k, m * n_y) that
    are marked in ``inside`` (k, m), as many together as there are lanes. What does not converge stays as it is.
    """
    return _sample_projection(integrator_digest())


@compiled
def _project(
    position: int,
    velocity: int,
    clock: FloatArray,
    states: FloatArray,
    first: int,
    constants: FloatArray,
    delta: FloatArray,
    marks: NDArray[np.int64],
    n: int,
) -> None:
    """Project the states of the lanes that are marked to be; those where that fails are marked so."""
    for kernel, tries in ((position, _MAX_CORRECTIONS), (velocity, _LINEAR_CORRECTIONS)):
        left = 0
        for lane in range(marks.size):
            left += 1 if marks[lane] == _WANTED else 0
        if kernel == 0:
            left = 0
        for attempt in range(tries):
            if left == 0:
                break
            call_code(kernel, row(clock, 0), row(states, first), row(constants, 0), 0, row(delta, 0))
            for lane in range(marks.size):
                if marks[lane] != _WANTED:
                    continue
                change = finite = size = magnitude = 0.0
                for m in range(n):
                    if delta[m, lane] != 0.0:
                        size, magnitude = max(size, abs(delta[m, lane])), max(magnitude, abs(states[first + m, lane]))
                    states[first + m, lane] += delta[m, lane]
                    change = max(change, abs(delta[m, lane]) / (SLOW + abs(states[first + m, lane])))
                    finite += 0.0 * delta[m, lane]
                lost = attempt == 0 and tries == _LINEAR_CORRECTIONS and size > BRANCH * (SLOW + magnitude)
                if lost or finite != 0.0 or (attempt == tries - 1 and not change <= _LINEAR):
                    marks[lane] = _FAILED
                    left -= 1
                elif not change > _QUADRATIC:
                    marks[lane] = _SETTLED
                    left -= 1
        for lane in range(marks.size):
            if marks[lane] == _SETTLED:
                marks[lane] = _WANTED


@compiled
def _begin(
    code: int,
    first: int,
    y: FloatArray,
    c: FloatArray,
    spans: FloatArray,
    limits: FloatArray,
    fresh: FloatArray,
    clock: FloatArray,
    constants: FloatArray,
    settings: FloatArray,
) -> None:
    """Fill in the memory of the cases from number `first` on, as many as there are lanes, into columns of `fresh`."""
    count, n = y.shape
    lanes = clock.shape[1]
    for lane in range(lanes):
        i = min(first + lane, count - 1)
        for m in range(n):
            fresh[m, lane] = y[i, m]
        for m in range(c.shape[1]):
            constants[m, lane] = c[i if c.shape[0] > 1 else 0, m]
        clock[0, lane] = spans[i, 0]
        settings[0, lane] = min(limits[0], abs(spans[i, 1] - spans[i, 0]))
        settings[1, lane] = 1.0 if spans[i, 1] >= spans[i, 0] else -1.0
        for m in range(2, limits.size):
            settings[m, lane] = limits[m]
    call_code(code, row(clock, 0), row(fresh, 0), row(constants, 0), row(settings, 0), row(fresh, n))


@compiled
def _follow(room: Scratch, lane: int, states: FloatArray, first: int, scale: float, end: int) -> None:
    """Copy the polynomials of a lane's step, in the fraction of the step, made to end in the state that it ended in."""
    n, terms = room.series.shape
    for m in range(n):
        power, total = 1.0, 0.0
        for k in range(terms):
            value = states[first + m * terms + k, lane] * power
            room.series[m, k] = value
            total += value
            power *= scale
        gap = states[end + m, lane] - total
        room.series[m, 2] += 3.0 * gap
        room.series[m, 3] -= 2.0 * gap


def _sweeping_loop(digest: str, watched: bool) -> Callable[..., int]:
    def loop(
        codes: tuple[int, int, int, int],
        limits: FloatArray,
        y: FloatArray,
        c: FloatArray,
        spans: FloatArray,
        t_eval: FloatArray,
        shape: tuple[int, int],
        out: FloatArray,
        ends: FloatArray,
        samples: FloatArray,
        inside: NDArray[np.bool_],
        lanes: int,
        watch: Watch,
        happened: FloatArray,
        totals: FloatArray,
    ) -> int:
        digest  # noqa: B018
        step, start, position, velocity = codes
        degree, memory = shape
        count, n = y.shape
        wanted = t_eval.size
        projected = position != 0 or velocity != 0
        largest, budget = limits[0], limits[1]
        held = n + 2 + memory
        rows = held + (n * (degree + 1) if wanted or watched else 0)
        # A step reads the state in one half and writes the other, which then is the state.
        states = np.zeros((2 * rows, lanes))
        constants, constants_ahead = np.ones((c.shape[1], lanes)), np.ones((c.shape[1], lanes))
        settings, settings_ahead = np.zeros((limits.size, lanes)), np.zeros((limits.size, lanes))
        clock, clock_ahead = np.zeros((1, lanes)), np.zeros((1, lanes))
        begun, delta = np.zeros((n + held, lanes)), np.zeros((n, lanes))
        for m in range(2, limits.size):
            for lane in range(lanes):
                settings[m, lane] = limits[m]
        before, end, steps, attempts = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
        case, status = np.full(lanes, -1), np.full(lanes, _IDLE)
        sampled, sampled_before = np.zeros(lanes, np.int64), np.zeros(lanes, np.int64)
        marks = np.zeros(lanes, np.int64)
        marked = inside.size > 0
        fresh, lone, setting = np.zeros(lanes, np.bool_), np.zeros(lanes, np.int64), np.zeros((1, limits.size))
        quick = np.zeros((QUICK * watch.kinds.size, lanes))
        signs, earlier = np.zeros((watch.directions.size, lanes)), np.zeros((1, lanes))
        if watched:
            room = scratch(watch, n, degree, c.shape[1], lanes)
        coming, active, old, new = 0, 0, 0, rows
        while True:
            for lane in range(lanes):
                while True:
                    if case[lane] >= 0:
                        i = case[lane]
                        while sampled[lane] < wanted and t_eval[sampled[lane]] == clock[0, lane]:
                            for m in range(n):
                                samples[i, sampled[lane] * n + m] = states[old + m, lane]
                            sampled[lane] += 1
                        if status[lane] == _RUNNING:
                            settings[0, lane] = min(largest, abs(end[lane] - clock[0, lane]))
                            break
                        for m in range(n):  # a case has ended: hand it in
                            out[i, m] = states[old + m, lane]
                        ends[i, 0], ends[i, 1], ends[i, 2] = clock[0, lane], status[lane], steps[lane]
                        case[lane], status[lane] = -1, _IDLE
                        settings[0, lane] = 0.0
                        active -= 1
                    if coming == count:
                        break
                    i = coming  # and take the next
                    if start != 0:
                        if i % lanes == 0:
                            _begin(start, i, y, c, spans, limits, begun, clock_ahead, constants_ahead, settings_ahead)
                        for m in range(held):
                            states[old + m, lane] = begun[n + m, i % lanes]
                    coming += 1
                    active += 1
                    case[lane], steps[lane], attempts[lane], sampled[lane] = i, 0.0, 0.0, 0
                    for m in range(n):
                        states[old + m, lane] = y[i, m]
                    shared = i if c.shape[0] > 1 else 0
                    for m in range(c.shape[1]):
                        constants[m, lane] = c[shared, m]
                    clock[0, lane], end[lane] = spans[i, 0], spans[i, 1]
                    settings[1, lane] = 1.0 if end[lane] >= clock[0, lane] else -1.0
                    status[lane] = _SUCCESS if end[lane] == clock[0, lane] else _RUNNING
                    if watched:
                        fresh[lane] = True
                        for m in range(c.shape[1]):
                            for point in range(POINT_LANES):
                                room.constants[lane * c.shape[1] + m, point] = c[shared, m]
                        for m in range(n):
                            room.one_point[0, m] = y[i, m]
                        starts(watch, room, lane, clock[0, lane], settings[1, lane], row(c, shared))
            if active == 0:
                break
            call_code(step, row(clock, 0), row(states, old), row(constants, 0), row(settings, 0), row(states, new))
            for lane in range(lanes):
                marks[lane] = _NONE
                if status[lane] != _RUNNING:
                    continue
                now, size = clock[0, lane], states[new + n, lane]
                rest = abs(end[lane] - now)
                broken = states[new + n + 1, lane] != 0.0
                smallest = _SMALLEST * abs(now) + 1e-30 * rest
                attempts[lane] += 1.0
                if memory > 0:
                    kept = size != 0.0
                    stuck = not kept and not states[new + n + 2, lane] >= smallest
                else:
                    stuck = broken or (size < rest and size < smallest)
                    kept = not stuck
                if stuck:
                    status[lane] = _NON_FINITE if broken else _STEP_TOO_SMALL
                    for m in range(n):
                        states[new + m, lane] = states[old + m, lane]
                    continue
                if not kept:
                    if attempts[lane] >= budget:
                        status[lane] = _MAX_STEPS
                    continue
                t = end[lane] if size == rest else now + settings[1, lane] * size
                sampled_before[lane] = sampled[lane]
                while sampled[lane] < wanted and (t_eval[sampled[lane]] - t) * settings[1, lane] < 0.0:
                    x = t_eval[sampled[lane]] - now
                    if memory > 0:
                        x /= settings[1, lane] * size
                    for m in range(n):
                        value = 0.0
                        for k in range(degree, -1, -1):
                            value = value * x + states[new + held + m * (degree + 1) + k, lane]
                        samples[case[lane], sampled[lane] * n + m] = value
                    if marked:
                        inside[case[lane], sampled[lane]] = True
                    sampled[lane] += 1
                before[lane], clock[0, lane], marks[lane] = now, t, _WANTED
                steps[lane] += 1.0
                if size == rest:
                    status[lane] = _SUCCESS
                elif attempts[lane] >= budget:
                    status[lane] = _MAX_STEPS
            old, new = new, old
            if not projected and not watched:
                continue
            if projected:
                _project(position, velocity, clock, states, old, constants, delta, marks, n)
            for lane in range(lanes):
                if marks[lane] != _FAILED:
                    continue
                # Go back to the state before the step, and try a smaller one where the step can.
                size = REDUCTION_BLIND * abs(clock[0, lane] - before[lane])
                for m in range(held):
                    states[old + m, lane] = states[new + m, lane]
                clock[0, lane], sampled[lane] = before[lane], sampled_before[lane]
                steps[lane] -= 1.0
                status[lane] = _PROJECTION_FAILED
                if memory > 0 and size >= _SMALLEST * abs(before[lane]) + 1e-30 * abs(end[lane] - before[lane]):
                    status[lane] = _RUNNING if attempts[lane] < budget else _MAX_STEPS
                    states[old + n + 2, lane], states[old + n + 4, lane] = size, 1.0
            if not watched:
                continue
            for lane in range(lanes):
                earlier[0, lane] = before[lane]
            at, rest_of_it = row(earlier, 0), row(constants, 0)
            if signs.shape[0] > 0:
                call_code(watch.quiet, at, row(states, old), rest_of_it, row(settings, 0), row(signs, 0))
            if quick.shape[0] > 0:
                call_code(watch.quick, at, row(states, old), rest_of_it, row(settings, 0), row(quick, 0))
            for lane in range(lanes):
                if marks[lane] != _WANTED:
                    continue
                i, now = case[lane], before[lane]
                one, many = row(c, i if c.shape[0] > 1 else 0), row(room.constants, lane * c.shape[1])
                h, scale = clock[0, lane] - now, 1.0 if memory > 0 else clock[0, lane] - now
                quiet, found, theta = True, NOTHING, 1.0
                for e in range(signs.shape[0]):
                    quiet = quiet and signs[e, lane] * room.signs[lane, e] > 0.0
                    quiet = quiet and not (fresh[lane] and room.zero[lane, e] != 0.0)
                    room.seen[lane, e] = 1.0 if quiet else room.seen[lane, e]
                if not quiet:
                    _follow(room, lane, states, old + held, scale, old)
                    found, theta = scan(watch, room, lane, many, one, now, h, fresh[lane], happened, i)
                fresh[lane] = False
                followed = not quiet
                for e in range(watch.kinds.size):
                    decided, total = advance(watch.kinds[e], totals[i, e], quick, e, lane, h)
                    if found != NOTHING or not decided:
                        if not followed:
                            _follow(room, lane, states, old + held, scale, old)
                        followed = True
                        total = accumulate(watch, room, many, one, now, h, theta, e, watch.kinds[e], totals[i, e])
                    totals[i, e] = total
                if quiet:
                    continue
                if found == NOTHING:
                    if status[lane] != _SUCCESS:
                        continue
                    for m in range(n):
                        room.one_point[0, m] = states[old + m, lane]
                    if not zeros_at_end(watch, room, lane, end[lane], settings[1, lane], one, happened, i):
                        continue
                elif theta < 1.0:
                    state_at(room, n, theta, 0)
                    clock[0, lane] = now + theta * h
                    for m in range(n):
                        states[old + m, lane] = room.one_point[0, m]
                    if projected:
                        for other in range(lanes):
                            lone[other] = _WANTED if other == lane else _NONE
                        _project(position, velocity, clock, states, old, constants, delta, lone, n)
                        if lone[lane] == _FAILED:
                            status[lane] = _PROJECTION_FAILED
                            continue
                for m in range(n):
                    room.one_point[0, m] = states[old + m, lane]
                t, forward = clock[0, lane], settings[1, lane]
                while sampled[lane] > 0 and (t_eval[sampled[lane] - 1] - t) * forward >= 0.0:
                    sampled[lane] -= 1
                    for m in range(n):
                        samples[i, sampled[lane] * n + m] = np.nan
                    if marked:
                        inside[i, sampled[lane]] = False
                if found == BROKEN:
                    status[lane] = _EVENT_NON_FINITE
                    continue
                outcome = resolve(watch, room, lane, n, t, forward, abs(spans[i, 1] - spans[i, 0]), one, happened, i)
                for m in range(n):
                    states[old + m, lane] = room.one_point[0, m]
                if outcome >= 0:
                    status[lane] = outcome
                    continue
                rest = abs(end[lane] - t)
                status[lane] = _RUNNING if attempts[lane] < budget else _MAX_STEPS
                if rest == 0.0:
                    status[lane] = _SUCCESS
                if status[lane] != _RUNNING:
                    continue
                fresh[lane] = True
                begin_signs(watch, room, lane, t, forward, one)
                if memory > 0:
                    setting[0, 0], setting[0, 1] = min(largest, rest), forward
                    for m in range(2, limits.size):
                        setting[0, m] = limits[m]
                    at, first = row(room.one_clock, 0), row(room.one_point, 0)
                    room.one_clock[0, 0] = t
                    call_code(watch.refill, at, first, one, row(setting, 0), row(room.one_out, 0))
                    for m in range(held):
                        states[old + m, lane] = room.one_out[0, m]
        return coming

    integer = types.intp
    numbers = types.UniTuple(integer, 4), types.UniTuple(integer, 2)
    arrays = (VECTOR, MATRIX, MATRIX, MATRIX, VECTOR)
    return compiled_and_cached(
        loop, (numbers[0], *arrays, numbers[1], MATRIX, MATRIX, MATRIX, _FLAGS, integer, WATCH, MATRIX, MATRIX)
    )


def _sample_projection(digest: str) -> Callable[..., None]:
    def project(
        position: int,
        velocity: int,
        c: FloatArray,
        t_eval: FloatArray,
        inside: NDArray[np.bool_],
        samples: FloatArray,
        lanes: int,
    ) -> None:
        digest  # noqa: B018
        wanted, n = t_eval.size, samples.shape[1] // t_eval.size
        clock, states, delta = np.zeros((1, lanes)), np.zeros((n, lanes)), np.zeros((n, lanes))
        constants = np.ones((c.shape[1], lanes))
        places, marks = np.zeros(lanes, np.int64), np.zeros(lanes, np.int64)
        filled, total = 0, inside.size
        for place in range(total + 1):
            i, j = place // wanted, place % wanted
            if place < total and inside[i, j]:
                for m in range(n):
                    states[m, filled] = samples[i, j * n + m]
                for m in range(c.shape[1]):
                    constants[m, filled] = c[i if c.shape[0] > 1 else 0, m]
                clock[0, filled], places[filled], marks[filled] = t_eval[j], place, _WANTED
                filled += 1
            if filled < lanes and (place < total or filled == 0):
                continue
            for lane in range(filled, lanes):
                marks[lane] = _NONE
            _project(position, velocity, clock, states, 0, constants, delta, marks, n)
            for lane in range(filled):
                if marks[lane] == _WANTED:
                    for m in range(n):
                        samples[places[lane] // wanted, places[lane] % wanted * n + m] = states[m, lane]
            filled = 0

    integer = types.intp
    return compiled_and_cached(project, (integer, integer, MATRIX, VECTOR, _FLAGS, MATRIX, integer))
