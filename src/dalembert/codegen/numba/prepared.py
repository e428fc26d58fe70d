"""Prepared runs: the memory of one case, and a call of machine code on it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence

import numpy as np

from ...integrators.problem import FloatArray, IntegrationProblem
from ...integrators.status import Status
from .loops import loop_named, packed

__all__ = ["prepared_run"]


def prepared_run(
    codes: tuple[int, int, int, int, int],
    sizes: tuple[int, int, int],
    memory: int,
    settings: Sequence[float],
    problem: IntegrationProblem,
    steps: object,
) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, Status]]:
    """Return a function from a state (n_y,) and parameters (n_p,) to the final state (n_y,) and the status.

    Parameters
    ----------
    codes : addresses
        See `dalembert.integrators.numba.single`.
    sizes : (int, int, int)
        Number of components of the state, of parameters and of constants.
    memory : int
        How many numbers a step remembers; 0 for one that cannot be rejected.
    settings : sequence of float
        What the step reads behind the largest step and the direction of time.
    problem : IntegrationProblem
        Span, largest step and number of steps.
    steps : object
        What keeps the code at these addresses.
    """
    n, n_p, n_c = sizes
    direction = 1.0 if problem.t1 >= problem.t0 else -1.0
    states, p = np.zeros((2, n + 2 + memory)), np.zeros((1, n_p))
    outcome = np.zeros(1, np.int64)
    arguments = (
        codes,
        (n, memory, problem.max_steps),
        np.array([problem.t0, problem.t1, problem.max_step]),
        p,
        np.zeros((1, n_c)),
        np.array([[0.0, direction, *settings]]),
        np.zeros((1, 1)),
        states,
        np.zeros((n, 1)),
        np.zeros((1, 1), np.int64),
        outcome,
    )
    words = packed(arguments)
    code, pointer = loop_named("single").call, ctypes.c_void_p(words.ctypes.data)
    start, given = states[0, :n], p[0]
    statuses = tuple(Status)

    def run(state: FloatArray, parameters: FloatArray) -> tuple[FloatArray, Status]:
        start[...] = state
        given[...] = parameters
        status = statuses[code(pointer)]
        return start.copy(), status

    run.held = words, arguments, steps  # type: ignore[attr-defined]  # what the code points to lives as long as `run`
    return run
