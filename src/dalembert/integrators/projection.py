"""Projection of many states onto the constraints, each until it holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.step_constants import BRANCH, SLOW
from .compiled_subset import bare, call_code, flat, row

__all__ = ["FAILED", "NONE", "WANTED", "correct", "corrected"]

NONE, WANTED, FAILED = 0, 1, 3
_SETTLED = 2
_MAX_CORRECTIONS, _LINEAR_CORRECTIONS = 10, 2
_QUADRATIC = 1e-8
_LINEAR = 1e-4


@bare
def correct(
    position: int,
    velocity: int,
    clock: FloatArray,
    states: FloatArray,
    first: int,
    constants: FloatArray,
    delta: FloatArray,
    whole: NDArray[np.int64],
    marks: int,
) -> None:
    """Project the states of the lanes that a row of ``whole`` marks as wanted; those where that fails are marked so.

    ``states`` holds the states from row `first` on; ``delta`` (n, lanes) is room.
    """
    lanes = clock.shape[1]
    for kernel, tries in ((position, _MAX_CORRECTIONS), (velocity, _LINEAR_CORRECTIONS)):
        left = 0
        for lane in range(lanes):
            left += 1 if whole[marks, lane] == WANTED else 0
        if kernel == 0:
            left = 0
        for attempt in range(tries):
            if left == 0:
                break
            call_code(kernel, row(clock, 0), row(states, first), row(constants, 0), 0, row(delta, 0))
            for lane in range(lanes):
                if whole[marks, lane] != WANTED:
                    continue
                change = finite = size = magnitude = 0.0
                for m in range(delta.shape[0]):
                    if delta[m, lane] != 0.0:
                        size, magnitude = max(size, abs(delta[m, lane])), max(magnitude, abs(states[first + m, lane]))
                    states[first + m, lane] += delta[m, lane]
                    change = max(change, abs(delta[m, lane]) / (SLOW + abs(states[first + m, lane])))
                    finite += 0.0 * delta[m, lane]
                lost = attempt == 0 and tries == _LINEAR_CORRECTIONS and size > BRANCH * (SLOW + magnitude)
                if lost or finite != 0.0 or (attempt == tries - 1 and not change <= _LINEAR):
                    whole[marks, lane] = FAILED
                    left -= 1
                elif not change > _QUADRATIC:
                    whole[marks, lane] = _SETTLED
                    left -= 1
        for lane in range(lanes):
            if whole[marks, lane] == _SETTLED:
                whole[marks, lane] = WANTED


@bare
def corrected(
    position: int,
    velocity: int,
    clock: FloatArray,
    states: FloatArray,
    number: int,
    constants: FloatArray,
    delta: FloatArray,
    mark: NDArray[np.int64],
) -> bool:
    """Project the state that begins a row of ``states``; return whether that came about.

    ``clock`` (1, 1) holds its time; ``delta`` (n, 1) and ``mark`` (1, 1) are room.
    """
    mark[0, 0] = WANTED
    correct(position, velocity, clock, flat(states), number * states.shape[1], constants, delta, mark, 0)
    return mark[0, 0] == WANTED
