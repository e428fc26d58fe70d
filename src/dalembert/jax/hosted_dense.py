"""Motions at any time of runs on the host."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, final

import jax
import jax.numpy as jnp

from .run_inputs import Given
from .runs.unknown import without_derivative
from .solved import States, read_at

if TYPE_CHECKING:
    from .hosted import HostedSolve


@final
class HostedDense:
    """``dense(t)`` is the motion at a time () or at times (n_t,) in any order, as `States`.

    A pytree, of which ``jax.vmap`` makes one for each case. Every call runs once more on the host, and reads the motion
    at the times, as ``solve`` does where they are given to it; outside the times that the run reached it is NaN.
    Derivatives are those of the rows of ``solve``.

    Parameters
    ----------
    solve : HostedSolve
        The runs.
    span : tuple
        Start, last requested time, and where the run ended.
    given : tuple
        Initial values, parameters, and inputs that are functions of time.
    """

    def __init__(self, solve: HostedSolve, span: tuple[Any, Any, Any], given: tuple[Any, Any, Given]) -> None:
        self.solve, self.span, self.given = solve, span, given

    def __call__(self, t: Any) -> States:
        """Return the motion at times; see the class."""
        return read_at(partial(_states, self.solve, self), t)

    def __repr__(self) -> str:
        return "HostedDense(t -> motion)"

    def at(self, t: Any) -> States:
        """Return the motion at times (n_t,)."""
        start, last, end = self.span
        forward = jnp.where(last >= start, 1.0, -1.0)
        inside = (forward * (t - start) >= 0.0) & (forward * (end - t) >= 0.0)
        requested = jnp.where(inside, t, start)
        order = jnp.argsort(forward * jax.lax.stop_gradient(requested), stable=True)
        every = jnp.concatenate([start[None], requested[order], last[None]])
        found = self.solve.solved(every, *self.given)
        back = jnp.argsort(order)
        # In single precision, the time of the end is rounded, and the run may end before.
        last_one = (t == end)[:, None]
        sources = start, t, self.given
        rows = []
        for part, ended in zip(found[1:5], found.end[1:], strict=True):
            row = part[1:-1][back]
            lost = last_one & ~jnp.isfinite(row)
            ended = without_derivative(jnp.broadcast_to(jax.lax.stop_gradient(ended), row.shape), ~lost, sources)
            rows.append(jnp.where(lost, ended, jnp.where(inside[:, None], row, jnp.nan)))
        return States(t, *rows)


def _children(dense: HostedDense) -> tuple[Any, Any]:
    return (dense.span, dense.given), dense.solve


jax.tree_util.register_pytree_node(HostedDense, _children, lambda solve, children: HostedDense(solve, *children))


@partial(jax.jit, static_argnums=0)
def _states(solve: HostedSolve, dense: HostedDense, t: Any) -> States:
    """Return the motion at times t (n_t,): compiled once for each number of times."""
    return dense.at(t)
