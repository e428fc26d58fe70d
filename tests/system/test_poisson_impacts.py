"""Impacts by Poisson's law: impulses of compression and of restitution, against solutions by hand."""

import numpy as np
import pytest
import sympy as sp
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from contacts.by_hand import after_impact
from contacts.test_many_contacts import decided, points
from dalembert.contacts.selection import mode_candidates as rules
from dalembert.errors import OptionError
from dalembert.methods.status import Status

pytestmark = pytest.mark.usefixtures("quick_xla")

N, O = ReferenceFrame("N"), Point("O")
x, y, theta, a, b = dynamicsymbols("x y theta a b")
e, mu, g, h = symbols("e mu g h", positive=True)


def kane(impacts, backend="llvm"):
    """Return a double pendulum of two rods of length and mass one, whose tip may touch a floor at the depth h."""
    scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
    A, B = N.orientnew("A", "Axis", (a, N.z)), N.orientnew("B", "Axis", (b, N.z))
    elbow = O.locatenew("E", -A.y)
    G1, G2, tip = O.locatenew("G1", -A.y / 2), elbow.locatenew("G2", -B.y / 2), elbow.locatenew("T", -B.y)
    scene.add_bodies(
        RigidBody("upper", G1, A, 1, (inertia(A, 0, 0, sp.Rational(1, 12)), G1)),
        RigidBody("lower", G2, B, 1, (inertia(B, 0, 0, sp.Rational(1, 12)), G2)),
    )
    floor = O.locatenew("F", -h * N.y)
    scene.add_contacts(da.PointPlane("tip", body="lower", point=tip, plane=(floor, N.y), restitution=e, friction=mu))
    return da.compile_model(scene, impacts=impacts, backend=backend, outputs=["energy"])


def just_after(model, start, numbers):
    """Return the run, and the rates at its end, a moment after an impact at its start."""
    run = model.simulate((0, 1e-9), start, numbers)
    assert run.success, run.message
    return run, run.qdot[-1]


def test_the_example_of_kane():
    """Newton's law with friction makes energy; Poisson's does not (T. R. Kane, Mechanics and Mathematics, 1984)."""
    q, v = np.radians([20, 30]), np.array([-0.1, -0.2])
    c, depth = np.cos(q[0] - q[1]) / 2, np.cos(q).sum()
    M = np.array([[4 / 3, c], [c, 1 / 3]])
    rows = np.array([np.sin(q), np.cos(q)])
    before = v @ M @ v / 2
    for impacts, gains in (("newton", True), ("poisson", False)):
        model = kane(impacts)
        start = {a: q[0], b: q[1], a.diff(): v[0], b.diff(): v[1]}
        run, after = just_after(model, start, {e: 0.5, mu: 0.5, h: depth})
        assert (run["energy"][-1] > before) == gains
        if not gains:
            assert abs(after - after_impact(M, rows, v, [0.5], np.array([0.5]))).max() < 1e-8


def struck(model, count, most_friction, seed, *, equal=False):
    """Return numbers of contacts (count, n_values) and rates (count, n_q) of random bodies whose contacts approach."""
    system, rng = model.modes.decisions.system(), np.random.default_rng(seed)
    n, k = system.coordinates, system.contacts
    values, rates = [], []
    for _ in range(count):
        root, jacobian, v = rng.normal(size=(n, n)), rng.normal(size=(2 * k, n)), rng.normal(size=n)
        mass = root @ root.T / n + 0.3 * np.eye(n)
        jacobian[:k] *= -np.sign(jacobian[:k] @ v)[:, None] * system.sense[:, None]
        power = np.zeros((2 * k, n))
        power[system.normal], power[system.tangential] = jacobian[:k] * system.sense[:, None], jacobian[k:]
        mus = rng.uniform(0, most_friction, k)
        es = np.full(k, rng.random()) if equal else rng.random(k)
        numbers = np.zeros(k), mus, mus, es, np.zeros(2 * k)
        parts = mass.ravel(), rng.normal(size=n), jacobian.ravel(), np.zeros(2 * k), jacobian @ v, power.ravel()
        values.append(np.concatenate([*parts, *numbers]))
        rates.append(v)
    return np.array(values), np.array(rates)


def parts(model, numbers):
    """Return mass matrix, rows of gaps and slips, coefficients of friction and of restitution."""
    system = model.modes.decisions.system()
    system.values[:] = numbers
    rows = system.jacobian.copy()
    rows[: system.contacts] *= system.sense[:, None]
    return system.mass.copy(), rows, system.mu.copy(), system.restitution.copy()


@pytest.fixture(scope="module")
def floor():
    """Models of points on a floor, of which random numbers take the place."""
    return {count: points(count, impacts="poisson") for count in (1, 2, 3, 5)}


@pytest.mark.parametrize("count", [1, 2, 3])
def test_random_impacts_are_those_after_impact(floor, count):
    model, compared = floor[count], 0
    values, rates = struck(model, 60, 0.6, seed=count)
    cases = decided(model, values, rates, rules.ALL)
    n = rates.shape[1]
    for numbers, before, after, status in zip(values, rates, cases.x[:, n:], cases.status, strict=True):
        expected = after_impact(*parts(model, numbers)[:2], before, *parts(model, numbers)[2:])
        if expected is not None:
            compared += 1
            assert status == Status.SUCCESS
            np.testing.assert_allclose(after, expected, rtol=1e-9, atol=1e-9)
    assert compared > 45


@pytest.mark.parametrize("count", [3, 5])
def test_a_search_finds_what_trying_every_combination_finds(floor, count):
    model = floor[count]
    values, rates = struck(model, 60, 0.5, seed=7)
    everything, search = (decided(model, values, rates, most) for most in (rules.ALL, 0))
    np.testing.assert_array_equal(search.status, everything.status)
    good = everything.status == Status.SUCCESS
    assert good.sum() > 50
    np.testing.assert_allclose(search.x[good], everything.x[good], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("friction", "equal"), [(0.0, False), (0.8, True)])
@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_energy_never_grows(floor, count, friction, equal):
    model, n = floor[count], 2 * count
    values, rates = struck(model, 400, friction, seed=11, equal=equal)
    cases = decided(model, values, rates, rules.ALL if count < 5 else 256)
    good = cases.status == Status.SUCCESS
    assert good.sum() > 300
    after, mass = cases.x[:, n:], values[:, : n * n].reshape(-1, n, n)
    energies = [np.einsum("ci,cij,cj->c", v, mass, v) / 2 for v in (rates, after)]
    assert np.all(energies[1][good] <= energies[0][good] * (1 + 1e-12))


def row_of_balls(es, backend="llvm", impacts="poisson"):
    """Return the model of balls of mass one in a row, with the coefficients of restitution of neighbours."""
    q = dynamicsymbols(f"q1:{len(es) + 2}")
    scene = da.Scene("row", frame=N, origin=O, coordinates=q)
    at = [O.locatenew(f"P{i}", each * N.x) for i, each in enumerate(q)]
    scene.add_bodies(*(Particle(f"b{i}", point, 1) for i, point in enumerate(at)))
    for i, each in enumerate(es):
        pair = {"bodies": (f"b{i}", f"b{i + 1}"), "centres": at[i : i + 2], "radii": (0.1, 0.1)}
        scene.add_contacts(da.SphereSphere(f"c{i}", **pair, restitution=each))
    return da.compile_model(scene, impacts=impacts, backend=backend)


BALLS = {"q1": -0.5, "q2": 0.2, "q3": 0.4, "q1_dot": 1, "q2_dot": 0, "q3_dot": 0}


@pytest.mark.parametrize(
    ("es", "after"),
    [
        ((1, 1), (-1 / 3, 2 / 3, 2 / 3)),  # as by Newton's law
        ((0.5, 0.5), (0, 1 / 2, 1 / 2)),
        ((0, 1), (1 / 6, 1 / 6, 2 / 3)),  # impulses 2/3, 1/3; the second gives 1/3 back, which the first has to hold
        ((1, 0), (-1 / 3, 2 / 3, 2 / 3)),  # the second gives nothing back, but is pressed together
    ],
)
def test_three_balls(es, after):
    model = row_of_balls(es)
    run = model.simulate((0, 1), BALLS, {})
    np.testing.assert_allclose(run.qdot[-1], after, atol=1e-13)
    assert "several contacts took part in 1 impact, first at t = 0.5" in run.message and "Poisson's law" in run.message
    sweep = model.sweep((0, 1), {**BALLS, "q1_dot": np.array([1.0, 1.0])}, {})
    np.testing.assert_allclose([sweep[f"q{i}_dot"] for i in (1, 2, 3)], np.array([after, after]).T, atol=1e-13)


@pytest.mark.parametrize("backend", ["llvm", "numba", "jax", "numpy"])
def test_backends(backend):
    run = row_of_balls((0, 1), backend).simulate((0, 1), BALLS, {})
    np.testing.assert_allclose(run.qdot[-1], (1 / 6, 1 / 6, 2 / 3), atol=1e-12)


@pytest.fixture(scope="module")
def bouncers():
    """A ball on a floor by the laws of Newton and of Poisson."""
    return {law: bouncing(law) for law in ("newton", "poisson")}


def bouncing(law):
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[x, y, theta])
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ball", G, S, 1, (inertia(S, 0, 0, sp.Rational(2, 5)), G)))
    scene.apply_uniform_gravity(-g * N.y)
    ball = da.SpherePlane("floor", body="ball", centre=G, radius=1, plane=(O, N.y), restitution=e, friction=mu)
    scene.add_contacts(ball)
    return da.compile_model(scene, impacts=law)


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.6])
def test_a_central_impact_is_that_of_newton(bouncers, friction):
    """Friction has no hold on the normal impulse of a ball: both laws give one motion, to rest."""
    start = {x: 0, y: 2, theta: 0, x.diff(): 1, y.diff(): 0, theta.diff(): 3}
    one, other = (model.simulate((0, 4), start, {e: 0.6, mu: friction, g: 9.81}) for model in bouncers.values())
    assert one.success and other.success and len(one.phases) == len(other.phases) > 10
    np.testing.assert_allclose(one.q[-1], other.q[-1], atol=1e-9)
    np.testing.assert_allclose(one.qdot[-1], other.qdot[-1], atol=1e-9)


def test_a_box_that_tumbles_comes_to_rest():
    scene = da.Scene("box", frame=N, origin=O, coordinates=[x, y, theta])
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("box", G, S, 1, (inertia(S, 0, 0, 0.13 / 3), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_contacts(
        da.BoxPlane(
            "box",
            body="box",
            frame=S,
            centre=G,
            half_sizes=(0.3, 0.2),
            plane=(O, N.y),
            friction=mu,
            restitution=e,
        )
    )
    start = {x: 0, y: 1, theta: 0.3, x.diff(): 2, y.diff(): 0, theta.diff(): 3}
    model = da.compile_model(scene, impacts="poisson", outputs=["energy"])
    run = model.simulate((0, 4), start, {g: 9.81, mu: 0.5, e: 0.4})
    assert run.success and sorted(run.phases[-1].modes.values()) == ["open", "open", "stick", "stick"]
    energy = run["energy"]  # it ends on its short side
    assert np.all(np.diff(energy) < 1e-9 * energy[0]) and abs(energy[-1] - 0.3 * 9.81) < 1e-9


def test_what_is_said(bouncers):
    line = "impacts       poisson: all contacts that touch take part at once, and each returns its restitution times"
    assert line in bouncers["poisson"].explain()
    assert "impacts  " not in bouncers["newton"].explain()
    with pytest.raises(OptionError, match=r"law of impacts 'poison'.*newton, poisson, sequence"):
        bouncing("poison")
