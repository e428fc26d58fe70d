"""Data of traced runs: the pieces of a method, limits of steps, results, and times along a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol, final

import jax
import jax.numpy as jnp

from .along import Differentiable
from .derivatives import Steps, StepsRecord
from .lanes import Attempts, Function
from .mesh_axes import vectorised
from .step_rules import Projections, Rows


class Stepping(Differentiable, Protocol):
    """Steps of given sizes, and their derivatives."""

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, n_y rows (k,)."""

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps, n_y rows (k,)."""


class Foreign(Protocol):
    """Runs as calls of machine code."""

    @property
    def serves(self) -> bool:
        """Whether the present trace may have such calls."""
        ...

    def __call__(
        self, limits: Limits, room: int, traced: Callable[..., StepsRecord], cases: int, t: Any, y: Any, c: Any
    ) -> StepsRecord:
        """Return the results of runs, with rows of times, first states and constants: one for each case, or for all.

        `traced` is a function of rows (t, y, c) of all cases that does so in a traced loop.
        """
        ...


@final
@dataclass(frozen=True)
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
    foreign: Foreign | None = None


@final
@dataclass(frozen=True)
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


@final
class Path(NamedTuple):
    """The attempts of a run, of which `count` were made, as in `StepsRecord`: what it takes to go along it again.

    ``taken`` (room, 2 + n_y), ``end`` (n_y,), and the time ``reached``, in the direction of the run.
    """

    count: Any
    taken: Any
    end: Any
    reached: Any
    direction: Any


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
    still = jax.lax.stop_gradient
    return vectorised(partial(jnp.searchsorted, side="right"), True, still(rows), still(values))
