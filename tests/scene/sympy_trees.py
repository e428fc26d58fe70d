"""A body on each joint of SymPy with an arm pinned to it, and reactions by Newton's and Euler's laws for bodies."""

from dataclasses import dataclass

import mpmath
import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef
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


def body(name, mass, *moments):
    """Return a body with a frame and a mass centre of its own; SymPy's own take long to make their inertias."""
    frame, centre = ReferenceFrame(f"{name}_frame"), Point(f"{name}_masscenter")
    return RigidBody(name, centre, frame, mass, (inertia(frame, *moments), centre))


def tree(kind, *, skew=False):
    """Return a base on a joint of a kind, whose points and axes lie off its bodies' own, with an arm on a pin."""
    N, O = ReferenceFrame("N"), Point("O")
    ground = RigidBody("ground", O, N, 1, (inertia(N, 1, 1, 1), O))
    base, arm = body("base", m, 0.11, 0.12, 0.19, 0.01, -0.02, 0.03), body("arm", M, 0.02, 0.07, 0.06)
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


def newton_euler(at, axes, carried, root, origin, gravity, values):
    """Return the force and the torque about a point that bodies need for their motion beside gravity, on axes (6,).

    Accelerations are differences of places and rotation matrices, with 50 digits.

    Parameters
    ----------
    at, axes : Point, ReferenceFrame
        Point and axes of a joint.
    carried : sequence of RigidBody
        The child of the joint and all that hangs on it.
    root, origin : ReferenceFrame, Point
    gravity : Vector
    values : mapping
        Numbers for parameters, coordinates, their rates and their second rates.
    """
    mpmath.mp.dps, h = 50, mpmath.mpf(10) ** -12
    held, moving = ([x for x in values if isinstance(x, kind)] for kind in (sp.Symbol, AppliedUndef))
    way = [at.pos_from(origin).to_matrix(root), root.dcm(axes)]
    parts = [(b.masscenter.pos_from(origin).to_matrix(root), root.dcm(b.frame)) for b in carried]
    rest = [*gravity.to_matrix(root), *(b.mass for b in carried)]
    rest += [x for b in carried for x in components(b.central_inertia, b.frame)]
    call = sp.lambdify([*held, *moving], [way, parts, rest], "mpmath")

    def place(s):
        number = {x: mpmath.mpf(float(values[x])) for x in held}
        course = [
            float(values[q]) + s * float(values[q.diff(T)]) + s**2 * float(values[q.diff(T, 2)]) / 2 for q in moving
        ]
        return call(*number.values(), *course)

    behind, (way, now, rest), ahead = place(-h), place(mpmath.mpf(0)), place(h)
    field, masses, moments = mpmath.matrix(rest[:3]), rest[3:], rest[3 + len(carried) :]
    force = torque = mpmath.matrix([0, 0, 0])
    for i, (before, here, after) in enumerate(zip(behind[1], now, ahead[1], strict=True)):
        acceleration = (before[0] - 2 * here[0] + after[0]) / h**2
        need = masses[i] * (acceleration - field)
        first, second = (after[1] - before[1]) / (2 * h), (before[1] - 2 * here[1] + after[1]) / h**2
        omega, alpha = axial(first * here[1].T), axial(second * here[1].T + first * first.T)
        central = here[1] * mpmath.matrix([moments[9 * i + 3 * j : 9 * i + 3 * j + 3] for j in range(3)]) * here[1].T
        force = force + need
        torque = torque + central * alpha + cross(omega, central * omega) + cross(here[0] - way[0], need)
    return np.array([float(x) for vector in (force, torque) for x in way[1].T * vector])


def components(dyadic, frame):
    """Return the matrix of a dyadic, which SymPy takes long for."""
    parts = (value * left.to_matrix(frame) * right.to_matrix(frame).T for value, left, right in dyadic.args)
    return sum(parts, sp.zeros(3))


def axial(skew):
    return mpmath.matrix([skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]) / 2


def cross(a, b):
    return mpmath.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def values_at(run, k, scene, parameters):
    """Return numbers for the symbols of a scene at one time of a run, whose outputs are the second rates."""
    values = dict(parameters)
    for q in scene.coordinates:
        name = q.func.__name__
        values |= {q: run[name][k], q.diff(T): run[f"{name}_dot"][k], q.diff(T, 2): run[f"{name}_ddot"][k]}
    return values
