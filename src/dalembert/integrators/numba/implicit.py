"""The adaptive loop of Radau IIA of order 5, for stiff systems and for index-2 systems with multipliers.

Compiled once, then used for all models; kernels are arguments. Source of the method, of its Newton iteration, error
estimate and step control: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.8; of the
predictive control: K. Gustafsson, ACM Transactions on Mathematical Software 20 (1994) 496-517.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types

from dalembert.integrators.collocation import NODES
from dalembert.integrators.digest import integrator_digest
from dalembert.integrators.gains import SMALLEST_SCALE, STRETCH
from dalembert.integrators.numba.control import smallest_step
from dalembert.integrators.numba.implicit_stages import (
    BROKEN,
    CONVERGED,
    MAX_ITERATIONS,
    ROWS,
    SLOPE,
    Z,
    between,
    estimate,
    evaluate_jacobian,
    factor_matrices,
    first_step,
    keep_polynomial,
    newton,
    predict,
    scale_of,
    write_polynomial,
)
from dalembert.integrators.numba.jit import VECTOR, call_kernel, compiled, compiled_and_cached
from dalembert.integrators.numba.packing import POINT
from dalembert.integrators.numba.projection import project
from dalembert.integrators.numba.stages import all_finite, evaluate_polynomial, store, with_room
from dalembert.integrators.problem import FloatArray, IntegrationProblem, PiecewisePolynomial, Solution
from dalembert.integrators.status import Status

DEGREE = 3


class ImplicitCode(NamedTuple):
    """Addresses of kernels under numba's calling convention, 0 where there is none.

    Either ``jacobian``, which writes the derivatives of ``rhs`` row by row, or ``tangent``, which writes its derivative
    along the second half of a state of twice the length, must be there.
    """

    rhs: int
    jacobian: int
    tangent: int
    position: int
    velocity: int


class Setting(NamedTuple):
    """The numbers of a problem; of n components the first ``differential`` have rates, the first ``kept`` are recorded.

    ``first_step`` is 0 where it is to be chosen.
    """

    t0: float
    t1: float
    rtol: float
    atol: float
    first_step: float
    max_step: float
    max_steps: int
    kept: int
    differential: int
    sampled: bool
    dense: bool


_CODE = types.NamedUniTuple(types.intp, 5, ImplicitCode)
_SETTING = types.NamedTuple((types.float64,) * 6 + (types.intp,) * 3 + (types.boolean,) * 2, Setting)

_SUCCESS = int(Status.SUCCESS)
_MAX_STEPS = int(Status.MAX_STEPS)
_STEP_TOO_SMALL = int(Status.STEP_TOO_SMALL)
_NON_FINITE = int(Status.NON_FINITE)
_PROJECTION_FAILED = int(Status.PROJECTION_FAILED)

_CAPACITY = 64
_SAFETY, _LARGEST_GROWTH, _LARGEST_REDUCTION = 0.9, 8.0, 0.2
_RATE_TO_KEEP_JACOBIAN, _GROWTH_TO_KEEP_FACTORS = 1e-3, 1.2


def integrate(code: ImplicitCode, problem: IntegrationProblem, multipliers: FloatArray | None = None) -> Solution:
    """Integrate a problem with Radau IIA of order 5.

    Parameters
    ----------
    code
        Addresses of the kernels; they must stay alive.
    problem
        The problem; its arrays are copied.
    multipliers
        Initial values (k,) of components without rates, which the kernels know behind those of the state.

    Returns
    -------
    Solution
        Of the state alone. Numerical failure is its status, never an exception.
    """
    n = len(problem.y0)
    y0 = np.concatenate([problem.y0, [] if multipliers is None else multipliers]).astype(np.float64)
    setting = Setting(
        float(problem.t0),
        float(problem.t1),
        float(problem.rtol),
        max(float(problem.atol), SMALLEST_SCALE),
        float(problem.first_step or 0.0),
        float(problem.max_step),
        int(problem.max_steps),
        n,
        n,
        problem.t_eval is not None,
        bool(problem.dense),
    )
    t_eval = np.array(() if problem.t_eval is None else problem.t_eval, dtype=np.float64)
    constants = np.array(problem.constants, dtype=np.float64)
    status, steps, rejected, evaluations, recorded, rows, pieces = _compiled_loop()(
        code, setting, y0, constants, t_eval
    )
    return Solution(
        status=Status(status),
        t=rows[:recorded, 0].copy(),
        y=rows[:recorded, 1:].copy(),
        steps=steps,
        rejected=rejected,
        evaluations=evaluations,
        dense=_dense_output(problem, steps, pieces) if problem.dense else None,
    )


def _dense_output(problem: IntegrationProblem, steps: int, pieces: FloatArray) -> PiecewisePolynomial:
    """Collect the polynomials of the accepted steps, or a constant where there was none."""
    n = len(problem.y0)
    if steps == 0:
        return PiecewisePolynomial(np.full(2, float(problem.t0)), np.array(problem.y0, dtype=float).reshape(1, 1, n))
    knots = np.concatenate([[problem.t0], pieces[:steps, 0]])
    return PiecewisePolynomial(knots, pieces[:steps, 1:].copy().reshape(steps, DEGREE + 1, n))


@compiled
def _sample(
    code: ImplicitCode,
    setting: Setting,
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
    projected = code.position != 0 or code.velocity != 0
    for k in range(first, t_eval.size):
        if (t_eval[k] - t_new) * (t_new - t) >= 0.0:
            return k, _SUCCESS
        evaluate_polynomial(pieces, piece, DEGREE, (t_eval[k] - t) / (t_new - t), work, n)
        if projected and not project(code.position, code.velocity, t_eval[k], work, point, constants, setting.atol, n):
            return k, _PROJECTION_FAILED
        store(rows, k, t_eval[k], work, point)
    return t_eval.size, _SUCCESS


@compiled
def _finish(
    code: ImplicitCode, setting: Setting, t_new: float, work: FloatArray, y_new: int, constants: FloatArray
) -> tuple[int, int]:
    """Project the end of a step and evaluate the slope there; return the verdict and the evaluations."""
    projected = code.position != 0 or code.velocity != 0
    if projected and not project(
        code.position, code.velocity, t_new, work, y_new, constants, setting.atol, setting.kept
    ):
        return _PROJECTION_FAILED, 0
    call_kernel(code.rhs, t_new, work, y_new, constants, int(np.intp(SLOPE)), work.shape[1])
    return (_SUCCESS if all_finite(work, y_new, int(np.intp(SLOPE))) else _NON_FINITE), 1


@compiled
def _shrinkage(error: float, iterations: int) -> float:
    """Return what the step is to be divided by, were the next error as this one; slow iterations ask for more."""
    share = (2 * MAX_ITERATIONS + 1) / (2 * MAX_ITERATIONS + iterations)
    return max(1.0 / _LARGEST_GROWTH, min(1.0 / _LARGEST_REDUCTION, error**0.25 / (_SAFETY * share)))


@compiled
def _predicted(quotient: float, h: float, last: float, error: float, previous: float) -> float:
    """Return what the step is to be divided by where its error goes on to change as it last did."""
    guess = last / abs(h) * (error * error / previous) ** 0.25 / _SAFETY
    guess = max(1.0 / _LARGEST_GROWTH, min(1.0 / _LARGEST_REDUCTION, guess))
    return max(quotient, guess)


@cache
def _compiled_loop() -> Callable[..., tuple[Any, ...]]:
    """Compile the loop, or load it from the disk cache."""
    return _entry_point(integrator_digest())


def _entry_point(digest: str) -> Callable[..., tuple[Any, ...]]:
    """Compile the loop under a cache key that holds ``digest``, for numba hashes what closure cells hold."""

    def implicit_loop(
        code: ImplicitCode,
        setting: Setting,
        y0: FloatArray,
        constants: FloatArray,
        t_eval: FloatArray,
    ) -> tuple[int, int, int, int, int, FloatArray, FloatArray]:
        digest  # noqa: B018
        n, kept, t, t1 = y0.size, setting.kept, setting.t0, setting.t1
        span, direction = abs(t1 - t), 1.0 if t1 >= t else -1.0
        rtol, atol = setting.rtol, setting.atol
        work = np.zeros((ROWS, n))
        y, y_new, slope = int(np.intp(0)), int(np.intp(1)), int(np.intp(SLOPE))
        for m in range(n):
            work[y, m] = y0[m]
        j, wide = np.zeros((n, n)), np.zeros((2, max(n * n, 2 * n)))
        real, pair = np.zeros((n, n)), np.zeros((n, n), np.complex128)
        real_pivots, pair_pivots = np.zeros(n, np.intp), np.zeros(n, np.intp)

        rows = np.empty((max(t_eval.size, 1) if setting.sampled else _CAPACITY, 1 + kept))
        pieces = np.empty((_CAPACITY if setting.dense else 1, 1 + (DEGREE + 1) * kept))
        steps = rejected = recorded = int(np.intp(0))
        if not setting.sampled:
            rows, recorded = store(rows, recorded, t, work, y), recorded + 1
        while recorded < t_eval.size and t_eval[recorded] == t:
            rows, recorded = store(rows, recorded, t, work, y), recorded + 1

        call_kernel(code.rhs, t, work, y, constants, slope, n)
        evaluations = int(np.intp(1))
        status = _SUCCESS if all_finite(work, y, slope) else _NON_FINITE
        # Newton stops where its error does not show in the estimate of the step's.
        tolerance = max(10.0 * 2.2e-16 / max(rtol, 1e-14), min(0.03, math.sqrt(max(rtol, 1e-14))))
        size = setting.first_step
        if status == _SUCCESS and size == 0.0 and span > 0.0:
            size = first_step(work, y, setting.differential, span, min(span, setting.max_step), rtol, atol)
        last, previous, ratio, rate = 0.0, 1e-2, 0.0, 1.0
        known_rate, factored = 1.0, 0.0
        fresh, retried = False, False

        while status == _SUCCESS and t != t1:
            if steps + rejected >= setting.max_steps:
                status = _MAX_STEPS
                break
            size = min(max(size, smallest_step(t, span)), setting.max_step)
            ends = size * STRETCH >= abs(t1 - t)
            h = t1 - t if ends else direction * size
            t_new = t1 if ends else t + h
            if not fresh and rate > _RATE_TO_KEEP_JACOBIAN:
                evaluate_jacobian(code.jacobian, code.tangent, t, work, y, constants, j, wide)
                fresh, factored = True, 0.0
            regular = factored == h
            if not regular:
                regular = factor_matrices(h, setting.differential, j, real, pair, real_pivots, pair_pivots)
                factored = h if regular else 0.0
            scale_of(work, y, setting.differential, h, rtol, atol, tolerance)
            outcome, iterations = BROKEN, 0
            if regular:
                predict(work, ratio * abs(h))
                known_rate = max(known_rate, 2.2e-16) ** 0.8
                outcome, iterations, rate = newton(
                    code.rhs, t, h, setting.differential, work, y, constants,
                    real, pair, real_pivots, pair_pivots, tolerance, known_rate,
                )  # fmt: skip
                evaluations += 3 * iterations
                if iterations > 1:
                    known_rate = rate / (1.0 - rate) if rate < 0.99 else 1.0
            if outcome != CONVERGED:
                known_rate = 1.0
                rejected += 1
                if fresh:  # else the Jacobian may be at fault, not the step
                    size, retried, ratio = 0.5 * abs(h), True, 0.0
                    if size < smallest_step(t, span):
                        status = _NON_FINITE if outcome == BROKEN else _STEP_TOO_SMALL
                rate = 1.0
                continue
            for m in range(n):
                work[y_new, m] = work[y, m] + work[Z + 2, m]
            error, more = estimate(
                code.rhs, t, h, setting.differential, work, y, y_new, constants, real, real_pivots,
                rtol, atol, retried or steps == 0,
            )  # fmt: skip
            evaluations += more
            if last != 0.0:
                spread = between(work, y, y_new, setting.differential, abs(h) / last, rtol, atol)
                error = max(error, spread)
            failure = _SUCCESS if error <= 1.0 else _STEP_TOO_SMALL
            if not error < np.inf:
                failure, error = _NON_FINITE, 1e4
            quotient = _shrinkage(error, iterations)
            if failure == _SUCCESS:
                failure, more = _finish(code, setting, t_new, work, y_new, constants)
                evaluations += more
                if failure != _SUCCESS:
                    quotient = 1.0 / _LARGEST_REDUCTION
                    call_kernel(code.rhs, t, work, y, constants, slope, n)
                    evaluations += 1
            if failure != _SUCCESS:
                rejected += 1
                retried, ratio = True, 0.0
                size = abs(h) / max(quotient, 1.0 / _SAFETY)
                if size < smallest_step(t, span):
                    status = failure
                continue

            keep_polynomial(work)
            pending = recorded < t_eval.size and (t_eval[recorded] - t_new) * direction < 0.0
            if setting.dense or pending:
                piece = steps if setting.dense else 0
                pieces = with_room(pieces, piece)
                write_polynomial(work, y, y_new, pieces, piece, kept)
                pieces[piece, 0] = t_new
                if pending:
                    recorded, status = _sample(
                        code, setting, pieces, piece, t, t_new, work, constants, t_eval, recorded, rows
                    )
            while recorded < t_eval.size and t_eval[recorded] == t_new:
                rows, recorded = store(rows, recorded, t_new, work, y_new), recorded + 1
            if not setting.sampled:
                rows, recorded = store(rows, recorded, t_new, work, y_new), recorded + 1
            steps += 1
            if last != 0.0:
                quotient = _predicted(quotient, h, last, error, previous)
            growth = 1.0 / quotient
            if retried:
                growth = min(growth, 1.0)
            last, previous, retried, fresh = abs(h), max(error, 1e-2), False, False
            ratio = 1.0 / abs(h)
            if not (rate <= _RATE_TO_KEEP_JACOBIAN and 1.0 <= growth <= _GROWTH_TO_KEEP_FACTORS and not ends):
                size = abs(h) * growth
            t = t_new
            y, y_new = y_new, y
        return status, steps, rejected, evaluations, recorded, rows, pieces

    return compiled_and_cached(implicit_loop, (_CODE, _SETTING, VECTOR, VECTOR, VECTOR))


assert NODES[2] == 1.0
