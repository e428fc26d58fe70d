"""Projection of a state onto the constraints, by the generated mass-orthogonal Newton corrections."""

import math

from dalembert.integrators.gains import BRANCH, SLOW
from dalembert.integrators.numba.jit import call_kernel, compiled
from dalembert.integrators.numba.packing import DELTA
from dalembert.integrators.tableau import FloatArray

MAX_CORRECTIONS = 10
_QUADRATIC = 1e-8
_LINEAR = 1e-4


@compiled
def correct(kernel: int, t: float, work: FloatArray, y: int, constants: FloatArray, n: int) -> tuple[float, float]:
    """Add one correction to ``work[y]``; return its largest entry and the largest entry that it changed."""
    call_kernel(kernel, t, work, y, constants, DELTA, n)
    size = magnitude = 0.0
    for m in range(n):
        change = abs(work[DELTA, m])
        if change != 0.0:
            size = max(size, change) if math.isfinite(change) else math.inf
            magnitude = max(magnitude, abs(work[y, m]))
            work[y, m] += work[DELTA, m]
    return size, magnitude


@compiled
def project(
    position: int,
    velocity: int,
    t: float,
    work: FloatArray,
    y: int,
    constants: FloatArray,
    atol: float,
    n: int,
) -> bool:
    """Project ``work[y]`` in place; return whether that converged.

    Newton's iteration on the positions is quadratic: after a correction below 1e-8 of what it corrects the
    rest is rounding. Where a magnitude near 0 hides that, a last correction below ``atol`` will do. The
    velocities are linear; a second correction only removes the rounding of a first one that was large, and one
    that is as large as the velocities themselves is refused.
    """
    if position != 0:
        size = magnitude = 0.0
        for _ in range(MAX_CORRECTIONS):
            size, magnitude = correct(position, t, work, y, constants, n)
            if size <= _QUADRATIC * magnitude or size == math.inf:
                break
        if not (size <= _QUADRATIC * magnitude or size <= atol):
            return False
    if velocity != 0:
        size, magnitude = correct(velocity, t, work, y, constants, n)
        if size > BRANCH * (SLOW + magnitude):
            return False
        if size > _LINEAR * magnitude and size < math.inf:
            size, magnitude = correct(velocity, t, work, y, constants, n)
        if size == math.inf:
            return False
    return True
