"""Types of NumPy arrays, columns of values of many cases, and memory for lanes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]

Column: TypeAlias = float | FloatArray
"""Values of cases: one for all of them, as a number or (1,), or one each (k,)."""

AnyColumn = TypeVar("AnyColumn", bound=Column)


def part_of(values: AnyColumn, cases: slice | list[int]) -> AnyColumn:
    """Return the values of some cases."""
    if isinstance(values, float) or len(values) == 1:
        return values
    return cast(AnyColumn, values[cases])


def arrays_of(columns: Mapping[str, Column]) -> dict[str, FloatArray]:
    """Return columns as arrays (1,) or (k,)."""
    return {name: np.array((value,)) if isinstance(value, float) else value for name, value in columns.items()}


def finite_rows(values: FloatArray) -> NDArray[np.bool_]:
    """Return which rows hold nothing but finite numbers; a product does that much faster than sums of short rows."""
    with np.errstate(over="ignore", invalid="ignore"):
        finite: NDArray[np.bool_] = np.isfinite(values @ np.ones(values.shape[1]))
    if not finite.all():
        large = np.flatnonzero(~finite)  # or a sum of finite numbers that is not
        finite[large] = np.isfinite(values[large]).all(axis=1)
    return finite


_LINE = 64


def aligned(rows: int, columns: int, dtype: type = np.float64) -> NDArray[Any]:
    """Return zeros (rows, columns) that begin with a cache line, so that no pack lies across two."""
    size = rows * columns * np.dtype(dtype).itemsize
    memory = np.zeros(size + _LINE, np.uint8)
    first = -memory.__array_interface__["data"][0] % _LINE
    return memory[first : first + size].view(dtype).reshape(rows, columns)
