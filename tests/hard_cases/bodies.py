"""Bodies that spin: free and unstable, heavy and fast, Suslov's, a disk that rolls, a plate that falls on its edge."""

import math
from dataclasses import replace
from functools import cache

import mpmath as mp
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from hard_cases.case import HardCase, reference
from hard_cases.rotations import UNIT, quaternion_frame, spin


def _fixed_point_scene(name, moments, weight=None):
    """Build a body that turns about the fixed point O; `weight` is m g l, the weight's moment on its axis S.z."""
    N, O, S, e = quaternion_frame()
    scene = da.Scene(name, frame=N, origin=O, coordinates=e)
    scene.add_bodies(RigidBody("body", O, S, 1, (inertia(S, *moments), O)))
    if weight is not None:
        scene.bodies[0].potential_energy = weight * S.z.dot(N.z)
        scene.add_loads((S, weight * S.z.cross(-N.z)))
    scene.add_holonomic_constraints(UNIT)
    return scene


_shared_scene = cache(_fixed_point_scene)


def _momentum(scene):
    """Return the components in space of the angular momentum about O."""
    body = scene.bodies[0]
    vector = body.central_inertia.dot(body.frame.ang_vel_in(scene.frame))
    return [vector.dot(axis) for axis in scene.frame]


def _jacobi(t, moments, start):
    """Return the angular velocity of a free body with I1 < I2 < I3 and M^2 > 2 E I2 (Landau, Lifshitz, section 37)."""
    with mp.workdps(40):
        I1, I2, I3 = map(mp.mpf, moments)
        w = [mp.mpf(x) for x in start]
        energy2 = I1 * w[0] ** 2 + I2 * w[1] ** 2 + I3 * w[2] ** 2
        square = (I1 * w[0]) ** 2 + (I2 * w[1]) ** 2 + (I3 * w[2]) ** 2
        a = [
            mp.sqrt((energy2 * I3 - square) / (I1 * (I3 - I1))),
            mp.sqrt((energy2 * I3 - square) / (I2 * (I3 - I2))),
            mp.sqrt((square - energy2 * I1) / (I3 * (I3 - I1))),
        ]
        rate = mp.sqrt((I3 - I2) * (square - energy2 * I1) / (I1 * I2 * I3))
        k2 = (I2 - I1) * (energy2 * I3 - square) / ((I3 - I2) * (square - energy2 * I1))
        # w1 > 0 and w3 > 0 put the start on the branch w = (a1 cn, a2 sn, a3 dn)
        phase = mp.ellipf(mp.asin(w[1] / a[1]), k2)
        u = phase + rate * mp.mpf(t)
        return [
            a[0] * mp.ellipfun("cn", u, m=k2),
            a[1] * mp.ellipfun("sn", u, m=k2),
            a[2] * mp.ellipfun("dn", u, m=k2),
        ]


def free_asymmetric():
    """Ten half turns over in 100 s."""
    return _free((5.0, 20.0, 100.0), 1e-9)


def _free(times, bound):
    entry = reference("free_asymmetric_top")
    moments = symbols("I1:4", positive=True)
    scene = _shared_scene("free_body", moments)
    omega = scene.bodies[0].frame.ang_vel_in(scene.frame)
    rows = {float(row["t"]): [*row["omega_body"], *row["quat"]] for row in entry["values"]["rows"]}
    return HardCase(
        scene=scene,
        parameters={"I1": 1.0, "I2": 2.0, "I3": 3.0},
        initial=spin((1, 0, 0, 0), (0.01, 2.0, 0.02)),
        quantity="omega in the body, quaternion",
        observed=[*(omega.dot(a) for a in scene.bodies[0].frame), "e0", "e1", "e2", "e3"],
        values={t: rows[t] for t in times},
        source=entry["source"] + "; Jacobi's elliptic functions",
        bound=bound,
        conserved=["energy", *_momentum(scene)],
        drift=1e-13,
    )


def free_asymmetric_long():
    """The same over 1000 s, some hundred half turns."""
    case = _free((100.0,), 1e-9)
    times = (100.0, 1000.0)
    values = {t: _jacobi(t, (1, 2, 3), (mp.mpf(0.01), 2, mp.mpf(0.02))) for t in times}
    return HardCase(
        **{
            **{name: getattr(case, name) for name in ("scene", "parameters", "initial", "conserved", "refused")},
            "observed": case.observed[:3],
            "quantity": "omega in the body",
            "values": values,
            "source": "Jacobi's elliptic functions in 40 digits",
            "bound": 1e-9,
            "drift": 1e-12,
            "report_only": (1000.0,),
        }
    )


def _heavy_top(name, tilt, spin_rate, precession, quaternion, bound):
    A, C, weight = symbols("A C mgl", positive=True)
    scene = _shared_scene("heavy_top", (A, A, C), weight)
    S = scene.bodies[0].frame
    # steady precession: the angular velocity is Om e_z and a spin about the axis; the body starts tilted about N.x
    start = spin(
        (math.cos(tilt / 2), math.sin(tilt / 2), 0, 0),
        (0.0, precession * math.sin(tilt), spin_rate),
    )
    return HardCase(
        scene=scene,
        parameters={"A": 0.5, "C": 0.2, "mgl": 2.0},
        initial=start,
        quantity="quaternion, cos of the tilt",
        observed=["e0", "e1", "e2", "e3", S.z.dot(scene.frame.z)],
        values={10.0: [*quaternion, math.cos(tilt)]},
        source=name,
        bound=bound,
        conserved=["energy", _momentum(scene)[2], S.ang_vel_in(scene.frame).dot(S.z)],
    )


def _tabled_top(name, bound):
    entry = reference("heavy_top")
    data = entry["values"][name]
    return _heavy_top(entry["source"], math.pi / 3, 12.0, float(data["Omega"]), data["quat_t10"], bound)


def slow_precession():
    """Steady precession at 60 degrees, the slow root."""
    return _tabled_top("b_slow", 1e-12)


def fast_precession():
    """Steady precession at 60 degrees, the fast root, 8.7 rad/s."""
    return _tabled_top("b_fast", 1e-12)


def fast_top():
    """Spin 300 rad/s: 480 turns in 10 s."""
    tilt, spin_rate, t = math.pi / 3, 300.0, 10
    with mp.workdps(40):
        A, C, weight, angle = mp.mpf("0.5"), mp.mpf("0.2"), mp.mpf(2), mp.mpf(tilt)
        root = mp.sqrt((C * spin_rate) ** 2 - 4 * A * weight * mp.cos(angle))
        precession = 2 * weight / (C * spin_rate + root)
        # turn Om t about N.z, the tilt about x, the proper rotation about the axis
        proper = (spin_rate - precession * mp.cos(angle)) * t / 2
        half, turn = angle / 2, precession * t / 2
        quaternion = [
            mp.cos(half) * mp.cos(turn + proper),
            mp.sin(half) * mp.cos(turn - proper),
            mp.sin(half) * mp.sin(turn - proper),
            mp.cos(half) * mp.sin(turn + proper),
        ]
    return _heavy_top("closed form of steady precession", tilt, spin_rate, float(precession), quaternion, 2e-10)


def upright_top():
    """Starts upright, where three angles would lock, and passes there every 2.8 s."""
    entry = reference("heavy_top_upright")
    return replace(
        _tabled_top("b_slow", 1e-12),
        initial=spin((1, 0, 0, 0), (1.0, 0.0, 3.0)),
        values={float(row["t"]): row["state"] for row in entry["values"]},
        source=entry["source"],
    )


def suslov():
    """A constraint in the body's frame, omega . S.z = 0; the motion is not reversible."""
    entry = reference("suslov_attitude")
    I11, I22, I33, I13 = symbols("I11 I22 I33 I13", positive=True)
    scene = _fixed_point_scene("suslov", (I11, I22, I33, 0, 0, I13))
    S = scene.bodies[0].frame
    omega = S.ang_vel_in(scene.frame)
    scene.add_nonholonomic_constraints(omega.dot(S.z))
    values = {float(row["t"]): [row["omega1"], row["omega2"], *row["quat"]] for row in entry["values"]}
    return HardCase(
        scene=scene,
        parameters={"I11": 1.0, "I22": 2.0, "I33": 2.5, "I13": 0.6},
        initial=spin((1, 0, 0, 0), (0.8, -0.5, 0.0)),
        quantity="omega in the body, quaternion",
        observed=[omega.dot(S.x), omega.dot(S.y), "e0", "e1", "e2", "e3"],
        values=values,
        source=entry["source"],
        bound=2e-14,
    )


def _disk_scene():
    X, Y, psi, theta, phi = dynamicsymbols("X Y psi theta phi")
    m, a, g = symbols("m a g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (psi, N.z))
    B = A.orientnew("B", "Axis", (theta, A.x))
    S = B.orientnew("S", "Axis", (phi, B.z))
    contact = O.locatenew("I", X * N.x + Y * N.y)
    G = contact.locatenew("G", a * B.y)
    scene = da.Scene("rolling_disk", frame=N, origin=O, coordinates=[X, Y, psi, theta, phi])
    scene.add_bodies(RigidBody("disk", G, S, m, (inertia(S, m * a**2 / 4, m * a**2 / 4, m * a**2 / 2), G)))
    scene.apply_uniform_gravity(-g * N.z)
    slip = G.pos_from(O).dt(N) + S.ang_vel_in(N).cross(-a * B.y)
    scene.add_nonholonomic_constraints(slip.dot(A.x), slip.dot(A.y))
    return scene


def wobbling_disk():
    """A thin disk that rolls and leans."""
    entry = reference("rolling_disk_313")
    data = entry["values"]["wobble"]
    theta, phi_dot, psi_dot = (float(data[key]) for key in ("theta0", "phid", "psid"))
    psi, th, phi = dynamicsymbols("psi theta phi")
    observed = ["psi", "theta", "phi", "theta_dot", psi.diff() * sin(th), phi.diff() + psi.diff() * cos(th), "X", "Y"]
    return HardCase(
        scene=_disk_scene(),
        parameters={"m": 1.0, "a": 0.5, "g": 9.81},
        initial={
            **{"X": 0.0, "Y": 0.0, "psi": 0.0, "theta": theta, "phi": 0.0},
            **{"psi_dot": psi_dot, "theta_dot": float(data["thd"]), "phi_dot": phi_dot},
        },
        quantity="angles, omega in the disk, contact point",
        observed=observed,
        values={
            float(row["t"]): [*(row[key] for key in ("psi", "theta", "phi", "p", "q", "r")), *row["contact_xy"]]
            for row in data["rows"]
        },
        source=entry["source"],
        bound=5e-12,
    )


def vertical_disk():
    """An upright disk that rolls on a circle."""
    entry = reference("vertical_rolling_disk")
    x, y, phi, theta = dynamicsymbols("x y phi theta")
    m, R, I, J = symbols("m R I J", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (phi, N.z))
    S = A.orientnew("S", "Axis", (theta, A.y))
    G = O.locatenew("G", x * N.x + y * N.y + R * N.z)
    scene = da.Scene("vertical_disk", frame=N, origin=O, coordinates=[x, y, phi, theta])
    scene.add_bodies(RigidBody("disk", G, S, m, (inertia(S, J, I, J), G)))
    slip = G.pos_from(O).dt(N) + S.ang_vel_in(N).cross(-R * N.z)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "R": 0.5, "I": 0.125, "J": 0.0625},
        initial={"x": 0.0, "y": 0.0, "phi": 0.3, "theta": 0.0, "phi_dot": 0.7, "theta_dot": 3.0},
        quantity="x, y, both angles",
        observed=["x", "y", phi - 0.3, "theta"],
        values={
            float(row["t"]): [row["x"], row["y"], float(row["phi"]) - 0.3, row["theta"]] for row in entry["values"]
        },
        source=entry["source"],
        bound=1e-13,
    )


def edge_plate():
    """From rest at theta = 1.2; F couples the fall to a turn."""
    entry = reference("edge_plate_flat")
    psi, theta = dynamicsymbols("psi theta")
    B, C = symbols("B C", positive=True)
    F = symbols("F", real=True)
    momentum = psi.diff() * (B * sin(theta) ** 2 + C * cos(theta) ** 2) + F * theta.diff() * sin(theta)
    return HardCase(
        scene=da.scenes.edge_plate(),
        parameters={key: float(x) for key, x in entry["values"]["parameters"].items()},
        initial={
            **{"x": 0.1, "y": -0.2, "psi": 0.3, "theta": 1.2},
            **{"x_dot": 0.5, "y_dot": 0.0, "psi_dot": 0.0, "theta_dot": 0.0},
        },
        observed=["theta", "theta_dot", "psi", "psi_dot", "z"],
        values={float(row["t"]): row["state"] for row in entry["values"]["rows"]},
        source=entry["source"],
        bound=2e-15,
        conserved=["energy", momentum, "x_dot", "y_dot"],
    )


CASES = {
    "free body near its unstable axis": free_asymmetric,
    "free body, a hundred tumbles": free_asymmetric_long,
    "heavy top, slow precession": slow_precession,
    "heavy top, fast precession": fast_precession,
    "heavy top, fast": fast_top,
    "heavy top from upright": upright_top,
    "Suslov body": suslov,
    "rolling disk": wobbling_disk,
    "vertical disk": vertical_disk,
    "edge plate falling flat": edge_plate,
}
