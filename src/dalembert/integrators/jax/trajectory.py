"""Single trajectories in blocks of steps, with polynomials of the steps.

JAX needs the size of every buffer when it compiles. A block has room for a fixed number of steps, and a run is as many
blocks as it takes: memory grows with the steps that were taken, not with those that were allowed, and nothing is
compiled anew for a longer span, other tolerances or other times to evaluate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np

from ...arrays import FloatArray
from ...ir.program import Program
from ...methods.status import RUNNING, Status
from ...methods.step_constants import SMALLEST_SCALE
from ...transforms.taylor import scale_floor
from ..dense_output import PiecewisePolynomial
from ..problem import IntegrationProblem, Solution
from ..projected_states import projected
from ..step_polynomials import end_in
from .compiling import compiled
from .lanes import Attempts, Batch, State, begun
from .precision import double_precision
from .projection import Projections
from .recording import block_of

__all__ = ["Polynomials", "Trajectories"]

BLOCK_STEPS = 64
"""Attempts in a block: the most that one call of the compiled function takes and returns."""


@final
@dataclass(frozen=True, eq=False)
class Polynomials:
    """Polynomials of steps of one method.

    Attributes
    ----------
    increments : callable
        (t, h, y, c) -> increments (k, stages, n_y) of steps from times (k,), sizes (k,), states (k, n_y) and constants.
    weights : ndarray (stages, degree)
        Inside a step with the increments d the solution is ``y + sum_j theta**(j+1) (weights^T d)_j``.
    """

    increments: Callable[..., Any]
    weights: FloatArray


@final
class Trajectories:
    """Trajectories by one method of one program; what is compiled is kept and serves every problem.

    Parameters
    ----------
    program : Program
    attempts, projections
        The method, for one case.
    polynomials : Polynomials
    sizes : (int, int)
        Length of the code of a step, and evaluations of the right-hand side in an attempt.
    """

    def __init__(
        self,
        program: Program,
        attempts: Attempts,
        projections: Projections,
        polynomials: Polynomials,
        sizes: tuple[int, int],
    ) -> None:
        self._program, self._polynomials, (operations, self._evaluations) = program, polynomials, sizes
        self._begin = compiled(partial(_begun, attempts), operations)
        self._advance = compiled(partial(_block, attempts, projections), operations)
        self._increments = compiled(polynomials.increments, operations)

    def __call__(self, problem: IntegrationProblem) -> Solution:
        """Integrate a problem; numerical failure is the solution's status, never an exception."""
        record = _Record(problem, self._polynomials.weights, self._program)
        c = np.array(problem.constants, dtype=np.float64)
        floor, least = scale_floor(problem.rtol, problem.atol), max(problem.atol, SMALLEST_SCALE)
        numbers = problem.t0, problem.t1, floor, problem.rtol, least, problem.max_step, problem.max_steps
        with double_precision():
            batch = Batch((np.array(problem.y0, dtype=np.float64),), (c,), *map(np.float64, numbers))
            state = self._begin(batch, np.float64(problem.first_step or 0.0))
            status = int(state.status)
            while status == RUNNING:
                count, taken, state = self._advance(batch, state)
                count, taken, end, status = jax.device_get((count, taken, (state.t, state.y[0]), state.status))
                record.add(taken[:count], end, partial(self._stages, taken, c))
        attempts = record.steps + record.rejected
        return record.solution(Status(int(status)), 2 + self._evaluations * attempts)

    def _stages(self, taken: FloatArray, c: FloatArray) -> FloatArray:
        """Return the increments of attempts (k, 2 + n_y)."""
        return np.asarray(self._increments(taken[:, 0], taken[:, 1], taken[:, 2:], c))


def _begun(attempts: Attempts, batch: Batch, first: Any) -> State:
    """Return a case at its start; its first step has the size `first`, if that is not 0 and the method asks."""
    state = begun(attempts, batch)
    if attempts.sized:
        size, *others = state.memory
        state = state._replace(memory=(jnp.where(first > 0.0, first, size), *others))
    return _as_carried(state)


def _block(attempts: Attempts, projections: Projections, batch: Batch, state: State) -> tuple[Any, Any, State]:
    """Return the result of `block_of`."""
    count, taken, state = block_of(attempts, projections, BLOCK_STEPS, batch, state)
    return count, taken, _as_carried(state)


def _as_carried(state: State) -> State:
    """Return a state whose numbers have types of their own, so that what takes it is compiled once."""
    return jax.tree.map(lambda leaf: jax.lax.convert_element_type(leaf, leaf.dtype), state)


@final
class _Record:
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
        self.steps = self.rejected = 0
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

    def add(self, taken: FloatArray, end: tuple[float, FloatArray], stages: Callable[[], FloatArray]) -> None:
        """Add a block of attempts (k, 2 + n_y), whose sizes are 0 where they were rejected, and its end.

        `stages` gives the increments of the attempts, and what else there is room for, where they are needed.
        """
        problem, accepted = self._problem, np.flatnonzero(taken[:, 1])
        self.steps, self.rejected = self.steps + len(accepted), self.rejected + len(taken) - len(accepted)
        if len(accepted) == 0:
            return
        knots = self.direction * np.append(taken[accepted, 0], end[0])
        states = np.concatenate([taken[accepted, 2:], end[1][np.newaxis]])
        if problem.dense or self._sampled < len(self._times):
            piece = PiecewisePolynomial(knots, self._coefficients(states, stages()[accepted]))
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
