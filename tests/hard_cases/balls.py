"""Balls that roll: through theta = 0, on a turntable, on an incline, with unequal moments, off their centre of mass."""

import math
from functools import cache

from sympy import Rational, cos, sin, sqrt, symbols
from sympy.physics.mechanics import RigidBody, dynamicsymbols, inertia

import dalembert as da
from hard_cases.case import HardCase, reference
from hard_cases.rotations import UNIT, matrix_entries, quaternion_frame, spin

ANGLES = dynamicsymbols("psi theta phi")


def _sphere_start(psi, theta, phi, omega):
    """Return angles and their rates of a sphere at the origin with this angular velocity in space."""
    wx, wy, wz = omega
    along, across = wx * math.cos(psi) + wy * math.sin(psi), -wx * math.sin(psi) + wy * math.cos(psi)
    phi_dot = -across / math.sin(theta)
    rates = {"psi_dot": wz - phi_dot * math.cos(theta), "theta_dot": along, "phi_dot": phi_dot}
    return {"x": 0.0, "y": 0.0, "psi": psi, "theta": theta, "phi": phi, **rates}


_sphere = cache(da.scenes.rolling_sphere)


def _euler(name, bound, **options):
    entry = reference("rolling_sphere_313_euler")
    data = entry["values"][name]
    omega = [float(w) for w in data["omega_space"]]
    start = _sphere_start(float(data["psi0"]), float(data["theta0"]), float(data["phi0"]), omega)
    scene = _sphere()
    frame = scene.bodies[0].frame
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "r": 0.5, "g": 9.81},
        initial=start,
        quantity="rotation matrix, x, y",
        observed=[*matrix_entries(scene.frame, frame), "x", "y"],
        values=_attitudes(data),
        source=entry["source"],
        bound=bound,
        **options,
    )


def generic():
    """Away from the singularity of its angles."""
    return _euler("generic", 1e-12)


def through_theta_0_in_angles():
    """The mass matrix of the angles is singular at t = 1."""
    return _euler("through_theta_0", 1e-12, may_fail="3-1-3 angles are singular at theta = 0")


def through_theta_0():
    """Passes the singularity of 3-1-3 angles, with a quaternion."""
    entry = reference("rolling_sphere_313_euler")
    data = entry["values"]["through_theta_0"]
    psi, theta, phi = (float(data[name]) for name in ("psi0", "theta0", "phi0"))
    together, apart = (psi + phi) / 2, (psi - phi) / 2
    e = (
        math.cos(theta / 2) * math.cos(together),
        math.sin(theta / 2) * math.cos(apart),
        math.sin(theta / 2) * math.sin(apart),
        math.cos(theta / 2) * math.sin(together),
    )
    # the angular velocity is minus the line of nodes, which the body sees at the angle -phi
    start = spin(e, (-math.cos(phi), math.sin(phi), 0.0))
    m, R = symbols("m R", positive=True)
    J = Rational(2, 5) * m * R**2
    scene = ball_scene((J, J, J))
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "R": 0.5},
        initial={"x": 0.0, "y": 0.0, **start},
        quantity="rotation matrix, x, y",
        observed=[*matrix_entries(scene.frame, scene.bodies[0].frame), "x", "y"],
        values=_attitudes(data),
        source=entry["source"],
        bound=1e-13,
    )


def _attitudes(data):
    """Return rotation matrices and centres of a sphere of radius 1/2."""
    return {
        float(row["t"]): [
            *(x for line in row["R"] for x in line),
            *(0.5 * float(x) for x in row["centre_xy_over_a"]),
        ]
        for row in data["rows"]
    }


def ball_scene(moments, *, at=None, surface=None, frame_gravity=None):
    """Build a ball of radius R whose centre G rolls without slip, with a quaternion for its attitude.

    `surface` (x, y) -> vector is the velocity of the plane at the contact point.
    """
    x, y = dynamicsymbols("x y")
    m, R = symbols("m R", positive=True)
    N, O, S, e = quaternion_frame()
    centre = O.locatenew("P", x * N.x + y * N.y + R * N.z)
    G = centre if at is None else centre.locatenew("G", at(S))
    scene = da.Scene("rolling_ball", frame=N, origin=O, coordinates=[x, y, *e])
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, *moments), G)))
    if frame_gravity is not None:
        scene.apply_uniform_gravity(frame_gravity(N))
    omega = S.ang_vel_in(N)
    slip = x.diff() * N.x + y.diff() * N.y + omega.cross(-R * N.z)
    if surface is not None:
        slip -= surface(N, x, y)
    scene.add_holonomic_constraints(UNIT)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
    return scene


def chaplygin_sphere(times=(1.0, 10.0, 50.0)):
    """Energy and the angular momentum about the contact are conserved."""
    entry = reference("chaplygin_sphere")
    I1, I2, I3, m, R = symbols("I1 I2 I3 m R", positive=True)
    scene = ball_scene((I1, I2, I3))
    N, S = scene.frame, scene.bodies[0].frame
    omega = S.ang_vel_in(N)
    at_contact = scene.bodies[0].central_inertia.dot(omega) + m * R**2 * (omega - omega.dot(N.z) * N.z)
    values = {
        float(row["t"]): [*row["quat"], *row["omega"], *row["cm_xy"]]
        for row in entry["values"]["rows"]
        if float(row["t"]) in times
    }
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "R": 1.0, "I1": 0.3, "I2": 0.45, "I3": 0.6},
        initial={"x": 0.0, "y": 0.0, **spin((1, 0, 0, 0), (0.7, 1.1, -0.4))},
        quantity="quaternion, omega in the body, x, y",
        observed=["e0", "e1", "e2", "e3", *(omega.dot(a) for a in S), "x", "y"],
        values=values,
        source=entry["source"],
        bound=5e-13,
        conserved=["energy", *(at_contact.dot(a) for a in N)],
        drift=1e-13,
    )


def routh_sphere():
    """The centre of mass beside the centre; Jellett's and Routh's integrals beside the energy."""
    entry = reference("routh_sphere")
    A, C, m, R, e, g = symbols("A C m R e g", positive=True)
    scene = ball_scene((A, A, C), at=lambda S: -e * S.z, frame_gravity=lambda N: -g * N.z)
    N, S = scene.frame, scene.bodies[0].frame
    omega = S.ang_vel_in(N)
    d = e * S.z - R * N.z  # from the mass centre to the contact
    momentum = scene.bodies[0].central_inertia.dot(omega)
    d3 = d.dot(S.z)
    across = d.dot(S.x) ** 2 + d.dot(S.y) ** 2
    x, y = dynamicsymbols("x y")
    values = {
        float(row["t"]): [*row["quat"], *row["omega"], *row["cm_xy"], row["cos_theta"]]
        for row in entry["values"]["rows"]
    }
    offset = e * S.z
    start = spin((math.cos(0.15), math.sin(0.15), 0, 0), (0.2, 0.1, 6.0))
    lean = (0.0, -math.sin(0.3))  # S.z at the start, horizontally
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "R": 1.0, "e": 0.2, "A": 0.35, "C": 0.4, "g": 9.81},
        initial={"x": 0.2 * lean[0], "y": 0.2 * lean[1], **start},
        quantity="quaternion, omega in the body, mass centre, cos of the tilt",
        observed=[
            *("e0", "e1", "e2", "e3"),
            *(omega.dot(a) for a in S),
            x - offset.dot(N.x),
            y - offset.dot(N.y),
            S.z.dot(N.z),
        ],
        values=values,
        source=entry["source"],
        bound=1e-12,
        conserved=[
            "energy",
            -momentum.dot(d),
            omega.dot(S.z) ** 2 * (A * C + m * (A * across + C * d3**2)),
        ],
    )


@cache
def _turntable_scene():
    m, R, Om, gs = symbols("m R Om gs", positive=True)
    J = Rational(2, 5) * m * R**2
    return ball_scene(
        (J, J, J), surface=lambda N, x, y: Om * N.z.cross(x * N.x + y * N.y), frame_gravity=lambda N: gs * N.x
    )


def _turntable(name, slope, bound):
    entry = reference("ball_on_turntable")
    scene = _turntable_scene()
    rows = entry["values"][name]
    values = {float(row["t"]): [row[key] for key in ("x", "y", "vx", "vy")] for row in rows}
    # v = omega x R z + Om z x r with v = (0, 1), r = (1/2, 0), Om = 3, R = 1/2
    omega = ((1.5 - 1.0) / 0.5, 0.0, 0.7)
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "R": 0.5, "Om": 3.0, "gs": slope},
        initial={"x": 0.5, "y": 0.0, **spin((1, 0, 0, 0), omega)},
        observed=["x", "y", "x_dot", "y_dot"],
        values=values,
        source=entry["source"],
        bound=bound,
        conserved=(),
    )


def turntable():
    """The constraint has a part without rates, energy is not conserved, the path is a circle."""
    return _turntable("level", 0.0, 1e-12)


def tilted_turntable():
    """The plane turns and slopes: the path is a cycloid."""
    return _turntable("tilted", 0.4, 5e-11)


def incline():
    """Rolls up and down a slope: the acceleration is 5/7 g sin(alpha)."""
    scene = da.scenes.rolling_sphere()
    alpha, g = symbols("alpha g", positive=True)
    N = scene.frame
    scene.apply_uniform_gravity(g * (sin(alpha) * N.x - cos(alpha) * N.z))
    start = _sphere_start(0.4, 1.1, -0.3, (0.3, -2.0, 0.9))
    pull = 5 / 7 * 9.81 * math.sin(0.4)

    def exact(t):
        return [-t + pull * t * t / 2, -0.15 * t, -1.0 + pull * t, -0.15]

    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "r": 0.5, "g": 9.81, "alpha": 0.4},
        initial=start,
        observed=["x", "y", "x_dot", "y_dot"],
        values={t: exact(t) for t in (1.0, 5.0)},
        source="closed form: uniform acceleration 5/7 g sin(alpha)",
        bound=2e-14,
    )


def sliding():
    """Friction is along the slip, whose direction is constant."""
    x, y = dynamicsymbols("x y")
    m, R, g, mu = symbols("m R g mu", positive=True)
    N, O, S, e = quaternion_frame()
    G = O.locatenew("G", x * N.x + y * N.y + R * N.z)
    scene = da.Scene("billiard_ball", frame=N, origin=O, coordinates=[x, y, *e])
    J = Rational(2, 5) * m * R**2
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, J, J, J), G)))
    scene.add_holonomic_constraints(UNIT)
    slip = x.diff() * N.x + y.diff() * N.y + S.ang_vel_in(N).cross(-R * N.z)
    along = [slip.dot(N.x), slip.dot(N.y)]
    friction = -mu * m * g / sqrt(along[0] ** 2 + along[1] ** 2) * (along[0] * N.x + along[1] * N.y)
    scene.add_loads((G, friction), (S, (-R * N.z).cross(friction)))
    v, omega, radius, pull = (2.0, 0.5), (20.0, -60.0, 15.0), 0.03, 0.2 * 9.81
    u = (v[0] - radius * omega[1], v[1] + radius * omega[0])
    unit = [a / math.hypot(*u) for a in u]

    def exact(t):
        spin_rate = [omega[0] + 2.5 * pull * t * -unit[1] / radius, omega[1] + 2.5 * pull * t * unit[0] / radius]
        place = [a * t - pull * t * t / 2 * b for a, b in zip(v, unit, strict=True)]
        return [*place, *(a - pull * t * b for a, b in zip(v, unit, strict=True)), *spin_rate, omega[2]]

    space = S.ang_vel_in(N)
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "R": radius, "g": 9.81, "mu": 0.2},
        initial={"x": 0.0, "y": 0.0, "x_dot": v[0], "y_dot": v[1], **spin((1, 0, 0, 0), omega)},
        observed=["x", "y", "x_dot", "y_dot", *(space.dot(axis) for axis in N)],
        quantity="position, velocity, omega in space",
        values={t: exact(t) for t in (0.2, 0.5)},
        source="closed form: the slip keeps its direction and shrinks by (7/2) mu g; Euler",
        bound=1e-11,
        conserved=(),
    )


CASES = {
    "sphere, 3-1-3 angles": generic,
    "sphere through theta = 0": through_theta_0,
    "sphere through theta = 0, in angles": through_theta_0_in_angles,
    "sphere with unequal moments": chaplygin_sphere,
    "Routh sphere": routh_sphere,
    "sphere on a turntable": turntable,
    "sphere on a tilted turntable": tilted_turntable,
    "sphere on an incline": incline,
    "billiard ball that slides": sliding,
}
