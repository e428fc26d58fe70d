"""Search for events in a step of one case.

A step is cut in halves until on each piece an expression keeps its sign or is monotone, as far as the Chebyshev series
through its values at eight points can tell (`dalembert.events.event_intervals`). A sign change on a monotone piece
is then one zero, located by Chandrupatla's method (Advances in Engineering Software 28, 1997). The eight points are the
lanes of one call of the watched expressions, so that a case is watched by itself, whatever its neighbours do.
"""

from __future__ import annotations

import math

from ..arrays import FloatArray
from ..lanes.workspace import BEND, DOUBT, LIMIT, RATE, EventKernels, EventWorkspace
from ..methods.chebyshev import POINTS
from ..methods.step_constants import BUDGET, COARSE, DEEP, DEEPEST, EPSILON, ROOT_PRECISION, ROOT_TRIES, TIME_NOISE
from ..subset.compiled_subset import compiled_subset, square
from .event_begins import take_begins
from .event_intervals import push_halves, resolved_piece, sample, simple_piece, state_at
from .event_rules import (
    bend_from_rates,
    change_counts,
    error_limit,
    happens_together,
    short_share,
    sign_beyond,
    unresolved,
    zero_level,
)
from .event_series import sample_event_series, value_at, zero_of_series

NOTHING, STOPPED, BROKEN = 0, 1, 2
_POINTS = POINTS.copy()


@compiled_subset
def _zero(
    events: EventKernels,
    space: EventWorkspace,
    c: int,
    t: float,
    h: float,
    event: int,
    a: float,
    b: float,
    fa: float,
    fb: float,
) -> float:
    """Return the zero of an expression between two fractions of the step, NaN for a pole."""
    x1, f1, x2, f2, x3, f3 = b, fb, a, fa, a, fa
    largest, least = max(abs(fa), abs(fb)), EPSILON * max(abs(t), abs(t + h)) / abs(h)
    share, best, f_best = 0.5, x1, f1
    for _ in range(ROOT_TRIES):
        x = x1 + share * (x2 - x1)
        f = value_at(events, space, c, t, h, x, event)
        if (f > 0.0) == (f1 > 0.0):
            x3, f3 = x1, f1
        else:
            x3, f3, x2, f2 = x2, f2, x1, f1
        x1, f1 = x, f
        best, f_best = (x2, f2) if abs(f2) < abs(f1) else (x1, f1)
        nearest = (ROOT_PRECISION * abs(best) + least) / abs(x2 - x1)
        if not nearest <= 0.5 or f_best == 0.0:
            break
        xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
        bend = f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        share = 0.5
        if phi * phi < xi and square(1.0 - phi) < 1.0 - xi and math.isfinite(bend):
            share = min(max(bend, nearest), 1.0 - nearest)
    return best if abs(f_best) <= largest else math.nan


@compiled_subset
def _find(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    c: int,
    t: float,
    h: float,
    low: float,
    high: float,
    side: int,
) -> int:
    """Find the sign changes of all expressions, into ``found`` (fraction, event) in their order.

    On side 0 they are those at the beginning of a simple piece, on side 1 those in it.
    """
    count = 0
    for e in range(events.directions.size):
        if space.may_change[0, e] == 0.0:
            continue
        first, last = space.ends[0, e], space.ends[1, e]
        new = sign_beyond(first if side == 0 else last, space.noise[0, e])
        changes = new * space.signs[lane, e] < 0.0
        space.signs[lane, e] = new if new != 0.0 else space.signs[lane, e]
        if not changes:
            continue
        theta = low
        if side == 1 and first * new < 0.0:
            if events.events_with_series > 0:
                theta = zero_of_series(events, space, c, t, h, e, low, high, first, last)
            else:
                theta = _zero(events, space, c, t, h, e, low, high, first, last)
        if math.isfinite(theta):
            place = count
            while place > 0 and space.found[place - 1, 0] > theta:
                space.found[place, 0], space.found[place, 1] = space.found[place - 1, 0], space.found[place - 1, 1]
                place -= 1
            space.found[place, 0], space.found[place, 1] = theta, e
            count += 1
    return count


@compiled_subset
def occur(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    count: int,
    t: float,
    h: float,
    happened: FloatArray,
    case: int,
) -> float:
    """Count the sign changes in ``found``; return the fraction at which the first of them stops the motion, or -1.

    Those that happen together with it have its time, at which the motion is over.
    """
    stop = -1.0
    for place in range(count):
        theta, e = space.found[place, 0], int(space.found[place, 1])
        now = t + theta * h
        if stop >= 0.0 and not happens_together((theta - stop) * h, now, t):
            break
        if not change_counts(events.directions[e], space.signs[lane, e]):
            continue
        now = now if stop < 0.0 else t + stop * h
        count_occurrence(events, space, e, now, space.signs[lane, e], happened, case)
        if stop < 0.0 and space.happens[0, e] >= 1.0:
            stop = theta
        elif stop < 0.0:
            space.happens[0, e] = 0.0
    return stop


@compiled_subset
def count_occurrence(
    events: EventKernels, space: EventWorkspace, e: int, now: float, sign: float, happened: FloatArray, case: int
) -> None:
    """Record an occurrence, a change to a sign.

    It is marked in ``happens`` with 1 if the state jumps, 2 if the case ends, else 0.5.
    """
    if happened[case, 3 * e] == 0.0:
        happened[case, 3 * e + 1] = now
    happened[case, 3 * e] += 1.0
    happened[case, 3 * e + 2] = now
    ends = events.last[e] > 0 and happened[case, 3 * e] >= events.last[e]
    space.happens[0, e] = 2.0 if ends else 1.0 if events.jumps[e] != 0 else 0.5
    if space.occurrences.shape[0] > 0:
        space.occurrences[0, 0] += 1.0
        place = int(space.occurrences[0, 0])
        if place < space.occurrences.shape[0]:
            space.occurrences[place, 0], space.occurrences[place, 1], space.occurrences[place, 2] = float(e), now, sign
            space.occurrences[place, 3], space.occurrences[place, 4] = space.happens[0, e], space.occurrences[0, 1]


@compiled_subset
def _begin_step(events: EventKernels, space: EventWorkspace, lane: int, one: int, t: float, h: float) -> None:
    """Record the rates of all expressions at the beginning of a step, and the sizes below which they count as zero."""
    if events.events_with_series == 0:
        for m in range(space.series.shape[0]):
            space.one_point[0, m] = space.series[m, 0]
        take_begins(events, space, lane, one, t)
    for e in range(events.directions.size):
        rate, noise = 0.0, space.start_noise[lane, e]
        if events.events_with_series > 0:
            rate = space.event_series[e, 1] / h
        else:
            rate, noise = space.one_out[0, 3 * e + 1], space.one_out[0, 3 * e + 2]
        space.rates[RATE, e], space.noise[0, e] = rate, zero_level(rate, noise, t)


@compiled_subset
def scan(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    many: int,
    one: int,
    t: float,
    h: float,
    fresh: bool,
    simple_step: bool,
    happened: FloatArray,
    case: int,
) -> tuple[int, float]:
    """Search for events in a step whose series are in place; return the outcome, and the fraction where it is.

    ``many`` and ``one`` are the addresses of the constants for eight points and for one. ``fresh`` says that the lane
    starts with this step, ``simple_step`` that each expression has at most one zero in it, ``values`` holding those
    at its ends. Events that stop the motion are marked in ``happens``: 1 for a jump, 2 for an end.
    """
    _begin_step(events, space, lane, one, t, h)
    for e in range(events.directions.size):
        space.happens[0, e] = 0.0
        if fresh:
            space.rates[BEND, e], space.rates[DOUBT, e] = math.nan, math.inf
    least = TIME_NOISE * max(abs(t), abs(t + h)) / abs(h)
    space.stack[0, 0], space.stack[0, 1], space.stack[0, 2] = 0.0, 1.0, 0.0
    height, budget, deepest = 1, BUDGET, DEEPEST
    while height > 0:
        height -= 1
        low, high, depth = space.stack[height, 0], space.stack[height, 1], space.stack[height, 2]
        simple = finite = simple_step and depth == 0.0
        if not simple:
            if events.events_with_series > 0:
                sample_event_series(space, low, high - low)
            else:
                sample(events.values, events.used, space, many, t, h, low, high - low, _POINTS)
            simple, finite = simple_piece(events.directions, space, lane, fresh and low == 0.0, high, h)
            if simple and finite and events.oscillating != 0 and depth < deepest and high - low > least:
                simple = resolved_piece(events, space, lane, many, t, h, low, high - low, fresh and low == 0.0)
            if not simple and fresh and low == 0.0 and _wants_bends(events, space):
                _find_bends(events, space, lane, one, t, h)
                height += 1  # the same piece once more
                continue
        budget -= 1 if depth >= DEEP else 0
        if budget < 0:
            deepest = COARSE
        if not (simple or depth >= deepest or high - low <= least):
            height = push_halves(space, height, low, high, depth)
            continue
        if not finite:
            return BROKEN, low
        _take_ends(events, space, lane, fresh, low, high)
        for side in range(2):
            number = _find(events, space, lane, one, t, h, low, high, side)
            stop = occur(events, space, lane, number, t, h, happened, case)
            if stop >= 0.0:
                return STOPPED, stop
        for e in range(events.directions.size):
            if space.may_change[0, e] != 0.0 and abs(space.ends[1, e]) > space.noise[0, e]:
                space.seen[lane, e] = 1.0
    return NOTHING, 1.0


@compiled_subset
def _wants_bends(events: EventKernels, space: EventWorkspace) -> bool:
    """Return whether the bend of an expression decides where a step begins."""
    wanted = False
    for e in range(events.directions.size):
        wanted = wanted or (space.may_change[0, e] != 0.0 and space.rates[BEND, e] == math.inf)
    return wanted


@compiled_subset
def _find_bends(events: EventKernels, space: EventWorkspace, lane: int, one: int, t: float, h: float) -> None:
    """Find the bends of expressions where a step begins, without the errors of its polynomials; -inf is not known."""
    if events.events_with_series > 0:
        for e in range(events.directions.size):
            space.rates[BEND, e], space.rates[DOUBT, e], space.rates[LIMIT, e] = space.event_series[e, 2], 0.0, 0.0
        return
    share = short_share(t, h)
    for part in range(3):
        theta = share * (2.0 - part)
        state_at(space, space.series.shape[0], theta, 0)
        take_begins(events, space, lane, one, t + theta * h)
        for e in range(events.directions.size):
            value, rate, slope = space.one_out[0, 3 * e], space.one_out[0, 3 * e + 1] * h, space.rates[RATE, e] * h
            if part == 0:
                space.rates[BEND, e], space.rates[LIMIT, e] = rate, -value
            elif part == 1:
                bend = bend_from_rates(slope, rate, space.rates[BEND, e], share)
                space.rates[BEND, e] = bend if math.isfinite(bend) else -math.inf
                space.rates[LIMIT, e] += 8.0 * value - 6.0 * share * slope
            elif share > 0.0:
                values = space.rates[LIMIT, e] - 7.0 * value
                space.rates[LIMIT, e] = error_limit(values, space.rates[BEND, e], space.noise[0, e], share)
                if events.exact != 0:
                    space.rates[LIMIT, e] = 0.0


@compiled_subset
def _take_ends(events: EventKernels, space: EventWorkspace, lane: int, fresh: bool, low: float, high: float) -> None:
    """Record the values at the ends of a piece; ``fresh`` says that the step begins where the lane starts.

    What the error of the polynomials may have made of an expression that was zero there is none, until it is seen.
    """
    for e in range(events.directions.size):
        if space.may_change[0, e] == 0.0:
            continue
        space.ends[0, e], space.ends[1, e] = space.values[e, 0], space.values[e, 7]
        if fresh and space.zero[lane, e] != 0.0:
            if low == 0.0:
                space.ends[0, e] = 0.0
            if space.seen[lane, e] == 0.0 and unresolved(space.ends[0, e], low, space.rates[DOUBT, e]):
                space.ends[0, e] = 0.0
                if unresolved(space.ends[1, e], high, space.rates[DOUBT, e]):
                    space.ends[1, e] = 0.0
        if abs(space.ends[0, e]) > space.noise[0, e]:
            space.seen[lane, e] = 1.0
