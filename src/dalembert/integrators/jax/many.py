"""Many cases by a solver of diffrax: its loop, vectorised over the cases."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import diffrax
import jax
import jax.numpy as jnp

from ...methods.status import Status
from .solvers import Settings, equation, solver_for

if TYPE_CHECKING:
    from .kernels import Kernels

__all__ = ["diffrax_batch"]


def diffrax_batch(kernels: Kernels, method: str) -> Callable[..., Any]:
    """Return the compiled function (settings, y0, t_eval, max_steps) -> (y, samples, ends) on a batch of cases.

    `Settings` whose arrays have a leading axis of cases but for the tolerances and the largest step, y0 (k, n_y),
    t_eval (n_t,) in the problem's own time; states y (k, n_y) at the ends, samples (k, n_t, n_y), and ends (k, 3):
    time, status and steps.
    """
    axes = Settings(0, 0, 0, 0, None, None, None, None)
    one = partial(_one, kernels, solver_for(kernels, method))
    return jax.jit(jax.vmap(one, (axes, 0, None, None)))


def _one(kernels: Kernels, solver: Any, settings: Settings, y0: Any, t_eval: Any, max_steps: Any) -> Any:
    term, controller = equation(kernels, settings, solver)
    order = solver.error_order(term)
    _, control = controller.init(term, settings.t0, settings.t1, y0, settings.first_step, settings, solver.func, order)
    n_times = len(t_eval)
    samples = {"samples": diffrax.SubSaveAt(ts=settings.direction * t_eval)} if n_times else {}
    solution = diffrax.diffeqsolve(
        term,
        solver,
        settings.t0,
        settings.t1,
        control.size,
        y0,
        settings,
        saveat=diffrax.SaveAt(subs={"end": diffrax.SubSaveAt(t1=True), **samples}, controller_state=True),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode(),
        max_steps=None,
        throw=False,
        controller_state=control._replace(attempts=max_steps),
    )
    results = diffrax.RESULTS
    broken = ~jnp.all(jnp.isfinite(y0)) | ~jnp.all(jnp.isfinite(term.vf(settings.t0, y0, settings)))
    hopeless = jnp.where(
        solution.controller_state.finite, int(Status.STEP_TOO_SMALL), _failure(kernels, settings, solution)
    )
    status = jnp.where(solution.result == results.successful, int(Status.SUCCESS), hopeless)
    status = jnp.where(solution.result == results.max_steps_reached, int(Status.MAX_STEPS), status)
    status = jnp.where(broken, int(Status.NON_FINITE), status)
    steps = solution.stats["num_accepted_steps"].astype(float)
    end = solution.ys["end"][-1]
    ends = jnp.stack([settings.direction * solution.ts["end"][-1], status.astype(float), steps])
    values = jnp.zeros((0, len(y0)))
    if n_times:
        values = jax.vmap(partial(_on_constraints, kernels, settings))(t_eval, solution.ys["samples"])
        values = jnp.where(jnp.isfinite(values), values, jnp.nan)
    return end, values, ends


def _on_constraints(kernels: Kernels, settings: Settings, t: Any, y: Any) -> Any:
    return kernels.project(t, y, settings.constants)


def _failure(kernels: Kernels, settings: Settings, solution: Any) -> Any:
    """Return the status of a run that met NaN: where the right-hand side is finite, the projection is what failed."""
    if not kernels.projected:
        return int(Status.NON_FINITE)
    t, y = settings.direction * solution.ts["end"][-1], solution.ys["end"][-1]
    finite = jnp.all(jnp.isfinite(kernels["rhs"](t, y, settings.constants)))
    return jnp.where(finite, int(Status.PROJECTION_FAILED), int(Status.NON_FINITE))
