"""Decisions on events: signs at the start, what counts, what happens together, and whether jumps accumulate.

Single runs call them as plain Python; in sweeps they are compiled.
"""

from __future__ import annotations

import math

from ..methods.event_constants import RESOLUTION, SHORT_SPAN, SOON, SOON_IN_A_ROW, TIME_NOISE, TOGETHER
from .compiled_subset import compiled_subset

__all__ = ["accumulates", "change_counts", "happens_together", "sign_beyond", "start_sign", "too_soon", "zero_level"]


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
    (``noise``) and of the time, and what was left when the zero was found, if the motion goes on from one
    (``residual``). ``forward`` is the direction of time. A ``direction`` of 2 or -2 says that the event is armed
    (`dalembert.integrators.event_code.armed`): its expression has not changed its sign yet, even if it is zero or past
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
def change_counts(direction: int, sign: float) -> bool:
    """Return whether a change to a sign is an occurrence of an event with a direction."""
    return direction == 0 or direction * sign > 0.0


@compiled_subset
def happens_together(gap: float, t: float, begin: float) -> bool:
    """Return whether what lies apart by ``gap`` happens together at time t, in a step or motion from ``begin`` on."""
    return abs(gap) <= TOGETHER * max(abs(t), abs(begin))


@compiled_subset
def too_soon(gap: float, span: float, before: float) -> float:
    """Return how many jumps in a row have followed the one before it too soon, from that number before this one."""
    return before + 1.0 if gap <= SOON * span else 0.0


@compiled_subset
def accumulates(gap: float, t: float, span: float, seen: bool, soon: float) -> bool:
    """Return whether jumps follow each other too fast to be told apart.

    ``gap`` is the time since the jump before, ``seen`` whether what jumps was seen beyond rounding in between, and
    ``soon`` how many in a row came `too_soon`.
    """
    return gap <= RESOLUTION * max(abs(t), SHORT_SPAN * span) or not seen or soon >= SOON_IN_A_ROW
