"""Warnings of motions so small that the absolute tolerance decides their error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..errors import PrecisionWarning, warn_caller

if TYPE_CHECKING:
    from ..results.sweep import Sweep
    from ..results.trajectory import Trajectory

_FEW = 100.0
"""Absolute tolerances within which a motion is small: an oscillator of that size was 2e-4 to 2e-2 of its size off."""
_ROUNDING = 1e-15
"""Starts up to this size are zero but for rounding."""


def warn_of_small_motion(run: Trajectory, rtol: float, atol: float) -> None:
    """Warn of a run of which no component of the state becomes large against `atol`."""
    last = run.parts[-1].y
    # most runs end here, in half a microsecond
    if not len(last) or max(map(abs, last[-1].tolist()), default=0.0) >= _FEW * atol:
        return
    largest = max(_size(part.y) for part in run.parts)
    if largest >= _FEW * atol or not largest > _ROUNDING:
        return
    # from rest, steps let the rounding of forces grow up to `atol`
    if _size(run.parts[0].y[:1]) > _ROUNDING or largest > atol:
        _warn(f"no coordinate or rate of this motion exceeds {largest:.2g}", largest, rtol, atol)


def _size(y: FloatArray) -> float:
    """Return the largest component of states (k, n)."""
    return float(np.max(np.abs(y), initial=0.0))


def warn_of_small_cases(sweep: Sweep, rtol: float, atol: float) -> None:
    """Warn of the cases of a sweep that start, and end, with no component of the state large against `atol`."""
    sizes = np.zeros(1)
    for values in sweep.initial.values():
        sizes = np.maximum(sizes, np.abs(values))
    if not np.any((sizes > _ROUNDING) & (sizes < _FEW * atol)):
        return
    sizes = np.maximum(sizes, np.max(np.abs(sweep.y), axis=1, initial=0.0))  # NaN, of cases that failed, is not small
    small = (sizes > _ROUNDING) & (sizes < _FEW * atol)
    if np.any(small):
        largest, number = float(np.max(sizes[small])), np.count_nonzero(small)
        cases = "one case" if number == 1 else f"{number} cases"
        _warn(f"no coordinate or rate exceeds {largest:.2g} at the start and the end of {cases}", largest, rtol, atol)


def _warn(what: str, largest: float, rtol: float, atol: float) -> None:
    """Warn of a motion of a size, and say which tolerance serves it."""
    warn_caller(
        f"{what}, and atol = {atol:g} allows errors of a large share of that. Pass a smaller one, such as"
        f" atol={1e-2 * rtol * largest:.0e}, or choose units in which the motion is larger",
        PrecisionWarning,
    )
