"""Simulations of the Chaplygin sleigh end at the closed form of its motion."""

import functools

import numpy as np
import pytest

import dalembert as da
from oracles.cases import SLEIGH_CASES

FORMULATIONS = ("minimal", "projected")
METHODS = ("dop853", "tsit5")
END = 10.0


@functools.cache
def compiled(formulation):
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="llvm", formulation=formulation)


def simulate(case, formulation, method, rtol, atol):
    traj = compiled(formulation).simulate((0, END), case.initial, case.parameters, method=method, rtol=rtol, atol=atol)
    assert traj.success, traj.message
    assert traj.t[-1] == END
    return traj


def final_error(traj, case):
    """Return the largest error of coordinates and rates at the end."""
    exact = case.exact(END)
    return max(np.abs(traj.q[-1] - exact.q).max(), np.abs(traj.qdot[-1] - exact.qdot).max())


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", SLEIGH_CASES, ids=lambda case: case.name)
def test_final_state_is_exact_to_1e_10(case, formulation, method):
    traj = simulate(case, formulation, method, rtol=1e-12, atol=1e-14)
    assert final_error(traj, case) < 1e-10
    assert np.abs(traj.constraint_violation).max() < 1e-13


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", SLEIGH_CASES, ids=lambda case: case.name)
def test_error_decreases_with_the_tolerance(case, formulation, method):
    """Over eight decades of tolerance the error falls at every second decade, by five decades at least."""
    tolerances = 10.0 ** np.arange(-4, -13, -2)
    errors = np.array([final_error(simulate(case, formulation, method, rtol, rtol / 100), case) for rtol in tolerances])
    assert (errors[1:] < errors[:-1]).all(), errors
    assert errors[-1] < 1e-5 * errors[0], errors
