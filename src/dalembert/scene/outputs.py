"""What a user asks for as outputs of a model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sympy import Basic
from sympy.physics.mechanics import Point

from ..errors import OptionError, list_names
from .scene import Place

__all__ = ["requested"]


def requested(outputs: Any) -> tuple[Any, ...]:
    """Return requested outputs, or the one that was given alone, and for points the components of their positions.

    Raises
    ------
    OptionError
        For what is no output.
    """
    kinds = str | Basic | Point
    listed = (outputs,) if isinstance(outputs, kinds) or not isinstance(outputs, Iterable) else tuple(outputs)
    strange = [repr(output) for output in listed if not isinstance(output, kinds)]
    if strange:
        raise OptionError(f"outputs are names, expressions of the scene's symbols or Points, not {list_names(strange)}")
    return tuple(part for output in listed for part in _parts(output))


def _parts(output: Any) -> tuple[Any, ...]:
    return tuple(Place(output, axis) for axis in range(3)) if isinstance(output, Point) else (output,)
