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
from ..methods.status import RUNNING
from ..subset.compiled_subset import call_code, compiled_subset, lane_count, lanes, row
from .implicit_attempts import SMALLEST_PREVIOUS, attempt, check_finite, propose
from .implicit_stages import first_step, write_polynomial
from .lane_progress import BEGINS, FINITE, NORM, QUOTIENT, RESULT, STEP, T_NEW, TIME, enter_lane, leave_lane
from .newton import ROWS, SLOPE, NewtonWorkspace, newton_workspace
from .packed_tableaus import ALLOWED, DELTA, POINT
from .problem import IntegrationProblem, Solution
from .recorded_runs import (
    Run,
    RunCodes,
    RunSettings,
    begin_status,
    block_is_full,
    pass_first_stops,
    passes_stop,
    pending,
    record,
    record_behind,
)
from .run_blocks import run_in_blocks, settings_of, solution
from .step_control import ACCEPTED

DEGREE = 3


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
        begin_motions(codes, settings, space, run)
        status = begin_status(settings, progress, space.numbers[FINITE, 0] == 0.0)
    while status == RUNNING and not block_is_full(progress):
        status = _attempt(codes, settings, space, run)
    return status


@compiled_subset
def _attempt(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> int:
    """Attempt a step, and record it where it is accepted; return the status."""
    progress, numbers, y = run.progress, space.numbers, run.progress.row
    attempt(codes, settings, space, run)
    if space.flags[RESULT, 0] != ACCEPTED:
        return space.flags[RESULT, 0]
    h, t_new, error, quotient = numbers[STEP, 0], numbers[T_NEW, 0], numbers[NORM, 0], numbers[QUOTIENT, 0]
    y_new, proposed = 1 - y, progress.size
    piece = progress.steps - progress.begun if settings.dense else 0
    if settings.dense or pending(run, t_new):
        write_polynomial(run.work, y, y_new, 0, run.pieces, piece, settings.kept)
        run.pieces[piece, 0] = t_new
    status = record(codes.position, codes.velocity, settings, run, piece, y_new, t_new)
    propose(run, h, t_new, error, quotient)
    if passes_stop(settings, run, status):
        begin_piece(codes, settings, space, run, proposed)
    record_behind(settings, run)
    return status


@compiled_subset
def begin_piece(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run, proposed: float) -> None:
    """Begin the motion behind a stop, which cut the step that was proposed, not its error."""
    evaluate_anew(codes, settings, space, run)
    run.progress.size = max(run.progress.size, proposed)


@compiled_subset
def begin_motions(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> None:
    """Evaluate the first slopes and choose the first steps of lanes that begin; `FINITE` is 0 where the former are."""
    evaluate_anew(codes, settings, space, run)
    for lane in range(lane_count()):
        if space.flags[BEGINS, lane] != 0 and space.numbers[FINITE, lane] == 0.0:
            enter_lane(space.numbers, run, lane)
            progress, span = run.progress, abs(run.progress.t1 - run.progress.t)
            if progress.size == 0.0 and span > 0.0:
                limit = min(span, settings.max_step)
                progress.size = first_step(run.work, progress.row, lane, settings.kept, span, limit, settings.rtol)
            leave_lane(space.numbers, run, lane)


@compiled_subset
def evaluate_anew(codes: RunCodes, settings: RunSettings, space: NewtonWorkspace, run: Run) -> None:
    """Evaluate multipliers and slopes of lanes that begin; discard Jacobians and predictions, of the motion before.

    `FINITE` is 0 where states and slopes are finite.
    """
    work, numbers, flags, count, y = run.work, space.numbers, space.flags, lane_count(), run.progress.row
    if count == 1:
        leave_lane(space.numbers, run, 0)
    clock, state, constants, n = row(run.clock, 0), row(work, y), row(run.constants, 0), work.shape[1] // count
    for lane in lanes():
        run.clock[0, lane] = numbers[TIME, lane]
    if codes.multipliers != 0:  # of the components without rates
        call_code(codes.multipliers, clock, state, constants, 0, row(work, POINT))
        for m in range(settings.kept, n):
            for lane in lanes():
                new, old = work[POINT, (m - settings.kept) * count + lane], work[y, m * count + lane]
                work[y, m * count + lane] = new if flags[BEGINS, lane] != 0 else old
    call_code(codes.rhs, clock, state, constants, 0, row(work, DELTA))
    for m in range(n):
        for lane in lanes():
            at = m * count + lane
            work[SLOPE, at] = work[DELTA, at] if flags[BEGINS, lane] != 0 else work[SLOPE, at]
    check_finite(work, space, y, SLOPE)
    run.progress.evaluations += 1
    for lane in range(count):
        if flags[BEGINS, lane] != 0:
            enter_lane(space.numbers, run, lane)
            progress = run.progress
            progress.rate = progress.known_rate = 1.0
            progress.ratio = progress.last_size = 0.0
            progress.previous = SMALLEST_PREVIOUS
            leave_lane(space.numbers, run, lane)


assert NODES[2] == 1.0
