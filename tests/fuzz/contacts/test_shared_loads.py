"""Contacts that hold each other while they stick: how long a lawful share of their load exists."""

import math

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import linprog, minimize
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.contacts.equations.shared_loads import SharedLaw, lawful_sums
from dalembert.ir.graph import Graph
from dalembert.results.shared_loads import _lawful
from fuzz.contacts.scenes import compiled, setting
from ir.trees import evaluate

WHEEL = dict.fromkeys(setting("wheel").parameters, 0.0)
WHEEL |= {"m": 1.8, "I": 0.036, "r": 0.2, "g_x": -1.1, "g_y": 9.81, "T": -2.2, "omega": 2.2, "mu": 0.7, "x_wall": 0.7}


@pytest.mark.parametrize("directions, laws", [(1, 4), (2, 6), (3, 8)])
def test_sums_of_laws_are_positive_where_a_share_breaks_none(directions, laws):
    rng, found = np.random.default_rng(directions), []
    for _ in range(40):
        values, slopes = rng.normal(size=laws) + 0.6, rng.normal(size=(laws, directions)).round(rng.integers(0, 4))
        graph = Graph()
        given = [
            SharedLaw(graph.const(float(a)), tuple(graph.const(float(b)) for b in row))
            for a, row in zip(values, slopes, strict=True)
        ]
        sums = [float(node.number) for node in lawful_sums(graph, "test", given)]
        cost = np.append(np.zeros(directions), -1.0)  # the largest margin
        above, bounds = np.hstack([-slopes, np.ones((laws, 1))]), [(None, None)] * directions + [(None, 1.0)]
        margin = -linprog(cost, A_ub=above, b_ub=values, bounds=bounds).fun
        found.append(margin > 0.0)
        assert (min(sums, default=1.0) > 0.0) == found[-1], (values, slopes, margin, sums)
    assert 5 < sum(found) < 35


def test_laws_of_few_directions_are_watched_beside_laws_that_change_alike():
    """Two laws cancel along the third direction alone, in whatever other laws they stand.

    Those of the first direction are parallel where n is zero, as on a level floor: their minor says nothing there.
    """
    graph = Graph()
    n, zero, one = graph.input("n"), graph.zero, graph.one
    slopes = [(n + 1, n, n), (n - 1, n, n), (zero, n + 1, n), (zero, n - 1, n), (zero, zero, one), (zero, zero, -one)]
    values = [5.0, 5.0, 5.0, 5.0, 1.0, -2.0]
    laws = [SharedLaw(graph.input(f"law{i}"), row) for i, row in enumerate(slopes)]
    at = {"n": 0.0} | {f"law{i}": value for i, value in enumerate(values)}
    sums = evaluate(graph, lawful_sums(graph, "test", laws), at)
    assert min(sums) < 0.0
    at["law5"] = 2.0
    assert min(evaluate(graph, lawful_sums(graph, "test", laws), at)) > 0.0


@pytest.mark.parametrize("mu_wall", [0.1, 0.3])
def test_a_wheel_in_a_corner_leaves_the_wall_when_it_can_push_no_less(mu_wall):
    """The floor bears m g_x, and its moment: whatever the wall does beyond that, it presses until |T| = m |g_x| r."""
    p = WHEEL | {"mu_wall": mu_wall}
    start = {"x": 0.5, "y": 0.2, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    model = compiled("wheel")
    used = {name: p[name] for name in model.layout.parameters}
    motion = model.simulate((1.1, 1.6), start, used, rtol=1e-10, atol=1e-12)
    away = (math.pi - math.asin(1.8 * 1.1 * 0.2 / 2.2)) / 2.2
    assert [tuple(phase.modes.values()) for phase in motion.phases] == [("stick", "stick"), ("stick", "open")]
    assert motion.phases[-1].t0 == pytest.approx(away, abs=1e-9)
    s, c = 1.6 - away, 2.2 * away
    turned = (math.sin(c) - math.sin(c + 2.2 * s)) / 2.2 + math.cos(c) * s  # of the second integral of sin(2.2 t)
    x = 0.5 + (1.8 * -1.1 * 0.5 * s * s + 2.2 / 0.2 * turned / 2.2) / (1.8 + 0.036 / 0.2**2)
    np.testing.assert_allclose(motion.q[-1, :2], [x, 0.2], atol=1e-9)
    sweep = model.sweep((1.1, 1.6), {**start, "x": np.full(3, 0.5)}, used, rtol=1e-10, atol=1e-12)
    assert list(sweep.phases) == [2, 2, 2]
    np.testing.assert_allclose(sweep["x"], x, atol=1e-9)


def footed(feet, named=None):
    """Return the model of a body in a plane that rests on feet, (x, y) and the angle of the normal each, pushed."""
    x, y, theta = coordinates = dynamicsymbols("x y theta")
    X, Y, T, mu = sp.symbols("X Y T mu", real=True)
    N, O = ReferenceFrame("N"), Point("O")
    S, G = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene = da.Scene("feet", frame=N, origin=O, coordinates=coordinates)
    scene.add_bodies(RigidBody("body", G, S, 2, (inertia(S, 0, 0, 3), G)))
    scene.add_loads((G, X * N.x + Y * N.y), (S, T * N.z))
    names = []
    for i, (a, b, angle) in enumerate(feet):
        normal, force = da.unknowns(f"N{i} F{i}")
        c, s = sp.cos(angle), sp.sin(angle)
        at, n, along = G.locatenew(f"P{i}", a * S.x + b * S.y), c * N.x + s * N.y, c * N.y - s * N.x
        scene.add_joints(da.Joint(f"foot{i}", body="body", at=at, force=normal * n + force * along))
        gap = (at.pos_from(O) - (a * N.x + b * N.y)).dot(n)
        scene.add_contacts(da.UnilateralContact(normal, gap=gap, name=f"foot{i}"))
        scene.add_friction(da.CoulombFriction(normal, force, mu=mu, name=f"foot{i}"))
        names += [normal, force, force - mu * normal]
    return da.compile_model(scene, outputs=names if named is None else {named: names[2], "height": y})


UP, LEFT, RIGHT = math.pi / 2, math.pi, 0.0
CORNER = ((-1.0, 2.0, RIGHT), (1.0, -2.0, UP))
SLOPE = ((-1.0, -0.5, UP + 0.3), (1.0, -0.5 + 2.0 * math.tan(0.3), UP + 0.3))


def powers(feet):
    """Return the powers of the reactions (3, 2 n) and the laws (3 n, 2 n) without mu, F between."""
    columns = []
    for a, b, angle in feet:
        for u in ((math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))):
            columns.append([*u, a * u[1] - b * u[0]])
    return np.array(columns).T


def least_lawful(feet, load, mu):
    """Return the lawful reactions of least norm, by sequential quadratic programming; None without any."""
    matrix, k = powers(feet), len(feet)
    laws = np.zeros((2 * k, 2 * k))
    for i in range(k):
        laws[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[mu, 1.0], [mu, -1.0]]
    if not linprog(np.zeros(2 * k), -laws, np.zeros(2 * k), matrix, -load, (None, None)).success:
        return None
    rules = [{"type": "eq", "fun": lambda x: matrix @ x + load, "jac": lambda x: matrix}]
    rules += [{"type": "ineq", "fun": lambda x: laws @ x, "jac": lambda x: laws}]
    begin = np.linalg.pinv(matrix) @ -load
    found = minimize(lambda x: x @ x, begin, jac=lambda x: 2 * x, constraints=rules, options={"ftol": 1e-14})
    return found.x


@pytest.mark.parametrize(
    "feet",
    [CORNER, SLOPE, ((-1.0, -0.5, UP), (1.5, -0.5, UP))],
    ids=["corner", "slope", "table"],
)
def test_shared_loads_lie_within_the_cones_and_are_the_least_that_do(feet):
    model, rng, k = footed(feet), np.random.default_rng(len(feet)), len(feet)
    start = dict.fromkeys(("x", "y", "theta", "x_dot", "y_dot", "theta_dot"), 0.0)
    cases = {name: rng.normal(size=40) * 4.0 for name in ("X", "Y", "T")}
    cases |= {"Y": cases["Y"] - 15.0, "mu": rng.uniform(0.3, 1.2, 40)}
    sweep = model.sweep((0.0, 0.01), start, cases, t_eval=[0.0, 0.005, 0.01])
    names = [f"{kind}{j}" for j in range(k) for kind in "NF"]
    stick = np.all([sweep.mode(f"foot{j}")[:, -1] == "stick" for j in range(k)], axis=0)
    corrected = 0
    for i in np.flatnonzero(stick):
        load, mu = np.array([cases[name][i] for name in ("X", "Y", "T")]), cases["mu"][i]
        found = np.array([sweep[name][i, -1] for name in names])
        np.testing.assert_allclose(powers(feet) @ found, -load, atol=1e-13 * np.abs(found).max() * 10)
        assert np.all(np.abs(found[1::2]) <= mu * found[::2] + 1e-9)
        np.testing.assert_allclose(found, least_lawful(feet, load, mu), atol=1e-5)
        assert sweep[f"-mu*N{k - 1} + F{k - 1}"][i, -1] == pytest.approx(found[-1] - mu * found[-2], abs=1e-12)
        if np.abs(found + np.linalg.pinv(powers(feet)) @ load).max() < 1e-6:
            continue
        corrected += 1
        if corrected < 3:
            one = {name: values[i] for name, values in cases.items()}
            run = model.simulate((0.0, 0.01), start, one, t_eval=[0.0, 0.005, 0.01])
            np.testing.assert_allclose([run[name][-1] for name in names], found, rtol=1e-12, atol=1e-12)
    assert corrected > 1


def test_reductions_of_shared_loads_say_that_they_take_the_least_norm():
    """Those of outputs that do not depend on reactions say nothing."""
    model = footed(CORNER, "margin")
    start = dict.fromkeys(("x", "y", "theta", "x_dot", "y_dot", "theta_dot"), 0.0)
    reduce = {"most": da.maximum("margin"), "low": da.minimum("height")}
    with pytest.warns(UserWarning, match=r"reductions most: contacts may share") as found:
        model.sweep((0.0, 0.01), start, {"X": -2.0, "Y": -12.0, "T": 3.0, "mu": [0.8]}, reduce=reduce)
    assert len(found) == 1


def test_round_cones_and_pulls_are_put_right_and_lawful_or_hopeless_reactions_stay():
    """Three feet of a table press down and share forces in the plane, against a solver of another kind."""
    feet, mu, rng = [(1.0, 0.0), (-1.0, 1.0), (-1.0, -1.0)], 0.5, np.random.default_rng(1)
    matrix = np.array([[*u, *np.cross([x, y, -1.0], u)] for x, y in feet for u in np.eye(3)]).T
    cones = np.zeros((3, 4, 9))
    for i in range(3):
        cones[i, 0, 3 * i + 2], cones[i, 1, 3 * i], cones[i, 2, 3 * i + 1] = mu, 1.0, 1.0
    corrected = 0
    for _ in range(20):
        inside = rng.normal(size=(3, 3)) * 0.6
        inside[:, 2] = 1.2 + rng.uniform(-1.0, 1.0, 3)
        load = matrix @ inside.ravel()
        plain = np.linalg.pinv(matrix) @ load
        found = plain.copy()
        changed = _lawful(found, matrix, cones)
        margins = [mu * n - math.hypot(f, g) for f, g, n in found.reshape(3, 3)]
        rules = [{"type": "eq", "fun": lambda v, load=load: matrix @ v - load, "jac": lambda v: matrix}]
        rules += [
            {"type": "ineq", "fun": lambda v, i=i: mu * v[3 * i + 2] - math.hypot(*v[3 * i : 3 * i + 2])}
            for i in range(3)
        ]
        other = minimize(lambda v: v @ v, plain, constraints=rules, options={"ftol": 1e-13, "maxiter": 300})
        if changed:
            corrected += 1
            assert min(margins) > -1e-10
            np.testing.assert_allclose(matrix @ found, load, atol=1e-13)
            assert other.success
            np.testing.assert_allclose(found, other.x, atol=1e-4)
        else:
            np.testing.assert_array_equal(found, plain)
            assert min(margins) > -1e-9 or not other.success
    assert 2 < corrected < 20
    pulled = np.linalg.pinv(matrix) @ [0.0, 0.0, -3.0, 0.0, 0.0, 0.0]
    kept = pulled.copy()
    assert not _lawful(kept, matrix, cones)
    np.testing.assert_array_equal(kept, pulled)
