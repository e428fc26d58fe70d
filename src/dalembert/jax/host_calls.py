"""Calls of functions on the host from traced programs, in double precision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import FloatArray
from .runs.mesh_axes import varying_like
from .runs.precision import SINGLE, process_precision

_Struct: Any = jax.ShapeDtypeStruct  # which has no types


def on_host(
    function: Callable[..., Sequence[FloatArray]], shapes: Sequence[tuple[int, ...]], *given: Any
) -> tuple[Any, ...]:
    """Return the result of a function of NumPy arrays, arrays of some shapes, without derivatives.

    Of a batch, to any depth, the function gets one call: all arguments have one further axis, which counts the cases,
    and so has what it returns.
    """
    ranks = [jnp.ndim(value) for value in given]
    single = process_precision() is SINGLE

    def call(*values: Any) -> tuple[Any, ...]:
        if single:
            arrays = [np.asarray(value, dtype=np.float64) for value in values]
        else:
            arrays = [np.ascontiguousarray(value, dtype=np.uint32).view(np.float64)[..., 0] for value in values]
        batch = arrays[0].shape[: arrays[0].ndim - ranks[0]]
        rows = [array.reshape(-1, *array.shape[len(batch) :]) for array in arrays]
        found = function(*rows)
        if single:
            pairs = zip(found, shapes, strict=True)
            return tuple(np.asarray(value, dtype=np.float32).reshape(*batch, *shape) for value, shape in pairs)
        return tuple(
            np.ascontiguousarray(value, dtype=np.float64).reshape(*batch, *shape, 1).view(np.uint32)
            for value, shape in zip(found, shapes, strict=True)
        )

    given = tuple(jax.lax.stop_gradient(jnp.asarray(value, dtype=float)) for value in given)
    return tuple(varying_like(_called(call, shapes, single, *given), given))


def _called(call: Callable[..., Any], shapes: Sequence[tuple[int, ...]], single: bool, *given: Any) -> tuple[Any, ...]:
    """Return the result of a function on the host, whose numbers are transferred as pairs of 32 bits."""
    if single:
        shown = tuple(_Struct(shape, jnp.float32) for shape in shapes)
        return tuple(jax.pure_callback(call, shown, *given, vmap_method="broadcast_all"))
    wanted = tuple(_Struct((*shape, 2), jnp.uint32) for shape in shapes)
    halves = (jax.lax.bitcast_convert_type(value, jnp.uint32) for value in given)  # its threads may not have 64 bits
    found = jax.pure_callback(call, wanted, *halves, vmap_method="broadcast_all")
    return tuple(jax.lax.bitcast_convert_type(value, jnp.float64) for value in found)
