"""Surfaces: piecewise polynomials of two values on the cells of a grid, known by a digest of their numbers.

In a graph, ``surface(x, y, key, i, j)`` is the derivative of orders i and j at (x, y). Kernels find the piece of either
axis, as for tables, and from both the number of the cell, ``cell = piece_x * n + piece_y``, whose coefficients are
numbers that `dalembert.ir.tables.entry` reads.
"""

from __future__ import annotations

import hashlib
import math
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..frozen import frozen
from .tables import PieceNumbers, Table, array_piece, digest, numbers_of

_POWERS = 4
"""Most powers of either value: those of cubic splines."""


@final
@frozen(eq=False)
class Surface(PieceNumbers):
    """A piecewise polynomial of two values.

    Attributes
    ----------
    name : str
        Name for users.
    axes : tuple of Table
        Two tables, of which only the ends, origins, smoothness and range of the pieces count.
    coefficients : ndarray (m, n, degree + 1, degree + 1)
        Of each cell, lowest powers first: ``sum_ab coefficients[i, j, a, b] (x - x_i)^a (y - y_j)^b``.
    """

    name: str
    axes: tuple[Table, Table]
    coefficients: NDArray[np.float64]

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees in either value."""
        return self.coefficients.shape[2] - 1, self.coefficients.shape[3] - 1

    @property
    def columns(self) -> int:
        """Number of pieces of the second axis."""
        return int(self.coefficients.shape[1])

    @cached_property
    def key(self) -> int:
        """Whole number that stands for the surface: a digest of all of it."""
        text = f"{self.name}\x1f{self.coefficients.shape}\x1f{self.axes[0].key}\x1f{self.axes[1].key}"
        return digest(hashlib.sha256(text.encode() + np.ascontiguousarray(self.coefficients, dtype="<f8").tobytes()))

    def row(self, number: int) -> NDArray[np.float64]:
        """Return a coefficient of each cell (m n,), see `surface_row`."""
        orders, powers = divmod(number, _POWERS * _POWERS)
        a, b = divmod(powers, _POWERS)
        found = self.derivative(*divmod(orders, _POWERS))[:, :, a, b].ravel()
        found.flags.writeable = False
        return found

    def jumps(self, number: int) -> bool:
        """See `PieceNumbers.jumps`."""
        orders = divmod(number // (_POWERS * _POWERS), _POWERS)
        return any(axis.smoothness < order for axis, order in zip(self.axes, orders, strict=True))

    def derivative(self, i: int, j: int) -> NDArray[np.float64]:
        """Return the coefficients (m, n, degree_x + 1 - i, degree_y + 1 - j) of a derivative."""
        found = self.coefficients
        for _ in range(i):
            found = found[:, :, 1:] * np.arange(1.0, found.shape[2])[:, np.newaxis]
        for _ in range(j):
            found = found[:, :, :, 1:] * np.arange(1.0, found.shape[3])
        return found


def surface_of(key: float) -> Surface:
    """Return the surface with a key; ``KeyError`` for one that is not registered in this process."""
    found = numbers_of(key)
    assert isinstance(found, Surface)
    return found


def surface_row(i: int, j: int, a: int, b: int) -> int:
    """Return the row of the coefficient of (x - x_i)^a (y - y_j)^b in the derivative of orders i and j."""
    return ((i * _POWERS + j) * _POWERS + a) * _POWERS + b


def array_surface(x: Any, y: Any, key: float, i: float, j: float) -> Any:
    """Return a surface or its derivative at arrays of x and y."""
    surface = surface_of(key)
    places = [array_piece(at, axis.key).astype(int) for at, axis in zip((x, y), surface.axes, strict=True)]
    s, t = (np.asarray(at, float) - axis.origins[p] for at, axis, p in zip((x, y), surface.axes, places, strict=True))
    numbers = surface.derivative(int(i), int(j))[places[0], places[1]]
    total = np.zeros(np.broadcast_shapes(np.shape(s), np.shape(t)))
    for a in range(numbers.shape[-2] - 1, -1, -1):
        inner = np.zeros_like(total)
        for b in range(numbers.shape[-1] - 1, -1, -1):
            inner = inner * t + numbers[..., a, b]
        total = total * s + inner
    return total


def surface_value(x: float, y: float, key: float, i: float, j: float) -> float:
    """Return a surface or its derivative at a point."""
    return float(array_surface(x, y, key, i, j))


def generic_surface(x: float, y: float, key: float, i: float, j: float) -> float:
    """Return a smooth function that stands for a surface at random points, where only its identity may count.

    It is no product of functions of one value, and no function of one combination of both.
    """
    surface = surface_of(key)
    size = float(np.nanmax(np.abs(surface.coefficients[:, :, 0, 0]), initial=0.0)) or 1.0
    phase, total = (surface.key % 1000) * 1e-3, 1.5 if i == j == 0.0 else 0.0
    for a, b in ((1.0, 0.73205080), (0.61803399, -1.1447142)):
        total += a**i * b**j * math.sin(a * x + b * y + phase + 0.5 * math.pi * (i + j))
    return size * total
