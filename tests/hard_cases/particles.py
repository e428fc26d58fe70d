"""Particles and knife edges with nonholonomic constraints, and pendulums in one coordinate too many."""

import math

from sympy import cos, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from hard_cases.case import HardCase, reference
from hard_cases.rotations import NO_CLOSED_FORM


def _point(name, coordinates, *, mass=1):
    q = dynamicsymbols(coordinates)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", sum((x * axis for x, axis in zip(q, N, strict=False)), 0 * N.x))
    scene = da.Scene(name, frame=N, origin=O, coordinates=q)
    scene.add_bodies(Particle("particle", P, mass))
    return scene, q


def knife_edge():
    """Turns through pi/2 again and again, and does not descend."""
    entry = reference("knife_edge_on_incline")
    x, y, phi = dynamicsymbols("x y phi")
    m, J, g, alpha = symbols("m J g alpha", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (phi, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    scene = da.Scene("knife_edge", frame=N, origin=O, coordinates=[x, y, phi])
    scene.add_bodies(RigidBody("blade", C, S, m, (inertia(S, 0, 0, J), C)))
    scene.apply_uniform_gravity(g * (sin(alpha) * N.x - cos(alpha) * N.z))
    scene.add_nonholonomic_constraints(x.diff() * sin(phi) - y.diff() * cos(phi))
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "J": 0.5, "g": 9.81, "alpha": 0.4},
        initial={"x": 0.0, "y": 0.0, "phi": 0.0, "x_dot": 0.0, "y_dot": 0.0, "phi_dot": 1.3},
        observed=["x", "y", "phi", "x_dot", "y_dot"],
        values={float(row["t"]): [row[k] for k in ("x", "y", "phi", "vx", "vy")] for row in entry["values"]},
        source=entry["source"],
        bound=1e-13,
    )


def rosenberg():
    """z_dot = y x_dot: the vakonomic equations give another motion."""
    entry = reference("nonholonomic_particle_free")
    scene, (x, y, z) = _point("rosenberg_particle", "x y z")
    scene.add_nonholonomic_constraints(z.diff() - y * x.diff())
    return HardCase(
        scene=scene,
        parameters={},
        initial={"x": 0.1, "y": -2.0, "z": 0.4, "x_dot": 1.2, "y_dot": 0.9, "z_dot": -2.4},
        observed=["x", "y", "z", "x_dot", "y_dot", "z_dot"],
        values={float(row["t"]): [row[k] for k in ("x", "y", "z", "vx", "vy", "vz")] for row in entry["values"]},
        source=entry["source"],
        bound=3e-14,
    )


def heisenberg():
    """z_dot = y x_dot - x y_dot: straight lines, where the vakonomic equations give helices."""
    entry = reference("heisenberg_free")
    scene, (x, y, z) = _point("heisenberg_particle", "x y z")
    scene.add_nonholonomic_constraints(z.diff() - y * x.diff() + x * y.diff())
    return HardCase(
        scene=scene,
        parameters={},
        initial={"x": 0.3, "y": -0.7, "z": 0.2, "x_dot": 1.1, "y_dot": 0.5},
        observed=["x", "y", "z"],
        values={float(row["t"]): [row[k] for k in ("x", "y", "z")] for row in entry["values"]},
        source=entry["source"],
        bound=2e-15,
    )


def cartesian_pendulum():
    """x^2 + y^2 = 1 over 100 s."""
    entry = reference("iftomm_A01_pendulum")
    scene, (x, y) = _point("cartesian_pendulum", "x y", mass=symbols("m", positive=True))
    scene.apply_uniform_gravity(-symbols("g", positive=True) * scene.frame.y)
    scene.add_holonomic_constraints(x**2 + y**2 - 1)
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "g": 9.81},
        initial={"x": -1.0, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0},
        observed=["x", "y", "x_dot", "y_dot"],
        values={float(row["t"]): [row[k] for k in ("x", "y", "vx", "vy")] for row in entry["values"]},
        source=entry["source"],
        bound=5e-12,
        refused=NO_CLOSED_FORM,
    )


def spherical_pendulum():
    """Passes the lower pole, where spherical angles are nearly singular."""
    entry = reference("spherical_pendulum_near_poles")
    scene, (x, y, z) = _point("spherical_pendulum", "x y z")
    scene.apply_uniform_gravity(-symbols("g", positive=True) * scene.frame.z)
    scene.add_holonomic_constraints(x**2 + y**2 + z**2 - 1)
    return HardCase(
        scene=scene,
        parameters={"g": 9.81},
        initial={"x": 0.6, "y": 0.0, "z": 0.8, "x_dot": 0.08, "y_dot": 0.01, "z_dot": -0.06},
        observed=["x", "y", "z", "x_dot", "y_dot", "z_dot"],
        values={float(row["t"]): [*(row[k] for k in ("x", "y", "z")), *row["v"]] for row in entry["values"]["rows"]},
        source=entry["source"],
        bound=1e-11,
        conserved=["energy", x * y.diff() - y * x.diff()],
        refused=NO_CLOSED_FORM,
    )


def spring_pendulum():
    """Stiffness 1e6: 160 oscillations of the spring a second upon the swing."""
    entry = reference("stiff_spring_pendulum")
    scene, (x, y) = _point("spring_pendulum", "x y", mass=symbols("m", positive=True))
    g, k, l = symbols("g k l", positive=True)
    N, P = scene.frame, scene.bodies[0].point
    scene.apply_uniform_gravity(-g * N.y)
    length = sqrt(x**2 + y**2)
    scene.bodies[0].potential_energy = k * (length - l) ** 2 / 2
    scene.add_loads((P, -k * (length - l) / length * (x * N.x + y * N.y)))
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "g": 9.81, "k": 1e6, "l": 1.0},
        initial={"x": 1.0, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0},
        observed=["x", "y", "x_dot", "y_dot"],
        values={float(row["t"]): row["state"] for row in entry["values"]},
        source=entry["source"],
        bound=5e-11,
    )


def _angles(count):
    names = [f"theta{i + 1}" for i in range(count)]
    q = dynamicsymbols(" ".join(names))
    g = symbols("g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pendulum_chain", frame=N, origin=O, coordinates=q)
    point = O
    for i, angle in enumerate(q):
        rod = N.orientnew(f"R{i + 1}", "Axis", (angle, N.z))
        point = point.locatenew(f"P{i + 1}", -rod.y)
        scene.add_bodies(Particle(f"bob{i + 1}", point, 1))
    scene.apply_uniform_gravity(-g * N.y)
    return scene, names


def double_pendulum():
    """Chaotic: errors grow by 8e8 in 20 s."""
    entry = reference("double_pendulum")
    scene, names = _angles(2)
    rates = [f"{name}_dot" for name in names]
    growth = {float(row["t"]): float(row["dtheta_over_1e_20"]) for row in entry["values"]["sensitivity"]}
    return HardCase(
        scene=scene,
        parameters={"g": 9.81},
        initial={**dict.fromkeys(names, 2.0), **dict.fromkeys(rates, 0.0)},
        observed=[*names, *rates],
        values={float(row["t"]): [row[k] for k in ("theta1", "theta2", "w1", "w2")] for row in entry["values"]["rows"]},
        source=entry["source"],
        bound=100 * growth[20.0] * 2.2e-16,
        drift=1e-13,
    )


def double_pendulum_cartesian():
    """The same with four Cartesian coordinates and two rods."""
    entry = reference("double_pendulum")
    x1, y1, x2, y2 = q = dynamicsymbols("x1 y1 x2 y2")
    g = symbols("g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("double_pendulum_cartesian", frame=N, origin=O, coordinates=q)
    for i, (x, y) in enumerate(((x1, y1), (x2, y2))):
        scene.add_bodies(Particle(f"bob{i + 1}", O.locatenew(f"P{i + 1}", x * N.x + y * N.y), 1))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x1**2 + y1**2 - 1, (x2 - x1) ** 2 + (y2 - y1) ** 2 - 1)
    values = {}
    for row in entry["values"]["rows"]:
        a, b = float(row["theta1"]), float(row["theta2"])
        first = [math.sin(a), -math.cos(a)]
        values[float(row["t"])] = [*first, first[0] + math.sin(b), first[1] - math.cos(b)]
    start = [math.sin(2), -math.cos(2), 2 * math.sin(2), -2 * math.cos(2)]
    names = ["x1", "y1", "x2", "y2"]
    return HardCase(
        scene=scene,
        parameters={"g": 9.81},
        initial={**dict(zip(names, start, strict=True)), **{f"{name}_dot": 0.0 for name in names}},
        observed=names,
        values=values,
        source=entry["source"],
        # With g changed by an ulp or a few, errors are between 4e-7 and 6e-5 (13 runs each, before and after products
        # in loops were fused only where they say so): what the amplification makes of the rounding of 1000 steps.
        bound=1000 * 7.782e8 * 2.2e-16,
        drift=1e-13,
        refused=NO_CLOSED_FORM,
    )


def chain_of_8():
    """Eight bobs, a dense mass matrix, and a tip that whips."""
    entry = reference("n_pendulum_chain_8")
    scene, names = _angles(8)
    rates = [f"{name}_dot" for name in names]
    return HardCase(
        scene=scene,
        parameters={"g": 9.81},
        initial={**dict.fromkeys(names, 1.5), **dict.fromkeys(rates, 0.0)},
        quantity="angles and rates",
        observed=[*names, *rates],
        values={float(row["t"]): [*row["theta"], *row["omega"]] for row in entry["values"]},
        source=entry["source"],
        bound=1e-11,
    )


CASES = {
    "knife edge on an incline": knife_edge,
    "Rosenberg's particle": rosenberg,
    "Heisenberg's particle": heisenberg,
    "pendulum, Cartesian (IFToMM A01)": cartesian_pendulum,
    "spherical pendulum near its pole": spherical_pendulum,
    "stiff spring pendulum": spring_pendulum,
    "double pendulum, angles": double_pendulum,
    "double pendulum, Cartesian": double_pendulum_cartesian,
    "chain of 8 pendulums": chain_of_8,
}
