"""Calls of recorded runs from Python: settings of a problem, blocks of rows, and the solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import FloatArray
from ..methods.status import RUNNING, Status
from ..methods.step_constants import FIRST_BLOCK, LARGEST_BLOCK, SMALLEST_SCALE
from ..stops.stops import table_of
from ..subset.arguments import NO_CODE
from ..threads import check, is_observed
from .dense_output import PiecewisePolynomial
from .problem import IntegrationProblem, Solution
from .recorded_runs import Progress, Run, RunSettings

_WITH_STOPS = 8
"""Factor by which the first block of a run with stops is longer: each ends a step, and each call packs their table."""


def settings_of(problem: IntegrationProblem, degree: int, *, stop_if_stiff: bool = False) -> RunSettings:
    """Return the settings of a problem."""
    return RunSettings(
        float(problem.t0),
        float(problem.rtol),
        max(float(problem.atol), SMALLEST_SCALE),
        float(problem.first_step or 0.0),
        float(problem.max_step),
        int(problem.max_steps),
        len(problem.y0),
        degree,
        problem.t_eval is not None,
        bool(problem.dense),
        stop_if_stiff,
        problem.stops is not None and problem.stops.behind,
    )


def run_in_blocks(
    loop: Callable[[Run], int], problem: IntegrationProblem, settings: RunSettings, work: FloatArray
) -> tuple[int, Run, list[FloatArray]]:
    """Call a loop until its run has ended.

    Parameters
    ----------
    loop : function from a run to a status
        Returns `RUNNING` where a block is full and the run has not ended.
    problem, settings
        Of which times to record and constants are taken.
    work : (n_rows, width)
        Its first row holds the initial state.

    Returns
    -------
    int, Run, list of arrays (k, 1 + (degree + 1)*n)
        The status; the run, whose rows are all that were recorded; blocks of ends of steps and polynomials.
    """
    n, bounded = settings.kept, settings.dense or not settings.sampled or is_observed()
    run = _begun(problem, settings, work)
    progress, samples = run.progress, run.rows
    blocks, pieces = [np.empty((0, 1 + n))], []
    status, size = RUNNING, FIRST_BLOCK if problem.inputs is None else _WITH_STOPS * FIRST_BLOCK
    while status == RUNNING:
        check(progress.t)
        limit = size if bounded else settings.max_steps
        rows = samples if settings.sampled else np.empty((1 + limit, 1 + n))
        piece = np.empty((limit if settings.dense else 1, 1 + (settings.degree + 1) * n))
        progress.begun, progress.limit = progress.steps, progress.steps + limit
        status = loop(run._replace(rows=rows, pieces=piece))
        if problem.stops is not None:
            problem.stops.raise_failure()
        count = progress.steps - progress.begun
        if not settings.sampled:
            blocks.append(rows[min(1, progress.begun) : 1 + count])  # that before the first step is the start
        if settings.dense:
            pieces.append(piece[:count])
        size = min(2 * size, LARGEST_BLOCK)
    recorded = samples[: progress.recorded] if settings.sampled else np.concatenate(blocks)
    return status, run._replace(rows=recorded), pieces


def _begun(problem: IntegrationProblem, settings: RunSettings, work: FloatArray) -> Run:
    """Return a run before its first step, whose rows are for the requested times."""
    n, constants = settings.kept, np.array(problem.constants, dtype=np.float64).reshape(-1, 1)
    t_eval = np.array(() if problem.t_eval is None else problem.t_eval, dtype=np.float64)
    samples, progress = np.empty((max(len(t_eval), 1), 1 + n)), Progress()
    progress.t, progress.t1, progress.size = settings.t0, float(problem.t1), settings.first_step
    progress.direction = 1.0 if progress.t1 >= progress.t else -1.0
    return Run(
        clock=np.zeros((1, 1)),
        constants=constants,
        t_eval=t_eval,
        work=work,
        delta=np.zeros((n, 1)),
        mark=np.zeros(1, np.int64),
        progress=progress,
        knot=np.zeros((1, 2)),
        rows=samples,
        pieces=samples,
        stops=table_of(problem.stops, problem.inputs, len(constants)),
        prepare=NO_CODE if problem.stops is None else problem.stops.prepare,
    )


def solution(problem: IntegrationProblem, status: int, run: Run, pieces: list[FloatArray]) -> Solution:
    """Return the solution of a run that has ended, from the result of `run_in_blocks`."""
    progress = run.progress
    return Solution(
        status=Status(status),
        t=run.rows[:, 0].copy(),
        y=run.rows[:, 1:].copy(),
        steps=progress.steps,
        rejected=progress.rejected,
        evaluations=progress.evaluations,
        dense=_dense_output(problem, np.concatenate(pieces)) if problem.dense else None,
        end=float(run.progress.t),
        last=run.work[progress.row, : len(problem.y0)].copy(),
    )


def _dense_output(problem: IntegrationProblem, pieces: FloatArray) -> PiecewisePolynomial:
    """Collect the polynomials of the accepted steps, or a constant where there was none."""
    n, steps = len(problem.y0), len(pieces)
    if steps == 0:
        return PiecewisePolynomial(np.full(2, float(problem.t0)), np.array(problem.y0, dtype=float).reshape(1, 1, n))
    knots = np.concatenate([[problem.t0], pieces[:, 0]])
    return PiecewisePolynomial(knots, pieces[:, 1:].copy().reshape(steps, -1, n))
