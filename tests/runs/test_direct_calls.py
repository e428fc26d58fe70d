"""Calls of prepared runs by machine code: the final state of the run in Python, for whatever it is given."""

import gc
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import ValueInputError
from dalembert.methods.status import Status

PARAMETERS = {"m": 1.0, "b": 0.3, "I_C": 0.5}


@pytest.fixture(scope="module")
def model():
    return da.compile_model(da.scenes.chaplygin_sleigh())


@pytest.fixture(scope="module")
def given(model):
    return model.state({"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}, PARAMETERS)


@pytest.fixture(scope="module")
def p(model):
    return model.parameter_vector(PARAMETERS)


def in_python(run, state, p):
    """Return the final state of the run without the call by machine code."""
    return run._run(np.asarray(state, float), np.asarray(p, float))


def strided(values):
    return np.repeat(values, 2)[::2]


def swapped(values):
    return values.astype(">f8")


def read_only(values):
    values = values.copy()
    values.flags.writeable = False
    return values


class Own(np.ndarray):
    """Arrays of a class of a user's own."""


@pytest.mark.parametrize("made", [strided, swapped, read_only, lambda values: values.view(Own), list, tuple])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_arrays_of_every_layout_give_the_same_bits(model, given, p, made, method):
    run = model.prepare((0, 3), method=method)
    expected = in_python(run, given, p)
    assert np.array_equal(run(given, p), expected)
    for found in (run(made(given), p), run(given, made(p)), run(made(given), made(p))):
        assert np.array_equal(found, expected) and type(found) is np.ndarray
    assert run.status is Status.SUCCESS


@pytest.mark.parametrize("kind", [np.float32, np.int64, np.complex64, "U8"])
def test_other_numbers_are_converted_or_refused_as_in_python(model, p, kind):
    run = model.prepare((0, 1))
    whole = np.array([0, 0, 1, 1, 2])
    if kind in (np.complex64, "U8"):
        with pytest.raises(ValueInputError, match="state"):
            run(whole.astype(kind).tolist(), p)
    else:
        assert np.array_equal(run(whole.astype(kind), p), run(whole.astype(float), p))


@pytest.mark.parametrize("shape", [(4,), (6,), (1, 5), (5, 1), ()])
def test_other_shapes_are_refused(model, given, p, shape):
    run = model.prepare((0, 1))
    with pytest.raises(ValueInputError, match=r"state must have shape \(5,\)"):
        run(np.zeros(shape), p)
    with pytest.raises(ValueInputError, match=r"p must have shape \(3,\)"):
        run(given, np.ones((2, 2)))


@pytest.mark.usefixtures("small_heap")
def test_a_final_state_is_an_array_of_its_own_that_leaks_nothing(model, given, p):
    run = model.prepare((0, 1))
    first = run(given, p)
    kept, start = first.copy(), given.copy()
    second = run(given + 0.1, p)
    assert np.array_equal(first, kept) and not np.array_equal(second, first) and np.array_equal(given, start)
    counts = [sys.getrefcount(value) for value in (given, p)]
    gc.collect()
    before = len(gc.get_objects())
    for _ in range(1000):
        run(given, p)
    gc.collect()
    assert [sys.getrefcount(value) for value in (given, p)] == counts
    assert len(gc.get_objects()) - before < 100 and sys.getrefcount(run(given, p)) <= 2


def test_statuses_are_those_of_the_last_run(model, given, p):
    run = model.prepare((0, 10), max_steps=20, rtol=1e-6)
    fast = given * [1, 1, 1, 100, 100]  # takes more steps
    run(given, p)
    assert run.status is Status.SUCCESS
    final = run(fast, p)
    assert run.status is Status.MAX_STEPS and np.array_equal(final, in_python(run, fast, p))
    run(given, p)
    assert run.status is Status.SUCCESS
    with ThreadPoolExecutor(1) as pool:
        pool.submit(run, fast, p).result()
        assert pool.submit(lambda: run.status).result() is Status.MAX_STEPS
    assert run.status is Status.SUCCESS


def test_states_that_are_not_finite_end_as_in_python(model, given, p):
    run = model.prepare((0, 1))
    for place in range(5):
        state = given.copy()
        state[place] = np.nan
        found, status = run(state, p), run.status
        assert np.array_equal(found, in_python(run, state, p), equal_nan=True) and status is run.status
        assert status is not Status.SUCCESS


def test_long_runs_return_to_python_and_end(model, given, p):
    run = model.prepare((0, 2000), method="tsit5", rtol=1e-10)  # pauses, so that Ctrl-C is seen
    assert np.array_equal(run(given, p), in_python(run, given, p))
    assert run.status is Status.SUCCESS


def test_threads_that_share_a_run_have_the_same_bits(model, given, p):
    run = model.prepare((0, 20), rtol=1e-12)
    states = [given * (1 + 0.01 * k) for k in range(40)]
    expected = [in_python(run, state, p) for state in states]
    with ThreadPoolExecutor(8) as pool:
        for _ in range(5):
            found = list(pool.map(lambda state: run(state, p), states))
            assert all(map(np.array_equal, found, expected))


@pytest.mark.usefixtures("small_heap")
def test_a_run_and_its_function_outlive_the_model(given, p):
    run = da.compile_model(da.scenes.chaplygin_sleigh()).prepare((0, 1))
    expected, direct = run(given, p), run._direct
    gc.collect()
    assert np.array_equal(run(given, p), expected)
    del run
    gc.collect()
    assert np.array_equal(direct(given, p), expected) and direct(given) is None and direct(given, given) is None


def test_a_python_without_the_global_lock_has_the_runs_of_python(model, given, p, monkeypatch):
    monkeypatch.setattr(sys, "_is_gil_enabled", lambda: False, raising=False)
    run = model.prepare((0, 1))
    assert run._direct is None and np.array_equal(run(given, p), in_python(run, given, p))


@pytest.fixture(scope="module")
def cart():
    """Return a cart of mass m that an input u pushes, and d brakes; its state, and its parameters."""
    x, u, d, N, O = *dynamicsymbols("x u d"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("cart", P, symbols("m")))
    scene.add_inputs(u, d)
    scene.add_loads((P, (u - d * x.diff()) * N.x))
    model = da.compile_model(scene)
    held = {"inputs": {"u": 0, "d": 0}}
    return model, model.state({"x": 0, "x_dot": 1}, {"m": 2}, **held), model.parameter_vector({"m": 2}, **held)


@pytest.mark.parametrize("kind", [float, int, np.float32, ">f8", list])
def test_inputs_of_every_type_are_held_over_the_run(cart, kind):
    model, state, p = cart
    run = model.prepare((0, 0.5))
    expected = model.simulate((0, 0.5), {"x": 0, "x_dot": 1}, {"m": 2}, inputs={"u": 3, "d": 1})
    inputs = [3, 1] if kind is list else np.array([3, 1], kind)
    for given in (p, np.round(p).astype(int)):  # whole numbers are no reason to round the inputs
        kept = given.copy()
        assert np.abs(run(state, given, inputs) - expected.y[-1]).max() < 1e-9
        assert np.array_equal(run(state, given, np.array([0.5, 0.0])), run(state, p, [0.5, 0.0]))
        assert np.array_equal(given, kept)
    assert np.abs(run(state, p, [0.5, 0.0])[1] - 1.125) < 1e-12


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_inputs_without_values_are_named(cart, value):
    model, state, p = cart
    run = model.prepare((0, 0.5))
    with pytest.raises(ValueInputError, match="missing inputs: d"):
        run(state, p, np.array([1.0, value]))
    with pytest.raises(ValueInputError, match=r"inputs must have shape \(2,\)"):
        run(state, p, np.zeros(3))
    with pytest.raises(ValueInputError, match="missing inputs: u, d"):
        run(state, model.parameter_vector({"m": 2}))
