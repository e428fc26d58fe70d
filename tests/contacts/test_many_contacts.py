"""Modes of many contacts: a search finds what trying every combination finds, and what it finds obeys the laws."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm.loops import loop_named
from dalembert.contacts.contact_cases import contact_cases
from dalembert.contacts.contact_system import OPEN, SLIP, STICK
from dalembert.contacts.selection import mode_candidates as rules
from dalembert.methods.status import Status
from dalembert.phases.decisions import LOOP
from hard_cases.contacts import loose_plate
from hard_cases.many_contacts import boxes, boxes_at_rest, feet, feet_at_rest

TIME = dynamicsymbols._t
OK, IMPOSSIBLE, AMBIGUOUS = Status.SUCCESS, Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS


@cache
def points(count, *, chained=False, impacts="newton"):
    """Return the model of points on a rough floor that are pushed; each lies on the one before it where `chained`."""
    g, push = sp.symbols("g push", real=True)
    N, O = ReferenceFrame("N"), Point("O")
    places = [dynamicsymbols(f"x{i} y{i}") for i in range(count)]
    scene = da.Scene("points", frame=N, origin=O, coordinates=[q for place in places for q in place])
    at = [O.locatenew(f"P{i}", x * N.x + y * N.y) for i, (x, y) in enumerate(places)]
    for i, (x, y) in enumerate(places):
        m, mu = sp.symbols(f"m{i} mu{i}", positive=True)
        scene.add_bodies(Particle(f"point{i}", at[i], m))
        scene.add_loads((at[i], push * sp.sin(2 * TIME + i) * N.x - m * g * N.y))
        normal, force = da.unknowns(f"R{i} F{i}")
        below = places[i - 1] if chained and i > 0 else (sp.Integer(0), sp.Integer(0))
        scene.add_joints(da.Joint(f"up{i}", body=f"point{i}", at=at[i], force=force * N.x + normal * N.y))
        if chained and i > 0:
            down = -force * N.x - normal * N.y
            scene.add_joints(da.Joint(f"down{i}", body=f"point{i - 1}", at=at[i - 1], force=down))
        scene.add_contacts(da.UnilateralContact(normal, gap=y - below[1], name=f"c{i}"))
        slip = x.diff(TIME) - below[0].diff(TIME)
        scene.add_friction(da.CoulombFriction(normal, force, slip=slip, mu=mu, name=f"c{i}"))
    return da.compile_model(scene, impacts=impacts)


def problems(system, count, most_friction, *, moving, seed):
    """Return numbers of contacts (count, n_values) and rates (count, n_q): random bodies, all contacts closed."""
    rng, n, m, k, s = np.random.default_rng(seed), system.coordinates, system.constraints, system.contacts, system.slips
    values, rates = [], []
    for _ in range(count):
        root = rng.normal(size=(n, n))
        mass, jacobian = root @ root.T / n + 0.3 * np.eye(n), rng.normal(size=(m + s, n))
        qdot = rng.normal(size=n) * moving
        velocity = np.concatenate([np.zeros(m), (jacobian[m:] @ qdot) * (rng.random(s) < 0.5)])
        power = np.zeros((2 * k, n))
        power[system.normal] = jacobian[system.constraint] * system.sense[:, None]
        power[system.tangential] = jacobian[system.row]
        mu = rng.uniform(0.0, most_friction, k)
        static = mu * (1.0 + (rng.random(k) < 0.4) * rng.random(k) / 2)
        parts = mass.ravel(), 3 * rng.normal(size=n), jacobian.ravel(), np.zeros(m + s), velocity, power.ravel()
        values.append(np.concatenate([*parts, np.zeros(k), mu, static, np.zeros(3 * k)]))
        rates.append(qdot)
    return np.array(values), np.array(rates)


def decided(model, values, rates, most):
    """Return cases with the selected modes; up to so many combinations are all tried."""
    count, n = rates.shape
    x, p = np.hstack([np.zeros((count, n)), rates]), np.zeros((count, len(model.layout.parameters)))
    cases = contact_cases(np.zeros(count), x, p, np.ones(count), len(model.contacts))
    arguments = model.modes.decisions.arguments(cases, values, np.arange(count), (0.0, 0.0))
    arguments.candidates.found.most = most
    loop_named(LOOP)(arguments)
    return cases


def forces(system, motion, modes):
    """Return normal reactions, friction forces, gap and slip accelerations of a motion (n_q,), from M a - forcing."""
    rows = np.vstack([system.power[system.normal], system.power[system.tangential]])
    found = np.linalg.lstsq(rows.T, system.mass @ motion - system.forcing, rcond=None)[0]
    accelerations = system.jacobian @ motion - system.bias
    k = system.contacts
    return found[:k], found[k:], accelerations[system.constraint] * system.sense, accelerations[system.row]


@pytest.mark.parametrize("moving", [0.0, 1.0])
@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_a_search_selects_the_modes_that_trying_every_combination_selects(count, moving):
    model = points(count)
    values, rates = problems(model.modes.decisions.system(), 60, 0.5, moving=moving, seed=count)
    everything, search = (decided(model, values, rates, most) for most in (rules.ALL, 0))
    np.testing.assert_array_equal(search.status, everything.status)
    good = everything.status == OK
    assert good.sum() > 50 and len(np.unique(everything.number)) > 5
    np.testing.assert_array_equal(search.modes[good], everything.modes[good])
    np.testing.assert_allclose(search.motion[good], everything.motion[good], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("moving", [0.0, 1.0])
@pytest.mark.parametrize("count", [2, 4])
def test_with_much_friction_no_mode_is_selected_where_none_is_lawful_and_several_are_noticed(count, moving):
    model = points(count)
    values, rates = problems(model.modes.decisions.system(), 250, 2.0, moving=moving, seed=3)
    everything, search = (decided(model, values, rates, most) for most in (rules.ALL, 0))
    np.testing.assert_array_equal(search.status == IMPOSSIBLE, everything.status == IMPOSSIBLE)
    several = everything.status == AMBIGUOUS
    assert several.sum() >= 5
    assert (search.status[several] == AMBIGUOUS).sum() > 0.7 * several.sum()
    assert not np.any(search.status[~several] == AMBIGUOUS)  # two lawful modes are shown, or none


@pytest.mark.parametrize("count", [8, 12])
def test_the_modes_of_many_contacts_obey_the_laws(count):
    """Of 12 contacts there are 17 million combinations."""
    model, lawful = points(count), 0
    system = model.modes.decisions.system()
    values, rates = problems(system, 40, 0.5, moving=0.0, seed=count)
    cases = decided(model, values, rates, 256)
    for i in np.flatnonzero(cases.status == OK):
        system.values[:] = values[i]
        press, friction, gaps, slips = forces(system, cases.motion[i], cases.modes[i])
        mode, size = cases.modes[i], 1e-7 * (1.0 + np.abs(press).sum())
        opened, slipping, sticking = (mode == state for state in (OPEN, SLIP, STICK))
        np.testing.assert_allclose(np.append(press[opened], friction[opened]), 0.0, atol=size)
        np.testing.assert_allclose(np.append(gaps[~opened], slips[sticking]), 0.0, atol=1e-7)
        assert np.all(press > -size) and np.all(gaps > -1e-7)
        assert np.all(np.abs(friction[sticking]) < system.mu_static[sticking] * press[sticking] + size)
        against = -np.sign(slips[slipping]) * system.mu[slipping] * press[slipping]
        np.testing.assert_allclose(friction[slipping], against, atol=size)
        lawful += 1
    assert lawful > 35


@pytest.mark.parametrize("rank", [10, 16])
def test_modes_are_found_of_contacts_that_are_redundant(rank):
    """The 24 rows of 12 contacts at rest depend on each other, so that forces are not determined by the motion."""
    model, rng = points(12), np.random.default_rng(7)
    system = model.modes.decisions.system()
    n, m, k, s = system.coordinates, system.constraints, system.contacts, system.slips
    values = []
    for _ in range(45):
        root = rng.normal(size=(n, n))
        mass = root @ root.T / n + 0.3 * np.eye(n)
        jacobian = rng.normal(size=(m + s, rank)) @ rng.normal(size=(rank, n)) / np.sqrt(rank)
        power = np.zeros((2 * k, n))
        power[system.normal] = jacobian[system.constraint] * system.sense[:, None]
        power[system.tangential] = jacobian[system.row]
        mu = rng.uniform(0.0, 0.5, k)
        static = mu * (1.0 + (rng.random(k) < 0.4) * rng.random(k) / 2)
        rest = np.zeros(m + s)
        parts = mass.ravel(), 3 * rng.normal(size=n), jacobian.ravel(), rest, rest, power.ravel()
        values.append(np.concatenate([*parts, np.zeros(k), mu, static, np.zeros(3 * k)]))
    cases = decided(model, np.array(values), np.zeros((45, n)), 256)
    assert not np.any(cases.status == IMPOSSIBLE)
    assert np.mean(cases.status == OK) > 0.9


def _search_always(monkeypatch):
    monkeypatch.setattr(rules, "FEW_CONTACTS", 0)
    monkeypatch.setattr(rules, "_FEW", 0)


def _compare(motion, other):
    assert [phase.modes for phase in motion.phases] == [phase.modes for phase in other.phases]
    ends = [[phase.t0 for phase in each.phases] for each in (motion, other)]
    np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(motion.q[-1], other.q[-1], rtol=0.0, atol=1e-8)


def test_a_motion_is_the_same_whether_its_modes_are_searched_for_or_all_tried(monkeypatch):
    """A stack of three points that slip and stick on each other, and a plate whose ends share a load."""
    model = points(3, chained=True)
    p = {"g": 10.0, "push": 9.0, **{f"m{i}": 1.0 + i for i in range(3)}, **{f"mu{i}": 0.2 + 0.1 * i for i in range(3)}}
    start = {f"{name}{i}{rate}": 0.0 for name in "xy" for i in range(3) for rate in ("", "_dot")}
    plate = da.compile_model(loose_plate(ground=sp.Float(0.6), corner=sp.Float(0.6)))
    values = {"m": 1.0, "l": 1.0, "h": 0.8, "g": 9.81}
    leaning = {"x": -0.8 / np.tan(0.7), "y": 0.0, "theta": 0.7, "y_dot": 0.0, "theta_dot": 1.0}
    leaning["x_dot"] = 0.8 / np.sin(0.7) ** 2
    found = []
    for search in (False, True):
        if search:
            _search_always(monkeypatch)
        points_run = model.simulate((0.0, 3.0), start, p, rtol=1e-10, atol=1e-12)
        found.append((points_run, plate.simulate((0.0, 1.0), leaning, values, rtol=1e-10, atol=1e-12)))
        model.modes.recorders.clear()
    for motion, other in zip(*found, strict=True):
        assert motion.success and len(motion.phases) > 1
        _compare(motion, other)


def test_feet_that_are_alike_break_away_together():
    """All four are at the limit of friction at one instant, and rounding decides which are found to be beyond it."""
    model = da.compile_model(feet(4))
    start, p = feet_at_rest(4, uneven=0.0)
    run = model.simulate((0.0, 1.0), start, p)
    assert run.success
    assert [set(phase.modes.values()) for phase in run.phases] == [{"stick"}, {"slip"}] * 2 + [{"stick"}]


def test_corners_of_a_box_do_not_slip_against_each_other():
    """At the limit of friction, where rounding decides, the guard of the lowest box has fired; the upper one stays."""
    model = da.compile_model(boxes(2))
    start, p = boxes_at_rest(2)
    decisions, layout = model.modes.decisions, model.layout
    x, parameters = (
        np.array([[values[n] for n in names]]) for values, names in ((start, layout.variables), (p, layout.parameters))
    )
    for t in np.arcsin(0.625) / 3.0 + np.arange(-4, 5) * 3e-17:
        cases = contact_cases(np.array([t]), x, parameters, np.ones(1), 4)
        cases.modes[:], cases.passed[:], cases.fired[0, 0] = STICK, t, rules.SHARE
        arguments = decisions.arguments(
            cases, decisions.values(cases.t, cases.x, cases.p), np.zeros(1, np.int64), (0.0, 0.0)
        )
        loop_named(LOOP)(arguments)
        assert cases.status[0] == OK
        assert cases.modes[0].tolist() == [SLIP, SLIP, STICK, STICK]
