"""Traced runs by an implicit solver of diffrax, whose derivatives are diffrax's."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import diffrax
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from ...errors import OptionError
from ...methods.status import Status
from ...options import SolveOptions
from .derivatives import instantiate
from .run_data import Reached, in_order
from .solvers import Settings, equation, solver_for

if TYPE_CHECKING:
    from .kernels import Kernels

__all__ = ["implicit_motion"]

_CHECKPOINTS = 16
"""States that a reverse run keeps: with diffrax's default, many more, gradients of short runs take longer."""


@jax.custom_jvp
def _following(y: Any, t: Any, rates: Any) -> Any:
    """Return states (n_t, n_y), which change with times (n_t,) by rates (n_t, n_y)."""
    return y


@_following.defjvp
def _(values: Any, tangents: Any) -> tuple[Any, Any]:
    (y, t, rates), (dy, dt, _) = values, tangents
    return y, _once(dy + dt[:, None] * rates, t)


@jax.custom_jvp
def _once(dy: Any, t: Any) -> Any:
    """Return changes of states as they are; that they change with the times is not known."""
    return dy


@partial(_once.defjvp, symbolic_zeros=True)
def _(values: Any, tangents: Any) -> tuple[Any, Any]:
    if not isinstance(tangents[1], SymbolicZero):
        raise OptionError(
            'solve_fn by \'kvaerno5\' has no second derivatives by times: take method="dopri8", "tsit5" or'
            ' "taylor", or differentiate by parameters and initial values alone'
        )
    return values[0], instantiate(tangents[0])


def implicit_motion(kernels: Kernels, t: Any, y0: Any, c: Any, options: SolveOptions) -> Reached:
    """Return the states (n_t, n_y) at the times t, and how the run went; see `dalembert.integrators.jax.motion`."""
    (rtol, atol), mode = options.tolerances, options.mode
    given, (t, ordered) = t, in_order(jax.lax.stop_gradient(t))
    direction = jnp.where(t[-1] >= t[0], 1.0, -1.0)
    settings = Settings(direction, direction * t[0], direction * t[-1], c, rtol, atol, 0.0, options.max_step)
    still = jax.lax.stop_gradient
    fixed = still(settings)
    solver = solver_for(kernels, options.method)
    term, controller = equation(kernels, fixed, solver)
    order = solver.error_order(term)
    start = controller.init(term, fixed.t0, fixed.t1, still(y0), 0.0, fixed, solver.func, order)[1]
    ends = len(t) <= 2  # then nothing is interpolated, which costs as much as a step does
    saved = {"t1": True} if ends else {"ts": direction * t}
    adjoint = diffrax.ForwardMode() if mode == "forward" else diffrax.RecursiveCheckpointAdjoint(_CHECKPOINTS)
    solution = diffrax.diffeqsolve(
        term,
        solver,
        settings.t0,
        settings.t1,
        start.size,
        y0,
        settings,
        saveat=diffrax.SaveAt(**saved, controller_state=True),
        stepsize_controller=controller,
        adjoint=adjoint,
        max_steps=options.max_steps,
        throw=False,
        controller_state=still(start._replace(attempts=jnp.array(options.max_steps))),
    )
    y = jnp.concatenate([y0[None], solution.ys])[: len(t)] if ends else solution.ys
    if kernels.projected:
        y = jax.vmap(lambda at, state: kernels.project(at, state, c))(t, y)
    failed = jnp.where(still(solution.controller_state.finite), int(Status.STEP_TOO_SMALL), int(Status.NON_FINITE))
    results = diffrax.RESULTS
    status = jnp.where(solution.result == results.max_steps_reached, int(Status.MAX_STEPS), failed)
    status = jnp.where(solution.result == results.successful, int(Status.SUCCESS), status)
    numbers = jnp.all(jnp.isfinite(still(y0))) & jnp.all(jnp.isfinite(still(c)))
    status = jnp.where(numbers, status, int(Status.NON_FINITE))
    status = jnp.where(ordered, status, int(Status.TIMES_IN_NO_ORDER))
    known = ordered & jnp.all(jnp.isfinite(y), axis=1)
    if ends:
        known &= (jnp.arange(len(t)) == 0) | (status == int(Status.SUCCESS))
    y = _following(y, given, jax.vmap(kernels["rhs"], (0, 0, None))(t, y, c))
    y = (_lost_pushed if mode == "forward" else _lost_pulled)(y, known, (y0, c, given))
    return Reached(y, status, solution.stats["num_accepted_steps"], solution.stats["num_steps"])


def _lost(y: Any, known: Any, sources: Any) -> Any:
    """Return states (n_t, n_y), NaN where they are not known, and then with derivatives NaN by all `sources`."""
    return jnp.where(known[:, None], y, jnp.nan)


_lost_pushed = jax.custom_jvp(_lost)
_lost_pulled = jax.custom_vjp(_lost)


@_lost_pushed.defjvp
def _(values: Any, tangents: Any) -> tuple[Any, Any]:
    return _lost(*values), _lost(tangents[0], *values[1:])


def _keeping(*values: Any) -> tuple[Any, Any]:
    return _lost(*values), values[1:]


def _pulled(kept: Any, given: Any) -> tuple[Any, None, Any]:
    known, sources = kept
    failed = jnp.any(~known[:, None] & (given != 0.0))
    lost = jax.tree.map(lambda source: jnp.where(failed, jnp.nan, jnp.zeros_like(source)), sources)
    return jnp.where(known[:, None], given, 0.0), None, lost


_lost_pulled.defvjp(_keeping, _pulled)
