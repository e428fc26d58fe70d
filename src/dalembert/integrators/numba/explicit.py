"""The adaptive explicit Runge-Kutta loop: compiled once, then used for all models and all tableaux.

Kernels and tableaux are arguments of the compiled loop. A first process on a machine compiles it, later ones
load it from numba's disk cache.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, final

import numpy as np
from numba import types

from dalembert.integrators.digest import integrator_digest
from dalembert.integrators.gains import SMALLEST_PREVIOUS, SMALLEST_SCALE, STRETCH
from dalembert.integrators.numba.control import growth, reduction, smallest_step
from dalembert.integrators.numba.jit import VECTOR, call_kernel, compiled, compiled_and_cached, kernel_address
from dalembert.integrators.numba.packing import PACKED_TABLEAU, POINT, PackedTableau, pack
from dalembert.integrators.numba.projection import project
from dalembert.integrators.numba.stages import (
    HELD_STEPS,
    LANES,
    WATCHED_FROM,
    all_finite,
    at_boundary,
    dense_polynomial,
    error_norm,
    evaluate_polynomial,
    evaluate_stages,
    first_step_size,
    store,
    with_room,
)
from dalembert.integrators.problem import (
    FloatArray,
    IntegrationProblem,
    Kernels,
    PiecewisePolynomial,
    Solution,
)
from dalembert.integrators.status import Status
from dalembert.integrators.tableau import Tableau


class Addresses(NamedTuple):
    """Addresses of the kernels; 0 where there is none."""

    rhs: int
    position: int
    velocity: int


class Settings(NamedTuple):
    """The numbers of an integration problem; ``first_step`` is 0 where it is to be chosen."""

    t0: float
    t1: float
    rtol: float
    atol: float
    first_step: float
    max_step: float
    max_steps: int
    sampled: bool
    dense: bool
    watched: bool


class Record(NamedTuple):
    """What the compiled loop returns.

    The first ``recorded`` of ``rows`` (capacity, 1 + n_y) are recorded times and states; the first ``steps``
    of ``pieces`` (capacity, 1 + (degree + 1)*n_y) are ends of steps and their polynomials, if they were asked
    for.
    """

    status: int
    steps: int
    rejected: int
    evaluations: int
    recorded: int
    rows: FloatArray
    pieces: FloatArray


@final
@dataclass(frozen=True, eq=False)
class Held:
    """Where a watched run was stopped: time, size of the last step, and state (n_y,)."""

    t: float
    step: float
    y: FloatArray


ADDRESSES = types.NamedUniTuple(types.intp, 3, Addresses)
SETTINGS = types.NamedTuple((types.float64,) * 6 + (types.intp, types.boolean, types.boolean, types.boolean), Settings)

_SUCCESS = int(Status.SUCCESS)
_MAX_STEPS = int(Status.MAX_STEPS)
_STEP_TOO_SMALL = int(Status.STEP_TOO_SMALL)
_NON_FINITE = int(Status.NON_FINITE)
_PROJECTION_FAILED = int(Status.PROJECTION_FAILED)

_CAPACITY = 64
_STOPPED = -1


def integrate(
    kernels: Kernels | Addresses, tableau: Tableau, problem: IntegrationProblem, *, watched: bool = False
) -> Solution | Held:
    """Integrate a problem with an explicit Runge-Kutta pair.

    Parameters
    ----------
    kernels
        Functions jitted by numba for ``void(float64, float64[::1], float64[::1], float64[::1])``, with
        ``error_model="numpy"``, or the addresses of code under numba's calling convention for that.
    tableau
        The method.
    problem
        The problem; its arrays are copied.
    watched
        Whether to stop where stability, not accuracy, holds the steps for long.

    Returns
    -------
    Solution or Held
        Numerical failure is its status, never an exception. `Held` where the run was stopped.
    """
    if isinstance(kernels, Kernels):
        functions = (kernels.rhs, kernels.project_position, kernels.project_velocity)
        kernels = Addresses(*map(kernel_address, functions))
    settings = Settings(
        float(problem.t0),
        float(problem.t1),
        float(problem.rtol),
        max(float(problem.atol), SMALLEST_SCALE),
        float(problem.first_step or 0.0),
        float(problem.max_step),
        int(problem.max_steps),
        problem.t_eval is not None,
        bool(problem.dense),
        watched,
    )
    t_eval = np.array(() if problem.t_eval is None else problem.t_eval, dtype=np.float64)
    y0 = np.array(problem.y0, dtype=np.float64)
    constants = np.array(problem.constants, dtype=np.float64)
    record = Record(*_compiled_loop()(kernels, pack(tableau), settings, y0, constants, t_eval))
    if record.status == _STOPPED:
        t, step, state = record.rows[0, 0], record.rows[1, 0], record.rows[0, 1:].copy()
        return Held(float(t), float(step), state)
    return _solution(record, problem)


def _solution(record: Record, problem: IntegrationProblem) -> Solution:
    rows = record.rows[: record.recorded]
    return Solution(
        status=Status(record.status),
        t=rows[:, 0].copy(),
        y=rows[:, 1:].copy(),
        steps=record.steps,
        rejected=record.rejected,
        evaluations=record.evaluations,
        dense=_dense_output(record, problem) if problem.dense else None,
    )


def _dense_output(record: Record, problem: IntegrationProblem) -> PiecewisePolynomial:
    """Collect the polynomials of the accepted steps, or a constant where there was none."""
    n = len(problem.y0)
    if record.steps == 0:
        return PiecewisePolynomial(np.full(2, float(problem.t0)), np.array(problem.y0, dtype=float).reshape(1, 1, n))
    pieces = record.pieces[: record.steps]
    knots = np.concatenate([[problem.t0], pieces[:, 0]])
    return PiecewisePolynomial(knots, pieces[:, 1:].copy().reshape(record.steps, -1, n))


@compiled
def _settle(
    kernels: Addresses,
    tableau: PackedTableau,
    settings: Settings,
    error: float,
    t_new: float,
    work: FloatArray,
    constants: FloatArray,
    y_new: int,
    n: int,
) -> tuple[int, int]:
    """Judge a step, project its end, evaluate the stage there; return the verdict and the evaluations."""
    if not math.isfinite(error):
        return _NON_FINITE, 0
    if error > 1.0:
        return _STEP_TOO_SMALL, 0
    evaluations = 0
    projected = kernels.position != 0 or kernels.velocity != 0
    if projected and not project(kernels.position, kernels.velocity, t_new, work, y_new, constants, settings.atol, n):
        return _PROJECTION_FAILED, 0
    if projected or not tableau.fsal:
        call_kernel(kernels.rhs, t_new, work, y_new, constants, tableau.first + tableau.end, n)
        evaluations = 1
    finite = all_finite(work, y_new, tableau.first + tableau.end)
    return (_SUCCESS if finite else _NON_FINITE), evaluations


@compiled
def _sample(
    kernels: Addresses,
    tableau: PackedTableau,
    settings: Settings,
    pieces: FloatArray,
    piece: int,
    t: float,
    t_new: float,
    work: FloatArray,
    constants: FloatArray,
    t_eval: FloatArray,
    first: int,
    rows: FloatArray,
) -> tuple[int, int]:
    """Record the times to evaluate inside a step; return the number of the next one and the status."""
    n, point = rows.shape[1] - 1, int(np.intp(POINT))
    projected = kernels.position != 0 or kernels.velocity != 0
    for k in range(first, t_eval.size):
        if (t_eval[k] - t_new) * (t_new - t) >= 0.0:
            return k, _SUCCESS
        evaluate_polynomial(pieces, piece, tableau.degree, (t_eval[k] - t) / (t_new - t), work, n)
        if projected and not project(
            kernels.position, kernels.velocity, t_eval[k], work, point, constants, settings.atol, n
        ):
            return k, _PROJECTION_FAILED
        store(rows, k, t_eval[k], work, point)
    return t_eval.size, _SUCCESS


@cache
def _compiled_loop() -> Callable[..., tuple[Any, ...]]:
    """Compile the loop, or load it from the disk cache."""
    return _entry_point(integrator_digest())


def _entry_point(digest: str) -> Callable[..., tuple[Any, ...]]:
    """Compile the loop under a cache key that holds ``digest``, for numba hashes what closure cells hold."""

    def adaptive_loop(
        kernels: Addresses,
        tableau: PackedTableau,
        settings: Settings,
        y0: FloatArray,
        constants: FloatArray,
        t_eval: FloatArray,
    ) -> tuple[int, int, int, int, int, FloatArray, FloatArray]:
        digest  # noqa: B018
        n, t, t1 = y0.size, settings.t0, settings.t1
        span, direction = abs(t1 - t), 1.0 if t1 >= t else -1.0
        work = np.zeros((tableau.first + tableau.total, (n + LANES - 1) // LANES * LANES))
        # Numbers that have been through np.intp are not literals, for which numba would compile helpers once more.
        y, y_new = int(np.intp(0)), int(np.intp(1))
        for m in range(n):
            work[y, m] = y0[m]

        rows = np.empty((max(t_eval.size, 1) if settings.sampled else _CAPACITY, 1 + n))
        pieces = np.empty((_CAPACITY if settings.dense else 1, 1 + (tableau.degree + 1) * n))
        steps = rejected = recorded = evaluations = int(np.intp(0))
        if not settings.sampled:
            rows, recorded = store(rows, recorded, t, work, y), recorded + 1
        while recorded < t_eval.size and t_eval[recorded] == t:
            rows, recorded = store(rows, recorded, t, work, y), recorded + 1

        call_kernel(kernels.rhs, t, work, y, constants, tableau.first, n)
        evaluations += 1
        status = _SUCCESS if all_finite(work, y, tableau.first) else _NON_FINITE
        size, previous, retried = settings.first_step, SMALLEST_PREVIOUS, False
        held = int(np.intp(0))
        if status == _SUCCESS and size == 0.0 and span > 0.0:
            limit = min(span, settings.max_step)
            size = first_step_size(
                kernels.rhs, tableau, t, direction, limit, work, constants, y, settings.rtol, settings.atol, n
            )
            evaluations += 1

        while status == _SUCCESS and t != t1:
            if steps + rejected >= settings.max_steps:
                status = _MAX_STEPS
                break
            size = min(max(size, smallest_step(t, span)), settings.max_step)
            ends = size * STRETCH >= abs(t1 - t)
            h = t1 - t if ends else direction * size
            t_new = t1 if ends else t + h
            evaluate_stages(
                kernels.rhs, tableau, (int(np.intp(1)), tableau.end + 1), t, h, work, constants, y, y_new, n
            )
            error = error_norm(tableau, h, work, y, y_new, settings.rtol, settings.atol, n)
            evaluations += tableau.end if tableau.fsal else tableau.end - 1
            failure, more = _settle(kernels, tableau, settings, error, t_new, work, constants, y_new, n)
            evaluations += more
            if failure != _SUCCESS:
                rejected += 1
                retried = True
                size = abs(h) * reduction(failure, error, tableau.exponent)
                if size < smallest_step(t, span):
                    status = failure
                continue

            if settings.watched and steps >= WATCHED_FROM:  # before the point of the last stage is overwritten
                held = held + 1 if at_boundary(tableau, h, work, y_new, n) else 0
            pending = recorded < t_eval.size and (t_eval[recorded] - t_new) * direction < 0.0
            if settings.dense or pending:
                piece = steps if settings.dense else 0
                pieces = with_room(pieces, piece)
                evaluate_stages(
                    kernels.rhs, tableau, (tableau.end + 1, tableau.total), t, h, work, constants, y, y_new, n
                )
                evaluations += tableau.total - tableau.end - 1
                dense_polynomial(tableau, h, work, y, y_new, pieces, piece, n)
                pieces[piece, 0] = t_new
                if pending:
                    recorded, status = _sample(
                        kernels,
                        tableau,
                        settings,
                        pieces,
                        piece,
                        t,
                        t_new,
                        work,
                        constants,
                        t_eval,
                        recorded,
                        rows,
                    )
            while recorded < t_eval.size and t_eval[recorded] == t_new:
                rows, recorded = store(rows, recorded, t_new, work, y_new), recorded + 1
            if not settings.sampled:
                rows, recorded = store(rows, recorded, t_new, work, y_new), recorded + 1
            steps += 1
            if held == HELD_STEPS:
                rows = store(store(rows, 1, abs(h), work, y_new), 0, t_new, work, y_new)
                status = _STOPPED
                break
            size = abs(h) * growth(error, previous, retried, tableau.exponent)
            previous, retried = max(error, SMALLEST_PREVIOUS), False
            t = t_new
            y, y_new = y_new, y
            for m in range(n):
                work[tableau.first, m] = work[tableau.first + tableau.end, m]
        return status, steps, rejected, evaluations, recorded, rows, pieces

    return compiled_and_cached(adaptive_loop, (ADDRESSES, PACKED_TABLEAU, SETTINGS, VECTOR, VECTOR, VECTOR))
