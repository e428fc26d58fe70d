"""Valid scenes that are out of the ordinary; each function returns a fresh scene."""

import sympy as sp
from sympy import Rational, cos, sin, symbols
from sympy.physics.mechanics import (
    Force,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    Torque,
    dynamicsymbols,
    inertia,
)

import dalembert as da

t = dynamicsymbols._t
m, M, g, l, r, k, c = symbols("m M g l r k c", positive=True)
A, B, C = symbols("A B C", positive=True)


def start(name, coordinates):
    N, O = ReferenceFrame("N"), Point("O")
    return da.Scene(name, frame=N, origin=O, coordinates=coordinates), N, O


def particles():
    """Two particles in a field, tied by a spring; no rigid body."""
    x, y, z, s = dynamicsymbols("x y z s")
    scene, N, O = start("particles", [x, y, z, s])
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    Q = O.locatenew("Q", s * (N.x + N.y))
    scene.add_bodies(Particle("a", P, m), Particle("b", Q, M))
    pull = k * (Q.pos_from(O) - P.pos_from(O))
    scene.add_loads((P, pull), (Q, -pull))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def flywheel_without_mass():
    """A wheel that has inertia only, on an arm of no mass that carries a particle."""
    a, b = dynamicsymbols("a b")
    scene, N, O = start("flywheel", [a, b])
    arm = N.orientnew("arm", "Axis", (a, N.z))
    W = arm.orientnew("W", "Axis", (b, arm.x))
    P = O.locatenew("P", l * arm.x)
    scene.add_bodies(
        RigidBody("wheel", P, W, 0, (inertia(W, A, B, B), P)),
        RigidBody("bob", P, arm, m, (inertia(arm, 0, 0, 0), P)),
    )
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def numbers_for_parameters():
    """No parameters at all: rationals and floats in their place."""
    a, b = dynamicsymbols("a b")
    scene, N, O = start("numbers", [a, b])
    F = N.orientnew("F", "Axis", (a, N.z))
    H = F.orientnew("H", "Axis", (b, F.z))
    G1 = O.locatenew("G1", Rational(1, 3) * F.x)
    P = O.locatenew("P", 0.7 * F.x)
    G2 = P.locatenew("G2", sp.sqrt(2) / 4 * H.x + sp.pi / 20 * H.y)
    scene.add_bodies(
        RigidBody("one", G1, F, 2, (inertia(F, 0, 0, Rational(1, 7)), G1)),
        RigidBody("two", G2, H, 1.3, (inertia(H, 0, 0, 0.05), G2)),
    )
    scene.apply_uniform_gravity(-9.81 * N.y)
    return scene


def inertia_elsewhere():
    """Inertia about a point that is not the mass centre, and on a frame that is not the body's."""
    a, b, d = dynamicsymbols("a b d")
    scene, N, O = start("inertia_elsewhere", [a, b, d])
    S = N.orientnew("S", "Body", (a, b, d), "ZXY")
    T = S.orientnew("T", "Axis", (sp.pi / 5, S.x + S.y))
    P = O.locatenew("P", r * N.x)
    G = P.locatenew("G", l * S.x - r * S.z)
    dyadic = inertia(T, A + m * 9, B + m * 9, C + m * 9, m * l * r / 7, 0, m * r**2 / 9)
    scene.add_bodies(RigidBody("block", G, S, m, (dyadic, P)))
    scene.apply_uniform_gravity(-g * N.z)
    return scene


def turntable():
    """A frame oriented by an angle that time prescribes, with a slider on it."""
    s, a = dynamicsymbols("s a")
    w = symbols("w")
    scene, N, O = start("turntable", [s, a])
    T = N.orientnew("T", "Axis", (w * t + sin(2 * t) / 3, N.z))
    F = T.orientnew("F", "Axis", (a, T.x))
    P = O.locatenew("P", s * T.x + l * T.z)
    G = P.locatenew("G", -r * F.z)
    scene.add_bodies(Particle("slider", P, M), RigidBody("bob", G, F, m, (inertia(F, A, B, C), G)))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((P, -k * s * T.x))
    return scene


def shaken_pendulum():
    """A pendulum whose support moves as time prescribes, in two directions, beyond the frame's own axes."""
    a = dynamicsymbols("a")
    h, w = symbols("h w", positive=True)
    scene, N, O = start("shaken", [a])
    P = O.locatenew("P", h * sin(w * t) * N.y + h * t**2 / 5 * N.x)
    F = N.orientnew("F", "Axis", (a, N.z))
    G = P.locatenew("G", l * F.x)
    scene.add_bodies(RigidBody("rod", G, F, m, (inertia(F, 0, 0, A), G)))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def sympy_loads():
    """SymPy's own Force and Torque, with damping, springs, and a follower force."""
    x, a, b = dynamicsymbols("x a b")
    scene, N, O = start("loads", [x, a, b])
    F = N.orientnew("F", "Axis", (a, N.z))
    H = F.orientnew("H", "Axis", (b, F.y))
    P = O.locatenew("P", x * N.x)
    G = P.locatenew("G", l * H.x)
    tip = G.locatenew("tip", l * H.x + r * H.y)
    body = RigidBody("rod", G, H, m, (inertia(H, A, B, C), G))
    scene.add_bodies(body, Particle("cart", P, M))
    scene.add_loads(
        Force(P, (-k * x - c * x.diff()) * N.x),
        Force(tip, g * H.y - c * tip.pos_from(O).dt(N)),
        Torque(H, -c * b.diff() * F.y - k * a * N.z),
        Torque(body, k * H.x),
        (G, sin(3 * t) * N.y),
        (N, k * N.z),
    )
    return scene


def double_pendulum(absolute):
    """One mechanism in two sets of coordinates; with absolute angles the second bob is reached off the chain."""
    a, b = dynamicsymbols("a b")
    scene, N, O = start("absolute" if absolute else "relative", [a, b])
    F = N.orientnew("F", "Axis", (a, N.z))
    H = N.orientnew("H", "Axis", (b, N.z)) if absolute else F.orientnew("H", "Axis", (b, F.z))
    P = O.locatenew("P", l * F.x)
    G = P.locatenew("G", r * H.x)
    scene.add_bodies(Particle("bob", P, m), RigidBody("rod", G, H, M, (inertia(H, 0, 0, A), G)))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def skew_axes():
    """Axes that are no unit vectors along the frames: rotation matrices full of square roots."""
    a, b, s = dynamicsymbols("a b s")
    scene, N, O = start("skew", [a, b, s])
    F = N.orientnew("F", "Axis", (a, N.x + N.y))
    H = F.orientnew("H", "Axis", (b, F.x - 2 * F.y + F.z))
    P = O.locatenew("P", l * F.x + s * (F.y + F.z))
    G = P.locatenew("G", r * (H.x + H.y))
    scene.add_bodies(
        RigidBody("one", P, F, M, (inertia(F, A, B, C), P)), RigidBody("two", G, H, m, (inertia(H, C, A, B), G))
    )
    scene.apply_uniform_gravity(g * (N.x - N.z) / sp.sqrt(2))
    return scene


def stop():
    """A slider against a one-sided spring and dry friction with a threshold."""
    x, y = dynamicsymbols("x y")
    scene, N, O = start("stop", [x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("slider", P, m))
    wall = sp.Piecewise((-k * (x - l), x > l), (0, True))
    friction = -c * sp.Piecewise((y.diff(), sp.Abs(y.diff()) < r), (r * sp.sign(y.diff()), True))
    scene.add_loads((P, wall * N.x + friction * N.y), (P, sp.Max(-y, 0) * k * N.y))
    return scene


def euler(kind, order):
    """A free rigid body, oriented by three angles."""
    x, y, z, a, b, d = dynamicsymbols("x y z a b d")
    scene, N, O = start(f"{kind}_{order}", [x, y, z, a, b, d])
    S = N.orientnew("S", kind, (a, b, d), order)
    G = O.locatenew("G", x * N.x + y * N.y + z * N.z)
    scene.add_bodies(RigidBody("block", G, S, m, (inertia(S, A, B, C, A / 5, B / 7, C / 9), G)))
    scene.add_loads((G.locatenew("P", l * S.x), k * S.y))
    return scene


def explicit_frame():
    """A frame given by its rotation matrix."""
    a, x = dynamicsymbols("a x")
    scene, N, O = start("dcm", [a, x])
    F = ReferenceFrame("F")
    F.orient_explicit(N, sp.Matrix([[cos(a), -sin(a), 0], [sin(a), cos(a), 0], [0, 0, 1]]))
    G = O.locatenew("G", x * F.x + l * F.y)
    scene.add_bodies(RigidBody("plate", G, F, m, (inertia(F, 0, 0, A), G)))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def root_is_not_the_first_frame():
    """Frames and points defined away from the referential: reached against the direction they were written in."""
    a, x = dynamicsymbols("a x")
    body, tip = ReferenceFrame("body"), Point("tip")
    mid = body.orientnew("mid", "Axis", (sp.pi / 7, body.y))
    N = mid.orientnew("N", "Axis", (-a, mid.z))
    G = tip.locatenew("G", -l * body.x)
    O = G.locatenew("O", -x * N.z + r * mid.y)
    scene = da.Scene("backwards", frame=N, origin=O, coordinates=[a, x])
    scene.add_bodies(RigidBody("part", G, body, m, (inertia(body, A, B, C), G)), Particle("bead", tip, M))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def half_angles():
    """A slider on a crank written with half the angle between the two."""
    a, b = dynamicsymbols("a b")
    scene, N, O = start("half_angles", [a, b])
    F = N.orientnew("F", "Axis", ((a + b) / 2, N.z))
    H = F.orientnew("H", "Axis", ((a - b) / 2, F.z))
    P = O.locatenew("P", 2 * l * cos((a - b) / 2) * F.x)
    scene.add_bodies(RigidBody("crank", P, H, m, (inertia(H, 0, 0, A), P)), Particle("p", O.locatenew("Q", r * F.y), M))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


FREE = {
    "particles": particles,
    "inertia without mass": flywheel_without_mass,
    "numbers for parameters": numbers_for_parameters,
    "inertia about another point on another frame": inertia_elsewhere,
    "frame turned by time": turntable,
    "point moved by time": shaken_pendulum,
    "SymPy's forces and torques": sympy_loads,
    "absolute angles": lambda: double_pendulum(True),
    "relative angles": lambda: double_pendulum(False),
    "skew axes": skew_axes,
    "piecewise forces": stop,
    "Body 123": lambda: euler("Body", "123"),
    "Body ZXZ": lambda: euler("Body", "ZXZ"),
    "Space 123": lambda: euler("Space", "123"),
    "Space ZYZ": lambda: euler("Space", "ZYZ"),
    "rotation matrix": explicit_frame,
    "written from the tip to the root": root_is_not_the_first_frame,
    "half angles": half_angles,
}
"""Scenes without constraints; tests compare each with the Lagrange operator."""


def quaternion_body():
    """A free body oriented by Euler parameters, with e.e = 1 as a holonomic constraint: M alone is singular."""
    x, y, z = dynamicsymbols("x y z")
    e = dynamicsymbols("e0 e1 e2 e3")
    scene, N, O = start("quaternion", [x, y, z, *e])
    S = N.orientnew("S", "Quaternion", e)
    G = O.locatenew("G", x * N.x + y * N.y + z * N.z)
    scene.add_bodies(RigidBody("top", G, S, m, (inertia(S, A, B, C), G)))
    scene.add_holonomic_constraints(sum(q**2 for q in e) - 1)
    scene.add_loads((S, k * S.x), (G, -m * g * N.z))
    return scene


def four_bar():
    """A closed chain of three rods, cut at its last joint: two holonomic constraints on three angles."""
    q = dynamicsymbols("q1:4")
    lengths = symbols("l1:4", positive=True)
    scene, N, O = start("four_bar", list(q))
    frame, joint = N, O
    for i, (angle, length) in enumerate(zip(q, lengths, strict=True)):
        frame = frame.orientnew(f"E{i}", "Axis", (angle, frame.z))
        G = joint.locatenew(f"G{i}", length / 2 * frame.x)
        scene.add_bodies(RigidBody(f"rod{i}", G, frame, m, (inertia(frame, 0, 0, m * length**2 / 12), G)))
        joint = joint.locatenew(f"J{i}", length * frame.x)
    closing = joint.pos_from(O) - r * N.x
    scene.add_holonomic_constraints(*(closing.dot(axis) for axis in (N.x, N.y)))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def cartesian_pendulum():
    """A particle held at a distance from the origin by a holonomic constraint."""
    x, y = dynamicsymbols("x y")
    scene, N, O = start("cartesian_pendulum", [x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("bob", P, m))
    scene.add_holonomic_constraints((x**2 + y**2 - l**2) / 2)
    scene.apply_uniform_gravity(-g * N.y)
    S = da.unknowns("S")
    scene.add_joints(da.Joint("string", body="bob", at=P, force=-S * (x * N.x + y * N.y) / l))
    return scene


def unequal_sphere():
    """The rolling sphere with three different principal moments."""
    scene = da.scenes.rolling_sphere()
    sphere = scene.bodies[0]
    central = inertia(sphere.frame, A, B, C), sphere.masscenter
    scene.bodies = (RigidBody("sphere", sphere.masscenter, sphere.frame, sphere.mass, central),)
    return scene
