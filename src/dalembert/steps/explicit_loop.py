"""The adaptive explicit Runge-Kutta loop, one for all models and all tableaux."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..methods.status import RUNNING, Status
from ..methods.step_constants import SMALLEST_PREVIOUS
from ..methods.tableau import Tableau
from ..subset.compiled_subset import compiled_subset
from .explicit_stages import (
    LANES,
    STIFF_STEPS,
    STIFFNESS_FROM,
    at_boundary,
    dense_polynomial,
    error_norm,
    evaluate_stages,
    first_step_size,
    polynomial_error,
)
from .packed_tableaus import ALLOWED, PackedTableau, packed_tableau
from .problem import IntegrationProblem, Solution
from .recorded_runs import (
    Run,
    RunCodes,
    RunSettings,
    all_finite,
    begin_status,
    block_is_full,
    evaluate,
    find_limits,
    pass_first_stops,
    passes_stop,
    pending,
    planned_step,
    project,
    proposed_after,
    record,
    record_behind,
    retry,
)
from .run_blocks import run_in_blocks, settings_of, solution
from .step_control import ACCEPTED, error_test, growth, reduction

_STOPPED = RUNNING - 1
"""Value that the loop returns in place of a status where it stopped a run that is held up by stability."""


@final
@frozen(eq=False)
class StiffnessStop:
    """Point at which a run was stopped because it seems stiff: time, size of the last step, state (n_y,)."""

    t: float
    step: float
    y: FloatArray


class ExplicitArguments(NamedTuple):
    """Arguments of the loop."""

    codes: RunCodes
    tableau: PackedTableau
    settings: RunSettings
    run: Run


def integrate(
    loop: Callable[[ExplicitArguments], int],
    codes: RunCodes,
    tableau: Tableau,
    problem: IntegrationProblem,
    *,
    stop_if_stiff: bool = False,
) -> Solution | StiffnessStop:
    """Integrate a problem with an explicit Runge-Kutta pair.

    Parameters
    ----------
    loop
        Compiled `LOOP`.
    codes
        What it calls.
    tableau
        The method.
    problem
        The problem; its arrays are copied.
    stop_if_stiff
        Whether to stop where stability, not accuracy, holds the steps for long.

    Returns
    -------
    Solution or StiffnessStop
        Numerical failure is its status, never an exception. `StiffnessStop` where the run was stopped.
    """
    settings, packed = settings_of(problem, tableau.degree, stop_if_stiff=stop_if_stiff), packed_tableau(tableau)
    n = settings.kept
    work = np.zeros((packed.first + packed.total, -(-n // LANES) * LANES))
    work[0, :n], work[ALLOWED] = problem.y0, settings.atol
    if problem.allowed is not None:
        work[ALLOWED] = problem.absolute_tolerances(work.shape[1])

    def of_block(run: Run) -> int:
        return loop(ExplicitArguments(codes, packed, settings, run))

    status, run, pieces = run_in_blocks(of_block, problem, settings, work)
    if status == _STOPPED:
        return StiffnessStop(float(run.progress.t), float(run.progress.size), work[run.progress.row, :n].copy())
    return solution(problem, status, run, pieces)


@compiled_subset
def LOOP(arguments: ExplicitArguments) -> int:
    """Take steps until the end, or until a block of rows is full; return the status, `RUNNING` for the latter."""
    codes, tableau, settings, run = arguments.codes, arguments.tableau, arguments.settings, arguments.run
    progress, status = run.progress, RUNNING
    if progress.evaluations == 0:
        status = begin_status(settings, progress, _begin(codes, tableau, settings, run))
    while status == RUNNING and not block_is_full(progress):
        status = _attempt(codes, tableau, settings, run)
    return status


@compiled_subset
def _begin(codes: RunCodes, tableau: PackedTableau, settings: RunSettings, run: Run) -> bool:
    """Evaluate the first stage and choose the first step; return whether the former is finite."""
    t0, t1, progress = settings.t0, run.progress.t1, run.progress
    run.progress.previous = SMALLEST_PREVIOUS
    pass_first_stops(settings, run)
    evaluate(codes.rhs, t0, run, 0, tableau.first)
    progress.evaluations += 1
    if not all_finite(run.work, 0, tableau.first):
        return False
    if run.progress.size == 0.0 and t0 != t1:
        limit, direction = min(abs(t1 - t0), settings.max_step), progress.direction
        run.progress.size = first_step_size(
            codes.rhs, tableau, t0, direction, limit, run, 0, settings.rtol, settings.kept
        )
        progress.evaluations += 1
    return True


@compiled_subset
def _test_step(
    codes: RunCodes,
    tableau: PackedTableau,
    settings: RunSettings,
    run: Run,
    error: float,
    t_new: float,
    y_new: int,
) -> int:
    """Test the error of a step, project its end and evaluate the stage there; return the result of the test."""
    outcome = error_test(error)
    if outcome != ACCEPTED:
        return outcome
    if not project(codes.position, codes.velocity, settings, t_new, run, y_new):
        return Status.PROJECTION_FAILED
    last = tableau.first + tableau.end
    if codes.position != 0 or codes.velocity != 0 or not tableau.fsal:
        evaluate(codes.rhs, t_new, run, y_new, last)
        run.progress.evaluations += 1
    return ACCEPTED if all_finite(run.work, y_new, last) else Status.NON_FINITE


@compiled_subset
def _attempt(codes: RunCodes, tableau: PackedTableau, settings: RunSettings, run: Run) -> int:
    """Attempt a step, and accept or reject it; return the status."""
    progress, work, n = run.progress, run.work, settings.kept
    y, y_new, t = progress.row, 1 - progress.row, progress.t
    run.clock[0, 0] = progress.t
    h, t_new = planned_step(settings, run, find_limits(run, codes.knots), 0)
    proposed = progress.size
    evaluate_stages(codes.rhs, tableau, 1, tableau.end + 1, t, h, run, y, y_new)
    error = error_norm(tableau, h, work, y, y_new, settings.rtol, n)
    progress.evaluations += tableau.end if tableau.fsal else tableau.end - 1
    outcome = _test_step(codes, tableau, settings, run, error, t_new, y_new)
    if outcome != ACCEPTED:
        return retry(settings, run, abs(h) * reduction(outcome, error, tableau.exponent), outcome)
    if settings.stop_if_stiff and progress.steps >= STIFFNESS_FROM:  # before the point of the last stage is overwritten
        progress.at_boundary = progress.at_boundary + 1 if at_boundary(tableau, h, work, y_new, n) else 0
    piece = progress.steps - progress.begun if settings.dense else 0
    if settings.dense or pending(run, t_new):
        evaluate_stages(codes.rhs, tableau, tableau.end + 1, tableau.total, t, h, run, y, y_new)
        progress.evaluations += tableau.total - tableau.end - 1
        if tableau.bounded:
            between = polynomial_error(tableau, h, work, y, y_new, settings.rtol, n)
            outcome = error_test(between)
            if outcome != ACCEPTED:
                return retry(settings, run, abs(h) * reduction(outcome, between, tableau.exponent), outcome)
            error = max(error, between)
        dense_polynomial(tableau, h, work, y, y_new, run.pieces, piece, n)
        run.pieces[piece, 0] = t_new
    status = record(codes.position, codes.velocity, settings, run, piece, y_new, t_new)
    if progress.at_boundary == STIFF_STEPS:
        progress.size = abs(h)
        return _STOPPED
    size = abs(h) * growth(error, progress.previous, progress.retried != 0, tableau.exponent)
    progress.size = proposed_after(run, size)
    progress.previous = max(error, SMALLEST_PREVIOUS)
    progress.retried = 0
    for m in range(n):
        work[tableau.first, m] = work[tableau.first + tableau.end, m]
    if passes_stop(settings, run, status):
        evaluate(codes.rhs, t_new, run, y_new, tableau.first)
        progress.evaluations += 1
        progress.size = max(progress.size, proposed)  # the stop cut the step, not its error
    record_behind(settings, run)
    return status
