"""A plate on two rough points of a line and a smooth third one, against closed forms: break-away, sweeps, impacts."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

HEIGHT, WIDTH, MASS, ROLL, GRAVITY, MU, STATIC = 0.02, 0.4, 2.0, 0.02, 10.0, 0.4, 0.6
COORDINATES = "x", "y", "z", "e0", "e1", "e2", "e3"


@cache
def model():
    """Return a plate that k t pushes along the line; W presses its third point, and its centre is c off the line."""
    x, y, z, *e = dynamicsymbols("x y z e0:4")
    k, W, c, rebound = sp.symbols("k W c rebound", real=True)
    N, O, T = ReferenceFrame("N"), Point("O"), ReferenceFrame("T")
    T.orient(N, "Quaternion", e)
    C = O.locatenew("C", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("plate", frame=N, origin=O, coordinates=[x, y, z, *e])
    scene.add_holonomic_constraints(sum(a**2 for a in e) - 1)
    scene.add_bodies(RigidBody("plate", C, T, MASS, (inertia(T, ROLL, 0.03, 0.03), C)))
    scene.apply_uniform_gravity(-GRAVITY * N.z)
    line = C.locatenew("line", -c * T.y - HEIGHT * T.z)
    for name, place in (("heel", -0.1 * T.x), ("toe", 0.3 * T.x), ("third", WIDTH * T.y)):
        friction, bounce = (0, rebound) if name == "third" else ((STATIC, MU), 0)
        at = line.locatenew(name, place)
        laws = {"friction": friction, "restitution": bounce}
        scene.add_contacts(da.PointPlane(name, body="plate", point=at, plane=(O, N.z), **laws))
    scene.add_loads((line, k * dynamicsymbols._t * T.x), (at, -W * N.z))
    return da.compile_model(scene)


def start(roll=0.0, turn=0.0, c=0.0):
    """Return initial values: both points of the line on the floor, at rest, with a turn and a roll."""
    values = dict.fromkeys(COORDINATES, 0.0) | {f"{name}_dot": 0.0 for name in COORDINATES}
    half, way = turn / 2, c * np.cos(roll) - HEIGHT * np.sin(roll)
    values |= {"x": -np.sin(turn) * way, "y": np.cos(turn) * way, "z": HEIGHT * np.cos(roll) + c * np.sin(roll)}
    values |= {"e0": np.cos(half) * np.cos(roll / 2), "e1": np.cos(half) * np.sin(roll / 2)}
    return values | {"e2": np.sin(half) * np.sin(roll / 2), "e3": np.sin(half) * np.cos(roll / 2)}


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_link_breaks_away_at_the_static_coefficient_and_slides_at_the_kinetic_one(turn):
    """Each point carries another part of the weight; both slip when k t is the sum of their limits."""
    k = 30.0
    begins = STATIC * MASS * GRAVITY / k
    values = {"k": k, "W": 3.0, "c": 0.0, "rebound": 0.0}
    run = model().simulate((0.0, begins + 0.2), start(turn=turn), values, rtol=1e-10)
    states = [tuple(phase.modes[name] for name in ("heel", "toe")) for phase in run.phases]
    assert run.success and states[0] == ("stick", "stick") and {*states[1:]} == {("slip", "slip")}
    assert run.phases[1].t0 == pytest.approx(begins, abs=1e-9)
    after = np.maximum(run.t - begins, 0.0)
    speed = (k * after**2 / 2 + (STATIC - MU) * MASS * GRAVITY * after) / MASS
    way = (k * after**3 / 6 + (STATIC - MU) * MASS * GRAVITY * after**2 / 2) / MASS
    for found, along, across in ((way, "x", "y"), (speed, "x_dot", "y_dot")):
        np.testing.assert_allclose(run[along], np.cos(turn) * found, atol=1e-8)
        np.testing.assert_allclose(run[across], np.sin(turn) * found, atol=1e-8)


def test_a_sweep_over_links_that_stick_and_break_away_is_its_single_runs():
    cases = np.array([10.0, 30.0, 60.0])
    values = {"W": 3.0, "c": 0.0, "rebound": 0.0}
    sweep = model().sweep((0.0, 0.5), start(turn=0.7), {"k": cases, **values}, rtol=1e-9)
    assert np.all(sweep.status == 0)
    for i, k in enumerate(cases):
        run = model().simulate((0.0, 0.5), start(turn=0.7), {"k": k, **values}, rtol=1e-9)
        assert (len(run.phases) > 1) == (k > 24.0)
        for name in ("x", "y", "x_dot", "y_dot", "e0", "e3"):
            assert sweep[name][i] == pytest.approx(run[name][-1], abs=1e-12)


def test_an_impact_beside_two_points_that_stick_loses_what_restitution_says():
    """The plate tips about its line: what pushes there in an impact is positive, and within the cones of friction."""
    c, rebound, roll = 0.1, 0.5, 0.2
    values = {"k": 0.0, "W": 0.0, "c": c, "rebound": rebound}
    run = model().simulate((0.0, 0.35), start(roll, 0.7, c), values, rtol=1e-10)
    assert run.success and all(phase.modes["heel"] == phase.modes["toe"] == "stick" for phase in run.phases)
    e, rates = (np.array([run[f"e{i}{dot}"] for i in range(4)]) for dot in ("", "_dot"))
    spin = 2 * (e[0] * rates[1] - e[1] * rates[0] - e[2] * rates[3] + e[3] * rates[2])  # about the line
    turning = ROLL + MASS * (c**2 + HEIGHT**2)
    moving, whole = turning * spin**2 / 2, turning * spin**2 / 2 + MASS * GRAVITY * run["z"]
    times = [phase.t0 for phase in run.phases[1:]]
    assert len(times) >= 2
    lost = 0.0
    for t in times:
        before, after = (int(f(np.flatnonzero(run.t == t))) for f in (np.min, np.max))
        assert moving[after] == pytest.approx(rebound**2 * moving[before], rel=1e-6)
        lost += (1 - rebound**2) * moving[before]
    assert np.all(np.diff(whole) < 1e-8) and whole[0] - whole[-1] == pytest.approx(lost, rel=1e-6)
    assert lost > 0.5 * (whole[0] - MASS * GRAVITY * HEIGHT)
