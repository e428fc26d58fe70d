"""Absolute tolerances by name: components of very different sizes against closed forms, by every method and backend."""

import pickle
import warnings
from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError, PrecisionWarning, UnknownNameError
from dalembert.options import NamedTolerances, SweepOptions, component_tolerances, tighter

pytestmark = pytest.mark.usefixtures("quick_xla")

T, SMALL, LARGE, RTOL = 10.0, 1e-9, 1e3, 1e-9
X, Y = dynamicsymbols("x y")
START, P = {"x": SMALL, "x_dot": 0, "y": LARGE, "y_dot": 0}, {"k": 25.0}
ATOL = {X: 1e-19, "x_dot": 1e-18, Y: 1e-7, Y.diff(): 1e-7}
RIGHT = {"bdf": 1e-6, "kvaerno5": 2e-8, "lsoda": 3e-8, "rk45": 3e-8}
"""Relative error of the small component at rtol = 1e-9 where it is more than 1e-8."""
METHODS = [
    *((backend, method) for backend in ("llvm", "numba") for method in ("taylor", "dop853", "tsit5", "radau")),
    *(("numpy", method) for method in ("dop853", "rk45", "radau", "bdf", "lsoda")),
    *(("jax", method) for method in ("dopri8", "tsit5", "taylor", "kvaerno5")),
]


def two_oscillators(contact=False):
    """Return oscillators of 1e-9 m and of 1000 m: cos(5 t) and cos(t); in place of the second a ball that bounces."""
    frame, origin, k = ReferenceFrame("N"), Point("O"), sp.symbols("k")
    first, second = origin.locatenew("A", X * frame.x), origin.locatenew("B", Y * frame.y)
    scene = da.Scene("two", frame, origin, [X, Y])
    scene.add_bodies(Particle("a", first, 1), Particle("b", second, 1))
    scene.add_loads((first, -k * X * frame.x), (second, (-10 if contact else -Y) * frame.y))
    if contact:
        floor = da.PointPlane("floor", body="b", point=second, plane=(origin, frame.y), restitution=0.5)
        scene.add_contacts(floor)
    return scene


@cache
def model_on(backend, contact=False):
    """Return the compiled oscillators."""
    return da.compile_model(two_oscillators(contact), backend=backend)


@pytest.mark.parametrize(("backend", "method"), METHODS)
def test_components_of_very_different_sizes(backend, method):
    """Runs, events, cases and prepared runs: 1e-9 m are off by 44 % with taylor at any one number, and SUCCESS."""
    model, exact = model_on(backend), SMALL * np.cos(5 * T)
    given = (0, T), START, P
    options = {"method": method, "rtol": RTOL}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loose = model.simulate(*given, **options)
        run = model.simulate(*given, **options, atol=ATOL)
        watched = model.simulate(*given, **options, atol=ATOL, events=["x"])
        swept = model.sweep((0, T), START, {"k": [25.0, 100.0]}, **options, atol=ATOL)
        prepared = model.prepare((0, T), **options, atol=ATOL)
    error = abs(loose["x"][-1] - exact) / SMALL
    assert loose.success
    assert error > 3e-8
    assert method != "taylor" or error > 0.4
    end = prepared(model.state(START, P), model.parameter_vector(P))
    allowed = RIGHT.get(method, 1e-8)
    for x, y in ((run["x"][-1], run["y"][-1]), (watched["x"][-1], watched["y"][-1]), (swept["x"][0], swept["y"][0])):
        assert abs(x - exact) < allowed * SMALL
        assert abs(y - LARGE * np.cos(T)) < allowed * LARGE
    assert abs(end[0] - exact) < allowed * SMALL
    assert swept["x"][1] == pytest.approx(SMALL * np.cos(10 * T), rel=0, abs=3 * allowed * SMALL)
    zeros = np.pi * (np.arange(16) + 0.5) / 5
    np.testing.assert_allclose(watched.events["x"].t, zeros, rtol=0, atol=allowed)


def test_one_number_for_all_is_the_same_number_for_each():
    """Explicit and implicit steps at equal tolerances by name are those of the number, to the bit."""
    model, every = model_on("llvm"), dict.fromkeys(("x", "x_dot", "y", "y_dot"), 1e-12)
    for method in ("taylor", "dop853", "tsit5", "radau"):
        one = model.simulate((0, T), START, P, method=method, atol=1e-12)
        named = model.simulate((0, T), START, P, method=method, atol=every)
        np.testing.assert_array_equal(one.y, named.y)
        cases = [model.sweep((0, T), START, {"k": [25, 9.0]}, method=method, atol=a).y for a in (1e-12, every)]
        np.testing.assert_array_equal(*cases)


def test_less_work_than_the_smallest_number():
    """A large component whose digits nobody needs takes fewer steps than at the tolerance of the small one."""
    model, start = model_on("llvm"), {"x": 1e-3, "x_dot": 0, "y": 1e-3, "y_dot": 0}
    for method in ("taylor", "dop853", "radau"):
        fine = model.simulate((0, T), start, {"k": 2500.0}, method=method, rtol=1e-10, atol=1e-13)
        mixed = {"x": 1e-5, "x_dot": 1e-3, "y": 1e-13, "y_dot": 1e-13}
        run = model.simulate((0, T), start, {"k": 2500.0}, method=method, rtol=1e-10, atol=mixed)
        assert run.stats.steps < 0.7 * fine.stats.steps
        assert abs(run["y"][-1] - 1e-3 * np.cos(T)) < 1e-11


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_derivatives(method):
    """The derivative of cos(sqrt(k) t) by k; each has the tolerance of its component."""
    exact = -T / 10 * np.sin(5 * T)
    for atol in (ATOL, "auto"):
        found = model_on("llvm").sensitivity((0, T), START, P, wrt=["k"], method=method, rtol=RTOL, atol=atol)
        assert found.jacobian("x", "k")[-1] / SMALL == pytest.approx(exact, abs=1e-7)
    pilot = NamedTolerances({"x": 1e-19}).with_derivatives(("x", "v", "d x d k", "d v d k"), 2)
    np.testing.assert_array_equal(pilot.of(("x", "v", "d x d k", "d v d k")), [1e-19, 1e-10, 1e-19, 1e-10])


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_auto_takes_the_sizes_of_components(method):
    """Single runs and cases whose components have sizes of their own."""
    model, sizes = model_on("llvm"), np.array([SMALL, 1e-3, 1.0, 1e-12])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = model.simulate((0, T), START, P, method=method, rtol=RTOL, atol="auto")
        start = {**START, "x": sizes, "y": [LARGE, LARGE, 1.0, 1.0]}
        cases = model.sweep((0, T), start, P, method=method, rtol=RTOL, atol="auto", t_eval=[5, T])
        even = model.simulate((0, T), {**START, "x": 1.0, "y": 2.0}, P, method=method, rtol=RTOL, atol="auto")
    assert abs(run["x"][-1] / SMALL - np.cos(5 * T)) < 1e-8
    assert run.stats.atol.by_name["x"] == pytest.approx(1e-20)
    assert "x: 1e-20" in run.stats.note
    assert 'by "auto", for components of different sizes' in run.stats.note
    np.testing.assert_allclose(cases["x"][:, 1] / sizes, np.cos(5 * T), rtol=0, atol=1e-8)
    assert "x: 1e-23" in cases.stats.note
    assert even.stats.atol == 1e-10
    assert not even.stats.note


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize("atol", [{"x": 1e-19, "x_dot": 1e-18, "y": 1e-8, "y_dot": 1e-8}, "auto"])
def test_contacts(backend, atol):
    """A ball falls from a kilometre beside an oscillation of a nanometre; modes take the names of their states."""
    model, exact = model_on(backend, contact=True), SMALL * np.cos(100)
    run = model.simulate((0, 20), START, P, method="dop853", rtol=RTOL, atol=atol)
    cases = model.sweep((0, 20), {**START, "y": [LARGE, 900.0]}, P, method="dop853", rtol=RTOL, atol=atol)
    loose = model.simulate((0, 20), START, P, method="dop853", rtol=RTOL)
    fall = np.sqrt(200.0)
    height = 50 * (20 - fall) * np.sqrt(2) - 5 * (20 - fall) ** 2
    assert abs(loose["x"][-1] - exact) > 1e-2 * SMALL
    for x, y in ((run["x"][-1], run["y"][-1]), (cases["x"][0], cases["y"][0])):
        assert abs(x - exact) < 1e-7 * SMALL
        assert y == pytest.approx(height, rel=1e-9)
    if atol != "auto":
        prepared = model.prepare((0, 20), method="dop853", rtol=RTOL, atol=atol)
        end = prepared(model.state(START, P), model.parameter_vector(P))
        assert abs(end[0] - exact) < 1e-7 * SMALL


def test_jumps_and_tables_and_stops():
    """Steps that end at kinks, at knots of tables and at samples of an input measure errors by the same weights."""
    frame, origin, k, u = ReferenceFrame("N"), Point("O"), sp.symbols("k"), dynamicsymbols("u")
    first, second = origin.locatenew("A", X * frame.x), origin.locatenew("B", Y * frame.y)
    scene = da.Scene("kinked", frame, origin, [X, Y])
    scene.add_bodies(Particle("a", first, 1), Particle("b", second, 1))
    scene.add_inputs(u)
    curve = da.table(Y, [-2000, -500, 0, 700, 2000], [2000.0, 500, 0, -700, -2000], kind="linear")
    scene.add_loads((first, -k * X * frame.x), (second, (curve + u) * frame.y))
    kinked = da.compile_model(scene)
    held = da.samples([0, 3, T], [0.0, 0.0, 0.0], kind="hold")
    for method in ("taylor", "dop853", "radau"):
        options = {"method": method, "rtol": RTOL, "atol": ATOL}
        run = kinked.simulate((0, T), START, P, inputs={u: held}, **options)
        swept = kinked.sweep((0, T), START, {"k": [25.0, 25.0]}, inputs={u: held}, **options)
        for x, y in ((run["x"][-1], run["y"][-1]), (swept["x"][1], swept["y"][1])):
            assert abs(x / SMALL - np.cos(5 * T)) < 1e-8
            assert abs(y / LARGE - np.cos(T)) < 1e-8


@pytest.mark.matrix
def test_pure_functions_of_jax():
    """`solve_fn` takes tolerances by name, and its runs have derivatives."""
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        for method in ("dopri8", "taylor"):
            solve = model_on("jax").solve_fn(list(START), method=method, rtol=RTOL, atol=ATOL)

            def end(k, solve=solve):
                return solve(np.array([0, T]), START, {"k": k}).q[-1, 0]

            assert float(end(25.0)) / SMALL == pytest.approx(np.cos(5 * T), abs=1e-8)
            assert float(jax.grad(end)(25.0)) / SMALL == pytest.approx(-T / 10 * np.sin(5 * T), abs=1e-6)


def test_results_tell_the_tolerances(tmp_path):
    """Statistics, attributes, the note of errors, comparisons and copies in other processes."""
    model = model_on("llvm")
    run = model.simulate((0, T), START, P, rtol=RTOL, atol=ATOL, error_estimate=True)
    assert run.stats.atol.by_name == {"x": 1e-19, "x_dot": 1e-18, "y": 1e-7, "y_dot": 1e-7}
    assert run.stats.atol == pickle.loads(pickle.dumps(run.stats.atol))
    assert run.error_estimate["x"].max() < 1e-8 * SMALL
    assert "x: 1e-19" in run.to_xarray().attrs["atol"]
    compared = model.compare_formulations((0, T), START, P, rtol=RTOL, atol=ATOL)
    assert "atol = (x: 1e-19" in str(compared)
    assert all(row.error < 1e-7 for row in compared)
    options = tighter(SweepOptions(atol={"x": 1e-6}))
    assert (options.atol.by_name, options.atol.default) == ({"x": pytest.approx(1e-8)}, pytest.approx(1e-12))
    assert component_tolerances(1e-9, ("x",)) is None


def test_what_is_left_out_is_the_default_and_said(recwarn):
    """x_dot is at most 5e-9, and the default of 1e-10 decides its error: a warning names it and a number."""
    model = model_on("llvm")
    for run in (model.simulate, model.sweep):
        with pytest.warns(PrecisionWarning, match=r'leaves out components .*: x_dot \(up to .*such as "x_dot": \de-'):
            run((0, T), START, P, rtol=RTOL, atol={"x": 1e-18})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.simulate((0, T), START, P, rtol=RTOL, atol={"x": 1e-18, "x_dot": 1e-18})
        model.simulate((0, T), {**START, "x": 0.0}, P, rtol=RTOL, atol={"y": 1e-7})


@pytest.mark.parametrize(
    ("atol", "message"),
    [
        ({"z": 1e-9}, r"unknown component of the state 'z'\. Known: x, y, x_dot, y_dot"),
        ({"x": -1.0}, "must be positive and finite numbers, not x = -1"),
        ({"x": 0.0}, "must be positive and finite numbers, not x = 0"),
        ({"x": np.inf}, "must be positive and finite numbers, not x = inf"),
        ({}, "must be positive and finite numbers, not no name"),
        ({X: 1e-9, "x": 1e-8}, r"atol of 'x' is given twice, as 'x\(t\)' and as 'x'"),
        ({"x": "small"}, "atol of 'x' must be a number, not 'small'"),
    ],
)
def test_wrong_names_and_numbers(atol, message):
    model = model_on("llvm")
    calls = [
        lambda: model.simulate((0, 1), START, P, atol=atol),
        lambda: model.sweep((0, 1), START, P, atol=atol),
        lambda: model.prepare((0, 1), atol=atol),
        lambda: model.sensitivity((0, 1), START, P, wrt=["k"], atol=atol),
        lambda: model.compare_formulations((0, 1), START, P, atol=atol),
        lambda: model.source_of("taylor", atol=atol),
        lambda: model_on("jax").solve_fn(atol=atol),
    ]
    for call in calls:
        with pytest.raises((OptionError, UnknownNameError), match=message):
            call()


def test_components_that_follow_from_others():
    """A rate that the constraints give is no component of the state of 'minimal', and the message says so."""
    frame, origin, length = ReferenceFrame("N"), Point("O"), sp.symbols("l", positive=True)
    scene = da.Scene("pendulum", frame, origin, [X, Y])
    point = origin.locatenew("P", X * frame.x + Y * frame.y)
    scene.add_bodies(Particle("bob", point, 1))
    scene.add_loads((point, -frame.y))
    scene.add_holonomic_constraints(X**2 + Y**2 - length**2)
    start, p = {"x": 0.6, "y": -0.8, "x_dot": 0, "y_dot": 0}, {"l": 1}
    model = da.compile_model(scene, formulation="projected")
    names = dict.fromkeys(("x", "y", "x_dot", "y_dot"), 1e-9)
    named, plain = (model.simulate((0, 5), start, p, atol=atol, rtol=1e-10) for atol in (names, 1e-9))
    np.testing.assert_array_equal(named.y, plain.y)
    table = model.compare_formulations((0, 5), start, p, atol=names, formulations=["projected", "ggl", "augmented"])
    assert [row.status for row in table] == ["SUCCESS"] * 3
    sleigh = da.compile_model(da.scenes.chaplygin_sleigh())
    with pytest.raises(UnknownNameError, match=r"component of the state 'y_dot'.* It is none in the formulation"):
        sleigh.simulate(
            (0, 1),
            {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0},
            {"m": 1, "b": 0.3, "I_C": 0.5},
            atol={"y_dot": 1e-9, "x_dot": 1e-9},
        )
