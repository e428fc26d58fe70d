"""Many bodies: accelerations by elimination along the tree, against the recursion of Newton and Euler."""

import functools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import CompileTimeWarning
from dalembert.ir.interpret import interpret
from dalembert.mechanics import virtual_power
from dalembert.mechanics.derive import derive
from dalembert.mechanics.tree_elimination import TreeFactorization
from dalembert.scene.reading import read
from dalembert.transforms.linear import factorize, matvec
from dalembert.transforms.lower_kernels import lower_kernel
from mechanics.bodies import GRAVITY, Link, links, scene_of, torques


def _chain(n):
    return [i - 1 for i in range(n)]


def _arms(count, length):
    """Return parents of arms that hang from one body."""
    return [-1] + [0 if k == 0 else 1 + arm * length + k - 1 for arm in range(count) for k in range(length)]


TREES = {
    "plane of 2": (_chain(2), ["turn z"] * 2, True, False),
    "plane of 3": (_chain(3), ["turn z"] * 3, True, False),
    "plane of 60": (_chain(60), ["turn z"] * 60, True, True),
    "plane of 16": (_chain(16), ["turn z"] * 16, True, True),
    "plane of 12": (_chain(12), ["turn z"] * 12, True, False),
    "space of 2": (_chain(2), ["turn z", "turn y"], False, False),
    "space of 7": (_chain(7), ["turn z", "turn y", "turn x"] * 2 + ["turn z"], False, False),
    "space of 12": (_chain(12), ["turn z", "turn y", "turn x"] * 4, False, False),
    "space of 30": (_chain(30), ["turn z", "turn y", "turn x"] * 10, False, True),
    "stars": (_arms(8, 2), ["turn y"] + ["turn z", "turn x"] * 8, False, False),
    "telescope": (_chain(14), ["turn z"] + ["slide x"] * 13, True, True),
    "slides": (_chain(21), ["slide x", "turn y", "slide z"] * 7, False, True),
    "balls": (_chain(7), ["ball"] * 7, False, True),
    "floating": (_arms(2, 9), ["free"] + ["turn y", "turn z", "turn x"] * 6, False, True),
}


@functools.cache
def compiled(name, backend="numpy", formulation="auto"):
    parents, kinds, planar, _ = TREES[name]
    tree = links(parents, kinds, len(parents), planar=planar)
    scene, values = scene_of(name.replace(" ", "_"), tree)
    model = da.compile_model(scene, backend=backend, formulation=formulation, cache=False)
    return tree, model, values


def states(tree, seed=0):
    rng, n = np.random.default_rng(seed), len(tree)
    return rng.uniform(-1.2, 1.2, n), rng.uniform(-1.0, 1.0, n)


@pytest.mark.parametrize("name", TREES)
def test_accelerations_need_no_torques(name):
    tree, model, values = compiled(name)
    q, qdot = states(tree)
    found, terms = torques(tree, q, qdot, model.accelerations(0.0, q, qdot, values))
    assert np.max(np.abs(found) / terms) < 1e-12


@pytest.mark.parametrize("name", TREES)
def test_the_elimination_is_chosen_by_its_operations(name):
    model, expected = compiled(name)[1], TREES[name][3]
    assert (model.stages.reduced.tree_factors is not None) == expected
    assert ("eliminated along the tree" in model.explain()) == expected


@pytest.mark.parametrize("name", ["plane of 60", "slides"])
def test_mass_matrix_and_forcing_are_those_of_the_recursion(name):
    """Columns of the mass matrix are torques of unit accelerations less those of none."""
    tree, model, values = compiled(name)
    q, qdot = states(tree)
    nothing = np.zeros_like(q)
    forcing = model.forcing(0.0, q, qdot, values)
    still, terms = torques(tree, q, qdot, nothing)
    assert np.max(np.abs(forcing + still) / terms) < 1e-12
    mass = model.mass_matrix(q, values)
    for i in (0, len(q) // 2, len(q) - 1):
        unit = np.eye(len(q))[i]
        column = torques(tree, q, nothing, unit)[0] - torques(tree, q, nothing, nothing)[0]
        np.testing.assert_allclose(mass[:, i], column, atol=1e-11 * np.abs(mass).max())
    both = model.mass_matrix(np.array([q, 2 * q]), values)
    np.testing.assert_allclose(both[0], mass, rtol=1e-14)


def test_inverse_dynamics_is_the_recursion():
    tree, model, values = compiled("slides")
    q, qdot = states(tree)
    qddot = states(tree, 1)[0]
    found = model.inverse_dynamics(0.0, q, qdot, qddot, values)
    expected, terms = torques(tree, q, qdot, qddot)
    assert np.max(np.abs(found - expected) / terms) < 1e-12


@pytest.mark.parametrize("name", ["plane of 3", "stars", "balls", "floating"])
def test_factors_along_the_tree_are_those_of_the_matrix(name, monkeypatch):
    """The same solutions, inner products, products and diagonal as with the dense matrix, however short."""
    monkeypatch.setattr(virtual_power, "_LEAST", 1)
    monkeypatch.setattr(virtual_power, "WORTH", 0)
    parents, kinds, planar, _ = TREES[name]
    scene, values = scene_of("tree", links(parents[:8], kinds[:8], 3, planar=planar))
    equations = derive(read(scene))
    graph, tree = equations.graph, equations.tree
    dense = factorize(graph, equations.mass_matrix)
    along = TreeFactorization(graph, tree)
    loads = list(equations.forcing), list(equations.qdot)
    outputs = [*along.solve(loads[0]), *tree.product(graph, loads[1]), *tree.diagonal(graph)]
    outputs += [along.inner(*map(along.half_solve, loads))]
    expected = [*dense.solve(loads[0]), *matvec(graph, equations.mass_matrix, loads[1])]
    expected += [row[i] for i, row in enumerate(equations.mass_matrix)]
    expected += [dense.inner(*map(dense.half_solve, loads))]
    inputs = {graph.input(x): ("y", i) for i, x in enumerate(equations.symbols.variables)}
    inputs |= {graph.input(x): ("p", i) for i, x in enumerate(equations.symbols.parameters)}
    kernel = lower_kernel(graph, "both", [*outputs, *expected], inputs, ("y", "p"))
    y = np.random.default_rng(5).uniform(-1, 1, len(equations.symbols.variables))
    both = interpret(kernel, {"y": y, "p": [values[x] for x in equations.symbols.parameters]})
    a, b = np.split(np.array(both), 2)
    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-10 * np.abs(b).max())


def absolute(n):
    """Return the scene of a chain in the plane whose angles are absolute, the tip of it, and its links."""
    q = dynamicsymbols(f"q0:{n}")
    m, l, J, g = sp.symbols("m l J g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("absolute", frame=N, origin=O, coordinates=q)
    scene.apply_uniform_gravity(-g * N.y)
    joint = O
    for i in range(n):
        frame = N.orientnew(f"E{i}", "Axis", (q[i], N.z))
        G = joint.locatenew(f"G{i}", l / 2 * frame.x)
        scene.add_bodies(RigidBody(f"b{i}", G, frame, m, (inertia(frame, 0, 0, J), G)))
        joint = joint.locatenew(f"P{i}", l * frame.x)
    half, moments = np.array([0.2, 0.0, 0.0]), np.array([1.0, 1.0, 0.05])
    return scene, joint, [Link(i - 1, "turn", 2, np.array([0.4 * (i > 0), 0, 0]), 1.3, half, moments) for i in range(n)]


ABSOLUTE = {"m": 1.3, "l": 0.4, "J": 0.05, "g": GRAVITY}


def powers(tree, angles, rates, found):
    """Return the power coefficients of the torques that a motion needs, by absolute angles, and their terms."""
    tau, terms = torques(tree, *(np.diff(x, prepend=0.0) for x in (angles, rates, found)))
    return tau - np.append(tau[1:], 0.0), terms


def test_absolute_angles_are_eliminated_along_the_tree():
    """A coordinate enters at two steps: it turns its body, and moves the joint of the next."""
    scene, _, tree = absolute(25)
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert model.stages.reduced.tree_factors is not None
    angles, rates = states(tree)
    tau, terms = powers(tree, angles, rates, model.accelerations(0.0, angles, rates, ABSOLUTE))
    assert np.max(np.abs(tau) / terms) < 1e-12


def test_a_closed_chain_is_eliminated_along_its_tree():
    """What torques the motion needs is the power of the force in the loop, and the tip stays where it is."""
    n = 20
    scene, tip, tree = absolute(n)
    anchor = scene.origin.locatenew("Q", sp.Symbol("D", positive=True) * scene.frame.x)
    loop = da.Closure("loop", None, f"b{n - 1}", "pin", parent_point=anchor, child_point=tip, axis=scene.frame.z)
    scene.add_joints(loop)
    model = da.compile_model(scene, outputs=["loop.force_x", "loop.force_y"], cache=False)
    assert model.stages.program.formulation == "projected" and "along the tree" in model.explain()
    values = ABSOLUTE | {"D": 4.8}
    lean = np.arccos(4.8 / (n * 0.4))
    start = {x: -lean if i < n // 2 else lean for i, x in enumerate(model.layout.coordinates)}
    run = model.simulate((0, 0.4), start | dict.fromkeys(model.layout.rates, 0.0), values, rtol=1e-10)
    assert run.success and np.abs(run.constraint_violation).max() < 1e-12
    assert np.ptp(run["energy"]) < 1e-9 * np.abs(run["energy"]).max()
    q, qdot = run.q[-1], run.qdot[-1]
    found = model.accelerations(float(run.t[-1]), q, qdot, values)
    tau, terms = powers(tree, q, qdot, found)
    force = run["loop.force_x"][-1], run["loop.force_y"][-1]
    pull = 0.4 * (force[1] * np.cos(q) - force[0] * np.sin(q))
    assert np.max(np.abs(tau - pull) / (terms + np.abs(pull))) < 1e-12
    speed = 0.4 * np.array([-np.sin(q) * found - np.cos(q) * qdot**2, np.cos(q) * found - np.sin(q) * qdot**2])
    assert np.max(np.abs(speed.sum(axis=1))) < 1e-11 * np.abs(speed).sum()


@pytest.mark.parametrize("backend", ["llvm", "numba", "jax"])
def test_backends_agree(backend):
    if backend == "jax":
        pytest.importorskip("jax")
    tree, reference, values = compiled("telescope")
    _, model, _ = compiled("telescope", backend)
    q, qdot = states(tree)
    for name, point in (("accelerations", (0.0, q, qdot, values)), ("mass_matrix", (q, values))):
        expected = getattr(reference, name)(*point)
        np.testing.assert_allclose(getattr(model, name)(*point), expected, rtol=1e-9, atol=1e-11)


def test_energy_is_kept_in_a_run():
    tree, model, values = compiled("space of 30", "llvm")
    q, qdot = states(tree)
    start = dict(zip(model.layout.coordinates, 0.2 * q, strict=True))
    start |= dict(zip(model.layout.rates, 0.2 * qdot, strict=True))
    run = model.simulate((0, 0.5), start, values, rtol=1e-11, atol=1e-12)
    assert run.success and run.stats.method == "dop853"
    energy = run["energy"]
    assert np.ptp(energy) < 1e-8 * np.abs(energy).max()


def test_linear_models_are_those_of_differences():
    tree, model, values = compiled("slides", "llvm")
    q, qdot = states(tree)
    n = len(q)
    start = dict(zip((*model.layout.coordinates, *model.layout.rates), [*q, *qdot], strict=True))
    linear = model.linearize(0.0, start, values)
    order = [model.layout.variables.index(x) for x in linear.states]
    step, columns = 1e-6, []
    for i in range(2 * n):
        ends = []
        for side in (step, -step):
            x = np.array([*q, *qdot])
            x[i] += side
            ends.append(np.array([*x[n:], *model.accelerations(0.0, x[:n], x[n:], values)]))
        columns.append((ends[0] - ends[1]) / (2 * step))
    expected = np.array(columns).T[np.ix_(order, order)]
    np.testing.assert_allclose(linear.A, expected, atol=1e-6 * np.abs(expected).max())


def test_backends_that_compile_slowly_say_so():
    parents, kinds, _, _ = TREES["space of 30"]
    scene, _ = scene_of("long", links(parents, kinds, 1))
    with pytest.warns(CompileTimeWarning, match=r"11,\d+ operations, and the numba backend takes minutes .* 5,000"):
        da.compile_model(scene, backend="numba", cache=False)


def test_sensitivities_are_those_of_differences():
    _, model, values = compiled("plane of 16", "llvm")
    start = dict.fromkeys(model.layout.coordinates, 0.1) | dict.fromkeys(model.layout.rates, 0.0)
    found = model.sensitivity((0, 0.2), start, values, wrt=["g", "m3"], rtol=1e-11)
    for name in ("g", "m3"):
        ends = []
        for side in (1 + 1e-4, 1 - 1e-4):
            ends.append(model.simulate((0, 0.2), start, values | {name: values[name] * side}, rtol=1e-12).q[-1])
        expected = (ends[0] - ends[1]) / (2e-4 * values[name])
        derivative = found.jacobians[-1, : len(expected), found.wrt.index(name)]
        np.testing.assert_allclose(derivative, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


# Bases that a chain hangs from: each gives a frame, a point, coordinates, bodies, and constraints.


def turning(N, O):
    t, W = dynamicsymbols._t, sp.Symbol("W")
    disk = N.orientnew("D", "Axis", (W * t, N.z))
    return disk.orientnew("T", "Axis", (sp.sin(W * t), disk.x)), O.locatenew("b", sp.cos(W * t) * N.x), [], [], {}


def vehicle(N, O):
    x, y, theta = dynamicsymbols("x y theta")
    frame, point = N.orientnew("S", "Axis", (theta, N.z)), O.locatenew("C", x * N.x + y * N.y)
    blade = -x.diff() * sp.sin(theta) + y.diff() * sp.cos(theta)
    return frame, point, [x, y, theta], [_base(frame, point)], {"add_nonholonomic_constraints": blade}


def satellite(N, O):
    e, x = dynamicsymbols("e0:4"), dynamicsymbols("x0:3")
    frame, point = N.orientnew("Q", "Quaternion", e), O.locatenew("b", x[0] * N.x + x[1] * N.y + x[2] * N.z)
    return frame, point, [*x, *e], [_base(frame, point)], {"add_holonomic_constraints": sum(c**2 for c in e) - 1}


def aircraft(N, O):
    a, x = dynamicsymbols("a0:3"), dynamicsymbols("x0:3")
    frame, point = N.orientnew("B", "Body", a, "123"), O.locatenew("b", x[0] * N.x + x[1] * N.y + x[2] * N.z)
    return frame, point, [*x, *a], [_base(frame, point)], {}


def _base(frame, point):
    M = sp.Symbol("M", positive=True)
    return RigidBody("base", point, frame, M, (inertia(frame, M, 2 * M, 3 * M), point))


def hanging(base, n):
    """Return the scene of a chain of n links that hangs from a base."""
    m, l, g, A, B, C = sp.symbols("m l g A B C", positive=True)
    q, N, O = dynamicsymbols(f"q0:{n}"), ReferenceFrame("N"), Point("O")
    frame, point, coordinates, bodies, constraints = base(N, O)
    scene = da.Scene(base.__name__, frame=N, origin=O, coordinates=[*coordinates, *q])
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_bodies(*bodies)
    for i in range(n):
        frame = frame.orientnew(f"E{i}", "Axis", (q[i], (frame.z, frame.y, frame.x)[i % 3]))
        G = point.locatenew(f"G{i}", l / 2 * frame.x + l / 7 * frame.y)
        scene.add_bodies(RigidBody(f"b{i}", G, frame, m, (inertia(frame, A, B, C, A / 5), G)))
        point = point.locatenew(f"P{i}", l * frame.x + l / 5 * frame.z)
    for method, expression in constraints.items():
        getattr(scene, method)(expression)
    return scene


@pytest.mark.parametrize(("base", "n"), [(turning, 14), (vehicle, 12), (satellite, 10), (aircraft, 8)])
def test_chains_on_moving_bases_are_those_of_the_dense_matrix(base, n, monkeypatch):
    """Bases that move by themselves, that roll, and that turn freely by a quaternion or by angles."""
    found = []
    for least in (virtual_power._LEAST, 1000):
        monkeypatch.setattr(virtual_power, "_LEAST", least)
        model = da.compile_model(hanging(base, n), backend="numpy", cache=False)
        assert ("along the tree" in model.explain()) == (least < 1000)
        values = {"m": 1.2, "l": 0.4, "g": GRAVITY, "A": 0.1, "B": 0.12, "C": 0.11, "W": 0.7, "M": 2.0}
        values = {name: value for name, value in values.items() if name in model.layout.parameters}
        q, qdot = states(model.layout.coordinates, seed=4)
        if base is satellite:
            q[3:7] /= np.linalg.norm(q[3:7])
            qdot[3:7] -= q[3:7] * (q[3:7] @ qdot[3:7])
        if base is vehicle:
            qdot[1] = qdot[0] * np.tan(q[2])
        found.append((model.accelerations(0.3, q, qdot, values), model.mass_matrix(q, values, t=0.3)))
    for along, dense in zip(*found, strict=True):
        np.testing.assert_allclose(along, dense, rtol=1e-10, atol=1e-11 * np.abs(dense).max())
