"""Results of traced runs."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, final

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, RunFailedError, ValueInputError
from ..methods.status import Status
from .host_calls import on_host
from .runs.mesh_axes import explicit_mesh, laid_out
from .runs.run_constants import RunConstants

if TYPE_CHECKING:
    from .hosted import HostedSolve
    from .pure import Solve

    AnySolve: TypeAlias = Solve | HostedSolve

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
    dense : Dense or None
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
    traced and differentiated. Of runs on the host, every call runs once more there, and reads the motion at the times
    as ``solve`` does where they are given to it.

    Parameters
    ----------
    solve : Solve or HostedSolve
        The runs.
    run : pytree
        What `solve` reads the run from.
    constants : RunConstants or None
        Constants of the steps, where they are more than those of the program.
    """

    def __init__(self, solve: AnySolve, run: Any, constants: RunConstants | None = None) -> None:
        self.solve, self.run, self.constants = solve, run, constants

    def __call__(self, t: Any) -> States:
        """Return the motion at times; see the class.

        Raises
        ------
        ValueInputError
            For times of another shape.
        """
        times = jnp.asarray(t, dtype=float)
        if times.ndim > 1:
            raise ValueInputError(f"t must be a time or times (n_t,), not of shape {times.shape}")
        found = _states(self.solve, self, jnp.atleast_1d(times))
        return jax.tree.map(lambda rows: rows[0], found) if times.ndim == 0 else found

    def __repr__(self) -> str:
        return "Dense(t -> motion)"


jax.tree_util.register_pytree_node(
    Dense,
    lambda dense: ((dense.run,), (dense.solve, dense.constants)),
    lambda fixed, children: Dense(fixed[0], children[0], fixed[1]),
)


@partial(jax.jit, static_argnums=0)
def solved_of(solve: AnySolve, t: Any, initial: Any, p: Any, given: Any) -> Solved:
    """Return the motion: compiled once for equal functions, and a part of the program where one is traced."""
    solved: Solved = laid_out(solve.motion, t, initial, p, given)
    return solved


@partial(jax.jit, static_argnums=0)
def _states(solve: AnySolve, dense: Dense, t: Any) -> States:
    """Return the motion at times t (n_t,): compiled once for each number of times."""
    states: States = laid_out(solve.states, dense, t)
    return states


def raise_failure(solved: Solved, formulation: str, method: str) -> Solved:
    """Return the result of a run that did not fail; raise an error for one, or one of several, that did.

    Traced runs raise on the host when they are computed: JAX raises an error of its own, with the text of ours.

    Raises
    ------
    RunFailedError
        Where the status is known.
    OptionError
        On a mesh of explicit axes.
    """
    status = solved.status
    if not isinstance(status, jax.core.Tracer):
        _raise_failed(formulation, method, np.asarray([status], dtype=float))
        return solved
    if explicit_mesh(status) is not None:
        raise OptionError(
            "throw=True raises on one device of a mesh of explicit axes, for which the others would wait: leave it out"
            " and look at the status, or take jax.shard_map, in which each device has runs of its own"
        )
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
