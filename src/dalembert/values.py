"""Checks of numbers and arrays that users give.

NumPy reads strings, durations and quantities with units as numbers, drops imaginary parts and forgets masks. Here they
are rejected.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from .arrays import FloatArray
from .errors import OptionError, ValueInputError

_REAL = "biuf"
EXACT = 1 << 53
"""Size below which whole numbers are doubles."""

_UNITS = ("magnitude", "to_value")
"""Attributes of quantities with units, in the packages that offer these."""


_TRACED = (
    "is traced by JAX, and a number is required here: inside jax.jit, jax.grad and jax.vmap call model.solve_fn(...), "
    'model.vector_field and model.functions (backend="jax")'
)


def array_of(value: Any) -> FloatArray:
    """Return a user's value as an array of its shape; numbers that are not finite are kept.

    Raises
    ------
    ValueError
        For what is no array of real numbers, with the reason: "is not a number", "has units", ...
    """
    if any(hasattr(value, name) for name in _UNITS):
        raise ValueError("has units; give plain numbers, all in one system of units such as SI")
    try:
        given = np.asanyarray(value)
    except (TypeError, ValueError) as error:
        traced = type(error).__module__.startswith("jax")
        raise ValueError(_TRACED if traced else "is not an array of numbers") from None
    # numpy.ma takes long to import, and no plain array is masked
    if type(given) is not np.ndarray and isinstance(given, np.ma.MaskedArray) and np.any(np.ma.getmaskarray(given)):
        raise ValueError("has masked values; give numbers, or NaN")
    kind = given.dtype.kind
    if kind == "O" and not any(isinstance(x, str | bytes | complex | np.generic) for x in given.flat):
        try:
            return np.asarray([float(x) for x in given.flat]).reshape(given.shape)
        except (TypeError, ValueError, OverflowError):
            kind = ""
    if kind not in _REAL or not kind:
        raise ValueError("is not a number" if given.ndim == 0 else "is not an array of numbers")
    return np.asarray(given, dtype=float)


def traced_note(error: Exception) -> str:
    """Return the addition to a message about a value that `array_of` rejected because JAX traces it; else nothing."""
    return f", which {_TRACED}" if str(error) == _TRACED else ""


def flag(name: str, value: Any) -> bool:
    """Return an option that is on or off.

    Raises
    ------
    OptionError
        For what is neither.
    """
    if not isinstance(value, bool | int | np.bool_ | np.integer):
        raise OptionError(f"{name} must be True or False, not {value!r}")
    return bool(value)


def listed(name: str, value: Any, what: str) -> list[Any]:
    """Return the members of a list that an option is, a text being one member.

    Raises
    ------
    OptionError
        For what is no list.
    """
    if isinstance(value, str):
        return [value]
    try:
        return list(value)
    except (TypeError, NotImplementedError):
        raise OptionError(f"{name} must be a list of {what}, not {value!r}") from None


def number(value: Any) -> float:
    """Return one number that a user gave.

    Raises
    ------
    ValueError
        For what is none, with the reason.
    """
    kind = type(value)
    if kind is float:
        return cast(float, value)
    if kind is np.float64 or (kind is int and -EXACT < value < EXACT):
        return float(value)
    found = array_of(value)
    if found.ndim:
        raise ValueError(f"is not a number: it has shape {found.shape}")
    return float(found)


def option(name: str, value: Any) -> float:
    """Return the number that an option is.

    Raises
    ------
    OptionError
        For what is none.
    """
    try:
        return number(value)
    except ValueError as error:
        raise OptionError(f"{name} must be a number, not {value!r}{traced_note(error)}") from None


def whole(name: str, value: Any) -> int:
    """Return the whole number that an option is.

    Raises
    ------
    OptionError
        For what is none.
    """
    found = option(name, value)
    if not found.is_integer():
        raise OptionError(f"{name} must be a whole number, not {value!r}")
    return int(found)


def times_of(name: str, value: Any) -> FloatArray:
    """Return times as an array of its own, a single one as an array of length 1.

    Raises
    ------
    ValueInputError
        For what are no numbers, or a table of them.
    """
    try:
        times = np.array(array_of(value), ndmin=1)
    except ValueError as reason:
        raise ValueInputError(f"{name} = {value!r} {reason}; give times in seconds") from None
    if times.ndim > 1:
        raise ValueInputError(f"{name} has shape {times.shape}; give one time, or a list of them")
    return times


def common_rows(sizes: Mapping[str, int]) -> int:
    """Return the number of rows that arrays of states have in common; one row serves all.

    Raises
    ------
    ValueInputError
        For numbers of rows that differ, by name.
    """
    counts = set(sizes.values()) - {1}
    if len(counts) > 1:
        counted = ", ".join(f"{name}: {size}" for name, size in sizes.items())
        raise ValueInputError(f"arrays of states must have as many rows as each other, or one; given are {counted}")
    return counts.pop() if counts else 1
