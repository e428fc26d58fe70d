"""Samples as inputs of traced runs: against the compiled backend, and their derivatives against differences."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import OptionError, UnknownNameError, ValueInputError
from dalembert.methods.status import Status
from jax_backend.jax_options import QUICK
from starts.test_input_values import driven, forced

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")
records = pytest.importorskip("dalembert.jax.arguments")

pytestmark = pytest.mark.usefixtures("quick_xla")

KNOTS = np.array([0.0, 0.31, 0.5, 0.93, 1.4, 2.05, 2.6, 3.0])
VALUES = np.array([0.4, -1.1, 0.7, 1.6, -0.2, -0.9, 1.3, 0.1])
T = np.array([0.1, 0.7, KNOTS[4], 1.9, KNOTS[6]])
START = {"x": 0.2, "x_dot": -0.1}
PARAMETERS = {"m": 0.8, "k": 2.0}
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
METHODS = {"hold": "dopri8", "linear": "tsit5", "cubic": "taylor"}


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@cache
def compiled(scene=forced, backend="jax", **options):
    return da.compile_model(scene(), backend=backend, **options)


def solve_fn(method, scene=forced, start=tuple(START), **options):
    return compiled(scene).solve_fn(start, method=method, **{**TIGHT, **options})


def expected(t, inputs, scene=forced, start=START, p=PARAMETERS):
    """Return coordinates, rates and outputs by the compiled backend."""
    model = compiled(scene, "llvm")
    run = model.simulate((t[0], t[-1]), start, p, inputs=inputs, t_eval=t, rtol=1e-13, atol=1e-14)
    return np.column_stack([run.q, run.qdot, *(run[name] for name in model.layout.outputs)])


def everything(run):
    return jax.numpy.concatenate([run.q, run.qdot, run.outputs], axis=1)


@pytest.mark.parametrize("kind", METHODS)
def test_samples_are_those_of_the_compiled_backend(kind):
    record, solve = da.samples(KNOTS, VALUES, kind), solve_fn(METHODS[kind])
    found = jax.jit(lambda t: solve(t, START, PARAMETERS, inputs={"u": record}), compiler_options=QUICK)
    for times in (T, T[::-1]):
        run = found(times)
        assert run.status == 0
        np.testing.assert_allclose(everything(run), expected(times, {"u": record}), rtol=1e-10, atol=1e-10)


def test_extrapolation_and_knots_between_the_ends_alone():
    times, record = np.array([-0.5, 1.0, 3.5, 4.0]), da.samples(KNOTS, VALUES, "cubic", "linear")
    run = jax.jit(lambda: solve_fn("tsit5")(times, START, PARAMETERS, inputs={"u": record}), compiler_options=QUICK)()
    np.testing.assert_allclose(everything(run), expected(times, {"u": record}), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("kind", METHODS)
def test_polynomials_are_those_of_the_record(kind):
    given = [
        da.samples(KNOTS[:count], VALUES[:count], kind, extrapolate)
        for extrapolate in ("error", "hold", "linear")
        for count in (2, 3, 5)
    ]
    made = jax.jit(lambda: [records.polynomials(jax.numpy.asarray(record.t), record) for record in given])()
    for record, found in zip(given, made, strict=True):
        rows = record.coefficients(np.clip(np.arange(-1, len(record.t)), record.first, record.last))
        np.testing.assert_allclose(found, rows[:, slice(*records.COLUMNS[kind])], rtol=1e-12, atol=1e-13)


def test_inputs_with_other_knots_in_positions_and_in_loads():
    start, p = {"theta": 0.3, "theta_dot": -0.2}, {"m": 1.1, "ell": 0.7, "g": 9.81}
    inputs = {
        "u": da.samples(KNOTS[:4], VALUES[:4] / 4.0, "cubic", "hold"),
        "v": da.samples(KNOTS[1::2], VALUES[::2]),
    }
    times = np.array([0.31, 0.6, 2.9])
    with pytest.raises(ValueInputError, match="'u' continue beyond their knots"):
        solve_fn("dopri8", driven, tuple(start))(times, start, p, inputs=inputs)
    inputs["u"] = da.samples(KNOTS, VALUES / 4.0, "cubic")
    solve = solve_fn("dopri8", driven, tuple(start))
    run = jax.jit(lambda: solve(times, start, p, inputs=inputs), compiler_options=QUICK)()
    np.testing.assert_allclose(everything(run), expected(times, inputs, driven, start, p), rtol=1e-9, atol=1e-9)


# -- derivatives ----------------------------------------------------------------------------------


def differences(function, at, size=1e-5):
    """Return the derivatives of a function by the numbers of an array, by differences."""
    moves = size * np.eye(len(at))
    return np.stack([(function(at + move) - function(at - move)) / (2.0 * size) for move in moves], axis=-1)


@pytest.mark.parametrize("kind", METHODS)
def test_derivatives_by_values_are_differences(kind):
    solve = solve_fn(METHODS[kind])

    def motion(values, p):
        return everything(solve(T, START, p, inputs={"u": da.samples(KNOTS, values, kind)}))

    mode = {"hold": jax.jacrev, "linear": jax.jacfwd, "cubic": jax.jacrev}[kind]
    by_values, by_p = jax.jit(mode(motion, (0, 1)), compiler_options=QUICK)(VALUES, PARAMETERS)
    want = differences(lambda values: expected(T, {"u": da.samples(KNOTS, values, kind)}), VALUES)
    np.testing.assert_allclose(by_values, want, rtol=1e-6, atol=1e-7)

    def masses(m):
        return expected(T, {"u": da.samples(KNOTS, VALUES, kind)}, p={**PARAMETERS, "m": m[0]})

    np.testing.assert_allclose(by_p["m"], differences(masses, np.array([0.8]))[..., 0], rtol=1e-6, atol=1e-7)


@pytest.mark.matrix
def test_derivatives_by_knots_and_times_where_they_are_those_of_the_motion():
    solve = solve_fn("tsit5")

    def motion(knots, times, kind="linear"):
        return everything(solve(times, START, PARAMETERS, inputs={"u": da.samples(knots, VALUES, kind)}))

    times = np.array([0.1, 0.7, 1.9])
    along = 0.3 * np.cos(np.arange(len(KNOTS))), np.array([0.4, -1.0, 0.7])
    pushed = jax.jit(lambda *at: jax.jvp(motion, at, along)[1], compiler_options=QUICK)(KNOTS, times)

    def moved(size):
        knots, t = KNOTS + size * along[0], times + size * along[1]
        return expected(t, {"u": da.samples(knots, VALUES)})

    np.testing.assert_allclose(pushed, (moved(1e-5) - moved(-1e-5)) / 2e-5, rtol=1e-6, atol=1e-7)
    with pytest.raises(OptionError, match="by the knots of input 'u', samples of kind 'hold'"):
        jax.jacfwd(lambda knots: motion(knots, times, "hold"))(KNOTS)
    with pytest.raises(OptionError, match="second derivatives by the knots of input 'u'"):
        jax.jacfwd(jax.jacfwd(lambda knots: motion(knots, times)))(KNOTS)


@pytest.mark.matrix
def test_second_derivatives_by_values_and_parameters():
    solve = solve_fn("tsit5", max_steps=256)

    def cost(given):
        run = solve(T[:2], START, {"m": given[0], "k": 2.0}, inputs={"u": da.samples(KNOTS[:4], given[1:])})
        return jax.numpy.sum(run.q**2)

    at = np.concatenate([[0.8], VALUES[:4]])
    along = np.array([0.3, 1.0, -0.7, 0.4, 0.2])
    both = jax.jit(lambda at: jax.jvp(jax.grad(cost), (at,), (along,)), compiler_options=QUICK)
    ahead, behind = (both(at + sign * 1e-5 * along)[0] for sign in (1.0, -1.0))
    np.testing.assert_allclose(both(at)[1], (ahead - behind) / 2e-5, rtol=1e-6, atol=1e-8)


def test_cases_have_their_own_records_and_their_own_failures():
    solve, tables = solve_fn("tsit5"), np.stack([VALUES, 2.0 * VALUES[::-1], VALUES**2])
    times = np.array([0.1, 0.7, 2.0])

    def end(record):
        return solve(times, START, PARAMETERS, inputs={"u": record})

    single = da.samples(KNOTS, tables)
    with pytest.raises(ValueInputError, match=r"values of shape \(3, 8\) and this is one run.*jax\.vmap"):
        end(single)
    quick = {"compiler_options": QUICK}
    runs = jax.jit(jax.vmap(lambda values: end(da.samples(KNOTS, values))), **quick)(tables)
    want = [expected(times, {"u": da.samples(KNOTS, values)}) for values in tables]
    np.testing.assert_allclose(jax.vmap(everything)(runs), want, rtol=1e-10, atol=1e-10)
    # Records are pytrees; a record of NaN, one whose knots are in no order, and a short one fail alone.
    knots = np.stack([KNOTS, KNOTS[::-1], KNOTS - 1.5])
    batch = jax.tree.map(lambda *rows: np.stack(rows), *(da.samples(KNOTS, values) for values in tables))
    batch = jax.tree.unflatten(jax.tree.structure(batch), [knots, tables])
    found = jax.jit(jax.vmap(end), **quick)(batch)
    np.testing.assert_array_equal(found.status, [0, int(Status.TIMES_IN_NO_ORDER), int(Status.OUTSIDE_TABLE)])
    np.testing.assert_allclose(found.y[0], runs.y[0], rtol=1e-12, atol=0.0)
    assert np.all(np.isnan(found.y[1:]))


# -- errors ---------------------------------------------------------------------------------------


def test_nan_in_values_and_weights_is_a_status_in_traced_code():
    def scaled(t, q, qdot, a):
        return a * q[0]

    solve = solve_fn("tsit5")
    for given in (lambda a: da.samples(KNOTS, a * VALUES), lambda a: da.feedback(scaled, a)):
        run = jax.jit(
            lambda a, given=given: solve(T[:2], START, PARAMETERS, inputs={"u": given(a)}), compiler_options=QUICK
        )
        assert [int(run(a).status) for a in (0.1, np.nan)] == [Status.SUCCESS, Status.NON_FINITE]


def test_what_is_wrong_with_inputs_is_named():
    solve, times = solve_fn("tsit5"), np.array([0.0, 1.0])

    def run(inputs, p: Any = PARAMETERS, function=solve, t=times):
        return function(t, START, p, inputs=inputs)

    for inputs, kind, message in (
        ({"u": da.samples([0.0, 0.5], [1.0, 2.0])}, ValueInputError, "'u' are too short.*run from t = 0 to 1"),
        ({"w": 1.0, "u": 1.0}, UnknownNameError, "unknown input 'w'.*Known: u"),
        ({"m": 1.0, "u": 1.0}, UnknownNameError, "'m' is a parameter"),
        ({}, UnknownNameError, "missing inputs: u"),
        ({"u": "fast"}, ValueInputError, "'u' must be a number, dalembert.samples"),
        ({"u": np.ones(3)}, ValueInputError, "'u' must be a number, dalembert.samples"),
        ([1.0], ValueInputError, "inputs must be a mapping"),
    ):
        with pytest.raises(kind, match=message):
            run(inputs)
    with pytest.raises(UnknownNameError, match=r"as inputs=\{\.\.\.\}: u"):
        run({"u": 1.0}, {**PARAMETERS, "u": 1.0})
    with pytest.raises(ValueInputError, match="'u' are traced by JAX"):
        jax.jit(lambda v: compiled().simulate((0, 1), START, PARAMETERS, inputs={"u": da.samples(KNOTS, v)}))(VALUES)


def test_numbers_given_as_inputs_are_those_given_among_parameters():
    solve, times = solve_fn("tsit5"), np.array([0.0, 1.0])
    one = solve(times, START, {**PARAMETERS, "u": 1.5})
    np.testing.assert_array_equal(one.y, solve(times, START, PARAMETERS, inputs={"u": 1.5}).y)
    p = compiled().parameter_vector(PARAMETERS)
    np.testing.assert_array_equal(one.y, solve(times, START, p, inputs={"u": 1.5}).y)


def test_a_record_that_was_a_pytree_serves_every_run():
    record = jax.tree.map(lambda array: array, da.samples(KNOTS, VALUES, "cubic"))
    same = da.samples(KNOTS, VALUES, "cubic")
    np.testing.assert_array_equal(expected(T, {"u": record}), expected(T, {"u": same}))
    with pytest.raises(ValueInputError, match="t must increase"):
        expected(T, {"u": jax.tree.map(lambda array: array[::-1], same)})


def test_dense_output_knows_the_inputs():
    solve = solve_fn("tsit5", dense=True, max_steps=512)
    run = solve(T[[0, -1]], START, PARAMETERS, inputs={"u": da.samples(KNOTS, VALUES)})
    np.testing.assert_allclose(everything(run.dense(T)), expected(T, {"u": da.samples(KNOTS, VALUES)}), rtol=1e-10)
