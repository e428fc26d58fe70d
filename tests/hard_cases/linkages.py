"""Linkages of published benchmarks: Bricard's, many windows of four bars, and four bars with a diagonal spring."""

import math

from sympy import cos, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, Vector, dynamicsymbols, inertia

import dalembert as da
from hard_cases.case import HardCase, published_reference

CORNERS = ((0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1))
"""Joints of Bricard's mechanism at the start, corners of a cube."""

AXES = "yzxyz"
"""Axes of its first five joints at the start; the sixth turns about x."""


def bricard_scene():
    """Build five equal rods of square cross section in a chain, closed by a sixth hinge about N.x."""
    q = dynamicsymbols("a1:6")
    m, L, w, g = symbols("m L w g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bricard", frame=N, origin=O, coordinates=q)
    along, across = m * w**2 / 6, m * (L**2 + w**2) / 12
    frame, joint = N, O
    for i, (angle, axis) in enumerate(zip(q, AXES, strict=True)):
        frame = frame.orientnew(f"B{i + 1}", "Axis", (angle, getattr(frame, axis)))
        ends = [b - a for a, b in zip(CORNERS[i], CORNERS[i + 1], strict=True)]
        arm = sum((L * d * e for d, e in zip(ends, (frame.x, frame.y, frame.z), strict=True)), Vector(0))
        G = joint.locatenew(f"G{i + 1}", arm / 2)
        moments = [along if d else across for d in ends]
        scene.add_bodies(RigidBody(f"rod{i + 1}", G, frame, m, (inertia(frame, *moments), G)))
        joint = joint.locatenew(f"P{i + 1}", arm)
    scene.apply_uniform_gravity(-g * N.y)
    gap = joint.pos_from(O.locatenew("E", L * N.z))
    scene.add_holonomic_constraints(*(gap.dot(e) for e in (N.x, N.y, N.z)))
    scene.add_holonomic_constraints(frame.x.dot(N.y), frame.x.dot(N.z))
    return scene


def bricard():
    """IFToMM A04: no degree of freedom by Gruebler's formula, one in fact; one of five constraints is redundant."""
    entry = published_reference("iftomm_A04_bricard")
    a1, a2 = dynamicsymbols("a1 a2")
    corner = (cos(a1) * (1 + sin(a2)), -cos(a2), -sin(a1) * (1 + sin(a2)))
    names = [f"a{i}" for i in range(1, 6)]
    return HardCase(
        scene=bricard_scene(),
        parameters={"m": 1.0, "L": 1.0, "w": 0.1, "g": 9.81},
        initial=dict.fromkeys([*names, *(f"{name}_dot" for name in names)], 0.0),
        quantity="end of the second rod, angle of the first and its rate",
        observed=[*corner, a1, "a1_dot"],
        values={float(row["t"]): row["state"] for row in entry["values"]},
        source=entry["source"],
        bound=1e-12,
    )


def windows_scene(count):
    """Build `count` windows of four bars of length 1 side by side, on the ground."""
    phi = dynamicsymbols(" ".join(f"phi{i}" for i in range(count + 1)))
    psi = dynamicsymbols(" ".join(f"psi{i}" for i in range(count)) + " ,")
    m, g = symbols("m g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(f"windows_{count}", frame=N, origin=O, coordinates=[*phi, *psi])
    tops = []
    for i, angle in enumerate(phi):
        base = O.locatenew(f"A{i}", i * N.x)
        crank = N.orientnew(f"C{i}", "Axis", (-angle, N.z))
        G = base.locatenew(f"G{i}", crank.y / 2)
        scene.add_bodies(RigidBody(f"crank{i}", G, crank, m, (inertia(crank, 0, 0, m / 12), G)))
        tops.append(base.locatenew(f"B{i}", crank.y))
    for i, angle in enumerate(psi):
        bar = N.orientnew(f"D{i}", "Axis", (angle, N.z))
        G = tops[i].locatenew(f"H{i}", bar.x / 2)
        scene.add_bodies(RigidBody(f"bar{i}", G, bar, m, (inertia(bar, 0, 0, m / 12), G)))
        gap = tops[i + 1].pos_from(tops[i].locatenew(f"E{i}", bar.x))
        scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def forty_windows():
    """IFToMM A02, forty windows: 81 bodies, 80 constraints, until just before the cranks lie down."""
    entry = published_reference("iftomm_A02_forty_windows")
    scene = windows_scene(40)
    phi = scene.coordinates[0]
    angles = [str(q.func) for q in scene.coordinates]
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "g": 9.81},
        initial={**dict.fromkeys(angles, 0.0), "phi0_dot": 1.0},
        quantity="position and velocity of the first upper corner",
        observed=[sin(phi), cos(phi), phi.diff() * cos(phi), -phi.diff() * sin(phi)],
        values={float(row["t"]): row["state"] for row in entry["values"]},
        source=entry["source"],
        bound=1e-11,
        rtol=1e-12,
        atol=1e-14,
        report_only=(1.0, 4.0),
    )


def level_windows_scene(count):
    """Build the cranks of A02, and bars that do not turn: each window has two conditions of rank one."""
    angles = dynamicsymbols(f"phi0:{count + 1}")
    m, g = symbols("m g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(f"level_windows_{count}", frame=N, origin=O, coordinates=angles)
    tops = []
    for i, angle in enumerate(angles):
        base = O.locatenew(f"A{i}", i * N.x)
        crank = N.orientnew(f"C{i}", "Axis", (-angle, N.z))
        G = base.locatenew(f"G{i}", crank.y / 2)
        scene.add_bodies(RigidBody(f"crank{i}", G, crank, m, (inertia(crank, 0, 0, m / 12), G)))
        tops.append(base.locatenew(f"B{i}", crank.y))
        if i:
            scene.add_bodies(Particle(f"bar{i}", tops[i - 1].locatenew(f"H{i}", N.x / 2), m))
            gap = tops[i - 1].pos_from(tops[i]) + N.x
            scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def level_windows():
    """IFToMM A02, forty windows whose bars do not turn: 80 conditions of rank 40, over all quarters."""
    entry, scene = published_reference("iftomm_A02_forty_windows"), level_windows_scene(40)
    phi = scene.coordinates[0]
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "g": 9.81},
        initial={**dict.fromkeys([str(q.func) for q in scene.coordinates], 0.0), "phi0_dot": 1.0},
        quantity="position and velocity of the first upper corner",
        observed=[sin(phi), cos(phi), phi.diff() * cos(phi), -phi.diff() * sin(phi)],
        values={float(row["t"]): row["state"] for row in entry["values"]},
        source=entry["source"],
        bound=1e-10,
        rtol=1e-12,
        atol=1e-14,
    )


def spring_linkage_scene():
    """Build three rods on two pivots, and a damped spring from the first pivot to the end of the third rod."""
    phi, psi, theta = q = dynamicsymbols("phi psi theta")
    m, l, k, c, g = symbols("m l k c g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("spring_linkage", frame=N, origin=O, coordinates=q)
    joint = O
    for name, angle in (("left", phi), ("coupler", psi)):
        rod = N.orientnew(name, "Axis", (angle, N.z))
        G = joint.locatenew(f"{name}_G", l / 2 * rod.x)
        scene.add_bodies(RigidBody(name, G, rod, m, (inertia(rod, 0, 0, m * l**2 / 12), G)))
        joint = joint.locatenew(f"{name}_end", l * rod.x)
    pivot = O.locatenew("P", l * N.x)
    rod = N.orientnew("right", "Axis", (theta, N.z))
    G = pivot.locatenew("right_G", l / 2 * rod.x)
    scene.add_bodies(RigidBody("right", G, rod, m, (inertia(rod, 0, 0, m * l**2 / 12), G)))
    end = pivot.locatenew("right_end", l * rod.x)
    gap = joint.pos_from(end)
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    reach = end.pos_from(O)
    length = sqrt(reach.dot(N.x) ** 2 + reach.dot(N.y) ** 2)
    pull = k * (length - sqrt(2) * l) + c * length.diff(dynamicsymbols._t)
    scene.add_loads((end, -pull / length * reach))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


SPRING_LINKAGE = {"m": 1.0, "l": 1.0, "k": 25.0, "c": 1.0, "g": 9.81}


def spring_linkage_guess(angle=2.0):
    """Return a guess of the equilibrium, with cranks at an angle."""
    at_rest = dict.fromkeys(["phi_dot", "psi_dot", "theta_dot"], 0.0)
    return {"phi": angle, "psi": 0.0, "theta": angle, **at_rest}


def linear_benchmark(model):
    """Return the angle of the cranks in equilibrium and the eigenvalues there, by `trim` and `linearize`."""
    found = model.trim(spring_linkage_guess(), SPRING_LINKAGE)
    assert found.converged, found.message
    linear = model.linearize(0.0, found.initial, SPRING_LINKAGE)
    return math.remainder(found["theta"], 2 * math.pi), sorted(linear.eigenvalues, key=lambda x: x.imag)
