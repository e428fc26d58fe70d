"""Extrema and integrals along one step of one case: `dalembert.events.reductions`, compiled."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray
from ..lanes.workspace import EventKernels, EventWorkspace
from ..methods.chebyshev import (
    BEND_TAIL,
    BENDS,
    BETWEEN,
    BOUNDS,
    CHECKS,
    CLOSE,
    INTEGRAL,
    MISSED,
    NEGLIGIBLE,
    POINTS,
    SLOPE_TAIL,
    SMOOTH,
    TAIL,
)
from ..methods.step_constants import BUDGET, COARSE, DEEP, DEEPEST
from ..subset.compiled_subset import compiled_subset, fma
from .event_intervals import SERIES, SLOPE_SERIES, converges, output_at, push_halves, sample, transformed
from .reductions import DEEP_IN_MEAN, FLAT, SHALLOW

MINIMUM, MAXIMUM, MEAN = 0, 1, 2
_BENDS = np.ascontiguousarray(BENDS.T)
_POINTS, _CHECKS, _BETWEEN = POINTS.copy(), CHECKS.copy(), np.ascontiguousarray(BETWEEN.T)
_INTEGRAL = INTEGRAL.copy()


@compiled_subset
def advance(kind: int, total: float, bounds: FloatArray, e: int, lane: int, h: float) -> tuple[bool, float]:
    """Return whether the bounds over a step decide what it adds to a minimum, maximum or integral, and the new one."""
    value, reach = bounds[BOUNDS * e, lane], bounds[BOUNDS * e + 1, lane]
    if kind == MEAN:
        return reach != 0.0, total + h * value
    sign = 1.0 if kind == MAXIMUM else -1.0
    best = max(sign * total, value)
    return reach <= best, sign * best


@compiled_subset
def accumulate(
    events: EventKernels,
    space: EventWorkspace,
    many: int,
    one: int,
    t: float,
    h: float,
    till: float,
    e: int,
    kind: int,
    total: float,
) -> float:
    """Return a minimum, maximum or integral with a step up to a fraction of it, whose series are in place."""
    sign = 1.0 if kind == MAXIMUM else -1.0
    best = sign * total
    space.stack[0, 0], space.stack[0, 1], space.stack[0, 2] = 0.0, till, 0.0
    height, budget = 1, BUDGET
    deep, deepest = (DEEP_IN_MEAN, SHALLOW) if kind == MEAN else (DEEP, DEEPEST)
    while height > 0:
        height -= 1
        low, high, depth = space.stack[height, 0], space.stack[height, 1], space.stack[height, 2]
        budget -= 1 if depth >= deep else 0
        if budget < 0:
            deepest = COARSE
        sample(events.running, events.read, space, many, t, h, low, high - low, _POINTS)
        transformed(SERIES, space, e, 0)
        if kind == MEAN:
            settled, mean = _mean_of_piece(space.work, depth >= deepest)
            if settled:
                total += (high - low) * h * mean
        else:
            missed = 0.0
            if events.running_oscillates != 0 and not converges(space.work):
                best, missed = _look_between(events, space, many, t, h, low, high - low, e, sign, best)
                if math.isnan(best):
                    return best
            last = depth >= deepest
            settled, best = _largest_in_piece(events, space, one, t, h, low, high, e, sign, best, missed, last)
            if math.isnan(best):
                return best
        if not settled:
            height = push_halves(space, height, low, high, depth)
    return total if kind == MEAN else sign * best


@compiled_subset
def _mean_of_piece(work: FloatArray, last: bool) -> tuple[bool, float]:
    """Return whether the series in ``work`` gives the mean over a piece, or the piece is the last, and the mean."""
    mean, varies, tail = 0.0, 0.0, abs(work[0, 6]) + abs(work[0, 7])
    for k in range(1, 8):
        varies += abs(work[0, k])
    size, before = varies + abs(work[0, 0]), abs(work[0, 4]) + abs(work[0, 5])
    smooth = tail * tail <= SMOOTH * size * before or tail <= NEGLIGIBLE * size
    if not (smooth or last or not math.isfinite(tail)):
        return False, 0.0
    for k in range(8):
        mean = fma(_INTEGRAL[k], work[0, k], mean)
    return True, mean


@compiled_subset
def _look_between(
    events: EventKernels,
    space: EventWorkspace,
    many: int,
    t: float,
    h: float,
    low: float,
    width: float,
    e: int,
    sign: float,
    best: float,
) -> tuple[float, float]:
    """Return the largest value of sign times an expression so far, and what the polynomial of a piece misses.

    They come from values between the points of the piece. NaN stands for a value that is not finite.
    """
    transformed(_BETWEEN, space, e, 2)
    for j in range(8):
        space.between[e, j] = space.values[e, j]
    sample(events.running, events.read, space, many, t, h, low, width, _CHECKS)
    missed = 0.0
    for j in range(8):
        value = space.values[e, j]
        miss = abs(value - space.work[2, j])
        missed, best = max(missed, miss), max(best, sign * value)
        if not math.isfinite(miss):
            best = math.nan
    for j in range(8):
        space.values[e, j] = space.between[e, j]
    return best, missed


@compiled_subset
def _largest_in_piece(
    events: EventKernels,
    space: EventWorkspace,
    one: int,
    t: float,
    h: float,
    low: float,
    high: float,
    e: int,
    sign: float,
    best: float,
    missed: float,
    last: bool,
) -> tuple[bool, float]:
    """Return whether a piece holds no larger value of sign times an expression than the one returned, NaN for NaN."""
    work = space.work
    for j in range(8):
        if not math.isfinite(space.values[e, j]):
            return True, math.nan
        best = max(best, sign * space.values[e, j])
    varies, tail = 0.0, abs(work[0, 6]) + abs(work[0, 7])
    for k in range(1, 8):
        varies += abs(work[0, k])
    if sign * work[0, 0] + varies + TAIL * tail + MISSED * missed <= best or last:
        return True, best
    transformed(SLOPE_SERIES, space, e, 1)
    transformed(_BENDS, space, e, 2)
    falls, turns = 0.0, 0.0
    for k in range(1, 8):
        falls += abs(work[1, k])
        turns += abs(work[2, k])
    if abs(work[1, 0]) > falls + SLOPE_TAIL * (tail + missed):
        return True, best
    if tail + missed <= CLOSE * varies and abs(work[2, 0]) > turns + BEND_TAIL * (tail + missed):
        if sign * work[2, 0] < 0.0:
            theta = low + (high - low) * _turning(work, sign)
            best = max(best, sign * output_at(events.at, events.read, space, 1, one, t, h, theta, e))
        return True, best
    return varies + TAIL * tail + MISSED * missed <= FLAT * abs(best), best


@compiled_subset
def _turning(work: FloatArray, sign: float) -> float:
    """Return where sign times a slope, which falls, changes its sign, as a fraction of the piece."""
    low, high = -1.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        a = b = 0.0
        for k in range(7, 0, -1):
            a, b = fma(2.0 * middle, a, work[1, k]) - b, a
        if sign * (fma(middle, a, work[1, 0]) - b) > 0.0:
            low = middle
        else:
            high = middle
    return 0.25 * (low + high) + 0.5
