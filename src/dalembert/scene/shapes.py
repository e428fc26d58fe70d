"""Shapes of bodies for pictures, and their numbers; they have no part in the motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, final

import numpy as np
import sympy as sp
from sympy import Expr
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Point, dynamicsymbols
from sympy.physics.vector import Vector

from ..arrays import FloatArray
from ..errors import OptionError, list_names
from ..frozen import frozen


@final
@frozen
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
@frozen
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
@frozen
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
@frozen
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
@frozen(eq=False)
class Mesh:
    """A surface of triangles of a body.

    Parameters
    ----------
    source : path, or pair of array_like (n, 3) and (m, 3)
        A file in the format STL, OBJ, DAE or MSH; or vertices [m], and the numbers of the vertices of each triangle.
        A file is read when it is drawn, with at most 400 vertices.
    at : Point, optional
        Its origin; the mass centre of the body by default.
    color : str, optional
        See `Sphere`.
    scale : float or array_like (3,)
        Metres a unit of the source.
    rotation : array_like (3, 3), optional
        Matrix that takes components on the axes of the source to those on the axes of the body's frame.
    offset : array_like (3,), optional
        Origin of the source from `at`, on the axes of the body's frame [m].
    fixed : bool
        Whether it is fixed in the frame of the scene, and no body has its name.
    """

    source: Any
    at: Point | None = None
    color: str | None = None
    scale: Any = 1.0
    rotation: Any = None
    offset: Any = None
    fixed: bool = False

    @property
    def rigid(self) -> tuple[FloatArray, FloatArray]:
        """The matrix (3, 3) and the offset (3,) that place components of the source."""
        turned = np.eye(3) if self.rotation is None else np.array(self.rotation, dtype=float)
        scale = np.broadcast_to(np.asarray(self.scale, dtype=float), (3,))
        return turned * scale, np.zeros(3) if self.offset is None else np.array(self.offset, dtype=float)


@final
@frozen
class Rod:
    """A straight line between two points, of one body or of several; with a length, a massless rod that holds them.

    ``scene.add_shapes`` draws it. ``scene.add_joints`` takes one with a name, a child and a length: the points then
    stay at that distance, and "strut.force" is the tension [N] of the rod "strut".

    Parameters
    ----------
    start, end : Point
        A rod that holds has its start on the parent, and its end on the child.
    color : str, optional
        See `Sphere`.
    name : str, optional
        Name of the joint.
    parent, child : str, RigidBody or Particle, optional
        The bodies that the rod holds; a parent None is the fixed frame.
    length : number or expression of parameters [m], optional

    Examples
    --------
    ::

        strut = da.Rod(P, Q, name="strut", parent="frame", child="wheel", length=l)
        scene.add_joints(strut)
        scene.add_shapes({"strut": strut})
    """

    start: Point
    end: Point
    color: str | None = None
    name: str | None = field(default=None, kw_only=True)
    parent: Any = field(default=None, kw_only=True)
    child: Any = field(default=None, kw_only=True)
    length: Any = field(default=None, kw_only=True)


@final
@frozen
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
@frozen
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
@frozen
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


Shape = Sphere | Disk | Box | Cylinder | Mesh | Rod | Spring | Ground | Path
BODY_SHAPES = (Sphere, Disk, Box, Cylinder, Mesh)
"""Shapes that move with a body, whose name is their key."""


# Numbers of shapes and forces of a scene, for pictures.


def _with_values(expression: Any, values: Mapping[str, float]) -> Any:
    found = sp.sympify(expression)
    return found.subs({symbol: values[str(symbol)] for symbol in found.free_symbols if str(symbol) in values})


def length_value(expression: Any, values: Mapping[str, float], shape: str) -> float:
    """Return a length of a shape [m] with the values of parameters by name.

    Raises
    ------
    OptionError
        For what is no positive number then.
    """
    value = _with_values(expression, values)
    if not value.is_number or not float(value) > 0.0:
        raise OptionError(
            f"shape {shape!r}: {expression} is no positive length; it may contain the parameters of the scene:"
            f" {list_names(list(values))}"
        )
    return float(value)


def vector_value(vector: Any, frame: Any, values: Mapping[str, float], shape: str) -> FloatArray:
    """Return the components (3,) of a vector that is fixed in a frame.

    Raises
    ------
    OptionError
        For one that moves in it, and for zero.
    """
    value = _with_values(vector.to_matrix(frame), values)
    if not all(x.is_number for x in value) or not any(value):
        raise OptionError(f"shape {shape!r}: {vector} is not fixed in the frame {frame}, or is zero")
    return np.array([float(x) for x in value])


def shape_numbers(shape: Shape, body: Any, frame: Any) -> tuple[Expr, ...]:
    """Return the lengths of a shape, and the components of its axis or normal, as expressions.

    A sphere has its radius; a disk its radius, a cylinder its radius and length, then their axis in the frame `body`; a
    box its edges; a spring its radius, and a ground its size, where they are given; the normal of a ground in the frame
    `frame` of the scene comes first.
    """
    names = () if isinstance(shape, Rod) else ("radius", "length", "x", "y", "z", "size")
    lengths = [getattr(shape, name, None) for name in names]
    found = [sp.sympify(length) for length in lengths if length is not None]
    axis = [*shape.axis.to_matrix(body)] if isinstance(shape, Disk | Cylinder) else []
    normal = [*shape.normal.to_matrix(frame)] if isinstance(shape, Ground) else []
    return (*normal, *found, *axis)


def force_values(
    force: Any, frame: Any, values: Mapping[str, float], t: FloatArray, known: Callable[[Any], FloatArray]
) -> FloatArray:
    """Return the components (n_t, 3) of a force on a frame at times (n_t,).

    `known` returns the values (n_t,) of coordinates, rates and reaction components.
    """
    components = force.to_matrix(frame)
    functions = sorted(components.atoms(sp.Derivative, AppliedUndef), key=sp.default_sort_key)
    plain = {f: sp.Dummy() for f in functions}
    components = components.subs(plain)
    arrays = {plain[f]: known(f) for f in functions}
    for symbol in sorted(components.free_symbols - set(arrays), key=str):
        if symbol == dynamicsymbols._t:
            arrays[symbol] = t
        elif str(symbol) in values:
            arrays[symbol] = np.full(len(t), values[str(symbol)])
        else:
            arrays[symbol] = known(symbol)
    found = sp.lambdify(list(arrays), list(components), "numpy")(*arrays.values())
    return np.stack([np.broadcast_to(np.asarray(x, dtype=float), len(t)) for x in found], axis=1)
