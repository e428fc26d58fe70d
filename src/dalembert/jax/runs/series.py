"""The Taylor method for one trajectory: blocks of a fixed number of steps, compiled once an order."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ...methods.status import RUNNING, Status
from ...methods.step_constants import REDUCTION_BLIND
from ...options import component_tolerances
from ...steps.problem import IntegrationProblem, Solution
from ...transforms.taylor import scale_floor
from .precision import compiled, double_precision
from .run_data import BlockRecord
from .step_rules import smallest_step

if TYPE_CHECKING:
    from .run_constants import ArrayKernels

BLOCK_STEPS = 64
"""Steps in a block: the most that one call of the compiled function takes and returns."""


@final
class _Span(NamedTuple):
    """Inputs of a run: ends of time, its direction, largest step, scale floor, constants, tolerances, weights."""

    t0: Any
    t1: Any
    direction: Any
    max_step: Any
    floor: Any
    c: Any
    rtol: Any
    atol: Any
    weights: tuple[Any, ...]


@final
class _Block(NamedTuple):
    """The state of a block of steps: time and state reached, size of the last step, number of steps.

    `most` is the largest size of the next attempt: smaller than any after one whose end could not be projected.
    Their ends are t (k,), the states there y (k, n_y), the terms of the series increments (k, order, n_y), where k is
    `BLOCK_STEPS`.
    """

    count: Any
    now: Any
    most: Any
    before: Any
    state: Any
    status: Any
    t: Any
    y: Any
    increments: Any


def _advance(
    step: Callable[..., Any],
    step_growth_limited: bool,
    kernels: ArrayKernels,
    order: int,
    span: _Span,
    t: Any,
    before: Any,
    y: Any,
    limit: Any,
) -> _Block:
    """Return a block of steps from time t and state y (n_y,), of which there are `limit` at most."""
    n = len(y)

    def body(block: _Block) -> _Block:
        return _after_step(step, step_growth_limited, kernels, span, block)

    start = _Block(
        jnp.array(0),
        t,
        jnp.array(jnp.inf),
        before,
        y,
        jnp.array(RUNNING),
        jnp.zeros(BLOCK_STEPS),
        jnp.zeros((BLOCK_STEPS, n)),
        jnp.zeros((BLOCK_STEPS, order, n)),
    )
    return lax.while_loop(lambda block: (block.status == RUNNING) & (block.count < limit), body, start)


def _after_step(
    step: Callable[..., Any], step_growth_limited: bool, kernels: ArrayKernels, span: _Span, block: _Block
) -> _Block:
    """Return a block with one step more, or with the status that ends the run."""
    n, order = len(block.state), block.increments.shape[1]
    exponents = jnp.arange(1, order + 1)[:, None]
    rest = jnp.abs(span.t1 - block.now)
    settings = (jnp.minimum(jnp.minimum(rest, span.max_step), block.most), span.direction, span.floor, *span.weights)
    known = jnp.append(block.state, block.before) if step_growth_limited else block.state
    values = jnp.stack([jnp.asarray(v, dtype=float) for v in step(block.now, known, span.c, settings)])
    size, finite = values[n], values[n + 1] == 0.0
    least, smaller = smallest_step(block.now, rest), REDUCTION_BLIND * size
    stuck = (size < least) & (size < rest)
    now = jnp.where(size == rest, span.t1, block.now + span.direction * size)
    new = kernels.project(now, values[:n], span.c, block.state, (span.rtol, span.atol))
    held = jnp.all(jnp.isfinite(new))
    status = jnp.where(now == span.t1, int(Status.SUCCESS), RUNNING)
    status = jnp.where(held, status, jnp.where(smaller < least, int(Status.PROJECTION_FAILED), RUNNING))
    status = jnp.where(stuck, int(Status.STEP_TOO_SMALL), status)
    status = jnp.where(finite, status, int(Status.NON_FINITE))
    moved = finite & ~stuck & held
    increments = values[n + 2 :].reshape(n, order + 1).T[1:] * (span.direction * size) ** exponents
    return _Block(
        block.count + moved,
        jnp.where(moved, now, block.now),
        jnp.where(moved, jnp.inf, smaller),
        jnp.where(moved, size, block.before),
        jnp.where(moved, new, block.state),
        status,
        block.t.at[block.count].set(now),
        block.y.at[block.count].set(new),
        block.increments.at[block.count].set(increments),
    )


@final
class TaylorIntegrator:
    """Taylor steps of one order for one program; what it compiles is kept and serves every problem.

    Parameters
    ----------
    step : callable
        A step that also gives its series (`dalembert.transforms.taylor.step_kernel`).
    kernels : Kernels
        The kernels of the program.
    order : int
        Order of the step.
    operations : int
        Length of the step.
    step_growth_limited : bool
        Whether the size of the step before lies behind the state that it takes.
    """

    def __init__(
        self, step: Callable[..., Any], kernels: ArrayKernels, order: int, operations: int, *, step_growth_limited: bool
    ) -> None:
        self._order = order
        self._kernels = kernels
        self._advance = compiled(partial(_advance, step, step_growth_limited, kernels, order), operations)

    def __call__(self, problem: IntegrationProblem) -> Solution:
        """Integrate a problem; numerical failure is the solution's status, never an exception."""
        record = BlockRecord(problem, np.eye(self._order), self._kernels.program)
        own = component_tolerances(problem.atol, self._kernels.program.layout.state)
        span = _Span(
            np.float64(problem.t0),
            np.float64(problem.t1),
            np.float64(record.direction),
            np.float64(problem.max_step),
            np.float64(scale_floor(problem.rtol, problem.atol)),
            np.array(problem.constants, dtype=np.float64),
            np.float64(problem.rtol),
            np.float64(problem.atol),
            () if own is None else tuple(problem.atol / own),
        )
        t, before, y = span.t0, np.float64(0.0), np.array(problem.y0, dtype=np.float64)
        status = RUNNING if np.all(np.isfinite(y)) and np.all(np.isfinite(span.c)) else int(Status.NON_FINITE)
        if status == RUNNING and problem.t0 == problem.t1:
            status = int(Status.SUCCESS)
        with double_precision():
            while status == RUNNING:
                limit = min(BLOCK_STEPS, problem.max_steps - record.steps)
                if limit == 0:
                    status = int(Status.MAX_STEPS)
                    break
                block: _Block = jax.device_get(self._advance(span, t, before, y, np.int64(limit)))
                count = slice(int(block.count))
                record.add(record.direction * block.t[count], block.y[count], block.increments[count], 0)
                t, before, y, status = block.now, block.before, block.state, int(block.status)
        return record.solution(Status(status), record.steps)
