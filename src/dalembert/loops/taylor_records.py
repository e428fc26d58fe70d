"""The record of a Taylor run: its steps, or the states at the requested times, and the series of the steps."""

from __future__ import annotations

import math
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..methods.status import Status
from ..steps.dense_output import PiecewisePolynomial
from ..steps.problem import IntegrationProblem, Solution
from ..steps.projection import end_in

TURN = 2.0 * math.pi

_Block = tuple[FloatArray, FloatArray, FloatArray | None]
"""Times (k,), what the steps put out there (k, width) or states (k, n), and the turns (n,) that angles made before."""


@final
class RunRecord:
    """The record of a run: its steps or the states at the requested times, and the series if requested.

    Where the state jumps at a stop, series and steps end in the state before it. Requested times have that behind it,
    as have steps where the stops of the problem say so.
    """

    def __init__(self, problem: IntegrationProblem, order: int) -> None:
        self.problem, self.order = problem, order
        self.steps, self.end, self.wound = 0, float(problem.t0), False
        self.start = np.asarray(problem.y0, dtype=float)
        self.blocks: list[_Block] = []
        self.samples: list[_Block] = []
        self.behind: list[tuple[NDArray[np.intp], FloatArray]] = []

    def add(self, times: FloatArray, rows: FloatArray, turns: FloatArray | None) -> None:
        """Add a block of steps, less some turns (n,)."""
        if not len(times):
            return
        problem, n, place, behind = self.problem, len(self.problem.y0), self.steps, None
        if problem.stops is not None:
            times, rows, behind = _parted(times, rows, n)
        start, self.end = self.end, float(times[-1])
        self.steps += len(times)
        if problem.t_eval is not None:
            requested, low, high = problem.t_eval, min(start, self.end), max(start, self.end)
            inside = requested[(requested >= low) & (requested <= high) & (requested != start)]
            series = _Series(self.order, self._direction, [(times, rows, None)], n)
            found = PiecewisePolynomial(np.append(start, times), series)(inside)
            for number, state in zip(*behind, strict=True) if behind is not None else ():
                found[inside == times[number]] = state
            self.samples.append((inside, found, turns))
        elif behind is not None and problem.stops is not None and problem.stops.behind:
            self.behind.append((behind[0] + 1 + place, behind[1]))
        if problem.dense:
            self.blocks.append((times, rows, turns))
        elif problem.t_eval is None:
            self.blocks.append((times, rows[:, :n].copy(), turns))

    @property
    def _direction(self) -> float:
        return 1.0 if self.problem.t1 >= self.problem.t0 else -1.0

    def solution(self, status: Status) -> Solution:
        """Return the solution of a run that ended with `status`."""
        problem, n = self.problem, len(self.problem.y0)
        count = 1 + sum(len(times) for times, _, _ in self.blocks)
        knots, wrapped = np.empty(count), np.empty((count, n))
        knots[0], wrapped[0], place = problem.t0, self.start, 1
        for times, rows, _ in self.blocks:
            knots[place : place + len(times)], wrapped[place : place + len(times)] = times, rows[:, :n]
            place += len(times)
        for numbers, states in self.behind:
            wrapped[numbers] = states
        parts = self.blocks
        t = knots.copy() if problem.dense else knots
        if problem.t_eval is not None:
            parts, first = self.samples, problem.t_eval[problem.t_eval == problem.t0]
            t = np.concatenate([first, *(times for times, _, _ in parts)])
            wrapped = np.concatenate(
                [self.start[np.newaxis].repeat(len(first), axis=0), *(states for _, states, _ in parts)]
            )
        y = self._turned(wrapped, parts) if self.wound else wrapped
        dense = None
        if problem.dense and self.blocks:
            dense = PiecewisePolynomial(knots, _Series(self.order, self._direction, self.blocks, n))
        elif problem.dense:
            constant = self.start.reshape(1, 1, n).copy()
            dense = PiecewisePolynomial(np.full(2, float(problem.t0)), constant)
        return Solution(
            status=status,
            t=t,
            y=y,
            steps=self.steps,
            rejected=0,
            evaluations=self.steps,
            dense=dense,
            wrapped=wrapped if self.wound else None,
            end=self.end,
        )

    @staticmethod
    def _turned(wrapped: FloatArray, parts: list[_Block]) -> FloatArray:
        """Return states with the turns that angles had made before the parts of the record, the last of the states."""
        y = wrapped.copy()
        place = len(wrapped) - sum(len(times) for times, _, _ in parts)
        for times, _, turns in parts:
            if turns is not None:
                y[place : place + len(times)] += turns * TURN
            place += len(times)
        return y


def _parted(
    times: FloatArray, rows: FloatArray, n: int
) -> tuple[FloatArray, FloatArray, tuple[NDArray[np.intp], FloatArray] | None]:
    """Return the steps among rows, and behind which of these (m,) a stop gave which states (m, n)."""
    jumps = np.flatnonzero((rows[:, n] == 0.0) & (np.diff(times, prepend=np.nan) == 0.0))
    if not len(jumps):
        return times, rows, None
    steps = np.ones(len(times), np.bool_)
    steps[jumps] = False
    return times[steps], rows[steps], (jumps - 1 - np.arange(len(jumps)), rows[jumps, :n])


@final
@frozen(eq=False)
class _Series:
    """Coefficients of the polynomials of steps, computed on demand from the outputs of the steps."""

    order: int
    direction: float
    blocks: list[_Block]
    n: int

    def __call__(self) -> FloatArray:
        """Return coefficients (steps, order + 1, n) in the fraction of the step, continuous at the knots."""
        parts = [self._coefficients(rows, turns) for _, rows, turns in self.blocks]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _coefficients(self, rows: FloatArray, turns: FloatArray | None) -> FloatArray:
        n, raw = self.n, rows[:, self.n + 2 :].reshape(len(rows), self.n, self.order + 1)
        sizes = rows[:, n] * self.direction  # differences of late knots have lost digits
        with np.errstate(over="ignore", invalid="ignore"):
            powers = sizes[:, np.newaxis] ** np.arange(self.order + 1)
            series: FloatArray = np.ascontiguousarray((raw * powers[:, np.newaxis, :]).transpose(0, 2, 1))
        if not np.all(np.isfinite(powers[:, -1])):  # of steps so long that their other terms are zero
            series[raw.transpose(0, 2, 1) == 0.0] = 0.0
        end_in(rows[:, :n], series)
        if turns is not None:
            series[:, 0] += turns * TURN
        return series
