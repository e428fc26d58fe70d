"""Solvers of diffrax whose steps end with a projection onto the constraints."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp


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
