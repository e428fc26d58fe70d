"""Joints and shapes for pictures, added to a scene by their classes.

Arguments of shapes are checked when they are added.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from sympy import Expr
from sympy.physics.mechanics import Point
from sympy.physics.mechanics.joint import Joint as SympyJoint
from sympy.physics.vector import Vector

from ..errors import OptionError, nesting_named
from .joints.closures import Closure, add_closure
from .joints.couplings import Gear, Rope, add_gear, add_rod, add_rope
from .joints.joints import Joint
from .joints.limits import Stop, add_stop
from .joints.reactions import require_new_name
from .joints.rolling_bodies import RollingDisc, RollingSphere, add_rolling
from .joints.sympy_joints import add_sympy_joint
from .shapes import Mesh, Rod, Shape

if TYPE_CHECKING:
    from .scene import Scene

ADDING: dict[type, Callable[[Scene, Any], None]] = {
    SympyJoint: add_sympy_joint,
    Closure: add_closure,
    Rod: add_rod,
    Rope: add_rope,
    Gear: add_gear,
    RollingDisc: add_rolling,
    RollingSphere: add_rolling,
    Stop: add_stop,
}
"""Classes of joints that constrain, each with the function that adds one to a scene."""


def add_connection(scene: Scene, joint: Any) -> bool:
    """Add a joint that constrains; return whether it is one."""
    for kind, add in ADDING.items():
        if isinstance(joint, kind):
            add(scene, joint)
            return True
    return False


@nesting_named
def add_joints(self: Scene, *joints: Any) -> None:
    """Add joints: those of ``sympy.physics.mechanics``, those that constrain, or a `Joint` with unknown reactions.

    `PinJoint`, `PrismaticJoint`, `CylindricalJoint`, `PlanarJoint`, `SphericalJoint` and `WeldJoint` build a tree.
    Each adds its bodies and coordinates, unless the scene has them, and its speeds. A parent at rest is the fixed
    frame. `Closure`, `Rod`, `Gear`, `RollingDisc` and `RollingSphere` add constraints, `Rope` and `Stop` contacts.
    The reaction of a joint "elbow" is an output by name: "elbow.force_x", ..., "elbow.torque_z" act on the child at
    the joint's ``child_point``, with axes of its ``parent_interframe``. See `reaction` for other axes.

    A reaction need not have power on the coordinates. It is computed where it is the same whatever connections of
    bodies carry that no joint declares; otherwise the error names the bodies.

    Raises
    ------
    SceneError
        For a second joint of the same name, and for arguments that contradict the scene, such as a SymPy joint that
        closes a loop.
    """
    for joint in joints:
        if isinstance(joint, Joint):
            if any(joint.name == item.name for item in self.connections):
                require_new_name(self, joint.name)
            self.joints += (joint,)
        elif not add_connection(self, joint):
            self.joints += (joint,)


_POINTS, _VECTORS, _OTHER = (
    ("at", "start", "end", "point"),
    ("axis", "normal"),
    ("color", "coils", "name", "parent", "child", "source", "scale", "rotation", "offset", "fixed"),
)


def add_shapes(self: Scene, shapes: Mapping[str, Shape | Sequence[Shape]]) -> None:
    """Add shapes for pictures; the motion does not depend on them.

    Parameters
    ----------
    shapes : mapping of str to shape or sequence of shapes
        `Sphere`, `Disk`, `Box` and `Cylinder` move with the body whose name is their key. `Rod`, `Spring`,
        `Path` and `Ground` have any name.

    Raises
    ------
    OptionError
        For what is no shape, and for arguments of shapes of the wrong kind.

    Examples
    --------
    A wheel::

        scene.add_shapes({"wheel": da.Disk(radius=r, axis=W.y), "floor": da.Ground(normal=N.z)})
    """
    given: Any = shapes
    if not isinstance(given, Mapping):
        raise OptionError(
            f"add_shapes takes a mapping from names to shapes, such as {{'wheel': Disk(...)}}, not {shapes!r}"
        )
    found: list[tuple[str, Shape]] = []
    for name, own in given.items():
        several = own if isinstance(own, Iterable) else (own,)
        for shape in several:
            if not isinstance(shape, Shape):
                known = ", ".join(kind.__name__ for kind in Shape.__args__)
                raise OptionError(f"shape {str(name)!r}: {shape!r} is none of {known}")
            _check(str(name), shape)
            found.append((str(name), shape))
    self.shapes += tuple(found)


def _check_mesh(name: str, mesh: Mesh) -> None:
    """Raise for a mesh whose numbers have no meaning."""
    try:
        numbers = [x for x in (*mesh.rigid, *(() if isinstance(mesh.source, str | PathLike) else mesh.source))]
        arrays = [np.asarray(x, dtype=float) for x in numbers]
        shapes = [x.shape[-1:] for x in arrays]
        fits = all(map(np.all, map(np.isfinite, arrays))) and shapes == [(3,)] * len(arrays) and len(arrays) in (2, 4)
        fits = fits and arrays[0].shape == (3, 3) and arrays[1].shape == (3,)
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise OptionError(
            f"shape {name!r}: a mesh is the path of a file, or vertices (n, 3) and faces (m, 3); scale= is a number or"
            " three, rotation= (3, 3), offset= (3,)"
        )


def _check(name: str, shape: Shape) -> None:
    if isinstance(shape, Mesh):
        _check_mesh(name, shape)
    for each in fields(shape):
        value, kind = getattr(shape, each.name), None
        if value is None and each.default is None:
            continue
        if each.name in _POINTS and not isinstance(value, Point):
            kind = "a Point"
        elif each.name in _VECTORS and not isinstance(value, Vector):
            kind = "a Vector"
        elif each.name == "color" and not isinstance(value, str):
            kind = "the name of a colour"
        elif each.name == "coils" and not (isinstance(value, int) and value > 0):
            kind = "a positive whole number"
        elif each.name not in (*_POINTS, *_VECTORS, *_OTHER) and not isinstance(value, int | float | Expr):
            kind = "a length: a number, or an expression of the scene's parameters"
        if kind is not None:
            raise OptionError(f"shape {name!r}: {each.name} must be {kind}, not {value!r}")
