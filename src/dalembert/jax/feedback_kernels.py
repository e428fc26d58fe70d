"""Kernels that are given inputs as functions of time and state: evaluated first, at the time and state at hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import jax
import jax.numpy as jnp

from .runs.kernels import Function, OnArrays
from .runs.mesh_axes import stack
from .runs.projection import Rows


@final
@dataclass(frozen=True, eq=False)
class FeedbackKernels:
    """The inputs of a run that are functions, put among the constants that kernels take.

    Constants come with the weights of all functions behind them (see `dalembert.jax.runs.run_constants`).

    Attributes
    ----------
    functions : tuple of callable
        (t, q, qdot, weights) -> the value of each input, weights those of all.
    places : tuple of int
        Numbers of the constants that are these values.
    start : int
        Number of the constant which is the start of the run.
    n : int
        How many coordinates there are.
    expand : callable
        (t, y, c) -> coordinates and rates, on rows.
    expand_one : callable
        The same on arrays.
    """

    functions: tuple[Callable[..., Any], ...]
    places: tuple[int, ...]
    start: int
    n: int
    expand: Function
    expand_one: OnArrays

    def on_rows(self, kernel: Function) -> Function:
        """Return a kernel on rows that takes weights behind its constants."""
        return lambda t, y, c: kernel(t, y, self._rows(t, y, c))

    def on_one_row(self, kernel: Function) -> Function:
        """Return a kernel on one row that takes weights as a second row of constants."""

        def run(t: Any, y: Rows, c: Rows) -> Rows:
            given, weights = c
            x = self.expand_one(t, y[0], given)
            values = self.values(given[self.start] + t, x[: self.n], x[self.n : 2 * self.n], weights)
            return kernel(t, y, (given.at[jnp.array(self.places)].set(values),))

        return run

    def values(self, t: Any, q: Any, qdot: Any, weights: Any) -> Any:
        """Return the values of the inputs (n_functions,) at one time."""
        return stack([function(t, q, qdot, weights) for function in self.functions])

    def at_times(self, t: Any, q: Any, qdot: Any, rows: Any, weights: Any) -> Any:
        """Return constants of kernels (n_t, n) with the values at times t (n_t,), q and qdot (n_t, n_q)."""
        values = jax.vmap(self.values, (0, 0, 0, None))(t, q, qdot, weights)
        rows = jnp.broadcast_to(rows, (len(t), rows.shape[-1]))
        return rows.at[:, jnp.array(self.places)].set(values)

    def _rows(self, t: Any, y: Rows, c: Rows) -> Rows:
        *given, weights = c
        x = self.expand(t, y, given)[: 2 * self.n]
        time = given[self.start] + t
        shape = jnp.broadcast_shapes(jnp.shape(time), *map(jnp.shape, x))
        flat = [jnp.ravel(jnp.broadcast_to(row, shape)) for row in (time, *x)]
        q, qdot = stack(flat[1 : self.n + 1], axis=-1), stack(flat[self.n + 1 :], axis=-1)
        of_cases = 0 if jnp.ndim(weights) == 2 else None
        values = jax.vmap(self.values, (0, 0, 0, of_cases))(flat[0], q, qdot, weights)
        for i, place in enumerate(self.places):
            given[place] = jnp.reshape(values[:, i], shape)
        return tuple(given)
