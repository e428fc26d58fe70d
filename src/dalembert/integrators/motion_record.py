"""Record of a motion that events cut in parts: accepted steps and continuous output."""

from __future__ import annotations

from typing import final

import numpy as np

from ..arrays import FloatArray
from .dense_output import DenseOutput, JoinedOutput
from .problem import Solution

__all__ = ["MotionRecord"]


@final
class MotionRecord:
    """Accepted steps and continuous output of a motion, as far as it has been integrated.

    Parameters
    ----------
    t : float
        Start of the motion [s].
    size : int
        Components of the state.
    controlled : bool
        Whether controllers act where blocks of steps begin.
    """

    def __init__(self, t: float, size: int, *, controlled: bool) -> None:
        self._size, self._controlled = size, controlled
        self._times: list[FloatArray] = []
        self._states: list[FloatArray] = []
        self._knots = [t]
        self._parts: list[DenseOutput] = []

    def joined(self) -> tuple[FloatArray, FloatArray, DenseOutput | None]:
        """Return times (k,), states (k, n_y), and the continuous output, None of a motion that took no time."""
        dense = JoinedOutput(np.array(self._knots), self._parts) if self._parts else None
        return np.concatenate(self._times), np.concatenate(self._states), dense

    def add(self, t: FloatArray, y: FloatArray) -> None:
        """Record states (k, n_y) at times (k,), or one state (n_y,)."""
        self._times.append(np.asarray(t, dtype=float))
        self._states.append(np.asarray(y, dtype=float).reshape(len(self._times[-1]), self._size))

    def take(self, block: Solution) -> None:
        """Record a whole block of steps."""
        assert block.dense is not None
        self._follow_act(block)
        self.add(block.t[1:], block.y[1:])
        self._parts.append(block.dense)
        self._knots.append(float(block.dense.knots[-1]))

    def cut(self, block: Solution, t: float, y: FloatArray, forward: float) -> None:
        """Record a block of steps up to time t, where the state is y; `forward` is the direction of time."""
        self._follow_act(block)
        kept = (block.t - t) * forward < 0.0
        kept[0] = False
        self.add(block.t[kept], block.y[kept])
        if t != self._knots[-1]:
            assert block.dense is not None
            self.add(np.array([t]), y)
            self._parts.append(block.dense)
            self._knots.append(t)

    def _follow_act(self, block: Solution) -> None:
        """Replace the last record by the state after the actions of controllers, in which a block begins."""
        if self._controlled:
            last = max(k for k, states in enumerate(self._states) if len(states))
            self._states[last] = np.concatenate([self._states[last][:-1], block.y[:1]])
