"""The Taylor method for one trajectory: blocks of a fixed number of steps, compiled once an order."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, cast, final

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ...methods.status import RUNNING, Status
from ...options import component_tolerances
from ...steps.problem import IntegrationProblem, Solution
from ...transforms.taylor.step import scale_floor
from .lanes import Batch, State, TaylorAttempts, advanced, begun
from .precision import compiled, double_precision
from .run_data import BlockRecord
from .step_rules import Projections

if TYPE_CHECKING:
    from .run_constants import ArrayKernels

BLOCK_STEPS = 64
"""Steps in a block: the most that one call of the compiled function takes and returns."""


def _advance(
    attempts: TaylorAttempts, projections: Projections, order: int, batch: Batch, state: State
) -> tuple[Any, Any, State]:
    """Return a block of steps of one run: how many, a row for each (k, 1 + n_y (order + 1)), and the run behind them.

    A row holds the end of a step, the state (n_y,) there, and the terms of the series (order, n_y); k is `BLOCK_STEPS`.
    A run that has made no attempt begins.
    """
    n = len(batch.y[0])
    exponents = jnp.arange(1, order + 1)[:, None]

    def body(carry: Any) -> Any:
        count, rows, before = carry
        after, size = advanced(attempts, projections, batch, batch.t1, before)
        terms = after.memory[-1].reshape(n, order + 1).T[1:] * size**exponents
        row = jnp.concatenate([after.t[None], after.y[0], terms.ravel()])
        # What is written for a rejected attempt, the next one overwrites.
        return count + (size != 0.0), lax.dynamic_update_index_in_dim(rows, row, count, 0), after

    def goes_on(carry: Any) -> Any:
        return (carry[2].status == RUNNING) & (carry[0] < BLOCK_STEPS)

    start = jax.tree.map(lambda a, b: jnp.where(state.attempts == 0, a, b), begun(attempts, batch), state)
    return lax.while_loop(goes_on, body, (jnp.array(0), jnp.zeros((BLOCK_STEPS, 1 + n * (order + 1))), start))


@final
class TaylorIntegrator:
    """Taylor steps of one order for one program; what it compiles is kept and serves every problem.

    Parameters
    ----------
    attempts : TaylorAttempts
        Steps of one row that also give their series (`dalembert.transforms.taylor.step.step_kernel`).
    kernels : Kernels
        The kernels of the program.
    order : int
        Order of the step.
    operations : int
        Length of the step.
    """

    def __init__(self, attempts: TaylorAttempts, kernels: ArrayKernels, order: int, operations: int) -> None:
        self._order, self._program = order, kernels.program
        self._begun, self._blank = partial(begun, attempts), cast("State | None", None)
        self._advance = compiled(partial(_advance, attempts, kernels.projections, order), operations)

    def __call__(self, problem: IntegrationProblem) -> Solution:
        """Integrate a problem; numerical failure is the solution's status, never an exception."""
        record = BlockRecord(problem, np.eye(self._order), self._program)
        own = component_tolerances(problem.atol, self._program.layout.state)
        numbers = Batch(
            y=(np.array(problem.y0),),
            c=(np.array(problem.constants),),
            t0=problem.t0,
            t1=problem.t1,
            floor=scale_floor(problem.rtol, problem.atol),
            rtol=problem.rtol,
            atol=problem.atol if own is None else own,
            max_step=problem.max_step,
            max_steps=problem.max_steps,
            held_to=problem.rtol,
        )
        batch = jax.tree.map(lambda number: np.array(number, dtype=np.float64), numbers)
        n = len(numbers.y[0])
        with double_precision():
            state: State = self._without_attempts(batch)
            while state.status == RUNNING:
                count, rows, state = jax.device_get(self._advance(batch, state))
                t, y, terms = np.split(rows[:count], [1, 1 + n], axis=1)
                record.add(record.direction * t[:, 0], y, terms.reshape(count, self._order, n), 0)
        record.rejected = int(state.attempts - state.steps)
        return record.solution(Status(int(state.status)), int(state.attempts))

    def _without_attempts(self, batch: Batch) -> State:
        """Return a run that has made no attempt."""
        if self._blank is None:
            shapes = jax.eval_shape(self._begun, batch)
            zeros = jax.tree.map(lambda shape: np.zeros(shape.shape, shape.dtype), shapes)
            self._blank = zeros._replace(status=np.full_like(zeros.status, RUNNING))
        return self._blank
