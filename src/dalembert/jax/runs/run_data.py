"""Data of traced runs: the pieces of a method, limits of steps, records, results, and times along a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np

from ...arrays import FloatArray
from ...frozen import frozen
from ...ir.program import Program
from ...methods.status import Status
from ...steps.dense_output import PiecewisePolynomial
from ...steps.problem import IntegrationProblem, Solution
from ...steps.projection import end_in, projected
from .derivatives import Stepping
from .lanes import Attempts, Function
from .step_rules import Projections

if TYPE_CHECKING:
    from ..foreign import ForeignRuns


@final
@frozen
class RunPieces:
    """A method, in the forms that a traced run needs.

    Attributes
    ----------
    one, one_projections
        Attempts and corrections of one case, on one row that holds all components.
    many, many_projections
        Attempts and corrections of many cases, on a row for each component.
    steps
        Steps of given sizes, and their derivatives.
    decided
        (t, y, c) -> the values in the rates that jump with the state, on rows; None where nothing does.
    moved_by
        Numbers of the constants on which the times of breaks depend.
    foreign
        Runs as calls of machine code; None where there are none.
    """

    one: Attempts
    one_projections: Projections
    many: Attempts
    many_projections: Projections
    steps: Stepping
    decided: Function | None = None
    moved_by: tuple[int, ...] = ()
    foreign: ForeignRuns | None = None


@final
@frozen
class Limits:
    """Tolerances, the least scale of Taylor steps, the largest step, and how many steps may be attempted.

    `atol` is one number, or an array (n_y,) where each component of the state has its own.
    They may be traced, in runs that are not differentiated.
    """

    rtol: Any
    atol: Any
    floor: Any
    max_step: Any
    max_steps: Any


@final
class Reached(NamedTuple):
    """States (n_t, n_y) of a run, NaN at times not reached, its status, its accepted steps, and its attempts."""

    y: Any
    status: Any
    steps: Any
    attempts: Any


def in_order(t: Any) -> tuple[Any, Any]:
    """Return times (n_t,) by which to run, and whether they are those given: finite, and going one way."""
    ordered = jnp.all(jnp.isfinite(t)) & (jnp.all(t[1:] >= t[:-1]) | jnp.all(t[1:] <= t[:-1]))
    return jnp.where(ordered, t, 0.0), ordered


def middles(t: Any, breaks: Any) -> Any:
    """Return the middles (n_t,) between the breaks (n,) around times, of which the first is 0 and the last the end."""
    direction, count = jnp.where(t[-1] >= t[0], 1.0, -1.0), len(breaks)
    passed = places(direction * breaks, direction * t)
    behind = jnp.where(passed > 0, breaks[jnp.maximum(passed - 1, 0)], t[0])
    ahead = breaks[jnp.minimum(passed, count - 1)]
    ahead = jnp.where((passed < count) & jnp.isfinite(ahead), ahead, t[-1])
    return behind + 0.5 * (ahead - behind)


def places(rows: Any, values: Any) -> Any:
    """Return how many of the rising `rows` (n,) are at most each of the values (k,)."""
    return jnp.searchsorted(*jax.lax.stop_gradient((rows, values)), side="right")


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
