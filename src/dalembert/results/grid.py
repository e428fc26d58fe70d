"""Product grids of values, for sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..errors import ValueInputError, nesting_named
from ..values import array_of

__all__ = ["Grid", "grid"]


@final
@dataclass(frozen=True, eq=False)
class Grid:
    """Every combination of some named values; the last axis varies fastest.

    Attributes
    ----------
    axes : dict of str to ndarray
        The values along each axis.
    """

    axes: dict[str, NDArray[np.float64]]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the varied quantities."""
        return tuple(self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""
        return tuple(len(values) for values in self.axes.values())

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Return one value a case (k,) for each name."""
        mesh = np.meshgrid(*self.axes.values(), indexing="ij")
        return {name: values.ravel() for name, values in zip(self.axes, mesh, strict=True)}

    def __repr__(self) -> str:
        return f"<Grid {' x '.join(f'{name}: {len(values)}' for name, values in self.axes.items())}>"


@nesting_named
def grid(**axes: Any) -> Grid:
    """Return the product grid of named values, to be given to `CompiledModel.sweep` as ``grid=``.

    Parameters
    ----------
    **axes : array_like (k,)
        The values of each parameter or initial value that varies.

    Raises
    ------
    ValueInputError
        For an axis that is not one-dimensional, has no values, or holds what are no numbers.

    Examples
    --------
    Two angles at the start and three lengths of the pendulum of `Scene`: six cases, the length fastest::

        axes = da.grid(theta=[0.5, 1.0], l=[1.0, 2.0, 3.0])
        sweep = model.sweep((0, 10), {theta.diff(): 0}, {m: 1, g: 9.81}, grid=axes)
    """
    values, strange = {}, []
    for name, axis in axes.items():
        try:
            values[name] = np.array(array_of(axis), ndmin=1)
        except ValueError as reason:
            strange.append(f"{name} = {axis!r} {reason}")
    if strange:
        raise ValueInputError(f"the axes of a grid are arrays of numbers: {'; '.join(strange)}")
    wrong = [f"{name} has shape {axis.shape}" for name, axis in values.items() if axis.ndim != 1 or not len(axis)]
    if wrong or not values:
        given = "; ".join(wrong) or "none given"
        raise ValueInputError(f"the axes of a grid are one-dimensional arrays of values: {given}")
    return Grid(values)
