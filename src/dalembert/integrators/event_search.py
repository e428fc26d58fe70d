"""Events of one case of a sweep: `dalembert.integrators.crossings` and `dalembert.integrators.events`, compiled.

The eight points of a piece of a step are the eight lanes of a call of the watched expressions, so that a case is
watched by itself, whatever its neighbours do.
"""

from __future__ import annotations

import math

from ..arrays import FloatArray
from ..methods.event_constants import (
    BUDGET,
    COARSE,
    DEEP,
    DEEP_COST,
    DEEPEST,
    RESIDUAL,
    ROOT_PRECISION,
    ROOT_TRIES,
    TIME_NOISE,
    TOGETHER,
)
from ..methods.status import RUNNING, Status
from ..methods.step_constants import EPSILON, SMALLEST_NORMAL
from .compiled_subset import call_code, compiled_subset, fma, row, square
from .event_intervals import push_halves, sample, simple_piece
from .event_rules import (
    accumulates,
    change_counts,
    happens_together,
    sign_beyond,
    start_sign,
    too_soon,
    zero_level,
)
from .event_series import happens_alone, sample_event_series, value_at, zero_of_series
from .workspace import EventKernels, EventWorkspace

__all__ = [
    "BROKEN",
    "NOTHING",
    "STOPPED",
    "begin_signs",
    "resolve",
    "scan",
    "starts",
    "state_at",
    "zeros_at_end",
]

NOTHING, STOPPED, BROKEN = 0, 1, 2


@compiled_subset
def begin_signs(events: EventKernels, space: EventWorkspace, lane: int, t: float, direction: float, c: int) -> None:
    """Take down the signs from which a lane starts, its state being in the first row of ``one_point``."""
    space.one_clock[0, 0] = t
    call_code(events.begins, row(space.one_clock, 0), row(space.one_point, 0), c, 0, row(space.one_out, 0))
    for e in range(events.directions.size):
        value, rate, noise = (
            space.one_out[0, 3 * e],
            space.one_out[0, 3 * e + 1],
            space.one_out[0, 3 * e + 2],
        )
        sign, zero = start_sign(value, rate, noise, space.residual[0, e], t, direction, events.directions[e])
        space.start_noise[lane, e] = noise if math.isfinite(noise) else 0.0
        space.zero[lane, e], space.signs[lane, e], space.seen[lane, e] = 1.0 if zero else 0.0, sign, 0.0


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
    """Return the zero of an expression between two fractions of the step, NaN for a pole; see `crossings.zeros`."""
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
    events: EventKernels, space: EventWorkspace, lane: int, c: int, t: float, h: float, low: float, high: float
) -> int:
    """Find the sign changes of all expressions on a simple piece, into ``found`` (fraction, event) in their order."""
    count = 0
    for e in range(events.directions.size):
        if space.may_change[0, e] == 0.0:
            continue
        first, last, noise = space.ends[0, e], space.ends[1, e], space.noise[0, e]
        for side in range(2):
            new = sign_beyond(first if side == 0 else last, noise)
            if new == 0.0:
                continue
            theta = math.nan
            if new * space.signs[lane, e] < 0.0:
                theta = low
                if side == 1 and first * new < 0.0:
                    if events.events_with_series > 0:
                        theta = zero_of_series(events, space, c, t, h, e, low, high, first, last)
                    else:
                        theta = _zero(events, space, c, t, h, e, low, high, first, last)
            space.signs[lane, e] = new
            if math.isfinite(theta):
                place = count
                while place > 0 and space.found[place - 1, 0] > theta:
                    space.found[place, 0], space.found[place, 1] = (
                        space.found[place - 1, 0],
                        space.found[place - 1, 1],
                    )
                    place -= 1
                space.found[place, 0], space.found[place, 1] = theta, e
                count += 1
                break
    return count


@compiled_subset
def _occur(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    count: int,
    t: float,
    h: float,
    happened: FloatArray,
    case: int,
) -> float:
    """Count the sign changes in ``found``; return the fraction at which the first of them stops the motion, or -1."""
    stop = -1.0
    for place in range(count):
        theta, e = space.found[place, 0], int(space.found[place, 1])
        now = t + theta * h
        if stop >= 0.0 and not happens_together((theta - stop) * h, now, t):
            break
        if not change_counts(events.directions[e], space.signs[lane, e]):
            continue
        _count(events, space, e, now, happened, case)
        if stop < 0.0 and space.happens[0, e] >= 1.0:
            stop = theta
        elif stop < 0.0:
            space.happens[0, e] = 0.0
    return stop


@compiled_subset
def _count(events: EventKernels, space: EventWorkspace, e: int, now: float, happened: FloatArray, case: int) -> None:
    """Take down an occurrence; it is marked in ``happens`` with 1 if the state jumps, 2 if the case ends, else 0.5."""
    if happened[case, 3 * e] == 0.0:
        happened[case, 3 * e + 1] = now
    happened[case, 3 * e] += 1.0
    happened[case, 3 * e + 2] = now
    ends = events.last[e] > 0 and happened[case, 3 * e] >= events.last[e]
    space.happens[0, e] = 2.0 if ends else 1.0 if events.jumps[e] != 0 else 0.5


@compiled_subset
def _begin_step(events: EventKernels, space: EventWorkspace, lane: int, one: int, t: float, h: float) -> None:
    """Take down the rates of all expressions where a step begins, and the sizes below which they count as zero."""
    if events.events_with_series == 0:
        for m in range(space.series.shape[0]):
            space.one_point[0, m] = space.series[m, 0]
        space.one_clock[0, 0] = t
        call_code(events.begins, row(space.one_clock, 0), row(space.one_point, 0), one, 0, row(space.one_out, 0))
    for e in range(events.directions.size):
        rate, noise = 0.0, space.start_noise[lane, e]
        if events.events_with_series > 0:
            rate = space.event_series[e, 1] / h
        else:
            rate, noise = space.one_out[0, 3 * e + 1], space.one_out[0, 3 * e + 2]
        space.rates[0, e], space.noise[0, e] = rate, zero_level(rate, noise, t)


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
    """Look for events in a step whose series are in place; return what became of the motion, and the fraction where.

    ``many`` and ``one`` are the addresses of the constants for eight points and for one. ``fresh`` says that the lane
    starts with this step, ``simple_step`` that each expression has at most one zero in it, ``values`` holding those
    at its ends. What stops the motion is marked in ``happens``: 1 for a jump, 2 for an end.
    """
    _begin_step(events, space, lane, one, t, h)
    for e in range(events.directions.size):
        if fresh and space.zero[lane, e] != 0.0:
            space.zero[lane, e] = max(abs(space.rates[0, e] * h), SMALLEST_NORMAL)
        space.happens[0, e] = 0.0
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
                sample(events.values, events.used, space, many, t, h, low, high - low)
            simple, finite = simple_piece(events.directions, space, lane, fresh and low == 0.0, high)
        budget -= DEEP_COST if depth >= DEEP else 1
        if budget < 0:
            deepest = COARSE
        if not (simple or depth >= deepest or high - low <= least):
            height = push_halves(space, height, low, high, depth)
            continue
        if not finite:
            return BROKEN, low
        _take_ends(events, space, lane, fresh and low == 0.0)
        number = _find(events, space, lane, one, t, h, low, high)
        stop = _occur(events, space, lane, number, t, h, happened, case)
        if stop >= 0.0:
            return STOPPED, stop
        for e in range(events.directions.size):
            if space.may_change[0, e] != 0.0 and abs(space.ends[1, e]) > space.noise[0, e]:
                space.seen[lane, e] = 1.0
    return NOTHING, 1.0


@compiled_subset
def _take_ends(events: EventKernels, space: EventWorkspace, lane: int, fresh: bool) -> None:
    """Take down the values at the ends of a piece; ``fresh`` says that it begins where the lane starts."""
    for e in range(events.directions.size):
        if space.may_change[0, e] == 0.0:
            continue
        space.ends[0, e], space.ends[1, e] = space.values[e, 0], space.values[e, 7]
        if fresh and space.zero[lane, e] != 0.0:
            space.ends[0, e] = 0.0
        if abs(space.ends[0, e]) > space.noise[0, e]:
            space.seen[lane, e] = 1.0


@compiled_subset
def starts(events: EventKernels, space: EventWorkspace, lane: int, t: float, direction: float, one: int) -> None:
    """Begin a case in a lane, its state being in the first row of ``one_point``."""
    space.jumped[lane, 0], space.jumped[lane, 1] = math.nan, 0.0
    for e in range(events.directions.size):
        space.residual[0, e] = 0.0
    begin_signs(events, space, lane, t, direction, one)


@compiled_subset
def zeros_at_end(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    t: float,
    direction: float,
    one: int,
    happened: FloatArray,
    case: int,
) -> bool:
    """Look for expressions that are zero at the very end, the state there being in ``one_point``; see `scan`."""
    count = 0
    for e in range(events.directions.size):
        space.residual[0, e] = space.happens[0, e] = 0.0
        space.ends[0, e] = space.signs[lane, e]
    begin_signs(events, space, lane, t, direction, one)
    for e in range(events.directions.size):
        if space.zero[lane, e] != 0.0 and space.signs[lane, e] * space.ends[0, e] < 0.0:
            space.found[count, 0], space.found[count, 1] = 0.0, e
            count += 1
            space.seen[lane, e] = 1.0
    return _occur(events, space, lane, count, t, 0.0, happened, case) >= 0.0


@compiled_subset
def resolve(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    n: int,
    t: float,
    direction: float,
    span: float,
    one: int,
    happened: FloatArray,
    case: int,
    theta: float,
) -> int:
    """Let happen what `scan` marked, at time t in the state in ``one_point``, which becomes that after it.

    `theta` is the fraction of the step where that is, 1 or more at its end.

    Returns the status that it gives the case, `RUNNING` where that goes on.
    """
    if events.events_with_series > 0 and theta < 1.0 and happens_alone(events, space, theta):
        return Status.EVENT
    space.one_clock[0, 0] = t
    call_code(events.begins, row(space.one_clock, 0), row(space.one_point, 0), one, 0, row(space.one_out, 0))
    _count_together(events, space, lane, t, direction, happened, case)
    ended, jumps, seen = False, False, True
    for e in range(events.directions.size):
        here = space.happens[0, e] > 0.0
        space.residual[0, e] = RESIDUAL * abs(space.one_out[0, 3 * e]) if here else 0.0
        ended = ended or space.happens[0, e] == 2.0
        jumps = jumps or (here and events.jumps[e] != 0)
        seen = seen and (not here or space.seen[lane, e] != 0.0)
    for e in range(events.directions.size):
        if space.happens[0, e] > 0.0 and events.jumps[e] != 0 and not _jump(events, space, n, e, one):
            return Status.EVENT_STATE
    if ended:
        return Status.EVENT
    return _status_after_jump(space, lane, t, span, seen) if jumps else RUNNING


@compiled_subset
def _count_together(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    t: float,
    direction: float,
    happened: FloatArray,
    case: int,
) -> None:
    """Count what is zero to rounding where something happens, and about to change its sign, as happening there too."""
    for e in range(events.directions.size):
        value, rate, noise = (
            space.one_out[0, 3 * e],
            space.one_out[0, 3 * e + 1],
            space.one_out[0, 3 * e + 2],
        )
        crosses = space.signs[lane, e] * rate * direction < 0.0
        if crosses and space.happens[0, e] == 0.0 and abs(value) <= noise + TOGETHER * abs(t) * abs(rate):
            if change_counts(events.directions[e], -space.signs[lane, e]):
                _count(events, space, e, t, happened, case)
                space.seen[lane, e] = 1.0


@compiled_subset
def _jump(events: EventKernels, space: EventWorkspace, n: int, e: int, one: int) -> bool:
    """Apply the jump of an event to the state in ``one_point``; return whether the constraints allow it."""
    clock, before, after = row(space.one_clock, 0), row(space.one_point, 0), row(space.one_point, 1)
    call_code(events.jumps[e], clock, before, one, 0, after)
    call_code(events.start, clock, after, one, 0, row(space.one_out, 0))
    total = 0.0
    for m in range(n + events.checks):
        total += 0.0 * space.one_out[0, m]
    for m in range(n, n + events.checks, 2):
        total = total if abs(space.one_out[0, m]) <= space.one_out[0, m + 1] else math.nan
    if total != 0.0:
        return False
    for m in range(n):
        space.one_point[0, m] = space.one_out[0, m]
    return True


@compiled_subset
def _status_after_jump(space: EventWorkspace, lane: int, t: float, span: float, seen: bool) -> int:
    """Return the status of a lane whose state has jumped, from the jumps before."""
    gap, space.jumped[lane, 0] = abs(t - space.jumped[lane, 0]), t
    if math.isnan(gap):
        return RUNNING
    space.jumped[lane, 1] = too_soon(gap, span, space.jumped[lane, 1])
    return Status.EVENTS_ACCUMULATE if accumulates(gap, t, span, seen, space.jumped[lane, 1]) else RUNNING
