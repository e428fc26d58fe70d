"""Functions of a state beside the vector field: what the model evaluates, traced and differentiated."""

import pickle

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import OptionError, UnknownNameError, ValueInputError
from starts.test_input_values import forced

jax = pytest.importorskip("jax")

pytestmark = pytest.mark.usefixtures("quick_xla")

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
    for name in (
        "expand",
        "outputs",
        "energy",
        "mass_matrix",
        "forcing",
        "constraint_jacobian",
        "accelerations",
        "project",
    ):
        function = getattr(functions, name)
        for wrapped in (function, jax.jit(function)):
            with pytest.raises(OptionError, match=r"the state must have shape"):
                wrapped(0.0, np.ones(len(y) + 1), p)
            with pytest.raises(OptionError, match=r"parameters must have shape"):
                wrapped(0.0, y, p[:-1])
            with pytest.raises(OptionError, match=r"t must be one number, not of shape \(2,\).*jax\.vmap"):
                wrapped(np.zeros(2), y, p)
    with pytest.raises(OptionError, match=r"t must be one number"):
        model.vector_field(np.zeros(1), y, p)
    same = pickle.loads(pickle.dumps(functions))
    assert same == functions and hash(same) == hash(functions) and functions != model.vector_field


def test_methods_of_the_model_take_what_jax_traces(model, at):
    """One state, rows of states, parameters by name; numbers as before."""
    q, qdot = (np.asarray(value) for value in model.functions.expand(0.0, *at))
    calls = {
        "mass_matrix": lambda q, p: model.mass_matrix(q, p),
        "forcing": lambda q, p: model.forcing(0.0, q, qdot, p),
        "constraint_jacobian": lambda q, p: model.constraint_jacobian(0.0, q, p),
        "accelerations": lambda q, p: model.accelerations(0.0, q, qdot, p),
    }
    rows = np.stack([q, 1.1 * q, 0.9 * q])
    every = jax.jit(lambda q, rows, p: [(call(q, p), call(rows, p)) for call in calls.values()])
    for (one, several), call in zip(every(q, rows, PARAMETERS), calls.values(), strict=True):
        np.testing.assert_allclose(one, call(q, PARAMETERS), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(several, call(rows, PARAMETERS), rtol=1e-12, atol=1e-12)
        assert isinstance(call(q, PARAMETERS), np.ndarray)
    slope = jax.grad(lambda m: model.mass_matrix(q, {**PARAMETERS, "m": m}).trace())(1.3)
    shares = [model.mass_matrix(q, {**PARAMETERS, "m": m}).trace() for m in (1.0, 2.0)]
    np.testing.assert_allclose(slope, shares[1] - shares[0], rtol=1e-12)
    with pytest.raises(ValueInputError, match=r"q must have shape \(5,\) or \(k, 5\), not \(2,\)"):
        jax.jit(calls["mass_matrix"])(q[:2], PARAMETERS)
    with pytest.raises(ValueInputError, match=r"as many rows as each other.*q: 3, qdot: 2"):
        jax.jit(lambda rows: model.forcing(0.0, rows, rows[:2], PARAMETERS))(rows)


def test_methods_of_the_model_with_traced_inputs_and_states():
    scene, z = forced(), dynamicsymbols("z")
    scene.add_states({z: -z})
    scene.add_loads((scene.bodies[0].masscenter, z * scene.frame.x))
    model, p, rest = da.compile_model(scene, backend="jax"), {"m": 0.8, "k": 2.0}, {"z": 0.0}
    knots, x = np.array([0.0, 1.0, 3.0]), np.array([0.5])

    def force(values, t=1.5):
        return model.forcing(t, x, [0.0], p, inputs={"u": da.samples(knots, values)}, states=rest)[..., 0]

    np.testing.assert_allclose(jax.jit(force)(np.array([1.0, 2.0, 4.0])), 2.5 - 1.0)
    np.testing.assert_allclose(jax.jit(jax.grad(force))(np.array([1.0, 2.0, 4.0])), [0.0, 0.75, 0.25])
    times = np.array([0.5, 1.0, 2.0])
    np.testing.assert_allclose(jax.jit(lambda v: force(v, times))(np.array([1.0, 2.0, 4.0])), [0.5, 1.0, 2.0])
    both = jax.jit(lambda u, z: model.accelerations(0.0, x, [0.0], {**p, "u": u}, states={"z": z}))
    np.testing.assert_allclose(both(1.0, 0.3), [(1.0 - 1.0 + 0.3) / 0.8], rtol=1e-14)
    with pytest.raises(UnknownNameError, match="missing inputs: u"):
        jax.jit(lambda x: model.forcing(0.0, x, [0.0], p, states=rest))(x)
    with pytest.raises(ValueInputError, match="depends on the first-order states"):
        jax.jit(lambda x: model.forcing(0.0, x, [0.0], p, inputs={"u": 1.0}))(x)
