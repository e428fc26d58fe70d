"""Reductions of sweeps against closed forms and against dense trajectories."""

import numpy as np
import pytest
import sympy as sp

import dalembert as da
from dalembert.codegen.llvm.backend import LLVMLibrary
from dalembert.errors import ExpressionError, OptionError, UnknownNameError
from dalembert.methods.status import Status
from events.test_events import FALL, SWING, ball, bounce, model, pendulum, theta, time, x, y

pytestmark = pytest.mark.usefixtures("quick_xla")
METHODS = [("llvm", "taylor"), ("llvm", "dop853"), ("llvm", "tsit5"), ("numpy", "dop853"), ("jax", "dopri8")]
N = 13  # not a multiple of any number of lanes
ANGLES = np.linspace(0.5, 2.9, N)
KEPT = {
    "low": da.minimum("y"),
    "high": da.maximum(y),
    "fastest": da.maximum(sp.sin(3 * theta) * theta.diff()),
    "average": da.mean(theta**2),
    "jolt": da.mean("kinetic_energy"),
    "crossing": da.first_crossing(theta + sp.Float(0.2)),
    "falling": da.first_crossing(theta.diff(), direction=1),
    "never": da.first_crossing(theta - 10),
    "end": da.final("energy"),
    "wave": da.maximum(sp.cos(40 * time + theta)),
}


def swings(cases=slice(None), *, backend="llvm", formulation="minimal", method="taylor", **options):
    start = {theta: ANGLES[cases], theta.diff(): 0.4}
    options = {"rtol": 1e-11, "atol": 1e-12, "threads": 1, "reduce": KEPT} | options
    return model(pendulum, backend, formulation).sweep((0.5, 2.5), start, SWING, method=method, **options)


def top_of(values):
    """Return the maximum of a function from closely spaced values: that of a parabola through the largest three."""
    i = int(np.argmax(values))
    if i in (0, len(values) - 1):
        return values[i]
    a, b, c = values[i - 1 : i + 2]
    return b + (c - a) ** 2 / (8 * (2 * b - a - c))


@pytest.mark.parametrize(
    "backend, method, formulation",
    [(*pair, "minimal") for pair in METHODS] + [(*pair, "projected") for pair in METHODS if pair[0] == "llvm"],
)
def test_against_dense_trajectories(backend, method, formulation):
    cases = np.arange(0, N, 5)
    kept = swings(cases, backend=backend, method=method, formulation=formulation).reduced
    assert list(kept) == list(KEPT) and all(values.shape == cases.shape for values in kept.values())
    for place, i in enumerate(cases):
        run = model(pendulum, "llvm").simulate(
            (0.5, 2.5),
            {theta: ANGLES[i], theta.diff(): 0.4},
            SWING,
            rtol=1e-12,
            atol=1e-13,
            events=[theta + sp.Float(0.2), da.Event("theta_dot", direction=1)],
        )
        t = np.linspace(0.5, 2.5, 20001)
        fine = run(t)
        turning = run.events["theta_dot"]
        close = {"rtol": 0, "atol": 1e-8}
        np.testing.assert_allclose(kept["low"][place], -top_of(-fine["y"]), **close)
        np.testing.assert_allclose(kept["high"][place], top_of(fine["y"]), **close)
        fastest = top_of(np.sin(3 * fine["theta"]) * fine["theta_dot"])
        np.testing.assert_allclose(kept["fastest"][place], fastest, **close)
        nodes, weights = np.polynomial.legendre.leggauss(200)
        at = run(1.5 + nodes)
        np.testing.assert_allclose(kept["average"][place], weights @ at["theta"] ** 2 / 2, **close)
        np.testing.assert_allclose(kept["jolt"][place], weights @ at["kinetic_energy"] / 2, **close)
        crossing = run.events[0].t
        np.testing.assert_allclose(kept["crossing"][place], crossing[0] if len(crossing) else np.nan, **close)
        np.testing.assert_allclose(kept["falling"][place], turning.t[0] if len(turning) else np.nan, **close)
        assert np.isnan(kept["never"][place])
        np.testing.assert_allclose(kept["end"][place], run["energy"][-1], **close)
        np.testing.assert_allclose(kept["wave"][place], 1.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_closed_forms_between_steps(method):
    """A thrown ball: its top and the mean of its height, to rounding, within a step that knows nothing of them."""
    up = np.linspace(1.0, 9.0, N)
    keep = {"top": da.maximum(y), "mean": da.mean(y), "least": da.minimum(y), "down": da.first_crossing(y, -1)}
    sweep = model(ball).sweep(
        (0.0, 1.0), {x: 0.0, y: 0.0, x.diff(): 0.0, y.diff(): up}, FALL, reduce=keep, method=method, rtol=1e-12
    )
    g = FALL["g"]
    # coefficients of dop853's polynomial reach 1e2, and so does what rounding leaves of it, in units of the last place
    rounding = 2e-13 if method == "dop853" else 1e-13
    np.testing.assert_allclose(sweep.reduced["top"], np.where(up < g, up**2 / (2 * g), up - g / 2), rtol=rounding)
    np.testing.assert_allclose(sweep.reduced["mean"], up / 2 - g / 6, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(sweep.reduced["least"], np.minimum(0.0, up - g / 2), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(sweep.reduced["down"], np.where(2 * up < g, 2 * up / g, np.nan), rtol=rounding)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_motions_that_events_end_or_cut(method):
    stop = da.Event(x - sp.Float(1.1), terminal=True)
    keep = {"top": da.maximum(y), "speed": da.minimum("y_dot"), "mean": da.mean(y), "end": da.final(x)}
    start = {x: 0.0, y: 1.0, x.diff(): np.array([1.0, 0.5]), y.diff(): 0.0}
    swept = model(ball).sweep((0, 3), start, FALL, events=[bounce(0.8), stop], reduce=keep, method=method, rtol=1e-12)
    assert list(swept.events) == ["floor", str(stop.expression)]
    for i, speed in enumerate(start[x.diff()]):
        run = model(ball).simulate((0, 3), {**start, x.diff(): speed}, FALL, events=[bounce(0.8), stop], rtol=1e-12)
        np.testing.assert_allclose(swept.reduced["top"][i], 1.0, rtol=1e-15)
        np.testing.assert_allclose(swept.reduced["speed"][i], -np.sqrt(2 * 9.81), rtol=1e-12)
        np.testing.assert_allclose(swept.reduced["end"][i], min(1.1, 3 * speed), rtol=1e-12)
        knots = np.unique(np.concatenate([run.t, run.events["floor"].t]))
        nodes, weights = np.polynomial.legendre.leggauss(6)
        sizes = np.diff(knots)[:, np.newaxis]
        values = run((knots[:-1, np.newaxis] + sizes * (1 + nodes) / 2).ravel())["y"].reshape(-1, 6)
        mean = np.sum(values @ weights * sizes[:, 0] / 2) / (knots[-1] - knots[0])
        np.testing.assert_allclose(swept.reduced["mean"][i], mean, rtol=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_company_changes_no_bit(method, monkeypatch):
    def assert_same(a, b, order):
        for name in KEPT:
            np.testing.assert_array_equal(a.reduced[name], b.reduced[name][order])
        np.testing.assert_array_equal(a.y, b.y[order])

    together = swings(method=method)
    assert_same(swings(np.arange(N)[::-1], method=method), together, slice(None, None, -1))
    many = np.resize(np.arange(N), 150)
    for threads in (1, 2):
        assert_same(swings(many, method=method, threads=threads), together, many)
    for lanes in (1, 2):
        monkeypatch.setattr(LLVMLibrary, "lanes", lanes)
        assert_same(swings(method=method), together, slice(None))
    assert_same(swings(slice(3, 4), method=method), together, slice(3, 4))


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_short_forms_failures_and_empty_spans(backend):
    start = {x: 0.0, y: 1.0, x.diff(): 2.0, y.diff(): np.array([0.0, np.nan, 1.0])}
    sweep = model(ball, backend).sweep((0.0, 1.0), start, FALL, reduce=["x", y.diff(), "energy", x * y])
    assert list(sweep.reduced) == ["x", "y_dot", "energy", "x(t)*y(t)"]
    np.testing.assert_array_equal(np.isnan(sweep.reduced["x"]), [False, True, False])
    assert Status(sweep.status[1]) is Status.NON_FINITE
    for name in ("x", "y_dot", "energy"):
        np.testing.assert_allclose(sweep.reduced[name], np.where(sweep.success, sweep[name], np.nan), rtol=1e-14)
    start[y.diff()] = 3.0
    keep = {"a": da.mean(y.diff()), "b": da.maximum(y), "c": da.first_crossing(y), "d": da.final(x)}
    still = model(ball, backend).sweep((1.0, 1.0), start, FALL, reduce=keep)
    assert [float(still.reduced[name][0]) for name in "abd"] == [3.0, 1.0, 0.0] and np.isnan(still.reduced["c"][0])


def test_names_and_expressions_that_were_given():
    """As `events` of single runs have them; what was not asked for is named, with what was."""
    start = {x: 0.0, y: 1.0, x.diff(): 1.0, y.diff(): np.zeros(2)}
    sweep = model(ball).sweep((0, 1), start, FALL, events=[x - 0.5, x.diff()], reduce=[x])
    assert list(sweep.events[x - 0.5].count) == [1, 1] and sweep.events[x.diff()] is sweep.events["x_dot"]
    np.testing.assert_array_equal(sweep.reduced[x], sweep.final["x"])
    with pytest.raises(UnknownNameError, match="unknown event 'hit'"):
        sweep.events["hit"]
    with pytest.raises(UnknownNameError, match="unknown reduction 'top'"):
        sweep.reduced["top"]


def test_xarray():
    pytest.importorskip("xarray")
    grid = da.grid(theta=ANGLES[:3], theta_dot=[0.1, 0.2])
    options = {"grid": grid, "reduce": {"top": da.maximum(y), "x": da.mean(x)}, "threads": 1}
    options["events"] = [da.Event(theta.diff(), name="turn")]
    swept = model(pendulum).sweep((0, 1), {}, SWING, **options)
    data = swept.to_xarray()
    assert data["top"].shape == (3, 2) == data["x_reduced"].shape
    np.testing.assert_array_equal(data["top"].values.ravel(), swept.reduced["top"])
    for part in ("count", "first", "last"):
        np.testing.assert_array_equal(data[f"turn_{part}"].values.ravel(), getattr(swept.events["turn"], part))
    assert data["turn_count"].shape == (3, 2) and np.all(data["turn_count"] > 0)


@pytest.mark.parametrize(
    "reduce, error, words",
    [
        ("x", OptionError, "list"),
        ([da.maximum(x)], OptionError, "name"),
        (["x", x], OptionError, "two"),
        ({"a": da.mean("z")}, UnknownNameError, "'z'"),
        ({"a": da.first_crossing(sp.Integer(2))}, ExpressionError, "constant"),
        ({"a": da.first_crossing(x, 3)}, OptionError, "direction"),
    ],
)
def test_errors(reduce, error, words):
    with pytest.raises(error, match=words):
        model(ball).sweep((0, 1), {x: 0, y: 1, x.diff(): 0, y.diff(): 0}, FALL, reduce=reduce)
