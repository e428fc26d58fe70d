"""What compiled loops are written in: Python that `dalembert.codegen.subset` translates, and calls of machine code.

The functions below mean the same to Python itself, for which a loop is an ordinary function, only a slow one that no
other thread may join.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["ahead", "bare", "call_code", "call_test", "element", "flat", "lowest", "row", "take"]

F = TypeVar("F", bound=Callable[..., object])

_ADDRESSES = (ctypes.c_int64,) * 5
_CODE, _TEST = ctypes.CFUNCTYPE(None, *_ADDRESSES), ctypes.CFUNCTYPE(ctypes.c_int64, *_ADDRESSES)


def bare(function: F) -> F:
    """Mark a function as one that `dalembert.codegen.subset` translates: it allocates nothing."""
    function.bare = True  # type: ignore[attr-defined]
    return function


def row(matrix: NDArray[Any], number: int) -> int:
    """Return the address of a row of a C-contiguous matrix of doubles; the matrix must stay alive."""
    return int(matrix.__array_interface__["data"][0]) + number * matrix.shape[1] * 8


def flat(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a C-contiguous matrix of doubles as one column, a view of the same memory."""
    return matrix.reshape(-1, 1)


def call_code(address: int, t: int, y: int, c: int, s: int, out: int) -> None:
    """Call the code at ``address`` with five addresses of doubles."""
    _CODE(address)(t, y, c, s, out)


def call_test(address: int, t: int, y: int, c: int, s: int, out: int) -> int:
    """Call the code at ``address`` with five addresses of doubles; return the whole number that it returns."""
    return int(_TEST(address)(t, y, c, s, out))


def element(address: int, index: int) -> float:
    """Return the double at an index from an address."""
    return ctypes.c_double.from_address(address + 8 * index).value


def ahead(address: int, index: int) -> None:
    """Have the memory at an index from an address brought near, where it is any; nothing is read."""


def lowest(bits: int) -> int:
    """Return the place of the lowest bit that is set in a whole number, which is not 0."""
    return (bits & -bits).bit_length() - 1


def take(array: NDArray[np.int64], amount: int) -> int:
    """Add to the first element of an array of whole numbers, which threads share; return what it was."""
    array[0] += amount
    return int(array[0] - amount)
