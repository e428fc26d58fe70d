"""Starts are judged by the terms of each constraint, whatever the size of what else moves in the scene."""

import functools

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import InitialStateError
from dalembert.methods.status import Status

pytestmark = pytest.mark.usefixtures("quick_xla")

BACKENDS = ("numpy", "llvm", "numba", "jax")
FAR = {"z": 1e3, "z_dot": 0.0}
P = {"m": 1.0, "L": 1e-6, "g": 9.81}
TURNED = {"y": -1e-6, "y_dot": 0.0, "x": 0.0, "x_dot": 1e-6}
SPAN = (0.0, 1e-4)


def small_pendulum(shift=0):
    """Build a pendulum, its pivot at `shift`, and a particle far off that no constraint holds."""
    x, y, z = dynamicsymbols("x y z")
    m, L, g = symbols("m L g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    bob, other = O.locatenew("P", x * N.x + y * N.y), O.locatenew("Q", z * N.z)
    scene = da.Scene("small_pendulum", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("P", bob, m), Particle("Q", other, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints((x - shift) ** 2 + y**2 - L**2)
    return scene


def equal_shares():
    """Build a slider that moves twice as far as another, a constraint without a length of its own."""
    x, y, z = dynamicsymbols("x y z")
    m = symbols("m", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("equal_shares", frame=N, origin=O, coordinates=[x, y, z])
    for name, at in (("P", x * N.x), ("Q", y * N.y), ("R", z * N.z)):
        scene.add_bodies(Particle(name, O.locatenew(name, at), m))
    scene.add_holonomic_constraints(x - 2 * y)
    return scene


@functools.cache
def _model(backend="numpy", formulation="projected"):
    return da.compile_model(small_pendulum(), backend=backend, formulation=formulation)


@pytest.mark.parametrize("formulation", ["projected", "augmented", "baumgarte", "ggl"])
@pytest.mark.parametrize("far", [0.0, 1.0, 1e3, 1e6])
def test_a_start_half_off_a_small_circle_is_refused(formulation, far):
    start = {"x": 0.5e-6, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0, **FAR, "z": far}
    with pytest.raises(InitialStateError, match="contradict the constraints"):
        _model(formulation=formulation).simulate(SPAN, start, P)


@pytest.mark.parametrize("off", [1e-5, 1e-3, 0.5])
def test_what_is_refused_alone_is_refused_beside_a_distant_body(off):
    for far in (0.0, 1e3):
        with pytest.raises(InitialStateError, match="contradict the constraints"):
            _model().simulate(SPAN, {**TURNED, **FAR, "z": far, "y": -1e-6 * (1.0 + off)}, P)


@pytest.mark.parametrize("speed", [0.0, 1.0, 1e6])
def test_a_rate_half_off_the_tangent_is_refused_beside_a_fast_body(speed):
    with pytest.raises(InitialStateError, match="contradict the constraints"):
        _model().simulate(SPAN, {**TURNED, **FAR, "z_dot": speed, "y_dot": 0.5e-6}, P)


@pytest.mark.parametrize("backend", BACKENDS)
def test_runs_and_sweeps_refuse_it_on_every_backend(backend):
    model = _model(backend)
    wrong = {**TURNED, **FAR, "y": -0.5e-6}
    with pytest.raises(InitialStateError, match="contradict the constraints"):
        model.simulate(SPAN, wrong, P)
    sweep = model.sweep(SPAN, {**TURNED, **FAR, "y": np.array([-1e-6, -0.5e-6])}, P)
    assert sweep.status.tolist() == [Status.SUCCESS, Status.INITIAL_STATE]
    assert model.simulate(SPAN, TURNED | FAR, P).success


def test_prepared_runs_refuse_it():
    model = _model("llvm")
    names = model.layout.state
    right, wrong = (np.array([{**TURNED, **FAR, "y": y}[n] for n in names]) for y in (-1e-6, -0.5e-6))
    run = model.prepare(SPAN)
    p = model.parameter_vector(P)
    for state, status in ((right, Status.SUCCESS), (wrong, Status.INITIAL_STATE)):
        run(state, p)
        assert run.status is status


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 2, np.pi, 30.0])
def test_what_rounding_leaves_of_a_start_is_accepted(angle):
    s, c = np.sin(angle), np.cos(angle)
    start = {"x": 1e-6 * s, "y": -1e-6 * c, "x_dot": 1e-6 * c, "y_dot": 1e-6 * s}
    for far in (0.0, 1.0, 1e6):
        assert _model().simulate(SPAN, {**start, **FAR, "z": far}, P).success


@pytest.mark.parametrize("formulation", ["projected", "augmented"])
def test_a_constraint_without_a_length_of_its_own(formulation):
    model = da.compile_model(equal_shares(), backend="numpy", formulation=formulation)
    rest = {"x_dot": 0.0, "y_dot": 0.0, **FAR}
    for x, y in ((0.0, 0.0), (1e-17, 1e-17), (2e-6, 1e-6), (2e-6, 1e-6 * (1 + 1e-9))):
        assert model.simulate((0.0, 1.0), {"x": x, "y": y, **rest}, {"m": 1.0}).success
    with pytest.raises(InitialStateError, match="contradict the constraints"):
        model.simulate((0.0, 1.0), {"x": 1e-6, "y": 0.0, **rest}, {"m": 1.0})


@pytest.mark.parametrize("length", [1.0, 1e-2])
def test_a_pendulum_far_from_the_origin(length):
    model = da.compile_model(small_pendulum(1000), backend="numpy", formulation="projected")
    p = {"m": 1.0, "L": length, "g": 9.81}
    start = {"x": 1000.0, "y": -length, "x_dot": 1.0, "y_dot": 0.0, **FAR}
    assert model.simulate((0.0, 0.01), start, p).success
    with pytest.raises(InitialStateError, match="contradict the constraints"):
        model.simulate((0.0, 0.01), {**start, "y": -1.01 * length}, p)


def test_what_rounding_leaves_of_rates_is_accepted():
    model = da.compile_model(equal_shares(), backend="numpy", formulation="projected")
    for far, left in ((1.0, 1e-13), (1e3, 1e-10)):
        start = {"x": 0.0, "y": 0.0, "z": far, "z_dot": far, "x_dot": left, "y_dot": 0.0}
        assert model.simulate((0.0, 1.0), start, {"m": 1.0}).success
