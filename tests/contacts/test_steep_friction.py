"""Steep friction in a plane: impacts always have an outcome, and reactions without bound stop slow slip."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm.loops import loop_named
from dalembert.contacts.contact_cases import contact_cases
from dalembert.contacts.contact_system import SLIP, STICK
from dalembert.contacts.selection.mode_candidates import BREAK_PLANE, STOP
from dalembert.methods.status import Status
from dalembert.phases.decisions import LOOP


@cache
def points(count):
    """Return the model of points above a rough floor; tests replace all numbers of their contacts."""
    N, O = ReferenceFrame("N"), Point("O")
    places = [dynamicsymbols(f"x{i} y{i} z{i}") for i in range(count)]
    scene = da.Scene("points in space", frame=N, origin=O, coordinates=[q for place in places for q in place])
    for i, (x, y, z) in enumerate(places):
        at = O.locatenew(f"P{i}", x * N.x + y * N.y + z * N.z)
        scene.add_bodies(Particle(f"point{i}", at, sp.Integer(1)))
        scene.add_contacts(da.PointPlane(f"c{i}", body=f"point{i}", point=at, plane=(O, N.z), friction=sp.Integer(1)))
    return da.compile_model(scene)


def closed(count, cases, most_friction, seed):
    """Return working memory, and numbers of random bodies whose contacts are all closed, by name (cases, ...)."""
    system, rng = points(count).modes.decisions.system(), np.random.default_rng(seed)
    n, rows = system.coordinates, len(system.jacobian)
    root = rng.normal(size=(cases, n, n))
    jacobian, power = rng.normal(size=(cases, rows, n)), np.zeros((cases, len(system.power), n))
    power[:, system.normal] = jacobian[:, system.constraint] * system.sense[:, np.newaxis]
    power[:, system.tangential] = jacobian[:, len(system.sense) :]
    mu = rng.uniform(0.5, most_friction, (cases, count))
    numbers = {"mass": root @ root.transpose(0, 2, 1) / n + 0.3 * np.eye(n), "forcing": 3 * rng.normal(size=(cases, n))}
    numbers |= {"jacobian": jacobian, "power": power, "mu": mu, "mu_static": mu, "rates": rng.normal(size=(cases, n))}
    return system, numbers


def decided(count, system, numbers, **known):
    """Return cases after one decision, from what is known of the motion before, and which of them had an impact."""
    k, model = len(numbers["rates"]), points(count)
    numbers["velocity"] = np.einsum("krn,kn->kr", numbers["jacobian"], numbers["rates"])
    values = np.zeros((k, system.values.size))
    for i in range(k):
        for name in numbers.keys() - {"rates"}:
            getattr(system, name)[...] = numbers[name][i]
        values[i] = system.values
    x = np.hstack([np.zeros_like(numbers["rates"]), numbers["rates"]])
    cases = contact_cases(np.zeros(k), x, np.zeros((k, len(model.layout.parameters))), np.ones(k), count)
    for name, value in known.items():
        getattr(cases, name)[...] = value
    arguments = model.modes.decisions.arguments(cases, values, np.arange(k), (0.0, 0.0))
    loop_named(LOOP)(arguments)
    return cases, arguments.after_impact != 0


@pytest.mark.parametrize(
    ("count", "most_friction", "seed", "k"),
    [
        *[(1, 2.0, 1, 300), (2, 2.0, 2, 300), (2, 0.6, 12, 300), (3, 1.0, 11, 100)],
        pytest.param(3, 1.0, 11, 300, marks=pytest.mark.matrix),
    ],
)
def test_an_impact_has_an_outcome_that_obeys_the_laws(count, most_friction, seed, k):
    """Steep friction has several directions of slip: in some of them a contact would pull.

    Directions that are improved one after the other may diverge.
    """
    system, numbers = closed(count, k, most_friction, seed=seed)
    normal = numbers["jacobian"][:, system.constraint] * system.sense[:, np.newaxis]
    push = np.linalg.solve(normal @ normal.transpose(0, 2, 1), np.ones((k, count, 1)))
    rates = numbers["rates"]
    approach = np.abs(np.einsum("kcn,kn->kc", normal, rates)) + np.einsum("kcn,kn->kc", normal, rates)
    rates -= np.einsum("kcn,kc->kn", normal, push[..., 0] * np.max(approach + 0.1, axis=1, keepdims=True))
    before = rates.copy()
    cases, struck = decided(count, system, numbers)
    found = cases.status == Status.SUCCESS
    assert found.all() and struck.all()
    slipping = 0
    for i in np.flatnonzero(found):
        after, jacobian = cases.x[i, system.coordinates :], numbers["jacobian"][i]
        impulse = np.linalg.lstsq(numbers["power"][i].T, numbers["mass"][i] @ (after - before[i]), rcond=None)[0]
        size = 1e-7 * (1.0 + np.abs(impulse).sum())
        for c in range(count):
            press, mu = impulse[system.normal[c]], numbers["mu"][i, c]
            force = impulse[system.tangential[2 * c : 2 * c + 2]]
            slip = jacobian[system.row[c] : system.row[c] + 2] @ after
            gap = normal[i, c] @ after
            assert press > -size and gap > -1e-7 and (press < size or gap < 1e-7)
            assert np.hypot(*force) < mu * press + size
            if np.hypot(*slip) > 1e-6:
                np.testing.assert_allclose(force, -mu * press * slip / np.hypot(*slip), atol=10 * size)
                slipping += press > size
    assert slipping > k // 6


def paradoxes():
    """Return one contact that slips, and which of 200 cases have no reaction that satisfies the laws."""
    system, numbers = closed(1, 200, 2.0, seed=3)
    rates, normal = numbers["rates"], numbers["jacobian"][:, system.constraint[0]]
    rates -= normal * (np.einsum("kn,kn->k", normal, rates) / np.einsum("kn,kn->k", normal, normal))[:, np.newaxis]
    slip = np.einsum("krn,kn->kr", numbers["jacobian"][:, 1:], rates)
    pulled = numbers["power"][:, system.normal[0]] - numbers["mu"] * np.einsum(
        "kr,krn->kn", slip / np.linalg.norm(slip, axis=1, keepdims=True), numbers["power"][:, system.tangential]
    )
    inverse = np.linalg.inv(numbers["mass"])
    ease = np.einsum("kn,knm,km->k", normal * system.sense[0], inverse, pulled)
    falls = np.einsum("kn,knm,km->k", normal * system.sense[0], inverse, numbers["forcing"])
    return system, numbers, np.linalg.norm(slip, axis=1), (ease < 0.0) & (falls < 0.0)


def test_reactions_without_bound_stop_slow_slip_in_a_plane():
    system, numbers, slip, none = paradoxes()
    assert 10 < none.sum() < 100
    cases, struck = decided(1, system, numbers, modes=SLIP, speeds=slip[:, np.newaxis])
    assert np.all(cases.status[none] == Status.CONTACT_IMPOSSIBLE) and not struck.any()
    cases, struck = decided(1, system, numbers, modes=SLIP, speeds=1e4 * slip[:, np.newaxis])
    assert not np.any(struck[~none]) and struck[none].mean() > 0.7
    np.testing.assert_array_equal(cases.status == Status.CONTACT_IMPOSSIBLE, none & ~struck)
    left = np.einsum("krn,kn->kr", numbers["jacobian"], cases.x[:, system.coordinates :])
    np.testing.assert_allclose(left[struck], 0.0, atol=1e-12)
    cases, struck = decided(1, system, numbers, modes=SLIP, speeds=1e7 * slip[:, np.newaxis])  # as slow as rest
    assert np.all(cases.status[none] == Status.SUCCESS) and not struck.any()
    left = np.einsum("krn,kn->kr", numbers["jacobian"], cases.x[:, system.coordinates :])
    np.testing.assert_allclose(left[none], 0.0, atol=1e-12)


def test_what_begins_to_slip_is_not_moved_by_another_contact_that_stops():
    """The slip that a contact has left where it stops would give the other one a direction."""
    system, numbers = closed(2, 800, 0.8, seed=5)
    jacobian, rates = numbers["jacobian"], numbers["rates"]
    rest = np.zeros((800, 6))
    rest[:, 2:4] = 1e-5 * np.random.default_rng(6).normal(size=(800, 2))
    rates[...] = np.linalg.solve(jacobian, rest[..., np.newaxis])[..., 0]
    added = np.tile([1.0, 0.0, 1.0, -1e-4, 1.0, 0.0, 1.0, -1e-4], (800, 1))
    cases, _ = decided(
        2, system, numbers, modes=[SLIP, STICK], fired=[STOP, BREAK_PLANE], added=added, speeds=1.0, passed=1.0
    )
    chosen = (cases.status == Status.SUCCESS) & np.all(cases.modes == [STICK, SLIP], axis=1)
    assert chosen.sum() > 10
    left = np.einsum("krn,kn->kr", jacobian, cases.x[:, system.coordinates :])
    np.testing.assert_allclose(left[chosen], 0.0, atol=1e-14)
