"""Inputs that are Python functions of time, against SciPy on equations written by hand and the same scene with time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import OptionError, PrecisionWarning, ValueInputError
from dalembert.scene.symbol_table import InputSymbol
from dalembert.stops.function_samples import SampledSpan, sampled

x, u, theta = dynamicsymbols("x u theta")
m, k, ell, g = symbols("m k ell g", positive=True)
START, VALUES = {x: 1, x.diff(): 0}, {m: 1, k: 2}
HANGING, PENDULUM = {theta: 0.5, theta.diff(): 0}, {m: 1, ell: 1, g: 9.81}
PUSH, SUPPORT = InputSymbol("u", True, -1, ""), InputSymbol("u", True, 1, "the position of point 'A'")


def wave(t: float) -> float:
    return float(np.sin(3 * t))


def pushed(force: Any = u) -> da.Scene:
    """Return a mass on a cubic spring under a force."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, (force - k * x**3) * N.x))
    if force is u:
        scene.add_inputs(u)
    return scene


def driven() -> da.Scene:
    """Return a pendulum whose support moves along the input u."""
    N, O = ReferenceFrame("N"), Point("O")
    A = O.locatenew("A", u * N.x)
    P = A.locatenew("P", ell * sin(theta) * N.x - ell * cos(theta) * N.y)
    scene = da.Scene("driven", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("p", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_inputs(u)
    return scene


def reference(rates: Any, start: list[float], end: float) -> np.ndarray:
    return np.asarray(solve_ivp(rates, (0, end), start, method="DOP853", rtol=3e-14, atol=1e-15).y[:, -1])


@pytest.fixture(scope="module")
def model() -> Any:
    return da.compile_model(pushed())


def test_functions_have_the_accuracy_of_the_tolerance(model: Any) -> None:
    want = reference(lambda t, y: [y[1], np.sin(3 * t) - 2 * y[0] ** 3], [1.0, 0.0], 2.0)
    for rtol in (1e-6, 1e-9, 1e-12):
        for method in ("taylor", "dop853", "tsit5", "radau"):
            run = model.simulate((0, 2), START, VALUES, inputs={u: wave}, method=method, rtol=rtol, atol=rtol)
            assert run.success and np.max(np.abs(run.y[-1] - want)) < rtol + 1e-13, (rtol, method)
            assert "Note: input 'u' is a function, sampled at" in run.message
    assert run["u"][-1] == pytest.approx(wave(2), abs=1e-12)
    again = model.simulate((0, 2), START, VALUES, inputs={"u": wave}, method=method, rtol=rtol, atol=rtol)
    assert np.array_equal(again.y, run.y) and again.message == run.message


def test_a_support_that_moves_by_a_function() -> None:
    def rates(t: float, y: Any) -> list[float]:
        return [y[1], -9.81 * np.sin(y[0]) + 9 * np.sin(3 * t) * np.cos(y[0])]

    want, model = reference(rates, [0.5, 0.0], 3.0), da.compile_model(driven())
    for rtol in (1e-6, 1e-9):
        for method in ("taylor", "dop853"):
            run = model.simulate((0, 3), HANGING, PENDULUM, inputs={u: wave}, method=method, rtol=rtol, atol=rtol)
            assert np.max(np.abs(run.y[-1] - want)) < 10 * rtol, (rtol, method)
    with pytest.warns(PrecisionWarning, match=r"the rate of input 'u' is known to .* Loosen rtol to"):
        model.simulate((0, 0.1), HANGING, PENDULUM, inputs={u: wave}, rtol=1e-12, atol=1e-12)
    with pytest.raises(ValueInputError, match="it jumps there, or its slope does"):
        model.simulate((0, 1), HANGING, PENDULUM, inputs={u: lambda t: abs(t - 0.3)})
    with pytest.raises(ValueInputError, match="at one time its rates are needed"):
        model.accelerations(0.0, [0.1], [0.2], PENDULUM, inputs={u: wave})


TIGHT = {"rtol": 1e-10, "atol": 1e-12}


def position(t: float) -> float:
    """Return the position of the mass on its spring at a time, by the same scene with time in place of the input."""
    return float(reference(lambda t, y: [y[1], np.sin(3 * t) - 2 * y[0] ** 3], [1.0, 0.0], t)[0])


@pytest.mark.parametrize("backend", [name for name in BACKENDS if name != "llvm"])
def test_every_backend(backend: str) -> None:
    model = da.compile_model(pushed(), backend=backend)
    run = model.simulate((0, 1), START, VALUES, inputs={u: wave}, **TIGHT)
    assert run["x"][-1] == pytest.approx(position(1.0), abs=3e-10)
    assert "sampled at" in run.message


def test_every_way_of_running(model: Any) -> None:
    timed = da.compile_model(pushed(sin(3 * dynamicsymbols._t)))
    want = timed.simulate((0, 3), START, VALUES, events=[x], **TIGHT)
    run = model.simulate((0, 3), START, VALUES, inputs={u: wave}, events=[x], **TIGHT)
    np.testing.assert_allclose(run["x"][-1], want["x"][-1], atol=3e-10)
    np.testing.assert_allclose(run.events["x"].t, want.events["x"].t, atol=3e-10)
    sweep = model.sweep((0, np.array([3.0, 2.0])), START, VALUES, inputs={u: wave}, **TIGHT)
    np.testing.assert_allclose(sweep["x"], [position(3.0), position(2.0)], atol=3e-10)
    assert "sampled at" in sweep.stats.note
    prepared = model.prepare((0, 3), inputs={u: wave}, **TIGHT)
    state, p = model.state(START, VALUES, inputs={u: wave}), model.parameter_vector(VALUES)
    assert prepared(state, p)[0] == pytest.approx(want["x"][-1], abs=3e-10)
    found, exact = (
        each.sensitivity((0, 3), START, VALUES, wrt=[k], of=[x], **given).jacobians[-1]
        for each, given in ((model, {"inputs": {u: wave}}), (timed, {}))
    )
    np.testing.assert_allclose(found, exact, atol=1e-6)
    at = model.accelerations([0.0, 0.3], [[1], [1]], [[0], [0]], VALUES, inputs={u: wave})
    np.testing.assert_allclose(at[:, 0], [-2.0, wave(0.3) - 2.0], rtol=1e-15)
    np.testing.assert_allclose(model.linearize(0.3, START, VALUES, inputs={u: wave}).B, [[0], [1]])


def test_spans_of_other_kinds(model: Any, tmp_path: Any) -> None:
    ahead = model.simulate((0, 2), START, VALUES, inputs={u: wave}, rtol=1e-10)
    back = model.simulate((2, 0), dict(zip(START, ahead.y[-1], strict=True)), VALUES, inputs={u: wave}, rtol=1e-10)
    np.testing.assert_allclose(back.y[-1], [1, 0], atol=1e-8)
    later = model.simulate((50, 52), START, VALUES, inputs={u: lambda t: wave(t - 50)}, rtol=1e-10)
    np.testing.assert_allclose(later.y[-1], ahead.y[-1], atol=1e-8)
    assert model.simulate((1, 1), START, VALUES, inputs={u: wave}).success
    estimated = model.simulate((0, 2), START, VALUES, inputs={u: wave}, rtol=1e-7, error_estimate=True)
    assert np.max(estimated.error_estimate["x"]) < 1e-6
    with pytest.warns(PrecisionWarning, match="input 'u' is known to"):
        model.simulate((1.7e9, 1.7e9 + 1), START, VALUES, inputs={u: wave})
    pytest.importorskip("zarr")
    cases = {x: np.array([1.0, 0.5, 1.0]), x.diff(): 0}
    plain = model.sweep((0, 2), cases, VALUES, inputs={u: wave})
    stored = model.sweep((0, 2), cases, VALUES, inputs={u: wave}, to=tmp_path / "s.zarr", chunk=2)
    assert np.array_equal(stored["x"].values, plain["x"])


def follows(function: Any, span: SampledSpan, symbol: InputSymbol = PUSH) -> tuple[float, int]:
    """Return the largest error of samples at random times, as a share of the largest value, and how many they are."""
    record = sampled(symbol, function, span)
    t = np.random.default_rng(1).uniform(span.low, span.high, 20_000)
    knot, *c = record.coefficients(record.pieces(t)).T
    want, h = np.array([function(each) for each in t.tolist()]), t - knot
    error = np.abs(c[0] + h * (c[1] + h * (c[2] + h * c[3])) - want)
    return float(np.max(error) / np.max(np.abs(want))), len(record.t)


def test_samples_are_where_a_function_needs_them() -> None:
    span = SampledSpan(0.0, 10.0, 1e-8)
    functions = {
        "constant": lambda t: 3,
        "kink": lambda t: abs(t - np.pi),
        "a multiple of first knots": lambda t: np.sin(2 * np.pi * 0.8 * 4 * t),
        "pulse": lambda t: np.exp(-(((t - 3.123) / 0.02) ** 2)),
    }
    counts = {}
    for name, function in functions.items():
        share, counts[name] = follows(function, span)
        assert share < 1e-8, name
    assert counts["constant"] == 9 and counts["kink"] < 1000 and counts["pulse"] < 1500
    narrow = SampledSpan(0.0, 10.0, 1e-8, max_step=1e-4)
    assert follows(lambda t: np.exp(-(((t - 3.123) / 2e-4) ** 2)), narrow)[1] > 500


def test_what_is_wrong_with_a_function_is_named(model: Any) -> None:
    noise = np.random.default_rng(0)
    for function, error, message in (
        (
            lambda t: float(t >= 5),
            ValueInputError,
            r"input 'u' is not followed .* at t = (5|4.9999).*jumps there.*'hold'",
        ),
        (lambda t: noise.normal(), ValueInputError, "input 'u' is not followed by samples.*noise, or oscillates"),
        (lambda t: 1 / 0, ValueInputError, "input 'u' raised ZeroDivisionError at t = .*division by zero"),
        (lambda t: None, ValueInputError, "input 'u' returned None at t = .*, which is not a number"),
        (lambda t: "1", ValueInputError, "input 'u' returned '1' at t = .*, which is not a number"),
        (lambda t: np.nan if t > 3 else 1.0, ValueInputError, r"returned nan at t = 3\.\d+, which is not finite"),
        (lambda t: np.ones(2), ValueInputError, r"returned array.* at t = .*it has shape \(2,\)"),
        (lambda t, q, qdot: 1, OptionError, r"called as f\(t\).*da.Controller\(function"),
        (da.feedback(lambda t, q, qdot: 1), OptionError, "traced runs alone take"),
    ):
        with pytest.raises(error, match=message):
            model.simulate((0, 10), START, VALUES, inputs={u: function})
    with pytest.raises(OptionError, match="not sampled here"):
        model.parameter_vector(VALUES, inputs={u: wave})
    for name in ("u", "u[3]"):
        with pytest.raises(OptionError, match="no values to differentiate by"):
            model.sensitivity((0, 1), START, VALUES, inputs={u: wave}, wrt=[name])
