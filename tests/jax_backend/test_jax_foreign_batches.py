"""Batches of runs in JAX programs as one call of the compiled loop over lanes."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.methods.status import Status
from jax_backend.jax_options import QUICK
from jax_backend.test_jax_foreign import sleigh

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

import jax.numpy as jnp  # noqa: E402

from dalembert.jax import solved  # noqa: E402
from dalembert.jax.foreign import ForeignRuns  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

T = np.array([0.0, 2.0])


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def rows_of(y, count):
    return jnp.asarray(y) * (1.0 + 0.01 * jnp.arange(count)[:, None])


def reached(solved):
    return solved.y, solved.status, solved.steps, solved.rejected


@pytest.mark.parametrize(
    ("method", "formulation", "times"),
    [
        ("dopri8", "minimal", (0.0, 2.0)),
        ("tsit5", "projected", (2.0, 0.0)),
        ("taylor", "minimal", (1.0, 0.6, 0.6, -0.5)),
    ],
)
def test_a_case_has_the_bits_of_its_run_alone(method, formulation, times):
    model, y, p = sleigh(formulation)
    solve = model.solve_fn(method=method, max_steps=200)
    rows = rows_of(y, 70)  # more than one thread takes
    rows = rows.at[3].set(jnp.nan).at[5, 2:].multiply(1e6)
    run = lambda y: reached(solve(np.array(times), y, p))  # noqa: E731
    program = jax.jit(jax.vmap(run)).lower(rows)
    assert "dalembert_batch_" in program.as_text() or len(times) > 2
    many = program.compile()(rows)
    assert int(many[1][3]) == Status.NON_FINITE and np.isnan(many[0][3][-1]).all()
    assert int(many[1][5]) not in (Status.SUCCESS, Status.NON_FINITE)
    assert np.sum(many[1] == Status.SUCCESS) == 68
    for i in (0, 3, 4, 5, 69):
        (y_there, *numbers), (y_alone, *wanted) = (np.asarray(each[i]) for each in many), map(np.asarray, run(rows[i]))
        assert list(map(int, numbers)) == list(map(int, wanted))
        np.testing.assert_array_equal(y_there[[0, -1]], y_alone[[0, -1]])
        np.testing.assert_allclose(y_there, y_alone, rtol=1e-13, atol=1e-13)  # XLA computes what lies between


@pytest.mark.matrix
def test_cases_are_those_of_a_sweep_of_the_llvm_backend():
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model, _, _ = sleigh()
    spins = np.linspace(0.5, 3.0, 40)
    name = "theta_dot"
    starts = np.stack([model.state({**initial, name: spin}, parameters) for spin in spins])
    p = model.parameter_vector(parameters)
    compiled = da.compile_model(da.scenes.chaplygin_sleigh())
    for method, own in (("taylor", "taylor"), ("dopri8", "dop853"), ("tsit5", "tsit5")):
        solve = model.solve_fn(method=method, rtol=1e-9, atol=1e-11)
        found = jax.vmap(lambda y, solve=solve: solve(T, y, p))(starts)
        sweep = compiled.sweep(T, {**initial, name: spins}, parameters, method=own, rtol=1e-9, atol=1e-11)
        final = np.stack([sweep.final[name] for name in compiled.layout.state], axis=1)
        np.testing.assert_allclose(found.y[:, -1], final, rtol=1e-13, atol=1e-14)
        np.testing.assert_array_equal(found.steps, sweep.steps)


@pytest.mark.parametrize(("method", "own"), [("dopri8", "dop853"), ("tsit5", "tsit5")])
def test_sweeps_of_both_backends_take_the_same_steps(method, own):
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    spins = np.linspace(0.5, 3.0, 21)
    spins[3:5] = 1e8, np.nan
    for span, times in (((0.0, 2.0), None), ((2.0, -1.0), [2.0, 0.3, 0.3, -1.0])):
        found = []
        for backend, name in (("jax", method), ("llvm", own)):
            model = da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend)
            given = {**initial, "theta_dot": spins}
            found.append(model.sweep(span, given, parameters, method=name, t_eval=times, max_steps=500))
        jax_run, llvm_run = found
        assert list(jax_run.status[3:5]) == [Status.MAX_STEPS, Status.NON_FINITE]
        for name in ("status", "steps"):
            np.testing.assert_array_equal(getattr(jax_run, name), getattr(llvm_run, name))
        for name in ("x", "theta"):
            np.testing.assert_allclose(jax_run.final[name], llvm_run.final[name], rtol=1e-12, atol=1e-13)
            if times is not None:
                np.testing.assert_allclose(jax_run[name], llvm_run[name], rtol=1e-6, atol=1e-7)


@pytest.mark.matrix
def test_batches_of_batches_and_what_all_cases_share():
    model, y, p = sleigh()
    solve = model.solve_fn(method="tsit5")
    rows, spans = rows_of(y, 3), jnp.array([[0.0, 1.0], [0.5, -1.0]])
    run = lambda t, y, p: solve(t, y, p).y[-1]  # noqa: E731
    inner = jax.vmap(run, (None, 0, None))
    nested = jax.vmap(inner, (0, None, None))
    turned = jax.vmap(jax.vmap(run, (0, None, None)), (None, 0, None), 1)
    own = jax.vmap(inner, (0, None, 0))(spans, rows, jnp.stack([p, p * 1.1]))
    mixed = jax.vmap(lambda t: jax.vmap(lambda s: run(t * s, y, p))(jnp.array([1.0, 2.0])))(spans)
    assert nested(spans, rows[:0], p).shape == (2, 0, len(y))
    assert jax.jit(nested).lower(spans, rows, p).as_text().count("custom_call @dalembert_batch") == 1
    for i, t in enumerate(spans):
        for k, start in enumerate(rows):
            alone = run(t, start, p)
            np.testing.assert_array_equal(nested(spans, rows, p)[i, k], alone)
            np.testing.assert_array_equal(turned(spans, rows, p)[i, k], alone)
            np.testing.assert_allclose(own[i, k], run(t, start, p * (1.0, 1.1)[i]), rtol=1e-13)
        np.testing.assert_array_equal(mixed[i, 1], run(2.0 * t, y, p))


def test_batches_in_loops_and_threads_and_far_more_than_processors():
    model, y, p = sleigh()
    solve = model.solve_fn(method="tsit5")
    rows = rows_of(y, 1000) / (1.0 + 0.01 * jnp.arange(1000.0)[:, None]) ** 0.9
    run = lambda y: solve(T, y, p).y[-1]  # noqa: E731
    many = jax.jit(jax.vmap(run))
    whole = np.asarray(many(rows))
    np.testing.assert_array_equal(jax.jit(lambda rows: jax.lax.map(run, rows, batch_size=200))(rows), whole)

    def in_thread(_):
        with jax.enable_x64(True):
            return np.asarray(many(rows))

    with ThreadPoolExecutor(6) as pool:
        for found in pool.map(in_thread, range(24)):
            np.testing.assert_array_equal(found, whole)


@pytest.mark.parametrize("times", [(0.0, 1.0), (0.0, 0.3, 1.0)], ids=["end", "times"])
def test_gradients_of_batches_go_along_the_steps_of_its_cases(times):
    model, y, p = sleigh()
    solve = model.solve_fn(method="tsit5", rtol=1e-7, max_steps=64)
    rows = rows_of(y, 5).at[2, 2:].multiply(1e6)  # one that fails, and cases of different length
    ends = jnp.linspace(0.5, 1.0, 5)

    def loss(y, p, end):
        solved = solve(np.array(times) * end, y, p)
        return jnp.sum(jnp.where(jnp.isfinite(solved.y[1:]), solved.y[1:], 0.0) ** 2), solved.y

    def mean(rows, p):
        losses, states = jax.vmap(loss, (0, None, 0))(rows, p, ends)
        return jnp.mean(losses), states

    gradient = jax.value_and_grad(mean, argnums=(0, 1), has_aux=True)
    (_, states), whole = jax.jit(gradient, compiler_options=QUICK)(rows, p)
    plain = jax.jit(jax.vmap(lambda y, end: solve(np.array(times) * end, y, p).y))(rows, ends)
    np.testing.assert_array_equal(states, plain)
    assert np.isnan(plain[2, -1]).all() and np.isfinite(plain[3]).all()
    one = jax.jit(jax.grad(lambda *given: loss(*given)[0], argnums=(0, 1)), compiler_options=QUICK)
    alone = [one(rows[i], p, ends[i]) for i in (0, 1, 3, 4)]
    np.testing.assert_allclose(whole[0][jnp.array([0, 1, 3, 4])], np.stack([each[0] for each in alone]) / 5, rtol=1e-9)
    np.testing.assert_allclose(whole[1], sum(each[1] for each in alone) / 5, rtol=1e-9, atol=1e-12)


def test_batches_that_are_exported_or_traced_agree(monkeypatch):
    model, y, p = sleigh()
    times, rows = np.array([0.0, 0.7, 2.0]), rows_of(y, 4)
    solve, portable = (model.solve_fn(method="tsit5", portable=portable) for portable in (False, True))

    def many(solve):
        return jax.jit(jax.vmap(lambda y: reached(solve(times, y, p))), compiler_options=QUICK)

    called = many(solve)(rows)
    exported = jax.export.export(many(portable))(jax.ShapeDtypeStruct(rows.shape, rows.dtype))
    assert "dalembert_batch" not in exported.mlir_module()
    monkeypatch.setattr(ForeignRuns, "serves", False)
    solved.solved_of.clear_cache()
    traced = many(solve)(rows)
    solved.solved_of.clear_cache()
    for found, wanted in zip(called, traced, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-10)
    for found, wanted in zip(exported.call(rows), traced, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("wide", [True, False])
def test_batches_without_cases(wide):
    model, y, p = sleigh()
    solve, none = model.solve_fn(method="tsit5"), jnp.zeros((0, len(y)))
    for times in (T, np.array([0.0, 0.5, 1.0])):
        with jax.enable_x64(wide):
            found = jax.jit(jax.vmap(lambda y, times=times: solve(times, y, p)))(none)
        assert found.y.shape == (0, len(times), len(y)) and found.status.shape == (0,)
    slopes = jax.grad(lambda p: jax.vmap(lambda y: solve(T, y, p).y)(none).sum())(jnp.asarray(p))
    np.testing.assert_array_equal(slopes, np.zeros(len(p)))
