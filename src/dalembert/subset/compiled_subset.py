"""The language of compiled loops, checked where it runs plain, and the types of its values.

`dalembert.codegen.subset` translates it. To Python itself a loop is an ordinary function, only a slow one. The
functions below mean the same in both, to the last bit; so do those of Python that the translator supports. Doubles are
those of NumPy, which follow IEEE 754 where Python's own raise exceptions (a division by zero, an overflow).
"""

from __future__ import annotations

import ctypes
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import field
from functools import cached_property
from itertools import accumulate
from operator import index
from threading import Lock, local
from typing import Any, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from ..frozen import frozen

F = TypeVar("F", bound=Callable[..., object])

NESTED = "nested-loops"
"""Attribute of functions of assembly in which a loop is in a loop."""

PLAIN_LOOPS: dict[int, Callable[[int], int]] = {}
"""Loops that run as plain Python instead of the code at an address (`dalembert.codegen.llvm.loops`), for good."""

_ADDRESSES = (ctypes.c_int64,) * 5
_CODE, _TEST = ctypes.CFUNCTYPE(None, *_ADDRESSES), ctypes.CFUNCTYPE(ctypes.c_int64, *_ADDRESSES)
_FOREIGN = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
_TAKING = Lock()
_TARGET = {"fused": True}
_LANES = local()


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
    """Return a C-contiguous matrix of doubles as one column for each lane, a view of the same memory."""
    return matrix.reshape(-1, lane_count())


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
    (a_top, a_below), (b_top, b_below), (c_top, c_below) = (float(x).as_integer_ratio() for x in (a, b, c))
    top = a_top * b_top * c_below + c_top * a_below * b_below
    if top == 0:
        return plain  # with the sign that it has: whatever cancels is exact
    try:
        found = top / (a_below * b_below * c_below)  # Python rounds quotients of integers once
    except OverflowError:
        found = math.inf if top > 0 else -math.inf
    return np.float64(found if top > 0 else -abs(found))


def lane_count() -> int:
    """Return how many cases the loop that runs has side by side, which is known when it is translated."""
    return int(getattr(_LANES, "count", 1))


def lanes() -> range:
    """Return the numbers of these cases, for a ``for`` whose rounds do not depend on each other.

    A round reads nothing that another writes, so that machine code takes them at once.
    """
    return range(lane_count())


@contextmanager
def lanes_of(count: int) -> Iterator[None]:
    """Run plain Python with so many cases side by side, in this thread."""
    before, _LANES.count = lane_count(), count
    try:
        yield
    finally:
        _LANES.count = before


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


# Arrays with bounds checks, for loops that run as plain Python.


@final
class CheckedArray:
    """An array as compiled loops use it: indices are never negative, nor past the end.

    Attributes
    ----------
    array : ndarray
    name : str
        Of the field of the arguments, with the indices of a part.

    Raises
    ------
    IndexError
        For an index outside the array; the message names it.
    """

    __slots__ = ("array", "name")

    def __init__(self, array: NDArray[Any], name: str) -> None:
        self.array, self.name = array, name

    @property
    def shape(self) -> tuple[int, ...]:
        """Length along each dimension."""
        return self.array.shape

    @property
    def size(self) -> int:
        """Number of elements."""
        return self.array.size

    @property
    def __array_interface__(self) -> dict[str, Any]:
        return self.array.__array_interface__

    def reshape(self, *shape: int) -> CheckedArray:
        """Return a view of another shape."""
        return CheckedArray(self.array.reshape(*shape), self.name)

    def __getitem__(self, key: int | tuple[int, ...]) -> Any:
        """Return an element, a double as NumPy's and others as Python's, or the part at fewer indices."""
        place = self._place(key)
        found = self.array[place]
        if len(place) < self.array.ndim:
            return CheckedArray(found, f"{self.name}[{', '.join(map(str, place))}]")
        return found if isinstance(found, np.float64) else found.item()

    def __setitem__(self, key: int | tuple[int, ...], value: Any) -> None:
        place = self._place(key)
        if len(place) < self.array.ndim:
            raise TypeError(f"{self.name} has {self.array.ndim} dimensions: one element is written at a time")
        self.array[place] = value

    def _place(self, key: int | tuple[int, ...]) -> tuple[int, ...]:
        place = tuple(map(index, key)) if isinstance(key, tuple) else (index(key),)
        shape = self.array.shape
        inside = len(place) <= len(shape)
        for n, length in zip(place, shape, strict=False):
            inside = inside and 0 <= n < length
        if not inside:
            raise IndexError(f"{self.name}[{', '.join(map(str, place))}] is outside the array, of shape {shape}")
        return place


class Kind(ABC):
    """A type; a value of it is one or more words of 8 bytes, each of a type of LLVM."""

    @property
    @abstractmethod
    def words(self) -> tuple[str, ...]:
        """LLVM types of the words."""


@final
@frozen
class Scalar(Kind):
    """A number; ``stored`` is its LLVM type in arrays, ``owned`` says that it is an address with its owner."""

    type: str
    stored: str
    owned: bool = field(default=False, compare=False)

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return (self.type,)


@final
@frozen
class Array(Kind):
    """A C-contiguous array: the address, and the length along each dimension."""

    item: Scalar
    dimensions: int

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return ("ptr", *("i64",) * self.dimensions)


@final
@frozen
class Fields(Kind):
    """A record: the address of numbers of 8 bytes each, which have names and can be changed."""

    names: tuple[str, ...]
    items: tuple[Scalar, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return ("ptr",)


@final
@frozen
class Group(Kind):
    """A tuple, with names where it is a NamedTuple."""

    parts: tuple[Kind, ...]
    names: tuple[str, ...] = ()

    @cached_property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return tuple(word for part in self.parts for word in part.words)

    @cached_property
    def places(self) -> tuple[int, ...]:
        """Place of the first word of each part among the words."""
        return tuple(accumulate((len(part.words) for part in self.parts), initial=0))


INTEGER, NUMBER, FLAG = Scalar("i64", "i64"), Scalar("double", "double"), Scalar("i1", "i8")
VECTOR, MATRIX = Array(NUMBER, 1), Array(NUMBER, 2)
INT_VECTOR, INT_MATRIX, FLAG_MATRIX = Array(INTEGER, 1), Array(INTEGER, 2), Array(FLAG, 2)
ADDRESS = Scalar("i64", "i64", owned=True)
ADDRESS_VECTOR = Array(ADDRESS, 1)
