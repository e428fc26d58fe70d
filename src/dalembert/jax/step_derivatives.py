"""Steps of given sizes and their derivatives, of explicit pairs, of Taylor series and of implicit pairs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np

from ..methods.tableau import Tableau
from .runs.adjoint import InTurn
from .runs.derivatives import Steps, jacobians
from .runs.pairs import implicit_slopes, slopes_of, weighted
from .runs.precision import contracted, product
from .runs.run_constants import Function, RunConstants
from .runs.step_rules import Projections, Rows, project


def _settled(projections: Projections, steps: Steps, ends: Rows) -> Rows:
    """Return the ends of steps on the constraints."""
    return project(projections, steps.t + steps.h, ends, steps.c)[0]


def _again(projections: Projections, steps: Steps, ends: Rows) -> Rows:
    """Return the ends of steps on the constraints, made so that JAX finds the derivatives of `_correction` there."""
    if not projections:
        return ends
    still = jax.lax.stop_gradient
    fixed = steps._replace(t=still(steps.t), h=still(steps.h), y=still(steps.y), c=still(steps.c))
    held = _settled(projections, fixed, still(ends))
    at = tuple(on + (end - still(end)) for on, end in zip(held, ends, strict=True))
    return _correction(projections, steps, at, steps.c)


def _correction(projections: Projections, steps: Steps, at: Rows, c: Rows) -> Rows:
    """Return states, on the constraints already, after one correction of each kind.

    To first order that is what all of them do: the derivative of a Newton iteration that has converged is that of one
    more, as its derivative there is a projection.
    """
    for correct, _ in projections:
        at = tuple(a + b for a, b in zip(at, correct(steps.t + steps.h, at, c), strict=True))
    return at


def series_ends(series: Function, order: int, steps: Steps, y: Rows, c: Rows) -> Rows:
    """Return the ends of steps of a Taylor series, from (t, y, c) -> coefficients of each component in turn."""
    values, each = series(steps.t, y, c), order + 1
    new = []
    for i, row in enumerate(y):
        total = jnp.zeros(jnp.shape(row))
        for value in reversed(values[i * each + 1 : (i + 1) * each]):
            total = steps.h * (value + total)
        new.append(row + total)
    return tuple(new)


def implicit_ends(rhs: Callable[..., Rows], tableau: Tableau, steps: Steps, y: Rows, c: Rows) -> Rows:
    """Return the ends of steps of an implicit pair."""
    slopes = implicit_slopes(partial(slopes_of, rhs), tableau, (steps.t, y), steps.h, c)
    weights = tableau.b[: tableau.end + 1]
    return tuple(a + steps.h * contracted(weights, k) for a, k in zip(y, slopes, strict=True))


@final
class PairSteps:
    """Steps of an explicit pair and their derivatives, by the derivatives of the right-hand side at the stages.

    Parameters
    ----------
    rhs
        (t, y, c) -> rates, on rows.
    tableau
        The pair.
    projections
        What moves the end of a step.
    in_turn
        What pulls a run of one case back one stage after the other, where that is faster and possible.
    constants
        See `Stepping`.
    """

    def __init__(
        self,
        rhs: Callable[..., Rows],
        tableau: Tableau,
        projections: Projections,
        in_turn: InTurn | None,
        constants: RunConstants,
    ) -> None:
        self.in_turn, self.constants = in_turn, constants
        count = tableau.end
        self._rhs, self._tableau, self._projections, self._count = rhs, tableau, projections, count
        self._matrix, self._weights = tableau.A[:count, :count], tableau.b[:count]

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, on the constraints."""
        return _settled(self._projections, steps, self._stages(steps)[1])

    def moved(self, steps: Steps) -> Rows:
        """See `Stepping`."""
        return _again(self._projections, steps, self._stages(steps)[1])

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps."""
        return slopes_of(self._rhs, steps.t, steps.y, steps.c)

    def _stages(self, steps: Steps) -> tuple[Rows, Rows]:
        """Return the slopes (stages, k) and the ends of steps before they are projected."""
        t, h, y, c = steps
        slopes = weighted(self._rhs, self._tableau, self._count, (t, y), h, c, ())
        return slopes, tuple(a + h * contracted(self._weights, k) for a, k in zip(y, slopes, strict=True))

    def along(self, steps: Steps) -> tuple[Any, Any]:
        """See `Stepping`: h, derivatives (stages, n_y, n_y) of the slopes, and (n_y, n_y) of the projection."""
        t, h, y, c = steps
        slopes, ends = self._stages(steps)
        points = tuple(a + h * contracted(self._matrix, k) for a, k in zip(y, slopes, strict=True))
        times = t + self._tableau.c[: self._count, np.newaxis] * h
        matrices = jnp.moveaxis(jacobians(lambda at: slopes_of(self._rhs, times, at, c), points), 1, 0)
        if not self._projections:
            return (h, matrices), (times, points, ends)
        ends = _settled(self._projections, steps, ends)
        held = jacobians(lambda at: _correction(self._projections, steps, at, c), ends)
        return (h, matrices, held), (times, points, ends)

    def shifts(self, steps: Steps, places: Any, dc: Rows) -> Any:
        """See `Stepping`: changes (stages, n_y) of the slopes, and (n_y,) of the projection."""
        times, points, ends = places
        rates = jax.jvp(lambda *c: slopes_of(self._rhs, times, points, c), steps.c, dc)[1]
        shift = jnp.stack([rate.T for rate in rates], axis=-1)
        if not self._projections:
            return (shift,)
        moves = jax.jvp(lambda *c: _correction(self._projections, steps, ends, c), steps.c, dc)[1]
        return shift, jnp.stack(moves, axis=-1)

    def push(self, along: Any, shift: Any, dy: Any) -> Any:
        """See `Stepping`."""
        h, matrices, *held = along
        slopes: list[Any] = []
        for i, row in enumerate(self._matrix.tolist()):  # numbers of no precision of their own
            point = sum((h * a * k for a, k in zip(row, slopes, strict=False) if a), start=dy)
            slopes.append(product(matrices[i], point) + shift[0][i])
        end = sum((h * b * k for b, k in zip(self._weights.tolist(), slopes, strict=True) if b), start=dy)
        return product(held[0], end) + shift[1] if held else end

    def pull(self, along: Any, ahead: Any) -> tuple[Any, Any]:
        """See `Stepping`: cotangents (stages, n_y) of the slopes, and (n_y,) of the end."""
        h, matrices, *held = along
        end = product(ahead, held[0]) if held else ahead
        before, matrix, weights = end, self._matrix.tolist(), self._weights.tolist()
        points: list[Any] = [None] * self._count
        slopes: list[Any] = [None] * self._count
        for i in reversed(range(self._count)):
            later = (h * matrix[j][i] * points[j] for j in range(i + 1, self._count) if matrix[j][i])
            slopes[i] = sum(later, start=h * weights[i] * end)
            points[i] = product(slopes[i], matrices[i])
            before = before + points[i]
        return before, (jnp.stack(slopes), ahead)

    def share(self, steps: Steps, places: Any, within: Any) -> Rows:
        """See `Stepping`."""
        (times, points, ends), (slopes, ahead) = places, within
        rates = tuple(slopes[..., i].T for i in range(len(points)))
        found: Rows = jax.vjp(lambda *c: slopes_of(self._rhs, times, points, c), *steps.c)[1](rates)
        if self._projections:
            moved = jax.vjp(lambda *c: _correction(self._projections, steps, ends, c), *steps.c)[1](tuple(ahead.T))
            found = tuple(a + b for a, b in zip(found, moved, strict=True))
        return found


@final
class WholeSteps:
    """Steps and their derivatives, each step as a whole: those of a Taylor series, and of implicit pairs.

    Parameters
    ----------
    rhs
        (t, y, c) -> rates, on rows.
    ends
        (`Steps`, y, c) -> the ends of the steps from other states and constants, before they are projected.
    projections
        What moves the end of a step.
    constants
        See `Stepping`.
    """

    def __init__(
        self,
        rhs: Callable[..., Rows],
        ends: Callable[[Steps, Rows, Rows], Rows],
        projections: Projections,
        constants: RunConstants,
    ) -> None:
        self.in_turn, self.constants = None, constants
        self._rhs, self._ends, self._projections = rhs, ends, projections

    def __call__(self, steps: Steps) -> Rows:
        """Return the states at the ends of steps, on the constraints."""
        return _settled(self._projections, steps, self._ends(steps, steps.y, steps.c))

    def moved(self, steps: Steps) -> Rows:
        """See `Stepping`."""
        return _again(self._projections, steps, self._ends(steps, steps.y, steps.c))

    def rates(self, steps: Steps) -> Rows:
        """Return the rates of the states at the starts of steps."""
        return slopes_of(self._rhs, steps.t, steps.y, steps.c)

    def along(self, steps: Steps) -> tuple[Any, Any]:
        """See `Stepping`: derivatives (n_y, n_y) of the step, and (n_y, n_y) of the projection."""
        step = jacobians(lambda at: self._ends(steps, at, steps.c), steps.y)
        if not self._projections:
            return (step,), None
        ends = _settled(self._projections, steps, self._ends(steps, steps.y, steps.c))
        held = jacobians(lambda at: _correction(self._projections, steps, at, steps.c), ends)
        return (step, held), ends

    def shifts(self, steps: Steps, places: Any, dc: Rows) -> Any:
        """See `Stepping`: changes (n_y,) of the end, and of the projection."""
        step = jnp.stack(jax.jvp(lambda *c: self._ends(steps, steps.y, c), steps.c, dc)[1], axis=-1)
        if places is None:
            return (step,)
        moves = jax.jvp(lambda *c: _correction(self._projections, steps, places, c), steps.c, dc)[1]
        return step, jnp.stack(moves, axis=-1)

    def push(self, along: Any, shift: Any, dy: Any) -> Any:
        """See `Stepping`."""
        end = product(along[0], dy) + shift[0]
        return product(along[1], end) + shift[1] if along[1:] else end

    def pull(self, along: Any, ahead: Any) -> tuple[Any, Any]:
        """See `Stepping`: the cotangents of the end, before it is projected and after."""
        end = product(ahead, along[1]) if along[1:] else ahead
        return product(end, along[0]), (end, ahead)

    def share(self, steps: Steps, places: Any, within: Any) -> Rows:
        """See `Stepping`."""
        end, ahead = within
        found: Rows = jax.vjp(lambda *c: self._ends(steps, steps.y, c), *steps.c)[1](tuple(end.T))
        if places is not None:
            moved = jax.vjp(lambda *c: _correction(self._projections, steps, places, c), *steps.c)[1](tuple(ahead.T))
            found = tuple(a + b for a, b in zip(found, moved, strict=True))
        return found
