"""The language of compiled loops: Python that `dalembert.codegen.subset` translates, and calls of machine code.

To Python itself a loop is an ordinary function, only a slow one. The functions below mean the same in both, to the last
bit; so do those of Python that the translator supports. Doubles are those of NumPy, which follow IEEE 754
where Python's own raise exceptions (a division by zero, an overflow).
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from fractions import Fraction
from threading import Lock
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "PLAIN_LOOPS",
    "call_c",
    "call_code",
    "call_test",
    "compiled_subset",
    "element",
    "exp",
    "flat",
    "fma",
    "log",
    "lowest",
    "prefetch",
    "row",
    "sqrt",
    "square",
    "take",
    "tell_target",
]

F = TypeVar("F", bound=Callable[..., object])

PLAIN_LOOPS: dict[int, Callable[[int], int]] = {}
"""Loops that run as plain Python instead of the code at an address (`dalembert.codegen.llvm.loops`), for good."""

_ADDRESSES = (ctypes.c_int64,) * 5
_CODE, _TEST = ctypes.CFUNCTYPE(None, *_ADDRESSES), ctypes.CFUNCTYPE(ctypes.c_int64, *_ADDRESSES)
_FOREIGN = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
_TAKING = Lock()
_TARGET = {"fused": True}


def compiled_subset(function: F) -> F:
    """Mark a function as one that `dalembert.codegen.subset` translates: it allocates nothing."""
    function.compiled_subset = True  # type: ignore[attr-defined]
    return function


def row(matrix: NDArray[Any], number: int) -> int:
    """Return the address of a row of a C-contiguous matrix of doubles or integers; the matrix must stay alive."""
    if not 0 <= number < max(matrix.shape[0], 1):
        raise IndexError(f"{getattr(matrix, 'name', 'the matrix')} of shape {matrix.shape} has no row {number}")
    return int(matrix.__array_interface__["data"][0]) + number * matrix.shape[1] * 8


def flat(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a C-contiguous matrix of doubles as one column, a view of the same memory."""
    return matrix.reshape(-1, 1)


def call_code(address: int, t: int, y: int, c: int, s: int, out: int) -> None:
    """Call the code at ``address`` with five addresses of doubles."""
    _CODE(address)(t, y, c, s, out)


def call_test(address: int, t: int, y: int, c: int, s: int, out: int) -> int:
    """Call the code at ``address`` with five addresses of doubles; return the integer that it returns."""
    if address in PLAIN_LOOPS:
        return PLAIN_LOOPS[address](t)
    return int(_TEST(address)(t, y, c, s, out))


def call_c(address: int, argument: int) -> int:
    """Call the C function at ``address`` with an address or an integer, and return what it returns."""
    return int(_FOREIGN(address)(argument))


def element(address: int, index: int) -> np.float64:
    """Return the double at an index from an address."""
    return np.float64(ctypes.c_double.from_address(address + 8 * index).value)


def prefetch(address: int, index: int) -> None:
    """Prefetch the memory at an index from an address, which need not be valid: nothing is read."""


def lowest(bits: int) -> int:
    """Return the place of the lowest bit that is set in an integer, which is not 0."""
    return (bits & -bits).bit_length() - 1


def take(array: NDArray[np.int64], amount: int) -> int:
    """Add to the first element of an array of integers, which threads share; return the former value.

    What a thread wrote before is seen by those that find its change.
    """
    with _TAKING:
        before = int(array[0])
        array[0] = before + amount
    return before


def tell_target(*, fused: bool) -> None:
    """Set whether machine code rounds `fma` once, so that plain Python does the same."""
    _TARGET["fused"] = fused


def fma(a: float, b: float, c: float) -> float:
    """Return a * b + c, rounded once; on targets without an instruction for it, rounded twice."""
    plain = a * b + c
    if not _TARGET["fused"] or not (math.isfinite(a) and math.isfinite(b)):
        return plain
    if not math.isfinite(c):
        return c
    exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
    if exact == 0:
        return plain  # with the sign that it has: whatever cancels is exact
    try:
        found = float(exact)
    except OverflowError:
        found = math.inf if exact > 0 else -math.inf
    return np.float64(found if exact > 0 else -abs(found))


def square(x: float) -> float:
    """Return x * x."""
    return x * x


def sqrt(x: float) -> float:
    """Return the square root of a double, NaN for a negative one."""
    return np.float64(math.nan if x < 0.0 else math.sqrt(x))


def exp(x: float) -> float:
    """Return the exponential of a double by the C library, infinity where it is too large."""
    try:
        return np.float64(math.exp(x))
    except OverflowError:
        return np.float64(math.inf)


def log(x: float) -> float:
    """Return the logarithm of a double by the C library: minus infinity of 0, NaN of a negative number."""
    if x <= 0.0:
        return np.float64(-math.inf if x == 0.0 else math.nan)
    return np.float64(math.log(x))
