"""Impacts with several contacts: all at once by Newton's law, or one after the other."""

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import OptionError

N, O = ReferenceFrame("N"), Point("O")
e, g, mu = symbols("e g mu", positive=True)
X = dynamicsymbols("x1:6")
RADIUS = 0.1


def balls(count, impacts, masses=None, backend="llvm"):
    """Return the model of balls in a row along N.x."""
    scene = da.Scene("row", frame=N, origin=O, coordinates=X[:count])
    points = [O.locatenew(f"P{i}", q * N.x) for i, q in enumerate(X[:count])]
    masses = masses or [1] * count
    scene.add_bodies(*(Particle(f"b{i}", p, mass) for i, (p, mass) in enumerate(zip(points, masses, strict=True))))
    for i in range(count - 1):
        pair = {"bodies": (f"b{i}", f"b{i + 1}"), "centres": points[i : i + 2], "radii": (RADIUS, RADIUS)}
        scene.add_contacts(da.SphereSphere(f"c{i}", **pair, restitution=e))
    return da.compile_model(scene, impacts=impacts, backend=backend)


@pytest.fixture(scope="module")
def row():
    return {law: balls(3, law) for law in ("newton", "sequence")}


def after(model, places, rates, restitution=1.0, until=1.0):
    """Return the run, and the velocities at its end."""
    names = [q.func.__name__ for q in X[: len(places)]]
    start = {**dict(zip(names, places, strict=True)), **{f"{n}_dot": v for n, v in zip(names, rates, strict=True)}}
    run = model.simulate((0, until), start, {e: restitution})
    assert run.success
    return run, np.array([run[f"{name}_dot"][-1] for name in names])


def test_a_cradle(row):
    """Momentum goes through; by Newton's law at once both other balls leave together."""
    struck = ([-0.5, 0.2, 0.4], [1, 0, 0])
    run, rates = after(row["sequence"], *struck)
    assert abs(rates - [0, 0, 1]).max() < 1e-13
    assert "impacts shared an instant, first at t = 0.5" in run.message and "'sequence'" in run.message
    apart, same = after(row["sequence"], [-0.5, 0.2, 0.4 + 1e-6], [1, 0, 0])
    assert abs(rates - same).max() < 1e-13 and "Note" not in apart.message
    run, rates = after(row["newton"], *struck)
    assert abs(rates - [-1 / 3, 2 / 3, 2 / 3]).max() < 1e-13
    assert "several contacts took part in 1 impact, first at t = 0.5" in run.message and "Newton's law" in run.message


def test_both_ends_struck_at_once(row):
    for law in row:
        _, rates = after(row[law], [-0.5, 0.2, 0.9], [1, 0, -1])
        assert abs(rates - [-1, 0, 1]).max() < 1e-13, law


def test_each_law_is_that_of_small_gaps_and_of_impulses_at_once():
    """Balls of masses 1, 2, 1/2 and e = 1/2, by the formulas of two balls; one impulse through both contacts."""
    masses, struck = [1, 2, 0.5], ([-0.5, 0.2, 0.4], [1, 0, 0])

    def pair(first, second, v, w):
        shared = (first * v + second * w) / (first + second)
        return shared - 0.5 * second / (first + second) * (v - w), shared + 0.5 * first / (first + second) * (v - w)

    v1, v2 = pair(1, 2, 1, 0)
    v2, v3 = pair(2, 0.5, v2, 0)
    for backend in ("llvm", "numpy"):
        _, rates = after(balls(3, "sequence", masses, backend), *struck, restitution=0.5)
        assert abs(rates - [v1, v2, v3]).max() < 1e-13
    _, rates = after(balls(3, "newton", masses), *struck, restitution=0.5)
    v1, v2 = pair(1, 2.5, 1, 0)
    assert abs(rates - [v1, v2, v2]).max() < 1e-13


def test_a_sequence_without_restitution_ends(row):
    """Infinitely many impacts that converge within the instant: the balls go on together, with their momentum."""
    run, rates = after(row["sequence"], [-0.5, 0.2, 0.4], [1, 0, 0], restitution=0.0)
    assert abs(rates - 1 / 3).max() < 1e-10
    assert run.phases[-1].modes == {"c0": "closed", "c1": "closed"}


def test_two_balls_go_through_five():
    _, rates = after(balls(5, "sequence"), [-0.7, -0.5, 0.2, 0.4, 0.6], [1, 1, 0, 0, 0])
    assert abs(rates - [0, 0, 0, 1, 1]).max() < 1e-13


@pytest.mark.parametrize("law", ["newton", "sequence"])
def test_a_box_comes_to_rest_on_two_corners(law):
    x, y, theta = dynamicsymbols("x y theta")
    scene = da.Scene("box", frame=N, origin=O, coordinates=[x, y, theta])
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("box", G, S, 1, (inertia(S, 0, 0, 0.13 / 3), G)))
    scene.apply_uniform_gravity(-g * N.y)
    box = da.BoxPlane("box", body="box", frame=S, centre=G, half_sizes=(0.3, 0.2), plane=(O, N.y), friction=mu)
    scene.add_contacts(box)
    start = {x: 0, y: 1, theta: 0, x.diff(): 0.5, y.diff(): 0, theta.diff(): 0}
    run = da.compile_model(scene, impacts=law).simulate((0, 1.5), start, {g: 9.81, mu: 0.5})
    assert run.success and sorted(run.phases[-1].modes.values()) == ["open", "open", "stick", "stick"]
    assert abs(run["y"][-1] - 0.2) < 1e-12 and abs(run["theta"][-1]) < 1e-12
    assert abs(run["x_dot"][-1]) < 1e-15 and abs(run.phases[1].t0 - np.sqrt(1.6 / 9.81)) < 1e-12


def test_explain_and_options(row):
    assert "impacts       sequence: the contact that approaches fastest is struck alone" in row["sequence"].explain()
    assert "impacts       newton: all contacts that touch take part at once" in row["newton"].explain()
    with pytest.raises(OptionError, match=r"law of impacts 'moreau'.*newton, poisson, sequence"):
        balls(2, "moreau")
