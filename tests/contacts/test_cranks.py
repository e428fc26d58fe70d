"""A crank whose slider has friction under a given load: at dead centres of the slider friction cannot hold it."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.methods.status import Status

LOAD, TURN = 2.0, 3.0
PI = np.pi


@cache
def lying(opens):
    """Return the crank with friction in a plane, though it slips along a line; the load presses it if it ``opens``."""
    a, h = dynamicsymbols("a h")
    T, turn = sp.symbols("T turn")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (a, N.z))
    P = O.locatenew("P", sp.cos(a) * (3 * N.x + 4 * N.y) / 5 + (h * N.z if opens else 0 * N.z))
    scene = da.Scene("lying", frame=N, origin=O, coordinates=[a, h] if opens else [a])
    scene.add_bodies(RigidBody("disc", O, S, 1, (inertia(S, 0, 0, 1), O)), Particle("slider", P, 1))
    scene.add_loads((S, turn * N.z), (P, -T * N.z))
    A, B, R = da.unknowns("A B R")
    scene.add_joints(da.Joint("guide", body="slider", at=P, force=A * N.x + B * N.y + (R * N.z if opens else 0 * N.z)))
    if opens:
        scene.add_contacts(da.UnilateralContact(R, gap=h, name="guide", restitution=0))
    scene.add_friction(da.CoulombFriction(R if opens else T, (A, B), mu=1, name="guide"))
    return da.compile_model(scene, outputs=["A", "B"])


@cache
def crank(beside=False, backend="llvm"):
    """Return a crank of unit inertia and radius with a slider of mass 1, and possibly a ball that falls beside it."""
    a, h = dynamicsymbols("a h")
    T, turn = sp.symbols("T turn")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (a, N.z))
    P, B = O.locatenew("P", sp.cos(a) * N.x), O.locatenew("B", h * N.z)
    scene = da.Scene("crank", frame=N, origin=O, coordinates=[a, h] if beside else [a])
    scene.add_bodies(RigidBody("disc", O, S, 1, (inertia(S, 0, 0, 1), O)), Particle("slider", P, 1))
    scene.add_loads((S, turn * N.z))
    F = da.unknowns("F")
    scene.add_joints(da.Joint("guide", body="slider", at=P, force=F * N.x))
    scene.add_friction(da.CoulombFriction(T, F, mu=1, name="guide"))
    if beside:
        scene.add_bodies(Particle("ball", B, 1))
        scene.add_loads((B, -10 * N.z))
        scene.add_contacts(da.PointPlane("ball", body="ball", point=B, plane=(O, N.z), restitution=0))
    return da.compile_model(scene, backend=backend)


def _rates(_, state, turn):
    s, c, rate = np.sin(state[0]), np.cos(state[0]), state[1]
    return rate, (turn + LOAD * s * np.sign(-s * rate) - s * c * rate**2) / (1.0 + s**2)


def _exact(a, rate, span, turn):
    run = solve_ivp(_rates, span, (a, rate), args=(turn,), rtol=1e-11, atol=1e-13, max_step=abs(span[1] - span[0]) / 50)
    return run.y[:, -1]


def _start(a, rate=0.0, beside=False):
    return {"a": a, "a_dot": rate} | ({"h": 0.2, "h_dot": 0.0} if beside else {})


@pytest.mark.parametrize(
    ("a", "way", "beside"),
    [(0.0, 1, True), (PI, 1, False), (-PI, -1, True), (2 * PI, 1, True), (9 * PI, 1, False), (1e-13, -1, False)],
)
def test_a_crank_at_rest_at_a_dead_centre_is_turned(a, way, beside):
    """The nearest number to the angle is before the dead centre, or behind it; no next number is between them."""
    run = crank(beside).simulate((0, 0.3), _start(a, beside=beside), {"T": LOAD, "turn": way * TURN}, rtol=1e-9)
    assert run.status is Status.SUCCESS and {phase.modes["guide"] for phase in run.phases} == {"slip"}
    turned = _exact(round(a / PI) * PI + way * 1e-12, 0.0, (0, 0.3), way * TURN)[0]
    np.testing.assert_allclose(run["a"][-1], turned, rtol=0, atol=2e-8)
    sweep = crank(beside).sweep(
        (0, 0.3), _start(np.full(2, a), beside=beside), {"T": LOAD, "turn": way * TURN}, rtol=1e-9
    )
    np.testing.assert_allclose(sweep["a"], turned, rtol=0, atol=2e-8)


@pytest.mark.parametrize("a", [0.0, 1e-9, PI, PI - 1e-9, -PI, 1.0])
def test_a_crank_that_friction_cannot_hold_has_one_past(a):
    """It came to rest against the load and friction, however near to a dead centre."""
    turn = TURN if a != 1.0 else 6.0
    run = crank().simulate((0.3, 0), _start(a), {"T": LOAD, "turn": turn}, rtol=1e-9)
    assert run.status is Status.SUCCESS
    np.testing.assert_allclose(run["a"][-1], _exact(a, -1e-12, (0.3, 0), turn)[0], rtol=0, atol=2e-8)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_a_crank_that_turns_has_come_through_its_dead_centres(backend):
    model, p = crank(backend=backend), {"T": LOAD, "turn": 1.0}
    run = model.simulate((0, 1.5), _start(0.5, 5.0), p, rtol=1e-10, atol=1e-12)
    assert run.status is Status.SUCCESS and len(run.phases) == 3
    back = model.simulate((1.5, 0), _start(run["a"][-1], run["a_dot"][-1]), p, rtol=1e-10, atol=1e-12)
    assert back.status is Status.SUCCESS and len(back.phases) == 3
    np.testing.assert_allclose((back["a"][-1], back["a_dot"][-1]), (0.5, 5.0), rtol=0, atol=1e-7)


def test_a_crank_that_friction_holds_has_rested():
    run = crank().simulate((1, 0), _start(1.0), {"T": LOAD, "turn": 1.0})
    assert run.status is Status.SUCCESS and [phase.modes for phase in run.phases] == [{"guide": "stick"}]


@pytest.mark.parametrize(("opens", "a"), [(False, 0.0), (False, PI), (True, 0.0), (True, PI)])
def test_friction_in_a_plane_does_not_hold_a_crank_at_a_dead_centre_either(opens, a):
    """Where the slip velocities in both directions vanish; friction is never more than the load."""
    start = _start(a) | ({"h": 0.0, "h_dot": 0.0} if opens else {})
    run = lying(opens).simulate((0, 0.3), start, {"T": LOAD, "turn": TURN}, rtol=1e-9)
    assert run.status is Status.SUCCESS and run.phases[-1].modes == {"guide": "slip"}
    turned = _exact(round(a / PI) * PI + 1e-12, 0.0, (0, 0.3), TURN)[0]
    np.testing.assert_allclose(run["a"][-1], turned, rtol=0, atol=2e-8)
    assert np.max(np.hypot(run["A"], run["B"])) < LOAD * (1 + 1e-9)
