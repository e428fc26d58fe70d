"""Many cases side by side: every lane of a pack is a case with its own time, step and status.

A lane whose case has ended takes the next one at once, so cases of unequal length do not wait for each
other. Lanes never mix: what a case computes does not depend on its neighbours, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import types

from ..digest import integrator_digest
from ..problem import FloatArray
from ..status import Status
from .code import call_code, row
from .jit import MATRIX, VECTOR, compiled_and_cached

__all__ = ["sweeping_loop"]

_SUCCESS, _MAX_STEPS = int(Status.SUCCESS), int(Status.MAX_STEPS)
_NON_FINITE, _STEP_TOO_SMALL = int(Status.NON_FINITE), int(Status.STEP_TOO_SMALL)
_PROJECTION_FAILED = int(Status.PROJECTION_FAILED)
_MAX_CORRECTIONS = 10
_SMALLEST = 16.0 * 2.220446049250313e-16
_QUADRATIC = 1e-8
_RUNNING, _IDLE = -1, -2


@cache
def sweeping_loop() -> Callable[..., int]:
    """Return the loop, compiled or loaded from numba's disk cache.

    ``loop(codes, limits, y, c, spans, t_eval, order, out, ends, samples, lanes)`` runs the cases of y (k, n_y) with
    constants c (k or 1, n_c) over spans (k, 2). ``codes`` are the addresses of the step and of the projections (0 for
    none), ``limits`` the largest step, the scale floor and the number of steps. It writes final states to ``out``
    (k, n_y), final times to ``ends`` (k,), states at the times ``t_eval`` (m,) to ``samples`` (k, m * n_y), and to the
    rows of ``ends`` (k, 3): final time, status, steps.
    """
    return _entry_point(integrator_digest())


def _entry_point(digest: str) -> Callable[..., int]:
    def loop(
        step: int,
        position: int,
        velocity: int,
        limits: FloatArray,
        y: FloatArray,
        c: FloatArray,
        spans: FloatArray,
        t_eval: FloatArray,
        order: int,
        out: FloatArray,
        ends: FloatArray,
        samples: FloatArray,
        lanes: int,
    ) -> int:
        digest  # noqa: B018
        count, n = y.shape
        wanted = t_eval.size
        largest, budget = limits[0], limits[2]
        rows = n + 2 + (n * (order + 1) if wanted else 0)
        # A step reads the state in one half and writes the other, which then is the state.
        states = np.zeros((2 * rows, lanes))
        constants = np.ones((c.shape[1], lanes))
        settings = np.full((3, lanes), limits[1])
        delta = np.zeros((n, lanes))
        clock = np.zeros((1, lanes))
        end = np.zeros(lanes)
        case = np.full(lanes, -1)
        steps = np.zeros(lanes)
        sampled = np.zeros(lanes, np.int64)
        status = np.full(lanes, _IDLE)
        unsettled = np.zeros(lanes, np.int64)
        coming, active, old, new = 0, 0, 0, rows
        while True:
            for lane in range(lanes):
                if status[lane] == _RUNNING:
                    settings[0, lane] = min(largest, abs(end[lane] - clock[0, lane]))
                    continue
                if case[lane] >= 0:  # a case has ended: hand it in
                    i = case[lane]
                    for m in range(n):
                        out[i, m] = states[old + m, lane]
                    ends[i, 0], ends[i, 1], ends[i, 2] = clock[0, lane], status[lane], steps[lane]
                    case[lane], status[lane] = -1, _IDLE
                    settings[0, lane] = 0.0
                    active -= 1
                if coming < count:  # and take the next
                    i = coming
                    coming += 1
                    active += 1
                    case[lane], status[lane], steps[lane], sampled[lane] = i, _RUNNING, 0.0, 0
                    for m in range(n):
                        states[old + m, lane] = y[i, m]
                    shared = i if c.shape[0] > 1 else 0
                    for m in range(c.shape[1]):
                        constants[m, lane] = c[shared, m]
                    clock[0, lane], end[lane] = spans[i, 0], spans[i, 1]
                    settings[0, lane] = min(largest, abs(end[lane] - clock[0, lane]))
                    settings[1, lane] = 1.0 if end[lane] >= clock[0, lane] else -1.0
                    while sampled[lane] < wanted and t_eval[sampled[lane]] == clock[0, lane]:
                        for m in range(n):
                            samples[i, sampled[lane] * n + m] = y[i, m]
                        sampled[lane] += 1
            if active == 0:
                return coming
            call_code(step, row(clock, 0), row(states, old), row(constants, 0), row(settings, 0), row(states, new))
            for lane in range(lanes):
                if status[lane] != _RUNNING:
                    continue
                start, size = clock[0, lane], states[new + n, lane]
                rest = abs(end[lane] - start)
                failed = states[new + n + 1, lane] != 0.0
                if failed or (size < rest and size < _SMALLEST * abs(start) + 1e-30 * rest):
                    status[lane] = _NON_FINITE if failed else _STEP_TOO_SMALL
                    for m in range(n):
                        states[new + m, lane] = states[old + m, lane]
                    continue
                t = end[lane] if size == rest else start + settings[1, lane] * size
                while sampled[lane] < wanted and (t_eval[sampled[lane]] - t) * settings[1, lane] <= 0.0:
                    h = t_eval[sampled[lane]] - start
                    for m in range(n):
                        value = 0.0
                        for k in range(order, -1, -1):
                            value = value * h + states[new + n + 2 + m * (order + 1) + k, lane]
                        samples[case[lane], sampled[lane] * n + m] = value
                    sampled[lane] += 1
                clock[0, lane] = t
                steps[lane] += 1.0
                if size == rest:
                    status[lane] = _SUCCESS
                elif steps[lane] >= budget:
                    status[lane] = _MAX_STEPS
            old, new = new, old
            for kernel, tries in ((position, _MAX_CORRECTIONS), (velocity, 2)):
                if kernel == 0:
                    continue
                left = 0
                for lane in range(lanes):
                    going = status[lane] == _RUNNING or status[lane] == _SUCCESS or status[lane] == _MAX_STEPS
                    unsettled[lane] = 1 if going else 0
                    left += unsettled[lane]
                for attempt in range(tries):
                    if left == 0:
                        break
                    call_code(kernel, row(clock, 0), row(states, old), row(constants, 0), 0, row(delta, 0))
                    for lane in range(lanes):
                        if unsettled[lane] == 0:
                            continue
                        change = 0.0
                        for m in range(n):
                            states[old + m, lane] += delta[m, lane]
                            change = max(change, abs(delta[m, lane]) / (1e-3 + abs(states[old + m, lane])))
                        if not change > _QUADRATIC:
                            unsettled[lane] = 0
                            left -= 1
                        elif attempt == tries - 1 and not change <= 1e-4:
                            status[lane] = _PROJECTION_FAILED

    integer = types.intp
    signature = (integer,) * 3 + (VECTOR, MATRIX, MATRIX, MATRIX, VECTOR, integer, MATRIX, MATRIX, MATRIX, integer)
    return compiled_and_cached(loop, signature)
