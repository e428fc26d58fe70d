"""Cases in lanes: every method and formulation against single runs, and against itself in other company."""

import ctypes
import functools
import itertools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm.assembly import compile_object, load_object
from dalembert.codegen.llvm.backend import LLVMLibrary, attempt_assembly
from dalembert.codegen.llvm.target import native_lanes
from dalembert.methods.status import Status
from dalembert.methods.tableaus import TABLEAUS

METHODS = ("taylor", "dop853", "tsit5")
FORMULATIONS = ("minimal", "projected")
N = 13  # not a multiple of any number of lanes
SPEED = np.linspace(-2.0, 2.0, N)


def pendulum():
    """A bob whose place follows from an angle, by constraints that one formulation eliminates and one projects."""
    x, y, theta = dynamicsymbols("x y theta")
    m, l, g = sp.symbols("m l g", positive=True)
    frame, origin = ReferenceFrame("N"), Point("O")
    bob = Particle("bob", origin.locatenew("B", x * frame.x + y * frame.y), m)
    scene = da.Scene("pendulum", frame=frame, origin=origin, coordinates=[theta, x, y])
    scene.add_bodies(bob)
    scene.add_holonomic_constraints(x - l * sp.sin(theta), y + l * sp.cos(theta))
    scene.apply_uniform_gravity(-g * frame.y)
    return scene


def runaway():
    """x'' = k x**2, which from x = 1, x' = 2 and k = 6 is 1/(1 - t)**2."""
    x, k = dynamicsymbols("x"), sp.Symbol("k")
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", x * frame.x)
    scene = da.Scene("runaway", frame=frame, origin=origin, coordinates=[x])
    scene.add_bodies(Particle("p", point, 1))
    scene.add_loads((point, k * x**2 * frame.x))
    return scene


SCENES = {
    "sleigh": (
        da.scenes.chaplygin_sleigh,
        {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": SPEED},
        {"m": 1.0, "b": np.linspace(0.1, 0.5, N), "I_C": 0.5},
    ),
    "pendulum": (
        pendulum,
        {"theta": np.linspace(0.3, 2.8, N), "theta_dot": SPEED},
        {"m": 1.0, "l": np.linspace(0.5, 1.5, N), "g": 9.81},
    ),
}


@functools.cache
def compiled(build, formulation="minimal"):
    return da.compile_model(build(), formulation=formulation)


def pick(values, cases):
    """Return the initial values or parameters of some cases."""
    return {name: value if np.ndim(value) == 0 else value[cases] for name, value in values.items()}


class Setup:
    """One scene in one formulation, swept by one method."""

    def __init__(self, scene, formulation, method):
        build, self.initial, self.parameters = SCENES[scene]
        self.model, self.method = compiled(build, formulation), method

    def sweep(self, span=(0.0, 3.0), cases=slice(None), parameters=None, **options):
        given = pick(self.parameters if parameters is None else parameters, cases)
        options = {"rtol": 1e-9, "atol": 1e-10, "threads": 1, "method": self.method} | options
        return self.model.sweep(span, pick(self.initial, cases), given, **options)

    def single(self, i, span=(0.0, 3.0), **options):
        options = {"rtol": 1e-9, "atol": 1e-10, "method": self.method} | options
        return self.model.simulate(span, pick(self.initial, i), pick(self.parameters, i), **options)


@pytest.fixture(params=[(s, f, m) for s in SCENES for f in FORMULATIONS for m in METHODS], ids="-".join)
def setup(request):
    return Setup(*request.param)


def assert_same(a, b):
    """Assert that two sweeps agree to the last bit, in everything."""
    np.testing.assert_array_equal(a.y, b.y)
    np.testing.assert_array_equal(a.t, b.t)
    np.testing.assert_array_equal(a.status, b.status)
    np.testing.assert_array_equal(a.steps, b.steps)
    if a.t_eval is not None:
        np.testing.assert_array_equal(a.samples, b.samples)


def test_sweeps_equal_single_runs(setup):
    times = np.array([0.0, 0.31, 1.5, 1.5, 2.999, 3.0])
    plain, sampled = setup.sweep(), setup.sweep(t_eval=times)
    assert np.all(plain.success) and np.all(sampled.success)
    np.testing.assert_array_equal(sampled.samples[:, -1], sampled.y)
    np.testing.assert_allclose(sampled.y, plain.y, rtol=1e-10, atol=1e-10)
    for i in (0, 5, N - 1):
        run = setup.single(i)
        np.testing.assert_allclose(plain.y[i], run.y[-1], rtol=2e-7, atol=2e-8)
        at_times = setup.single(i, t_eval=times)
        np.testing.assert_allclose(sampled.samples[i], at_times.y, rtol=2e-7, atol=2e-7)
        np.testing.assert_array_equal(sampled.samples[i, 0], run.y[0])


def test_steps_are_those_of_single_runs(setup):
    """The control of the step size is the same in lanes, but for four-digit logarithms."""
    steps = setup.sweep().steps
    for i in (0, N - 1):
        assert abs(steps[i] - setup.single(i).stats.steps) <= 1 + 0.1 * steps[i]


@pytest.mark.parametrize("sampled", [False, True])
def test_company_changes_no_bit(setup, sampled, monkeypatch):
    options = {"t_eval": np.linspace(0.0, 3.0, 7)} if sampled else {}
    together = setup.sweep(**options)
    turned = setup.sweep(cases=np.arange(N)[::-1], **options)
    np.testing.assert_array_equal(turned.y[::-1], together.y)
    np.testing.assert_array_equal(turned.steps[::-1], together.steps)
    many = np.resize(np.arange(N), 150)  # several blocks, which two threads take in turn
    for threads in (1, 2):
        np.testing.assert_array_equal(setup.sweep(cases=many, threads=threads, **options).y, together.y[many])
    for lanes in (1, 2):
        monkeypatch.setattr(LLVMLibrary, "lanes", lanes)
        assert_same(setup.sweep(**options), together)
    for i in (0, N // 2):
        alone = setup.sweep(cases=slice(i, i + 1), **options)
        np.testing.assert_array_equal(alone.y[0], together.y[i])


def test_refilled_lanes(setup):
    """Spans of 20 to 1: short cases come and go beside long ones."""
    ends = np.where(np.arange(N) % 3 == 0, 6.0, np.linspace(0.3, 0.6, N))
    sweep = setup.sweep((0.0, ends))
    assert np.all(sweep.success)
    np.testing.assert_array_equal(sweep.t, ends)
    for i in range(0, N, 4):
        alone = setup.sweep((0.0, ends[i]), cases=slice(i, i + 1))
        np.testing.assert_array_equal(sweep.y[i], alone.y[0])
        assert sweep.steps[i] == alone.steps[0]


def test_a_case_that_is_not_a_number_spoils_no_other(setup):
    name = "b" if "b" in setup.parameters else "l"
    bad = np.arange(N) % 4 == 1
    spoilt = setup.sweep(parameters={**setup.parameters, name: np.where(bad, np.nan, setup.parameters[name])})
    assert {Status(s) for s in spoilt.status[bad]} == {Status.NON_FINITE}
    np.testing.assert_array_equal(spoilt.y[~bad], setup.sweep().y[~bad])


@pytest.mark.parametrize("method", METHODS)
def test_numbers_that_overflow_reach_no_neighbour(method):
    model, values = compiled(pendulum, "projected"), {"m": 1.0, "l": 1.0, "g": 9.81}
    options = {"method": method, "rtol": 1e-8, "atol": 1e-8, "threads": 1}
    angles, speeds = np.array([0.4, 0.8, 1.2]), np.full(3, 0.5)
    clean = model.sweep((0.0, 2.0), {"theta": angles, "theta_dot": speeds}, values, **options)
    spoilt = model.sweep((0.0, 2.0), {"theta": angles, "theta_dot": [0.5, 1e160, 0.5]}, values, **options)
    assert not spoilt.success[1] and spoilt.t[1] < 2.0
    np.testing.assert_array_equal(spoilt.y[::2], clean.y[::2])
    np.testing.assert_array_equal(spoilt.steps[::2], clean.steps[::2])


@pytest.mark.parametrize("method", METHODS)
def test_finite_time_blow_up(method):
    model = compiled(runaway)
    start = {"x": 1.0, "x_dot": 2.0}
    options = {"method": method, "rtol": 1e-8, "atol": 1e-8, "threads": 1, "max_steps": 10**4}
    k = np.where(np.arange(9) % 3 == 1, 6.0, 0.01)
    mixed, calm = (model.sweep((0.0, 2.0), start, {"k": values}, **options) for values in (k, np.full(9, 0.01)))
    failed = k == 6.0
    assert np.all(mixed.success == ~failed)
    np.testing.assert_allclose(mixed.t[failed], 1.0, atol=1e-3)
    assert np.all(np.isfinite(mixed.y))
    np.testing.assert_array_equal(mixed.y[~failed], calm.y[~failed])
    assert len({tuple(y) for y in mixed.y[failed]}) == 1


def test_max_steps_is_the_status_of_each_case(setup):
    ends = np.where(np.arange(N) % 2 == 0, 0.05, 200.0)
    sweep = setup.sweep((0.0, ends), max_steps=12)
    long = ends == 200.0
    assert np.all(sweep.success[~long])
    assert {Status(s) for s in sweep.status[long]} == {Status.MAX_STEPS}
    assert np.all(sweep.steps[long] <= 12) and np.all(sweep.t[long] < 200.0)


def test_there_and_back(setup):
    there = setup.sweep((0.0, 1.0))
    names = [*setup.model.layout.coordinates, *(f"{q}_dot" for q in setup.model.layout.coordinates)]
    start = {name: there[name] for name in names}
    back = setup.model.sweep((1.0, 0.0), start, setup.parameters, method=setup.method, rtol=1e-9, atol=1e-10)
    assert np.all(back.success) and np.all(back.t == 0.0)
    first = setup.sweep((0.0, 0.0))
    np.testing.assert_allclose(back.y, first.y, atol=2e-7)
    sampled = setup.sweep((1.0, -1.0), t_eval=[1.0, 0.25, -0.9])
    run = setup.single(3, (1.0, -1.0), t_eval=np.array([1.0, 0.25, -0.9]))
    np.testing.assert_allclose(sampled.samples[3], run.y, atol=2e-7)


def test_spans_of_zero(setup):
    ends = np.where(np.arange(N) % 2 == 0, 0.0, 1.0)
    sweep = setup.sweep((0.0, ends))
    assert np.all(sweep.success)
    np.testing.assert_array_equal(sweep.steps == 0, ends == 0.0)
    np.testing.assert_array_equal(sweep.y[0], setup.single(0).y[0])
    sampled = setup.sweep((0.5, 0.5), t_eval=[0.5, 0.5])
    np.testing.assert_array_equal(sampled.samples[:, 0], sampled.y)
    np.testing.assert_array_equal(sampled.samples[:, 1], sampled.y)


def test_largest_step(setup):
    assert np.all(setup.sweep(max_step=0.05).steps >= 60)


def test_errors_fall_with_the_tolerance(setup):
    exact = setup.sweep(method="taylor", rtol=1e-14, atol=1e-14).y
    tolerances = (1e-4, 1e-6, 1e-8, 1e-10)
    errors = [np.abs(setup.sweep(rtol=tol, atol=tol).y - exact).max() for tol in tolerances]
    assert all(b < 0.2 * a for a, b in itertools.pairwise(errors))
    assert all(error < 300 * tol for error, tol in zip(errors, tolerances, strict=True))


@pytest.mark.parametrize("method", METHODS)
def test_constraints_hold_at_ends_and_samples(method):
    setup = Setup("pendulum", "projected", method)
    sweep = setup.sweep(rtol=1e-5, atol=1e-5, t_eval=np.linspace(0.0, 3.0, 50))
    lengths = setup.parameters["l"][:, np.newaxis]
    gap = sweep["x"] - lengths * np.sin(sweep["theta"]), sweep["y"] + lengths * np.cos(sweep["theta"])
    rate = sweep["x_dot"] - lengths * np.cos(sweep["theta"]) * sweep["theta_dot"]
    assert np.abs([*gap, rate]).max() < 1e-13


@pytest.mark.parametrize("lanes", [1, native_lanes()])
@pytest.mark.parametrize("options", [(d, c) for d in (False, True) for c in (False, True)], ids=str)
@pytest.mark.parametrize("tableau", TABLEAUS, ids=lambda tableau: tableau.name)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_steps_that_call_the_right_hand_side_compute_the_same_bits(formulation, tableau, options, lanes):
    dense, carried = options
    program = compiled(pendulum, formulation).stages.program
    rhs, n = program.kernel("rhs"), len(program.layout.state)
    rng = np.random.default_rng(5)
    y = rng.uniform(0.1, 1.0, (2 * n + 5, lanes))
    y[n + 2 : n + 5] = np.array([0.05, -3.0, 8.0])[:, np.newaxis]
    arrays = [np.zeros(lanes), y, rng.uniform(0.5, 1.0, (program.layout.constants, lanes))]
    arrays.append(np.repeat([[1.0], [1.0], [1e-3], [1e-3]], lanes, axis=1))
    results = []
    for inline in (False, True):
        text = attempt_assembly(rhs, tableau, lanes, dense=dense, carried=carried, inline=inline)
        library = load_object(compile_object(text))
        out = np.zeros((2 * n + 5 + n * (tableau.degree + 1), lanes))
        first = np.zeros((2 * n + 5, lanes))
        for name, target in (("attempt", out), ("start", first)):
            code = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(library.address(name))
            code(*(a.ctypes.data for a in arrays), target.ctypes.data)
        results.append(np.concatenate([out, first]))
    np.testing.assert_array_equal(*results)
    assert np.all(np.isfinite(results[0])) and np.any(results[0][n] == 0.05)
