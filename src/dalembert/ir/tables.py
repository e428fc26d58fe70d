"""Tables: piecewise polynomials of one value, known by a digest of their numbers.

Graphs and kernels name a table by its key; the numbers are kept here once. In a graph, ``table(x, key, order)`` is the
derivative of an order at x, of order -1 the antiderivative. Kernels find the piece first, ``piece(x, key)``, and read
its numbers, ``entry(piece, key, row)``: all that varies within a piece is arithmetic.
"""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from functools import cached_property
from typing import Any, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from ..frozen import frozen

ORIGIN, LOWER, UPPER = 0, 1, 2
"""Rows of a table: what powers are taken of x less, and the ends of the pieces."""

_FIRST, _ROWS = 3, 16
"""First row of coefficients, and rows for each order of derivative."""

_FARTHEST = 1e100
"""End of a piece that has none."""

_BITS = 48
"""Bits of a key: a double holds it exactly."""


class PieceNumbers(ABC):
    """Numbers of pieces, in rows: those of a `Table`, or of the cells of a `dalembert.ir.surfaces.Surface`."""

    name: str

    @property
    @abstractmethod
    def key(self) -> int:
        """Whole number that stands for it."""

    @abstractmethod
    def row(self, number: int) -> NDArray[np.float64]:
        """Return a number of each piece."""

    @abstractmethod
    def jumps(self, number: int) -> bool:
        """Return whether a row has coefficients of something that jumps at the ends of pieces."""


@final
@frozen(eq=False)
class Table(PieceNumbers):
    """A piecewise polynomial of one value x.

    Attributes
    ----------
    name : str
        Name for users.
    edges : ndarray (m,)
        Where pieces end, increasing; piece i is edges[i - 1] <= x < edges[i].
    origins : ndarray (m + 1,)
        Of the powers of each piece.
    coefficients : ndarray (m + 1, degree + 1)
        Of each piece, lowest power first; NaN outside of the range of a table that has values only within.
    smoothness : int
        How many derivatives are continuous; -1 where the table itself jumps.
    first, last : float
        The range of the knots.
    """

    name: str
    edges: NDArray[np.float64]
    origins: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    smoothness: int
    first: float
    last: float

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return int(self.coefficients.shape[1]) - 1

    @cached_property
    def spacing(self) -> float:
        """The least distance of two neighbouring edges that is more than rounding, 1 where there are none."""
        widths = np.diff(self.edges)
        wide = widths[widths > 1e-9 * (self.last - self.first)]
        return float(np.min(wide)) if len(wide) else 1.0

    @property
    def bounded(self) -> bool:
        """Whether the table has values only within its range."""
        return bool(np.isnan(self.coefficients[0, 0]))

    @cached_property
    def key(self) -> int:
        """Whole number that stands for the table: a digest of all of it."""
        numbers = (self.edges, self.origins, self.coefficients, (self.smoothness, self.first, self.last))
        parts = [np.ascontiguousarray(part, dtype="<f8").tobytes() for part in numbers]
        text = f"{self.name}\x1f{self.coefficients.shape}".encode()
        return digest(hashlib.sha256(b"\x1f".join([text, *parts])))

    def jumps(self, number: int) -> bool:
        """See `PieceNumbers.jumps`; the rows before those of coefficients have none."""
        return self.smoothness < (number - _FIRST) // _ROWS - 1

    def row(self, number: int) -> NDArray[np.float64]:
        """Return a number of each piece (m + 1,): its origin, an end, or a coefficient (see `coefficient_row`)."""
        found = self._rows.get(number)
        if found is None:
            found = self._rows[number] = self._row(number)
            found.flags.writeable = False
        return found

    @cached_property
    def _rows(self) -> dict[int, NDArray[np.float64]]:
        return {}

    def _row(self, number: int) -> NDArray[np.float64]:
        if number == ORIGIN:
            return self.origins.copy()
        if number in (LOWER, UPPER):
            ends = np.concatenate([[-_FARTHEST], self.edges, [_FARTHEST]])
            return np.asarray(ends[:-1] if number == LOWER else ends[1:]).copy()
        order, place = divmod(number - _FIRST, _ROWS)
        return np.ascontiguousarray(self.polynomials(order - 1)[:, place])

    def polynomials(self, order: int) -> NDArray[np.float64]:
        """Return the coefficients (m + 1, n) of a derivative, or of the antiderivative that is 0 at the first knot."""
        found = self._polynomials.get(order)
        if found is None:
            found = self._polynomials[order] = self._integrated() if order < 0 else self._differentiated(order)
        return found

    @cached_property
    def _polynomials(self) -> dict[int, NDArray[np.float64]]:
        return {}

    def _differentiated(self, order: int) -> NDArray[np.float64]:
        powers = self.coefficients
        for _ in range(order):
            powers = powers[:, 1:] * np.arange(1.0, powers.shape[1])
        return powers

    def _integrated(self) -> NDArray[np.float64]:
        powers, origins = self.coefficients, self.origins
        raised = np.hstack([np.zeros((len(powers), 1)), powers / np.arange(1.0, powers.shape[1] + 1.0)])
        start = bisect_right(self.edges.tolist(), self.first)
        raised[start, 0] = -_horner(raised[start], self.first - origins[start])
        for i in (*range(start + 1, len(raised)), *range(start - 1, -1, -1)):  # continuous at the edges
            near, edge = (i - 1, self.edges[i - 1]) if i > start else (i + 1, self.edges[i])
            raised[i, 0] = _horner(raised[near], edge - origins[near]) - _horner(raised[i], edge - origins[i])
        return raised


def digest(found: Any) -> int:
    """Return the key that a hash gives."""
    return int.from_bytes(found.digest()[: _BITS // 8], "big")


_KNOWN: dict[int, PieceNumbers] = {}

_Kind = TypeVar("_Kind", bound=PieceNumbers)


def registered(numbers: _Kind) -> _Kind:
    """Register a table or a surface with these numbers and return it; `numbers_of` finds it by its key."""
    found = _KNOWN.setdefault(numbers.key, numbers)
    assert isinstance(found, type(numbers))
    return found


def numbers_of(key: float) -> PieceNumbers:
    """Return the table or surface with a key; ``KeyError`` for one that is not registered in this process."""
    return _KNOWN[int(key)]


def table_of(key: float) -> Table:
    """Return the table with a key; ``KeyError`` for one that is not registered in this process."""
    found = numbers_of(key)
    assert isinstance(found, Table)
    return found


def coefficient_row(order: int, power: int) -> int:
    """Return the row of the coefficient of a power, in the derivative of an order."""
    return _FIRST + _ROWS * (order + 1) + power


def _horner(coefficients: Any, s: float) -> float:
    total = 0.0
    for number in coefficients[::-1]:
        total = total * s + float(number)
    return total


def piece(x: float, key: float) -> float:
    """Return the number of the piece that x lies in: how many edges are not above it; 0 for NaN."""
    return float(bisect_right(table_of(key).edges, x)) if x == x else 0.0


def entry(place: float, key: float, row: float) -> float:
    """Return a number of a piece."""
    return float(numbers_of(key).row(int(row))[int(place)])


def array_piece(x: Any, key: float) -> Any:
    """Return `piece` of an array."""
    x = np.asarray(x, dtype=float)
    return np.where(np.isnan(x), 0.0, np.searchsorted(table_of(key).edges, x, side="right"))


def array_entry(place: Any, key: float, row: float) -> Any:
    """Return `entry` of an array."""
    return numbers_of(key).row(int(row))[np.asarray(place).astype(np.int64)]


def array_value(x: Any, key: float, order: float) -> Any:
    """Return a table or its derivative at an array of x."""
    table, x = table_of(key), np.asarray(x, dtype=float)
    places = array_piece(x, key).astype(np.int64)
    powers, s = table.polynomials(int(order))[places], x - table.origins[places]
    total = np.zeros_like(s)
    for power in range(powers.shape[-1] - 1, -1, -1):
        total = total * s + powers[..., power]
    return total


def value(x: float, key: float, order: float) -> float:
    """Return a table or its derivative at x."""
    table = table_of(key)
    i = int(piece(x, key))
    return _horner(table.polynomials(int(order))[i], x - float(table.origins[i]))


def generic(x: float, key: float, order: float) -> float:
    """Return a smooth function that stands for a table at random points, where nothing but its identity may count.

    Derivatives are those of this function. The table itself may be nothing, or a line, wherever the points are.
    """
    table = table_of(key)
    size = float(np.nanmax(np.abs(table.coefficients[:, 0]), initial=0.0)) or 1.0
    phase = (table.key % 1000) * 1e-3
    low = {-1.0: 1.5 * x, 0.0: 1.5}.get(float(order), 0.0)
    return size * (low + math.sin(x + phase + 0.5 * math.pi * order))
