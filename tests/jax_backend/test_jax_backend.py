import logging
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen import backend_named
from dalembert.codegen.printers import JAX
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.ir.ops import OPERATIONS
from dalembert.ir.program import Layout, Program
from dalembert.methods.status import Status
from dalembert.steps.problem import IntegrationProblem
from oracles.cases import SLEIGH_CASES, SPHERE_CASES

jax = pytest.importorskip("jax")
diffrax = pytest.importorskip("diffrax")

from dalembert.jax import functions  # noqa: E402
from dalembert.jax.backend import JaxEngine  # noqa: E402
from dalembert.jax.modules import loaded, rendered_module  # noqa: E402
from dalembert.jax.runs import solvers  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

methods = pytest.mark.parametrize("method", solvers.METHODS)
CASES = [(case, "minimal") for case in (SLEIGH_CASES[0], SPHERE_CASES[0])] + [(SLEIGH_CASES[1], "augmented")]
cases = pytest.mark.parametrize(("case", "formulation"), CASES, ids=lambda part: getattr(part, "name", part))


@cache
def compiled(scene, formulation, backend="jax"):
    return da.compile_model(getattr(da.scenes, scene)(), backend=backend, formulation=formulation)


def hand_written(state, body, outputs):
    """Return a program whose state starts with the names in `state`, with one constant ``k``."""
    layout = Layout((), (), ("k",), (), (), tuple(state), (), (), 0, 1, {})
    loads = (Load("time", "t", None), *(Load(name, "y", i) for i, name in enumerate(state)), Load("k", "c", 0))
    body = tuple(Assignment(*line) for line in body)
    rhs = Kernel("rhs", ("t", "y", "c"), loads, body, tuple(outputs))
    return Program("hand written", "augmented", layout, (rhs,), ())


TRACED = []


@cache
def engine_of(name):
    """Return an engine of the JAX backend, which takes down in `TRACED` when its right-hand side is traced."""
    kernels = loaded(rendered_module(PROGRAMS[name]))

    def rhs(*arguments):
        TRACED.append(name)
        return kernels["rhs"](*arguments)

    return JaxEngine(PROGRAMS[name], {**kernels, "rhs": rhs})


PROGRAMS = {
    # A forced oscillator, and by large k what is compiled with it: a' = a^2, a' = sqrt(1 - t), no number, a' = 1.
    "oscillator": hand_written(
        "ab",
        [
            ("s", "sin", ("time",)),
            ("f", "mul", ("k", "s")),
            ("second", "sub", ("f", "a")),
            ("square", "mul", ("a", "a")),
            ("d", "sub", (1.0, "time")),
            ("root", "sqrt", ("d",)),
            ("z", "sub", ("a", "a")),
            ("nan", "div", ("z", "z")),
            *((f"below{n}", "less", ("k", 100.0 * n)) for n in (1, 2, 3, 4)),
            ("rest4", "select", ("below4", "nan", 1.0)),
            ("rest3", "select", ("below3", "root", "rest4")),
            ("rest2", "select", ("below2", "square", "rest3")),
            ("first", "select", ("below1", "b", "rest2")),
            ("r", "select", ("below1", "second", 0.0)),
        ],
        ["first", "r"],
    ),
    "constant": hand_written("ab", [], [1.0, "k"]),
}
FAULTS = {"blow up": 150.0, "square root": 250.0, "not a number": 350.0, "constant": 450.0}


def problem(y0=(1.0, 0.5), **options):
    defaults = {"t0": 0.0, "t1": 6.0, "constants": np.array([1.0]), "rtol": 1e-8, "atol": 1e-10}
    return IntegrationProblem(**{**defaults, **options, "y0": np.array(y0)})


def solve(method, y0=(1.0, 0.5), **options):
    return engine_of("oscillator").integrate(problem(y0, **options), method)


def solve_fault(name, method, start=1.0, **options):
    return solve(method, [start, 0.0], constants=np.array([FAULTS[name]]), **options)


# Kernels


def kernels_of(case, formulation):
    return [kernel for kernel in compiled(case.scene, formulation).stages.program if kernel.name != "prepare"]


@cases
def test_every_kernel_agrees_with_the_reference_interpreter(case, formulation):
    program = compiled(case.scene, formulation).stages.program
    engine = backend_named("jax").load(backend_named("jax").render(program), cache=False)
    generator = np.random.default_rng(7)
    parameters = generator.uniform(0.5, 1.5, len(program.layout.parameters))
    c = np.array(interpret(program.kernel("prepare"), {"p": parameters}))
    n = max(len(program.layout.state), 2 * len(program.layout.coordinates))
    t, y = generator.normal(size=20), generator.normal(size=(20, n))
    for kernel in kernels_of(case, formulation):
        values = engine.evaluate(kernel.name, t, y, c)
        assert values.dtype == np.float64 and values.shape == (20, len(kernel.outputs))
        expected = [interpret(kernel, {"t": t[i], "y": y[i], "c": c}) for i in range(20)]
        np.testing.assert_allclose(
            values, expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max(), err_msg=kernel.name
        )


@pytest.mark.parametrize("name", [name for name in JAX.formats if name in OPERATIONS])
def test_operation(name):
    operation = OPERATIONS[name]
    arguments = np.random.default_rng(3).uniform(0.1, 0.9, (20, 3)) * np.array([1.0, 1.0, -1.0])
    arguments[:4, 0], arguments[4:8, 1] = 0.0 if name in ("sign", "select") else 0.5, arguments[4:8, 0]
    kernel = hand_written("abd", [("r", name, tuple("abd"[: operation.arity]))], ["r"]).kernel("rhs")
    source = "\n    ".join(["def f(t, y, c):", *JAX.lines(kernel), f"return ({JAX.outputs(kernel)[0]},)"])
    namespace = {"jnp": jax.numpy, "fn": functions}
    exec(source, namespace)
    program = Program("operation", "augmented", PROGRAMS["oscillator"].layout, (kernel,), ())
    engine = JaxEngine(program, {"rhs": namespace["f"]})
    values = engine.evaluate("rhs", np.zeros(20), arguments, np.ones(1))[:, 0]
    expected = [operation.evaluate(*row[: operation.arity]) for row in arguments.tolist()]
    np.testing.assert_allclose(values, expected, rtol=1e-14)


@pytest.mark.parametrize("count", [0, 1, 3, 16, 17, 100])
def test_batches_of_any_size(count):
    t, y = np.linspace(0.0, 1.0, count), np.ones((count, 2))
    values = engine_of("oscillator").evaluate("rhs", t, y, np.array([2.0]))
    np.testing.assert_allclose(values, np.stack([y[:, 1], 2.0 * np.sin(t) - 1.0], axis=1), rtol=1e-15, atol=1e-15)
    values[:] = 0.0  # the array is the caller's


def test_constant_outputs():
    values = engine_of("constant").evaluate("rhs", np.zeros(3), np.zeros((3, 2)), np.array([4.0]))
    np.testing.assert_array_equal(values, [[1.0, 4.0]] * 3)


# Integration


# The cases of a scene by one method, so that each method is compiled once; all pairs in `matrix`.
TAKEN = {SLEIGH_CASES[0].name: "kvaerno5", **{case.name: "dopri8" for case in SLEIGH_CASES[1:]}}
EXACT = [
    pytest.param(case, method, marks=[] if TAKEN.get(case.name, "tsit5") == method else [pytest.mark.matrix])
    for case in (*SLEIGH_CASES, *SPHERE_CASES)
    for method in solvers.METHODS
]


@pytest.mark.parametrize(("case", "method"), EXACT, ids=lambda part: getattr(part, "name", part))
def test_final_state_is_exact(case, method):
    model = compiled(case.scene, "minimal")
    traj = model.simulate((0, 4), case.initial, case.parameters, method=method, rtol=1e-12, atol=1e-14)
    exact = case.exact(4)
    assert traj.success
    np.testing.assert_allclose(traj.q[-1], exact.q, rtol=0, atol=2e-11)
    np.testing.assert_allclose(traj.qdot[-1], exact.qdot, rtol=0, atol=2e-11)


@cases
def test_final_state_is_that_of_scipy(case, formulation):
    options = {"t_span": (0, 4), "initial": case.initial, "parameters": case.parameters, "rtol": 1e-12, "atol": 1e-13}
    ours = compiled(case.scene, formulation).simulate(**options)
    reference = compiled(case.scene, formulation, "numpy").simulate(**options)
    assert ours.stats.method == "dopri8"
    np.testing.assert_allclose(ours.q[-1], reference.q[-1], rtol=0, atol=1e-10)
    np.testing.assert_allclose(ours.qdot[-1], reference.qdot[-1], rtol=0, atol=1e-10)


@methods
def test_error_falls_with_the_tolerance(method):
    exact = solve(method, rtol=1e-13, atol=1e-14).y[-1]
    errors = [
        np.abs(solve(method, rtol=tolerance, atol=tolerance).y[-1] - exact).max()
        for tolerance in (1e-4, 1e-6, 1e-8, 1e-10)
    ]
    assert (np.diff(errors) < 0.0).all()
    assert (np.array(errors) < 20 * np.array([1e-4, 1e-6, 1e-8, 1e-10])).all()


@methods
def test_legs_leave_no_trace(method, monkeypatch):
    times = np.linspace(0.0, 6.0, 101)
    options = {"rtol": 1e-11, "atol": 1e-11}
    runs = [solve(method, dense=True, **options), solve(method, t_eval=times, **options)]
    monkeypatch.setattr(solvers, "BLOCK_STEPS", 5)
    backend = backend_named("jax")
    engine = backend.load(backend.render(PROGRAMS["oscillator"]), cache=False)
    for whole, given in zip(runs, ({"dense": True}, {"t_eval": times}), strict=True):
        legs = engine.integrate(problem(**options, **given), method)
        assert (legs.steps, legs.rejected) == (whole.steps, whole.rejected) and whole.steps > 15
        np.testing.assert_allclose(legs.t, whole.t, rtol=1e-12)
        np.testing.assert_allclose(legs.y, whole.y, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(legs.y, runs[0].dense(times), rtol=1e-12, atol=1e-13)


@methods
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steps_dense_output_and_t_eval_agree(method, sign):
    options = {"t1": sign * 6.0}
    run = solve(method, dense=True, **options)
    assert run.success and run.t[0] == 0.0 and run.t[-1] == options["t1"]
    assert len(run.t) == run.steps + 1 and (sign * np.diff(run.t) > 0.0).all()
    np.testing.assert_allclose(run.dense(run.t), run.y, rtol=1e-13, atol=1e-14)
    times = np.unique(np.concatenate([run.t, np.linspace(0.0, options["t1"], 57)]))[:: int(sign)]
    sampled = solve(method, t_eval=times, **options)
    np.testing.assert_array_equal(sampled.t, times)
    np.testing.assert_allclose(sampled.y, run.dense(times), rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(sampled.y[np.isin(times, run.t)], run.y)
    assert (sampled.steps, sampled.rejected) == (run.steps, run.rejected)
    exact = solve(method, t_eval=times, rtol=1e-13, atol=1e-14, **options)
    np.testing.assert_allclose(run.dense(times), exact.y, rtol=0, atol=1e-6)


@methods
def test_there_and_back(method):
    there = solve(method, t1=3.0, rtol=1e-10)
    back = solve(method, there.y[-1], t0=3.0, t1=0.0, rtol=1e-10)
    assert back.t[-1] == 0.0 and not np.signbit(back.t[-1]) and (np.diff(back.t) < 0.0).all()
    np.testing.assert_allclose(back.y[-1], [1.0, 0.5], atol=1e-7)


@methods
def test_zero_span(method):
    run = solve(method, t0=2.0, t1=2.0, dense=True)
    assert run.success and run.steps == 0
    np.testing.assert_array_equal(run.t, [2.0])
    np.testing.assert_array_equal(run.y, [[1.0, 0.5]])
    np.testing.assert_array_equal(run.dense(np.array([2.0])), [[1.0, 0.5]])
    run = solve(method, t0=2.0, t1=2.0, t_eval=np.array([2.0, 2.0]))
    np.testing.assert_array_equal(run.y, [[1.0, 0.5]] * 2)


@methods
def test_repeated_and_empty_t_eval(method):
    times = np.array([0.0, 0.0, 2.5, 2.5, 6.0, 6.0])
    run = solve(method, t_eval=times)
    np.testing.assert_array_equal(run.t, times)
    np.testing.assert_array_equal(run.y[::2], run.y[1::2])
    run = solve(method, t_eval=np.zeros(0))
    assert run.success and run.y.shape == (0, 2)


@methods
def test_max_step_and_first_step(method):
    run = solve(method, rtol=1e-3, atol=1e-3, max_step=0.07, first_step=1e-3)
    steps = np.diff(run.t)
    assert steps.max() <= 0.07 * (1 + 1e-8) and steps[0] == pytest.approx(1e-3)
    assert np.diff(solve(method, first_step=1e9, max_step=2.0, rtol=1e9).t)[0] == 2.0


# How runs end


@methods
def test_max_steps_counts_attempts(method):
    run = solve(method, t1=1e3, max_steps=7, t_eval=np.linspace(0.0, 1e3, 10**4))
    assert run.status is Status.MAX_STEPS
    assert run.steps + run.rejected == 7
    assert 0 < len(run.t) == len(run.y) < 10**4
    enough = solve(method)
    exactly = enough.steps + enough.rejected
    assert solve(method, max_steps=exactly).success
    assert solve(method, max_steps=exactly - 1).status is Status.MAX_STEPS


@methods
def test_max_steps_over_several_legs(method):
    run = solve(method, t1=1e9, max_steps=2 * solvers.BLOCK_STEPS + 3, max_step=1e-2)
    assert run.status is Status.MAX_STEPS
    assert run.steps + run.rejected == 2 * solvers.BLOCK_STEPS + 3
    assert len(run.t) == run.steps + 1 and (np.diff(run.t) > 0.0).all()


@pytest.mark.parametrize("method", [name for name, method in solvers.METHODS.items() if not method.implicit])
def test_finite_time_blow_up(method):
    run = solve_fault("blow up", method, t1=2.0, dense=True)
    assert run.status is Status.STEP_TOO_SMALL
    assert run.t[-1] == pytest.approx(1.0, abs=1e-6) and len(run.t) == run.steps + 1
    assert np.isfinite(run.y).all()
    assert run.dense(np.array([0.5]))[0, 0] == pytest.approx(2.0, rel=1e-7)
    times = np.linspace(0.0, 2.0, 20)
    sampled = solve_fault("blow up", method, t1=2.0, t_eval=times)
    np.testing.assert_array_equal(sampled.t, times[times < 1.0])


@methods
def test_nan_at_the_start(method):
    for run in (
        solve_fault("not a number", method, dense=True),
        solve(method, [np.nan, 1.0], t_eval=np.array([0.0, 1.0]), dense=True),
    ):
        assert run.status is Status.NON_FINITE
        assert run.steps == 0 and len(run.t) == 1


@methods
@pytest.mark.parametrize("first_step", [None, 10.0])
def test_nan_on_the_way(method, first_step):
    run = solve_fault("square root", method, 0.0, t1=2.0, first_step=first_step)
    assert run.status is Status.NON_FINITE
    assert 0.9 <= run.t[-1] <= 1.0 and np.isfinite(run.y).all()


@methods
def test_zero_tolerance_and_zero_state(method):
    assert solve(method, [0.0, 0.0], constants=np.zeros(1), atol=0.0).success
    assert solve_fault("constant", method, 0.0, atol=0.0).success


@methods
def test_evaluations_are_counted(method):
    run = solve(method)
    stages = solvers.METHODS[method].solver.tableau.num_stages
    assert run.evaluations == (stages - 1) * (run.steps + run.rejected) + 4


# Compilation


@methods
def test_other_numbers_compile_nothing(method, caplog):
    engine = engine_of("oscillator")
    engine.integrate(problem(), method)
    engine.evaluate("rhs", np.zeros(10), np.ones((10, 2)), np.ones(1))
    count = TRACED.count("oscillator")
    assert count <= 2
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        for options in (
            {"rtol": 1e-4, "atol": 1e-5, "t1": 3.0, "constants": np.array([2.0])},
            {"t0": 5.0, "t1": -5.0, "dense": True, "first_step": 0.1, "max_step": 0.3, "max_steps": 77},
            {"t1": 50.0, "max_step": 0.1, "t_eval": np.linspace(0.0, 50.0, 33)},
        ):
            engine.integrate(problem([0.3, 0.4], **options), method)
        engine.evaluate("rhs", np.zeros(13), np.ones((13, 2)), np.zeros(1))
    assert TRACED.count("oscillator") == count
    assert not caplog.records


@pytest.mark.parametrize("enabled", [False, True])
def test_double_precision_leaves_the_setting_alone(enabled):
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", enabled)
    try:
        run = solve("dopri8", rtol=1e-13, atol=1e-13, dense=True)
        values = engine_of("oscillator").evaluate("rhs", np.ones(1), np.ones((1, 2)), np.ones(1))
        assert jax.config.jax_enable_x64 is enabled
        assert jax.numpy.ones(1).dtype == (np.float64 if enabled else np.float32)
    finally:
        jax.config.update("jax_enable_x64", before)
    assert {array.dtype for array in (run.t, run.y, run.dense(run.t), values)} == {np.dtype(np.float64)}
    assert values[0, 1] == np.sin(1.0) - 1.0
    backend = backend_named("numpy")
    reference = backend.load(backend.render(PROGRAMS["oscillator"]), cache=False)
    exact = reference.integrate(problem(rtol=1e-13, atol=1e-13), "dop853").y[-1]
    np.testing.assert_allclose(run.y[-1], exact, rtol=0, atol=1e-11)


def test_debugging_of_nans_does_not_turn_a_status_into_an_exception():
    with jax.debug_nans(True):
        assert solve_fault("square root", "dopri8", 0.0, t1=2.0).status is Status.NON_FINITE


EXTRAS = """
import os, sys
import dalembert.codegen
print([name for name in ('jax', 'diffrax', 'equinox') if name in sys.modules], flush=True)
for package in ('jax', 'diffrax'):
    if not os.fork():
        sys.modules[package] = None
        for attempt in range(2):
            try:
                dalembert.codegen.backend_named('jax')
            except dalembert.errors.MissingExtraError as error:
                print(package, isinstance(error, ImportError), error, flush=True)
        dalembert.codegen.backend_named('numpy')
        os._exit(0)
    assert os.wait()[1] == 0
"""


@pytest.fixture(scope="module")
def extras():
    """Return what a process without JAX prints, and its forks in each of which a package is missing."""
    run = subprocess.run([sys.executable, "-c", EXTRAS], capture_output=True, text=True, check=True)
    return run.stdout.splitlines()


def test_jax_is_imported_only_when_asked_for(extras):
    assert extras[0] == "[]"


@pytest.mark.parametrize("package", ["jax", "diffrax"])
def test_missing_extra(package, extras):
    first, second = (line.removeprefix(f"{package} ") for line in extras if line.startswith(f"{package} "))
    assert first == second
    assert first.startswith("True") and 'pip install "dalembert[jax]"' in first and package in first
