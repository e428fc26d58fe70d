"""Functions of users as operations: compiled by numba, called by address in machine code, as Python elsewhere.

Graphs and kernels name a function by its key, ``call2(x, y, key)``; the function is kept here, with its machine code,
as long as the process lives, so that no address outlasts what it points to. At random points a call is a function of
which nothing is known.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from typing import Any, final

import numpy as np

from ..errors import ExpressionError
from ..frozen import frozen

CALLS: dict[str, int] = {f"call{count}": count for count in range(1, 7)}
"""Operations, with the number of arguments of the functions that they call; behind these stands the key."""

SYMBOL = "dalembert_call_"
"""Beginning of the symbols of functions in machine code; the key follows."""

_BITS = 48
"""Bits of a key: a double holds it exactly."""


@final
@frozen(eq=False)
class CalledFunction:
    """A function of scalars, compiled.

    Attributes
    ----------
    name : str
        For users.
    count : int
        Number of its arguments.
    python : callable
        The function in Python.
    compiled : callable
        The same as machine code; what it raises is NaN.
    address : int
    slopes : tuple of CalledFunction
        Derivatives by each argument; none where they are not known.
    given : object
        What it was made of, for a process that makes it again.
    key : int
    owner : object
        Holds the machine code.
    """

    name: str
    count: int
    python: Callable[..., float]
    compiled: Any
    address: int
    slopes: tuple[CalledFunction, ...] = ()
    given: Any = None
    key: int = 0
    owner: Any = None

    @property
    def op(self) -> str:
        """The operation that calls it."""
        return f"call{self.count}"

    def slope(self, place: int) -> CalledFunction:
        """Return the derivative by an argument.

        Raises
        ------
        ExpressionError
            Where it is not known.
        """
        if not self.slopes:
            raise ExpressionError(
                f"the derivative of the compiled function {self.name!r} is needed, and is not known: give"
                " da.compiled(f, ..., derivatives=(df_dx, ...)), a compiled function of the same arguments for each"
            )
        return self.slopes[place]


_FUNCTIONS: dict[int, CalledFunction] = {}
_KEYS: dict[tuple[Any, ...], tuple[int, Any]] = {}
"""Keys by name, identity of the Python function, which is kept, and keys of derivatives."""


def key_of(name: str, python: Any, slopes: tuple[CalledFunction, ...] = ()) -> int:
    """Return the key of a function: a digest of its code, the same in every process."""
    same = name, id(python), *(slope.key for slope in slopes)
    if same in _KEYS:
        return _KEYS[same][0]
    code = python.__code__
    cells = [cell.cell_contents for cell in python.__closure__ or ()]
    parts = name, code.co_code.hex(), repr(code.co_consts), code.co_names, repr(cells), *same[2:]
    key = int.from_bytes(hashlib.sha256(repr(parts).encode()).digest()[:8], "big") >> (64 - _BITS)
    taken = {each for each, _ in _KEYS.values()}
    while key in taken:  # equal code, as with other globals
        key += 1
    _KEYS[same] = key, python
    return key


def registered(function: CalledFunction) -> CalledFunction:
    """Return a function that is known by its key."""
    return _FUNCTIONS.setdefault(function.key, function)


def known(key: int) -> CalledFunction | None:
    """Return the function of a key, None where there is none yet."""
    return _FUNCTIONS.get(key)


def function_of(key: Any) -> CalledFunction:
    """Return the function of a key."""
    return _FUNCTIONS[int(float(key))]


def call(*values: float) -> float:
    """Return the value of a function, as Python computes it; the key comes last. What it raises is NaN."""
    *args, key = values
    try:
        return float(function_of(key).python(*args))
    except Exception:
        return math.nan


def array_call(*values: Any) -> Any:
    """Return the values of a function of arrays, by machine code; the key comes last."""
    *args, key = values
    compiled = function_of(key).compiled
    rows = np.broadcast_arrays(*args)
    found = np.array([compiled(*row) for row in zip(*(each.ravel().tolist() for each in rows), strict=True)])
    return found.reshape(rows[0].shape) if rows[0].ndim else float(found[0])


def generic_call(*values: float) -> float:
    """Return a smooth function that stands for another at random points, where nothing but its identity may count."""
    *args, key = values
    phase = (int(key) % 1000) * 1e-3
    return math.sin(phase + sum((1.0 + 0.37 * place) * x for place, x in enumerate(args))) + 1.5 * args[0]
