"""Arrays with bounds checks, for loops that run as plain Python."""

from __future__ import annotations

from operator import index
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = ["CheckedArray"]


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
        place = tuple(index(number) for number in key) if isinstance(key, tuple) else (index(key),)
        shape = self.array.shape
        if len(place) > len(shape) or not all(0 <= n < length for n, length in zip(place, shape, strict=False)):
            raise IndexError(f"{self.name}[{', '.join(map(str, place))}] is outside the array, of shape {shape}")
        return place
