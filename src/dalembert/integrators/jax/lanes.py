"""Many cases at once: one loop, in which every case has its own time, step and status.

Steps are straight-line code on arrays that hold one number a case, so that XLA makes one pass over the cases of them.
The state is carried as one array a component: were it one array in all, XLA would compute a whole step once for each
of its rows, with branches, and not vectorise it (measured on CPU: ten times slower). A case that has ended takes
steps of size zero; where samples are wanted, steps end at their times.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol, final

import jax.numpy as jnp
from jax import lax

from ..gains import BRANCH, SLOW
from ..status import Status
from .compiling import compiled

__all__ = ["Attempted", "Attempts", "Batch", "Outcome", "Rows", "TaylorAttempts", "run_batch"]

_RUNNING = -1
_QUADRATIC = 1e-8
LINEAR_CORRECTIONS = 2
_SMALLEST = 16.0 * 2.220446049250313e-16


Rows = tuple[Any, ...]
Function = Callable[..., Rows]


@final
class Batch(NamedTuple):
    """Cases to run: y (n_y rows (k,)), c (n_c rows (k,)), t0, t1 (k,), and the common settings.

    `floor` is the least scale of Taylor steps, `rtol` and `atol` are those of Runge-Kutta steps and projections.
    """

    y: Rows
    c: Rows
    t0: Any
    t1: Any
    t_eval: Any
    floor: Any
    rtol: Any
    atol: Any
    max_step: Any
    max_steps: Any


@final
class Outcome(NamedTuple):
    """Results: y (n_y rows (k,)), final times, statuses and steps (k,), and samples (n_t, n_y, k)."""

    y: Rows
    t: Any
    status: Any
    steps: Any
    samples: Any


@final
class Attempted(NamedTuple):
    """An attempt: the new state, its size, whether it is finite and accepted, the next size, and what to remember."""

    y: Rows
    size: Any
    finite: Any
    accepted: Any
    following: Any
    memory: Any


class Attempts(Protocol):
    """A one-step method on rows."""

    def start(self, batch: Batch, direction: Any) -> Any:
        """Return the memory before the first step."""

    def attempt(self, batch: Batch, t: Any, y: Rows, largest: Any, direction: Any, memory: Any) -> Attempted:
        """Attempt a step of at most `largest`."""


@final
class TaylorAttempts:
    """Steps (t, y, c, s) -> (new state, size, check), as `dalembert.ir.taylor.step_kernel` gives them."""

    def __init__(self, step: Function) -> None:
        self._step = step

    def start(self, batch: Batch, direction: Any) -> Any:
        """Return nothing: a Taylor step remembers nothing."""
        return ()

    def attempt(self, batch: Batch, t: Any, y: Rows, largest: Any, direction: Any, memory: Any) -> Attempted:
        """Take a step; one that is too small to advance the time is not accepted."""
        values = self._step(t, y, batch.c, (largest, direction, batch.floor))
        size, finite = values[len(y)], values[len(y) + 1] == 0.0
        accepted = finite & ~((size < largest) & (size < _least(t, batch.t1)))
        return Attempted(tuple(values[: len(y)]), size, finite, accepted, jnp.where(finite, size, 0.0), memory)


@final
class _Carry(NamedTuple):
    y: Rows
    t: Any
    status: Any
    steps: Any
    attempts: Any
    sampled: Any
    samples: Any
    memory: Any


def run_batch(
    attempts: Attempts, projections: Sequence[tuple[Function, int]], operations: int
) -> Callable[[Batch], Outcome]:
    """Return the compiled loop of a method.

    `projections` are functions (t, y, c) -> correction of the state, and how often each is applied after a step;
    `operations` is the length of all code that runs between two loops.
    """
    run: Callable[[Batch], Outcome] = compiled(partial(_run, attempts, tuple(projections)), operations)
    return run


def _least(t: Any, t1: Any) -> Any:
    """Return the size below which a step does not advance the time."""
    return _SMALLEST * jnp.abs(t) + 1e-30 * jnp.abs(t1 - t)


def _project(projections: Sequence[tuple[Function, int]], t: Any, y: Rows, c: Rows) -> tuple[Rows, Any]:
    """Return states on the constraints, and where that converged."""
    held = jnp.ones(t.shape, dtype=bool)
    for correct, count in projections:
        change = jnp.zeros(t.shape)
        for attempt in range(count):
            corrections = correct(t, y, c)
            if attempt == 0 and count == LINEAR_CORRECTIONS:
                held &= _on_branch(y, corrections)
            y = tuple(a + b for a, b in zip(y, corrections, strict=True))
        for value, correction in zip(y, corrections, strict=True):
            change = jnp.maximum(change, jnp.abs(correction) / (1e-3 + jnp.abs(value)))
        held &= change <= _QUADRATIC
    return y, held


def _on_branch(y: Rows, corrections: Rows) -> Any:
    """Return where corrections of velocities are small beside them."""
    size = magnitude = jnp.zeros(y[0].shape)
    for value, correction in zip(y, corrections, strict=True):
        size = jnp.maximum(size, jnp.abs(correction))
        magnitude = jnp.maximum(magnitude, jnp.where(correction != 0.0, jnp.abs(value), 0.0))
    return size <= BRANCH * (SLOW + magnitude)


def _run(attempts: Attempts, projections: Sequence[tuple[Function, int]], batch: Batch) -> Outcome:
    n, wanted = len(batch.y), len(batch.t_eval)
    direction = jnp.where(batch.t1 >= batch.t0, 1.0, -1.0)
    times = jnp.append(batch.t_eval, jnp.inf)
    places = jnp.arange(len(batch.t0))

    def due_now(carry: _Carry) -> Any:
        return (times[carry.sampled] == carry.t) & (carry.status != int(Status.NON_FINITE))

    def sample(carry: _Carry) -> _Carry:
        """Record the cases that are at the time of their next sample, repeated times included."""
        due = due_now(carry)
        row = jnp.where(due, carry.sampled, wanted)
        samples = carry.samples.at[row, :, places].set(jnp.stack(carry.y, axis=1), mode="drop")
        return carry._replace(samples=samples, sampled=carry.sampled + due)

    def sample_all(carry: _Carry) -> _Carry:
        if not wanted:
            return carry
        return lax.while_loop(lambda now: jnp.any(due_now(now)), sample, carry)

    def body(carry: _Carry) -> _Carry:
        running = carry.status == _RUNNING
        goal = batch.t1
        if wanted:
            ahead = times[carry.sampled]
            goal = jnp.where(jnp.isfinite(ahead), ahead, batch.t1)
        largest = jnp.where(running, jnp.minimum(batch.max_step, jnp.abs(goal - carry.t)), 0.0)
        found = attempts.attempt(batch, carry.t, carry.y, largest, direction, carry.memory)
        arrived = found.size == jnp.abs(goal - carry.t)
        after = jnp.where(arrived, goal, carry.t + direction * found.size)
        new, held = _project(projections, after, found.y, batch.c)
        moved = running & found.accepted & held
        t = jnp.where(moved, after, carry.t)
        y = tuple(jnp.where(moved, b, a) for a, b in zip(carry.y, new, strict=True))
        tried = carry.attempts + running
        stuck = ~found.accepted & (found.following < _least(carry.t, batch.t1))
        failed = jnp.where(found.finite, int(Status.STEP_TOO_SMALL), int(Status.NON_FINITE))
        status = jnp.where(tried >= batch.max_steps, int(Status.MAX_STEPS), _RUNNING)
        status = jnp.where(stuck, failed, status)
        status = jnp.where(found.accepted & ~held, int(Status.PROJECTION_FAILED), status)
        status = jnp.where(t == batch.t1, int(Status.SUCCESS), status)
        return sample_all(
            carry._replace(
                y=y,
                t=t,
                steps=carry.steps + moved,
                attempts=tried,
                status=jnp.where(running, status, carry.status),
                memory=found.memory,
            )
        )

    finite = jnp.isfinite(sum(batch.y) + sum(batch.c)) if batch.c else jnp.isfinite(sum(batch.y))
    status = jnp.where(batch.t0 == batch.t1, int(Status.SUCCESS), _RUNNING)
    start = _Carry(
        y=batch.y,
        t=batch.t0,
        status=jnp.where(finite, status, int(Status.NON_FINITE)),
        steps=jnp.zeros(len(batch.t0)),
        attempts=jnp.zeros(len(batch.t0)),
        sampled=jnp.zeros(len(batch.t0), dtype=int),
        samples=jnp.full((wanted, n, len(batch.t0)), jnp.nan),
        memory=attempts.start(batch, direction),
    )
    end = lax.while_loop(lambda carry: jnp.any(carry.status == _RUNNING), body, sample_all(start))
    return Outcome(end.y, end.t, end.status, end.steps, end.samples)
