"""Stops: limits of coordinates and other expressions, as contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import CylindricalJoint, PinJoint, PlanarJoint, Point, PrismaticJoint
from sympy.physics.vector import Vector

from ...errors import list_names
from ...frozen import frozen
from ..contacts.laws import UnilateralContact
from .parts import body_of, require
from .reactions import ActionPair, Connection, require_new_name, unknown
from .sympy_joints import tree_of

if TYPE_CHECKING:
    from ..scene import Scene


@final
@frozen
class Stop:
    """Stops that keep a coordinate of a joint, or an expression of coordinates, between limits.

    Each limit is a unilateral contact: "knee.lower" and "knee.upper" are names of contacts and their reactions, a force
    [N] or a torque [N m] that pushes away from the limit.

    Parameters
    ----------
    name : str
    of : str or Expr
        Name of a SymPy joint of the scene, or an expression of coordinates.
    lower, upper : expression of parameters and time, or number, optional
        The limits; at least one.
    restitution : Expr or number
        Newton's coefficient, between 0 (default) and 1.
    coordinate : dynamicsymbol, optional
        Which of the coordinates of a joint that has several.
    body, other : str, RigidBody or Particle, optional
        With an expression: the bodies between which the stop acts; by default `other` is the fixed frame.
    at, direction : Point, Vector, optional
        With an expression that grows as the body moves: point and unit direction of the force on the body.
    axis : Vector, optional
        With an expression that grows as the body turns: unit axis of the torque on the body.

    Examples
    --------
    A pendulum that swings against a bumper, and a knee that does not bend backwards::

        along = cos(theta) * N.x + sin(theta) * N.y
        scene.add_joints(da.Stop("bumper", theta, upper=pi / 3, body="bob", at=P, direction=along))

        ground, shank = RigidBody("ground", masscenter=O, frame=N), RigidBody("shank")
        leg = da.Scene("leg", frame=N, origin=O)
        leg.add_joints(PinJoint("knee", ground, shank, child_point=shank.y, joint_axis=N.z))
        leg.add_contacts(da.Stop("knee_stop", "knee", lower=0, restitution=0.2))
    """

    name: str
    of: Any
    lower: Any = None
    upper: Any = None
    restitution: Any = 0
    coordinate: Any = None
    body: Any = None
    other: Any = None
    at: Point | None = None
    direction: Vector | None = None
    axis: Vector | None = None


@final
@frozen
class _Guided:
    """The limited quantity of a stop: an expression, and the unit force or torque that has the power of its rate."""

    value: Any
    body: Any
    other: Any
    at: Any
    force: Any = 0
    torque: Any = 0

    def action(self, size: Any) -> ActionPair:
        """Return the action of some size along the expression."""
        force, torque = (0 if vector == 0 else size * vector for vector in (self.force, self.torque))
        return ActionPair(self.body, self.other, self.at, force, torque)


_AXES: dict[type, Callable[[Any], tuple[tuple[Any, Any], ...]]] = {
    PinJoint: lambda j: ((0, j.joint_axis.normalize()),),
    PrismaticJoint: lambda j: ((j.joint_axis.normalize(), 0),),
    CylindricalJoint: lambda j: ((0, j.joint_axis.normalize()), (j.joint_axis.normalize(), 0)),
    PlanarJoint: lambda j: ((0, j.rotation_axis), *((vector, 0) for vector in j.planar_vectors)),
}
"""Unit force and torque on the child for each coordinate of a joint."""


def add_stop(scene: Scene, stop: Stop) -> None:
    """Add the contacts of a stop, and their reactions.

    Raises
    ------
    SceneError
        With every fault of the stop.
    """
    require_new_name(scene, stop.name)
    faults: list[str] = []
    if stop.lower is None and stop.upper is None:
        faults.append("it has no limit: give lower=, upper= or both")
    guided = _of_joint(scene, stop, faults) if isinstance(stop.of, str) else _of_expression(scene, stop, faults)
    require(scene, stop.name, faults)
    assert guided is not None
    actions, components = [], {}
    for side, limit, sense in (("lower", stop.lower, 1), ("upper", stop.upper, -1)):
        if limit is None:
            continue
        name = f"{stop.name}.{side}"
        components[name] = push = unknown(name)
        actions.append(guided.action(sense * push))
        gap = sense * (guided.value - sp.sympify(limit))
        scene.contacts += (UnilateralContact(push, gap=gap, restitution=stop.restitution, name=name),)
    text = f"stop of {guided.value}: contacts {list_names(components)}"
    scene.connections += (
        Connection(stop.name, tuple(actions), components, None, None, closes=False, source=stop, text=text),
    )


def _of_joint(scene: Scene, stop: Stop, faults: list[str]) -> _Guided | None:
    """Return a coordinate of a SymPy joint, with the action of its free direction."""
    joints = {joint.name: joint for joint in tree_of(scene)}
    given = [name for name in ("body", "other", "at", "direction", "axis") if getattr(stop, name) is not None]
    if stop.of not in joints:
        faults.append(f"{stop.of!r} is no SymPy joint of the scene; known: {list_names(joints)}")
        return None
    if given:
        faults.append(f"the joint {stop.of!r} says where it acts; leave out {list_names(given)}")
    joint = joints[stop.of]
    if type(joint) not in _AXES:
        faults.append(
            f"the joint {stop.of!r} is a {type(joint).__name__}, whose coordinates are not those of a force or torque"
            " along one axis: give an expression, with body= and at= and direction=, or axis="
        )
        return None
    known = list(joint.coordinates)
    coordinate = known[0] if stop.coordinate is None and len(known) == 1 else stop.coordinate
    if coordinate not in known:
        names = list_names(str(q.func.__name__) for q in known)
        faults.append(f"coordinate= must be one of the coordinates of {stop.of!r} ({names}), not {stop.coordinate!r}")
        return None
    force, torque = _AXES[type(joint)](joint)[known.index(coordinate)]
    return _Guided(coordinate, joint.child, joint.parent, joint.child_point, force, torque)


def _of_expression(scene: Scene, stop: Stop, faults: list[str]) -> _Guided | None:
    """Return an expression of coordinates, with the action that the stop was given."""
    before = len(faults)
    body, other = (body_of(scene, each, faults.append) for each in (stop.body, stop.other))
    if not isinstance(stop.of, sp.Expr) or not stop.of.has(AppliedUndef):
        faults.append(f"it limits {stop.of!r}: give the name of a SymPy joint, or an expression of coordinates")
    if stop.coordinate is not None:
        faults.append("coordinate= is one of a joint; leave it out")
    if stop.body is None:
        faults.append("body= is missing: the body that the stop pushes")
    pushes, turns = stop.direction is not None, stop.axis is not None
    if pushes == turns or pushes != (stop.at is not None):
        faults.append("give at= and direction= of a force, or axis= of a torque")
    for name, value in (("direction", stop.direction), ("axis", stop.axis)):
        if value is not None and not isinstance(value, Vector):
            faults.append(f"{name} must be a Vector such as N.x, not {value!r}")
    if len(faults) > before:
        return None
    at = stop.at if pushes else body.masscenter
    return _Guided(stop.of, body, other, at, stop.direction if pushes else 0, stop.axis if turns else 0)
