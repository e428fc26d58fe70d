"""Times at which conditions on time change, in traced programs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...integrators.breakpoints import break_times_of_cases
from ...ir.conditions import Conditions

__all__ = ["traced_breaks"]


def traced_breaks(conditions: Conditions, p: Any, t: Any, most: int) -> tuple[Any, Any]:
    """Return the breaks (most,) of a run along times t (n_t,) of parameters p (n_p,), and which move with parameters.

    Breaks are times since t[0] in the order of the run, infinite behind the last. More than a run may take steps are
    left out, as it ends before. Derivatives do not pass.
    """
    shape: Any = jax.eval_shape(lambda: jnp.zeros((most, 2), jnp.uint32))
    given = (_halves(jax.lax.stop_gradient(value)) for value in (p, t[0], t[-1]))
    found = jax.pure_callback(partial(_breaks, conditions, most), (shape, shape), *given, vmap_method="broadcast_all")
    times, moved = (jax.lax.bitcast_convert_type(halves, jnp.float64) for halves in found)
    return times, moved


def _halves(value: Any) -> Any:
    """Return numbers as two integers each: a thread of a callback may not know of 64 bits."""
    return jax.lax.bitcast_convert_type(jnp.asarray(value, dtype=float), jnp.uint32)


def _breaks(conditions: Conditions, most: int, *given: Any) -> tuple[Any, Any]:
    """Return breaks (..., most) and 1 where they move, of parameters (..., n_p), all of them in halves."""
    p, t0, t1 = (np.ascontiguousarray(value, dtype=np.uint32).view(np.float64)[..., 0] for value in given)
    shape, rows, begin, end = t0.shape, p.reshape(-1, p.shape[-1]), t0.ravel(), t1.ravel()
    times = np.repeat(np.where(end >= begin, np.inf, -np.inf)[:, np.newaxis], most, axis=1)
    moved = np.zeros_like(times)
    starts, found = break_times_of_cases(conditions, rows, begin, end)
    moving = _moving(conditions)
    others = break_times_of_cases(moving, rows, begin, end) if moving.functions else (0 * starts, found[:0])
    for i in range(len(rows)):
        own, some = (values[first[i] : first[i + 1]] for first, values in ((starts, found), others))
        own = own[:most]
        times[i, : len(own)] = own - begin[i]
        moved[i, : len(own)] = np.isclose(own[:, np.newaxis], some, rtol=1e-14, atol=0.0).any(axis=1)
    one, other = (values.reshape(*shape, most, 1).view(np.uint32) for values in (times, moved))
    return one, other


def _moving(conditions: Conditions) -> Conditions:
    """Return the conditions whose changes depend on parameters, and those within which they are nested."""
    own = [
        any(load.array == "p" and load.index != conditions.place for load in function.loads)
        for function in conditions.functions
    ]
    around = [moves and nested for moves, nested in zip(own, conditions.nested, strict=True)]
    kept = [i for i, moves in enumerate(own) if moves or any(around[i:])]
    return replace(
        conditions,
        functions=tuple(conditions.functions[i] for i in kept),
        kinds=tuple(conditions.kinds[i] for i in kept),
        nested=tuple(conditions.nested[i] for i in kept),
        sharpness=tuple(conditions.sharpness[i] for i in kept),
    )
