"""Events with Taylor series of their own, computed along with those of the state.

Sign changes are then located on the series. One evaluation of the expression corrects the result for the terms that the
series leave out.
"""

from __future__ import annotations

import math

from ..arrays import FloatArray
from ..lanes.workspace import EventKernels, EventWorkspace
from ..methods.chebyshev import POINTS, SLOPE_TAIL, TAIL
from ..methods.step_constants import FLAT, TIME_NOISE
from ..subset.compiled_subset import call_code, compiled_subset, fma, row, sqrt
from .event_intervals import output_at, state_at

_POINTS = POINTS.copy()
_NEWTON, _CLOSE, _NEAR = 60, 1e-7, 1e-5
_CORRECTIONS, _CORRECTED = 6, 1e-16
"""Steps with the expression itself, the first by the slope of the series, others by secants; and the product of two
changes in a row, as shares of the piece, behind which nothing is left to correct."""


@compiled_subset
def value_at(
    events: EventKernels, space: EventWorkspace, c: int, t: float, h: float, theta: float, event: int
) -> float:
    """Return one expression at a fraction of the step, of the state on the constraints where steps are projected."""
    if events.position == 0 and events.velocity == 0:
        return output_at(events.value, events.used, space, 0, c, t, h, theta, event)
    n = space.series.shape[0]
    state_at(space, n, theta, 0)
    space.one_clock[0, 0] = t + theta * h
    clock, point, out = row(space.one_clock, 0), row(space.one_point, 0), row(space.one_out, 0)
    for correction in range(4):
        code = events.position if correction < 2 else events.velocity
        if code != 0:
            call_code(code, clock, point, c, 0, out)
            for m in range(n):
                space.one_point[0, m] += space.one_out[0, m]
    call_code(events.value, clock, point, c, 0, out)
    return float(space.one_out[0, event])


@compiled_subset
def load_event_series(space: EventWorkspace, lane: int, states: FloatArray, first: int, h: float) -> None:
    """Load the series, in the fraction of the step, of events that may change their sign from those of integrals."""
    count, terms = space.event_series.shape
    power = 1.0
    for k in range(terms):
        space.powers[0, k] = power * (k + 1)
        power *= h
    for e in range(count):
        if space.may_change[0, e] != 0.0:
            for k in range(terms):
                space.event_series[e, k] = states[first + e * (terms + 1) + k + 1, lane] * space.powers[0, k]


@compiled_subset
def at_most_one_zero(space: EventWorkspace, lane: int, fresh: bool) -> bool:
    """Return whether the series show that each event keeps its sign in a step or is monotone, with at most one zero.

    The least that a polynomial can be is its first coefficient and what the others can take away, for powers of
    fractions lie between 0 and 1. Then ``values`` get the values at the ends of the step. An event that is zero where
    the motion begins is divided by the fraction, or where it leaves zero flatly by its square.
    """
    count, terms = space.event_series.shape
    for e in range(count):
        if space.may_change[0, e] == 0.0:
            continue
        curve = space.event_series[e]
        begin, slope, bend = curve[0], curve[1], curve[2]
        tail = abs(curve[terms - 1]) + abs(curve[terms - 2])
        here = 1.0 if begin > 0.0 else -1.0
        way = 1.0 if slope > 0.0 else -1.0
        turn = 1.0 if bend > 0.0 else -1.0
        end = begin + slope + bend
        above = abs(begin) + min(0.0, here * slope) + min(0.0, here * bend) - TAIL * tail
        leaving = abs(slope) + min(0.0, way * bend) - TAIL * tail
        steep = abs(slope) + 2.0 * min(0.0, way * bend) - SLOPE_TAIL * tail
        bent = abs(bend) - TAIL * tail
        for k in range(3, terms):
            term = curve[k]
            end += term
            above += min(0.0, here * term)
            leaving += min(0.0, way * term)
            steep += float(k) * min(0.0, way * term)
            bent += min(0.0, turn * term)
        space.values[e, 0], space.values[e, 7] = begin, end
        if not math.isfinite(end):
            return False
        if above > 0.0 or steep > 0.0:
            continue
        if not (fresh and space.zero[lane, e] != 0.0):
            return False
        flat = slope * bend >= 0.0 or abs(slope) <= FLAT * bent
        if not (leaving > 0.0 or (bent > 0.0 and flat)):
            return False
    return True


@compiled_subset
def no_sign_change(space: EventWorkspace, lane: int, t: float, h: float, fresh: bool) -> bool:
    """Return whether no event ends a step with `at_most_one_zero` with another sign; the signs are seen then."""
    for e in range(space.event_series.shape[0]):
        if space.may_change[0, e] == 0.0:
            continue
        noise = space.start_noise[lane, e] + TIME_NOISE * abs(t * space.event_series[e, 1] / h)
        first, last, sign = space.values[e, 0], space.values[e, 7], space.signs[lane, e]
        if fresh and space.zero[lane, e] != 0.0:
            first = 0.0
        if not (last * sign > 0.0 and abs(last) > noise) or (first * sign < 0.0 and abs(first) > noise):
            return False
    for e in range(space.event_series.shape[0]):
        if space.may_change[0, e] != 0.0:
            space.signs[lane, e] = 1.0 if space.values[e, 7] > 0.0 else -1.0
            space.seen[lane, e] = 1.0
    return True


@compiled_subset
def sample_event_series(space: EventWorkspace, low: float, width: float) -> None:
    """Evaluate the events that may change their sign at the eight points of a piece of the step, into ``values``."""
    count, terms = space.event_series.shape
    x0, x1, x2, x3 = (
        low + width * _POINTS[0],
        low + width * _POINTS[1],
        low + width * _POINTS[2],
        low + width * _POINTS[3],
    )
    x4, x5, x6, x7 = (
        low + width * _POINTS[4],
        low + width * _POINTS[5],
        low + width * _POINTS[6],
        low + width * _POINTS[7],
    )
    for e in range(count):
        if space.may_change[0, e] == 0.0:
            continue
        a = b = c = d = p = q = r = s = space.event_series[e, terms - 1]
        for k in range(terms - 2, -1, -1):
            term = space.event_series[e, k]
            a, b, c, d = fma(a, x0, term), fma(b, x1, term), fma(c, x2, term), fma(d, x3, term)
            p, q, r, s = fma(p, x4, term), fma(q, x5, term), fma(r, x6, term), fma(s, x7, term)
        values = space.values[e]
        values[0], values[1], values[2], values[3] = a, b, c, d
        values[4], values[5], values[6], values[7] = p, q, r, s


@compiled_subset
def _series_at(space: EventWorkspace, event: int, theta: float) -> tuple[float, float]:
    """Return value and slope of an event at a fraction of the step."""
    last = space.event_series.shape[1] - 1
    value, slope = space.event_series[event, last], 0.0
    for k in range(last - 1, -1, -1):
        slope = fma(slope, theta, value)
        value = fma(value, theta, space.event_series[event, k])
    return value, slope


@compiled_subset
def _guessed(first: float, slope: float, last: float, otherwise: float) -> float:
    """Return the zero of the parabola with these values at 0 and 1 and this slope at 0, if it lies between them."""
    root = sqrt(max(slope * slope - 4.0 * (last - first - slope) * first, 0.0))
    theta = 2.0 * first / (root - slope if first > 0.0 else -root - slope)
    return theta if theta > 0.0 and theta < 1.0 else otherwise


@compiled_subset
def zero_of_series(
    events: EventKernels,
    space: EventWorkspace,
    c: int,
    t: float,
    h: float,
    event: int,
    low: float,
    high: float,
    first: float,
    last: float,
) -> float:
    """Return the zero of an event on a monotone piece of the step, from ``first`` at one end to ``last`` at the other.

    Newton's method on its series, within a bracket, then with the expression itself, because the series are truncated:
    one step where tolerances are tight, and further ones where they are loose.
    """
    a, b = low, high
    theta = low + (high - low) * (first / (first - last))
    if low == 0.0 and high == 1.0:
        theta = _guessed(first, space.event_series[event, 1], last, theta)
    value, slope = _series_at(space, event, theta)
    for _ in range(_NEWTON):
        if (value > 0.0) == (first > 0.0):
            a = theta
        else:
            b = theta
        following = theta - value / slope
        if not (following > a and following < b):
            following = 0.5 * (a + b)
        done = abs(following - theta) <= _CLOSE * (high - low)
        theta = following
        value, slope = _series_at(space, event, theta)
        if done:
            break
    before = earlier = 0.0
    for attempt in range(_CORRECTIONS):
        value = value_at(events, space, c, t, h, theta, event)
        if attempt > 0 and value != earlier:
            slope = (value - earlier) / before
        exact = theta - value / slope
        if not math.isfinite(exact):
            break
        exact = min(max(exact, low), high)
        change = exact - theta
        size = abs(change) if attempt == 0 else abs(before)
        theta, before, earlier = exact, change, value
        if abs(change) * size <= _CORRECTED * (high - low) * (high - low):
            break
    return theta


@compiled_subset
def happens_alone(events: EventKernels, space: EventWorkspace, theta: float) -> bool:
    """Return whether no other event that may change its sign is near zero where something happens."""
    nothing = True
    for e in range(events.directions.size):
        if space.happens[0, e] == 0.0 and space.may_change[0, e] != 0.0:
            size = 0.0
            for k in range(space.event_series.shape[1]):
                size += abs(space.event_series[e, k])
            value, _ = _series_at(space, e, theta)
            nothing = nothing and abs(value) > _NEAR * size
    return nothing
