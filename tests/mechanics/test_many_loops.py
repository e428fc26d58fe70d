"""Many closed loops: forces and accelerations of constraints, recomputed in plain NumPy."""

import functools
import sys
from pathlib import Path

import numpy as np
import pytest
from sympy.physics.mechanics import ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.reduction.saddle import SaddlePoint
from dalembert.scene.expressions.vector_products import VectorProduct, multiplied_out, product_of
from mechanics.bodies import GRAVITY, Link, torques

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from loops import LOOPS

J = 1 / 12


@functools.cache
def compiled(name, n, backend="numpy"):
    scene, values, start = LOOPS[name](n)
    return da.compile_model(scene, backend=backend, formulation="projected", cache=False), values, start


def motion(model, values, spread=0.4):
    """Return random coordinates, rates, and the accelerations there, on or off the constraints."""
    rng, n = np.random.default_rng(7), len(model.layout.coordinates)
    q, qdot = rng.uniform(-spread, spread, n), rng.uniform(-1.0, 1.0, n)
    return q, qdot, model.accelerations(0.0, q, qdot, values)


def require(loads, terms, rows, turned, sizes):
    """Require that loads are those of constraints, and that accelerations (rows . qddot + ...) leave `turned` zero."""
    multipliers = np.linalg.lstsq(rows.T, loads, rcond=None)[0]
    pulls = np.abs(rows.T) @ np.abs(multipliers)
    assert np.max(np.abs(loads - rows.T @ multipliers) / (terms + pulls + terms.max())) < 1e-12
    assert np.max(np.abs(turned) / sizes) < 1e-12


def test_windows_need_no_other_forces():
    n = 8
    model, values, _ = compiled("windows", n)
    q, w, found = motion(model, values)
    names = [f"a{i}" for i in range(n + 1)] + [f"b{i}" for i in range(n)]
    place = {name: i for i, name in enumerate(names)}
    along, across = np.array([np.cos(q), np.sin(q)]).T, np.array([-np.sin(q), np.cos(q)]).T
    turned = found[:, None] * across - w[:, None] ** 2 * along  # second rate of a unit vector along each bar
    loads, terms = J * found, np.abs(J * found)
    for arms in [[(i, 0.5)] for i in range(n + 1)] + [[(i, 1.0), (place[f"b{i}"], 0.5)] for i in range(n)]:
        force = sum(arm * turned[i] for i, arm in arms) + np.array([0.0, GRAVITY])
        for i, arm in arms:
            loads[i] += arm * across[i] @ force
            terms[i] += arm * np.linalg.norm(force)
    rows, drift, sizes = np.zeros((2 * n, len(q))), np.zeros(2 * n), np.zeros(2 * n)
    for i in range(n):
        for j, sign in ((i, 1.0), (place[f"b{i}"], 1.0), (i + 1, -1.0)):
            rows[2 * i : 2 * i + 2, j] = sign * across[j]
            drift[2 * i : 2 * i + 2] += sign * turned[j]
            sizes[2 * i : 2 * i + 2] += np.abs(found[j]) + w[j] ** 2
    require(loads, terms, rows, drift, sizes)


def test_particles_of_a_net_need_no_other_forces():
    n = 4
    model, values, _ = compiled("net", n)
    q, v, found = motion(model, values)
    loads, terms = found.copy(), np.abs(found) + GRAVITY
    loads[2::3] += GRAVITY
    rows, turned, sizes = [], [], []
    for i in range(n):
        for j in range(n):
            for k, m in ((i + 1, j), (i, j + 1)):
                if k < n and m < n:
                    a, b = (slice(3 * (n * u + w), 3 * (n * u + w) + 3) for u, w in ((i, j), (k, m)))
                    row = np.zeros(len(q))
                    row[a], row[b] = 2 * (q[a] - q[b]), 2 * (q[b] - q[a])
                    speed = 2 * (v[a] - v[b]) @ (v[a] - v[b])
                    rows.append(row)
                    turned.append(row @ found + speed)
                    sizes.append(np.abs(row) @ np.abs(found) + speed)
    for k in (0, 1, 2, 3 * n - 1):
        rows.append(np.eye(len(q))[k])
        turned.append(found[k])
        sizes.append(GRAVITY)
    require(loads, terms, np.array(rows), np.array(turned), np.array(sizes))


def test_links_of_a_track_need_no_other_forces():
    n = 12
    model, values, _ = compiled("track", n)
    q, w, found = motion(model, values)
    loads, terms = found.copy(), np.abs(found) + GRAVITY
    loads[1::3] += GRAVITY
    loads[2::3] *= J
    rows, turned, sizes = np.zeros((2 * n, 3 * n)), np.zeros(2 * n), np.zeros(2 * n)
    for i in range(n):
        for k, sign in ((i, 1.0), ((i + 1) % n, -1.0)):
            a, arm = 3 * k + 2, 0.5  # the right end of one is the left end of the next
            along, across = np.array([np.cos(q[a]), np.sin(q[a])]), np.array([-np.sin(q[a]), np.cos(q[a])])
            part = slice(2 * i, 2 * i + 2)
            rows[part, 3 * k : 3 * k + 2] = sign * np.eye(2)
            rows[part, a] = arm * across
            turned[part] += sign * found[3 * k : 3 * k + 2] + arm * (across * found[a] - along * w[a] ** 2)
            sizes[part] += np.abs(found[3 * k : 3 * k + 2]) + arm * (np.abs(found[a]) + w[a] ** 2)
    require(loads, terms, rows, turned, sizes)


def test_an_arch_in_relative_angles_is_held():
    """The guard of a row that vanishes is no bound that doubles with each rotation: it would let go of the end."""
    n = 40
    model, values, _ = compiled("arch", n)
    q, w, found = motion(model, values, 2.0 / n)
    places, half = [np.array([float(i > 0), 0.0, 0.0]) for i in range(n)], np.array([0.5, 0.0, 0.0])
    tree = [Link(i - 1, "turn", 2, place, 1.0, half, np.full(3, J)) for i, place in enumerate(places)]
    loads, terms = torques(tree, q, w, found)
    angles, rates, turns = np.cumsum(q), np.cumsum(w), np.cumsum(found)
    arms = [np.cumsum(part[::-1])[::-1] for part in (-np.sin(angles), np.cos(angles))]
    tip = [np.sum(-np.sin(angles) * turns - np.cos(angles) * rates**2)]
    tip += [np.sum(np.cos(angles) * turns - np.sin(angles) * rates**2)]
    require(loads, terms, np.array(arms), np.array(tip), np.full(2, np.sum(np.abs(turns) + rates**2)))


@pytest.mark.parametrize(("name", "sizes"), [("windows", (4, 8)), ("track", (6, 12))])
def test_operations_grow_linearly(name, sizes):
    short, long = (len(compiled(name, n)[0].stages.program.kernel("rhs").body) for n in sizes)
    assert long < 2.4 * short


def test_inner_products_are_those_of_all_pairs():
    equations = compiled("net", 3)[0].stages.equations
    saddle = SaddlePoint.of(equations, guarded=True)
    found = saddle.mass.inner_products(saddle.halves)
    for i, row in enumerate(found):
        assert all(entry is saddle.mass.inner(saddle.halves[i], saddle.halves[j]) for j, entry in enumerate(row))


def test_a_track_keeps_its_energy_and_its_pins():
    model, values, start = compiled("track", 6, "llvm")
    run = model.simulate((0.0, 0.5), start, values, rtol=1e-10)
    assert run.success and np.abs(run.constraint_violation).max() < 1e-12
    energy = run["energy"]
    assert np.ptp(energy) < 1e-9 * max(np.abs(energy).max(), 6 * GRAVITY)


def turned_frames(n):
    """Return a root frame, a vector on many frames, and its components on the root in SymPy."""
    q, root = dynamicsymbols(f"q0:{n}"), ReferenceFrame("N")
    frame, vector = root, 0 * root.x
    for i, angle in enumerate(q):
        frame = frame.orientnew(f"E{i}", "Axis", (angle, (frame.z, frame.x)[i % 2]))
        vector = vector + (i + 1) * frame.y
    return root, vector


def test_products_of_vectors_are_multiplied_out_where_they_are_short():
    root, vector = turned_frames(4)
    assert product_of(root, vector, root.x) == vector.dot(root.x)


def test_a_product_of_vectors_is_that_of_sympy():
    root, vector = turned_frames(9)
    product = product_of(root, vector, vector) + product_of(root, vector, root.x)
    assert product.has(VectorProduct)
    plain = vector.dot(vector) + vector.dot(root.x)
    values = dict(zip(dynamicsymbols("q0:9"), np.linspace(0.2, 1.4, 9), strict=True))
    expected = float(plain.xreplace(values))
    assert float(product.xreplace(values)) == pytest.approx(expected, rel=1e-12)
    assert float(multiplied_out(product).xreplace(values)) == pytest.approx(expected, rel=1e-12)
