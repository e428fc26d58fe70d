"""Wheels with rolling resistance that hold a cart together: they share its load in any lawful way."""

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.contacts.selection import mode_candidates as rules

N, O = ReferenceFrame("N"), Point("O")
x, y, theta = dynamicsymbols("x y theta")
m, g, r, mu, d = symbols("m g r mu d", positive=True)
M, L, k, h = symbols("M L k h", real=True)
CART = {"m": 1, "M": 10, "g": 9.81, "r": 0.3, "mu": 0.5, "d": 0.02, "L": 1}
INERTIA = 10 + 2 * 1 + 2 * 0.5  # of the chassis and two discs that roll


@pytest.fixture(scope="module")
def cart():
    """Return the model of a cart on two wheels, which a force k t pushes and a moment h turns."""
    turns = dynamicsymbols("front rear")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x, y, theta, *turns])
    C, G = N.orientnew("C", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("chassis", G, C, M, (inertia(C, 0, 0, M * L**2 / 3), G)))
    for name, turn, place in zip(("front", "rear"), turns, (L, -L), strict=True):
        W, hub = N.orientnew(f"W_{name}", "Axis", (turn, N.z)), G.locatenew(f"H_{name}", place * C.x)
        scene.add_bodies(RigidBody(name, hub, W, m, (inertia(W, 0, 0, m * r**2 / 2), hub)))
        floor = {"centre": hub, "radius": r, "plane": (O, N.y), "friction": mu, "rolling_resistance": d}
        scene.add_contacts(da.SpherePlane(f"{name}_wheel", body=name, **floor))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((G, k * dynamicsymbols._t * N.x), (C, -h * N.z))
    names = ("front_wheel", "rear_wheel")
    outputs = [f"{name}.{what}" for name in names for what in ("rolling_1", "normal", "friction_1")]
    return da.compile_model(scene, outputs=outputs)


def standing(v=0.0):
    zero = dict.fromkeys(("x", "theta", "front", "rear", "y_dot", "theta_dot"), 0.0)
    return {**zero, "y": 0.3, "x_dot": v, "front_dot": -v / 0.3, "rear_dot": -v / 0.3}


def test_a_cart_rolls_to_rest_on_two_wheels(cart):
    run = cart.simulate((0, 6), standing(2.0), {**CART, "k": 0, "h": 0})
    slowed = 12 * 9.81 * 0.02 / 0.3 / INERTIA
    assert run.success and abs(run.phases[-1].t0 - 2 / slowed) < 1e-9 and abs(run["x"][-1] - 2 / slowed) < 1e-9
    assert set(run.phases[-1].modes.values()) == {"stick"}


@pytest.mark.parametrize("search", [False, True])
@pytest.mark.parametrize("moment", [0.0, 20.0])
@pytest.mark.parametrize("grows", [4.0, -4.0])
def test_two_wheels_share_what_holds_a_cart(cart, monkeypatch, grows, moment, search):
    """They hold it up to d (N_1 + N_2) / r = 7.848, in whatever way they share that; then it starts to roll."""
    if search:
        monkeypatch.setattr(rules, "FEW_CONTACTS", 0)
        monkeypatch.setattr(rules, "_FEW", 0)
    cart.modes.recorders.clear()
    run = cart.simulate((0, 4), standing(), {**CART, "k": grows, "h": moment}, rtol=1e-10)
    cart.modes.recorders.clear()
    begins = 12 * 9.81 * 0.02 / 0.3 / 4
    assert run.success and [set(phase.modes.values()) for phase in run.phases] == [{"stick"}, {"stick", "slip"}]
    assert abs(run.phases[1].t0 - begins) < 1e-9
    assert abs(abs(run["x"][-1]) - 4 * (4 - begins) ** 3 / 6 / INERTIA) < 1e-9
    held = run.t < begins
    for wheel in ("front_wheel", "rear_wheel"):
        most = 0.02 * run[f"{wheel}.normal"][held]
        assert np.all(np.abs(run[f"{wheel}.rolling_1"][held]) <= most * (1 + 1e-9))


def test_a_sweep_of_carts(cart):
    rates = np.array([1.0, 2.0, 4.0, -8.0])
    sweep = cart.sweep((0, 4), standing(), {**CART, "k": rates, "h": 0.0}, rtol=1e-10)
    left = np.maximum(4 - 12 * 9.81 * 0.02 / 0.3 / np.abs(rates), 0)
    assert sweep.success.all()
    np.testing.assert_allclose(sweep["x"], rates * left**3 / 6 / INERTIA, atol=1e-10)
