"""Options of scenes from files of robots, and the names, numbers, vectors, frames and places of such scenes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, final

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from ..arrays import FloatArray
from ..errors import OptionError
from ..frozen import frozen
from ..scene.orientation import free_orientation
from ..scene.scene import Scene
from ..values import flag
from .robot_description import JointItem

PARAMETERS = "numbers", "symbols"
"""Forms of masses, inertias and lengths of a file in a scene."""

LOADS = "damping", "friction"
"""Loads of joints that can be chosen by name."""


@final
@frozen
class RobotOptions:
    """Options of `Scene.from_urdf` and `Scene.from_mjcf`.

    Attributes
    ----------
    floating_base : bool
    symbols : bool
        Whether masses, inertias and lengths become symbols.
    damping, friction : bool
        Which loads of joints the scene has.
    limits : bool
        Whether limits of joints become stops.
    actuated : bool or tuple of str
        Joints that get an input, by name; all or none of them.
    gravity : tuple of float or None
        Acceleration [m/s^2]; None takes that of the file, or 9.81 downwards.
    """

    floating_base: bool = False
    symbols: bool = False
    damping: bool = True
    friction: bool = True
    limits: bool = False
    actuated: bool | tuple[str, ...] = False
    gravity: tuple[float, float, float] | None = None

    @classmethod
    def of(
        cls,
        *,
        floating_base: Any,
        parameters: Any,
        joint_loads: Any,
        limits: Any,
        actuated: Any,
        gravity: Any,
    ) -> RobotOptions:
        """Return the options from what a user gave.

        Raises
        ------
        OptionError
            For values that are not allowed.
        """
        if parameters not in PARAMETERS:
            raise OptionError(f'parameters must be "numbers" or "symbols", not {parameters!r}')
        if not isinstance(joint_loads, bool) and joint_loads not in LOADS:
            raise OptionError(f'joint_loads must be True, False, "damping" or "friction", not {joint_loads!r}')
        return cls(
            flag("floating_base", floating_base),
            parameters == "symbols",
            joint_loads in (True, "damping"),
            joint_loads in (True, "friction"),
            flag("limits", limits),
            _actuated(actuated),
            _gravity(gravity),
        )


def _actuated(given: Any) -> bool | tuple[str, ...]:
    if isinstance(given, bool):
        return given
    names = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else None
    if names is None or not all(isinstance(name, str) for name in names):
        raise OptionError(f'actuated must be True, False or names of joints such as ["elbow"], not {given!r}')
    if len(set(names)) < len(names):
        raise OptionError(f"actuated names a joint twice: {', '.join(names)}")
    return names


def _gravity(given: Any) -> tuple[float, float, float] | None:
    if given is None:
        return None
    try:
        values = np.array(given, dtype=float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise OptionError(f"gravity must be three numbers [m/s^2], such as (0, 0, -9.81), not {given!r}")
    x, y, z = (float(value) for value in values)
    return x, y, z


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
