"""One trajectory, step by step, with a compiled step kernel.

The kernel decides the size of each step and never rejects one; the loop keeps the time, looks for
numbers that are not finite, and projects. It is the same for every model and every order.

Time and state are summed with compensation (Kahan; N. J. Higham, Accuracy and Stability of Numerical
Algorithms, section 4.3): what rounding takes from a sum is kept and added to the next increment, so that
the phase of a long run, and angles that wind up, keep the digits of the steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numba import types

from ..digest import integrator_digest
from ..problem import FloatArray
from ..status import Status
from .code import call_code, row
from .jit import MATRIX, VECTOR, compiled, compiled_and_cached

__all__ = ["RUNNING", "marching_loop"]

RUNNING = -1
"""What the loop returns when its rows are full before the end of the span."""

_SUCCESS, _NON_FINITE = int(Status.SUCCESS), int(Status.NON_FINITE)
_STEP_TOO_SMALL, _PROJECTION_FAILED = int(Status.STEP_TOO_SMALL), int(Status.PROJECTION_FAILED)
_MAX_CORRECTIONS = 10
_SMALLEST = 16.0 * 2.220446049250313e-16
_QUADRATIC = 1e-8


@compiled
def _sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b as rounded, and what rounding took (Knuth's two-sum)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@compiled
def _advance(old: FloatArray, before: int, rows: FloatArray, here: int, h: float, low: FloatArray) -> None:
    """Write to ``rows[here, :n]`` the state ``old[before, :n]`` moved by the series in that row, with compensation."""
    n = low.size - 1
    width = (rows.shape[1] - n - 2) // n
    for i in range(n):
        first = n + 2 + i * width
        move = 0.0
        for k in range(width - 1, 0, -1):
            move = (move + rows[here, first + k]) * h
        rows[here, i], low[i] = _sum(old[before, i], move + low[i])


@cache
def marching_loop() -> Callable[..., tuple[int, int]]:
    """Return the loop, compiled or loaded from numba's disk cache.

    ``loop(step, position, velocity, span, settings, y, c, rows, times, limit, low)`` starts from the state y (1, n_y)
    and writes the outputs of step k to ``rows[k % len(rows)]`` (see `dalembert.ir.taylor`), its end to ``times[k]``
    where that exists. It returns its status and the number of steps. ``span`` holds the present time, the end and
    the largest step; ``settings`` (1, 3) is handed to the kernel; ``low`` (n_y + 1,) holds what rounding took from the
    state and from the time so far.
    """
    return _entry_point(integrator_digest())


def _entry_point(digest: str) -> Callable[..., tuple[int, int]]:
    def loop(
        step: int,
        position: int,
        velocity: int,
        span: FloatArray,
        settings: FloatArray,
        y: FloatArray,
        c: FloatArray,
        rows: FloatArray,
        times: FloatArray,
        limit: int,
        low: FloatArray,
    ) -> tuple[int, int]:
        digest  # noqa: B018
        n = y.shape[1]
        t, t1, largest = span[0], span[1], span[2]
        clock = np.empty((1, 1))
        delta = np.empty((1, n))
        state = row(y, 0)
        for k in range(limit):
            here = k % rows.shape[0]
            rest = abs(t1 - t - low[n])
            if rest == 0.0:
                return _SUCCESS, k
            settings[0, 0] = min(rest, largest)
            clock[0, 0] = t
            call_code(step, row(clock, 0), state, row(c, 0), row(settings, 0), row(rows, here))
            size = rows[here, n]
            if rows[here, n + 1] != 0.0:
                return _NON_FINITE, k
            if size < _SMALLEST * max(abs(t), abs(t1 - span[0]) * 1e-16) and size < rest:
                return _STEP_TOO_SMALL, k
            if k == 0:
                _advance(y, 0, rows, here, settings[0, 1] * size, low)
            else:
                _advance(rows, here - 1, rows, here, settings[0, 1] * size, low)
            state = row(rows, here)
            if size == rest:
                t, low[n] = t1, 0.0
            else:
                t, low[n] = _sum(t, settings[0, 1] * size + low[n])
            clock[0, 0] = t
            for kernel, tries in ((position, _MAX_CORRECTIONS), (velocity, 2)):
                if kernel == 0:
                    continue
                change = math.inf
                for _ in range(tries):
                    call_code(kernel, row(clock, 0), state, row(c, 0), 0, row(delta, 0))
                    change = 0.0
                    for i in range(n):
                        rows[here, i] += delta[0, i]
                        change = max(change, abs(delta[0, i]) / (1e-3 + abs(rows[here, i])))
                    if not change > _QUADRATIC:
                        break
                if not change <= 1e-4:
                    return _PROJECTION_FAILED, k
            span[0] = t
            if k < times.size:
                times[k] = t
            if t == t1:
                return _SUCCESS, k + 1
        return RUNNING, limit

    integer = types.intp
    return compiled_and_cached(
        loop, (integer, integer, integer, VECTOR, MATRIX, MATRIX, MATRIX, MATRIX, VECTOR, integer, VECTOR)
    )
