"""Several laws of friction under one normal reaction: random bodies, against trial of all combinations by hand."""

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from contacts.by_hand import after_impact, solutions
from contacts.test_many_contacts import decided
from dalembert.contacts import mode_candidates as rules
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
