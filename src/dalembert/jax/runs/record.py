"""Records of runs that are computed in blocks of steps: plain arrays, cut to the steps taken."""

from __future__ import annotations

from typing import final

import numpy as np

from ...arrays import FloatArray
from ...ir.program import Program
from ...methods.status import Status
from ...steps.dense_output import PiecewisePolynomial
from ...steps.problem import IntegrationProblem, Solution
from ...steps.projection import end_in, projected


@final
class BlockRecord:
    """Collects blocks, whose time is negated where the problem goes backward.

    Parameters
    ----------
    problem : IntegrationProblem
        Says what is recorded.
    weights : ndarray (n_stages, degree)
        Inside a step with the increments k (n_stages, n_y) the solution is ``y + sum_j theta**(j+1) (weights^T k)_j``.
    program : Program
        Its projections are those of states inside steps.
    """

    def __init__(
        self,
        problem: IntegrationProblem,
        weights: FloatArray,
        program: Program,
    ) -> None:
        self._program = program
        self.direction = 1.0 if problem.t1 >= problem.t0 else -1.0
        self.steps = self.rejected = self.blocks = 0
        self._problem = problem
        self._weights = weights
        y0 = np.array(problem.y0, dtype=np.float64).reshape(1, -1)
        self._knots = [np.array([self.direction * problem.t0])]
        self._states = [y0]
        self._pieces: list[FloatArray] = []
        times = np.array(() if problem.t_eval is None else problem.t_eval, dtype=np.float64)
        self._sampled = int(np.count_nonzero(times == problem.t0))
        self._times = self.direction * times
        self._samples = [np.repeat(y0, self._sampled, axis=0)]

    def add(self, t: FloatArray, y: FloatArray, stages: FloatArray, rejected: int) -> None:
        """Add a block: its ends of steps t (k,), the states y (k, n_y) there, and the increments (k, n_stages, n_y)."""
        problem = self._problem
        self.steps, self.rejected, self.blocks = self.steps + len(t), self.rejected + rejected, self.blocks + 1
        if len(t) == 0:
            return
        knots = np.concatenate([self._knots[-1][-1:], t])
        states = np.concatenate([self._states[-1][-1:], y])
        if problem.dense or self._sampled < len(self._times):
            piece = PiecewisePolynomial(knots, self._coefficients(states, stages))
            self._sample(piece, states)
            if problem.dense:
                self._pieces.append(piece.coefficients)
        kept = slice(1 if problem.dense or problem.t_eval is None else -1, None)
        self._knots.append(knots[kept])
        self._states.append(states[kept])

    def solution(self, status: Status, evaluations: int) -> Solution:
        """Return the recorded solution, in the problem's own time."""
        sampled = self._problem.t_eval is not None
        knots = self.direction * np.concatenate(self._knots) + 0.0
        states = np.concatenate(self._states)
        times = self.direction * self._times[: self._sampled] + 0.0
        return Solution(
            status=status,
            t=times if sampled else knots,
            y=np.concatenate(self._samples) if sampled else states,
            steps=self.steps,
            rejected=self.rejected,
            evaluations=evaluations,
            dense=self._dense(knots, states) if self._problem.dense else None,
            end=float(knots[-1]),
        )

    def _coefficients(self, states: FloatArray, stages: FloatArray) -> FloatArray:
        """Return the coefficients (k, degree + 1, n_y) of the steps from `states` (k + 1, n_y)."""
        powers = np.einsum("sp,ksn->kpn", self._weights, stages, optimize=True)
        polynomials = np.concatenate([states[:-1, np.newaxis], powers], axis=1)
        end_in(states[1:], polynomials)
        return polynomials

    def _sample(self, piece: PiecewisePolynomial, states: FloatArray) -> None:
        """Record the times to evaluate that this block has reached; ends of steps give their states exactly."""
        reached = int(np.searchsorted(self._times, piece.knots[-1], side="right"))
        times = self._times[self._sampled : reached]
        if times.size:
            c = np.asarray(self._problem.constants, dtype=np.float64)
            values = projected(self._program, c, self.direction * times, piece(times))
            near = np.searchsorted(piece.knots, times)
            exact = piece.knots[near] == times
            values[exact] = states[near[exact]]
            self._samples.append(values)
            self._sampled = reached

    def _dense(self, knots: FloatArray, states: FloatArray) -> PiecewisePolynomial:
        if not self._pieces:
            return PiecewisePolynomial(np.repeat(knots, 2), states.reshape(1, 1, -1))
        return PiecewisePolynomial(knots, np.concatenate(self._pieces))
