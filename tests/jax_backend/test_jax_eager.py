"""Calls outside of `jax.jit`, and what JAX keeps between them."""

import contextlib

import numpy as np
import pytest

import dalembert as da
from analysis.test_sensitivity import MOTIONS

jax = pytest.importorskip("jax")

pytestmark = pytest.mark.usefixtures("quick_xla")

T = np.array([0.0, 0.1, 0.2, 0.3])
PARAMETERS, INITIAL, _ = MOTIONS["chaplygin_sleigh"]


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")


@contextlib.contextmanager
def compilations():
    """Count what XLA compiles."""
    found = []

    def note(event, seconds, **_):
        if event.endswith("backend_compile_duration"):
            found.append(seconds)

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        yield found
    finally:
        jax.monitoring.unregister_event_duration_listener(note)


def last(solve, p):
    return solve(T[[0, -1]], INITIAL, p).q[-1, 0]


def test_runs_and_gradients_compile_once(model):
    p = model.parameter_vector(PARAMETERS)
    solve = model.solve_fn(INITIAL, method="tsit5")
    with compilations() as first:
        motion, gradient = solve(T, INITIAL, PARAMETERS), jax.grad(lambda p: last(solve, p))(p)
    assert first
    scene_again = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")
    for function in (solve, scene_again.solve_fn(INITIAL, method="tsit5")):
        with compilations() as again:
            same, other = function(T, INITIAL, PARAMETERS), jax.grad(lambda p, f=function: last(f, p))(p)
        assert not again
        np.testing.assert_array_equal(same.y, motion.y)
        np.testing.assert_array_equal(other, gradient)
    kept = len(jax.live_arrays())
    for _ in range(3):
        solve(T, INITIAL, PARAMETERS), jax.grad(lambda p: last(solve, p))(p)
    assert len(jax.live_arrays()) == kept


def test_equal_models_functions_and_fields_are_equal(model):
    same, other = (da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", outputs=o) for o in ((), ("X",)))
    assert model == same and hash(model) == hash(same) and model != other
    assert model.vector_field == same.vector_field and hash(model.vector_field) == hash(same.vector_field)
    assert model.vector_field != other.vector_field and model.vector_field != 1.0
    solve = model.solve_fn(INITIAL)
    assert solve == same.solve_fn(INITIAL) and hash(solve) == hash(same.solve_fn(INITIAL))
    assert solve not in (other.solve_fn(INITIAL), model.solve_fn(), model.solve_fn(INITIAL, rtol=1e-7), 1.0)
    traced = []

    @jax.jit
    def rate(model, y, p):
        traced.append(model)
        return model.vector_field(0.0, y, p)

    y, p = model.state(INITIAL, PARAMETERS), model.parameter_vector(PARAMETERS)
    np.testing.assert_array_equal(rate(model, y, p), rate(same, y, p))
    assert len(traced) == 1
    rate(da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", formulation="projected"), np.ones(6), p)
    assert len(traced) == 2


def test_memory_of_runs_does_not_grow_with_the_steps_allowed(model):
    p = model.parameter_vector(PARAMETERS)
    values = np.tile(list(INITIAL.values()), (8, 1))

    def bytes_of(max_steps):
        solve = model.solve_fn(INITIAL, method="tsit5", max_steps=max_steps)
        runs = jax.jit(jax.vmap(lambda values: solve(T, values, p).q))
        return runs.lower(values).compile().memory_analysis().temp_size_in_bytes

    assert bytes_of(10**6) == bytes_of(100)


@pytest.mark.matrix
def test_states_between_the_ends_are_those_of_runs_that_keep_all_steps(model):
    """Runs with derivatives keep all steps, others blocks of them; here there are ten blocks, some without a time."""
    times = np.linspace(0.0, 6.0, 9)[[0, 1, 1, 3, 7, 8]] * np.array([[1.0], [-1.0]])
    values, p = np.array(list(INITIAL.values())), model.parameter_vector(PARAMETERS)
    solve = model.solve_fn(INITIAL, method="tsit5", max_step=0.02)
    kept = jax.jit(lambda t: jax.jvp(lambda p: solve(t, values, p).y, (p,), (0.0 * p,))[0])(times[1])
    alone = jax.jit(lambda t: solve(t, values, p).y)(times[1])
    batch = jax.jit(jax.vmap(lambda t: solve(t, values, p).y))(times)
    np.testing.assert_allclose(alone, kept, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(batch[1], kept, rtol=1e-12, atol=1e-13)
    back = jax.jit(lambda t, y: model.solve_fn(method="tsit5", max_step=0.02)(t, y, p).y)(times[0, ::-1], batch[0, -1])
    np.testing.assert_allclose(back, batch[0, ::-1], rtol=1e-5, atol=1e-5)
