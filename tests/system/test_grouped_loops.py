"""Redundant conditions of a large rank, and of rates: they are enforced together in groups."""

import functools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.methods.status import Status

pytestmark = pytest.mark.usefixtures("quick_xla")

m, L, g, b, J = sp.symbols("m L g b J", positive=True)
x, y, theta, p, q = dynamicsymbols("x y theta p q")
N, O = ReferenceFrame("N"), Point("O")
COUNT = 8
FORMULATIONS = ["projected", "baumgarte", "augmented", "ggl"]
HANGING = {"m": 1.0, "L": 0.8, "g": 9.81}


def ladder(count=COUNT, longer=0):
    """Cranks of one length in a row, each end at a constant place from the next: two conditions a pair, of rank one."""
    cranks = dynamicsymbols(f"a0:{count}")
    scene = da.Scene("ladder", frame=N, origin=O, coordinates=cranks)
    ends = []
    for i, angle in enumerate(cranks):
        along = L + longer if i == count - 1 else L
        ends.append(O.locatenew(f"end{i}", (2 * i + along * sp.sin(angle)) * N.x - along * sp.cos(angle) * N.y))
        scene.add_bodies(Particle(f"end{i}", ends[-1], m))
        if i:
            gap = ends[i].pos_from(ends[i - 1]) - 2 * N.x
            scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


@functools.cache
def climbing(formulation="auto", backend="llvm"):
    return da.compile_model(ladder(), formulation=formulation, backend=backend)


@functools.cache
def pendulum():
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[p])
    scene.add_bodies(Particle("bob", O.locatenew("P", L * sp.sin(p) * N.x - L * sp.cos(p) * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    return da.compile_model(scene)


def begin(angle, speed):
    return {f"a{i}": angle for i in range(COUNT)} | {"a0_dot": speed}


def swung(t, angle, speed, parameters=HANGING):
    run = pendulum().simulate((0, t), {"p": angle, "p_dot": speed}, parameters, rtol=1e-12, atol=1e-14)
    return run["p"][-1], run["p_dot"][-1]


# -- a large rank -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("angle", "speed"), [(0.4, 1.0), (np.pi / 2, 0.0), (-2.0, 9.0)])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_long_ladder_swings_as_a_pendulum(formulation, angle, speed):
    """A row of each pair vanishes twice a turn."""
    model = climbing(formulation)
    run = model.simulate((0, 5), begin(angle, speed), HANGING, rtol=1e-10, atol=1e-12)
    assert run.success and "enforced together with the others" in run.message
    end = swung(5, angle, speed)
    assert run["a0"][-1] == pytest.approx(end[0], abs=1e-6) and run["a7_dot"][-1] == pytest.approx(end[1], abs=1e-5)
    assert np.ptp(run["energy"]) < 1e-6


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_every_method_and_sweeps(method):
    angles, speeds = np.linspace(-3, 3, 13), np.linspace(-9, 9, 13)
    options = {"rtol": 1e-9, "atol": 1e-11, "method": method}
    cases = climbing().sweep((0, 2), begin(angles, speeds), HANGING, **options)
    expected = pendulum().sweep((0, 2), {"p": angles, "p_dot": speeds}, HANGING, rtol=1e-12, atol=1e-14)
    assert np.all(cases.status == 0)
    np.testing.assert_allclose(cases["a7"], expected["p"], atol=2e-6)


@pytest.mark.parametrize("backend", ["numba", "jax", "numpy"])
def test_other_backends(backend):
    model = da.compile_model(ladder(7), backend=backend)
    run = model.simulate((0, 1), {f"a{i}": 1.0 for i in range(7)} | {"a0_dot": 3.0}, HANGING)
    assert run.success
    assert run["a6"][-1] == pytest.approx(swung(1, 1.0, 3.0)[0], abs=1e-6)


def test_events_and_derivatives():
    options = {"rtol": 1e-10, "atol": 1e-12, "t_eval": [0, 1.5, 3]}
    run = climbing().simulate((0, 3), begin(1.0, 3.0), HANGING, events=["a3_dot"], **options)
    expected = pendulum().simulate((0, 3), {"p": 1.0, "p_dot": 3.0}, HANGING, events=["p_dot"], **options)
    np.testing.assert_allclose(run.events[0].t, expected.events[0].t, atol=1e-8)
    found = climbing().sensitivity((0, 3), begin(1.0, 3.0), HANGING, of=["a5"], wrt=["g"], **options)
    wanted = pendulum().sensitivity((0, 3), {"p": 1.0, "p_dot": 3.0}, HANGING, of=["p"], wrt=["g"], **options)
    np.testing.assert_allclose(found.jacobians, wanted.jacobians, rtol=1e-6, atol=1e-7)


@pytest.mark.matrix
@pytest.mark.parametrize("formulation", FORMULATIONS[:3])
def test_a_ladder_that_locks_does_not_succeed(formulation):
    """Its last crank grows after a second."""
    model = da.compile_model(ladder(COUNT, (1 + sp.tanh(40 * (dynamicsymbols._t - 1))) / 100), formulation=formulation)
    assert model.simulate((0, 0.5), begin(1.0, 1.0), HANGING).success
    run = model.simulate((0, 2), begin(1.0, 1.0), HANGING)
    assert not run.success and 0.7 < run.t_end < 1.2
    assert not np.any(model.sweep((0, 2), begin(np.array([1.0, 2.0]), 1.0), HANGING).success)


def tied():
    """Six more pairs, and three conditions of rank two of which the first has a group that vanishes at z = pi / 2."""
    v, w, z = dynamicsymbols("v w z")
    scene = ladder(7)
    scene.coordinates = (*scene.coordinates, x, y, v, w, z)
    P = O.locatenew("beside", x * N.x + y * N.y + z * N.z)
    scene.add_bodies(Particle("beside", P, m), Particle("across", O.locatenew("Q", v * N.x + w * N.y), m))
    scene.add_holonomic_constraints(sp.cos(z) * (x - y), sp.sin(z) * (x - y) + (v - w), v - w)
    return scene


@pytest.mark.parametrize("formulation", ["projected", "baumgarte"])
def test_a_group_that_vanishes_where_the_whole_does_not_ends_a_run_and_is_named(formulation):
    model = da.compile_model(tied(), formulation=formulation)
    still = {f"a{i}": 0.5 for i in range(7)} | dict.fromkeys(("x", "y", "v", "w", "z"), 0.0)
    start = {**still, "a0_dot": 0.0, "x_dot": 1.0, "v_dot": 0.5, "z_dot": 1.0}
    assert model.simulate((0, 1), start, HANGING).success
    run = model.simulate((0, 3), start, HANGING)
    assert run.status is Status.SINGULAR_CONFIGURATION and run.t_end == pytest.approx(np.pi / 2, abs=0.1)
    assert "cos(z)" in run.message and "enforced in groups" in run.message


# -- rates ------------------------------------------------------------------------------------------


def sleigh(rows, loop):
    """A sleigh whose blade is written once, or by both components of its slip; it may carry a parallelogram."""
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    scene = da.Scene("sleigh", frame=N, origin=O, coordinates=[x, y, theta, *((p, q) if loop else ())])
    G = C.locatenew("G", b * S.x)
    scene.add_bodies(RigidBody("sleigh", G, S, m, (inertia(S, 0, 0, J), G)))
    slip = -x.diff() * sp.sin(theta) + y.diff() * sp.cos(theta)
    scene.add_nonholonomic_constraints(*((slip,) if rows == 1 else (-slip * sp.sin(theta), slip * sp.cos(theta))))
    if loop:
        ends = []
        for i, angle in enumerate((p, q)):
            place = (2 * i + L * sp.cos(angle)) * S.x + L * sp.sin(angle) * S.y
            ends.append(C.locatenew(f"end{i}", place))
            scene.add_bodies(Particle(f"end{i}", ends[-1], m))
        gap = ends[1].pos_from(ends[0]) - 2 * S.x
        scene.add_holonomic_constraints(*((p - q,) if rows == 1 else (gap.dot(S.x), gap.dot(S.y))))
    return scene


@pytest.mark.parametrize("loop", [False, True])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_blade_by_both_components_of_its_slip(formulation, loop):
    """Each component says nothing in one direction of the blade, which turns through all."""
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": np.cos(0.2), "y_dot": np.sin(0.2), "theta_dot": 2.0}
    start |= {"p": 0.5, "q": 0.5, "p_dot": 3.0} if loop else {}
    values = {"m": 1.0, "b": 0.3, "J": 0.4} | ({"L": 0.5} if loop else {})
    expected = da.compile_model(sleigh(1, loop)).simulate((0, 5), start, values, rtol=1e-12, atol=1e-14)
    model = da.compile_model(sleigh(2, loop), formulation=formulation)
    run = model.simulate((0, 5), start, values, rtol=1e-10, atol=1e-12)
    assert run.success and "enforced together with the others" in run.message
    assert expected["theta"].max() > np.pi / 2
    for name in ("x", "y", "theta", *("pq" if loop else ())):
        assert run[name][-1] == pytest.approx(expected[name][-1], abs=1e-7)
    cases = model.sweep((0, 5), {**start, "theta_dot": np.array([1.0, 2.0])}, values, rtol=1e-10, atol=1e-12)
    assert np.all(cases.status == 0) and cases["x"][1] == pytest.approx(expected["x"][-1], abs=1e-7)
