"""Taylor method for one trajectory: blocks of steps, whose series are kept or sampled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..interrupts import check
from ..methods.status import RUNNING, Status
from ..transforms.taylor import scale_floor
from .problem import IntegrationProblem, PiecewisePolynomial, Solution
from .recorded_runs import FIRST_BLOCK, LARGEST_BLOCK
from .taylor_loop import TaylorArguments, TaylorProgress

__all__ = ["StepCode", "integrate"]

_LARGEST_WINDING = 256
"""Steps after which angles lose the turns that they have made: a large angle has fewer digits to turn by."""

_FEWEST_TURNS, _MOST_TURNS = 2, 4
"""Turns that large angles keep: the size from which the step no longer minds them (`dalembert.transforms.taylor`)."""

_TURN = 2.0 * math.pi
_TURN_HIGH = float.fromhex("0x1.921fb54p+2")
"""A turn to 29 bits, of which multiples are exact."""

_TURN_LOW = float.fromhex("0x1.10b4611a62633p-28")
"""The rest of a turn."""


@final
@dataclass(frozen=True)
class StepCode:
    """Compiled code: the loop of `dalembert.integrators.taylor_loop`, and addresses of the kernels that it calls.

    The step is a Taylor step of some order that also writes its series; the projections are 0 where there are none.
    ``angles`` are the components of the state that matter modulo a turn.
    """

    loop: Callable[..., int]
    order: int
    step: int
    position: int = 0
    velocity: int = 0
    angles: tuple[int, ...] = ()


Watch = Callable[[float, FloatArray, float], bool]
"""Time, state and mean size of the last steps -> whether to stop there."""

_WATCHED_FROM, _WATCHED_REST = 900, 4000


def integrate(code: StepCode, problem: IntegrationProblem, watch: Watch | None = None) -> Solution | None:
    """Integrate a problem with a Taylor step.

    Parameters
    ----------
    code
        The step and the projections.
    problem
        The problem; its arrays are copied.
    watch
        Asked between blocks of steps whether to stop, in runs that have many more steps before them.

    Returns
    -------
    Solution
        Numerical failure is its status, never an exception. Each step is one evaluation of the series. None where the
        run was stopped.
    """
    n = len(problem.y0)
    clock, delta = np.empty((1, 1)), np.empty((n, 1))
    mark, progress = np.zeros(1, np.int64), TaylorProgress()
    direction = 1.0 if problem.t1 >= problem.t0 else -1.0
    progress.t, t1, largest = problem.t0, float(problem.t1), float(problem.max_step)
    codes = code.step, code.position, code.velocity
    settings = np.array([[0.0, direction, scale_floor(problem.rtol, problem.atol)]])
    y = np.append(np.asarray(problem.y0, dtype=float), 0.0).reshape(1, n + 1)
    c = np.array(problem.constants, dtype=float).reshape(1, -1)
    low = np.zeros(n + 1)
    record = _Record(problem, code.order, bool(code.position or code.velocity))
    angles, turns = np.array(code.angles, np.intp), np.zeros(n)
    status, size = RUNNING, FIRST_BLOCK
    if not (np.all(np.isfinite(y)) and np.all(np.isfinite(c))):
        status = int(Status.NON_FINITE)
    while status == RUNNING:
        check()
        limit = min(size, problem.max_steps - record.steps)
        if limit == 0:
            status = int(Status.MAX_STEPS)
            break
        rows, times = np.empty((limit, n + 2 + n * (code.order + 1))), np.empty(limit)
        start = float(progress.t)
        turns[angles] += _unwound(y[0], low, angles)
        arguments = TaylorArguments(
            *codes, limit, t1, largest, settings, y, c, rows, times, low, clock, delta, mark, progress
        )
        status = code.loop(arguments)
        count, t = progress.steps, float(progress.t)
        record.add(start, times[:count], y[0, :n], rows[:count], turns)
        if count:
            y = rows[count - 1, : n + 1].copy().reshape(1, n + 1)
        size = min(2 * size, _LARGEST_WINDING if len(angles) else LARGEST_BLOCK)
        if watch is not None and status == RUNNING and record.steps >= _WATCHED_FROM:
            step = abs(t - start) / count
            if abs(problem.t1 - t) >= _WATCHED_REST * step and watch(t, y[0, :n], step):
                return None
    return record.solution(Status(status))


def _unwound(y: FloatArray, low: FloatArray, angles: NDArray[np.intp]) -> FloatArray:
    """Take whole turns from large angles of a state y (n,), and return how many; `low` gets what rounding takes."""
    whole = np.trunc(y[angles] / _TURN)
    turns = np.where(np.abs(whole) > _MOST_TURNS, whole - np.sign(whole) * _FEWEST_TURNS, 0.0)
    near = y[angles] - turns * _TURN_HIGH
    rest = turns * _TURN_LOW
    y[angles] = near - rest
    low[angles] += (near - y[angles]) - rest
    return turns


@final
class _Record:
    """The record of a run: its steps or the states at the times asked for, and the series if they are wanted."""

    def __init__(self, problem: IntegrationProblem, order: int, projected: bool) -> None:
        self.problem, self.order, self.projected = problem, order, projected
        self.steps = 0
        self.end = float(problem.t0)
        self.knots = [np.array([problem.t0])]
        self.series: list[FloatArray] = []
        self.times: list[FloatArray] = []
        self.states: list[FloatArray] = []
        self.near: list[FloatArray] = []
        self.wound = False
        if problem.t_eval is None:
            self._keep(np.array([problem.t0]), np.asarray(problem.y0, dtype=float).reshape(1, -1))
        else:
            first = problem.t_eval[problem.t_eval == problem.t0]
            self._keep(first, np.tile(np.asarray(problem.y0, dtype=float), (len(first), 1)))

    def _keep(self, times: FloatArray, states: FloatArray, turns: FloatArray | None = None) -> None:
        self.times.append(times)
        self.near.append(states)
        self.states.append(states if turns is None or not np.any(turns) else states + turns * _TURN)

    def add(self, start: float, times: FloatArray, y: FloatArray, rows: FloatArray, turns: FloatArray) -> None:
        """Take in a block of steps that started at time `start` from state y (n,), less some turns (n,)."""
        count, n = len(times), len(y)
        if count == 0:
            return
        self.steps += count
        self.end = float(times[-1])
        self.wound |= bool(np.any(turns))
        ends = rows[:, :n]
        wanted = self.problem.t_eval
        if wanted is None:
            self._keep(times.copy(), ends.copy(), turns)
        if self.problem.dense or wanted is not None:
            knots = np.concatenate([[start], times])
            sizes = rows[:, n] * (1.0 if self.problem.t1 >= self.problem.t0 else -1.0)
            series = self._series(sizes, ends, rows[:, n + 2 :].reshape(count, n, self.order + 1))
            if wanted is not None:
                low, high = min(start, times[-1]), max(start, times[-1])
                inside = wanted[(wanted >= low) & (wanted <= high) & (wanted != start)]
                self._keep(inside, PiecewisePolynomial(knots, series)(inside), turns)
            if self.problem.dense:
                series[:, 0] += turns * _TURN
                self.knots.append(times.copy())
                self.series.append(series)

    def _series(self, sizes: FloatArray, ends: FloatArray, raw: FloatArray) -> FloatArray:
        """Return coefficients (steps, order + 1, n) in the fraction of the step, continuous at the knots.

        `sizes` are those of the steps themselves: differences of late knots have lost digits.
        """
        powers = sizes[:, np.newaxis] ** np.arange(self.order + 1)
        series: FloatArray = np.ascontiguousarray((raw * powers[:, np.newaxis, :]).transpose(0, 2, 1))
        gap = ends - series.sum(axis=1)
        series[:, 2] += 3.0 * gap
        series[:, 3] -= 2.0 * gap
        return series

    def solution(self, status: Status) -> Solution:
        """Return the solution of a run that ended with `status`."""
        n = len(self.problem.y0)
        dense = None
        if self.problem.dense:
            if self.series:
                dense = PiecewisePolynomial(np.concatenate(self.knots), np.concatenate(self.series))
            else:
                constant = np.array(self.problem.y0, dtype=float).reshape(1, 1, n)
                dense = PiecewisePolynomial(np.full(2, float(self.problem.t0)), constant)
        return Solution(
            status=status,
            t=np.concatenate(self.times),
            y=np.concatenate(self.states),
            steps=self.steps,
            rejected=0,
            evaluations=self.steps,
            dense=dense,
            near=np.concatenate(self.near) if self.wound else None,
            end=self.end,
        )
