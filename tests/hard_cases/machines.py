"""Machines in space: the Whipple bicycle and the stiff flyball governor."""

import math

import numpy as np
from sympy import pi, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from hard_cases.case import HardCase, reference


def governor():
    """IFToMM A05: a damped stiff spring, rates of 1e4 1/s upon a motion of seconds."""
    entry = reference("iftomm_A05_stiff_flyball")
    phi, al, s = dynamicsymbols("phi alpha s")
    K, c, l0, e, g = symbols("K c l0 e g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (phi, N.z))
    scene = da.Scene("flyball_governor", frame=N, origin=O, coordinates=[phi, al, s])
    m, ball, thin = 0.3, 5.0, 0.3 * 0.01**2 / 6
    across = 0.3 * (1 + 0.01**2) / 12
    slider = O.locatenew("S", s * A.z)
    scene.add_bodies(
        RigidBody("shaft", O, A, m, (inertia(A, across, across, thin), O)),
        RigidBody("slider", slider, A, 3.0, (inertia(A, 0.005, 0.005, 0.005), slider)),
    )
    for side in (1, -1):
        # the rod points outwards and down by alpha
        R = A.orientnew(f"R{side}", "Axis", (side * al, A.y))
        hinge = O.locatenew(f"H{side}", side * e * A.x + A.z)
        middle = hinge.locatenew(f"G{side}", side * R.x / 2)
        scene.add_bodies(
            RigidBody(f"rod{side}", middle, R, m, (inertia(R, thin, across, across), middle)),
            Particle(f"ball{side}", hinge.locatenew(f"B{side}", side * R.x), ball),
        )
        foot = slider.locatenew(f"F{side}", side * e * A.x)
        reach = middle.pos_from(foot)
        length = sqrt(reach.dot(A.x) ** 2 + reach.dot(A.z) ** 2)
        force = (K * (length - l0) + c * length.diff(dynamicsymbols._t)) / length * reach
        scene.add_loads((foot, force), (middle, -force))
    scene.apply_uniform_gravity(-g * N.z)
    keys = ("alpha", "s", "alphad", "sd", "phi", "phid")
    return HardCase(
        scene=scene,
        parameters={"K": 8e5, "c": 4e4, "l0": 0.5, "e": 0.05, "g": 9.81},
        initial={
            **{"phi": 0.0, "alpha": math.pi / 6, "s": 0.5},
            **{"phi_dot": 2 * math.pi, "alpha_dot": 0.0, "s_dot": 0.0},
        },
        observed=["alpha", "s", "alpha_dot", "s_dot", "phi", "phi_dot"],
        values={float(row["t"]): [row[key] for key in keys] for row in entry["values"]},
        source=entry["source"],
        bound=1e-13,
        conserved=(),
        report_only=(2.0, 5.0, 10.0),
    )


COORDINATES = ("x", "y", "z", "theta", "psi", "phi", "psif", "betar", "betaf")


def bicycle_scene():
    """Build the Whipple bicycle in the coordinates of Basu-Mandal et al.

    (x, y, z) is the centre of the rear wheel, x backward and z up; theta, psi and phi are 3-1-3 angles of the rear
    frame, upright and level at psi = pi/2 and phi = pi; psif turns the front frame about the steering axis.
    In the frame of the rear, b.x points forward, b.y down and b.z to the left.
    """
    x, y, z, theta, psi, phi, psif, betar, betaf = q = dynamicsymbols(" ".join(COORDINATES))
    names = "w c lam g rR mR IRxx IRyy xB zB mB IBxx IByy IBzz IBxz xH zH mH IHxx IHyy IHzz IHxz rF mF IFxx IFyy"
    p = {name: symbols(name, real=True) for name in names.split()}
    N, O = ReferenceFrame("N"), Point("O")
    yaw = N.orientnew("Y", "Axis", (theta, N.z))
    lean = yaw.orientnew("L", "Axis", (psi, yaw.x))
    b = lean.orientnew("b", "Axis", (phi, lean.z))
    rear = O.locatenew("R", x * N.x + y * N.y + z * N.z)
    tilted = b.orientnew("T", "Axis", (-p["lam"], b.z))  # T.y is the steering axis, downwards
    steer = tilted.orientnew("U", "Axis", (-psif, tilted.y))
    f = steer.orientnew("f", "Axis", (p["lam"], steer.z))
    foot = rear.locatenew("K", (p["w"] + p["c"]) * b.x + p["rR"] * b.y)  # where the axis meets the ground
    front = foot.locatenew("F", -p["c"] * f.x - p["rF"] * f.y)
    GB = rear.locatenew("GB", p["xB"] * b.x + (p["zB"] + p["rR"]) * b.y)
    GH = foot.locatenew("GH", (p["xH"] - p["w"] - p["c"]) * f.x + p["zH"] * f.y)
    wheel_r, wheel_f = b.orientnew("WR", "Axis", (betar, b.z)), f.orientnew("WF", "Axis", (betaf, f.z))
    scene = da.Scene("whipple_bicycle", frame=N, origin=O, coordinates=q)
    scene.add_bodies(
        RigidBody("rear wheel", rear, wheel_r, p["mR"], (inertia(wheel_r, p["IRxx"], p["IRxx"], p["IRyy"]), rear)),
        RigidBody("rider", GB, b, p["mB"], (inertia(b, p["IBxx"], p["IBzz"], p["IByy"], p["IBxz"], 0, 0), GB)),
        RigidBody("fork", GH, f, p["mH"], (inertia(f, p["IHxx"], p["IHzz"], p["IHyy"], p["IHxz"], 0, 0), GH)),
        RigidBody("front wheel", front, wheel_f, p["mF"], (inertia(wheel_f, p["IFxx"], p["IFxx"], p["IFyy"]), front)),
    )
    scene.apply_uniform_gravity(-p["g"] * N.z)
    for centre, wheel, carrier, radius in ((rear, wheel_r, b, p["rR"]), (front, wheel_f, f, p["rF"])):
        up = N.z - N.z.dot(carrier.z) * carrier.z
        arm = -radius / sqrt(1 - N.z.dot(carrier.z) ** 2) * up
        scene.add_holonomic_constraints(centre.pos_from(O).dot(N.z) + arm.dot(N.z))
        slip = centre.pos_from(O).dt(N) + wheel.ang_vel_in(N).cross(arm)
        scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
    return scene


def bicycle_parameters():
    """Return the parameters of the benchmark bicycle."""
    given = reference("whipple_bicycle_eigenvalues")["parameters"]
    p = {key: float(pi / 10 if key == "lam" else x) for key, x in given.items() if key not in ("IB", "IH")}
    for name in ("IB", "IH"):
        words = given[name].split()
        p |= {name + key: float(x) for key, x in zip(words[::2], words[1::2], strict=True)}
    return p


def upright_bicycle(speed):
    """Return initial values of upright motion at a speed."""
    p = bicycle_parameters()
    start = dict.fromkeys(COORDINATES, 0.0) | {"z": p["rR"], "psi": math.pi / 2, "phi": math.pi}
    return start | {"psi_dot": 0.0, "psif_dot": 0.0, "betar_dot": speed / p["rR"]}


def bicycle_linearized(model, speed):
    """Return the eigenvalues of roll and steer about upright motion at this speed, from generated derivatives."""
    p, start = bicycle_parameters(), upright_bicycle(speed)
    free = ["x", "y", "theta", "psi", "psif", "betar", "betaf", "psi_dot", "psif_dot", "betar_dot"]
    found = model.linearize(0.0, start, p, states=free)
    return np.linalg.eigvals(found.block("psi", "psif", "psi_dot", "psif_dot"))


def bicycle_eigenvalues(model, speed, step=2e-3):
    """Return the same by differences, another way to them.

    Lean and steer are set, the rest of the position is assembled, and the rates follow from those of lean, steer and
    the rear wheel, which keeps its speed to first order.
    """
    p = bicycle_parameters()
    upright = dict.fromkeys(COORDINATES, 0.0) | {"z": p["rR"], "psi": math.pi / 2, "phi": math.pi}

    def second(state):
        psi, psif, psi_rate, psif_rate = state
        guess = upright | {"psi": math.pi / 2 + psi, "psif": psif}
        rates = {"psi_dot": psi_rate, "psif_dot": psif_rate, "betar_dot": speed / p["rR"]}
        found = model.assemble(guess | rates, p, fixed=["psi", "psif", "x", "y", "theta", "betar", "betaf", *rates])
        q = np.array([found[name] for name in COORDINATES])
        qdot = np.array([found[f"{name}_dot"] for name in COORDINATES])
        return model.accelerations(0.0, q, qdot, p)[[COORDINATES.index("psi"), COORDINATES.index("psif")]]

    matrix = np.zeros((4, 4))
    matrix[0, 2] = matrix[1, 3] = 1.0
    for j in range(4):
        unit = step * np.eye(4)[j]
        near, far = second(unit) - second(-unit), second(2 * unit) - second(-2 * unit)
        matrix[2:, j] = (8 * near - far) / (12 * step)
    return np.linalg.eigvals(matrix)


CASES = {"stiff flyball governor": governor}
