"""The examples of docs/contacts.md against computations by hand."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

PAGE = Path(__file__).parents[2] / "docs" / "contacts.md"


@pytest.fixture(scope="module")
def page():
    names = {}
    with contextlib.redirect_stdout(io.StringIO()):
        for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL):
            exec(compile(block, PAGE.name, "exec"), names)
    return names


def test_billiards(page):
    """Sliding balls gain 5/7 of their speed and 2/7 of that of their rim; equal elastic balls exchange velocities."""
    run, mu_g = page["billiards"], 0.2 * 9.81
    first = 2 / (7 * mu_g)
    assert abs(run.phases[1].t0 - first) < 1e-12
    speed, gone = 5 / 7, 12 / (49 * mu_g)
    struck = first + (0.34 - gone) / speed
    assert abs(run.phases[2].t0 - struck) < 1e-11
    assert abs(run.phases[3].t0 - struck - 2 * speed / (7 * mu_g)) < 1e-11
    after = run(np.array([struck + 1e-9]))
    assert abs(after["x_a_dot"]) < 1e-8 and abs(after["x_b_dot"] - speed) < 1e-8
    ends = {"x_a_dot": 2 / 7 * speed, "x_b_dot": 5 / 7 * speed, "turn_a_dot": -2 / 7 * speed / 0.03}
    for name, value in ends.items():
        assert abs(run[name][-1] - value) < 1e-10, name


def test_cradle(page):
    """The first ball falls for a quarter of its period, and the third has its energy."""
    run = page["cradle"]
    quarter = ellipk(np.sin(0.25) ** 2) * np.sqrt(0.5 / 9.81)
    speed = np.sqrt(2 * 9.81 * 0.5 * (1 - np.cos(0.5)))
    assert len(run.phases) == 2 and abs(run.phases[1].t0 - quarter) < 1e-11
    assert "impacts shared an instant, first at t = 0.360248" in run.message
    energy = lambda i: run[f"q{i}_dot"] ** 2 / 2 * 0.25 + 9.81 * 0.5 * (1 - np.cos(run[f"q{i}"]))  # noqa: E731
    after = run.t > run.phases[1].t0
    assert abs(energy(3) - speed**2 / 2)[after].max() < 1e-9 and max(energy(i)[after].max() for i in (1, 2)) < 1e-12


def tumble(count, a=0.3, b=0.2, e=0.4, mu=0.5, g=9.81):
    """Return time and velocities after each of the first impacts of a thrown box, corner by corner."""
    J = (a**2 + b**2) / 3
    q, v, t = np.array([0, 1, 0.3]), np.array([2.0, 0, 3]), 0.0
    corners = [(i * a, j * b) for i in (-1, 1) for j in (-1, 1)]

    def lever(angle, corner):
        c, s = np.cos(angle), np.sin(angle)
        return np.array([c * corner[0] - s * corner[1], s * corner[0] + c * corner[1]])

    def height(s, k, q, v):
        return q[1] + v[1] * s - g * s * s / 2 + lever(q[2] + v[2] * s, corners[k])[1]

    found, times = [], np.linspace(1e-7, 1.5, 100_000)
    for _ in range(count):
        below = [height(times, k, q, v) < 0 for k in range(4)]
        i, k = min((int(np.argmax(below[k])), k) for k in range(4) if below[k].any())
        s = brentq(height, times[i - 1], times[i], args=(k, q, v), xtol=1e-15)
        t, q = t + s, q + v * s - np.array([0, g * s * s / 2, 0])
        v = v - np.array([0, g * s, 0])
        x, y = lever(q[2], corners[k])
        normal, along = np.array([0, 1, x]), np.array([1, 0, -y])
        inverse = np.array([1, 1, 1 / J])
        nn, nt, tt = (np.sum(p * inverse * r) for p, r in ((normal, normal), (normal, along), (along, along)))
        un, ut = normal @ v, along @ v
        push, hold = np.linalg.solve([[nn, nt], [nt, tt]], [-(1 + e) * un, -ut])
        if abs(hold) > mu * push:  # slip goes on, against which friction acts
            for sign in (1, -1):
                push = -(1 + e) * un / (nn - sign * mu * nt)
                hold = -sign * mu * push
                if sign * (ut + nt * push + tt * hold) > 0:
                    break
        v = v + inverse * (push * normal + hold * along)
        found.append((t, *v))
    return np.array(found)


def test_tumbling_box(page):
    """Flights in closed form, impacts by Newton's and Coulomb's laws at one corner each."""
    run, hand = page["box"], tumble(6)
    flights = run.phases[1 : len(hand) + 1]
    assert all(set(phase.modes.values()) == {"open"} for phase in flights)
    assert abs(np.array([phase.t0 for phase in flights]) - hand[:, 0]).max() < 1e-10
    for phase, (t, *velocity) in zip(flights, hand, strict=True):
        after = run(np.array([t + 1e-8]))
        found = np.array([after[name][0] for name in ("x_dot", "y_dot", "theta_dot")])
        assert abs(found - velocity).max() < 1e-6, phase.t0
    lost = np.diff(run["energy"])
    assert run.success and lost.max() < 1e-9 * run["energy"][0]
    assert sorted(run.phases[-1].modes.values()) == ["open", "open", "stick", "stick"]
    assert min(abs(run["y"][-1] - size) for size in (0.2, 0.3)) < 1e-12


def test_coin_that_spins_down(page):
    """Newton and Euler on the frame of the leaning coin, whose centre has the velocity r omega x y; and the energy.

    The moment that resists spin is that of the normal reaction m (g + z''), z being r sin(theta).
    """
    m, r, g, width = 0.01, 0.02, 9.81, 5e-4
    A, C = m * r**2 / 4, m * r**2 / 2

    def spin(state):
        return state[4] * np.sin(state[0]) + state[5] * np.cos(state[0])

    def rates(t, state):
        theta, psi, _, w1, w2, w3, _, _, _ = state
        sine, cosine = np.sin(theta), np.cos(theta)
        nu = w2 / sine * cosine
        tilts = (A * nu * w2 - C * w2 * w3 - m * r * (r * w2 * w3 + g * cosine)) / (A + m * r**2)
        moment = width * m * (g + r * (cosine * tilts - sine * w1**2))
        resists = -moment * np.sign(spin(state))
        forward, down = -r * w3, -r * w1 * sine
        return [
            w1,
            w2 / sine,
            w3 - nu,
            tilts,
            (C * w1 * w3 - A * nu * w1 + resists * sine) / A,
            (m * r**2 * w1 * w2 + resists * cosine) / (C + m * r**2),
            forward * np.cos(psi) - down * np.sin(psi),
            forward * np.sin(psi) + down * np.cos(psi),
            moment * abs(spin(state)),
        ]

    run, theta = page["coin"], 1.3
    start = [theta, 0, 0, 0, 30 * np.sin(theta), 0, 0, 0, 0]
    exact = solve_ivp(rates, (0, 0.7), start, rtol=1e-12, atol=1e-14, method="DOP853").y
    assert [phase.modes for phase in run.phases] == [{"edge": "stick", "edge.drilling": "slip"}]
    assert spin(exact).min() > 0 and exact[0].min() < 0.8
    end = exact[:, -1]
    for name, value in zip(("theta", "psi", "phi", "theta_dot"), end, strict=False):
        assert abs(run[name][-1] - value) < 1e-8 * max(1, abs(value)), name
    assert abs(np.array([run["x"][-1], run["y"][-1]]) - end[6:8]).max() < 1e-9
    assert abs(run["energy"][0] - run["energy"][-1] - end[8]) < 1e-9 * run["energy"][0]
    theta, _, _, w1, w2, w3, *_ = end
    d1 = rates(0, end)[3]
    nu = w2 / np.tan(theta)
    push = m * ((-r * nu * w3 - r * w1**2) * np.sin(theta) + (r * d1 + r * w2 * w3) * np.cos(theta) + g)
    assert abs(run["edge.normal"][-1] - push) < 1e-7 * push
    np.testing.assert_allclose(run["edge.drilling_1"], -width * run["edge.normal"], rtol=1e-12)


def test_ball_in_a_bowl():
    """The angular frequency of small oscillations, sqrt(5 g / (7 (R - r))), with its correction by the amplitude."""
    m, r, R, g, mu = sp.symbols("m r R g mu", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    x, y, turn = dynamicsymbols("x y turn")
    scene = da.Scene("ball_in_bowl", frame=N, origin=O, coordinates=[x, y, turn])
    S, G = N.orientnew("S", "Axis", (turn, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, 0, 0, 2 * m * r**2 / 5), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_contacts(da.SphereInBowl("bowl", body="ball", centre=G, radius=r, bowl=(O, R), friction=mu))
    model = da.compile_model(scene, outputs=["bowl.normal"])
    dip = {x: 9e-4, y: -((0.9**2 - 9e-4**2) ** 0.5), turn: 0, x.diff(): 0, y.diff(): 0, turn.diff(): 0}
    run = model.simulate((0, 10), dip, {m: 1, g: 9.81, r: 0.1, R: 1, mu: 0.5}, rtol=1e-11)
    x = lambda t: run(np.array([t]))["x"][0]  # noqa: E731
    frequency, amplitude = np.sqrt(5 * 9.81 / (7 * 0.9)), np.arcsin(1e-3)
    period = 2 * np.pi / frequency
    zeros = [brentq(x, (k + 0.2) * period, (k + 0.3) * period, xtol=1e-14) for k in (0, 3)]
    assert abs((zeros[1] - zeros[0]) / 3 / period - 1 - amplitude**2 / 16) < 1e-9
    assert run.phases[0].modes == {"bowl": "stick"} and len(run.phases) == 1


def test_a_wheel_meets_the_edge_of_a_step():
    """The edge is a point, a circle of radius 0; the angular momentum about it stays in the impact."""
    x, y, theta = dynamicsymbols("x y theta")
    T = sp.Symbol("T")
    m, J, r, h, g = 2.0, 0.04, 0.2, 0.05, 9.81
    N, O = ReferenceFrame("N"), Point("O")
    S, C = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("C", x * N.x + y * N.y)
    scene = da.Scene("step", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("wheel", C, S, m, (inertia(S, 0, 0, J), C)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((S, -T * N.z))
    floor = da.SpherePlane("floor", body="wheel", centre=C, radius=r, plane=(O, N.y), friction=0.8)
    centres = (C, O.locatenew("E", h * N.y))
    scene.add_contacts(
        floor, da.SphereSphere("edge", bodies=("wheel", None), centres=centres, radii=(r, 0), friction=1.5)
    )
    model = da.compile_model(scene)
    before, away = 1.2, np.sqrt(r**2 - (r - h) ** 2)
    start = {x: -away - 0.12, y: r, theta: 0, x.diff(): before, y.diff(): 0, theta.diff(): -before / r}
    run = model.simulate((0, 0.1 + 1e-9), start, {T: 0})
    after = (m * before * (r - h) + J * before / r) / (J + m * r**2)
    assert run.success and run.mode("edge")[-1] == "stick" and run.mode("floor")[-1] == "open"
    np.testing.assert_allclose(run.qdot[-1], [after * (r - h), after * away, -after], atol=1e-6)
    rest = start | {x: -away, x.diff(): 0, theta.diff(): 0}
    for share in (0.99, 1.01):
        lifted = model.simulate((0, 0.05), rest, {T: share * m * g * away})
        assert lifted.success and (lifted["y"][-1] > r + 1e-6) == (share > 1)
