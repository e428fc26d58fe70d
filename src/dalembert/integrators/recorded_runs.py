"""What the loops of recorded runs share: settings, what they remember and record, and their calls from Python.

Compiled loops allocate nothing: a run fills a block of rows, returns where it is full, and is called again with others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..interrupts import check
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_SCALE, STRETCH
from .compiled_subset import bare, call_code, row
from .kinds import FLAG, INTEGER, INTEGER_MATRIX, INTEGERS, MATRIX, NUMBER, VECTOR, Group
from .packed_tableaus import POINT
from .problem import IntegrationProblem, PiecewisePolynomial, Solution
from .projection import corrected
from .step_control import smallest_step
from .taylor_runs import RUNNING

__all__ = [
    "BEGUN",
    "EVALUATIONS",
    "FURTHER_COUNT",
    "FURTHER_NUMBERS",
    "LIMIT",
    "PREVIOUS",
    "RECORDED",
    "REJECTED",
    "RETRIED",
    "ROW",
    "RUN",
    "SETTINGS",
    "SIZE",
    "STEPS",
    "Run",
    "Settings",
    "T",
    "all_finite",
    "coming",
    "evaluate",
    "follow",
    "pending",
    "project",
    "record",
    "refused",
    "settings_of",
    "solution",
]

T, SIZE, PREVIOUS, FURTHER_NUMBERS = range(4)
"""Places in ``Run.numbers``: time, size of the next step, the error before; behind them those of a loop alone."""

ROW, STEPS, REJECTED, EVALUATIONS, RECORDED, RETRIED, BEGUN, LIMIT, FURTHER_COUNT = range(9)
"""Places in ``Run.counts``.

The row of the state, numbers of steps, refused steps, evaluations and recorded times, whether a step was refused, and
the steps before and after the present block; behind them one of a loop alone.
"""

_NUMBERS, _COUNTS = FURTHER_NUMBERS + 5, FURTHER_COUNT + 1
_SUCCESS, _PROJECTION_FAILED = int(Status.SUCCESS), int(Status.PROJECTION_FAILED)
_FIRST_BLOCK, _LARGEST_BLOCK = 64, 8192


class Settings(NamedTuple):
    """The numbers of a problem, of whose components the first ``kept`` are recorded, by polynomials of a ``degree``.

    ``first_step`` is 0 where it is to be chosen; ``watched`` runs stop where stability holds the steps.
    """

    t0: float
    t1: float
    rtol: float
    atol: float
    first_step: float
    max_step: float
    max_steps: int
    kept: int
    degree: int
    sampled: bool
    dense: bool
    watched: bool


SETTINGS = Group((NUMBER,) * 6 + (INTEGER,) * 3 + (FLAG,) * 3, Settings._fields)


class Run(NamedTuple):
    """What a loop works on.

    ``work`` (n_rows, width) are vectors in rows: the ends of a step in turn, then those of `packing`. ``rows``
    (k, 1 + n) get the times to record ``t_eval`` with their states or, where there are none, the ends of the steps of a
    block; ``pieces`` (k, 1 + (degree + 1)*n) ends of steps and polynomials, of one step where they are not kept.
    """

    clock: FloatArray
    constants: FloatArray
    t_eval: FloatArray
    work: FloatArray
    delta: FloatArray
    mark: NDArray[np.int64]
    numbers: FloatArray
    counts: NDArray[np.int64]
    rows: FloatArray
    pieces: FloatArray


RUN = Group((MATRIX, MATRIX, VECTOR, MATRIX, MATRIX, INTEGER_MATRIX, VECTOR, INTEGERS, MATRIX, MATRIX), Run._fields)


@bare
def evaluate(code: int, t: float, run: Run, y: int, out: int) -> None:
    """Call a kernel on one row of the work; another gets its outputs."""
    run.clock[0, 0] = t
    call_code(code, row(run.clock, 0), row(run.work, y), row(run.constants, 0), 0, row(run.work, out))


@bare
def project(position: int, velocity: int, t: float, run: Run, y: int) -> bool:
    """Project a row of the work onto the constraints, if there are any; return whether that came about."""
    if position == 0 and velocity == 0:
        return True
    run.clock[0, 0] = t
    return corrected(position, velocity, run.clock, run.work, y, run.constants, run.delta, run.mark)


@bare
def all_finite(work: FloatArray, first: int, second: int) -> bool:
    """Whether every entry of two rows is finite."""
    total = 0.0
    for m in range(work.shape[1]):
        total += 0.0 * work[first, m] + 0.0 * work[second, m]
    return total == 0.0


@bare
def coming(settings: Settings, numbers: FloatArray) -> tuple[float, float]:
    """Return the next step, with its sign, and where it ends."""
    t, t1 = numbers[T], settings.t1
    size = min(max(numbers[SIZE], smallest_step(t, abs(t1 - settings.t0))), settings.max_step)
    numbers[SIZE] = size
    if size * STRETCH >= abs(t1 - t):
        return t1 - t, t1
    h = size if t1 >= settings.t0 else -size
    return h, t + h


@bare
def refused(settings: Settings, run: Run, size: float, failure: int) -> int:
    """Count a step that failed, to try a smaller one; return the failure where that is too small, else success."""
    run.counts[REJECTED] += 1
    run.counts[RETRIED] = 1
    run.numbers[SIZE] = size
    return failure if size < smallest_step(run.numbers[T], abs(settings.t1 - settings.t0)) else _SUCCESS


@bare
def pending(run: Run, t_new: float) -> bool:
    """Whether a time to record lies inside a step up to a time."""
    k = run.counts[RECORDED]
    return k < run.t_eval.size and (run.t_eval[k] - t_new) * (t_new - run.numbers[T]) < 0.0


@bare
def record(position: int, velocity: int, settings: Settings, run: Run, piece: int, y_new: int, t_new: float) -> int:
    """Take a step and record what is wanted of it, by its polynomial where that is `pending`; return the status."""
    counts, t, status = run.counts, run.numbers[T], _SUCCESS
    while pending(run, t_new):
        at = run.t_eval[counts[RECORDED]]
        _evaluate_polynomial(run, piece, settings.degree, (at - t) / (t_new - t), settings.kept)
        if not project(position, velocity, at, run, POINT):
            status = _PROJECTION_FAILED
            break
        _store(run, counts[RECORDED], at, POINT)
        counts[RECORDED] += 1
    while counts[RECORDED] < run.t_eval.size and run.t_eval[counts[RECORDED]] == t_new:
        _store(run, counts[RECORDED], t_new, y_new)
        counts[RECORDED] += 1
    if not settings.sampled:
        _store(run, counts[STEPS] - counts[BEGUN], t_new, y_new)
    counts[STEPS] += 1
    counts[ROW], run.numbers[T] = y_new, t_new
    return status


@bare
def _evaluate_polynomial(run: Run, piece: int, degree: int, theta: float, n: int) -> None:
    """Evaluate a polynomial, lowest power first, by Horner's scheme, into ``work[POINT]``."""
    for m in range(n):
        value = run.pieces[piece, 1 + degree * n + m]
        for power in range(degree - 1, -1, -1):
            value = value * theta + run.pieces[piece, 1 + power * n + m]
        run.work[POINT, m] = value


@bare
def _store(run: Run, number: int, t: float, source: int) -> None:
    run.rows[number, 0] = t
    for m in range(run.rows.shape[1] - 1):
        run.rows[number, 1 + m] = run.work[source, m]


def settings_of(problem: IntegrationProblem, degree: int, *, watched: bool = False) -> Settings:
    """Return the settings of a problem."""
    return Settings(
        float(problem.t0),
        float(problem.t1),
        float(problem.rtol),
        max(float(problem.atol), SMALLEST_SCALE),
        float(problem.first_step or 0.0),
        float(problem.max_step),
        int(problem.max_steps),
        len(problem.y0),
        degree,
        problem.t_eval is not None,
        bool(problem.dense),
        watched,
    )


def follow(
    loop: Callable[[Run], int], problem: IntegrationProblem, settings: Settings, work: FloatArray
) -> tuple[int, Run, list[FloatArray]]:
    """Call a loop until its run has ended.

    Parameters
    ----------
    loop : function from a run to a status
        Returns `RUNNING` where a block is full.
    problem, settings
        Of which times to record and constants are taken.
    work : (n_rows, width)
        Its first row holds the initial state.

    Returns
    -------
    int, Run, list of arrays (k, 1 + (degree + 1)*n)
        The status; the run, whose rows are all that were recorded; blocks of ends of steps and polynomials.
    """
    n = settings.kept
    t_eval = np.array(() if problem.t_eval is None else problem.t_eval, dtype=np.float64)
    begin = np.concatenate([[settings.t0], work[0, :n]])
    first = int(np.searchsorted(t_eval != settings.t0, True)) if len(t_eval) else 0
    samples = np.empty((max(len(t_eval), 1), 1 + n))
    samples[:first] = begin
    numbers, counts = np.zeros(_NUMBERS), np.zeros(_COUNTS, np.int64)
    numbers[T], numbers[SIZE], counts[RECORDED] = settings.t0, settings.first_step, first
    constants = np.array(problem.constants, dtype=np.float64).reshape(1, -1)
    room = np.zeros((1, 1)), constants, t_eval, work, np.zeros((n, 1)), np.zeros((1, 1), np.int64), numbers, counts
    blocks, pieces = [begin.reshape(1, -1)], []
    bounded = settings.dense or not settings.sampled
    status, size = RUNNING, _FIRST_BLOCK
    while status == RUNNING:
        check()
        limit = size if bounded else settings.max_steps
        rows = samples if settings.sampled else np.empty((limit, 1 + n))
        piece = np.empty((limit if settings.dense else 1, 1 + (settings.degree + 1) * n))
        counts[BEGUN], counts[LIMIT] = counts[STEPS], counts[STEPS] + limit
        status = loop(Run(*room, rows, piece))
        count = int(counts[STEPS] - counts[BEGUN])
        if not settings.sampled:
            blocks.append(rows[:count])
        if settings.dense:
            pieces.append(piece[:count])
        size = min(2 * size, _LARGEST_BLOCK)
    recorded = samples[: counts[RECORDED]] if settings.sampled else np.concatenate(blocks)
    return status, Run(*room, recorded, samples), pieces


def solution(problem: IntegrationProblem, status: int, run: Run, pieces: list[FloatArray]) -> Solution:
    """Return what `follow` found."""
    counts = run.counts
    return Solution(
        status=Status(status),
        t=run.rows[:, 0].copy(),
        y=run.rows[:, 1:].copy(),
        steps=int(counts[STEPS]),
        rejected=int(counts[REJECTED]),
        evaluations=int(counts[EVALUATIONS]),
        dense=_dense_output(problem, np.concatenate(pieces)) if problem.dense else None,
        end=float(run.numbers[T]),
        last=run.work[counts[ROW], : len(problem.y0)].copy(),
    )


def _dense_output(problem: IntegrationProblem, pieces: FloatArray) -> PiecewisePolynomial:
    """Collect the polynomials of the accepted steps, or a constant where there was none."""
    n, steps = len(problem.y0), len(pieces)
    if steps == 0:
        return PiecewisePolynomial(np.full(2, float(problem.t0)), np.array(problem.y0, dtype=float).reshape(1, 1, n))
    knots = np.concatenate([[problem.t0], pieces[:, 0]])
    return PiecewisePolynomial(knots, pieces[:, 1:].copy().reshape(steps, -1, n))
