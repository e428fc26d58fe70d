"""Steps of diffrax: its own PI controller, which here also ends hopeless and over-long runs, and projection."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, final

import diffrax
import jax.numpy as jnp
from jax import lax

from .precision import precision_of
from .step_rules import smallest_step


def projecting(solver: Any, project: Callable[[Any, Any, Any, Any], Any]) -> Any:
    """Return `solver` with ``project(t, y, before, args)`` applied to the end of every step.

    The error is judged before. A projection that fails gives NaN, and the step is rejected. The slope at the end of a
    step is evaluated anew at the start of the next, because the state has moved in between.
    """
    base = type(solver)

    def step(
        self: Any, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: Any, made_jump: Any
    ) -> tuple[Any, Any, Any, Any, Any]:
        end, error, dense, state, result = base.step(
            self, terms, t0, t1, y0, args, solver_state, jnp.ones_like(made_jump, dtype=bool)
        )
        end = project(t1, end, y0, args)
        return end, error, {**dense, "y1": end}, state, result

    given = {field.name: getattr(solver, field.name) for field in dataclasses.fields(base) if field.init}
    return type(f"Projected{base.__name__}", (base,), {"step": step})(**given)


# K. Gustafsson, ACM Transactions on Mathematical Software 17 (1991) 533-554, as the compiled loops have them: the
# factor of the next step is error**(-0.85/order) * previous_error**(0.2/order).
_PROPORTIONAL = 0.2
_INTEGRAL = 0.65


@final
class Control(NamedTuple):
    """Memory of the controller from step to step.

    Attributes
    ----------
    memory
        State of diffrax's controller.
    size
        Size of the next step.
    attempts
        Attempts that are left.
    finite
        Whether the last attempt gave finite numbers.
    proposed
        Size of the next step but for knots of tables, which may cut it.
    """

    memory: Any
    size: Any
    attempts: Any
    finite: Any
    proposed: Any


@final
class StepController(diffrax.AbstractAdaptiveStepSizeController):
    """diffrax's PI controller, with three more reasons to reject or to stop.

    A step that leaves the finite numbers is rejected; a step that is rejected although it cannot be made smaller
    ends the run with ``RESULTS.dt_min_reached``; a run whose attempts are used up ends with
    ``RESULTS.max_steps_reached``. Derivatives are those at fixed step sizes.
    The bounds are traced, so that other bounds compile nothing.

    Parameters
    ----------
    rtol, atol
        Tolerances.
    max_step
        Largest step size.
    span
        Length of the time span.
    limit
        (t, y, args) -> the largest size of a step from there that knots of tables allow; None where there are none.
    """

    rtol: Any
    atol: Any
    max_step: Any
    span: Any
    norm: Callable[[Any], Any]
    inner: Any
    limit: Callable[..., Any] | None

    def __init__(self, rtol: Any, atol: Any, max_step: Any, span: Any, limit: Callable[..., Any] | None = None) -> None:
        self.limit = limit
        self.rtol = rtol
        self.atol = jnp.maximum(atol, precision_of(atol).smallest_scale)
        self.max_step = max_step
        self.span = span
        self.inner = diffrax.PIDController(
            rtol=self.rtol, atol=self.atol, pcoeff=_PROPORTIONAL, icoeff=_INTEGRAL, dtmax=max_step
        )
        self.norm = self.inner.norm

    def wrap(self, direction: Any) -> StepController:
        """See diffrax; nothing here depends on the direction of time."""
        return self

    def init(
        self, terms: Any, t0: Any, t1: Any, y0: Any, dt0: Any, args: Any, func: Any, error_order: Any
    ) -> tuple[Any, Control]:
        """See diffrax; a `dt0` of 0 has the first step chosen. The number of attempts is for the caller to set."""
        chosen, memory = self.inner.init(terms, t0, t1, y0, None, args, func, error_order)
        size = jnp.where(dt0 > 0.0, dt0, chosen - t0)
        size = jnp.where(jnp.isfinite(size), size, 1e-6 * self.span)
        size = jnp.clip(size, smallest_step(t0, self.span), jnp.minimum(self.span, self.max_step))
        cut = size if self.limit is None else jnp.minimum(size, self.limit(t0, y0, args))
        return t0 + cut, Control(memory, cut, jnp.array(0), jnp.array(True), size)

    def adapt_step_size(
        self,
        t0: Any,
        t1: Any,
        y0: Any,
        y1_candidate: Any,
        args: Any,
        y_error: Any,
        error_order: Any,
        controller_state: Control,
    ) -> tuple[Any, Any, Any, Any, Control, Any]:
        """See diffrax."""
        y0, y1_candidate, y_error, args = lax.stop_gradient((y0, y1_candidate, y_error, args))
        finite = jnp.all(jnp.isfinite(y1_candidate)) & jnp.all(jnp.isfinite(y_error))
        candidate, error = jnp.where(finite, y1_candidate, y0), jnp.where(finite, y_error, jnp.inf)
        kept, begin, end, jump, memory, result = self.inner.adapt_step_size(
            t0, t1, y0, candidate, args, error, error_order, controller_state.memory
        )
        smallest = smallest_step(begin, self.span)
        hopeless = ~kept & (end - begin < smallest)
        size = proposed = jnp.maximum(end - begin, smallest)
        if self.limit is not None:
            before = controller_state.proposed  # goes on after a step that a knot has cut
            proposed = jnp.maximum(size, jnp.where(controller_state.size < before, before, 0.0))
            size = jnp.where(kept, proposed, size)
            size = jnp.minimum(size, self.limit(begin, jnp.where(kept, candidate, y0), args))
        attempts = controller_state.attempts - 1
        results = diffrax.RESULTS
        result = results.where(attempts <= 0, results.max_steps_reached, result)
        result = results.where(hopeless, results.dt_min_reached, result)
        return kept, begin, begin + size, jump, Control(memory, size, attempts, finite, proposed), result
