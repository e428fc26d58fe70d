"""Functions of a state beside the vector field: what the model evaluates, traced and differentiated."""

import pickle

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError
from runtime.test_sensitivity import MOTIONS

jax = pytest.importorskip("jax")

NAMES = ("expand", "outputs", "energy", "mass_matrix", "forcing", "constraint_jacobian", "accelerations", "project")
PARAMETERS, INITIAL, OUTPUTS = MOTIONS["rolling_sphere"]


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module", params=("minimal", "projected"))
def model(request):
    scene = da.scenes.rolling_sphere()
    return da.compile_model(scene, backend="jax", formulation=request.param, outputs=list(OUTPUTS))


@pytest.fixture(scope="module")
def at(model):
    return model.state(INITIAL, PARAMETERS), model.parameter_vector(PARAMETERS)


def everything(model, y, p):
    return {name: getattr(model.functions, name)(0.0, y, p) for name in NAMES}


def test_values_are_those_of_the_model_alone_and_in_batches(model, at):
    y, p = at
    batch = jax.jit(jax.vmap(lambda y: everything(model, y, p)))(np.stack([y, 1.1 * y]))
    found = jax.tree.map(lambda rows: rows[0], batch)
    run = model.simulate((0.0, 0.0), INITIAL, PARAMETERS, t_eval=[0.0])
    q, qdot = found["expand"]
    np.testing.assert_allclose(q, run.q[0], rtol=1e-14)
    np.testing.assert_allclose(qdot, run.qdot[0], rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(found["energy"], run["energy"][0], rtol=1e-13)
    np.testing.assert_allclose(found["outputs"], [run["F_u"][0]], rtol=1e-12)
    for name, arguments in {
        "mass_matrix": (q, p),
        "forcing": (0.0, q, qdot, p),
        "constraint_jacobian": (0.0, q, p),
        "accelerations": (0.0, q, qdot, p),
    }.items():
        expected = getattr(model, name)(*map(np.asarray, arguments))
        np.testing.assert_allclose(found[name], expected, rtol=1e-12, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(found["project"], y, rtol=1e-12)


def test_energy_does_not_change_along_the_vector_field(model, at):
    """Its gradient, by reverse mode, in the direction of the motion."""
    y, p = at
    gradient = jax.jit(jax.grad(lambda y: model.functions.energy(0.0, y, p)))(y)
    rate = model.vector_field(0.0, y, p)
    assert np.abs(gradient).max() > 0.1
    assert abs(float(gradient @ rate)) < 1e-12 * float(np.linalg.norm(gradient) * np.linalg.norm(rate))


def test_projection_moves_a_state_onto_the_constraints_and_is_differentiated(model, at):
    y, p = at
    off = y + 1e-6 * np.cos(np.arange(len(y)))

    def slip(y):
        """Return what the velocity constraints leave."""
        qdot = model.functions.expand(0.0, y, p)[1]
        return model.functions.constraint_jacobian(0.0, y, p) @ qdot

    held = jax.jit(lambda y: slip(model.functions.project(0.0, y, p)))
    assert np.abs(held(off)).max() < 1e-14
    assert np.abs(jax.jacfwd(held)(off)).max() < 1e-12
    if model.formulation == "projected":
        assert np.abs(slip(off)).max() > 1e-8


def test_arguments(model, at):
    y, p = at
    functions = model.functions
    np.testing.assert_array_equal(functions.energy(0.0, y, PARAMETERS), functions.energy(0.0, y, p))
    with pytest.raises(OptionError, match=r"the state must have shape"):
        functions.energy(0.0, y[:-1], p)
    with pytest.raises(UnknownNameError, match="missing parameters: m"):
        functions.energy(0.0, y, {name: value for name, value in PARAMETERS.items() if name != "m"})
    same = pickle.loads(pickle.dumps(functions))
    assert same == functions and hash(same) == hash(functions) and functions != model.vector_field
