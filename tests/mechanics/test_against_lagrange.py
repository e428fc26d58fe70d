"""Mass matrix, forcing and energies of many scenes against the Lagrange operator applied to SymPy's own T."""

import functools

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.ir.random_points import values_of
from oracles.lagrange_any import lagrange_scene
from scene.builders import FREE, four_bar

RTOL = 1e-10
SCENES = {**FREE, "four-bar": four_bar, **da.scenes.ALL}


@functools.cache
def compiled(name, formulation="augmented"):
    return da.compile_model(SCENES[name](), backend="numpy", formulation=formulation)


@functools.cache
def oracle_of(name):
    return lagrange_scene(SCENES[name]())


def random_state(model, rng):
    size = len(model.layout.coordinates)
    p = dict(zip(model.layout.parameters, rng.uniform(0.5, 2.0, len(model.layout.parameters)), strict=True))
    if "I_C" in p:  # about a point b away from the mass centre, so that it has a least value
        p["I_C"] += p["m"] * p["b"] ** 2
    return rng.uniform(-1.4, 1.4, size), rng.uniform(-2, 2, size), p


def assert_terms(model, oracle, t, q, qdot, p):
    expected_mass, expected_forcing = oracle.terms(t, q, qdot, p)
    mass, forcing = model.mass_matrix(q, p, t=t), model.forcing(t, q, qdot, p)
    scale = np.abs(expected_mass).max()
    np.testing.assert_allclose(mass, expected_mass, rtol=RTOL, atol=RTOL * scale)
    # forcing is a sum of products of inertia and two rates, which may cancel
    limit = RTOL * max(np.abs(expected_forcing).max(), scale * np.abs(qdot).max() ** 2)
    np.testing.assert_allclose(forcing, expected_forcing, rtol=RTOL, atol=limit)


@pytest.mark.parametrize("name", SCENES)
def test_mass_matrix_and_forcing(name):
    model, oracle = compiled(name), oracle_of(name)
    assert oracle.coordinates == model.layout.coordinates
    rng = np.random.default_rng(7)
    for t in (0.0, 0.83, -1.9):
        assert_terms(model, oracle, t, *random_state(model, rng))


@pytest.mark.parametrize("name", SCENES)
def test_mass_matrix_is_symmetric_and_positive(name):
    model = compiled(name)
    rng = np.random.default_rng(8)
    for _ in range(3):
        q, _, p = random_state(model, rng)
        mass = model.mass_matrix(q, p, t=0.4)
        np.testing.assert_array_equal(mass, mass.T)
        assert np.linalg.eigvalsh(mass).min() > -1e-12 * np.abs(mass).max()


@pytest.mark.filterwarnings("ignore::dalembert.errors.EnergyWarning")  # loads that follow their bodies
@pytest.mark.parametrize("name", [n for n in FREE if n != "piecewise forces"])
def test_kinetic_energy_and_gravity_potential(name):
    """Recorded at the start of a run of zero length, which every scene survives."""
    model, oracle = compiled(name), oracle_of(name)
    rng = np.random.default_rng(9)
    q, qdot, p = random_state(model, rng)
    layout = model.layout
    initial = dict(zip((*layout.coordinates, *layout.rates), (*q, *qdot), strict=True))
    trajectory = model.simulate((0.6, 0.6), initial, p)
    kinetic, potential = oracle.energies(0.6, q, qdot, p)
    assert trajectory["kinetic_energy"][0] == pytest.approx(kinetic, rel=1e-12)
    loads = model.stages.equations.load_energy
    if loads.potential is not None:  # that of loads is tested in test_load_potentials
        graph, values = loads.potential.graph, dict(zip((*layout.coordinates, *layout.rates), (*q, *qdot), strict=True))
        inputs = {graph.input(key): value for key, value in (values | p | {"t": 0.6}).items()}
        potential += values_of([loads.potential], inputs)[0]
    assert trajectory["potential_energy"][0] == pytest.approx(potential, rel=1e-12, abs=1e-12)
    assert trajectory["energy"][0] == pytest.approx(kinetic + potential, rel=1e-12)


@pytest.mark.parametrize("name", FREE)
@pytest.mark.parametrize("formulation", ["minimal", "projected", "augmented"])
def test_accelerations_without_constraints_solve_the_mass_matrix(name, formulation):
    model = compiled(name, formulation)
    rng = np.random.default_rng(10)
    q, qdot, p = random_state(model, rng)
    expected = np.linalg.solve(model.mass_matrix(q, p, t=0.3), model.forcing(0.3, q, qdot, p))
    np.testing.assert_allclose(model.accelerations(0.3, q, qdot, p), expected, rtol=1e-9, atol=1e-10)


# -- random scenes ------------------------------------------------------------------------

JOINTS = ("revolute", "skew revolute", "prismatic", "planar", "spherical")


FREEDOM = {"planar": 3, "spherical": 3}


@st.composite
def mechanisms(draw):
    """Return how to build a tree of one to three bodies, each hung on the one before or on the referential."""
    count = draw(st.integers(1, 3))
    return [
        (
            draw(st.sampled_from(JOINTS)),
            draw(st.sampled_from(("x", "y", "z"))),
            draw(st.integers(-1, i - 1)),
            draw(st.booleans()),
        )
        for i in range(count)
    ]


def build(mechanism):
    N, O = ReferenceFrame("N"), Point("O")
    frames, ends, coordinates, bodies, loads = {-1: N}, {-1: O}, [], [], []
    g, k = sp.symbols("g k", positive=True)
    for i, (joint, axis, parent, heavy) in enumerate(mechanism):
        frame, end = frames[parent], ends[parent]
        direction = getattr(frame, axis)
        l, m, A, B, C = sp.symbols(f"l{i} m{i} A{i} B{i} C{i}", positive=True)
        if joint == "prismatic":
            s = dynamicsymbols(f"s{i}")
            coordinates.append(s)
            body = frame.orientnew(f"F{i}", "Axis", (sp.Rational(1, 3), frame.x))
            joint_point = end.locatenew(f"P{i}", s * direction + l * frame.y)
        elif joint == "planar":
            s, u, a = dynamicsymbols(f"s{i} u{i} a{i}")
            coordinates += [s, u, a]
            body = frame.orientnew(f"F{i}", "Axis", (a, frame.z))
            joint_point = end.locatenew(f"P{i}", s * frame.x + u * frame.y)
        elif joint == "spherical":
            a, b, c = dynamicsymbols(f"a{i} b{i} c{i}")
            coordinates += [a, b, c]
            body = frame.orientnew(f"F{i}", "Body", (a, b, c), "ZXZ" if axis == "z" else "XYZ")
            joint_point = end
        else:
            a = dynamicsymbols(f"a{i}")
            coordinates.append(a)
            axis_vector = direction + frame.x + frame.y if joint.startswith("skew") else direction
            body = frame.orientnew(f"F{i}", "Axis", (a, axis_vector))
            joint_point = end
        G = joint_point.locatenew(f"G{i}", l * body.x - l / 3 * body.z)
        frames[i], ends[i] = body, G.locatenew(f"E{i}", l * body.x)
        if heavy or joint in ("spherical", "planar"):
            bodies.append(RigidBody(f"b{i}", G, body, m, (inertia(body, A, B, C, A / 9), G)))
        else:
            bodies.append(Particle(f"b{i}", G, m))
        loads.append((ends[i], -k * ends[i].pos_from(O).dt(N)))
        loads.append((body, k * body.y))
    scene = da.Scene("random", frame=N, origin=O, coordinates=coordinates)
    scene.add_bodies(*bodies)
    scene.add_loads(*loads)
    scene.apply_uniform_gravity(-g * N.z)
    return scene


@pytest.mark.parametrize("count", [5, pytest.param(20, marks=pytest.mark.matrix)])
def test_random_mechanisms(count):
    few = mechanisms().filter(lambda m: sum(FREEDOM.get(joint, 1) for joint, *_ in m) <= 5)

    @settings(max_examples=count)
    @given(few, st.integers(0, 2**32 - 1))
    def check(mechanism, seed):
        model = da.compile_model(build(mechanism), backend="numpy", formulation="augmented")
        rng = np.random.default_rng(seed)
        assert_terms(model, lagrange_scene(build(mechanism)), 0.0, *random_state(model, rng))

    check()
