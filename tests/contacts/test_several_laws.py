"""Several laws of friction under one normal reaction: random bodies, against trial of all combinations by hand."""

import numpy as np
import pytest
from scipy.optimize import linprog
from sympy import symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from contacts.by_hand import after_impact, solutions
from contacts.test_many_contacts import decided
from dalembert.contacts.selection import mode_candidates as rules
from dalembert.methods.status import Status


def balls(count, impacts):
    """Return the model of balls on a floor that slide and roll, of which random numbers take the place."""
    N, O = ReferenceFrame("N"), Point("O")
    r, mu, d = symbols("r mu d", positive=True)
    q = [dynamicsymbols(f"x{i} y{i} turn{i}") for i in range(count)]
    scene = da.Scene("balls", frame=N, origin=O, coordinates=[each for three in q for each in three])
    for i, (x, y, turn) in enumerate(q):
        S, G = N.orientnew(f"S{i}", "Axis", (turn, N.z)), O.locatenew(f"G{i}", x * N.x + y * N.y)
        scene.add_bodies(RigidBody(f"ball{i}", G, S, 1, (inertia(S, 0, 0, 1), G)))
        plane = {"centre": G, "radius": r, "plane": (O, N.y), "friction": mu, "rolling_resistance": d}
        scene.add_contacts(da.SpherePlane(f"c{i}", body=f"ball{i}", **plane))
    return da.compile_model(scene, impacts=impacts)


@pytest.fixture(scope="module")
def models():
    return {(count, law): balls(count, law) for count in (1, 2) for law in ("newton", "poisson")}


def problems(system, count, most_friction, seed, *, approach):
    """Return numbers of contacts (count, n_values) and rates (count, n_q): random bodies, all contacts closed.

    They approach, or are at rest and pushed.
    """
    rng, n, m, s = np.random.default_rng(seed), system.coordinates, system.constraints, system.slips
    opening, values, rates = system.constraint[system.constraint >= 0], [], []
    for _ in range(count):
        root, jacobian, v = rng.normal(size=(n, n)), rng.normal(size=(m + s, n)), rng.normal(size=n) * approach
        mass = root @ root.T / n + 0.3 * np.eye(n)
        if approach:
            jacobian[opening] *= -np.sign(jacobian[opening] @ v)[:, None]
        power = np.zeros((len(system.owner), n))
        power[system.normal[system.constraint >= 0]] = jacobian[opening]
        power[system.tangential] = jacobian[m:]
        k = system.contacts
        mus, es = rng.uniform(0, most_friction, k), rng.random(k) * (system.constraint >= 0)
        parts = mass.ravel(), 3 * rng.normal(size=n), jacobian.ravel(), np.zeros(m + s), jacobian @ v, power.ravel()
        values.append(np.concatenate([*parts, np.zeros(k), mus, mus, es, np.zeros(2 * k)]))
        rates.append(v)
    return np.array(values), np.array(rates)


def laws_of(system, numbers):
    """Return mass matrix, forcing, rows of gaps and slips, coefficients of laws and contacts, owners of the laws."""
    system.values[:] = numbers
    leads = [i for i in range(system.contacts) if system.constraint[i] >= 0]
    place = {i: number for number, i in enumerate(leads)}
    assert np.all(system.sense == 1) and np.all(system.width == 1)
    rows = np.vstack([system.jacobian[system.constraint[leads]], system.jacobian[system.row]])
    owners = [place[i] for i in system.leader]
    return system.mass.copy(), system.forcing.copy(), rows, system.mu.copy(), system.restitution[leads], owners


@pytest.mark.parametrize("most", [rules.ALL, 0])
@pytest.mark.parametrize("count", [1, 2])
def test_modes_at_rest(models, count, most):
    model, compared = models[count, "newton"], 0
    system = model.modes.decisions.system()
    assert system.contacts == 2 * count
    values, rates = problems(system, 150, 0.5, seed=count, approach=0.0)
    cases = decided(model, values, rates, most)
    for numbers, motion, status in zip(values, cases.motion, cases.status, strict=True):
        mass, forcing, rows, mus, _, owners = laws_of(system, numbers)
        inverse = np.linalg.inv(mass)
        free = inverse @ forcing
        found = solutions(rows @ inverse @ rows.T, rows @ free, mus, np.zeros(count), owners)
        if len(found) == 1:
            compared += 1
            assert status == Status.SUCCESS
            np.testing.assert_allclose(motion, free + inverse @ rows.T @ found[0], rtol=1e-8, atol=1e-8)
    assert compared > 120


@pytest.mark.parametrize("most", [rules.ALL, 0])
@pytest.mark.parametrize("law", ["newton", "poisson"])
@pytest.mark.parametrize("count", [1, 2])
def test_impacts(models, count, law, most):
    model, compared = models[count, law], 0
    system, n = model.modes.decisions.system(), 3 * count
    values, rates = problems(system, 150, 0.5, seed=3 + count, approach=1.0)
    cases = decided(model, values, rates, most)
    for numbers, before, after, status in zip(values, rates, cases.x[:, n:], cases.status, strict=True):
        mass, _, rows, mus, es, owners = laws_of(system, numbers)
        expected = after_impact(mass, rows, before, mus, es, owners, poisson=law == "poisson")
        if expected is not None:
            compared += 1
            assert status == Status.SUCCESS
            np.testing.assert_allclose(after, expected, rtol=1e-8, atol=1e-8)
    assert compared > 120


@pytest.mark.parametrize("count", [1, 2])
def test_energy_never_grows_by_the_law_of_poisson(models, count):
    """With one restitution, whatever the coefficients of the laws are."""
    model, n = models[count, "poisson"], 3 * count
    system = model.modes.decisions.system()
    values, rates = problems(system, 400, 1.0, seed=9, approach=1.0)
    place = values.shape[1] - 3 * system.contacts + np.flatnonzero(system.constraint >= 0)
    values[:, place] = values[:, place[:1]]
    cases = decided(model, values, rates, rules.ALL)
    good = cases.status == Status.SUCCESS
    assert good.sum() > 380
    after, mass = cases.x[:, n:], values[:, : n * n].reshape(-1, n, n)
    before, left = (np.einsum("ci,cij,cj->c", v, mass, v) for v in (rates, after))
    assert np.all(left[good] <= before[good] * (1 + 1e-12)) and np.mean(left[good] / before[good]) < 0.9


@pytest.fixture(scope="module")
def corner():
    """Return the model of a ball in a corner, which forces X, Y and a moment T push: four laws share its load."""
    N, O = ReferenceFrame("N"), Point("O")
    x, y, turn = dynamicsymbols("x y turn")
    X, Y, T, r, mu_1, mu_2, d_1, d_2 = symbols("X Y T r mu_1 mu_2 d_1 d_2")
    scene = da.Scene("corner", frame=N, origin=O, coordinates=[x, y, turn])
    S, G = N.orientnew("S", "Axis", (turn, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ball", G, S, 1, (inertia(S, 0, 0, 0.4), G)))
    scene.add_loads((G, X * N.x + Y * N.y), (S, T * N.z))
    on = {"body": "ball", "centre": G, "radius": r}
    scene.add_contacts(
        da.SpherePlane("floor", **on, plane=(O, N.y), friction=mu_1, rolling_resistance=d_1),
        da.SpherePlane("wall", **on, plane=(O, N.x), friction=mu_2, rolling_resistance=d_2),
    )
    return da.compile_model(scene)


def margin_at_rest(p):
    """Return the largest least margin of the laws with which forces at rest balance, by a linear program."""
    r, columns = p["r"], []
    rows = np.array([[0, 1, 0], [1, 0, r], [0, 0, 1], [1, 0, 0], [0, 1, -r], [0, 0, 1]])
    for force, normal, most in ((1, 0, p["mu_1"]), (2, 0, p["d_1"]), (4, 3, p["mu_2"]), (5, 3, p["d_2"])):
        for sign in (1, -1):
            law = np.zeros(7)
            law[normal], law[force], law[6] = -most, sign, 1.0
            columns.append(law)
    balance, load = np.hstack([rows.T, np.zeros((3, 1))]), -np.array([p["X"], p["Y"], p["T"]])
    nothing = np.zeros(len(columns))
    limits = [(None, None)] * 6 + [(None, 10.0)]
    found = linprog([0] * 6 + [-1], np.array(columns), nothing, balance, load, limits)
    return found.x[6]


@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_a_ball_in_a_corner_rests_as_long_as_some_way_to_share_its_load_is_lawful(corner, size):
    """In lengths of `size`; a motion that is lawful beside rest makes it ambiguous."""
    rng = np.random.default_rng(4)
    names = {"X": 5, "Y": 5, "T": 2 * size, "mu_1": 0.8, "mu_2": 0.8, "d_1": 0.3 * size, "d_2": 0.3 * size}
    cases = {name: rng.uniform(0 if name[0] in "md" else -most, most, 150) for name, most in names.items()}
    cases["X"], cases["Y"] = cases["X"] - 3, cases["Y"] - 3
    start = {"x": size, "y": size, "turn": 0, "x_dot": 0, "y_dot": 0, "turn_dot": 0}
    sweep = corner.sweep((0, 1e-9), start, {**cases, "r": size})
    modes = np.array([sweep.mode(name) for name in corner.contacts])
    margins = np.array([margin_at_rest({name: v[i] for name, v in cases.items()} | {"r": size}) for i in range(150)])
    rests = np.all(modes == "stick", axis=0)
    lawful, ambiguous = margins > 1e-6 * size, sweep.status == Status.CONTACT_AMBIGUOUS
    assert not np.any(sweep.status == Status.CONTACT_IMPOSSIBLE) and not np.any(np.abs(margins) < 1e-6 * size)
    assert np.all(rests[lawful & ~ambiguous]) and not np.any(rests[~lawful])
    assert lawful.sum() > 30 and ambiguous.sum() < 0.5 * lawful.sum()
