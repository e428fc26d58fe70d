import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dalembert.codegen.numpy.solvers import METHODS
from dalembert.errors import OptionError
from dalembert.methods.status import Status
from steps.integrator_cases import MIXED_START, mixed, pendulum_velocity, solve

SCIPY_NAMES = {"dop853": "DOP853", "rk45": "RK45", "radau": "Radau", "lsoda": "LSODA", "bdf": "BDF"}


@pytest.mark.parametrize("method", METHODS)
def test_stepping_is_solve_ivp(method):
    def rhs(t, y):
        out = np.zeros(4)
        mixed(t, y, None, out)
        return out

    times = np.linspace(0.0, 5.0, 17)
    reference = solve_ivp(rhs, (0.0, 5.0), MIXED_START, SCIPY_NAMES[method], rtol=1e-7, atol=1e-9, dense_output=True)
    run = solve(f"scipy-{method}", mixed, MIXED_START, t0=0.0, t1=5.0, rtol=1e-7, atol=1e-9, dense=True)
    np.testing.assert_array_equal(run.t, reference.t)
    np.testing.assert_array_equal(run.y, reference.y.T)
    np.testing.assert_allclose(run.dense(times), reference.sol(times).T, rtol=1e-13, atol=1e-15)
    assert run.evaluations == reference.nfev + 1


@pytest.mark.parametrize("size", np.geomspace(1e-167, 1e-161, 25))
def test_errors_whose_squares_underflow_are_none(size):
    """Slopes that are rounding, and do not become smoother in smaller steps."""

    def noise(t, y, c, out):
        out[0] = size * math.sin(1e30 * t)

    run = solve("scipy-dop853", noise, np.zeros(1), t0=0.0, t1=1.0, rtol=1e-8, atol=1e-3)
    assert run.status is Status.SUCCESS and run.rejected == 0


def test_unknown_method_is_named():
    with pytest.raises(OptionError, match="dop853"):
        solve("scipy-euler", mixed, MIXED_START, t0=0.0, t1=1.0)


@pytest.mark.parametrize("method", ["lsoda", "bdf"])
def test_multistep_methods_refuse_projection(method):
    with pytest.raises(OptionError, match=method):
        solve(f"scipy-{method}", mixed, MIXED_START, projections=(None, pendulum_velocity), t0=0.0, t1=1.0)
