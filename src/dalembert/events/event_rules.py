"""Rules of events: signs at the start, occurrences, simultaneous events, accumulation of jumps.

An expression that is zero where a motion begins is near it slope x + bend x^2 + r(x) x^3, with x the fraction of the
step; a step tells as far as it can whether the expression leaves zero to one side. Its slope is known from the kernel
of its rates, r from values along the polynomials of the step. These may be off by E x^2, and so may its bend; rates
along the polynomials give it without that error, and the difference of both is E. Eight values of an expression that
oscillates within the step do not give its bend: E is bounded by what values near the start show.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray
from ..methods.step_constants import (
    BENT,
    DOUBT,
    FLAT,
    LIKELY,
    RESOLUTION,
    RESOLVED,
    SHORT_SHARE,
    SHORT_SPAN,
    SOON,
    SOON_IN_A_ROW,
    TIME_NOISE,
    TOGETHER,
)
from ..subset.compiled_subset import compiled_subset, sqrt, square


@compiled_subset
def sign_beyond(value: float, noise: float) -> float:
    """Return the sign of a value, 0 where it is not beyond its noise."""
    return 0.0 if not abs(value) > noise else (1.0 if value > 0.0 else -1.0)


@compiled_subset
def zero_level(rate: float, noise: float, t: float) -> float:
    """Return the size below which an expression counts as zero, from its rate and its noise at a time of a motion."""
    level = noise + TIME_NOISE * abs(t) * abs(rate)
    return level if math.isfinite(level) else 0.0


@compiled_subset
def start_sign(
    value: float, rate: float, noise: float, residual: float, t: float, forward: float, direction: int
) -> tuple[float, bool]:
    """Return the sign that an expression has where a motion begins, and whether it is zero there.

    One that is zero takes the sign of its rate at once. What rounding leaves of a zero is what it makes of the state
    (``noise``) and of the time, and its residual when the zero was found, if the motion continues from one
    (``residual``). ``forward`` is the direction of time. A ``direction`` of 2 or -2 says that the event is armed
    (`dalembert.events.event_code.armed`): its expression has not changed its sign yet, even if it is zero or past
    it, and then counts as zero.
    """
    level = noise + RESOLUTION * abs(t) * abs(rate)
    zero = abs(value) <= (level if math.isfinite(level) else 0.0) + residual
    if abs(direction) > 1:
        side = -0.5 * direction
        return side, zero or not side * value > 0.0
    deciding = rate * forward if zero else value
    return sign_beyond(deciding, 0.0), zero


@compiled_subset
def carried_sign(
    before: float, value: float, rate: float, noise: float, t: float, forward: float, direction: int
) -> float:
    """Return the sign with which an expression continues after a stop; 0 where it is that of the state there.

    ``before`` is its sign when it reached the stop: NaN where a motion begins, 0 where it was not known. An armed event
    that is not zero has that of its side, wherever its expression is now.
    """
    if math.isnan(before):
        return 0.0
    if abs(direction) <= 1:
        return before
    sign, zero = start_sign(value, rate, noise, 0.0, t, forward, 0)
    return 0.0 if zero or sign == 0.0 else -0.5 * direction


@compiled_subset
def change_counts(direction: int, sign: float) -> bool:
    """Return whether a change to a sign is an occurrence of an event with a direction."""
    return direction == 0 or direction * sign > 0.0


@compiled_subset
def happens_together(gap: float, t: float, begin: float) -> bool:
    """Return whether events ``gap`` apart are simultaneous at time t, in a step or motion from ``begin`` on."""
    return abs(gap) <= TOGETHER * max(abs(t), abs(begin))


@compiled_subset
def recorded_after(wanted: float, t: float, forward: float) -> bool:
    """Return whether what is recorded at a time is the motion from an occurrence at time t on.

    So it is from the time of the occurrence on, and within rounding before it: single runs, sweeps and runs with other
    times to record take other steps, and locate the same occurrence a few roundings earlier or later.
    """
    return (t - wanted) * forward <= RESOLUTION * abs(t)


def last_instants(elapsed: FloatArray, start: float) -> FloatArray:
    """Return the last instants (k,) since a start that round to the same times as those given.

    `recorded_after` is asked about them: far from zero a time is rounded by more than what it allows.
    """
    if start == 0.0:
        return elapsed
    return elapsed + np.sign(elapsed) * 0.5 * np.spacing(np.abs(start + elapsed))


@compiled_subset
def too_soon(gap: float, span: float, before: float) -> float:
    """Return how many jumps in a row have followed the one before it too soon, from that number before this one."""
    return before + 1.0 if gap <= SOON * span else 0.0


@compiled_subset
def accumulates(gap: float, t: float, span: float, seen: bool, soon: float) -> bool:
    """Return whether jumps follow each other too fast to be separated.

    ``gap`` is the time since the jump before, ``seen`` whether what jumps was seen beyond rounding in between, and
    ``soon`` how many in a row came `too_soon`.
    """
    return gap <= RESOLUTION * max(abs(t), SHORT_SPAN * span) or not seen or soon >= SOON_IN_A_ROW


@compiled_subset
def short_share(t: float, h: float) -> float:
    """Return a share of a step from time t, as doubles tell it, over which differences of rates give a bend."""
    return ((t + SHORT_SHARE * h) - t) / h


@compiled_subset
def bend_from_rates(first: float, second: float, third: float, share: float) -> float:
    """Return half the second derivative over a step from rates where it begins, after a share of it, and after two.

    It is NaN where there is no share.
    """
    return (4.0 * second - 3.0 * first - third) / (4.0 * share) if share > 0.0 else math.nan


@compiled_subset
def error_limit(values: float, bend: float, noise: float, share: float) -> float:
    """Return a bound of the error of a bend along polynomials, from values where a step begins.

    `values` are 8 f(s) - f(2 s) - 7 f(0) - 6 s f'(0) of an expression f, for the share s; its half of the second
    derivative along the polynomials is a quarter of that over s^2. `bend` is the one without their error.
    """
    area = square(share)
    return LIKELY * (abs(0.25 * values / area - bend) + 4.0 * noise / area)


@compiled_subset
def deepest_dip(slope: float, bend: float, least: float) -> float:
    """Return how far least x^3 - bend x^2 - slope x falls below zero, for a slope of at least 0 and least above 0.

    At its minimum 3 least x^2 = 2 bend x + slope.
    """
    root = sqrt(square(bend) + 3.0 * least * slope)
    if bend >= 0.0:
        x = (bend + root) / (3.0 * least)
    else:
        x = slope / (root - bend)
    return x * (2.0 * slope + bend * x) / 3.0


@compiled_subset
def leaves_zero(
    slope: float, bend: float, twice: float, thrice: float, largest: float, noise: float, known: bool
) -> bool:
    """Return whether an expression keeps its sign on a piece that begins in its zero, but for what is next to nothing.

    Parameters
    ----------
    slope, bend : float
        Size of the slope, and the bend away from the side where the expression ends, over the piece.
    twice, thrice : float
        Least sizes of the expression divided by the second and third power of the distance, not above 0 where that may
        change its sign.
    largest, noise : float
        Its largest size, and the size below which it counts as zero.
    known : bool
        Whether it is known to leave zero to the side where it ends. Then it may dip to the other side by its noise, or
        by the share `BENT` of its largest size; else slope and bend must be nothing.
    """
    flat = slope <= FLAT * largest
    nothing = max(noise, BENT * largest)
    leaves = twice > 0.0 and (flat or (known and square(slope) <= 4.0 * twice * nothing))
    if thrice > 0.0:
        leaves = leaves or (flat and abs(bend) <= BENT * largest)
        leaves = leaves or (known and deepest_dip(slope, bend, thrice) <= nothing)
    return leaves


@compiled_subset
def slope_agrees(slope: float, last: float, largest: float) -> bool:
    """Return whether an expression leaves zero to the side where its values lie.

    It does not where it oscillates between the points.
    """
    return slope * last >= 0.0 or abs(slope) <= FLAT * largest


@compiled_subset
def bend_agrees(bend: float, last: float, twice: float) -> bool:
    """Return whether an expression that begins flat bends to where its values lie, if these say that it bends."""
    return twice <= 0.0 or (bend * last > 0.0 and 2.0 * abs(bend) >= twice)


@compiled_subset
def least_doubt(doubt: float, error: float, tail: float, limit: float) -> float:
    """Return the least error of a bend by the polynomials, as pieces tell it that become shorter.

    `tail` are the last coefficients of the expression divided by the square of the distance; where they are no small
    part of the error, the values do not tell the bend. `limit` is the `error_limit`.
    """
    return min(doubt, error, limit) if tail <= RESOLVED * error else doubt


@compiled_subset
def unresolved(value: float, theta: float, doubt: float) -> bool:
    """Return whether the error of the polynomials may have made a value at a fraction of the step that begins in zero.

    `doubt` is the error of the bend over the step, not finite where it is not known.
    """
    return doubt < math.inf and abs(value) <= DOUBT * doubt * square(theta)
