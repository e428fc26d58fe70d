"""Pieces of a step of one case: watched expressions at their eight points, and whether they are simple.

A piece is simple where no expression can have more than the zero that its ends show: |T_k| <= 1 bounds it by the
coefficients of its Chebyshev series, of which the last two stand for what the series leaves out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..lanes.workspace import BEND, DOUBT, LIMIT, RATE, EventKernels, EventWorkspace
from ..methods import chebyshev
from ..methods.chebyshev import COEFFICIENTS, CONVERGED, DIVIDED, MISSED, POINTS, SLOPE_TAIL, SLOPES, TAIL
from ..methods.step_constants import BENT, STEEP
from ..subset.compiled_subset import call_code, compiled_subset, fma, row, square
from .event_rules import bend_agrees, least_doubt, leaves_zero, slope_agrees, unresolved

_POINTS, _CHECKS = POINTS.copy(), chebyshev.CHECKS.copy()
_BETWEEN = np.ascontiguousarray(chebyshev.BETWEEN.T)
SERIES = np.ascontiguousarray(COEFFICIENTS.T)
SLOPE_SERIES = np.ascontiguousarray(SLOPES.T)
_ONCE, _TWICE, _THRICE = (np.ascontiguousarray(matrix.T) for matrix in DIVIDED)
_BEND = chebyshev.BEND.copy()
_THETA = 3


@compiled_subset
def sample(
    values: int,
    used: NDArray[np.int64],
    space: EventWorkspace,
    c: int,
    t: float,
    h: float,
    low: float,
    width: float,
    points: FloatArray,
) -> None:
    """Evaluate all expressions at eight points of a piece of the step, fractions of it, into ``values``."""
    degree, work = space.series.shape[1] - 1, space.work
    for j in range(8):
        work[_THETA, j] = low + width * points[j]
        space.clock[0, j] = t + work[_THETA, j] * h
    for u in range(used.size):
        m = used[u]
        a = b = c0 = d = e = f = g = w = space.series[m, degree]  # in registers: stored sums wait for each other
        for k in range(degree - 1, -1, -1):
            term = space.series[m, k]
            a, b = fma(a, work[_THETA, 0], term), fma(b, work[_THETA, 1], term)
            c0, d = fma(c0, work[_THETA, 2], term), fma(d, work[_THETA, 3], term)
            e, f = fma(e, work[_THETA, 4], term), fma(f, work[_THETA, 5], term)
            g, w = fma(g, work[_THETA, 6], term), fma(w, work[_THETA, 7], term)
        point = space.point[m]
        point[0], point[1], point[2], point[3] = a, b, c0, d
        point[4], point[5], point[6], point[7] = e, f, g, w
    call_code(values, row(space.clock, 0), row(space.point, 0), c, 0, row(space.values, 0))


@compiled_subset
def transformed(matrix: FloatArray, space: EventWorkspace, e: int, to: int) -> None:
    """Write the product of a matrix, given transposed, and the values of an expression to a row of ``work``."""
    work = space.work[to]
    a = b = c = d = p = q = r = s = 0.0  # in registers: stored sums wait for each other
    for j in range(8):
        value, column = space.values[e, j], matrix[j]
        a, b, c, d = (
            fma(column[0], value, a),
            fma(column[1], value, b),
            fma(column[2], value, c),
            fma(column[3], value, d),
        )
        p, q, r, s = (
            fma(column[4], value, p),
            fma(column[5], value, q),
            fma(column[6], value, r),
            fma(column[7], value, s),
        )
    work[0], work[1], work[2], work[3] = a, b, c, d
    work[4], work[5], work[6], work[7] = p, q, r, s


@compiled_subset
def _least_size(work: FloatArray, i: int) -> float:
    """Return the least size that a series can have on a piece on which it keeps its sign; up to 0 it may not."""
    rest = 0.0
    for k in range(1, 8):
        rest += abs(work[i, k])
    return abs(work[i, 0]) - (rest + TAIL * (abs(work[i, 6]) + abs(work[i, 7])))


@compiled_subset
def converges(work: FloatArray) -> bool:
    """Return whether the series of an expression, in the first row, shows no oscillation between the points."""
    rest = 0.0
    for k in range(1, 8):
        rest += abs(work[0, k])
    return abs(work[0, 6]) + abs(work[0, 7]) <= CONVERGED * rest


@compiled_subset
def _one_sign(work: FloatArray, i: int) -> bool:
    return _least_size(work, i) > 0.0


@compiled_subset
def _monotone(work: FloatArray, missed: float) -> bool:
    rest = 0.0
    for k in range(1, 8):
        rest += abs(work[1, k])
    return abs(work[1, 0]) > rest + SLOPE_TAIL * (abs(work[0, 6]) + abs(work[0, 7]) + missed)


@compiled_subset
def _leaves_flatly(
    directions: NDArray[np.int64], space: EventWorkspace, lane: int, e: int, largest: float, high: float, slope: float
) -> bool:
    """Return whether an expression that begins a piece in a zero without a slope keeps its sign; see `event_rules`.

    The bend of an armed one becomes infinite where it decides, and is not known without the error of the polynomials.
    """
    last, side = space.values[e, 7], 0.0
    if abs(directions[e]) > 1:
        side = space.signs[lane, e]
    bend = 0.0
    for j in range(1, 8):
        bend = fma(_BEND[j], space.values[e, j] - slope * _POINTS[j], bend)
    if side * last < 0.0 and math.isnan(space.rates[BEND, e]):
        space.rates[BEND, e] = math.inf
        return False
    transformed(_TWICE, space, e, 1)
    twice, tail = _least_size(space.work, 1), abs(space.work[1, 6]) + abs(space.work[1, 7])
    if side != 0.0 and math.isfinite(space.rates[BEND, e]):
        exact, area, nothing = space.rates[BEND, e] * square(high), square(high), True
        doubt = least_doubt(space.rates[DOUBT, e], abs(bend - exact) / area, tail / area, space.rates[LIMIT, e])
        space.rates[DOUBT, e], bend = doubt, exact
        for j in range(8):
            nothing = nothing and unresolved(space.values[e, j], high * _POINTS[j], doubt)
        if nothing:
            return True
        if side * last < 0.0 and not bend_agrees(exact, last, twice):
            return False
    transformed(_THRICE, space, e, 1)
    thrice = _least_size(space.work, 1)
    against = bend if last < 0.0 else -bend
    if leaves_zero(abs(slope), against, twice, thrice, largest, space.noise[0, e], side * last > 0.0):
        return True
    if side != 0.0 and math.isnan(space.rates[BEND, e]):
        space.rates[BEND, e] = math.inf
    return False


@compiled_subset
def simple_piece(
    directions: NDArray[np.int64], space: EventWorkspace, lane: int, fresh: bool, high: float, h: float
) -> tuple[bool, bool]:
    """Return whether a piece need not be cut for any expression, and whether all values are finite.

    ``fresh`` says that expressions which are zero at the start of the lane are so where the piece, up to the fraction
    ``high`` of the step of size h, begins. An armed one (see `dalembert.events.event_code.armed`) is known to
    leave zero against its direction.
    """
    simple = finite = True
    for e in range(directions.size):
        if space.may_change[0, e] == 0.0:
            continue
        lost, largest = True, 0.0
        for j in range(8):
            value = space.values[e, j]
            if math.isfinite(value):
                lost = False
                largest = max(largest, abs(value))
            else:
                finite = False
                largest = math.inf
        if lost or largest <= space.noise[0, e]:
            continue
        transformed(SERIES, space, e, 0)
        if _one_sign(space.work, 0):
            continue
        agrees = True
        if fresh and space.zero[lane, e] != 0.0:
            transformed(_ONCE, space, e, 1)
            slope = space.rates[RATE, e] * h * high
            agrees, begin = slope_agrees(slope, space.values[e, 7], largest), 0.0
            for k in range(7, -1, -1):
                begin = space.work[1, k] - begin  # T_k(-1) = (-1)^k
            if agrees and _least_size(space.work, 1) > MISSED * abs(begin - slope):
                continue
            if abs(slope) <= STEEP * largest:
                if _leaves_flatly(directions, space, lane, e, largest, high, slope):
                    continue
        transformed(SLOPE_SERIES, space, e, 1)
        if not (agrees and _monotone(space.work, 0.0)):
            simple = False
    return simple, finite


@compiled_subset
def resolved_piece(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    many: int,
    t: float,
    h: float,
    low: float,
    width: float,
    fresh: bool,
) -> bool:
    """Return whether a simple piece is simple by the values between its points, too.

    Expressions that oscillate there are missed by eight points, unless their series converge. ``fresh`` is that of
    `simple_piece`.
    """
    count, resolved = events.directions.size, True
    for e in range(count):
        if space.may_change[0, e] != 0.0:
            transformed(SERIES, space, e, 0)
            resolved = resolved and converges(space.work) and not (fresh and space.zero[lane, e] != 0.0)
    if resolved:
        return True
    for e in range(count):
        for j in range(8):
            space.between[e, j] = space.values[e, j]
    sample(events.values, events.used, space, many, t, h, low, width, _CHECKS)
    for e in range(count):
        for j in range(8):
            space.between[e, j], space.values[e, j] = space.values[e, j], space.between[e, j]
    resolved = True
    for e in range(count):
        if space.may_change[0, e] != 0.0:
            resolved = resolved and _resolved(space, lane, e, fresh, low + width)
    return resolved


@compiled_subset
def _resolved(space: EventWorkspace, lane: int, e: int, fresh: bool, high: float) -> bool:
    """Return whether the values ``between`` do not contradict that an expression is simple on a piece."""
    last, largest, missed = space.values[e, 7], 0.0, 0.0
    transformed(_BETWEEN, space, e, 2)
    for j in range(8):
        largest = max(largest, abs(space.values[e, j]), abs(space.between[e, j]))
        missed = max(missed, abs(space.between[e, j] - space.work[2, j]))
    if not math.isfinite(largest) or not math.isfinite(missed) or largest <= space.noise[0, e]:
        return True
    if fresh and space.zero[lane, e] != 0.0:
        same = True
        for j in range(8):
            value, theta = space.between[e, j], high * _CHECKS[j]
            crossed = value * last < 0.0 and abs(value) > max(space.noise[0, e], BENT * largest)
            same = same and not (crossed and not unresolved(value, theta, space.rates[DOUBT, e]))
        return same
    transformed(SERIES, space, e, 0)
    if _least_size(space.work, 0) > MISSED * missed:
        return True
    transformed(SLOPE_SERIES, space, e, 1)
    return _monotone(space.work, missed)


@compiled_subset
def push_halves(space: EventWorkspace, height: int, low: float, high: float, depth: float) -> int:
    """Put the halves of a piece on the stack, the first on top; return the height of the stack."""
    middle, stack = 0.5 * (low + high), space.stack
    stack[height, 0], stack[height, 1], stack[height, 2] = middle, high, depth + 1.0
    stack[height + 1, 0], stack[height + 1, 1], stack[height + 1, 2] = low, middle, depth + 1.0
    return height + 2


@compiled_subset
def state_at(space: EventWorkspace, n: int, theta: float, target: int) -> None:
    """Write the state at a fraction of the step, all of whose series are in place, to a row of ``one_point``."""
    degree = space.series.shape[1] - 1
    for m in range(n):
        value = space.series[m, degree]
        for k in range(degree - 1, -1, -1):
            value = fma(value, theta, space.series[m, k])
        space.one_point[target, m] = value


@compiled_subset
def output_at(
    code: int,
    components: NDArray[np.int64],
    space: EventWorkspace,
    target: int,
    c: int,
    t: float,
    h: float,
    theta: float,
    output: int,
) -> float:
    """Return an output of a compiled kernel at a fraction of the step.

    The components of the state that it reads are taken from their series, and written to row `target` of ``one_point``.
    """
    degree = space.series.shape[1] - 1
    for u in range(components.size):
        m = components[u]
        value = space.series[m, degree]
        for k in range(degree - 1, -1, -1):
            value = fma(value, theta, space.series[m, k])
        space.one_point[target, m] = value
    space.one_clock[0, 0] = t + theta * h
    call_code(code, row(space.one_clock, 0), row(space.one_point, target), c, 0, row(space.one_out, 0))
    return float(space.one_out[0, output])
