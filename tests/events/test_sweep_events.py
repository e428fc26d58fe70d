"""Events of sweeps: every method against single runs, and against itself in other company."""

import numpy as np
import pytest
import sympy as sp

import dalembert as da
from dalembert.codegen.llvm.backend import LLVMLibrary
from dalembert.methods.status import Status
from events.test_events import FALL, SWING, ball, bounce, bounces, g, model, pendulum, theta, time, x, y

pytestmark = pytest.mark.usefixtures("quick_xla")
LANES = ("taylor", "dop853", "tsit5")
OTHERS = [("numpy", "dop853"), ("numpy", "lsoda"), ("jax", "dopri8")]
N = 13  # not a multiple of any number of lanes
HEIGHTS = np.linspace(0.6, 1.5, N)
ANGLES = np.linspace(0.5, 2.9, N)

BALL_EVENTS = [bounce(0.8), x - 1, da.Event(sp.sin(30 * time + y), name="clock", direction=1)]
HALVED = {theta.diff(): -theta.diff() / 2, x.diff(): -x.diff() / 2, y.diff(): -y.diff() / 2}
PENDULUM_EVENTS = [
    da.Event(theta + sp.Rational(1, 3), direction=-1, apply=HALVED, name="wall"),
    "theta_dot",
    da.Event(y + sp.Float(0.5), terminal=2, name="height"),
]


def sweep_balls(cases=slice(None), *, backend="llvm", method="auto", events=BALL_EVENTS, **options):
    start = {x: 0.0, y: HEIGHTS[cases], x.diff(): 0.7, y.diff(): 0.0}
    options = {"rtol": 1e-10, "atol": 1e-11, "threads": 1} | options
    return model(ball, backend).sweep((0.0, 2.5), start, FALL, events=events, method=method, **options)


def sweep_pendula(cases=slice(None), *, formulation="minimal", method="auto", events=PENDULUM_EVENTS, **options):
    start = {theta: ANGLES[cases], theta.diff(): 0.4}
    options = {"rtol": 1e-10, "atol": 1e-11, "threads": 1} | options
    return model(pendulum, "llvm", formulation).sweep((0.0, 3.0), start, SWING, events=events, method=method, **options)


def assert_equal_to_single_runs(sweep, single, cases, tolerance):
    for i in cases:
        run = single(i)
        assert Status(sweep.status[i]) is run.status
        np.testing.assert_allclose(sweep.t[i], run.t[-1], atol=tolerance)
        np.testing.assert_allclose(sweep.y[i], run.y[-1], atol=10 * tolerance)
        assert set(sweep.events) == set(run.events)
        for name, record in run.events.items():
            counts = sweep.events[name]
            assert counts.count[i] == len(record)
            ends = record.t[[0, -1]] if len(record) else [np.nan, np.nan]
            np.testing.assert_allclose([counts.first[i], counts.last[i]], ends, atol=tolerance)


def assert_same(a, b, order=slice(None)):
    """Assert that two sweeps agree to the last bit, in everything."""
    for name in ("y", "t", "status", "steps"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name)[order])
    for name in a.events:
        for part in ("count", "first", "last"):
            np.testing.assert_array_equal(getattr(a.events[name], part), getattr(b.events[name], part)[order])
    if a.samples is not None:
        np.testing.assert_array_equal(a.samples, b.samples[order])


@pytest.mark.parametrize("method", LANES)
def test_balls_equal_single_runs_and_closed_forms(method):
    sweep = sweep_balls(method=method)

    def single(i):
        start = {x: 0.0, y: HEIGHTS[i], x.diff(): 0.7, y.diff(): 0.0}
        options = {"rtol": 1e-10, "atol": 1e-11, "method": method}
        return model(ball).simulate((0.0, 2.5), start, FALL, events=BALL_EVENTS, **options)

    assert_equal_to_single_runs(sweep, single, range(0, N, 4), 1e-10)
    for i in range(N):
        exact = bounces(0.8, 200, HEIGHTS[i])
        exact = exact[exact < 2.5]
        assert sweep.events["floor"].count[i] == len(exact)
        np.testing.assert_allclose(sweep.events["floor"].first[i], exact[0], atol=1e-13)
        np.testing.assert_allclose(sweep.events["floor"].last[i], exact[-1], atol=1e-10)


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("method", LANES)
def test_pendula_equal_single_runs(method, formulation):
    sweep = sweep_pendula(method=method, formulation=formulation)
    assert {Status(s) for s in sweep.status} == {Status.EVENT, Status.SUCCESS}
    assert np.all(sweep.success) and not sweep.failures()

    def single(i):
        start = {theta: ANGLES[i], theta.diff(): 0.4}
        options = {"rtol": 1e-10, "atol": 1e-11, "method": method}
        chosen = model(pendulum, "llvm", formulation)
        return chosen.simulate((0.0, 3.0), start, SWING, events=PENDULUM_EVENTS, **options)

    assert_equal_to_single_runs(sweep, single, range(0, N, 3), 1e-7)
    gap = sweep["x"] - SWING["l"] * np.sin(sweep["theta"]), sweep["y"] + SWING["l"] * np.cos(sweep["theta"])
    assert np.abs(gap).max() < 1e-13


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("method", LANES)
@pytest.mark.parametrize("run", [sweep_balls, sweep_pendula])
def test_company_changes_no_bit(run, method, sampled, monkeypatch):
    options = {"method": method} | ({"t_eval": np.linspace(0.0, 2.5, 7)} if sampled else {})
    if run is sweep_pendula:
        options["formulation"] = "projected"
    together = run(**options)
    assert_same(together, run(np.arange(N)[::-1], **options), slice(None, None, -1))
    many = np.resize(np.arange(N), 150)
    for threads in (1, 2):
        assert_same(run(many, **options | {"threads": threads}), together, many)
    for lanes in (1, 2):
        monkeypatch.setattr(LLVMLibrary, "lanes", lanes)
        assert_same(run(**options), together)
    for i in (0, N // 2):
        assert_same(run(slice(i, i + 1), **options), together, slice(i, i + 1))


@pytest.mark.parametrize("method", LANES)
def test_samples(method):
    times = np.linspace(0.0, 2.5, 26)
    stop = da.Event(x - 1.4, terminal=True, name="stop")
    sweep = sweep_balls(method=method, t_eval=times, events=[bounce(0.8), stop])
    assert np.all(sweep.status == Status.EVENT)
    np.testing.assert_allclose(sweep.t, 2.0, atol=1e-12)
    run = model(ball).simulate(
        (0.0, 2.5),
        {x: 0.0, y: HEIGHTS[3], x.diff(): 0.7, y.diff(): 0.0},
        FALL,
        events=[bounce(0.8), stop],
        method=method,
        t_eval=times,
        rtol=1e-10,
        atol=1e-11,
    )
    reached = len(run.t)
    before = reached - 1  # they stop at the time of a sample: rounding decides whether they still take it
    np.testing.assert_allclose(sweep.samples[3, :before], run.y[:before], atol=1e-8)
    assert np.all(np.isnan(sweep.samples[:, reached + 1 :])) and np.all(np.isfinite(sweep.samples[:, : reached - 1]))


@pytest.mark.parametrize("backend, method", OTHERS)
def test_other_backends(backend, method):
    cases = slice(0, N, 6)
    options = {"rtol": 1e-8, "atol": 1e-9} if method == "lsoda" else {}
    sweep = sweep_balls(cases, backend=backend, method=method, t_eval=[0.3, 1.0], **options)
    lanes = sweep_balls(cases, t_eval=[0.3, 1.0])
    for name in ("floor", "clock"):
        np.testing.assert_array_equal(sweep.events[name].count, lanes.events[name].count)
        np.testing.assert_allclose(sweep.events[name].last, lanes.events[name].last, atol=1e-5)
    np.testing.assert_allclose(sweep.samples, lanes.samples, atol=1e-5)


@pytest.mark.parametrize("method", LANES)
def test_failures_stay_with_their_case(method):
    """Accumulation, a jump that contradicts the constraints, and an expression that is not a number."""
    e = sp.Symbol("m", positive=True) / 10  # a parameter that the motion does not depend on
    events = [
        da.Event(y, direction=-1, apply={y.diff(): -e * y.diff()}, name="floor"),
        sp.sqrt(sp.Float(2.2) - time * sp.Symbol("m", positive=True) / 5),
    ]
    start = {x: 0.0, y: 1.0, x.diff(): 0.7, y.diff(): 0.0}
    mass = np.resize([8.0, 2.0, 5.0], N)

    def run(cases):
        given = {"m": mass[cases], "g": 9.81}
        return model(ball).sweep((0.0, 2.3), start, given, events=events, method=method, threads=1)

    sweep = run(slice(None))
    expected = [Status.EVENT_NON_FINITE, Status.EVENTS_ACCUMULATE, Status.SUCCESS]
    fall = np.sqrt(2 / 9.81)
    ends = [11 / 8, fall + 2 * fall * 0.2 / 0.8, fall + 2 * fall * 0.5 / 0.5]
    expected[2] = Status.EVENTS_ACCUMULATE
    np.testing.assert_array_equal(sweep.status, np.resize(expected, N))
    np.testing.assert_allclose(sweep.t, np.resize(ends, N), atol=1e-5)
    for i in range(3):
        alone = run(slice(i, i + 1))
        np.testing.assert_array_equal(alone.y[0], sweep.y[i])
    broken = sweep_pendula(formulation="projected", events=[da.Event(theta, apply={theta.diff(): 0})], method=method)
    assert {Status(s) for s in broken.status} == {Status.EVENT_STATE}
    np.testing.assert_array_equal(broken.events["theta"].count, 1)


@pytest.mark.parametrize("method", LANES)
def test_events_at_one_time(method):
    events = [
        da.Event(y, direction=-1, apply={y.diff(): -y.diff()}, name="floor"),
        da.Event(time - sp.sqrt(2 / g), apply={x.diff(): -x.diff()}, name="clock"),
        da.Event(time**2 * g / 2 - 1, name="again"),
        "x",
    ]
    start = {x: 0.0, y: 1.0, x.diff(): np.linspace(1.0, 2.0, N), y.diff(): 0.0}
    sweep = model(ball).sweep((0.0, 1.2), start, FALL, events=events, method=method, threads=1)
    assert np.all(sweep.success)
    for name in ("floor", "clock", "again", "x"):
        np.testing.assert_array_equal(sweep.events[name].count, 1)
    np.testing.assert_allclose(sweep.events["x"].first, 2 * np.sqrt(2 / 9.81), atol=1e-12)
    assert np.all(sweep["y"] > 0.0)


@pytest.mark.parametrize("method", LANES)
def test_zeros_at_the_very_end(method):
    sweep = sweep_balls(method=method, events=[da.Event(time - sp.Rational(5, 2), terminal=True, name="end"), x])
    assert np.all(sweep.status == Status.EVENT) and np.all(sweep.events["end"].count == 1)
    np.testing.assert_array_equal(sweep.t, 2.5)
    np.testing.assert_array_equal(sweep.events["x"].count, 0)
