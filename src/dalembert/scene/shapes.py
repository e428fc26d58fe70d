"""Shapes of bodies for pictures; they have no part in the motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, final

from sympy import Expr
from sympy.physics.mechanics import Point
from sympy.physics.vector import Vector

from ..errors import OptionError

__all__ = [
    "BODY_SHAPES",
    "Box",
    "Cylinder",
    "Disk",
    "Ground",
    "Path",
    "Rod",
    "Shape",
    "Sphere",
    "Spring",
    "checked_shapes",
]


@final
@dataclass(frozen=True)
class Sphere:
    """A sphere of a body.

    Parameters
    ----------
    radius : number or expression of parameters [m]
    at : Point, optional
        Its centre; the mass centre of the body by default.
    color : str, optional
        A colour of matplotlib and HTML, such as "tab:blue" or "#1f77b4".
    """

    radius: Any
    at: Point | None = None
    color: str | None = None


@final
@dataclass(frozen=True)
class Disk:
    """A thin disk of a body, with spokes that show how it turns.

    Parameters
    ----------
    radius : number or expression of parameters [m]
    axis : Vector
        Its axis, fixed in the body, such as ``W.y``.
    at : Point, optional
        Its centre; the mass centre of the body by default.
    color : str, optional
        See `Sphere`.
    """

    radius: Any
    axis: Vector
    at: Point | None = None
    color: str | None = None


@final
@dataclass(frozen=True)
class Box:
    """A box of a body.

    Parameters
    ----------
    x, y, z : number or expression of parameters [m]
        Its edges, along the axes of the body's frame.
    at : Point, optional
        Its centre; the mass centre of the body by default.
    color : str, optional
        See `Sphere`.
    """

    x: Any
    y: Any
    z: Any
    at: Point | None = None
    color: str | None = None


@final
@dataclass(frozen=True)
class Cylinder:
    """A cylinder of a body.

    Parameters
    ----------
    radius, length : number or expression of parameters [m]
    axis : Vector
        Its axis, fixed in the body.
    at : Point, optional
        Its centre; the mass centre of the body by default.
    color : str, optional
        See `Sphere`.
    """

    radius: Any
    length: Any
    axis: Vector
    at: Point | None = None
    color: str | None = None


@final
@dataclass(frozen=True)
class Rod:
    """A straight line between two points, of one body or of several.

    Parameters
    ----------
    start, end : Point
    color : str, optional
        See `Sphere`.
    """

    start: Point
    end: Point
    color: str | None = None


@final
@dataclass(frozen=True)
class Spring:
    """A coil spring between two points.

    Parameters
    ----------
    start, end : Point
    radius : number or expression of parameters [m], optional
        A twentieth of the largest length by default.
    coils : int
    color : str, optional
        See `Sphere`.
    """

    start: Point
    end: Point
    radius: Any = None
    coils: int = 8
    color: str | None = None


@final
@dataclass(frozen=True)
class Ground:
    """A square of a plane that is fixed in the frame of the scene.

    Parameters
    ----------
    normal : Vector
        Fixed in the frame of the scene.
    at : Point, optional
        A point of the plane, fixed in the frame of the scene; its origin by default.
    size : number or expression of parameters [m], optional
        Edge of the square; by default as large as the picture.
    color : str, optional
        See `Sphere`.
    """

    normal: Vector
    at: Point | None = None
    size: Any = None
    color: str | None = None


@final
@dataclass(frozen=True)
class Path:
    """The path of a point.

    Parameters
    ----------
    point : Point
    color : str, optional
        See `Sphere`.
    """

    point: Point
    color: str | None = None


Shape = Sphere | Disk | Box | Cylinder | Rod | Spring | Ground | Path
BODY_SHAPES = (Sphere, Disk, Box, Cylinder)
"""Shapes that move with a body, whose name is their key."""

_POINTS, _VECTORS, _OTHER = ("at", "start", "end", "point"), ("axis", "normal"), ("color", "coils")


def checked_shapes(shapes: Any) -> tuple[tuple[str, Shape], ...]:
    """Return pairs of name and shape of a mapping from names to shapes, or to several.

    Raises
    ------
    OptionError
        For what is no shape, and for arguments of shapes of the wrong kind.
    """
    if not isinstance(shapes, Mapping):
        raise OptionError(
            f"add_shapes takes a mapping from names to shapes, such as {{'wheel': Disk(...)}}, not {shapes!r}"
        )
    found: list[tuple[str, Shape]] = []
    for name, given in shapes.items():
        several = given if isinstance(given, Iterable) else (given,)
        for shape in several:
            if not isinstance(shape, Shape):
                known = ", ".join(kind.__name__ for kind in Shape.__args__)
                raise OptionError(f"shape {str(name)!r}: {shape!r} is none of {known}")
            _check(str(name), shape)
            found.append((str(name), shape))
    return tuple(found)


def _check(name: str, shape: Shape) -> None:
    for field in fields(shape):
        value, kind = getattr(shape, field.name), None
        if value is None and field.default is None:
            continue
        if field.name in _POINTS and not isinstance(value, Point):
            kind = "a Point"
        elif field.name in _VECTORS and not isinstance(value, Vector):
            kind = "a Vector"
        elif field.name == "color" and not isinstance(value, str):
            kind = "the name of a colour"
        elif field.name == "coils" and not (isinstance(value, int) and value > 0):
            kind = "a positive whole number"
        elif field.name not in (*_POINTS, *_VECTORS, *_OTHER) and not isinstance(value, int | float | Expr):
            kind = "a length: a number, or an expression of the scene's parameters"
        if kind is not None:
            raise OptionError(f"shape {name!r}: {field.name} must be {kind}, not {value!r}")
