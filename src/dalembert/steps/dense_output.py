"""Continuous output of a motion over its steps: one polynomial a step, and outputs one after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError
from ..methods.step_constants import EPSILON


class DenseOutput(ABC):
    """A solution that can be evaluated between its knots, forward or backward in time.

    Parameters
    ----------
    knots
        Ends of the steps (n_steps + 1,), monotone in either direction.
    """

    def __init__(self, knots: FloatArray) -> None:
        self.knots = knots

    def __call__(self, t: FloatArray) -> FloatArray:
        """Evaluate at times ``t`` (k,), in any order.

        Returns
        -------
        ndarray (k, n_y)

        Raises
        ------
        OptionError
            If a time lies outside the integrated span.
        """
        times = np.asarray(t, dtype=np.float64)
        step = self._locate(times)
        begin = self.knots[step]
        h = self.knots[step + 1] - begin
        if h.all():
            return self._evaluate(step, (times - begin) / h)
        theta = np.divide(times - begin, h, out=np.zeros_like(times), where=h != 0.0)
        return self._evaluate(step, theta)

    def within(self, step: NDArray[np.intp], theta: FloatArray) -> FloatArray:
        """Return states (k, n_y) at the fractions ``theta`` (k,) of the steps numbered ``step`` (k,)."""
        return self._evaluate(step, theta)

    def _locate(self, times: FloatArray) -> NDArray[np.intp]:
        first, last = float(self.knots[0]), float(self.knots[-1])
        low, high = min(first, last), max(first, last)
        slack = 4.0 * EPSILON * max(abs(low), abs(high))
        if times.size and not (times.min() >= low - slack and times.max() <= high + slack):
            raise OptionError(f"times must lie between {low!r} and {high!r}, which the run covers")
        if last < first:
            step = np.searchsorted(-self.knots, -times, side="right") - 1
        else:
            step = self.knots.searchsorted(times, side="right") - 1
        return np.minimum(np.maximum(step, 0), len(self.knots) - 2)

    @abstractmethod
    def _evaluate(self, step: NDArray[np.intp], theta: FloatArray) -> FloatArray:
        """Evaluate at the fractions ``theta`` (k,) of the steps numbered ``step`` (k,), giving (k, n_y)."""


@final
class PiecewisePolynomial(DenseOutput):
    """One polynomial per step, ``y(theta) = sum_k coefficients[step, k] * theta**k``.

    Parameters
    ----------
    knots
        Ends of the steps (n_steps + 1,).
    coefficients
        Coefficients (n_steps, degree + 1, n_y), lowest power first, in the fraction theta of the step; or a function
        that computes them when they are first needed.
    """

    def __init__(self, knots: FloatArray, coefficients: FloatArray | Callable[[], FloatArray]) -> None:
        super().__init__(knots)
        self._coefficients = coefficients

    @property
    def coefficients(self) -> FloatArray:
        """Coefficients (n_steps, degree + 1, n_y), lowest power first, in the fraction theta of the step."""
        found = self._coefficients
        if not isinstance(found, np.ndarray):
            found = self._coefficients = found()
        return found

    def _evaluate(self, step: NDArray[np.intp], theta: FloatArray) -> FloatArray:
        fraction, coefficients = theta[:, np.newaxis], self.coefficients
        several = max(1, _TOGETHER // max(1, coefficients.shape[1] * coefficients.shape[2]))
        value = np.empty((len(step), coefficients.shape[2]))
        for first in range(0, len(step), several):
            some = slice(first, first + several)
            _horner(coefficients[step[some]], fraction[some], value[some])
        return value


_TOGETHER = 65536
"""Coefficients that are gathered at a time: they stay in a cache."""


def _horner(coefficients: FloatArray, fraction: FloatArray, value: FloatArray) -> None:
    """Set values (k, n_y) of polynomials (k, degree + 1, n_y) at fractions (k, 1)."""
    value[...] = coefficients[:, -1]
    for power in range(coefficients.shape[1] - 2, -1, -1):
        value *= fraction
        value += coefficients[:, power]


@final
class JoinedOutput(DenseOutput):
    """Continuous outputs one after the other; the motion may jump where they meet, and is then that after the jump.

    Parameters
    ----------
    knots
        Ends of the parts (n_parts + 1,).
    parts
        One continuous output a part, of at least its length.
    """

    def __init__(self, knots: FloatArray, parts: Sequence[DenseOutput]) -> None:
        super().__init__(knots)
        self.parts = tuple(parts)

    def _evaluate(self, step: NDArray[np.intp], theta: FloatArray) -> FloatArray:
        times = self.knots[step] + theta * (self.knots[step + 1] - self.knots[step])
        order = np.argsort(step, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(step[order])) + 1)
        found = [self.parts[int(step[group[0]])](times[group]) for group in groups if len(group)]
        if not found:
            return self.parts[0](times)
        values = np.empty((len(times), found[0].shape[1]))
        values[order] = np.concatenate(found)
        return values
