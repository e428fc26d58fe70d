"""Rods, ropes and gears: couplings of two bodies."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.physics.mechanics import Point
from sympy.physics.vector import Vector, dynamicsymbols

from ...frozen import frozen
from ..contacts.laws import UnilateralContact
from ..expressions.identity import vanishes
from ..shapes import Rod
from .closures import Closure, add_closure, ends_of, reaction_of
from .parts import add_constraints, add_velocity_constraints, body_of, called, constant_in, frame_of, require
from .reactions import ActionPair, Connection, has_body, require_new_name, unknown

if TYPE_CHECKING:
    from ..scene import Scene


@final
@frozen
class Rope:
    """A massless rope between two bodies: slack, or taut at its length; it pulls and does not push.

    It is a unilateral contact of its name: ``traj.mode("rope")`` is "closed" where it is taut, and "rope.force" is the
    tension [N].

    Parameters
    ----------
    name : str
    parent, child : str, RigidBody or Particle
        The bodies that it ties; a parent None is the fixed frame.
    parent_point, child_point : Point
        Its ends, fixed on them.
    length : expression of parameters, or number
        [m], positive.
    restitution : Expr or number
        Newton's coefficient, between 0 (default) and 1, of the jerk with which it becomes taut.

    Examples
    --------
    A ball on a string::

        x, y = dynamicsymbols("x y")
        swing = da.Scene("swing", frame=N, origin=O, coordinates=[x, y])
        Q = O.locatenew("Q", x * N.x + y * N.y)
        swing.add_bodies(Particle("ball", Q, m))
        swing.add_joints(da.Rope("string", None, "ball", parent_point=O, child_point=Q, length=l))
    """

    name: str
    parent: Any
    child: Any
    parent_point: Point
    child_point: Point
    length: Any
    restitution: Any = 0


@final
@frozen
class Gear:
    """A gear box between two bodies that turn about axes: the child turns `ratio` times as fast as the parent.

    Angular velocities are relative to the housing, which takes the sum of both torques. "gear.torque" [N m] is the
    torque on the child about its axis; the parent has - `ratio` times that about its own. The box is a constraint on
    angular velocities, or with `angles` one on angles. Bearings in the housing are not part of it: forces of teeth on
    them are in no reaction.

    Parameters
    ----------
    name : str
    parent, child : str or RigidBody
        A parent None is a wheel fixed in the fixed frame, such as the ring of a planetary gear; `housing` is then the
        carrier.
    axis : Vector
        About which the parent turns, fixed in the housing; a unit vector.
    child_axis : Vector, optional
        About which the child turns; by default `axis`.
    ratio : expression of parameters, or number
        Not zero; negative where the bodies turn in opposite senses.
    housing : str or RigidBody, optional
        The body with the bearings; by default the fixed frame.
    angles : (Expr, Expr), optional
        Angles of parent and child about the axes, in coordinates: child = ratio parent + offset.
    offset : expression of parameters, or number
        [rad], with `angles`.

    Examples
    --------
    A motor that turns five times as fast as the drum that it drives, in the opposite direction::

        ground, motor, drum = RigidBody("ground", masscenter=O, frame=N), RigidBody("motor"), RigidBody("drum")
        winch = da.Scene("winch", frame=N, origin=O)
        winch.add_joints(PinJoint("fast", ground, motor, joint_axis=N.z))
        winch.add_joints(PinJoint("slow", ground, drum, joint_axis=N.z))
        winch.add_joints(da.Gear("gear", "motor", "drum", axis=N.z, ratio=-0.2))
    """

    name: str
    parent: Any
    child: Any
    axis: Vector
    ratio: Any
    child_axis: Vector | None = None
    housing: Any = None
    angles: tuple[Any, Any] | None = None
    offset: Any = 0


def add_rod(scene: Scene, rod: Rod) -> None:
    """Add a rod as a closure of the kind "distance".

    Raises
    ------
    SceneError
        With every fault of the rod.
    """
    missing = [name for name in ("name", "child", "length") if getattr(rod, name) is None]
    require(scene, str(rod.name), [f"a rod that holds needs {name}=" for name in missing])
    add_closure(
        scene,
        Closure(
            str(rod.name),
            rod.parent,
            rod.child,
            kind="distance",
            parent_point=rod.start,
            child_point=rod.end,
            distance=rod.length,
        ),
    )


def add_rope(scene: Scene, rope: Rope) -> None:
    """Add a rope as a contact, whose gap is its slack.

    Raises
    ------
    SceneError
        With every fault of the rope.
    """
    ends = ends_of(
        scene,
        Closure(
            rope.name,
            rope.parent,
            rope.child,
            kind="distance",
            parent_point=rope.parent_point,
            child_point=rope.child_point,
            distance=rope.length,
        ),
    )
    (stretch,) = ends.at_distance()
    tension = unknown(f"{rope.name}.force")
    scene.contacts += (UnilateralContact(tension, gap=-stretch, restitution=rope.restitution, name=rope.name),)
    text = f"rope between {called(ends.parent, ends.child)}: a contact that is closed where it is taut"
    scene.connections += (replace(reaction_of(ends), closes=False, text=text),)


def add_gear(scene: Scene, gear: Gear) -> None:
    """Add the constraint and the torques of a gear.

    Raises
    ------
    SceneError
        With every fault of the gear.
    """
    require_new_name(scene, gear.name)
    faults: list[str] = []
    parent, child, housing = (body_of(scene, body, faults.append) for body in (gear.parent, gear.child, gear.housing))
    faults += _gear_faults(scene, gear, (parent, child, housing)) if not faults else []
    require(scene, gear.name, faults)
    base, ratio = frame_of(scene, housing), sp.sympify(gear.ratio)
    axes = [axis.normalize() for axis in (gear.axis, gear.axis if gear.child_axis is None else gear.child_axis)]
    spins = [frame_of(scene, body).ang_vel_in(base).dot(axis) for body, axis in zip((parent, child), axes, strict=True)]
    slip = spins[1] - ratio * spins[0]
    if gear.angles is None:
        if vanishes(slip):
            require(scene, gear.name, ["the coordinates fulfil it for all their values already; leave it out"])
        add_velocity_constraints(scene, gear.name, [slip])
    else:
        row = gear.angles[1] - ratio * gear.angles[0] - gear.offset
        rates = {u: q.diff(dynamicsymbols._t) for u, q in _rates(scene)}
        if not vanishes(sp.diff(row, dynamicsymbols._t) - sp.sympify(slip).xreplace(rates)):
            require(scene, gear.name, ["angles= are not those of the bodies about its axes; their rates differ"])
        add_constraints(scene, gear.name, [row])
    torque = unknown(f"{gear.name}.torque")
    actions = (
        ActionPair(child, housing, child.masscenter, torque=torque * axes[1]),
        ActionPair(parent, housing, parent.masscenter, torque=-ratio * torque * axes[0])
        if parent is not None
        else ActionPair(housing, None, housing.masscenter, torque=ratio * torque * axes[0]),
    )
    wheel = called(parent)
    text = f"gear between {wheel} and {str(child.name)!r}: 1 {'holonomic ' if gear.angles else ''}constraint"
    scene.connections += (
        Connection(
            gear.name, actions, {f"{gear.name}.torque": torque}, None, None, closes=True, source=gear, text=text
        ),
    )


def _rates(scene: Scene) -> list[tuple[Any, Any]]:
    """Return speeds of SymPy's joints with the coordinates whose rates they are."""
    found = [item.source for item in scene.connections if hasattr(item.source, "kdes")]
    return [(u, q) for joint in found for u, q in zip(joint.speeds, joint.coordinates, strict=True)]


def _gear_faults(scene: Scene, gear: Gear, bodies: tuple[Any, Any, Any]) -> list[str]:
    """Return the faults of the arguments of a gear."""
    parent, child, housing = bodies
    faults = []
    for side, body in (("parent", parent), ("child", child)):
        if body is None and side == "parent" and housing is not None:
            continue  # a fixed wheel, such as the ring of a planetary gear
        if body is None or not hasattr(body, "frame") or not has_body(scene, body):
            fixed = "; a fixed wheel is the parent, with a housing= that turns" if body is None else ""
            faults.append(f"its {side} must be a RigidBody of the scene, which can turn{fixed}")
    if len({id(body) for body in bodies}) < 3:
        faults.append("its bodies must be three: parent, child and housing")
    for name in ("axis", "child_axis"):
        axis = getattr(gear, name)
        if axis is None and name == "child_axis":
            continue
        if not isinstance(axis, Vector) or axis == 0:
            faults.append(f"{name} must be a Vector such as N.z, not {axis!r}")
        elif not constant_in(frame_of(scene, housing), axis):
            where = "the fixed frame" if housing is None else f"the housing {str(housing.name)!r}"
            faults.append(f"the axis {axis} is not fixed in {where}")
    if not isinstance(gear.ratio, int | float | sp.Expr) or gear.ratio == 0:
        faults.append(f"its ratio must be a number or an expression of parameters, and not zero, not {gear.ratio!r}")
    pair: Any = gear.angles
    if pair is not None and not (isinstance(pair, tuple | list) and len(pair) == 2):
        faults.append(f"angles must be those of parent and child, two expressions, not {pair!r}")
    return faults
