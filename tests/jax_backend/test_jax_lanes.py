from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from sympy import symbols

import dalembert as da
from dalembert.methods.status import Status
from dalembert.starts.inputs import constants
from dalembert.steps.problem import IntegrationProblem
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import step_kernel
from hard_cases.particles import double_pendulum_cartesian

jnp = pytest.importorskip("jax").numpy
pytest.importorskip("diffrax")

from dalembert.jax.pieces import series_attempts  # noqa: E402
from dalembert.jax.runs.series import TaylorIntegrator  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_xla")

SLEIGH = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
CASES = {"m": 1.0, "b": np.linspace(0.1, 0.5, 21), "I_C": 0.5}
T = np.array([0.0, 0.7, 0.7, 2.0])
METHODS = ("taylor", "dopri8", "tsit5", "kvaerno5")


@cache
def compiled(backend="jax", formulation="minimal"):
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend, formulation=formulation)


def sweep(model, method="auto", **options):
    options = {"t_span": (0.0, 2.0), "initial": SLEIGH, "parameters": CASES, "rtol": 1e-8, "atol": 1e-10, **options}
    return model.sweep(method=method, **options)


@pytest.mark.parametrize(
    ("method", "formulation"), [*((m, "minimal") for m in METHODS), ("taylor", "projected"), ("tsit5", "projected")]
)
def test_sweeps_are_those_of_numba(method, formulation):
    run = sweep(compiled("jax", formulation), method, t_eval=T)
    exact = sweep(compiled("llvm", formulation), t_eval=T, rtol=1e-12, atol=1e-14)
    assert (run.status == Status.SUCCESS).all()
    for name in ("x", "y", "theta", "theta_dot"):
        np.testing.assert_allclose(run.final[name], exact.final[name], rtol=0, atol=2e-6)
        np.testing.assert_allclose(run[name], exact[name], rtol=0, atol=2e-6)


@pytest.mark.parametrize("method", METHODS[:3])
def test_a_case_that_fails_leaves_its_neighbours_alone(method):
    whole = sweep(compiled(), method)
    b = CASES["b"].copy()
    b[3] = np.nan
    spoiled = sweep(compiled(), method, parameters={**CASES, "b": b})
    good = np.arange(len(b)) != 3
    assert spoiled.status[3] == Status.NON_FINITE
    np.testing.assert_array_equal(spoiled.final["x"][good], whole.final["x"][good])


@pytest.mark.parametrize("method", METHODS[:3])
def test_backward_mixed_and_empty_spans(method):
    ends = np.where(np.arange(21) % 2, -1.0, 1.0)
    ends[4] = 0.0
    run = sweep(compiled(), method, t_span=(0.0, ends))
    exact = sweep(compiled("llvm"), t_span=(0.0, ends), rtol=1e-12, atol=1e-14)
    assert (run.status == Status.SUCCESS).all()
    np.testing.assert_allclose(run.final["x"], exact.final["x"], rtol=0, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_steps_that_run_out(method):
    run = sweep(compiled(), method, max_steps=2, t_span=(0.0, 50.0))
    assert (run.status == Status.MAX_STEPS).all()


@pytest.mark.matrix
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_taylor_trajectories(sign):
    parameters = {**CASES, "b": 0.3}
    run = compiled().simulate((0.0, sign * 3.0), SLEIGH, parameters, method="taylor", rtol=1e-11, atol=1e-13)
    exact = compiled("llvm").simulate((0.0, sign * 3.0), SLEIGH, parameters, rtol=1e-13, atol=1e-15)
    assert run.success and len(run.t) == run.stats.steps + 1 and run.t[-1] == sign * 3.0
    times = np.linspace(0.0, sign * 3.0, 31)
    np.testing.assert_allclose(run(times).y, exact(times).y, rtol=0, atol=1e-9)
    short = compiled().simulate((0.0, 3.0), SLEIGH, parameters, method="taylor", max_steps=2)
    assert short.status is Status.MAX_STEPS and len(short.t) == 3


@cache
def never_projected():
    """Return steps of a Taylor series whose states behind t = 0.3 cannot be projected."""
    model, order = compiled(), 8
    program, size = model.stages.program, len(model.layout.state)
    step = step_kernel(recurrences(program.kernel("rhs"), step_growth_limited=False), order, dense=True)
    projections = [(lambda t, y, c: (jnp.where(t > 0.3, jnp.nan, 0.0) * y[0],), 1)]
    kernels = SimpleNamespace(program=program, projections=projections)
    return TaylorIntegrator(series_attempts(step, size, step_growth_limited=False), kernels, order, 2000)


@pytest.mark.parametrize(("most", "status"), [(4, Status.MAX_STEPS), (10**6, Status.PROJECTION_FAILED)])
def test_taylor_steps_that_cannot_be_projected_are_attempts(most, status):
    """They count against `max_steps`, as in all other runs (`step_control.status_after`)."""
    model, p = compiled(), {**CASES, "b": 0.3}
    problem = IntegrationProblem(
        t0=0.0,
        t1=2.0,
        y0=model.state(SLEIGH, p),
        constants=constants(model.stages.program, model.parameter_vector(p)),
        max_steps=most,
    )
    run = never_projected()(problem)
    assert run.status == status and len(run.t) == run.steps + 1 and run.end < 0.3 and run.rejected > 1
    assert run.evaluations == run.steps + run.rejected <= most
    assert status != Status.MAX_STEPS or run.evaluations == most
    assert status == Status.MAX_STEPS or run.end == pytest.approx(0.3, abs=1e-12)


def test_methods_that_sweeps_take():
    """That of `simulate`: test_jax_backend.test_final_state_is_that_of_scipy."""
    assert sweep(compiled()).stats.method == "taylor"


@pytest.mark.parametrize(
    ("method", "formulation"),
    [
        *((m, "minimal") for m in METHODS),
        ("dopri8", "projected"),
        pytest.param("taylor", "projected", marks=pytest.mark.matrix),  # as sweeps are above; XLA takes half a minute
    ],
)
def test_prepared_runs(method, formulation):
    model, parameters = compiled("jax", formulation), {**CASES, "b": 0.3}
    run = model.prepare((0.0, 2.0), method=method, rtol=1e-10, atol=1e-12)
    y, p = model.state(SLEIGH, parameters), model.parameter_vector(parameters)
    exact = compiled("llvm", formulation).simulate((0.0, 2.0), SLEIGH, parameters, rtol=1e-13, atol=1e-14).y[-1]
    np.testing.assert_allclose(run(y, p), exact, rtol=0, atol=2e-8)
    assert run.status is Status.SUCCESS
    short = model.prepare((0.0, 50.0), method=method, max_steps=3)
    short(y, p)
    assert short.status is Status.MAX_STEPS


@pytest.mark.matrix
def test_implicit_steps_are_as_long_as_their_errors_allow():
    """An iteration that fails at every other step made 343 steps and 322 rejections of this, and MAX_STEPS of 10 s."""
    case = double_pendulum_cartesian()
    model = da.compile_model(case.scene, backend="jax", formulation="projected")
    options = {"method": "kvaerno5", "rtol": 1e-4, "atol": 1e-6}
    run = model.simulate((0.0, 10.0), case.initial, case.parameters, max_steps=1000, **options)
    assert run.success and run.stats.rejected < 0.5 * run.stats.steps < 300
    assert np.abs(run.constraint_violation).max() < 1e-10
    assert np.ptp(run["energy"]) < 0.2 * 9.81
    sweep = model.sweep((0.0, 2.0), case.initial, {"g": np.array([9.0, 9.81])}, max_steps=200, **options)
    assert sweep.success.all()


def test_stiff_sleigh():
    """A spring and a damper hold the angle so strongly that it creeps to zero; numba's radau is what it is held to."""
    scene = da.scenes.chaplygin_sleigh()
    stiffness, damping = symbols("K C", positive=True)
    theta = scene.coordinates[2]
    moment = -(stiffness * theta + damping * theta.diff())
    scene.add_loads((scene.bodies[0].frame, moment * scene.frame.z))
    start = {**SLEIGH, "theta_dot": 0.0}
    parameters = {"m": 1.0, "b": 0.3, "I_C": 0.5, "K": 1e6, "C": 1e6}
    exact = da.compile_model(scene).simulate((0.0, 3.0), start, parameters, method="radau", rtol=1e-10, atol=1e-12)
    model = da.compile_model(scene, backend="jax")
    times, errors = np.linspace(0.0, 3.0, 61), []
    for tolerance in (1e-5, 1e-7):
        run = model.simulate((0.0, 3.0), start, parameters, method="kvaerno5", rtol=tolerance, atol=1e-2 * tolerance)
        assert run.success and run.stats.steps < 600
        np.testing.assert_allclose(run(times).y, exact(times).y, rtol=0, atol=tolerance)
        errors.append(np.abs(run.y[-1] - exact.y[-1]).max())
    assert errors[1] < 0.1 * errors[0] < 1e-7
