"""Samples as inputs: knots at which steps end, on every backend, by every method, in every kind of run."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from sympy import Piecewise, cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import backend_named
from dalembert.errors import OptionError, UnknownNameError, ValueInputError
from starts.test_input_values import BLOCK, BLOCK_AT_REST, pushed_block

pytestmark = pytest.mark.usefixtures("quick_xla")

x, u, v, theta = dynamicsymbols("x u v theta")
m, k, ell, g = symbols("m k ell g", positive=True)
P = {m: 1.3, k: 2.0}
START = {x: 0.2, x.diff(): 0.1}
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
DRAW = np.random.default_rng(7)
KNOTS = np.linspace(-1.0, 4.0, 14) + np.concatenate([[0.0], 0.1 * DRAW.uniform(-1.0, 1.0, 12), [0.0]])
VALUES = DRAW.normal(size=14)
DAMPING_KNOTS, DAMPING = np.linspace(-1.0, 4.0, 9), DRAW.uniform(0.1, 0.5, 9)
METHODS = [("numpy", method) for method in backend_named("numpy").methods]
METHODS += [("numba", "dop853"), ("jax", "dopri8"), ("jax", "taylor")]  # others take long to compile, and the same way
KINDS = ("hold", "linear", "cubic")

Function = Callable[[float], float]


def pendulum() -> da.Scene:
    """Return a mass on a nonlinear spring with an input force u and an input damping v."""
    N, O = ReferenceFrame("N"), Point("O")
    where = O.locatenew("P", x * N.x)
    scene = da.Scene("sampled", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", where, m))
    scene.add_loads((where, (u - k * sin(x) - v * x.diff()) * N.x))
    scene.add_inputs(u, v)
    return scene


def function_of(knots: Any, values: Any, kind: str, middle: float) -> Function:
    """Return the function of time of samples on the piece around a time."""
    if kind == "cubic":
        return CubicSpline(knots, values)
    if kind == "linear":
        return lambda t: float(np.interp(t, knots, values))
    held = float(values[np.searchsorted(knots, middle) - 1])
    return lambda t: held


def reference(kind: str, t0: float, t1: float, scale: float = 1.0) -> np.ndarray[Any, Any]:
    """Return the final state by SciPy, stopped at every knot."""
    edges = np.unique(np.concatenate([[t0, t1], KNOTS, DAMPING_KNOTS]))
    edges = edges[(edges >= min(t0, t1)) & (edges <= max(t0, t1))]
    y = np.array([0.2, 0.1])
    for a, b in zip(*((edges[:-1], edges[1:]) if t1 > t0 else (edges[:0:-1], edges[-2::-1])), strict=True):
        force = function_of(KNOTS, scale * VALUES, kind, 0.5 * (a + b))
        damping = function_of(DAMPING_KNOTS, DAMPING, "linear", 0.5 * (a + b))

        def rates(t: float, y: Any, force: Function = force, damping: Function = damping) -> list[float]:
            return [y[1], (force(t) - 2.0 * np.sin(y[0]) - damping(t) * y[1]) / 1.3]

        y = solve_ivp(rates, (a, b), y, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return y


def records(kind: str, shift: float = 0.0, scale: Any = 1.0) -> dict[Any, Any]:
    """Return the inputs of the scene; `scale` may have one number a case."""
    values = VALUES * scale if np.ndim(scale) == 0 else np.outer(scale, VALUES)
    return {u: da.samples(KNOTS + shift, values, kind), v: da.samples(DAMPING_KNOTS + shift, DAMPING)}


@pytest.fixture(scope="module")
def models() -> Any:
    """Return the compiled scene by backend."""
    made: dict[str, Any] = {}

    def model(backend: str = "llvm") -> Any:
        if backend not in made:
            made[backend] = da.compile_model(pendulum(), backend=backend)
        return made[backend]

    return model


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("span", [(0.0, 3.5), (3.5, 0.0)], ids=["forward", "backward"])
@pytest.mark.parametrize("method", backend_named("llvm").methods)
def test_every_kind_of_run_against_scipy_stopped_at_knots(models: Any, method: str, span: Any, kind: str) -> None:
    model, wanted = models(), reference(kind, *span)
    run = model.simulate(span, START, P, inputs=records(kind), method=method, **TIGHT)
    np.testing.assert_allclose(run.y[-1], wanted, atol=1e-10)
    times = np.linspace(*span, 6)
    sampled = model.simulate(span, START, P, inputs=records(kind), method=method, t_eval=times, **TIGHT)
    np.testing.assert_allclose(sampled["x"], run(times)["x"], atol=1e-9)
    scales = np.array([0.0, 0.5, 1.0])
    for t_eval in (None, times):
        sweep = model.sweep(span, START, P, inputs=records(kind, scale=scales), method=method, t_eval=t_eval, **TIGHT)
        for i, scale in enumerate(scales):
            found = [sweep.final["x"][i], sweep.final["x_dot"][i]]
            np.testing.assert_allclose(found, reference(kind, *span, scale), atol=1e-10)
    np.testing.assert_allclose(sweep["x"][-1], sampled["x"], atol=1e-10)
    prepared = model.prepare(span, inputs=records(kind), method=method, **TIGHT)
    np.testing.assert_allclose(prepared(np.array([0.2, 0.1]), model.parameter_vector(P)), wanted, atol=1e-10)


@pytest.mark.parametrize(("backend", "method"), METHODS)
def test_every_backend_and_method(models: Any, backend: str, method: str) -> None:
    model, loose = models(backend), method in ("bdf", "lsoda")
    options = {"rtol": 1e-9, "atol": 1e-11} if loose or backend == "jax" else TIGHT
    for kind, span in (("hold", (0.0, 1.5)), ("linear", (1.5, 0.0))):
        wanted = reference(kind, *span)
        run = model.simulate(span, START, P, inputs=records(kind), method=method, **options)
        np.testing.assert_allclose(run.y[-1], wanted, atol=1e-6 if loose else 1e-8 if backend == "jax" else 1e-10)
    sweep = model.sweep(span, START, P, inputs=records(kind, scale=np.array([0.5, 1.0])), method=method, **options)
    np.testing.assert_allclose(sweep.final["x"][-1], run["x"][-1], atol=1e-8)
    prepared = model.prepare(span, inputs=records(kind), method=method, **options)
    np.testing.assert_allclose(prepared(np.array([0.2, 0.1]), model.parameter_vector(P)), run.y[-1], atol=1e-8)


def test_runs_far_from_zero_and_cases_with_their_own_spans(models: Any) -> None:
    model = models()
    wanted = reference("linear", 0.0, 3.0)
    run = model.simulate((1e5, 1e5 + 3.0), START, P, inputs=records("linear", 1e5), **TIGHT)
    np.testing.assert_allclose(run.y[-1], wanted, atol=1e-9)
    starts = np.array([0.0, 0.7, 1.2])
    sweep = model.sweep((starts, starts + 1.5), START, P, inputs=records("hold"), **TIGHT)
    for i, t0 in enumerate(starts):
        np.testing.assert_allclose(sweep.final["x"][i], reference("hold", t0, t0 + 1.5)[0], atol=1e-10)


def test_values_of_inputs_along_a_run(models: Any) -> None:
    model = models()
    times = np.array([0.0, *KNOTS[3:9], 3.5])
    run = model.simulate((0.0, 3.5), START, P, inputs=records("hold"), t_eval=times)
    np.testing.assert_allclose(run["u"][1:-1], VALUES[3:9], rtol=1e-14)
    cubic = model.simulate((0.0, 3.5), START, P, inputs=records("cubic"), t_eval=np.linspace(0.0, 3.5, 50))
    np.testing.assert_allclose(cubic["u"], CubicSpline(KNOTS, VALUES)(cubic.t), atol=1e-12)
    sweep = model.sweep((0.0, 3.5), START, P, inputs=records("linear", scale=np.array([1.0, 2.0])), t_eval=times)
    np.testing.assert_allclose(sweep["u"][1], 2.0 * np.interp(times, KNOTS, VALUES), atol=1e-12)
    np.testing.assert_allclose(sweep.final["u"], np.interp(3.5, KNOTS, VALUES) * np.array([1.0, 2.0]), atol=1e-12)
    found = model.forcing(np.array([0.3, 1.7]), np.zeros((2, 1)), np.zeros((2, 1)), P, inputs=records("linear"))
    np.testing.assert_allclose(found[:, 0], np.interp([0.3, 1.7], KNOTS, VALUES), atol=1e-14)


def test_a_held_force_gives_a_parabola_on_each_piece() -> None:
    N, O = ReferenceFrame("N"), Point("O")
    where = O.locatenew("P", x * N.x)
    scene = da.Scene("free", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", where, m))
    scene.add_loads((where, u * N.x))
    scene.add_inputs(u)
    model, count = da.compile_model(scene), 400
    knots, values = np.arange(count + 1) * 0.01, np.random.default_rng(1).normal(size=count + 1)
    inputs = {u: da.samples(knots, values, "hold", extrapolate="hold")}
    run = model.simulate((0.0, 5.0), {x: 0.0, x.diff(): 0.0}, {m: 1.0}, inputs=inputs, t_eval=knots, rtol=1e-12)
    rates = np.concatenate([[0.0], np.cumsum(values[:-1] * 0.01)])
    places = np.concatenate([[0.0], np.cumsum(rates[:-1] * 0.01 + 0.5 * values[:-1] * 0.01**2)])
    np.testing.assert_allclose(run["x"], places, atol=1e-13)
    np.testing.assert_allclose(run["x_dot"], rates, atol=1e-13)
    later = model.simulate((0.0, 5.0), {x: 0.0, x.diff(): 0.0}, {m: 1.0}, inputs=inputs, rtol=1e-12)
    assert later["x_dot"][-1] == pytest.approx(rates[-1] + values[-1] * 1.0, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_extrapolation(models: Any, kind: str) -> None:
    model, t = models(), np.array([0.0, 0.4, 0.9, 1.5])
    values = np.array([1.0, -0.5, 0.3, 0.7])
    spline = CubicSpline(t, values)
    for mode in ("hold", "linear"):
        inputs = {u: da.samples(t, values, kind, extrapolate=mode), v: 0.1}
        run = model.simulate((-1.0, 3.0), START, P, inputs=inputs, t_eval=np.array([-1.0, 2.5, 3.0]))
        slopes = {"hold": (0.0, 0.0), "linear": (-1.5 / 0.4, 0.4 / 0.6), "cubic": (spline(0.0, 1), spline(1.5, 1))}
        first, last = slopes[kind] if mode == "linear" else (0.0, 0.0)
        np.testing.assert_allclose(run["u"], [1.0 - first, 0.7 + last * 1.0, 0.7 + last * 1.5], rtol=1e-12)
    with pytest.raises(ValueInputError, match=r"'u' are too short.*from t = 0 to 1.5.*from t = 0 to 2"):
        model.simulate((0.0, 2.0), START, P, inputs={u: da.samples(t, values, kind), v: 0.1})


def driven() -> da.Scene:
    """Return a pendulum whose support moves along the input u."""
    N, O = ReferenceFrame("N"), Point("O")
    support = O.locatenew("A", u * N.x)
    bob = support.locatenew("P", ell * sin(theta) * N.x - ell * cos(theta) * N.y)
    scene = da.Scene("driven", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("p", bob, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_inputs(u)
    return scene


def closed() -> da.Scene:
    """Return the same with the support as coordinates that constraints hold."""
    y = dynamicsymbols("y")
    N, O = ReferenceFrame("N"), Point("O")
    bob = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("closed", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("p", bob, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints((x - u) ** 2 + y**2 - ell**2)
    scene.add_inputs(u)
    return scene


def test_a_position_and_a_holonomic_constraint_follow_a_spline() -> None:
    t, values = np.linspace(0.0, 2.0, 6), np.array([0.0, 0.2, -0.1, 0.15, 0.3, 0.1])
    spline, p = CubicSpline(t, values), {m: 1.0, ell: 0.7, g: 9.8}

    def rates(time: float, y: Any) -> list[float]:
        return [y[1], -(9.8 * np.sin(y[0]) + float(spline(time, 2)) * np.cos(y[0])) / 0.7]

    state = np.array([0.3, 0.0])
    for a, b in itertools.pairwise(t):
        state = solve_ivp(rates, (a, b), state, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    inputs = {u: da.samples(t, values, "cubic")}
    first = da.compile_model(driven())
    run = first.simulate((0.0, 2.0), {theta: 0.3, theta.diff(): 0.0}, p, inputs=inputs, **TIGHT)
    assert run["theta"][-1] == pytest.approx(state[0], abs=1e-10)
    y = dynamicsymbols("y")
    for formulation in ("projected", "ggl"):
        model = da.compile_model(closed(), formulation=formulation)
        start = {x: 0.7 * np.sin(0.3), y: -0.7 * np.cos(0.3), x.diff(): float(spline(0.0, 1)), y.diff(): 0.0}
        method = "radau" if formulation == "ggl" else "auto"
        options = {"rtol": 1e-8, "atol": 1e-10} if formulation == "ggl" else TIGHT
        run = model.simulate((0.0, 2.0), start, p, inputs=inputs, method=method, t_eval=[1.1, 2.0], **options)
        tolerance = 1e-6 if formulation == "ggl" else 1e-9
        assert run["x"][-1] == pytest.approx(spline(2.0) + 0.7 * np.sin(state[0]), abs=tolerance)
        assert np.max(np.abs(run.constraint_violation)) < 1e-8
        sweep = model.sweep(
            (0.0, 2.0),
            start,
            p,
            inputs={u: da.samples(t, np.array([values, values]), "cubic")},
            method=method,
            t_eval=[1.1, 2.0],
            **options,
        )
        np.testing.assert_allclose(sweep["x"][1], run["x"], atol=tolerance)


@pytest.mark.parametrize("angle", [u, u.diff()])
def test_an_orientation_follows_a_spline(angle: Any) -> None:
    """In a frame turned by an input, a pendulum swings as in the fixed one."""
    N, O, A, B = ReferenceFrame("N"), Point("O"), ReferenceFrame("A"), ReferenceFrame("B")
    A.orient_axis(N, angle, N.z)
    B.orient_axis(A, theta, A.z)
    bob = O.locatenew("P", -ell * B.y)
    scene = da.Scene("turned", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("p", bob, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_inputs(u)
    model, knots = da.compile_model(scene), np.linspace(0.0, 2.0, 6)
    spline, p = CubicSpline(knots, [0.0, 0.2, -0.1, 0.15, 0.3, 0.1]), {m: 1.0, ell: 0.7, g: 9.8}
    order = 0 if angle is u else 1
    first = {theta: 0.3 - spline(0.0, order), theta.diff(): -spline(0.0, order + 1)}
    swing = solve_ivp(lambda t, y: [y[1], -14.0 * np.sin(y[0])], (0, 2), [0.3, 0.0], "DOP853", rtol=1e-12, atol=1e-14)
    run = model.simulate((0, 2), first, p, inputs={u: da.samples(knots, spline(knots), "cubic")}, **TIGHT)
    assert run["theta"][-1] + spline(2.0, order) == pytest.approx(swing.y[0, -1], abs=1e-10)
    with pytest.raises(ValueInputError, match=r"orientation of frame 'A'.*kind='cubic'"):
        model.simulate((0, 2), first, p, inputs={u: da.samples(knots, spline(knots), "linear")})


@pytest.mark.parametrize("kind", ["hold", "linear"])
def test_a_position_refuses_samples_that_are_not_smooth(kind: str) -> None:
    record = da.samples([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], kind, extrapolate="hold")
    p = {m: 1.0, ell: 0.7, g: 9.8}
    with pytest.raises(ValueInputError, match=r"position of point 'A'.*kind='cubic'"):
        da.compile_model(driven()).simulate((0, 1), {theta: 0.3, theta.diff(): 0.0}, p, inputs={u: record})
    with pytest.raises(ValueInputError, match=r"holonomic constraint 1.*kind='cubic'"):
        da.compile_model(closed(), formulation="projected").simulate((0, 1), {}, p, inputs={u: record})
    cubic = da.samples([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], "cubic", extrapolate="hold")
    with pytest.raises(ValueInputError, match=r"beyond their knots.*rate jumps"):
        da.compile_model(driven()).simulate((0, 3), {theta: 0.3, theta.diff(): 0.0}, p, inputs={u: cubic})


def test_events_see_inputs_that_jump_and_those_they_do_not_depend_on(models: Any) -> None:
    model = models()
    inputs = records("hold")
    for events, wanted in (([da.Event(x, name="zero")], None), ([da.Event(u - 0.1, name="jump")], "jumps")):
        run = model.simulate((0.0, 3.5), START, P, inputs=inputs, events=events, **TIGHT)
        dense = model.simulate((0.0, 3.5), START, P, inputs=inputs, **TIGHT)
        found = run.events[events[0].name].t
        if wanted is None:
            fine = np.linspace(0.0, 3.5, 20_001)
            signs = np.sign(dense(fine)["x"])
            assert len(found) == np.sum(signs[1:] != signs[:-1])
            np.testing.assert_allclose(dense(found)["x"], 0.0, atol=1e-10)
        else:
            inside = (KNOTS > 0.0) & (KNOTS < 3.5)
            before, after = VALUES[np.flatnonzero(inside) - 1] - 0.1, VALUES[inside] - 0.1
            np.testing.assert_allclose(found, KNOTS[inside][before * after < 0.0], atol=1e-12)
        sweep = model.sweep((0.0, 3.5), START, P, inputs=records("hold", scale=np.ones(2)), events=events, **TIGHT)
        np.testing.assert_array_equal(sweep.events[events[0].name].count, len(found))
    sweep = model.sweep(
        (0.0, 3.5), START, P, inputs=records("linear", scale=np.ones(2)), reduce={"top": da.maximum(u)}, **TIGHT
    )
    inside = np.concatenate([VALUES[(KNOTS > 0.0) & (KNOTS < 3.5)], np.interp([0.0, 3.5], KNOTS, VALUES)])
    np.testing.assert_allclose(sweep.reduced["top"], np.max(inside), rtol=1e-12)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_knots_and_conditions_on_time_together(backend: str) -> None:
    t = dynamicsymbols._t
    N, O = ReferenceFrame("N"), Point("O")
    where = O.locatenew("P", x * N.x)
    scene = da.Scene("both", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", where, m))
    push = Piecewise((1, t < 0.73), (-1, t < 2.01), (0.5, True))
    scene.add_loads((where, (u + push - k * x) * N.x))
    scene.add_inputs(u)
    model = da.compile_model(scene, backend=backend)
    edges = np.unique(np.concatenate([[0.0, 3.0, 0.73, 2.01], KNOTS[(KNOTS > 0.0) & (KNOTS < 3.0)]]))
    y = np.array([0.2, 0.1])
    for a, b in itertools.pairwise(edges):
        middle = 0.5 * (a + b)
        force = function_of(KNOTS, VALUES, "hold", middle)(middle) + (
            1 if middle < 0.73 else -1 if middle < 2.01 else 0.5
        )
        y = solve_ivp(
            lambda t, y, f=force: [y[1], (f - 2.0 * y[0]) / 1.3], (a, b), y, method="DOP853", rtol=1e-12, atol=1e-14
        ).y[:, -1]
    inputs = {u: da.samples(KNOTS, VALUES, "hold")}
    run = model.simulate((0.0, 3.0), START, P, inputs=inputs, **TIGHT)
    np.testing.assert_allclose(run.y[-1], y, atol=1e-10)
    many = {u: da.samples(KNOTS, np.array([VALUES, VALUES]), "hold")}
    sweep = model.sweep((0.0, 3.0), START, P, inputs=many, t_eval=[1.0, 3.0], **TIGHT)
    np.testing.assert_allclose(sweep["x"][1], run(np.array([1.0, 3.0]))["x"], atol=1e-9)
    prepared = model.prepare((0.0, 3.0), inputs=inputs, **TIGHT)
    np.testing.assert_allclose(prepared(np.array([0.2, 0.1]), model.parameter_vector(P)), y, atol=1e-10)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_sensitivities_through_knots(models: Any, backend: str) -> None:
    model, h = models(backend), 1e-5
    found = model.sensitivity((0.0, 2.0), START, P, inputs=records("hold"), wrt=[k, x], **TIGHT)
    assert found.jacobian("x", "k")[-1] == pytest.approx(
        (end(model, {**P, k: 2.0 + h}) - end(model, {**P, k: 2.0 - h})) / (2.0 * h), rel=1e-6
    )
    assert found.jacobian("x", "x")[-1] == pytest.approx(
        (end(model, P, {**START, x: 0.2 + h}) - end(model, P, {**START, x: 0.2 - h})) / (2.0 * h), rel=1e-6
    )


def end(model: Any, p: Any, start: Any = START) -> float:
    """Return x at the end of a run."""
    return float(model.simulate((0.0, 2.0), start, p, inputs=records("hold"), **TIGHT)["x"][-1])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (([0.0, 2.0, 1.0], [1.0, 2.0, 3.0]), r"t must increase.*t\[1\] = 2 is followed by 1"),
        (([0.0, 1.0, 1.0], [1.0, 2.0, 3.0]), "t must increase"),
        (([0.0, np.nan], [1.0, 2.0]), r"t\[1\] is not"),
        (([0.0, 1.0], [[1.0, 2.0], [np.inf, 1.0]]), r"values\[1, 0\] is not"),
        (([0.0, 1.0], [1.0, 2.0, 3.0]), r"values must have shape \(2,\)"),
        (([[0.0, 1.0]], [1.0, 2.0]), "t must have shape"),
        (([], []), "t must have shape"),
        (([0.0], [1.0]), "one knot gives no values"),
        (([-1e308, 1e308], [1.0, 3.0]), "inf apart.*at most 1e.100 apart"),
        (([0.0, 1e-310, 1.0], [0.0, 1.0, 1.0]), "range of floating-point numbers"),
        (([0.0, 1.0], [-1e308, 1e308]), "range of floating-point numbers"),
        (([0.0, 1e-120, 1.0], [0.0, 1.0, 1.0], "cubic"), "least distance cubed"),
        ((["a", "b"], [1.0, 2.0]), "t is not an array of numbers"),
    ],
)
def test_wrong_samples_are_named(arguments: Any, text: str) -> None:
    with pytest.raises(ValueInputError, match=text):
        da.samples(*arguments)


def test_wrong_options_and_counts_are_named(models: Any) -> None:
    model = models()
    with pytest.raises(OptionError, match=r"unknown kind 'spline'.*hold, linear, cubic"):
        da.samples([0.0, 1.0], [1.0, 2.0], "spline")
    with pytest.raises(OptionError, match="unknown extrapolate 'zero'"):
        da.samples([0.0, 1.0], [1.0, 2.0], extrapolate="zero")
    with pytest.raises(ValueInputError, match="values for 3 cases and this is one run"):
        model.simulate((0, 1), START, P, inputs=records("linear", scale=np.ones(3)))
    with pytest.raises(ValueInputError, match="input u: 3"):
        model.sweep((0, 1), {**START, x: np.zeros(4)}, P, inputs=records("linear", scale=np.ones(3)))
    with pytest.raises(ValueInputError, match="values for 3 cases, and t_span has 2"):
        model.sweep((np.zeros(2), 1.0), START, P, inputs=records("linear", scale=np.ones(3)))
    with pytest.raises(ValueInputError, match="parameter_vector takes numbers"):
        model.parameter_vector(P, inputs=records("linear"))
    with pytest.raises(UnknownNameError, match="missing inputs: v"):
        model.simulate((0, 1), START, P, inputs={u: 1.0})


def sliding(values: np.ndarray[Any, Any], knots: np.ndarray[Any, Any]) -> float:
    """Return how far a block of mass 2 slides that a force held from knot to knot pushes against a friction of 5."""
    place = rate = 0.0
    for force, left in zip(values[:-1], np.diff(knots), strict=True):
        while left > 0.0 and (rate != 0.0 or abs(force) > 5.0):
            acceleration = 0.5 * (force - 5.0 * np.sign(rate or force))
            stops = -rate / acceleration if acceleration * rate < 0.0 else np.inf
            time = min(stops, left)
            place += rate * time + 0.5 * acceleration * time**2
            rate, left = 0.0 if stops <= left else rate + acceleration * time, left - time
    return place


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_contacts_under_samples_that_let_them_stick_and_slip(backend: str) -> None:
    model, start, p = da.compile_model(pushed_block(), backend=backend), BLOCK_AT_REST, BLOCK
    knots, values = np.linspace(0.0, 5.0, 21), 9.0 * np.random.default_rng(3).normal(size=21)
    wanted = sliding(values, knots)
    run = model.simulate((0.0, 5.0), start, p, inputs={u: da.samples(knots, values, "hold")}, **TIGHT)
    assert run["x"][-1] == pytest.approx(wanted, abs=1e-10)
    assert {phase.modes["floor"] for phase in run.phases} == {"stick", "slip"}
    scales = np.array([0.4, 0.7, 1.0])
    inputs = {u: da.samples(knots + 50.0, np.outer(scales, values), "hold")}
    sweep = model.sweep((50.0, 55.0), start, p, inputs=inputs, t_eval=[52.0, 55.0], **TIGHT)
    np.testing.assert_allclose(sweep.final["x"], [sliding(s * values, knots) for s in scales], atol=1e-10)
    np.testing.assert_allclose(sweep["u"][:, 0], scales * values[8], rtol=1e-12)
    prepared = model.prepare((0.0, 5.0), inputs={u: da.samples(knots, values, "hold")}, **TIGHT)
    final = prepared(model.state(start, p, inputs={u: 0.0}), model.parameter_vector(p))
    assert final[0] == pytest.approx(wanted, abs=1e-10)


def test_a_belt_whose_speed_jumps_is_refused() -> None:
    N, O = ReferenceFrame("N"), Point("O")
    F, normal = da.unknowns("F normal")
    y = dynamicsymbols("y")
    where = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("belt", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", where, m))
    scene.add_joints(da.Joint("belt", body="block", at=where, force=F * N.x + normal * N.y))
    scene.add_holonomic_constraints(y)
    scene.add_loads((where, -k * x * N.x - g * m * N.y))
    scene.add_friction(da.CoulombFriction(normal, F, slip=x.diff() - u, mu=0.3, name="belt"))
    scene.add_inputs(u)
    model, p = da.compile_model(scene), {m: 1.0, k: 5.0, g: 9.8}
    start = {x: 0.0, x.diff(): 0.0, y: 0.0, y.diff(): 0.0}
    with pytest.raises(ValueInputError, match=r"slip velocity of 'belt'.*kind='linear' or 'cubic'"):
        model.simulate((0, 1), start, p, inputs={u: da.samples([0.0, 1.0], [0.0, 1.0], "hold", "hold")})
    run = model.simulate((0, 1), start, p, inputs={u: da.samples([0.0, 1.0], [0.0, 0.2])}, **TIGHT)
    assert run["x"][-1] == pytest.approx(0.1, abs=1e-10)  # it sticks, and moves with the belt


def test_comparisons_and_estimates_of_errors(models: Any) -> None:
    run = models().simulate((0.0, 2.0), START, P, inputs=records("hold"), error_estimate=True)
    assert np.max(run.error_estimate["x"]) < 1e-7
    table = models().compare_formulations((0.0, 2.0), START, P, inputs=records("linear"))
    assert sum(row.status == "SUCCESS" for row in table.rows) >= 3
    assert "inputs        u, v" in models().explain()


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_a_sampled_controller_sees_what_follows_a_knot(backend: str) -> None:
    N, O = ReferenceFrame("N"), Point("O")
    where, (period, gain) = O.locatenew("P", x * N.x), symbols("period gain")
    scene = da.Scene("sampled controller", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", where, m))
    scene.add_loads((where, (u + v - k * x) * N.x))
    scene.add_inputs(u, v)
    scene.add_controllers(da.Controller("law", period=period, inputs={u: -gain * x - 0.3 * v}))
    model, knots = da.compile_model(scene, backend=backend), np.arange(21) * 0.1
    values, y = np.random.default_rng(5).normal(size=21), np.array([0.2, 0.1])
    for i in range(20):  # with a constant force the motion is a cosine about x = force / k
        force, rate = -1.5 * y[0] + 0.7 * values[i], np.sqrt(2.0 / 1.3)
        c, s, off = np.cos(0.1 * rate), np.sin(0.1 * rate), y[0] - force / 2.0
        y = np.array([force / 2.0 + off * c + y[1] / rate * s, y[1] * c - off * rate * s])
    p, inputs = {**P, period: 0.1, gain: 1.5}, {v: da.samples(knots, values, "hold")}
    run = model.simulate((0.0, 2.0), START, p, inputs=inputs, **TIGHT)
    np.testing.assert_allclose([run["x"][-1], run["x_dot"][-1]], y, atol=1e-11)
    sweep = model.sweep((0.0, 2.0), {**START, x: np.array([0.2, 0.2])}, p, inputs=inputs, **TIGHT)
    np.testing.assert_allclose(sweep.final["x"], y[0], atol=1e-11)


def test_many_knots_cost_no_table_of_constants(models: Any) -> None:
    model, count = models(), 100_001
    t = np.linspace(0.0, 100.0, count)
    inputs = {u: da.samples(t, np.sin(t), "linear"), v: 1.5}
    run = model.simulate((0.0, 100.0), START, P, inputs=inputs, t_eval=[100.0], dense=False, rtol=1e-10)
    smooth = solve_ivp(
        lambda t, y: [y[1], (np.sin(t) - 2.0 * np.sin(y[0]) - 1.5 * y[1]) / 1.3],
        (0.0, 100.0),
        [0.2, 0.1],
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
    )
    assert run["x"][-1] == pytest.approx(smooth.y[0, -1], abs=1e-6)
    assert run.stats.steps == count - 1


def test_reductions_see_the_inputs_of_the_end(models: Any) -> None:
    sweep = models().sweep((0.0, 3.5), START, P, inputs=records("linear", scale=np.ones(2)), reduce=["u", "x"], **TIGHT)
    np.testing.assert_allclose(sweep.reduced["u"], np.interp(3.5, KNOTS, VALUES), rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
@pytest.mark.parametrize("span", [(-0.8, 3.9), (3.9, -0.8)], ids=["forward", "backward"])
def test_events_and_reductions_in_lanes_between_knots(models: Any, method: str, kind: str, span: Any) -> None:
    """Each case in lanes, from knot to knot, against the same case alone, knot by knot, by another loop."""
    model = models("llvm")
    scales = np.array([0.5, 1.0, 1.7])
    options = {"method": method, **TIGHT}
    bounce = da.Event(x + 0.35, apply={x.diff(): -0.9 * x.diff()}, name="bounce")
    kept = {"most": da.maximum(x), "least": da.minimum(x.diff()), "mean": da.mean(x**2), "when": da.first_crossing(x)}
    records = {u: da.samples(KNOTS, np.outer(scales, VALUES), kind), v: da.samples(DAMPING_KNOTS, DAMPING, kind)}
    sweep = model.sweep(span, START, P, inputs=records, events=[bounce, x.diff()], reduce=kept, **options)
    assert sweep.success.all()
    for i, scale in enumerate(scales):
        own = {u: da.samples(KNOTS, scale * VALUES, kind), v: da.samples(DAMPING_KNOTS, DAMPING, kind)}
        alone = model.simulate(span, START, P, inputs=own, events=[bounce, x.diff()], **options)
        for name in ("bounce", "x_dot"):
            times = alone.events[name].t
            assert len(times) == sweep.events[name].count[i]
            np.testing.assert_allclose(times[:1], sweep.events[name].first[i : i + 1][: len(times)], atol=1e-9)
            np.testing.assert_allclose(times[-1:], sweep.events[name].last[i : i + 1][: len(times)], atol=1e-9)
        np.testing.assert_allclose(sweep.final["x"][i], alone["x"][-1], atol=1e-9)
        turns = [alone["x"][0], alone["x"][-1], *alone.events["x_dot"]["x"], *alone.events["bounce"]["x"]]
        np.testing.assert_allclose(sweep.reduced["most"][i], max(turns), atol=1e-9)
        fine = alone(np.linspace(*span, 40001))
        np.testing.assert_allclose(sweep.reduced["mean"][i], np.mean(fine["x"] ** 2), atol=1e-4)
        np.testing.assert_allclose(sweep.reduced["least"][i], fine["x_dot"].min(), atol=2e-3)


def test_watched_sweeps_under_samples_do_not_go_case_by_case(models: Any, monkeypatch: Any) -> None:
    from dalembert.codegen.engine import Engine

    def refuse(*arguments: Any) -> None:
        raise AssertionError("case by case")

    model, records = models("llvm"), {u: da.samples(KNOTS, VALUES), v: 0.2}
    monkeypatch.setattr(Engine, "integrate_block", refuse)
    many = {m: np.linspace(1, 2, 5), k: 2.0}
    for watched in (x, x * u):
        assert model.sweep((0, 3), START, many, inputs=records, reduce={"top": da.maximum(watched)}).success.all()
