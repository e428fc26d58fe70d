"""Results of traced runs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, final

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import FloatArray
from ..errors import RunFailedError, ValueInputError
from ..methods.status import Status
from .host_calls import on_host
from .runs.mesh_axes import laid_on_mesh, mesh_of, varying_alike
from .runs.run_constants import RunConstants
from .runs.run_data import Path

if TYPE_CHECKING:
    from .pure import Solve

_GOOD = [int(each) for each in Status if each.success]


@final
class Solved(NamedTuple):
    """Result of a traced run; rows after a failure are NaN.

    Attributes
    ----------
    t : Array (n_t,)
        Times, as given.
    y : Array (n_t, n_y)
        States, in the order of ``layout.state``.
    q, qdot : Array (n_t, n_q)
        Coordinates and rates, in the order of ``layout.coordinates``. First-order states are the last columns of y.
    outputs : Array (n_t, n_outputs)
        Requested outputs (reactions, for example), in the order of ``layout.outputs``.
    status : Array ()
        How the run ended, a number of `dalembert.methods.status.Status`; 0 is success. What is given and not finite is
        NON_FINITE, and so is a run whose outputs are not finite somewhere though its states are.
    steps, rejected : Array ()
        Numbers of accepted and of rejected steps; the second is None where `end` is not.
    dense : Dense, HostedDense or None
        The motion at any time between the first and the last, where ``dense=True`` asked for it.
    end : States or None
        Where the run ended, if it was asked to watch for events or to keep reductions, or may change contacts.
    events : dict of str to EventTimes, or None
        Events by name.
    reduced : dict of str to Array (), or None
        Reductions by name, NaN where the run failed.
    """

    t: Any
    y: Any
    q: Any
    qdot: Any
    outputs: Any
    status: Any
    steps: Any
    rejected: Any
    dense: Any = None
    end: Any = None
    events: Any = None
    reduced: Any = None


@final
class EventTimes(NamedTuple):
    """The count () of an event, and its first and last time [s] (), NaN where it did not occur."""

    count: Any
    first: Any
    last: Any


@final
class States(NamedTuple):
    """A motion at times: t, y, q, qdot and outputs as in `Solved`, without a first axis where one time was given."""

    t: Any
    y: Any
    q: Any
    qdot: Any
    outputs: Any


@final
class Dense:
    """``dense(t)`` is the motion at a time () or at times (n_t,) in any order, as `States`.

    A pytree, of which ``jax.vmap`` makes one for each case. States inside steps are ends of shorter steps of the same
    method, as accurate as those at the ends; outside the times that the run reached they are NaN. Everything may be
    traced and differentiated.
    """

    def __init__(
        self, solve: Solve, path: Path, start: Any, p: Any, c: Any, breaks: Any, constants: RunConstants | None
    ) -> None:
        self.constants = constants
        self.solve, self.path, self.start, self.p, self.c, self.breaks = solve, path, start, p, c, breaks

    def __call__(self, t: Any) -> States:
        """Return the motion at times; see the class."""
        return read_at(partial(_states, self.solve, self), t)

    def __repr__(self) -> str:
        return "Dense(t -> motion)"


def read_at(states: Callable[[Any], States], t: Any) -> States:
    """Return the motion at a time () or at times (n_t,), from a function of times (n_t,).

    Raises
    ------
    ValueInputError
        For times of another shape.
    """
    times = jnp.asarray(t, dtype=float)
    if times.ndim > 1:
        raise ValueInputError(f"t must be a time or times (n_t,), not of shape {times.shape}")
    found = states(jnp.atleast_1d(times))
    return jax.tree.map(lambda rows: rows[0], found) if times.ndim == 0 else found


def _children(dense: Dense) -> tuple[Any, Any]:
    return (dense.path, dense.start, dense.p, dense.c, dense.breaks), (dense.solve, dense.constants)


def _whole(fixed: Any, children: Any) -> Dense:
    path, start, p, c, breaks = children
    return Dense(fixed[0], path, start, p, c, breaks, fixed[1])


jax.tree_util.register_pytree_node(Dense, _children, _whole)


@partial(jax.jit, static_argnums=0)
def _states(solve: Solve, dense: Dense, t: Any) -> States:
    """Return the motion at times t (n_t,): compiled once for each number of times."""
    with mesh_of((dense, t)):
        return solve.states(*laid_on_mesh(varying_alike((dense, t))))


def raise_failure(solved: Solved, formulation: str, method: str) -> Solved:
    """Return the result of a run that did not fail; raise an error for one, or one of several, that did.

    Traced runs raise on the host when they are computed: JAX raises an error of its own, with the text of ours.

    Raises
    ------
    RunFailedError
        Where the status is known.
    """
    status = solved.status
    if not isinstance(status, jax.core.Tracer):
        _raise_failed(formulation, method, np.asarray([status], dtype=float))
        return solved
    fails = partial(_raise_failed, formulation, method)
    failed = ~jnp.isin(status, jnp.array(_GOOD))
    one = jax.lax.cond(failed, lambda own: on_host(fails, ((),), own)[0], jnp.ones_like, status.astype(float))
    # Everything is multiplied by one, derivatives too, so that nothing is computed without the check.
    return jax.tree.map(lambda leaf: leaf * one.astype(leaf.dtype), solved)


def _raise_failed(formulation: str, method: str, statuses: FloatArray) -> tuple[FloatArray]:
    """Return ones (k,) for runs with these statuses (k,).

    Raises
    ------
    RunFailedError
        Where one failed.
    """
    failed = np.flatnonzero(~np.isin(statuses, _GOOD))
    if len(failed):
        count, first = len(statuses), Status(int(statuses[failed[0]]))
        who = "the run" if count == 1 else f"{len(failed)} of {count} runs failed: number {failed[0]}"
        raise RunFailedError(
            f"{who} failed with the status {first}: {first.message_for((formulation,), method)} Without throw=True the"
            " result holds this status, and NaN at times that it did not reach"
        )
    return (np.ones(len(statuses)),)
