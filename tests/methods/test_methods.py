import numpy as np
import pytest

from dalembert.methods.status import Status
from dalembert.methods.tableaus import TABLEAUS
from steps.integrator_cases import (
    METHODS,
    MIXED_START,
    NUMBA_METHODS,
    PENDULUM_CONSTANTS,
    PENDULUM_START,
    PROJECTABLE,
    blow_up,
    mixed,
    mixed_solution,
    not_a_number,
    pendulum,
    pendulum_position,
    pendulum_velocity,
    pendulum_violation,
    solve,
    square_root,
)

methods = pytest.mark.parametrize("method", METHODS)
projectable = pytest.mark.parametrize("method", PROJECTABLE)
PROJECTIONS = (pendulum_position, pendulum_velocity)

ORDERS = {f"llvm-{tableau.name}": (tableau.order, tableau.dense_order) for tableau in TABLEAUS} | {
    "scipy-dop853": (8, 7),
    "scipy-rk45": (5, 4),
}
STEPS = {5: np.array([40, 50, 64, 80]), 8: np.array([20, 25, 32, 40])}


LOOSE = {"rtol": 1e8, "atol": 1e8}


def fixed_steps(method, t1, n):
    """Take n equal steps from 0."""
    h = t1 / n * (1 + 1e-12)
    return solve(method, mixed, MIXED_START, t0=0.0, t1=t1, first_step=h, max_step=h, **LOOSE)


def one_step(method, t, h):
    """Take one step from the exact solution."""
    run = solve(method, mixed, mixed_solution(t), t0=t, t1=t + h, first_step=h, dense=True, **LOOSE)
    assert run.steps <= 2 and np.diff(run.t)[0] == pytest.approx(h)
    return run


def slope(h, errors):
    return np.polyfit(np.log(h), np.log(errors), 1)[0]


@pytest.mark.parametrize("method", ORDERS)
def test_order(method):
    order, _ = ORDERS[method]
    counts = STEPS[order]
    runs = [fixed_steps(method, 4.0, n) for n in counts]
    assert [run.steps for run in runs] == list(counts)
    errors = [np.abs(run.y[-1] - mixed_solution(4.0)).max() for run in runs]
    assert slope(4.0 / counts, errors) == pytest.approx(order, abs=0.3)


@pytest.mark.parametrize("method", ORDERS)
def test_order_of_dense_output(method):
    _, dense_order = ORDERS[method]
    sizes = np.array([0.14, 0.2, 0.28])
    errors = []
    for h in sizes:
        run = one_step(method, 1.0, h)
        times = np.linspace(1.0, 1.0 + h, 41)
        errors.append(np.abs(run.dense(times) - mixed_solution(times)).max())
    assert slope(sizes, errors) == pytest.approx(dense_order + 1, abs=0.3)


@methods
def test_error_falls_with_tolerance(method):
    tolerances = np.array([1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
    slow = method in ("scipy-bdf", "scipy-radau", "llvm-radau")
    times = np.linspace(0.0, 6.0, 31)
    errors = []
    for tolerance in tolerances[: 3 if slow else None]:
        run = solve(
            method,
            mixed,
            MIXED_START,
            t0=0.0,
            t1=6.0,
            rtol=tolerance,
            atol=tolerance,
            t_eval=times,
            max_steps=10**6,
        )
        assert run.status is Status.SUCCESS
        np.testing.assert_array_equal(run.t, times)
        errors.append(np.abs(run.y - mixed_solution(times)).max())
    errors = np.array(errors)
    assert np.all(errors[1:] < errors[:-1])
    assert np.all(errors < 2e3 * tolerances[: len(errors)])


@methods
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_accepted_steps_dense_output_and_t_eval_agree(method, sign):
    options = {"t0": 0.0, "t1": sign * 0.7, "rtol": 1e-6, "atol": 1e-8}
    run = solve(method, mixed, MIXED_START, dense=True, **options)
    assert run.success and run.t[0] == 0.0 and run.t[-1] == options["t1"]
    assert len(run.t) == run.steps + 1
    np.testing.assert_allclose(run.dense(run.t), run.y, rtol=1e-13, atol=1e-14)
    times = np.unique(np.concatenate([run.t, np.linspace(0.0, options["t1"], 23)]))[:: int(sign)]
    sampled = solve(method, mixed, MIXED_START, t_eval=times, **options)
    np.testing.assert_array_equal(sampled.t, times)
    np.testing.assert_allclose(sampled.y, run.dense(times), rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(sampled.y[np.isin(times, run.t)], run.y)
    assert sampled.steps == run.steps


@methods
def test_there_and_back(method):
    options = {"rtol": 1e-8, "atol": 1e-10, "max_steps": 10**6}
    there = solve(method, mixed, MIXED_START, t0=0.0, t1=3.0, **options)
    back = solve(method, mixed, there.y[-1], t0=3.0, t1=0.0, **options)
    assert back.t[-1] == 0.0 and np.all(np.diff(back.t) < 0.0)
    np.testing.assert_allclose(back.y[-1], MIXED_START, atol=2e-5)


@methods
def test_zero_span(method):
    run = solve(method, mixed, MIXED_START, t0=2.0, t1=2.0, dense=True)
    assert run.success and run.steps == 0
    np.testing.assert_array_equal(run.t, [2.0])
    np.testing.assert_array_equal(run.y, [MIXED_START])
    np.testing.assert_array_equal(run.dense(np.array([2.0])), [MIXED_START])
    run = solve(method, mixed, MIXED_START, t0=2.0, t1=2.0, t_eval=np.array([2.0, 2.0]))
    np.testing.assert_array_equal(run.y, [MIXED_START, MIXED_START])


@methods
def test_repeated_and_empty_t_eval(method):
    times = np.array([0.0, 0.0, 0.5, 0.5, 1.0, 1.0])
    run = solve(method, mixed, MIXED_START, t0=0.0, t1=1.0, t_eval=times)
    np.testing.assert_array_equal(run.t, times)
    np.testing.assert_allclose(run.y, mixed_solution(times), atol=1e-4)
    run = solve(method, mixed, MIXED_START, t0=0.0, t1=1.0, t_eval=np.zeros(0))
    assert run.success and run.y.shape == (0, 4)


@methods
def test_max_step_and_first_step(method):
    run = solve(method, mixed, MIXED_START, t0=0.0, t1=1.0, rtol=1e-3, atol=1e-3, max_step=0.07, first_step=1e-3)
    assert np.diff(run.t).max() <= 0.07 * (1 + 1e-8)
    assert np.diff(run.t)[0] <= 1e-3 * (1 + 1e-12)


@methods
def test_finite_time_blow_up(method):
    run = solve(method, blow_up, [1.0], t0=0.0, t1=2.0, rtol=1e-6, atol=1e-8, dense=True)
    assert run.status in (Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.MAX_STEPS)
    assert not run.success
    assert run.t[-1] == pytest.approx(1.0, abs=1e-3)
    assert np.all(np.isfinite(run.y))
    assert run.dense(np.array([0.5]))[0, 0] == pytest.approx(2.0, rel=1e-4)


@methods
def test_initial_nan(method):
    for run in (
        solve(method, not_a_number, [1.0], t0=0.0, t1=1.0),
        solve(method, mixed, [np.nan, 1.0, 0.0, 1.0], t0=0.0, t1=1.0),
    ):
        assert run.status is Status.NON_FINITE
        assert run.steps == 0 and run.evaluations == 1 and len(run.t) == 1


@methods
def test_nan_on_the_way(method):
    run = solve(method, square_root, [0.0], t0=0.0, t1=2.0, max_step=0.3)
    assert run.status is Status.NON_FINITE
    assert 0.6 <= run.t[-1] <= 1.0


@methods
def test_max_steps(method):
    run = solve(method, mixed, MIXED_START, t0=0.0, t1=100.0, max_steps=7, t_eval=np.linspace(0.0, 100.0, 10**4))
    assert run.status is Status.MAX_STEPS
    assert run.steps + run.rejected >= 7 and run.steps <= 7
    assert 0 < len(run.t) == len(run.y) < 10**4


@methods
def test_runs_repeat_exactly(method):
    runs = [solve(method, mixed, MIXED_START, t0=0.0, t1=2.0, dense=True) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].t, runs[1].t)
    np.testing.assert_array_equal(runs[0].y, runs[1].y)
    times = np.linspace(0.0, 2.0, 50)
    np.testing.assert_array_equal(runs[0].dense(times), runs[1].dense(times))


@pytest.mark.parametrize("name", NUMBA_METHODS)
def test_projection_holds_for_20_000_steps(name):
    options = {
        "t0": 0.0,
        "t1": 400.0,
        "rtol": 1e-6,
        "atol": 1e-6,
        "max_step": 0.02,
        "constants": PENDULUM_CONSTANTS,
        "max_steps": 10**5,
    }
    method = f"llvm-{name}"
    times = np.linspace(0.0, 400.0, 997)
    free = solve(method, pendulum, PENDULUM_START, **options)
    held = solve(method, pendulum, PENDULUM_START, projections=PROJECTIONS, **options)
    sampled = solve(method, pendulum, PENDULUM_START, projections=PROJECTIONS, t_eval=times, **options)
    assert held.steps >= 20_000
    assert pendulum_violation(held.y) <= 1e-12
    assert pendulum_violation(sampled.y) <= 1e-12
    assert pendulum_violation(free.y) > 1e2 * pendulum_violation(held.y)


@projectable
def test_projection_keeps_dense_output_continuous_and_t_eval_on_the_constraints(method):
    options = {"t0": 0.0, "t1": 3.0, "rtol": 1e-4, "atol": 1e-4, "constants": PENDULUM_CONSTANTS}
    run = solve(method, pendulum, PENDULUM_START, projections=PROJECTIONS, dense=True, **options)
    assert run.success
    assert pendulum_violation(run.y) < 1e-12
    np.testing.assert_allclose(run.dense(run.t), run.y, atol=1e-13)
    inside = run.t[1:-1]
    np.testing.assert_allclose(run.dense(inside * (1 - 1e-14)), run.y[1:-1], atol=1e-12)
    times = np.linspace(0.0, 3.0, 71)
    sampled = solve(method, pendulum, PENDULUM_START, projections=PROJECTIONS, t_eval=times, **options)
    assert pendulum_violation(sampled.y) < 1e-12
    np.testing.assert_allclose(sampled.y, run.dense(times), atol=2e-2)
    exact = solve("llvm-dop853", pendulum, PENDULUM_START, **{**options, "rtol": 1e-12, "atol": 1e-12})
    np.testing.assert_allclose(run.y[-1], exact.y[-1], atol=0.1)


@projectable
def test_velocity_projection_alone(method):
    run = solve(
        method,
        pendulum,
        PENDULUM_START,
        projections=(None, pendulum_velocity),
        constants=PENDULUM_CONSTANTS,
        t0=0.0,
        t1=2.0,
    )
    assert np.abs(run.y[:, 0] * run.y[:, 2] + run.y[:, 1] * run.y[:, 3]).max() < 1e-13


def never_converges(t, y, c, out):
    for i in range(len(out)):
        out[i] = 0.1


@projectable
def test_projection_failure_is_a_status(method):
    run = solve(method, mixed, MIXED_START, projections=(never_converges, None), t0=0.0, t1=1.0, max_steps=10**4)
    assert run.status is Status.PROJECTION_FAILED
    assert run.steps == 0
