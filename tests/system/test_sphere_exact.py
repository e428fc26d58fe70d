"""Simulations of the rolling sphere: straight line, constant spin, no friction force."""

import functools

import numpy as np
import pytest

import dalembert as da
from oracles.cases import SPHERE_CASES
from oracles.sphere_exact import spatial_angular_velocity

FORMULATIONS = ("minimal", "projected")
END = 10.0
TOLERANCE = 1e-10


@functools.cache
def simulate(case, formulation):
    model = da.compile_model(
        da.scenes.rolling_sphere(), backend="llvm", formulation=formulation, outputs=["F_u", "F_v"]
    )
    traj = model.simulate((0, END), case.initial, case.parameters, rtol=1e-12, atol=1e-14)
    assert traj.success, traj.message
    assert traj.t[-1] == END
    return traj


@pytest.fixture(params=[(c, f) for c in SPHERE_CASES for f in FORMULATIONS], ids=lambda p: f"{p[0].name}-{p[1]}")
def run(request):
    """Return case and trajectory."""
    case, formulation = request.param
    return case, simulate(case, formulation)


def test_centre_moves_uniformly_on_a_straight_line(run):
    case, traj = run
    start = case.exact(0)
    line = start.q[:2] + traj.t[:, None] * start.qdot[:2]
    np.testing.assert_allclose(traj.q[:, :2], line, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(traj.qdot[:, :2] - start.qdot[:2], 0, atol=TOLERANCE)


def test_angular_velocity_is_constant_in_space(run):
    case, traj = run
    start = case.exact(0)
    expected = np.broadcast_to(spatial_angular_velocity(start.q, start.qdot), (len(traj.t), 3))
    np.testing.assert_allclose(spatial_angular_velocity(traj.q, traj.qdot), expected, rtol=0, atol=TOLERANCE)


def test_final_state_is_exact(run):
    """Angles included, on their continuous branch."""
    case, traj = run
    exact = case.exact(END)
    np.testing.assert_allclose(traj.q[-1], exact.q, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(traj.qdot[-1], exact.qdot, rtol=0, atol=TOLERANCE)


def test_no_slip_is_held(run):
    _, traj = run
    assert np.abs(traj.constraint_violation).max() < 1e-13


def test_friction_force_vanishes(run):
    _, traj = run
    np.testing.assert_allclose(traj["F_u"], 0, atol=TOLERANCE)
    np.testing.assert_allclose(traj["F_v"], 0, atol=TOLERANCE)
