"""Names, numbers, vectors, frames and places of scenes of robots."""

from __future__ import annotations

import re
from typing import Any, final

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from ..arrays import FloatArray
from ..frozen import frozen
from ..scene.orientation import free_orientation
from ..scene.scene import Scene
from .robot_description import JointItem

SIMPLE = "revolute", "prismatic"
"""Kinds of joints with one coordinate."""


def coordinate(name: str) -> Any:
    """Return a function of time with any name."""
    return sp.Function(name)(dynamicsymbols._t)


def identifier(name: str) -> str:
    """Return a name without signs other than letters, digits and underscores."""
    found = re.sub(r"\W", "_", name)
    return found if found[:1].isidentifier() else f"_{found}"


def free_names(name: str) -> list[str]:
    """Return the names of the coordinates of a free link: three of its position, four of its quaternion."""
    return [*(f"{name}_{axis}" for axis in "xyz"), *(f"{name}_e{i}" for i in range(4))]


def coordinate_names(joint: JointItem) -> list[str]:
    """Return the names of the coordinates of a joint; none where it mimics another."""
    if joint.kind == "planar":
        return [f"{joint.name}_{which}" for which in ("x", "y", "theta")]
    if joint.kind in SIMPLE:
        return [] if joint.mimic is not None else [joint.name]
    names = free_names(identifier(joint.name))
    return names if joint.kind == "floating" else names[3:]


def joint_value(joint: JointItem, table: dict[str, JointItem]) -> Any:
    """Return the value of a joint with one coordinate, by that of the joint that it mimics."""
    if joint.mimic is None:
        return coordinate(joint.name)
    followed = joint_value(table[joint.mimic.joint], table)
    return number(joint.mimic.multiplier) * followed + number(joint.mimic.offset)


def number(value: float) -> Any:
    """Return a number as an exact one where it is whole, so that sums and products with it vanish."""
    return sp.Integer(int(value)) if value == int(value) and abs(value) < 2**31 else sp.Float(float(value))


def vector(frame: ReferenceFrame, components: Any) -> Vector:
    """Return a vector by its components on a frame."""
    return Vector([(sp.Matrix(list(components)), frame)])


def new_frame(name: str) -> ReferenceFrame:
    """Return a frame whose rotation to itself is known, which SymPy else looks for among all frames joined to it."""
    frame = ReferenceFrame(name)
    frame.dcm(frame)
    return frame


def matrix(rows: FloatArray) -> Any:
    """Return a matrix of numbers."""
    return sp.Matrix(3, 3, [number(float(x)) for x in rows.ravel()])


def is_identity(rotation: FloatArray) -> bool:
    """Whether a rotation turns nothing."""
    return bool(np.all(rotation == np.eye(3)))


@final
@frozen(eq=False)
class LinkPlace:
    """A link that carries others: a frame that moves with it, its origin, and the rotation from its axes to the frame.

    `axes` is the identity where the frame has the axes of the link.
    """

    frame: ReferenceFrame
    point: Point
    axes: FloatArray


@final
@frozen(eq=False)
class Drive:
    """The free direction of a joint with one coordinate: its unit vector, and where forces on both sides act."""

    axis: Vector
    on_child: Any
    on_parent: Any


def turned_frame(name: str, frame: ReferenceFrame, rotation: FloatArray) -> ReferenceFrame:
    """Return a frame whose axes are the columns of a rotation on another; that itself where nothing turns."""
    if is_identity(rotation):
        return frame
    turned = new_frame(name)
    turned.orient_explicit(frame, matrix(rotation))
    return turned


def free_coordinates(
    scene: Scene, name: str, frame: ReferenceFrame, base: ReferenceFrame, *, moves: bool
) -> tuple[Any, ...]:
    """Orient a frame by a unit quaternion, and return the coordinates, positions first."""
    *places, e0, e1, e2, e3 = free_names(name)
    before, there = scene.coordinates, tuple(map(coordinate, places)) if moves else ()
    quaternion = free_orientation(scene, frame, base, names=[e0, e1, e2, e3])
    scene.coordinates = (*before, *there, *quaternion)
    return (*there, *quaternion)
