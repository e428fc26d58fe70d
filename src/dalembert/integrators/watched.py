"""Events of a motion: expressions that are watched, rules of their events, occurrences, and states to record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from ..arrays import FloatArray
from .dense_output import DenseOutput
from .event_rules import change_counts, recorded_after

__all__ = ["Jump", "Occurrence", "Rule", "Watched", "recorded_states"]

Jump = Callable[[float, FloatArray, float], FloatArray | None]
"""From a time, a state (n_y,) and the direction of time, 1 or -1, to the state after a jump.

None where the constraints do not allow it."""


@final
@dataclass(frozen=True, eq=False)
class Rule:
    """The rule of an event: the sign changes that count, the occurrence that ends the run (0: none), and the jump.

    A direction of 2 or -2 says that the event is armed: an expression that is zero where the motion begins, or already
    beyond it, counts as not having changed its sign yet. If it does not go back, the event occurs at once.
    """

    direction: int
    last: int
    jump: Jump | None

    def counts(self, sign: int) -> bool:
        """Whether a change to `sign` is an occurrence."""
        return change_counts(self.direction, sign)


@final
@dataclass(frozen=True, eq=False)
class Watched:
    """Expressions whose sign changes along a motion are events.

    Attributes
    ----------
    values
        From times (k,) and states (k, n_y) to the values of all expressions (k, n).
    begins
        From a time and a state (n_y,) to value, rate and noise of each expression (n, 3).
    settle
        From times and interpolated states to states on the constraints.
    rules
        One an expression.
    oscillating
        Whether expressions may oscillate within a step.
    during
        From two times to what is watched on a block of steps between them, where that differs: expressions may jump
        where blocks end.
    """

    values: Callable[[FloatArray, FloatArray], FloatArray]
    begins: Callable[[float, FloatArray], FloatArray]
    settle: Callable[[FloatArray, FloatArray], FloatArray]
    rules: Sequence[Rule]
    oscillating: bool = False
    during: Callable[[float, float], Watched] | None = None


@final
@dataclass(frozen=True, eq=False)
class Occurrence:
    """One event: its number, time, states (n_y,) before and after, and the sign that its expression changed to."""

    event: int
    t: float
    before: FloatArray
    after: FloatArray
    sign: int


def recorded_states(
    watched: Watched, wanted: FloatArray, dense: DenseOutput | None, t: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the times to record that a motion reached, and the states there (k, n_y): after a jump at that time.

    Parameters
    ----------
    wanted : ndarray (m,)
        Times to record, in the order of the motion.
    dense
        The motion, None where it took no time.
    t, y
        Accepted steps, which hold the time of a jump twice.
    """
    forward = 1.0 if t[-1] >= t[0] else -1.0
    reached = wanted[(wanted - t[-1]) * forward <= 0.0]
    at = reached.copy()
    for jumped in t[1:][t[1:] == t[:-1]]:
        k = int(np.searchsorted(reached * forward, jumped * forward))
        while k > 0 and recorded_after(reached[k - 1], jumped, forward):
            k -= 1
            at[k] = jumped
    found = np.tile(y[0], (len(reached), 1))
    if dense is not None and len(reached):
        found = watched.settle(at, dense(at))
    found[at == t[0]] = y[0]
    found[at == t[-1]] = y[-1]
    return reached, found
