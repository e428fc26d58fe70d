"""The adaptive loop of Radau IIA of order 5, for stiff systems and for index-2 systems with multipliers.

Source of the method, of its Newton iteration, error estimate and step control: E. Hairer, G. Wanner, Solving Ordinary
Differential Equations II, section IV.8; of the predictive control: K. Gustafsson, ACM Transactions on Mathematical
Software 20 (1994) 496-517.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np

from ..arrays import FloatArray
from ..methods.collocation import NODES
from ..methods.status import Status
from .compiled_subset import bare
from .implicit_stages import between, estimate, first_step, keep_polynomial, scale_of, write_polynomial
from .kinds import INTEGER, Group
from .newton import (
    BROKEN,
    CONVERGED,
    MAX_ITERATIONS,
    ROOM,
    ROWS,
    SLOPE,
    Room,
    Z,
    evaluate_jacobian,
    factor_matrices,
    newton,
    predict,
    room,
)
from .problem import IntegrationProblem, Solution
from .recorded_runs import (
    BEGUN,
    EVALUATIONS,
    FURTHER_COUNT,
    FURTHER_NUMBERS,
    LIMIT,
    PREVIOUS,
    REJECTED,
    RETRIED,
    ROW,
    RUN,
    SETTINGS,
    SIZE,
    STEPS,
    Run,
    Settings,
    T,
    all_finite,
    coming,
    evaluate,
    follow,
    pending,
    project,
    record,
    refused,
    settings_of,
    solution,
)
from .taylor_runs import RUNNING

__all__ = ["DEGREE", "KINDS", "LOOP", "Addresses", "ImplicitCode", "integrate"]

DEGREE = 3

_SUCCESS, _MAX_STEPS = int(Status.SUCCESS), int(Status.MAX_STEPS)
_STEP_TOO_SMALL, _NON_FINITE = int(Status.STEP_TOO_SMALL), int(Status.NON_FINITE)
_PROJECTION_FAILED = int(Status.PROJECTION_FAILED)

# Size of the last step, its inverse where its polynomial can be continued, rate of convergence of its iteration, what
# the first correction of the next is judged by, and the step that the matrices are factored for; 0 for none.
_LAST, _RATIO, _RATE, _KNOWN_RATE, _FACTORED = range(FURTHER_NUMBERS, FURTHER_NUMBERS + 5)
_FRESH = FURTHER_COUNT  # whether the Jacobian is that of the present state

_SAFETY, _LARGEST_GROWTH, _LARGEST_REDUCTION = 0.9, 8.0, 0.2
_RATE_TO_KEEP_JACOBIAN, _GROWTH_TO_KEEP_FACTORS = 1e-3, 1.2
_EPSILON = 2.2e-16


class Addresses(NamedTuple):
    """Addresses of kernels, see `ImplicitCode`."""

    rhs: int
    jacobian: int
    tangent: int
    position: int
    velocity: int


@final
@dataclass(frozen=True)
class ImplicitCode:
    """Compiled code, which must stay alive: the loop of this module, and what it calls; 0 for what there is not.

    Kernels have the arguments of a step (`dalembert.transforms.taylor.STEP_ARGUMENTS`). Either ``jacobian``, which
    writes the derivatives of ``rhs`` row by row, or ``tangent``, which writes its derivative along the second half
    of a state of twice the length, must be there.
    """

    loop: Callable[..., int]
    rhs: int
    jacobian: int
    tangent: int
    position: int = 0
    velocity: int = 0


KINDS = (Group((INTEGER,) * 5, Addresses._fields), SETTINGS, ROOM, RUN)


def integrate(code: ImplicitCode, problem: IntegrationProblem, multipliers: FloatArray | None = None) -> Solution:
    """Integrate a problem with Radau IIA of order 5.

    Parameters
    ----------
    code
        The loop and the kernels.
    problem
        The problem; its arrays are copied.
    multipliers
        Initial values (k,) of components without rates, which the kernels know behind those of the state.

    Returns
    -------
    Solution
        Of the state alone. Numerical failure is its status, never an exception.
    """
    y0 = np.concatenate([problem.y0, [] if multipliers is None else multipliers])
    work = np.zeros((ROWS, len(y0)))
    work[0] = y0
    codes = Addresses(code.rhs, code.jacobian, code.tangent, code.position, code.velocity)
    settings, space = settings_of(problem, DEGREE), room(len(y0))
    status, run, pieces = follow(lambda run: code.loop(codes, settings, space, run), problem, settings, work)
    return solution(problem, status, run, pieces)


@bare
def LOOP(codes: Addresses, settings: Settings, room: Room, run: Run) -> int:
    """Take steps until the end, or until a block of rows is full; return the status, `RUNNING` for the latter."""
    counts, numbers = run.counts, run.numbers
    if counts[EVALUATIONS] == 0 and not _begun(codes, settings, run):
        return _NON_FINITE
    while numbers[T] != settings.t1:
        if counts[STEPS] == counts[LIMIT]:
            return RUNNING
        if counts[STEPS] + counts[REJECTED] >= settings.max_steps:
            return _MAX_STEPS
        status = _attempt(codes, settings, room, run)
        if status != _SUCCESS:
            return status
    return _SUCCESS


@bare
def _begun(codes: Addresses, settings: Settings, run: Run) -> bool:
    """Evaluate the first slope and choose the first step; return whether the former is finite."""
    numbers, span = run.numbers, abs(settings.t1 - settings.t0)
    numbers[PREVIOUS], numbers[_RATE], numbers[_KNOWN_RATE] = 1e-2, 1.0, 1.0
    evaluate(codes.rhs, settings.t0, run, 0, SLOPE)
    run.counts[EVALUATIONS] += 1
    if not all_finite(run.work, 0, SLOPE):
        return False
    if numbers[SIZE] == 0.0 and span > 0.0:
        limit = min(span, settings.max_step)
        numbers[SIZE] = first_step(run.work, 0, settings.kept, span, limit, settings.rtol, settings.atol)
    return True


@bare
def _shrinkage(error: float, iterations: int) -> float:
    """Return what the step is to be divided by, were the next error as this one; slow iterations ask for more."""
    share = (2 * MAX_ITERATIONS + 1) / (2 * MAX_ITERATIONS + iterations)
    quotient = math.sqrt(math.sqrt(error)) / (_SAFETY * share)
    return max(1.0 / _LARGEST_GROWTH, min(1.0 / _LARGEST_REDUCTION, quotient))


@bare
def _predicted(quotient: float, h: float, last: float, error: float, previous: float) -> float:
    """Return what the step is to be divided by where its error goes on to change as it last did."""
    guess = last / abs(h) * math.sqrt(math.sqrt(error * error / previous)) / _SAFETY
    guess = max(1.0 / _LARGEST_GROWTH, min(1.0 / _LARGEST_REDUCTION, guess))
    return max(quotient, guess)


@bare
def _increments(codes: Addresses, settings: Settings, room: Room, run: Run, h: float) -> tuple[int, int]:
    """Solve for the increments of a step; return how that ended, and the iterations."""
    counts, numbers, rtol = run.counts, run.numbers, settings.rtol
    y, t, kept = counts[ROW], numbers[T], settings.kept
    if counts[_FRESH] == 0 and numbers[_RATE] > _RATE_TO_KEEP_JACOBIAN:
        evaluate_jacobian(codes.jacobian, codes.tangent, t, run, y, room)
        counts[_FRESH], numbers[_FACTORED] = 1, 0.0
    if numbers[_FACTORED] != h:
        numbers[_FACTORED] = h if factor_matrices(h, kept, room) else 0.0
    # Newton stops where its error does not show in the estimate of the step's.
    tolerance = max(10.0 * _EPSILON / max(rtol, 1e-14), min(0.03, math.sqrt(max(rtol, 1e-14))))
    scale_of(run.work, y, kept, h, rtol, settings.atol, tolerance)
    if numbers[_FACTORED] != h:
        return BROKEN, 0
    predict(run.work, numbers[_RATIO] * abs(h))
    known_rate = math.exp(0.8 * math.log(max(numbers[_KNOWN_RATE], _EPSILON)))
    outcome, iterations, rate = newton(codes.rhs, t, h, kept, run, y, room, tolerance, known_rate)
    counts[EVALUATIONS] += 3 * iterations
    if iterations > 1:
        known_rate = rate / (1.0 - rate) if rate < 0.99 else 1.0
    numbers[_RATE], numbers[_KNOWN_RATE] = rate, known_rate
    return outcome, iterations


@bare
def _diverged(settings: Settings, run: Run, h: float, outcome: int) -> int:
    """Go on with a new Jacobian or, where it is that already, with a smaller step; return the status."""
    numbers = run.numbers
    numbers[_KNOWN_RATE] = numbers[_RATE] = 1.0
    if run.counts[_FRESH] == 0:
        run.counts[REJECTED] += 1
        return _SUCCESS
    numbers[_RATIO] = 0.0
    return refused(settings, run, 0.5 * abs(h), _NON_FINITE if outcome == BROKEN else _STEP_TOO_SMALL)


@bare
def _error(codes: Addresses, settings: Settings, room: Room, run: Run, h: float, y_new: int) -> float:
    """Return the norm of the error of a step over the tolerances."""
    counts, numbers, work = run.counts, run.numbers, run.work
    y, kept, rtol, atol = counts[ROW], settings.kept, settings.rtol, settings.atol
    careful = counts[RETRIED] != 0 or counts[STEPS] == 0
    error, more = estimate(codes.rhs, numbers[T], h, kept, run, y, y_new, room, rtol, atol, careful)
    counts[EVALUATIONS] += more
    if numbers[_LAST] != 0.0:
        error = max(error, between(work, y, y_new, kept, abs(h) / numbers[_LAST], rtol, atol))
    return error


@bare
def _settled(codes: Addresses, run: Run, error: float, t_new: float, y_new: int) -> int:
    """Judge a step, project its end and evaluate the slope there; return the verdict."""
    if not error < np.inf:
        return _NON_FINITE
    if error > 1.0:
        return _STEP_TOO_SMALL
    failure = _PROJECTION_FAILED
    if project(codes.position, codes.velocity, t_new, run, y_new):
        evaluate(codes.rhs, t_new, run, y_new, SLOPE)
        failure = _SUCCESS if all_finite(run.work, y_new, SLOPE) else _NON_FINITE
        run.counts[EVALUATIONS] += 1
    if failure != _SUCCESS:
        evaluate(codes.rhs, run.numbers[T], run, run.counts[ROW], SLOPE)
        run.counts[EVALUATIONS] += 1
    return failure


@bare
def _attempt(codes: Addresses, settings: Settings, room: Room, run: Run) -> int:
    """Take a step, or refuse it; return the status."""
    numbers, counts, work = run.numbers, run.counts, run.work
    y, y_new = counts[ROW], 1 - counts[ROW]
    h, t_new = coming(settings, numbers)
    outcome, iterations = _increments(codes, settings, room, run, h)
    if outcome != CONVERGED:
        return _diverged(settings, run, h, outcome)
    for m in range(work.shape[1]):
        work[y_new, m] = work[y, m] + work[Z + 2, m]
    error = _error(codes, settings, room, run, h, y_new)
    failure = _settled(codes, run, error, t_new, y_new)
    quotient = _shrinkage(error if error < np.inf else 1e4, iterations)
    if failure != _SUCCESS:
        if error <= 1.0:
            quotient = 1.0 / _LARGEST_REDUCTION
        numbers[_RATIO] = 0.0
        return refused(settings, run, abs(h) / max(quotient, 1.0 / _SAFETY), failure)
    keep_polynomial(work)
    piece = counts[STEPS] - counts[BEGUN] if settings.dense else 0
    if settings.dense or pending(run, t_new):
        write_polynomial(work, y, y_new, run.pieces, piece, settings.kept)
        run.pieces[piece, 0] = t_new
    status = record(codes.position, codes.velocity, settings, run, piece, y_new, t_new)
    if numbers[_LAST] != 0.0:
        quotient = _predicted(quotient, h, numbers[_LAST], error, numbers[PREVIOUS])
    growth = 1.0 / quotient
    if counts[RETRIED] != 0:
        growth = min(growth, 1.0)
    slow = numbers[_RATE] > _RATE_TO_KEEP_JACOBIAN
    if slow or growth < 1.0 or growth > _GROWTH_TO_KEEP_FACTORS or t_new == settings.t1:
        numbers[SIZE] = abs(h) * growth
    numbers[_LAST], numbers[PREVIOUS], numbers[_RATIO] = abs(h), max(error, 1e-2), 1.0 / abs(h)
    counts[RETRIED] = counts[_FRESH] = 0
    return status


assert NODES[2] == 1.0
