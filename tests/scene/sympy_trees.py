"""A body on each joint of SymPy with an arm pinned to it, and reactions by Newton's and Euler's laws for bodies."""

from dataclasses import dataclass

import numpy as np
import sympy as sp
from sympy.physics.mechanics import (
    CylindricalJoint,
    PinJoint,
    PlanarJoint,
    Point,
    PrismaticJoint,
    ReferenceFrame,
    RigidBody,
    SphericalJoint,
    System,
    WeldJoint,
    dynamicsymbols,
    inertia,
)

import dalembert as da

T = dynamicsymbols._t
KINDS = {
    "pin": PinJoint,
    "slider": PrismaticJoint,
    "cylinder": CylindricalJoint,
    "plane": PlanarJoint,
    "ball": SphericalJoint,
    "weld": WeldJoint,
}
m, M, g = sp.symbols("m M g", positive=True)
PARAMETERS = {m: 1.3, M: 0.7, g: 9.81}


@dataclass(frozen=True)
class Tree:
    """Ground, bodies and joints, in the order of the tree."""

    ground: RigidBody
    bodies: tuple
    joints: tuple

    def scene(self, name="tree"):
        """Return the tree as a scene, without coordinates or bodies of its own."""
        scene = da.Scene(name, frame=self.ground.frame, origin=self.ground.masscenter)
        scene.add_joints(*self.joints)
        scene.apply_uniform_gravity(-g * self.ground.frame.y)
        return scene

    def system(self):
        """Return the tree as a System of SymPy with its equations."""
        system = System.from_newtonian(self.ground)
        system.add_joints(*self.joints)
        system.apply_uniform_gravity(-g * self.ground.frame.y)
        system.form_eoms()
        return system

    def state(self):
        """Return a value for every coordinate and speed, by name."""
        symbols = [x for joint in self.joints for x in (*joint.coordinates, *joint.speeds)]
        return {x.func.__name__: 0.3 + 0.17 * i * (-1) ** i for i, x in enumerate(symbols)}


def tree(kind, *, skew=False):
    """Return a base on a joint of a kind, whose points and axes lie off its bodies' own, with an arm on a pin."""
    N, O = ReferenceFrame("N"), Point("O")
    ground = RigidBody("ground", masscenter=O, frame=N)
    base, arm = RigidBody("base", mass=m), RigidBody("arm", mass=M)
    base.central_inertia = inertia(base.frame, 0.11, 0.12, 0.19, 0.01, -0.02, 0.03)
    arm.central_inertia = inertia(arm.frame, 0.02, 0.07, 0.06)
    tilted = ReferenceFrame("tilted")
    tilted.orient_axis(N, N.x, sp.pi / 5)
    axis = 0.6 * tilted.x + 0.8 * tilted.z if skew else tilted.z
    first = KINDS[kind](
        "first",
        ground,
        base,
        parent_point=0.3 * N.x + 0.1 * N.z,
        child_point=-0.4 * base.x + 0.2 * base.y,
        parent_interframe=tilted,
        **({"joint_axis": axis} if kind in ("pin", "slider", "cylinder") else {}),
    )
    second = PinJoint("second", base, arm, None, None, 0.5 * base.x, -0.6 * arm.x, joint_axis=base.y)
    return Tree(ground, (base, arm), (first, second))


def newton_euler(joint, carried, scene_frame, origin, gravity, values):
    """Return force and torque on the child of a joint at its child point, on the parent's intermediate frame (6,).

    Parameters
    ----------
    joint : Joint of SymPy
    carried : sequence of RigidBody
        The child and all that hangs on it.
    scene_frame, origin : ReferenceFrame, Point
    gravity : Vector
    values : mapping
        Numbers for parameters, coordinates, their rates and their second rates.
    """
    at = joint.child_point
    force = torque = 0 * scene_frame.x
    for body in carried:
        need = body.mass * (body.masscenter.pos_from(origin).dt(scene_frame).dt(scene_frame) - gravity)
        omega = angular_velocity(body.frame, scene_frame)
        momentum = body.central_inertia.dot(omega)
        force += need
        torque += momentum.dt(scene_frame) + body.masscenter.pos_from(at).cross(need)
    found = []
    for vector in (force, torque):
        found += [vector.dot(axis) for axis in joint.parent_interframe]
    return np.array([float(sp.sympify(x).doit().subs(values)) for x in found])


def angular_velocity(frame, base):
    """Return the angular velocity of a frame by its rotation matrix, without what was set."""
    matrix = base.dcm(frame)
    skew = matrix.diff(T) * matrix.T
    return skew[2, 1] * base.x + skew[0, 2] * base.y + skew[1, 0] * base.z
