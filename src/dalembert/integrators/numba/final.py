"""Prepared runs: from a state and parameters to the final state, with as little as possible around the compiled code."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from ..problem import FloatArray
from ..status import Status
from .march import RUNNING, marching_loop
from .series import StepCode

__all__ = ["final_state"]


def final_state(
    code: StepCode,
    prepare: int,
    sizes: tuple[int, int, int],
    span: tuple[float, float, float],
    floor: float,
    max_steps: int,
) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, Status]]:
    """Return a function from a state (n_y,) and parameters (n_p,) to the final state (n_y,) and the status.

    Parameters
    ----------
    code : StepCode
        A Taylor step that writes no series.
    prepare : int
        Address of the code that computes the constants of parameters.
    sizes : (int, int, int)
        Number of components of the state, of parameters and of constants.
    span : (float, float, float)
        Start, end and largest step.
    floor : float
        atol / rtol.
    max_steps : int
        Steps after which a run ends.
    """
    (n, n_p, n_c), t0 = sizes, span[0]
    loop = marching_loop()
    clock = np.array(span)
    settings = np.array([[0.0, 1.0 if span[1] >= span[0] else -1.0, floor]])
    initial, parameters, constants = np.empty((1, n)), np.empty(n_p), np.empty((1, n_c))
    rows, times = np.empty((2, n + 2)), np.empty(0)
    ends = initial[0], rows[0, :n], rows[1, :n]
    # addresses are taken once: asking an array for its own costs more than a short run
    prepare_code = ctypes.CFUNCTYPE(None, *(ctypes.c_void_p,) * 2)(prepare)
    source, target = parameters.ctypes.data, constants.ctypes.data
    step, position, velocity = code.step, code.position, code.velocity
    first = initial[0]
    statuses = {int(status): status for status in Status} | {RUNNING: Status.MAX_STEPS}

    def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        clock[0] = t0
        first[:] = state
        parameters[:] = p
        prepare_code(source, target)
        status, count = loop(step, position, velocity, clock, settings, initial, constants, rows, times, max_steps)
        return ends[2 - count % 2 if count else 0].copy(), statuses[status]

    return run
