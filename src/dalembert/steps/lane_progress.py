"""Rows of numbers and flags for cases side by side in steps of the implicit method, and the progress of each case."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..subset.compiled_subset import compiled_subset, lane_count, lanes
from .recorded_runs import Run

# Rows of ``numbers``: what a lane keeps of its `Progress`, then what belongs to one attempt of a step.
TIME, LAST, DIRECTION, END_OF_STEPS, SIZE, PREVIOUS, STEPS, REJECTED, RETRIED, FRESH, LAST_SIZE, RATIO, RATE = range(13)
KNOWN_RATE, FACTORED, UNLIMITED, STEP, T_NEW, NORM, QUOTIENT, TOTAL, OF_STATE, JUDGED, BEFORE, FINITE = range(13, 25)
NUMBERS = 25

# Rows of ``flags``: whether the lane begins a motion or attempts a step, renews its Jacobian, iterates, filters its
# error (or factors its matrices) once more; how the iteration ended and after how many rounds; whether its matrices are
# regular; how the attempt ended.
BEGINS, RUNS, RENEWS, ITERATES, AGAIN, ENDED, ITERATIONS, REGULAR, RESULT = range(9)
FLAGS = 9


@compiled_subset
def marked(flags: NDArray[np.int64], which: int) -> bool:
    """Return whether a row of flags is set in a lane."""
    some = 0
    for lane in lanes():
        some += flags[which, lane]
    return some > 0


@compiled_subset
def enter_lane(numbers: FloatArray, run: Run, lane: int) -> None:
    """Make the progress of the run that of a lane; of one lane, it is."""
    if lane_count() == 1:
        return
    progress = run.progress
    progress.t, progress.t1, progress.direction = numbers[TIME, lane], numbers[LAST, lane], numbers[DIRECTION, lane]
    progress.end, progress.size = numbers[END_OF_STEPS, lane], numbers[SIZE, lane]
    progress.steps, progress.rejected = int(numbers[STEPS, lane]), int(numbers[REJECTED, lane])
    progress.retried, progress.fresh = int(numbers[RETRIED, lane]), int(numbers[FRESH, lane])
    progress.last_size, progress.previous = numbers[LAST_SIZE, lane], numbers[PREVIOUS, lane]
    progress.ratio, progress.unlimited = numbers[RATIO, lane], numbers[UNLIMITED, lane]
    progress.rate, progress.known_rate = numbers[RATE, lane], numbers[KNOWN_RATE, lane]
    progress.factored = numbers[FACTORED, lane]


@compiled_subset
def leave_lane(numbers: FloatArray, run: Run, lane: int) -> None:
    """Write the progress of the run to a lane."""
    progress = run.progress
    numbers[TIME, lane], numbers[LAST, lane], numbers[DIRECTION, lane] = progress.t, progress.t1, progress.direction
    numbers[END_OF_STEPS, lane], numbers[SIZE, lane] = progress.end, progress.size
    numbers[STEPS, lane], numbers[REJECTED, lane] = float(progress.steps), float(progress.rejected)
    numbers[RETRIED, lane], numbers[FRESH, lane] = float(progress.retried), float(progress.fresh)
    numbers[LAST_SIZE, lane], numbers[PREVIOUS, lane] = progress.last_size, progress.previous
    numbers[RATIO, lane], numbers[UNLIMITED, lane] = progress.ratio, progress.unlimited
    numbers[RATE, lane], numbers[KNOWN_RATE, lane] = progress.rate, progress.known_rate
    numbers[FACTORED, lane] = progress.factored
