"""The compiled equations of the ready scenes are those that the text derives from its kinetic energies."""

import functools

import numpy as np
import pytest

import dalembert as da
from oracles.lagrange_sleigh import sleigh_equations
from oracles.lagrange_sphere import sphere_equations

BACKENDS = ("numpy", "llvm", "jax")
TEXT = {"chaplygin_sleigh": sleigh_equations, "rolling_sphere": sphere_equations}
PARAMETERS = {
    "chaplygin_sleigh": [
        {"m": 1.0, "b": 0.3, "I_C": 0.5},
        {"m": 2.3, "b": 0.7, "I_C": 1.4},
        {"m": 0.6, "b": 1.1, "I_C": 0.9},
        {"m": 1.7, "b": 0.05, "I_C": 1.2},
    ],
    "rolling_sphere": [
        {"m": 1.0, "r": 0.5, "g": 9.81},
        {"m": 2.3, "r": 0.8, "g": 1.62},
        {"m": 0.6, "r": 1.1, "g": 9.81},
        {"m": 1.7, "r": 1.4, "g": 3.71},
    ],
}
STATES_PER_PARAMETER_SET = 250
RTOL = 1e-12


@functools.cache
def compiled(scene, backend):
    if backend == "jax":
        pytest.importorskip("jax")
    return da.compile_model(da.scenes.ALL[scene](), backend=backend)


def random_states(n_q, seed):
    """Return coordinates and rates of shape (STATES_PER_PARAMETER_SET, n_q), angles over more than a turn."""
    rng = np.random.default_rng(seed)
    shape = STATES_PER_PARAMETER_SET, n_q
    return rng.uniform(-4, 4, shape), rng.uniform(-3, 3, shape)


def assert_close(actual, expected, scale):
    """Compare state by state, relative to `scale` of shape (k,)."""
    assert actual.shape == expected.shape
    error = np.abs(actual - expected).reshape(len(expected), -1).max(axis=1)
    assert (error / scale).max() <= RTOL


def largest(array):
    """Return the largest magnitude of each state, shape (k,)."""
    return np.abs(array).reshape(len(array), -1).max(axis=1)


@pytest.fixture(params=[(scene, i) for scene in TEXT for i in range(4)], ids=lambda case: f"{case[0]}-{case[1]}")
def problem(request):
    """Return scene, text equations, q, qdot, parameters."""
    scene, i = request.param
    equations = TEXT[scene]()
    return scene, equations, *random_states(len(equations.q), seed=i), PARAMETERS[scene][i]


@pytest.mark.parametrize("backend", BACKENDS)
def test_mass_matrix_is_the_hessian_of_the_kinetic_energy(problem, backend):
    scene, equations, q, _, p = problem
    expected = equations.mass_matrix(q, p)
    assert_close(np.asarray(compiled(scene, backend).mass_matrix(q, p)), expected, largest(expected))


@pytest.mark.parametrize("backend", BACKENDS)
def test_forcing_is_what_the_lagrange_operator_leaves(problem, backend):
    """Relative to products of the mass matrix and two rates: the forcing is a sum of such and may cancel."""
    scene, equations, q, qdot, p = problem
    expected = equations.forcing(q, qdot, p)
    scale = largest(equations.mass_matrix(q, p)) * largest(qdot) ** 2
    assert_close(np.asarray(compiled(scene, backend).forcing(0.0, q, qdot, p)), expected, scale)


@pytest.mark.parametrize("backend", BACKENDS)
def test_constraint_jacobian_is_that_of_the_printed_constraints(problem, backend):
    scene, equations, q, _, p = problem
    expected = equations.constraint_jacobian(q, p)
    assert_close(np.asarray(compiled(scene, backend).constraint_jacobian(0.0, q, p)), expected, largest(expected))


@pytest.mark.parametrize("scene", TEXT)
def test_one_state_gives_one_matrix(scene):
    equations, p = TEXT[scene](), PARAMETERS[scene][0]
    q, qdot = (states[0] for states in random_states(len(equations.q), seed=9))
    model = compiled(scene, "numpy")
    np.testing.assert_allclose(model.mass_matrix(q, p), equations.mass_matrix(q, p), atol=1e-12)
    np.testing.assert_allclose(model.forcing(0.0, q, qdot, p), equations.forcing(q, qdot, p), atol=1e-12)
    np.testing.assert_allclose(model.constraint_jacobian(0.0, q, p), equations.constraint_jacobian(q, p), atol=1e-12)
