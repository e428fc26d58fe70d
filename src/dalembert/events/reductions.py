"""Extrema and integrals of functions along a motion, from the Chebyshev series through eight points of a piece.

A piece of a step is cut in halves until the series is as good as the function: for an integral, until its last two
coefficients are small; for an extremum, until the piece cannot hold a better one, or the function is monotone on it,
or bends one way on it, where the zero of the slope of the series is where the extremum is. Where nothing but rounding
is left of a function it ends, too: where what varies is a share of the extremum that rounding may be (`FLAT`), or where
the budget of the step is used up (`dalembert.methods.step_constants.BUDGET`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ..arrays import FloatArray
from ..methods.chebyshev import (
    BEND_TAIL,
    BENDS,
    BETWEEN,
    CHECKS,
    CLOSE,
    COEFFICIENTS,
    CONVERGED,
    INTEGRAL,
    MISSED,
    NEGLIGIBLE,
    POINTS,
    SLOPE_TAIL,
    SLOPES,
    SMOOTH,
    TAIL,
)
from ..methods.step_constants import BUDGET, COARSE, DEEP, DEEPEST, EPSILON
from ..steps.dense_output import DenseOutput, JoinedOutput

KINDS = ("minimum", "maximum", "mean")


SHALLOW = 16
"""Halvings after which the integral of a piece is taken as it is: a jump or a kink is in it."""

FLAT = 32 * EPSILON
"""Share of the extremum up to which what a function varies by on a piece is rounding."""

DEEP_IN_MEAN = 15
"""As `dalembert.methods.step_constants.DEEP`, for integrals."""

Sample = Callable[[FloatArray], FloatArray]
Values = Callable[[int, FloatArray], FloatArray]


def running_values(
    dense: DenseOutput, sampled: Callable[[DenseOutput], Values], kinds: Sequence[str], oscillating: bool
) -> FloatArray:
    """Return minimum, maximum or integral over time (n,), as `kinds` say, of functions along a motion.

    Parameters
    ----------
    dense
        The motion.
    sampled
        From continuous output to a function from a number of a step and fractions of it (k,) to values (k, n).
    kinds
        One of `KINDS` a function.
    oscillating
        Whether functions may oscillate between eight points of a step.
    """
    parts = zip(dense.parts, dense.knots[1:], strict=True) if isinstance(dense, JoinedOutput) else [(dense, None)]
    totals = np.array([{"minimum": np.inf, "maximum": -np.inf, "mean": 0.0}[kind] for kind in kinds])
    for part, end in parts:
        values = sampled(part)
        sizes = np.diff(part.knots)
        for step, h in enumerate(sizes):
            share = 1.0 if end is None else (end - part.knots[step]) / h if h else 0.0
            if share <= 0.0:
                break
            for i, kind in enumerate(kinds):

                def sample(theta: FloatArray, step: int = step, i: int = i, values: Values = values) -> FloatArray:
                    return values(step, theta)[:, i]

                till = min(1.0, float(share))
                if kind == "mean":
                    totals[i] += h * _integral(sample, till)
                else:
                    sign = 1.0 if kind == "maximum" else -1.0
                    totals[i] = sign * _largest(sample, till, sign, sign * totals[i], oscillating)
    return totals


def _integral(sample: Sample, till: float) -> float:
    total, stack, budget, deepest = 0.0, [(0.0, till, 0)], BUDGET, SHALLOW
    while stack:
        low, high, depth = stack.pop()
        budget -= 1 if depth >= DEEP_IN_MEAN else 0
        deepest = COARSE if budget < 0 else deepest
        series = COEFFICIENTS @ sample(low + (high - low) * POINTS)
        tail, before, size = (np.abs(part).sum() for part in (series[-2:], series[-4:-2], series))
        smooth = tail * tail <= SMOOTH * size * before or tail <= NEGLIGIBLE * size
        if not smooth and depth < deepest and np.isfinite(tail):
            middle = 0.5 * (low + high)
            stack += [(middle, high, depth + 1), (low, middle, depth + 1)]
        else:
            total += (high - low) * float(INTEGRAL @ series)
    return total


def _largest(sample: Sample, till: float, sign: float, best: float, oscillating: bool) -> float:
    """Return the largest value of sign times a function over a step up to a fraction of it, at least `best`."""
    stack, budget, deepest = [(0.0, till, 0)], BUDGET, DEEPEST
    while stack:
        low, high, depth = stack.pop()
        budget -= 1 if depth >= DEEP else 0
        deepest = COARSE if budget < 0 else deepest
        values = sign * sample(low + (high - low) * POINTS)
        if not np.all(np.isfinite(values)):
            return np.nan
        series, slopes, bends = COEFFICIENTS @ values, SLOPES @ values, BENDS @ values
        varies, tail, missed = np.abs(series[1:]).sum(), np.abs(series[-2:]).sum(), 0.0
        if oscillating and tail > CONVERGED * varies:
            between = sign * sample(low + (high - low) * CHECKS)
            missed = float(np.abs(between - BETWEEN @ values).max())
            if not math.isfinite(missed):
                return np.nan
            best = max(best, float(np.max(between)))
        best = max(best, float(np.max(values)))
        if series[0] + varies + TAIL * tail + MISSED * missed <= best or depth >= deepest:
            continue
        if abs(slopes[0]) > np.abs(slopes[1:]).sum() + SLOPE_TAIL * (tail + missed):
            continue
        bent = abs(bends[0]) > np.abs(bends[1:]).sum() + BEND_TAIL * (tail + missed)
        if tail + missed <= CLOSE * varies and bent:
            if bends[0] < 0.0:
                theta = low + (high - low) * _turning(slopes)
                best = max(best, sign * float(sample(np.array([theta]))[0]))
            continue
        if varies + TAIL * tail + MISSED * missed <= FLAT * abs(best):
            continue
        middle = 0.5 * (low + high)
        stack += [(middle, high, depth + 1), (low, middle, depth + 1)]
    return best


def _turning(slopes: FloatArray) -> float:
    """Return where a slope that falls changes its sign, as a fraction of the piece."""
    low, high = -1.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if np.polynomial.chebyshev.chebval(middle, slopes) > 0.0:
            low = middle
        else:
            high = middle
    return 0.25 * (low + high) + 0.5
