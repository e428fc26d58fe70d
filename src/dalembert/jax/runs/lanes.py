"""Many cases at once: one loop, in which every case has its own time, step and status.

Steps are straight-line code on arrays that hold one number a case, so that XLA makes one pass over the cases of them.
The state is carried as one array a component: were it one array in all, XLA would compute a whole step once for each
of its rows, with branches, and not vectorise it (measured on CPU: ten times slower). A case that has ended takes
steps of size zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, final

import jax
import jax.numpy as jnp
from jax import lax

from ...methods.status import RUNNING, Status
from ...methods.step_constants import ANY_START, REDUCTION_BLIND
from .step_rules import Projections, Rows, project, smallest_of, smallest_step, weights_of

Function = Callable[..., Rows]


@final
class Batch(NamedTuple):
    """Cases to run: y (n_y rows (k,)), c (n_c rows (k,)), t0, t1 (k,), and the common settings.

    `floor` is the least scale of Taylor steps, `rtol` and `atol` are those of Runge-Kutta steps. Projections
    read `atol` and `held_to`, which is rtol where runs start on the constraints. Steps end at `breaks` (n, k), which
    lie in the order of a run, infinite behind the last; between them, constants are ``between(c, middle, passed)``,
    from what c is, the middle of two breaks, and how many have been passed.
    """

    y: Rows
    c: Rows
    t0: Any
    t1: Any
    floor: Any
    rtol: Any
    atol: Any
    max_step: Any
    max_steps: Any
    breaks: Any = ()
    between: Any = ()
    held_to: Any = ANY_START


@final
class Attempted(NamedTuple):
    """An attempt: the new state, its size, whether it is finite and accepted, the next size, and what to remember."""

    y: Rows
    size: Any
    finite: Any
    accepted: Any
    following: Any
    memory: Any


Sides = Callable[..., tuple[Rows, Rows]]
"""(t, y, c) -> states on the sides of knots of tables that motions forwards and backwards in time go to."""


class Attempts(Protocol):
    """A one-step method on rows; `sides` move states at breaks, None leaves them.

    Where steps are `sized` by what was before, the memory begins with the size of the next one.
    """

    sides: Sides | None
    sized: bool

    def start(self, batch: Batch, direction: Any) -> Any:
        """Return the memory before the first step."""

    def attempt(self, batch: Batch, t: Any, y: Rows, largest: Any, direction: Any, memory: Any) -> Attempted:
        """Attempt a step of at most `largest`."""

    def retry(self, memory: Any, size: Any) -> tuple[Any, Any]:
        """Return the memory for another attempt after one whose end cannot be projected, and its size.

        See `step_control.blind_retry`; the memory begins with the largest size of the next attempt.
        """
        smaller = REDUCTION_BLIND * size
        return (smaller, *memory[1:]), smaller


@final
class TaylorAttempts(Attempts):
    """Steps (t, y, c, s) -> (new state, size, check), as `dalembert.transforms.taylor.step.step_kernel` gives them.

    Those that do not grow at once, `step_growth_limited`, receive the size of the step before, as a last row of y.
    What is remembered is the largest size after a projection that failed, that size, and what else a step gives: as its
    outputs behind the check, so many numbers of its `series`.
    """

    def __init__(
        self, step: Function, *, step_growth_limited: bool, sides: Sides | None = None, series: int = 0
    ) -> None:
        self._step, self._paced, self.sides, self.sized = step, step_growth_limited, sides, False
        self._series = series

    def start(self, batch: Batch, direction: Any) -> Any:
        """Return that no projection has failed, and the size of no step, where steps are given."""
        none = jnp.zeros(jnp.shape(batch.t0))
        return self._memory(none + jnp.inf, none, (jnp.zeros(self._series),) if self._series else ())

    def attempt(self, batch: Batch, t: Any, y: Rows, largest: Any, direction: Any, memory: Any) -> Attempted:
        """Take a step; one that is too small to advance the time is not accepted."""
        most, told = memory[0], memory[1:2] if self._paced else ()
        values = self._step(
            t, (*y, *told), batch.c, (jnp.minimum(largest, most), direction, batch.floor, *weights_of(batch.atol))
        )
        size, finite = values[len(y)], values[len(y) + 1] == 0.0
        accepted = finite & ~((size < largest) & (size < smallest_step(t, jnp.abs(batch.t1 - t))))
        memory = self._memory(jnp.full_like(most, jnp.inf), size, values[len(y) + 2 :])
        return Attempted(tuple(values[: len(y)]), size, finite, accepted, jnp.where(finite, size, 0.0), memory)

    def _memory(self, most: Any, size: Any, series: Rows) -> Rows:
        return (most, size, *series) if self._paced else (most, *series)


@final
class State(NamedTuple):
    """Present state of cases: y (n_y rows (k,)), and (k,) time, status, steps, attempts, memory of the method.

    Where steps end at breaks, also how many of them each case has passed.
    """

    y: Rows
    t: Any
    status: Any
    steps: Any
    attempts: Any
    memory: Any
    passed: Any = ()


def direction_of(batch: Batch) -> Any:
    """Return 1 where time runs forward, -1 where it runs backward."""
    return jnp.where(batch.t1 >= batch.t0, 1.0, -1.0)


def _next_break(batch: Batch, passed: Any) -> tuple[Any, Batch]:
    """Return where steps must end next, and the cases with what is decided until then."""
    direction, count = direction_of(batch), len(batch.breaks)
    places = (jnp.arange(len(batch.t0)),) if jnp.ndim(batch.t0) else ()
    ahead = batch.breaks[(jnp.minimum(passed, count - 1), *places)]
    ahead = jnp.where((passed < count) & (direction * ahead < direction * batch.t1), ahead, batch.t1)
    behind = jnp.where(passed > 0, batch.breaks[(jnp.maximum(passed - 1, 0), *places)], batch.t0)
    middle = behind + 0.5 * (ahead - behind)
    return ahead, batch._replace(c=batch.between(batch.c, middle, passed))


def begun(attempts: Attempts, batch: Batch) -> State:
    """Return cases at their start; those that hold no numbers have failed, those without a span are done."""
    finite = jnp.ones(jnp.shape(batch.t0), dtype=bool)
    for row in (*batch.y, *batch.c):
        finite &= jnp.all(jnp.isfinite(row), axis=tuple(range(finite.ndim, jnp.ndim(row))))
    status = jnp.where(batch.t0 == batch.t1, int(Status.SUCCESS), RUNNING)
    none = jnp.zeros(jnp.shape(batch.t0))
    passed: Any = ()
    if len(batch.breaks):
        passed = jnp.zeros(jnp.shape(batch.t0), dtype=int)
        batch = _next_break(batch, passed)[1]
    return State(
        y=batch.y,
        t=batch.t0,
        status=jnp.where(finite, status, int(Status.NON_FINITE)),
        steps=none,
        attempts=none,
        memory=attempts.start(batch, direction_of(batch)),
        passed=passed,
    )


def advanced(attempts: Attempts, projections: Projections, batch: Batch, goal: Any, state: State) -> tuple[State, Any]:
    """Return cases after one attempt towards the times `goal`, and by how much the time of each moved."""
    direction, passed, whole = direction_of(batch), state.passed, batch
    running = state.status == RUNNING
    if len(batch.breaks):
        ahead, batch = _next_break(batch, passed)
        goal = jnp.where(direction * ahead < direction * goal, ahead, goal)
    rest = jnp.abs(goal - state.t)
    largest = jnp.where(running, jnp.minimum(batch.max_step, rest), 0.0)
    found = attempts.attempt(batch, state.t, state.y, largest, direction, state.memory)
    after = jnp.where(found.size == rest, goal, state.t + direction * found.size)
    new, held = project(projections, after, found.y, batch.c, state.y, (batch.held_to, smallest_of(batch.atol)))
    moved = running & found.accepted & held
    t = jnp.where(moved, after, state.t)
    tried = state.attempts + running
    least = smallest_step(state.t, jnp.abs(batch.t1 - state.t))
    stuck = ~found.accepted & (found.following < least)
    again, smaller = attempts.retry(state.memory, found.size)
    loose = found.accepted & ~held
    failed = jnp.where(found.finite, int(Status.STEP_TOO_SMALL), int(Status.NON_FINITE))
    status = jnp.where(tried >= batch.max_steps, int(Status.MAX_STEPS), RUNNING)
    status = jnp.where(stuck, failed, status)
    status = jnp.where(loose & (smaller < least), int(Status.PROJECTION_FAILED), status)
    status = jnp.where(t == batch.t1, int(Status.SUCCESS), status)
    if len(batch.breaks):
        crossed = moved & (t == ahead) & (t != batch.t1)
        passed = passed + crossed
        if attempts.sides is not None:
            sides, c = attempts.sides, _next_break(whole, passed)[1].c
            ways = lax.cond(jnp.any(crossed), lambda: sides(t, new, c), lambda: (tuple(new), tuple(new)))
            sided = (jnp.where(direction > 0.0, a, b) for a, b in zip(*ways, strict=True))
            new = tuple(jnp.where(crossed, b, a) for a, b in zip(new, sided, strict=True))
    following = State(
        y=tuple(jnp.where(moved, b, a) for a, b in zip(state.y, new, strict=True)),
        t=t,
        status=jnp.where(running, status, state.status),
        steps=state.steps + moved,
        attempts=tried,
        memory=jax.tree.map(lambda a, b: jnp.where(loose, a, b), again, found.memory),
        passed=passed,
    )
    return following, jnp.where(moved, direction * found.size, 0.0)
