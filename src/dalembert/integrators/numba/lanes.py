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
from ..problem import FloatArray
from ..status import Status
from .code import call_code, row
from .jit import compiled, compiled_and_cached

__all__ = ["sweeping_loop"]

_SUCCESS, _MAX_STEPS = int(Status.SUCCESS), int(Status.MAX_STEPS)
_NON_FINITE, _STEP_TOO_SMALL = int(Status.NON_FINITE), int(Status.STEP_TOO_SMALL)
_PROJECTION_FAILED = int(Status.PROJECTION_FAILED)
_MAX_CORRECTIONS = 10
_SMALLEST = 16.0 * 2.220446049250313e-16
_QUADRATIC = 1e-8
_RUNNING, _IDLE = -1, -2
_DONE, _MOVING, _FAILED = 0, 1, 2


@cache
def sweeping_loop() -> Callable[..., int]:
    """Return the loop, compiled or loaded from numba's disk cache.

    ``loop(codes, limits, y, c, spans, t_eval, shape, out, ends, samples, lanes)`` runs the cases of y (k, n_y) with
    constants c (k or 1, n_c) over spans (k, 2). ``codes`` are four addresses: the step, what fills in its memory
    before the first step, and the projections (0 for none). ``limits`` are the largest step, the number of steps, and
    what else the step reads behind step and direction. ``shape`` is the degree of its polynomials and the number of
    outputs that it remembers; polynomials of a step with a memory are in the fraction of the step, others in time.
    The loop writes final states to ``out`` (k, n_y), states at the times ``t_eval`` (m,) to ``samples`` (k, m * n_y),
    and final time, status and steps to the rows of ``ends`` (k, 3).
    """
    return _entry_point(integrator_digest())


@compiled
def _project(
    kernel: int,
    tries: int,
    clock: FloatArray,
    states: FloatArray,
    first: int,
    constants: FloatArray,
    delta: FloatArray,
    moving: NDArray[np.int64],
    n: int,
) -> None:
    """Correct the lanes that are marked as moving until they are done or have failed."""
    left = 0
    for lane in range(moving.size):
        left += 1 if moving[lane] == _MOVING else 0
    for attempt in range(tries):
        if left == 0:
            break
        call_code(kernel, row(clock, 0), row(states, first), row(constants, 0), 0, row(delta, 0))
        for lane in range(moving.size):
            if moving[lane] != _MOVING:
                continue
            change = finite = 0.0
            for m in range(n):
                states[first + m, lane] += delta[m, lane]
                change = max(change, abs(delta[m, lane]) / (1e-3 + abs(states[first + m, lane])))
                finite += 0.0 * delta[m, lane]
            if finite != 0.0 or (attempt == tries - 1 and not change <= 1e-4):
                moving[lane] = _FAILED
                left -= 1
            elif not change > _QUADRATIC:
                moving[lane] = _DONE
                left -= 1
    for lane in range(moving.size):
        if moving[lane] == _MOVING:
            moving[lane] = _DONE


@compiled
def _project_samples(
    codes: tuple[int, int, int, int],
    t_eval: FloatArray,
    c: FloatArray,
    inside: NDArray[np.bool_],
    samples: FloatArray,
    constants: FloatArray,
    delta: FloatArray,
    n: int,
) -> None:
    """Project the samples that were interpolated, a pack at a time; what does not converge stays as it is."""
    lanes, wanted = constants.shape[1], t_eval.size
    clock, states = np.zeros((1, lanes)), np.zeros((n, lanes))
    places, moving = np.zeros(lanes, np.int64), np.zeros(lanes, np.int64)
    filled, total = 0, inside.size
    for place in range(total + 1):
        if place < total and inside[place // wanted, place % wanted]:
            i, j = place // wanted, place % wanted
            for m in range(n):
                states[m, filled] = samples[i, j * n + m]
            for m in range(c.shape[1]):
                constants[m, filled] = c[i if c.shape[0] > 1 else 0, m]
            clock[0, filled], places[filled], moving[filled] = t_eval[j], place, _MOVING
            filled += 1
        if filled < lanes and (place < total or filled == 0):
            continue
        for lane in range(filled, lanes):
            moving[lane] = _DONE
        if codes[2] != 0:
            _project(codes[2], _MAX_CORRECTIONS, clock, states, 0, constants, delta, moving, n)
            for lane in range(filled):
                moving[lane] = _MOVING if moving[lane] == _DONE else _FAILED
        if codes[3] != 0:
            _project(codes[3], 2, clock, states, 0, constants, delta, moving, n)
        for lane in range(filled):
            if moving[lane] == _DONE:
                for m in range(n):
                    samples[places[lane] // wanted, places[lane] % wanted * n + m] = states[m, lane]
        filled = 0


def _entry_point(digest: str) -> Callable[..., int]:
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
        lanes: int,
    ) -> int:
        digest  # noqa: B018
        step, start, position, velocity = codes
        degree, memory = shape
        count, n = y.shape
        wanted = t_eval.size
        largest, budget = limits[0], limits[1]
        remembered = n + 2 + memory
        rows = remembered + (n * (degree + 1) if wanted else 0)
        # A step reads the state in one half and writes the other, which then is the state.
        states = np.zeros((2 * rows, lanes))
        fresh = np.zeros((remembered, lanes))
        constants = np.ones((c.shape[1], lanes))
        settings = np.zeros((limits.size, lanes))
        for m in range(2, limits.size):
            settings[m, :] = limits[m]
        delta = np.zeros((n, lanes))
        clock = np.zeros((1, lanes))
        before = np.zeros(lanes)
        end = np.zeros(lanes)
        case = np.full(lanes, -1)
        steps = np.zeros(lanes)
        attempts = np.zeros(lanes)
        sampled = np.zeros(lanes, np.int64)
        sampled_before = np.zeros(lanes, np.int64)
        status = np.full(lanes, _IDLE)
        moving = np.zeros(lanes, np.int64)
        inside = np.zeros((count, wanted), np.bool_)
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
                    i = coming  # take the next
                    coming += 1
                    active += 1
                    if start != 0 and i % lanes == 0:
                        # The memory of as many cases as there are lanes is filled in together, before the first is taken.
                        # The other half of the states and delta are free at this point of the loop.
                        pass
                    case[lane], steps[lane], attempts[lane], sampled[lane] = i, 0.0, 0.0, 0
                    for m in range(n):
                        states[old + m, lane] = y[i, m]
                    shared = i if c.shape[0] > 1 else 0
                    for m in range(c.shape[1]):
                        constants[m, lane] = c[shared, m]
                    clock[0, lane], end[lane] = spans[i, 0], spans[i, 1]
                    settings[1, lane] = 1.0 if end[lane] >= clock[0, lane] else -1.0
                    status[lane] = _SUCCESS if end[lane] == clock[0, lane] else _RUNNING
            if active == 0:
                return coming
        return coming

    integer = types.intp
    signature = ()
    return compiled_and_cached(loop, signature)
