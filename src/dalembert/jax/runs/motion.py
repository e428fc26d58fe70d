"""A traced run whose derivatives are taken over its steps at once, and its start.

The run itself is a plain loop, which takes down where each attempt began and how far it went. Derivatives are those of
the accepted steps at these sizes (see `dalembert.jax.runs.derivatives`). States at requested times are ends of
shorter steps of the same method, from the beginning of the step that passes over them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, final

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from ...once import once_property
from .along import Along, Course
from .derivatives import CHUNK, Over, Steps, StepsRecord, instantiate
from .jumping import At, Timed, moved_until, sure_until
from .linear_maps import apply
from .mesh_axes import stack
from .run_data import Limits, Reached, RunPieces, places
from .runs import Runs
from .step_rules import Rows
from .unknown import Known, OrNan


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def started(rates: Callable[[Any, Any, Any], Any], y: Any, t: Any, c: Any) -> Any:
    """Return the state (n_y,) at time 0 of a run from the state y (n_y,) at the time t, which is 0, too.

    It changes with t as a motion with ``rates(t, y, c)`` does, in derivatives up to the fourth.
    """
    # In a batch whose cases differ in t or c alone JAX takes the value for one of all cases, and the change for one of
    # each, which it does not bring together.
    return jnp.where(True, y, t + jnp.sum(c))


@partial(started.defjvp, symbolic_zeros=True)
def _(rates: Callable[[Any, Any, Any], Any], values: Any, tangents: Any) -> tuple[Any, Any]:
    def reached(y: Any, t: Any, c: Any) -> Any:
        # A step of the classical method, of which derivatives up to the fourth by its size are those of the motion.
        h = -t
        k1 = rates(t, y, c)
        k2 = rates(0.5 * t, y + 0.5 * h * k1, c)
        k3 = rates(0.5 * t, y + 0.5 * h * k2, c)
        k4 = rates(0.0, y + h * k3, c)
        return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    value = started(rates, *values)
    if isinstance(tangents[1], SymbolicZero):
        return value, instantiate(tangents[0])
    return value, jax.jvp(reached, values, tuple(instantiate(tangent) for tangent in tangents))[1]


@final
class _Full(NamedTuple):
    """A run in floating point numbers: states (n_t, n_y) and record, steps over more than two times, as in `Known`."""

    y: Any
    record: StepsRecord
    over: Over
    known: Any
    moved: Any


@final
class TracedMotion:
    """Runs of one method for one program, as functions that JAX differentiates and vectorises.

    Parameters
    ----------
    pieces : Pieces
        The method.
    limits : Limits
        How the steps are chosen.
    """

    def __init__(self, pieces: RunPieces, limits: Limits) -> None:
        self._pieces = pieces
        self._runs = Runs(pieces, limits)
        self._room = -(-limits.max_steps // CHUNK) * CHUNK

    def __call__(self, t: Any, y0: Any, c: Any, breaks: Any = (), moved: Any = ()) -> Reached:
        """Return the states (n_t, n_y) at the sorted times t (n_t,), from y0 (n_y,) at t[0] = 0, and how the run went.

        States that were not reached are NaN, and so are all derivatives of what is computed from them. Steps end at
        `breaks` (n,), in the order of the run, infinite behind the last, which are `moved` (n,) by constants or not.
        """
        given = t, y0, c, jnp.asarray(breaks, dtype=float), jnp.asarray(moved, dtype=float)
        return _counted(self._passing(*given))

    def recorded(self, t: Any, y0: Any, c: Any, breaks: Any = (), moved: Any = ()) -> tuple[Reached, StepsRecord]:
        """Return the result of a call, and the record of the run, whose states are differentiated, too.

        Behind jumps of the rates that depend on the state, or on parameters in time, their derivatives miss a term:
        see `jumps`.
        """
        full = self._full(t, y0, c, jnp.asarray(breaks, dtype=float), jnp.asarray(moved, dtype=float))
        return _counted(_reached(full.y, full.record)), full.record

    @property
    def jumps(self) -> bool:
        """Whether derivatives along a record may miss what a jump of the rates adds."""
        return self._pieces.decided is not None or bool(self._pieces.moved_by)

    def states(self, record: StepsRecord, t: Any, c: Any) -> Any:
        """Return the states (n_t, n_y) at times t (n_t,) since the start of a run, NaN where it did not reach them.

        They are ends of shorter steps of the same method, and change with the times as those with their sizes do.
        """
        still = jax.lax.stop_gradient
        forward, taken = jnp.where(record.reached >= 0.0, 1.0, -1.0), record.taken
        inside = jnp.arange(len(taken)) < record.count
        starts = jnp.where(inside, forward * taken[:, 0], jnp.inf)
        at = jnp.maximum(places(starts, forward * t) - 1, 0)
        known = (forward * t >= 0.0) & (forward * t <= forward * record.reached) & (record.count > 0.0)
        known |= (t == 0.0) & (record.reached == 0.0)
        begins = jnp.where(known, still(taken[at, 0]), 0.0)
        size = jnp.where(known, t - begins, 0.0)
        y = jnp.where((known & (record.count > 0.0))[:, None], taken[at, 2:], record.end)
        rows = self._pieces.steps.constants.rows(c, begins + 0.5 * still(size))
        ends = self._pieces.steps.moved(Steps(begins, size, tuple(y.T), rows))
        zeros = jnp.zeros(len(t))
        moving = stack(ends, axis=1), (t, record.end, c)
        return apply(OrNan(()), Known(known.astype(float), zeros, still(c)), moving)

    def _plain(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> Any:
        """Return the result of the run, in floating point numbers."""
        return _reached(*self._runs.run(0, t, y0, c, breaks)[:2])

    # -- its derivatives ------------------------------------------------------------------

    @once_property
    def _passing(self) -> Callable[..., Reached]:
        """The function (t, y0, c, breaks, moved) -> how the run went, in floating point numbers."""

        def push(values: Any, tangents: Any) -> Any:
            full = self._full(*values)
            dy, reached = self._changes(full, values, tangents, kept=False)[0], _reached(full.y, full.record)
            return reached, Reached(dy, *(jnp.zeros_like(number) for number in reached[1:]))

        passing = jax.custom_jvp(self._plain)
        passing.defjvp(push, symbolic_zeros=True)
        return passing

    @once_property
    def _full(self) -> Callable[..., _Full]:
        """The function (t, y0, c, breaks, moved) -> a run with its record, differentiated as such."""

        def push(values: Any, tangents: Any) -> Any:
            full = self._full(*values)
            dy, end, rows = self._changes(full, values, tangents, kept=True)
            still = jax.tree.map(jnp.zeros_like, full)
            taken = jnp.concatenate([still.record.taken[:, :2], rows], axis=1)
            return full, still._replace(y=dy, record=still.record._replace(taken=taken, end=end))

        full = jax.custom_jvp(self._recorded)
        full.defjvp(push, symbolic_zeros=True)
        return full

    def _changes(self, full: _Full, values: Any, tangents: Any, *, kept: bool) -> tuple[Any, ...]:
        """Return the changes of the states (n_t, n_y), of the last one, and where `kept` of those in the record."""
        (t, _, c, breaks, _), (dt, dy, dc) = values, tangents[:3]
        dy, dc = instantiate(dy), instantiate(dc)
        timed = len(t) > 2
        course = Course(full.record._replace(reached=(), status=(), steps=(), attempts=()), full.over, c)
        end, over, *rows = apply(Along(self._pieces.steps, kept), course, (dy, dc))
        changes = over if timed else stack([dy, end])[: len(t)]
        changes = apply(Timed(self._runs.rates), At(t, full.y, c, breaks), (changes, dc))
        if not isinstance(dt, SymbolicZero):
            changes = changes + dt[:, None] * self._runs.rates(t, full.y, c, breaks)
        known = Known(full.known, full.moved, c)
        sources = instantiate(dt), dy, dc
        return apply(OrNan(self._pieces.moved_by), known, (changes, sources)), end, *rows

    def _recorded(self, t: Any, y0: Any, c: Any, breaks: Any, moved: Any) -> _Full:
        """Return a run with its record; what lies behind a jump is not known to those who differentiate."""
        y, record, known, over = self._runs.run(self._room, t, y0, c, breaks)
        decided, moved_by = self._pieces.decided, self._pieces.moved_by
        behind = jnp.zeros(len(t))

        direction, constants = jnp.where(t[-1] >= t[0], 1.0, -1.0), self._pieces.steps.constants

        def rates(t: Any, y: Rows, c: Rows) -> Rows:
            return self._pieces.steps.rates(Steps(t, jnp.zeros_like(t), y, c))

        if decided is not None and len(y0):
            until = sure_until(decided, rates, constants, record, c, direction)
            known &= direction * (t - until) <= 0.0
        if moved_by and len(y0):
            starts = jnp.where(jnp.arange(len(record.taken)) < record.count, direction * record.t, jnp.inf)
            at = jnp.minimum(jnp.searchsorted(starts, direction * breaks), len(starts) - 1)
            course = t[-1], record.reached, breaks, moved > 0.0
            behind = direction * (t - moved_until(rates, constants, record.y[at], c, direction, course)) > 0.0
        record = record._replace(count=record.count.astype(float))
        return _Full(y, record, over, known.astype(float), behind.astype(float))


def _reached(y: Any, record: StepsRecord) -> Reached:
    """Return states and how a run went."""
    return Reached(y, record.status, record.steps, record.attempts)


def _counted(reached: Reached) -> Reached:
    """Return how a run went in whole numbers."""
    return Reached(reached.y, *(number.astype(int) for number in reached[1:]))
