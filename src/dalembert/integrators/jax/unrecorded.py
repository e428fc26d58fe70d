"""Changes of states at times, of runs of which no record is kept: by blocks that are recomputed, or continuous."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp

from ...methods.status import Status
from .continuous import Continuous, Passed
from .derivatives import Steps
from .jumping import moved_until
from .linear_maps import apply
from .mesh_axes import stack, vectorised
from .recomputed import Blocks, Kept, Recomputed, with_blocks
from .run_data import Limits, Pieces, Reached, in_order

__all__ = ["Marked", "Unrecorded", "moved_behind", "with_marks"]


@final
class Marked(NamedTuple):
    """A run along times (n_t,), in floating point numbers, with its states at breaks.

    Attributes
    ----------
    reached
        As a call of the run returns it.
    known, moved : Array (n_t,)
        Which times were reached; which lie behind a break that moves and at which rates jump.
    at_breaks : Array (n, n_y)
        States at the breaks that were reached.
    end : Array ()
        The time that was reached.
    """

    reached: Any
    known: Any
    moved: Any
    at_breaks: Any
    end: Any


def moved_behind(pieces: Pieces, t: Any, c: Any, course: tuple[Any, Any, Any], states: Any, go: Any) -> Any:
    """Return which times (n_t,) lie behind a break that moves and at which rates jump: 1, else 0.

    `course` is the time reached, breaks (n,), and which of them move; `states` (n, n_y) are those at the breaks, and
    `go` is true.
    """
    direction = jnp.where(t[-1] >= t[0], 1.0, -1.0)

    def rates(t: Any, y: Any, c: Any) -> Any:
        return pieces.steps.rates(Steps(t, jnp.zeros_like(t), y, c, go))

    reached, breaks, moved = course
    until = moved_until(rates, pieces.steps.constants, states, c, direction, (t[-1], reached, breaks, moved > 0.0))
    return (direction * (t - until) > 0.0).astype(float)


@final
@dataclass(frozen=True, eq=False)
class Unrecorded:
    """Changes of runs of one method whose adjoint is not "recorded".

    Attributes
    ----------
    pieces, limits
        The method, and how the steps are chosen.
    marked
        From (t, y0, c, breaks, moved) to `Marked`: the run as it is.
    continuous : bool
        Whether changes are those of the motion, else of the steps.
    """

    pieces: Pieces
    limits: Limits
    marked: Callable[..., Marked]
    continuous: bool

    def __call__(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any, moving: Any) -> tuple[Marked, Any]:
        """Return the result of a run, as `Marked`, and the changes (n_t, n_y) of the states.

        `moving` are the changes of the first state and of the constants.
        """
        still = jax.lax.stop_gradient
        given = still(t), still(y0), still(c), still(breaks), still(moved)
        if self.continuous:
            run, held = vectorised(self._at_marks, True, *given)
            held = held._replace(y=jnp.concatenate([y0[None], held.y[1:]]), c=c, requested=t)
            limits, make = self.limits, self.pieces.field
            assert make is not None
            settings = limits.rtol, limits.atol, limits.max_step, limits.max_steps
            return run, apply(Continuous(make(), settings), held, moving)
        kept, run = vectorised(self._in_blocks, True, *given)
        states = jnp.concatenate([y0[None], kept.states.y[0][1:]])
        kept = kept._replace(states=kept.states._replace(y=(states,)), c=c, requested=t)
        last, changes = apply(Recomputed(self.pieces.steps, self._blocks), kept, moving)
        return run, changes if len(t) > 2 else stack([moving[0], last])[: len(t)]

    def _at_marks(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> tuple[Marked, Passed]:
        """Return the result of a run, and its marks: the requested times that it reached, and the breaks."""
        run, count = self.marked(t, y0, c, breaks, moved), len(t)
        requested, (t, _) = t, in_order(t)
        forward = jnp.where(t[-1] >= t[0], 1.0, -1.0)
        last = jnp.max(jnp.where(run.known, jnp.arange(count), 0))
        number = jnp.minimum(jnp.arange(count), last)  # of the time itself, or of the last one that was reached
        times, states = t[number], jnp.where(number[:, None] > 0, run.reached.y[number], y0)
        at, marks = jnp.arange(count), jnp.asarray(count)
        if len(breaks):
            passed = forward * breaks < forward * run.end
            keys = jnp.concatenate([forward * times, jnp.where(passed, forward * breaks, jnp.inf)])
            order = jnp.argsort(keys, stable=True)  # the start stays the first
            times = forward * jnp.where(jnp.isfinite(keys), keys, 0.0)[order]
            states, at = jnp.concatenate([states, run.at_breaks])[order], jnp.argsort(order)[:count]
            marks = count + jnp.sum(passed)
        return run, Passed(times, states, marks.astype(float), at.astype(float), c, requested)

    @property
    def _blocks(self) -> Blocks:
        limits = self.limits
        settings = limits.floor, limits.rtol, limits.atol, limits.max_step, limits.max_steps
        return Blocks(self.pieces.one, self.pieces.one_projections, settings, self.pieces.steps.constants)

    def _in_blocks(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> tuple[Kept, Marked]:
        """Return what is kept of a run, and its result."""
        times, ordered = in_order(t)
        # States at breaks are needed where they may move.
        watched = breaks if self.pieces.moved_by else breaks[:0]
        marks, count = jnp.where(jnp.isfinite(watched), watched, times[0]), len(watched)
        end, kept = with_blocks(self._blocks, with_marks(times, marks), y0, c, breaks)
        at_breaks, own = kept.states_there[1 : 1 + count], slice(1 + count, None if len(t) > 2 else 0)
        if count:
            own_times = kept.at[own], kept.begins[own], kept.sizes[own], kept.states_there[own]
            kept = Kept(kept.states, kept.count, kept.end, *own_times, kept.t0, kept.t1, c, breaks, t)
        forward = jnp.where(times[-1] >= times[0], 1.0, -1.0)
        known = ordered & (forward * (times - end.t) <= 0.0)
        if len(t) <= 2:
            y = jnp.stack([y0, end.y[0]])[: len(t)]
        else:
            rows = self.pieces.steps.constants.rows(c, kept.begins + 0.5 * kept.sizes)
            steps = Steps(kept.begins, kept.sizes, tuple(kept.states_there.T), rows, kept.count > 0.0)
            y = jnp.stack(self.pieces.steps(steps), axis=1)
        behind = jnp.zeros(len(t))
        if count and len(y0):
            behind = moved_behind(self.pieces, times, c, (end.t, breaks, moved), at_breaks, kept.count > 0.0)
        status = jnp.where(ordered, end.status.astype(float), float(Status.TIMES_IN_NO_ORDER))
        reached = Reached(jnp.where(known[:, None], y, jnp.nan), status, end.steps, end.attempts)
        return kept, Marked(reached, known, behind, at_breaks, end.t)


def with_marks(t: Any, marks: Any) -> Any:
    """Return times from the first to the last, with marks in between, in no order; times as they are without marks."""
    return jnp.concatenate([t[:1], marks, t]) if len(marks) else t
