"""Closed loops: slider-crank, Andrews' squeezer, car axis, four-bars with redundant bars, a rod on a corner."""

import math

from sympy import Rational, cos, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from hard_cases.case import HardCase, reference
from hard_cases.rotations import NO_CLOSED_FORM

T = dynamicsymbols._t


def slider_crank_scene():
    """Build a crank, a rod and a slider on N.x; two constraints hold the end of the rod on the slider."""
    phi, beta, s = dynamicsymbols("phi beta s")
    r, l, J, m2, I2, m3, g = symbols("r l J m2 I2 m3 g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    crank = N.orientnew("K", "Axis", (phi, N.z))
    rod = N.orientnew("R", "Axis", (-beta, N.z))
    pin = O.locatenew("A", r * crank.x)
    middle, end = pin.locatenew("G", l / 2 * rod.x), pin.locatenew("B", l * rod.x)
    slider = O.locatenew("S", s * N.x)
    scene = da.Scene("slider_crank", frame=N, origin=O, coordinates=[phi, beta, s])
    scene.add_bodies(
        RigidBody("crank", O, crank, 1, (inertia(crank, 0, 0, J), O)),
        RigidBody("rod", middle, rod, m2, (inertia(rod, 0, 0, I2), middle)),
        Particle("slider", slider, m3),
    )
    scene.apply_uniform_gravity(-g * N.y)
    gap = end.pos_from(slider)
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    return scene


def slider_crank():
    """Two constraints; the crank goes round seven times in 5 s."""
    entry = reference("slider_crank")
    p = {key: float(x) for key, x in entry["values"]["parameters"].items()}
    beta = math.asin(p["r"] * math.sin(0.3) / p["l"])
    return HardCase(
        scene=slider_crank_scene(),
        parameters=p,
        initial={"phi": 0.3, "beta": beta, "s": p["r"] * math.cos(0.3) + p["l"] * math.cos(beta), "phi_dot": 12.0},
        observed=["phi", "beta", "s", "phi_dot", "beta_dot", "s_dot"],
        values={float(row["t"]): row["state"] for row in entry["values"]["rows"]},
        source=entry["source"],
        bound=2e-12,
        refused=NO_CLOSED_FORM,
    )


_LENGTHS = "d da e ea rr ra l0 ss sa sb sc sd ta tb u ua ub zf zt fa"
_PLACES = "xa ya xb yb xc yc"


def andrews_scene():
    """Build Andrews' squeezing mechanism: seven bodies, three loops through the point P."""
    be, th, ga, ph, de, om, ep = q = dynamicsymbols("be th ga ph de om ep")
    d, da_, e, ea, rr, ra, l0, ss, sa, sb, sc, sd, ta, tb, u, ua, ub, zf, zt, fa = symbols(_LENGTHS, positive=True)
    xa, ya, xb, yb, xc, yc = symbols(_PLACES, real=True)
    masses, moments = symbols("m1:8", positive=True), symbols("I1:8", positive=True)
    c0, mom = symbols("c0 mom", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A, B, C = (O.locatenew(n, x * N.x + y * N.y) for n, x, y in (("A", xa, ya), ("B", xb, yb), ("C", xc, yc)))
    angles = (be, be + th, ga, ph + de, de, om + ep, ep)
    F = [N.orientnew(f"K{i + 1}", "Axis", (angle, N.z)) for i, angle in enumerate(angles)]
    pin = O.locatenew("R", rr * F[0].x)
    knee = A.locatenew("Q5", zt * F[4].x)
    elbow = A.locatenew("Q7", -u * F[6].y)
    centres = [
        O.locatenew("G1", ra * F[0].x),
        pin.locatenew("G2", -da_ * F[1].x),
        B.locatenew("G3", sa * F[2].x - sb * F[2].y),
        knee.locatenew("G4", -(e - ea) * F[3].y),
        A.locatenew("G5", ta * F[4].x - tb * F[4].y),
        elbow.locatenew("G6", (zf - fa) * F[5].x),
        A.locatenew("G7", ua * F[6].x - ub * F[6].y),
    ]
    scene = da.Scene("andrews_squeezer", frame=N, origin=O, coordinates=q)
    for i, (G, frame, m, I) in enumerate(zip(centres, F, masses, moments, strict=True)):
        scene.add_bodies(RigidBody(f"body{i + 1}", G, frame, m, (inertia(frame, 0, 0, I), G)))
    P = pin.locatenew("P", -d * F[1].x)
    ends = (
        B.locatenew("P3", -ss * F[2].y),
        knee.locatenew("P4", -e * F[3].y),
        elbow.locatenew("P6", zf * F[5].x),
    )
    reactions = iter(da.unknowns("lam1:7"))
    for body, end in zip((3, 4, 6), ends, strict=True):
        gap = P.pos_from(end)
        scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
        force = next(reactions) * N.x + next(reactions) * N.y
        scene.add_joints(
            da.Joint(f"P on {body}", body="body2", at=P, force=-force),
            da.Joint(f"{body} on P", body=f"body{body}", at=end, force=force),
        )
    D = B.locatenew("D", sd * F[2].x - sc * F[2].y)
    pull = D.pos_from(C)
    length = sqrt(pull.dot(N.x) ** 2 + pull.dot(N.y) ** 2)
    scene.bodies[2].potential_energy = c0 * (length - l0) ** 2 / 2
    scene.bodies[0].potential_energy = -mom * be
    scene.add_loads((D, -c0 * (length - l0) / length * pull), (F[0], mom * N.z))
    return scene


def andrews_parameters():
    """Return the parameters of the test set."""
    given = reference("andrews_squeezer")["parameters"]
    p = {key: float(x) for key, x in given.items() if key not in ("m", "I")}
    for name in ("m", "I"):
        p |= {f"{name}{i + 1}": float(x) for i, x in enumerate(given[name].split())}
    return p


ANDREWS_START = {
    "be": -0.0617138900142764496358948458001,
    "th": 0.0,
    "ga": 0.455279819163070380255912382449,
    "ph": 0.222668390165885884674473185609,
    "de": 0.487364979543842550225598953530,
    "om": -0.222668390165885884674473185609,
    "ep": 1.23054744454982119249735015568,
}


def andrews():
    """Three loops, six constraints, accelerations of 5e5."""
    entry = reference("andrews_squeezer")
    names = list(ANDREWS_START)
    rows = entry["values"]["own_24_digits"]
    values = {float(t): [*row[:14], *row[21:]] for t, row in rows.items()}
    rates = [f"{name}_dot" for name in names]
    return HardCase(
        scene=andrews_scene(),
        parameters=andrews_parameters(),
        initial={**ANDREWS_START, **dict.fromkeys(rates, 0.0)},
        quantity="angles, rates, multipliers",
        observed=[*names, *rates, *(f"lam{i}" for i in range(1, 7))],
        values=values,
        scale=[1.0] * 7 + [1e3] * 7 + [1e2] * 6,
        source=entry["source"],
        bound=1e-8,
        drift=1e-9,
        refused=NO_CLOSED_FORM,
        rtol=1e-10,
        atol=1e-10,
    )


def car_axis():
    """Constraints that depend on time, masses of 5e-4, and both multipliers as reactions."""
    entry = reference("car_axis")
    xl, yl, xr, yr = q = dynamicsymbols("xl yl xr yr")
    k, L, L0, r, w, g = symbols("k L L0 r w g", positive=True)
    lam1, lam2 = da.unknowns("lam1 lam2")
    N, O = ReferenceFrame("N"), Point("O")
    left, right = O.locatenew("L", xl * N.x + yl * N.y), O.locatenew("R", xr * N.x + yr * N.y)
    yb = r * sin(w * T)
    xb = sqrt(L**2 - yb**2)
    wheel = xb * N.x + yb * N.y
    scene = da.Scene("car_axis", frame=N, origin=O, coordinates=q)
    scene.add_bodies(Particle("left", left, k), Particle("right", right, k))
    scene.apply_uniform_gravity(-g * N.y)
    for point, arm in ((left, xl * N.x + yl * N.y), (right, (xr - xb) * N.x + (yr - yb) * N.y)):
        length = sqrt(arm.dot(N.x) ** 2 + arm.dot(N.y) ** 2)
        scene.add_loads((point, (L0 - length) / length * arm))
    apart = (xl - xr) * N.x + (yl - yr) * N.y
    scene.add_holonomic_constraints(xb * xl + yb * yl, (xl - xr) ** 2 + (yl - yr) ** 2 - L**2)
    scene.add_joints(
        da.Joint("left wheel", body="left", at=left, force=lam1 * wheel + 2 * lam2 * apart),
        da.Joint("axle", body="right", at=right, force=-2 * lam2 * apart),
    )
    rates = ("xl_dot", "yl_dot", "xr_dot", "yr_dot")
    return HardCase(
        scene=scene,
        parameters={"k": 10 * 0.01**2 / 2, "L": 1.0, "L0": 0.5, "r": 0.1, "w": 10.0, "g": 1.0},
        initial={
            **{"xl": 0.0, "yl": 0.5, "xr": 1.0, "yr": 0.5},
            **dict(zip(rates, (-0.5, 0.0, -0.5, 0.0), strict=True)),
        },
        quantity="positions, velocities, multipliers",
        observed=["xl", "yl", "xr", "yr", *rates, "lam1", "lam2"],
        values={float(t): row for t, row in entry["values"]["own_26_digits"].items()},
        source=entry["source"],
        bound=5e-12,
        scale=[1.0] * 8 + [1e-2] * 2,
        conserved=(),
        refused=NO_CLOSED_FORM,
    )


def _benchmark():
    entry = reference("iftomm_A02_n_four_bar")
    rows = (row for row in entry["values"]["N2"] if float(row["t"]) <= 10.0)
    return {float(row["t"]): [row[key] for key in ("B0x", "B0y", "B0vx", "B0vy")] for row in rows}, entry["source"]


def _four_bar(name, couplers, values, source, bound, **options):
    """Build three cranks of length 1 side by side, joined by couplers given as (first crank, last crank)."""
    count = 3
    phi = dynamicsymbols(" ".join(f"phi{i}" for i in range(count)))
    psi = dynamicsymbols(" ".join(f"psi{i}" for i in range(len(couplers))) + " ,")
    m, g = symbols("m g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(name, frame=N, origin=O, coordinates=[*phi, *psi])
    tops = []
    for i, angle in enumerate(phi):
        base = O.locatenew(f"A{i}", i * N.x)
        crank = N.orientnew(f"C{i}", "Axis", (-angle, N.z))
        G = base.locatenew(f"G{i}", crank.y / 2)
        scene.add_bodies(RigidBody(f"crank{i}", G, crank, m, (inertia(crank, 0, 0, m / 12), G)))
        tops.append(base.locatenew(f"B{i}", crank.y))
    for j, ((first, last), angle) in enumerate(zip(couplers, psi, strict=True)):
        bar = N.orientnew(f"D{j}", "Axis", (angle, N.z))
        length = last - first
        G = tops[first].locatenew(f"H{j}", Rational(length, 2) * bar.x)
        scene.add_bodies(RigidBody(f"bar{j}", G, bar, length * m, (inertia(bar, 0, 0, m * Rational(length**3, 12)), G)))
        for i in range(first + 1, last + 1):
            gap = tops[i].pos_from(tops[first].locatenew(f"E{j}{i}", (i - first) * bar.x))
            scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    x, y = sin(phi[0]), cos(phi[0])
    rate = phi[0].diff()
    start = {**{f"phi{i}": 0.0 for i in range(count)}, **{f"psi{j}": 0.0 for j in range(len(couplers))}}
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "g": 9.81},
        initial={**start, "phi0_dot": 1.0},
        quantity="position and velocity of a corner",
        observed=[x, y, rate * y, -rate * x],
        values=values,
        source=source,
        bound=bound,
        refused=NO_CLOSED_FORM,
        **options,
    )


WINDOWS, ONE_COUPLER = ((0, 1), (1, 2)), ((0, 2),)


def four_bar():
    """IFToMM A02, two windows, from upright until just before the cranks lie down."""
    entry = reference("four_bar_start")
    values = {float(row["t"]): row["state"] for row in entry["values"]}
    return _four_bar("four_bar", WINDOWS, values, entry["source"], 1e-13)


def four_bar_through_singularity():
    """The loops are singular where the cranks lie down."""
    why = "the constraints lose rank where the cranks lie down"
    return _four_bar("four_bar", WINDOWS, *_benchmark(), 1e-9, may_fail=why)


def redundant_four_bar():
    """Three cranks on one coupler: four constraints of rank three on the motion."""
    entry = reference("four_bar_start")
    values = {float(row["t"]): row["state"] for row in entry["values"]}
    why = "the constraints are redundant on the whole motion"
    return _four_bar("redundant_four_bar", ONE_COUPLER, values, entry["source"], 1e-12, may_fail=why)


def corner_plate():
    """A rod on the floor that leans on a corner, without friction; the reactions are outputs."""
    entry = reference("plate_corner_coulomb")
    x, y, th = dynamicsymbols("x y theta")
    m, l, h, g = symbols("m l h g", positive=True)
    NA, NB = da.unknowns("N_A N_B")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (th, N.z))
    A = O.locatenew("A", x * N.x + y * N.y)
    G = A.locatenew("G", l * S.x)
    corner = A.locatenew("Q", h / sin(th) * S.x)
    scene = da.Scene("leaning_rod", frame=N, origin=O, coordinates=[x, y, th])
    scene.add_bodies(RigidBody("rod", G, S, m, (inertia(S, 0, 0, m * l**2 / 3), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(y, x + h * cos(th) / sin(th))
    scene.add_joints(
        da.Joint("floor", body="rod", at=A, force=NA * N.y),
        da.Joint("corner", body="rod", at=corner, force=NB * S.y),
    )
    rows = entry["values"]["frictionless"]["rows"]
    return HardCase(
        scene=scene,
        parameters={"m": 1.0, "l": 1.0, "h": 0.8, "g": 9.81},
        initial={"y": 0.0, "theta": 1.0, "theta_dot": 0.0},
        observed=["theta", "theta_dot", "x", "N_A", "N_B"],
        values={
            float(row["t"]): [row[key] for key in ("theta", "thetad", "x_minus_const", "NA", "NB")] for row in rows
        },
        source=entry["source"],
        bound=2e-14,
    )


CASES = {
    "slider-crank": slider_crank,
    "Andrews' squeezing mechanism": andrews,
    "car axis": car_axis,
    "four-bar": four_bar,
    "four-bar through its singular position": four_bar_through_singularity,
    "four-bar with redundant bars": redundant_four_bar,
    "rod on a corner": corner_plate,
}
