"""Rules of events: signs at the start, occurrences, simultaneous events, accumulation of jumps."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray
from ..methods.step_constants import RESOLUTION, SHORT_SPAN, SOON, SOON_IN_A_ROW, TIME_NOISE, TOGETHER
from ..subset.compiled_subset import compiled_subset


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
    """Return the sign with which an expression goes on behind a stop; 0 where it is that of the state there.

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
