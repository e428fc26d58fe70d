"""Choice of the cheaper explicit method: Taylor series, or the Runge-Kutta pair of order 8(5,3) of Dormand and Prince.

A Taylor step costs about order^2/2 multiply-adds for every product of varying factors, a Runge-Kutta step twelve
evaluations; the one wins where the right-hand side is short or the tolerance tight, the other where it is long.
"""

from __future__ import annotations

import math

from ..ir.kernel import Kernel

__all__ = ["runge_kutta_pays"]

_STEPS, _DIGITS = 1.0, 0.113
"""Steps of DOP853 for one Taylor step at rtol 1e-6, and the power of 1/rtol with which they grow."""

_SHORT = 1000
"""Lines up to which a Taylor step is straight-line code."""

_MARGIN = 0.78
"""Predicted ratio of times up to which the Runge-Kutta pair is taken: near 1 the prediction is a guess."""

_CONTROL = 1.4
"""Lines of a Taylor step that a line of its residual control counts as (measured on one to six pendulums)."""

_CALLS = {"exp": 60, "log": 60, "tan": 60, "atan": 60, "asin": 60, "acos": 60} | dict.fromkeys(
    ("atan2", "sinh", "cosh", "tanh", "pow"), 150
)
"""Lines that a function of the C library counts as, which is called lane by lane."""

_TIGHTEST = 3e-13
"""Below, rounding matters, which Taylor steps keep smaller."""


def runge_kutta_pays(rhs: Kernel, series_lines: int, control: tuple[int, int], tolerance: float) -> bool:
    """Return whether DOP853 is expected to be clearly faster than Taylor steps.

    Parameters
    ----------
    rhs : Kernel
        The right-hand side.
    series_lines : int
        Lines of the recurrences of a Taylor step, unrolled.
    control : (int, int)
        Evaluations and other lines of its residual control; 0 where there is none.
    tolerance : float
        Relative tolerance.

    Notes
    -----
    Costs are in lines of Taylor steps, fitted to measurements of the sleigh, the rolling spheres and the stiff sleigh,
    `minimal` and `projected`, for tolerances from 1e-4 to 1e-12: the pair needs some 57 lines a component and 340 in
    all besides its evaluations, a sine with its cosine counts as 12, and what a Taylor step has beyond straight-line
    code counts less. The predicted ratio of times was within a factor 1.4 of the measured one for most, and 2 for all.
    """
    if tolerance < _TIGHTEST:
        return False
    pairs = sum(line.op in ("sin", "cos") for line in rhs.body) / 2
    taylor = 280 + 1.1 * min(series_lines, _SHORT) + 0.8 * max(series_lines - _SHORT, 0)
    evaluation = len(rhs.body) + 12 * pairs + sum(_CALLS.get(line.op, 0) for line in rhs.body)
    taylor += _CONTROL * (control[0] * evaluation + control[1])
    attempt = 12 * evaluation + 57 * len(rhs.outputs) + 340
    steps = _STEPS * math.exp(-_DIGITS * math.log(1e6 * tolerance))
    return steps * attempt < _MARGIN * taylor
