"""Requested outputs of a model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sympy import Basic
from sympy.physics.mechanics import Point

from ..errors import OptionError, list_names
from ..values import listed as members
from .scene import Place

__all__ = ["placed", "requested"]


def requested(outputs: Any) -> tuple[Any, ...]:
    """Return the requested outputs as a tuple, with the components of their positions for points.

    Raises
    ------
    OptionError
        For what is no output.
    """
    kinds = str | Basic | Point
    listed = (
        (outputs,)
        if isinstance(outputs, kinds) or not isinstance(outputs, Iterable)
        else tuple(members("outputs", outputs, "names"))
    )
    strange = [repr(output) for output in listed if not isinstance(output, kinds)]
    if strange:
        raise OptionError(f"outputs are names, expressions of the scene's symbols or Points, not {list_names(strange)}")
    return tuple(part for output in listed for part in _parts(output))


def placed(points: Iterable[Any]) -> tuple[list[Place], list[str]]:
    """Return a component of each of the points that were given as such, to be read, and the names of all of them."""
    listed = members("points", points, "points or their names")
    places = [Place(point, 0) for point in listed if isinstance(point, Point)]
    return places, [point.name if isinstance(point, Point) else str(point) for point in listed]


def _parts(output: Any) -> tuple[Any, ...]:
    return tuple(Place(output, axis) for axis in range(3)) if isinstance(output, Point) else (output,)
