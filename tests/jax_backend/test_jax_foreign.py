"""Single runs as calls of machine code, beside the traced loops that they replace."""

import gc
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import OptionError
from dalembert.methods.status import Status

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

from dalembert.codegen import lane_runs  # noqa: E402
from dalembert.codegen.llvm.loops import loop_named  # noqa: E402
from dalembert.jax import foreign, solved  # noqa: E402
from dalembert.jax.foreign import ForeignRuns  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

TIMES = ((0.0, 2.0), (1.0, 0.6, 0.6, -0.5), (0.5, 0.5, 0.5, 0.5), (0.0, 1.0, 1.0, 500.0))


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


@cache
def sleigh(formulation="minimal"):
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", formulation=formulation)
    return model, model.state(initial, parameters), model.parameter_vector(parameters)


@pytest.mark.matrix
@pytest.mark.parametrize(
    ("method", "formulation"),
    [pytest.param("dopri8", "minimal", marks=pytest.mark.matrix), ("tsit5", "projected"), ("taylor", "minimal")],
)
def test_calls_take_the_steps_of_traced_loops(method, formulation, monkeypatch):
    model, y, p = sleigh(formulation)
    solve = model.solve_fn(method=method, rtol=1e-9, atol=1e-11, max_steps=150)
    called = [solve(np.array(t), y, p) for t in TIMES]
    monkeypatch.setattr(ForeignRuns, "serves", False)
    solved.solved_of.clear_cache()
    for t, found in zip(TIMES, called, strict=True):
        traced = solve(np.array(t), y, p)
        assert (int(found.status), int(found.steps)) == (int(traced.status), int(traced.steps))
        assert int(found.rejected) == int(traced.rejected)
        np.testing.assert_allclose(found.y, traced.y, rtol=1e-9, atol=1e-10)
    assert int(called[-1].status) == (Status.MAX_STEPS if method == "tsit5" else Status.SUCCESS)
    solved.solved_of.clear_cache()


def test_what_xla_knows_already_is_not_told_again():
    model, y, p = sleigh()
    times, solve = np.array([0.0, 1.0]), model.solve_fn(method="tsit5")
    first = solve(times, y, p).y
    foreign._handler.cache_clear()
    solved.solved_of.clear_cache()
    np.testing.assert_array_equal(solve(times, y, p).y, first)


@pytest.mark.matrix
def test_calls_and_batches_outlive_the_caches_of_code():
    """Was a segmentation fault: XLA called code that had been unloaded."""
    model, y, p = sleigh()
    times, solve = np.array([0.0, 1.0]), model.solve_fn(method="tsit5")
    alone, batch = jax.jit(lambda p: solve(times, y, p).y), jax.jit(jax.vmap(lambda p: solve(times, y, p).y))
    many = np.tile(p, (6, 1))
    found = alone(p), batch(many)
    for kept in (loop_named, lane_runs._advance_code, lane_runs._check_code, foreign._handler):
        kept.cache_clear()
    gc.collect()
    assert loop_named("lane_loop").call is not None  # in the place of what was unloaded
    for again in ((alone(p), batch(many)), (solve(times, y, p).y, jax.vmap(lambda p: solve(times, y, p).y)(many))):
        for one, other in zip(again, found, strict=True):
            np.testing.assert_array_equal(one, other)


def test_what_is_not_finite_fails_at_the_start():
    model, y, p = sleigh()
    solve = model.solve_fn(method="tsit5")
    for t in (np.array([0.0, 1.0]), np.array([1.0, 1.0])):
        for given in ((np.full_like(y, np.nan), p), (y, np.where(np.arange(len(p)) == 1, np.inf, p))):
            found = solve(t, *given)
            assert int(found.status) == Status.NON_FINITE and int(found.steps) == 0


def test_a_run_is_one_call_with_the_value_of_its_gradient():
    model, y, p = sleigh()
    times = np.array([0.0, 0.4, 1.0])
    solve = model.solve_fn(method="tsit5")

    def end(p):
        return (solve(times, y, p).y[-1] ** 2).sum()

    program = jax.jit(lambda p: solve(times[[0, 2]], y, p).y).lower(p).as_text()
    assert "dalembert_run_" in program and "stablehlo.while" not in program
    both = jax.value_and_grad(lambda p: (end(p), solve(times, y, p).y), has_aux=True)
    (_, beside), gradient = jax.jit(both)(p)
    np.testing.assert_array_equal(beside, solve(times, y, p).y)
    step = 1e-6
    for i in range(len(p)):
        move = step * np.eye(len(p))[i]
        np.testing.assert_allclose(gradient[i], (end(p + move) - end(p - move)) / (2 * step), rtol=1e-6, atol=1e-7)


def test_threads_run_the_same_call():
    model, y, p = sleigh()
    solve = model.solve_fn(method="tsit5", rtol=1e-12, atol=1e-13)
    run = jax.jit(lambda y: solve(np.array([0.0, 20.0]), y, p).y[-1])
    starts = [y * (1.0 + 0.01 * i) for i in range(16)]
    alone = [np.asarray(run(start)) for start in starts]

    def in_thread(start):
        with jax.enable_x64(True):
            return np.asarray(run(start))

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(in_thread, starts))
    np.testing.assert_array_equal(alone, together)


def test_portable_programs_are_exported_as_traced_loops():
    model, y, p = sleigh()
    solves = (model.solve_fn(method="tsit5", portable=portable) for portable in (False, True))
    called, portable = (jax.jit(lambda y, solve=solve: solve(np.array(TIMES[0]), y, p).y[-1]) for solve in solves)
    shape = jax.ShapeDtypeStruct(y.shape, np.float64)
    exported = jax.export.export(portable)(shape)
    assert "dalembert_run_" not in exported.mlir_module() and "while" in exported.mlir_module()
    np.testing.assert_allclose(exported.call(y), called(y), rtol=1e-9)
    assert "dalembert_run_" in called.lower(y).as_text()
    with pytest.raises(ValueError, match="custom calls"):
        jax.export.export(called)(shape)
    with pytest.raises(OptionError, match="portable=True"):
        model.solve_fn(events=[da.Event(model.layout.state[0], name="start")], portable=True)
