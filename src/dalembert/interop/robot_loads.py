"""Loads of the joints of robots: motors, damping, springs, dry friction and stops; and gravity."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody
from sympy.physics.vector import Dyadic, Vector, dynamicsymbols

from ..arrays import FloatArray
from ..errors import SceneError, list_names
from ..scene.contacts.laws import CoulombFriction
from ..scene.joints.joints import Joint, Unknown
from ..scene.joints.limits import Stop
from .robot_description import JointItem
from .robot_values import number, vector

if TYPE_CHECKING:
    from .robot_scenes import RobotBuilder

GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration [m/s^2] where neither the file nor the user gives one."""


_UNLIMITED = 1e6
"""Limits [rad] or [m] from this size on, which some files have for joints without limits, are none."""


def add_joint_loads(builder: RobotBuilder) -> None:
    """Add the loads of all joints, as far as the options ask for them."""
    for joint in builder.joints:
        if joint.name in builder.drives:
            _add_loads(builder, joint)
        elif joint.kind == "ball" and joint.damping and builder.options.damping:
            _brake_ball(builder, joint)


def _add_loads(builder: RobotBuilder, joint: JointItem) -> None:
    options, name = builder.options, joint.name
    value = builder.values[name]
    rate = value.diff(dynamicsymbols._t)
    motor = builder.parts[name].input
    if motor is not None:
        builder.scene.add_inputs(motor)
        push_joint(builder, name, motor)
    if options.damping and joint.damping:
        push_joint(builder, name, -builder.parameter(f"d_{name}", joint.damping, nonnegative=True) * rate)
    if options.damping and joint.stiffness:
        stiffness = builder.parameter(f"k_{name}", joint.stiffness, nonnegative=True)
        push_joint(builder, name, -stiffness * (value - sp.Float(joint.reference)))
    if options.friction and joint.friction:
        _add_friction(builder, joint, rate)
    if options.limits:
        _add_stop(builder, joint, value)
    if joint.armature:
        _add_rotor(builder, joint, value)


def push_joint(builder: RobotBuilder, name: str, size: Any) -> None:
    """Add a torque or force on the child along the axis of a joint, and the opposite one on what does not rest."""
    drive = builder.drives[name]
    builder.scene.add_loads((drive.on_child, size * drive.axis))
    if not builder.rests(builder.seats[name]):
        builder.scene.add_loads((drive.on_parent, -size * drive.axis))


def _brake_ball(builder: RobotBuilder, joint: JointItem) -> None:
    """Add the torque of viscous damping against the angular velocity of a ball joint."""
    frame = builder.places[joint.child].frame
    a, b, c, d = quaternion = builder.parts[joint.name].coordinates
    rates = [e.diff(dynamicsymbols._t) for e in quaternion]
    rows = (-b, a, d, -c), (-c, -d, a, b), (-d, c, -b, a)
    size = -2 * builder.parameter(f"d_{joint.name}", joint.damping, nonnegative=True)
    torque = vector(frame, [size * sum(x * rate for x, rate in zip(row, rates, strict=True)) for row in rows])
    builder.scene.add_loads((frame, torque))
    if not builder.rests(joint.parent):
        builder.scene.add_loads((builder.places[joint.parent].frame, -torque))


def _add_friction(builder: RobotBuilder, joint: JointItem, rate: Any) -> None:
    """Add dry friction of a given size: the most that sticks, and what opposes a slip."""
    label = f"{joint.name}.friction"
    force = Unknown(label, real=True)
    action = force * builder.drives[joint.name].axis
    at, torque, push = (builder.places[joint.child].point, action, 0)
    if joint.kind == "prismatic":
        torque, push = 0, action
    other = None if builder.rests(joint.parent) else builder.body_for(joint.parent).name
    builder.scene.add_joints(Joint(label, builder.body_for(joint.child).name, at, push, torque, other))
    size = builder.parameter(f"f_{joint.name}", joint.friction, nonnegative=True)
    builder.scene.add_friction(CoulombFriction(normal=size, tangential=force, slip=rate, mu=1, name=label))


def _add_stop(builder: RobotBuilder, joint: JointItem, value: Any) -> None:
    """Add the limits of a joint as contacts, called after it."""
    drive = builder.drives[joint.name]
    other = None if builder.rests(joint.parent) else builder.body_for(joint.parent)
    where = {"axis": drive.axis} if joint.kind == "revolute" else {"at": drive.on_child, "direction": drive.axis}
    lower, upper = (limit if limit is not None and abs(limit) < _UNLIMITED else None for limit in joint.limits)
    if lower is not None or upper is not None:
        stop = Stop(joint.name, value, lower, upper, body=builder.body_for(joint.child), other=other, **where)
        builder.scene.add_joints(stop)


def _add_rotor(builder: RobotBuilder, joint: JointItem, value: Any) -> None:
    """Add the inertia of a rotor, felt at the joint: a body that turns in the fixed frame by the value of the joint."""
    scene = builder.scene
    frame, point = ReferenceFrame(f"{joint.name} rotor"), Point(f"{joint.name} rotor")
    frame.orient_axis(scene.frame, scene.frame.z, value)
    point.set_pos(scene.origin, Vector(0))
    inertia = builder.parameter(f"a_{joint.name}", joint.armature, nonnegative=True)
    dyadic = Dyadic([(inertia, frame.z, frame.z)])
    scene.add_bodies(RigidBody(f"{joint.name} rotor", point, frame, sp.S.Zero, (dyadic, point)))


def add_gravity(builder: RobotBuilder) -> None:
    """Add the field of gravity: that of the user, of the file, or 9.81 along -z, which is g among symbols."""
    scene, given = builder.scene, builder.options.gravity
    field = np.array(given if given is not None else builder.robot.gravity or GRAVITY)
    if builder.options.symbols and given is None and not np.any(field[:2]) and field[2] < 0.0:
        scene.apply_uniform_gravity(-builder.parameter("g", -float(field[2]), nonnegative=True) * scene.frame.z)
    elif np.any(field):
        scene.apply_uniform_gravity(vector(scene.frame, [number(float(x)) for x in field]))
    _lift(builder, field)


def _lift(builder: RobotBuilder, field: FloatArray) -> None:
    """Add the forces that hold up shares of the weights of links (gravcomp= of a body of MuJoCo)."""
    robot = builder.robot
    if robot.lifted and builder.options.symbols:
        names = list_names(map(repr, robot.lifted))
        raise SceneError(
            robot.name,
            [f"gravcomp= of {names} holds up masses that are numbers: leave it out, or give parameters='numbers'"],
        )
    for name, share in robot.lifted.items():
        own = robot.links[name]
        if np.any(own.mass * field) and not builder.rests(builder.carriers[name][0]):
            link = builder.link(name)
            centre = link.point.locatenew(f"{name} lifted", vector(link.frame, [number(float(x)) for x in own.centre]))
            force = [number(float(x)) for x in -share * own.mass * field]
            builder.scene.add_loads((centre, vector(builder.scene.frame, force)))
