"""The adaptive loop of Radau IIA of order 5, for stiff systems and for index-2 systems with multipliers.

Source of the method, of its Newton iteration, error estimate and step control: E. Hairer, G. Wanner, Solving Ordinary
Differential Equations II, section IV.8; of the predictive control: K. Gustafsson, ACM Transactions on Mathematical
Software 20 (1994) 496-517.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..methods.collocation import NODES
from ..methods.status import RUNNING, Status
from ..methods.step_constants import LARGEST_GROWTH, LARGEST_REDUCTION, SAFETY
from ..subset.compiled_subset import compiled_subset, exp, log, sqrt
from .implicit_stages import between, estimate, first_step, keep_polynomial, scale_of, write_polynomial
from .newton import (
    BROKEN,
    CONVERGED,
    MAX_ITERATIONS,
    ROWS,
    SLOPE,
    NewtonWorkspace,
    Z,
    evaluate_jacobian,
    factor_matrices,
    newton,
    newton_workspace,
    predict,
)
from .packed_tableaus import ALLOWED, POINT
from .problem import IntegrationProblem, Solution
from .recorded_runs import (
    Run,
    RunCodes,
    RunSettings,
    all_finite,
    begin_status,
    block_is_full,
    evaluate,
    pass_first_stops,
    passes_stop,
    pending,
    planned_step,
    project,
    proposed_after,
    record,
    record_behind,
    retry,
    status_of,
)
from .run_blocks import run_in_blocks, settings_of, solution
from .step_control import ACCEPTED, error_test, growth_limit

DEGREE = 3

_RATE_TO_KEEP_JACOBIAN, _GROWTH_TO_KEEP_FACTORS = 1e-3, 1.2
"""Rate of convergence up to which the Jacobian is kept, and growth up to which a step keeps its size and factors."""

_SMALLEST_PREVIOUS = 1e-2
"""Least error norm that the predictive controller remembers of a step."""

_UNIT = 2.2e-16
"""Rounding in the tolerance and the rate of Newton's iteration, two digits of it as in RADAU5."""


class ImplicitArguments(NamedTuple):
    """Arguments of the loop."""

    codes: RunCodes
    settings: RunSettings
    workspace: NewtonWorkspace
    run: Run


def integrate(
    loop: Callable[[ImplicitArguments], int],
    codes: RunCodes,
    problem: IntegrationProblem,
    multipliers: int = 0,
    states: int = 0,
) -> Solution:
    """Integrate a problem with Radau IIA of order 5.

    Parameters
    ----------
    loop
        Compiled `LOOP`.
    codes
        What it calls.
    problem
        The problem; its arrays are copied.
    multipliers
        Number of components without rates, which the kernels take after those of the state.
    states
        Number of first-order states, the last with rates.

    Returns
    -------
    Solution
        Of the state alone. Numerical failure is its status, never an exception.
    """
    n, settings = len(problem.y0), settings_of(problem, DEGREE)
    work, space = implicit_work(problem, n + multipliers), newton_workspace(n + multipliers, n - states)
    work[0, :n] = problem.y0

    def of_block(run: Run) -> int:
        return loop(ImplicitArguments(codes, settings, space, run))

    status, run, pieces = run_in_blocks(of_block, problem, settings, work)
    return solution(problem, status, run, pieces)


def implicit_work(problem: IntegrationProblem, width: int) -> FloatArray:
    """Return the working array (ROWS, width) of a run with the tolerances of a problem."""
    work = np.zeros((ROWS, width))
    work[ALLOWED] = problem.absolute_tolerances(width)
    return work


@compiled_subset
def LOOP(arguments: ImplicitArguments) -> int:
    """Take steps until the end, or until a block of rows is full; return the status, `RUNNING` for the latter."""
    codes, settings, space, run = arguments.codes, arguments.settings, arguments.workspace, arguments.run
    progress, status = run.progress, RUNNING
    if progress.evaluations == 0:
        pass_first_stops(settings, run)
        status = begin_status(settings, progress, begin_motion(codes, settings, run))
    while status == RUNNING and not block_is_full(progress):
        status = _attempt(codes, settings, space, run)
    return status


@compiled_subset
def begin_motion(codes: RunCodes, settings: RunSettings, run: Run) -> bool:
    """Evaluate the first slope and choose the first step; return whether the former is finite."""
    progress, y, span = run.progress, run.progress.row, abs(run.progress.t1 - run.progress.t)
    _evaluate_anew(codes, settings, run, y, progress.t)
    if not all_finite(run.work, y, SLOPE):
        return False
    if progress.size == 0.0 and span > 0.0:
        limit = min(span, settings.max_step)
        progress.size = first_step(run.work, y, settings.kept, span, limit, settings.rtol)
    return True


@compiled_subset
def _limited(quotient: float) -> float:
    """Return the divisor of the step size, within the limits of growth and reduction."""
    return max(1.0 / LARGEST_GROWTH, min(1.0 / LARGEST_REDUCTION, quotient))


@compiled_subset
def _shrinkage(error: float, iterations: int) -> float:
    """Return the divisor of the next step size for the error of this step; larger after slow iterations."""
    share = (2 * MAX_ITERATIONS + 1) / (2 * MAX_ITERATIONS + iterations)
    return _limited(sqrt(sqrt(error)) / (SAFETY * share))


@compiled_subset
def _predicted(quotient: float, h: float, last: float, error: float, previous: float) -> float:
    """Return the divisor of the next step size for an error that changes as it last did (predictive control)."""
    return max(quotient, _limited(last / abs(h) * sqrt(sqrt(error * error / previous)) / SAFETY))


@compiled_subset
def _increments(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run, h: float) -> tuple[int, int]:
    """Solve for the increments of a step; return how that ended, and the iterations."""
    progress, rtol = run.progress, settings.rtol
    y, t, kept = progress.row, progress.t, settings.kept
    if progress.fresh == 0 and progress.rate > _RATE_TO_KEEP_JACOBIAN:
        evaluate_jacobian(codes.jacobian, codes.tangent, t, run, y, space)
        progress.fresh, progress.factored = 1, 0.0
    if progress.factored != h:
        progress.factored = h if factor_matrices(h, kept, space) else 0.0
    # Newton stops where its error does not show in the estimate of the step's.
    tolerance = max(10.0 * _UNIT / max(rtol, 1e-14), min(0.03, sqrt(max(rtol, 1e-14))))
    scale_of(run.work, y, kept, space.paired, h, rtol, tolerance)
    if progress.factored != h:
        return BROKEN, 0
    predict(run.work, progress.ratio * abs(h))
    # without a polynomial that predicts the stages, the first correction is the whole of the increments
    known_rate = 1.0 if progress.ratio == 0.0 else exp(0.8 * log(max(progress.known_rate, _UNIT)))
    outcome, iterations, rate = newton(codes.rhs, t, h, kept, run, y, space, tolerance, known_rate)
    progress.evaluations += 3 * iterations
    if iterations > 1:
        known_rate = rate / (1.0 - rate) if rate < 0.99 else 1.0
    progress.rate, progress.known_rate = rate, known_rate
    return outcome, iterations


@compiled_subset
def _diverged(settings: RunSettings, run: Run, h: float, outcome: int) -> int:
    """Retry with a new Jacobian or, where it is new already, with a smaller step; return the status."""
    progress = run.progress
    progress.known_rate = progress.rate = 1.0
    if run.progress.fresh == 0:
        run.progress.rejected += 1
        return status_of(settings, run.progress)
    progress.ratio = 0.0
    return retry(settings, run, 0.5 * abs(h), Status.NON_FINITE if outcome == BROKEN else Status.STEP_TOO_SMALL)


@compiled_subset
def _error(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run, h: float, y_new: int) -> float:
    """Return the norm of the error of a step over the tolerances."""
    progress, work = run.progress, run.work
    y, kept, rtol = progress.row, settings.kept, settings.rtol
    careful = progress.retried != 0 or progress.steps == 0
    error, more = estimate(codes.rhs, progress.t, h, kept, run, y, y_new, space, rtol, careful)
    progress.evaluations += more
    if progress.last_size != 0.0:
        error = max(error, between(work, y, y_new, kept, abs(h) / progress.last_size, rtol))
    return error


@compiled_subset
def _test_step(codes: RunCodes, settings: RunSettings, run: Run, error: float, t_new: float, y_new: int) -> int:
    """Test the error of a step, project its end and evaluate the slope there; return the result of the test."""
    outcome = error_test(error)
    if outcome != ACCEPTED:
        return outcome
    outcome = Status.PROJECTION_FAILED
    if project(codes.position, codes.velocity, settings, t_new, run, y_new):
        evaluate(codes.rhs, t_new, run, y_new, SLOPE)
        outcome = ACCEPTED if all_finite(run.work, y_new, SLOPE) else Status.NON_FINITE
        run.progress.evaluations += 1
    if outcome != ACCEPTED:
        evaluate(codes.rhs, run.progress.t, run, run.progress.row, SLOPE)
        run.progress.evaluations += 1
    return outcome


@compiled_subset
def attempt(
    codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run
) -> tuple[int, float, float, float, float]:
    """Attempt a step from one of the ends to the other; return `ACCEPTED`, or the status of the run after a rejection.

    Return the step, its end, its error and the divisor of the next size by this error, too.
    """
    progress, work = run.progress, run.work
    y, y_new = progress.row, 1 - progress.row
    h, t_new = planned_step(settings, run, codes.knots)
    outcome, iterations = _increments(codes, settings, space, run, h)
    if outcome != CONVERGED:
        return _diverged(settings, run, h, outcome), h, t_new, 0.0, 1.0
    for m in range(work.shape[1]):
        work[y_new, m] = work[y, m] + work[Z + 2, m]
    error = _error(codes, settings, space, run, h, y_new)
    outcome = _test_step(codes, settings, run, error, t_new, y_new)
    quotient = _shrinkage(error if error < np.inf else 1e4, iterations)
    if outcome != ACCEPTED:
        if error <= 1.0:
            quotient = 1.0 / LARGEST_REDUCTION
        progress.ratio = 0.0
        outcome = retry(settings, run, abs(h) / max(quotient, 1.0 / SAFETY), outcome)
    else:
        keep_polynomial(work)
    return outcome, h, t_new, error, quotient


@compiled_subset
def propose(run: Run, h: float, t_new: float, error: float, quotient: float) -> None:
    """Propose the size of the step after an accepted one, which ends at a time; for the others see `attempt`."""
    progress = run.progress
    if progress.last_size != 0.0:
        quotient = _predicted(quotient, h, progress.last_size, error, progress.previous)
    growth = min(1.0 / quotient, growth_limit(progress.retried != 0))
    slow = progress.rate > _RATE_TO_KEEP_JACOBIAN
    if progress.unlimited != 0.0:
        progress.size = proposed_after(run, abs(h) * growth)
    elif slow or growth < 1.0 or growth > _GROWTH_TO_KEEP_FACTORS or t_new == progress.end:
        progress.size = abs(h) * growth
    progress.last_size, progress.previous, progress.ratio = abs(h), max(error, _SMALLEST_PREVIOUS), 1.0 / abs(h)
    if progress.unlimited != 0.0:  # the polynomial of so short a step does not predict a longer one
        progress.ratio = progress.last_size = 0.0
    progress.retried = progress.fresh = 0


@compiled_subset
def _attempt(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> int:
    """Attempt a step, and record it where it is accepted; return the status."""
    progress, y = run.progress, run.progress.row
    outcome, h, t_new, error, quotient = attempt(codes, settings, space, run)
    if outcome != ACCEPTED:
        return outcome
    y_new, proposed = 1 - y, progress.size
    piece = progress.steps - progress.begun if settings.dense else 0
    if settings.dense or pending(run, t_new):
        write_polynomial(run.work, y, y_new, run.pieces, piece, settings.kept)
        run.pieces[piece, 0] = t_new
    status = record(codes.position, codes.velocity, settings, run, piece, y_new, t_new)
    propose(run, h, t_new, error, quotient)
    if passes_stop(settings, run, status):
        begin_piece(codes, settings, run, y_new, t_new, proposed)
    record_behind(settings, run)
    return status


@compiled_subset
def begin_piece(codes: RunCodes, settings: RunSettings, run: Run, y: int, t: float, proposed: float) -> None:
    """Begin the motion behind a stop, which cut the step that was proposed, not its error."""
    _evaluate_anew(codes, settings, run, y, t)
    run.progress.size = max(run.progress.size, proposed)


@compiled_subset
def _evaluate_anew(codes: RunCodes, settings: RunSettings, run: Run, y: int, t: float) -> None:
    """Evaluate multipliers and slope; discard the Jacobian and the predictions, which are of the motion before."""
    progress = run.progress
    if codes.multipliers != 0:  # of the components without rates
        evaluate(codes.multipliers, t, run, y, POINT)
        for m in range(settings.kept, run.work.shape[1]):
            run.work[y, m] = run.work[POINT, m - settings.kept]
    evaluate(codes.rhs, t, run, y, SLOPE)
    progress.evaluations += 1
    progress.rate = progress.known_rate = 1.0
    progress.ratio = progress.last_size = 0.0
    progress.previous = _SMALLEST_PREVIOUS


assert NODES[2] == 1.0
