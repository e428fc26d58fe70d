"""Numbers of shapes and forces of a scene, for pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import dynamicsymbols

from ..arrays import FloatArray
from ..errors import OptionError, list_names

__all__ = ["force_values", "length_value", "vector_value"]


def _with_values(expression: Any, values: Mapping[str, float]) -> Any:
    found = sp.sympify(expression)
    return found.subs({symbol: values[str(symbol)] for symbol in found.free_symbols if str(symbol) in values})


def length_value(expression: Any, values: Mapping[str, float], shape: str) -> float:
    """Return a length of a shape [m] with the values of parameters by name.

    Raises
    ------
    OptionError
        For what is no positive number then.
    """
    value = _with_values(expression, values)
    if not value.is_number or not float(value) > 0.0:
        raise OptionError(
            f"shape {shape!r}: {expression} is no positive length; it may contain the parameters of the scene:"
            f" {list_names(list(values))}"
        )
    return float(value)


def vector_value(vector: Any, frame: Any, values: Mapping[str, float], shape: str) -> FloatArray:
    """Return the components (3,) of a vector that is fixed in a frame.

    Raises
    ------
    OptionError
        For one that moves in it, and for zero.
    """
    value = _with_values(vector.to_matrix(frame), values)
    if not all(x.is_number for x in value) or not any(value):
        raise OptionError(f"shape {shape!r}: {vector} is not fixed in the frame {frame}, or is zero")
    return np.array([float(x) for x in value])


def force_values(
    force: Any, frame: Any, values: Mapping[str, float], t: FloatArray, known: Callable[[Any], FloatArray]
) -> FloatArray:
    """Return the components (n_t, 3) of a force on a frame at times (n_t,).

    `known` returns the values (n_t,) of coordinates, rates and reaction components.
    """
    components = force.to_matrix(frame)
    functions = sorted(components.atoms(sp.Derivative, AppliedUndef), key=sp.default_sort_key)
    plain = {f: sp.Dummy() for f in functions}
    components = components.subs(plain)
    arrays = {plain[f]: known(f) for f in functions}
    for symbol in sorted(components.free_symbols - set(arrays), key=str):
        if symbol == dynamicsymbols._t:
            arrays[symbol] = t
        elif str(symbol) in values:
            arrays[symbol] = np.full(len(t), values[str(symbol)])
        else:
            arrays[symbol] = known(symbol)
    found = sp.lambdify(list(arrays), list(components), "numpy")(*arrays.values())
    return np.stack([np.broadcast_to(np.asarray(x, dtype=float), len(t)) for x in found], axis=1)
