"""A particle on curves that cross themselves, or nearly: runs end where their branch is left to chance, or are right.

The lemniscate r^4 - a^2 (x^2 - y^2) = b crosses itself at the origin for b = 0. For b > 0 it is one curve around both
sides of the y axis, for b < 0 two, and a motion without forces goes along it at its speed.
"""

import functools

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from dalembert.reduction.margins import short_time

x, y = dynamicsymbols("x y")
m, a = sp.symbols("m a", positive=True)
b = sp.Symbol("b", real=True)
END = 2.5
FORMULATIONS = ["baumgarte", "augmented", "ggl"]
METHODS = ["taylor", "dop853", "tsit5", "radau"]


@functools.cache
def lemniscate(formulation):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("lemniscate", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, m))
    scene.add_holonomic_constraints((x**2 + y**2) ** 2 - a**2 * (x**2 - y**2) - b)
    return da.compile_model(scene, formulation=formulation)


def tangent(_, place):
    u, v = place
    slope = np.array([4 * u * (u * u + v * v) - 2 * u, 4 * v * (u * u + v * v) + 2 * v])
    return np.array([-slope[1], slope[0]]) / np.hypot(*slope)


def start(angle, level, speed=1.0):
    """Return a start on the curve with a = 1 at an angle, moving towards the y axis at a speed."""
    half = 0.5 * np.cos(2 * angle)
    radius = np.sqrt(half + np.sqrt(half * half + level))
    place = radius * np.array([np.cos(angle), np.sin(angle)])
    rates = speed * tangent(0.0, place)
    return dict(zip([x, y, x.diff(), y.diff()], [*place, *rates], strict=True))


def methods_of(formulation):
    return ["radau"] if formulation == "ggl" else METHODS


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_runs_into_the_crossing_end_by_name(formulation, rtol):
    model, p = lemniscate(formulation), {m: 1.0, a: 1.0, b: 0.0}
    for method in methods_of(formulation):
        options = {"method": method, "rtol": rtol, "atol": rtol / 100, "max_steps": 20_000}
        for angle in (0.15, 0.3, 0.5):
            given = start(angle, 0.0)
            run = model.simulate((0, END), given, p, **options)
            sampled = model.simulate((0, END), given, p, t_eval=[0.0, 0.25, END], **options)
            cases = model.sweep((0, END), given, p | {m: np.ones(2)}, t_eval=[0.0, 0.25, END], **options)
            ends = [run.status, sampled.status, *cases.status]
            assert ends == [Status.SINGULAR_CONFIGURATION] * 4, (method, angle)
            assert "by the coordinates vanish, or nearly so; 2 branches meet there" in run.message
            assert run["x"][-1] > -0.02 and sampled.t.tolist() == [0.0, 0.25]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("level", [1e-3, -1e-3, 1e-5, -1e-5])
def test_runs_past_a_crossing_are_right(formulation, level):
    """Their errors are much less than what keeps the branches apart."""
    model, given = lemniscate(formulation), start(0.3, level)
    place = solve_ivp(tangent, (0, END), [given[x], given[y]], "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    for method in methods_of(formulation):
        options = {"method": method, "rtol": 1e-8, "atol": 1e-10, "max_steps": 20_000}
        run = model.simulate((0, END), given, {m: 1.0, a: 1.0, b: level}, **options)
        cases = model.sweep((0, END), given, {m: np.ones(2), a: 1.0, b: level}, **options)
        assert run.success and np.all(cases.success), (method, run.message)
        found = np.array([[run["x"][-1], run["y"][-1]], *zip(cases["x"], cases["y"], strict=True)])
        np.testing.assert_allclose(found, np.tile(place, (3, 1)), atol=1e-3)


@pytest.mark.parametrize("formulation", ["baumgarte", "augmented"])
def test_no_run_that_succeeds_is_on_a_wrong_branch(formulation):
    """At coarse tolerances runs end by name, or go on as the curve does."""
    model, draw, ended = lemniscate(formulation), np.random.default_rng(1), 0
    for number in range(40):
        rtol, level = 10.0 ** draw.uniform(-5, -2), (-1) ** number * 10.0 ** draw.uniform(-7, -2)
        given, method = start(draw.uniform(0.05, 0.6), level), METHODS[number % 4]
        place = solve_ivp(tangent, (0, END), [given[x], given[y]], "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        options = {"method": method, "rtol": rtol, "atol": rtol / 100, "max_steps": 20_000}
        run = model.simulate((0, END), given, {m: 1.0, a: 1.0, b: level}, **options)
        cases = model.sweep((0, END), given, {m: np.ones(2), a: 1.0, b: level}, **options)
        ended += run.status == Status.SINGULAR_CONFIGURATION
        for status, u, v in ((run.status, run["x"][-1], run["y"][-1]), (cases.status[0], cases["x"][0], cases["y"][0])):
            assert status in (Status.SUCCESS, Status.SINGULAR_CONFIGURATION)
            assert status != Status.SUCCESS or np.hypot(u - place[0], v - place[1]) < 0.3, (method, rtol, level)
        assert run.success or abs(level) < rtol
    assert 0 < ended < 30


def test_projected_runs_keep_their_branch_where_another_is_ten_tolerances_away():
    """Nearer than that, an error as large as the tolerance may lead to the other branch."""
    model, draw = lemniscate("projected"), np.random.default_rng(2)
    for number in range(24):
        rtol = (1e-2, 1e-3, 1e-4)[number % 3]
        level = (-1) ** number * (5 * rtol) ** 2
        given, method = start(draw.uniform(0.05, 0.6), level), METHODS[number % 4]
        place = solve_ivp(tangent, (0, END), [given[x], given[y]], "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        options = {"method": method, "rtol": rtol, "atol": rtol / 100, "max_steps": 20_000}
        run = model.simulate((0, END), given, {m: 1.0, a: 1.0, b: level}, **options)
        near = np.hypot(run["x"][-1] - place[0], run["y"][-1] - place[1]) < 0.3
        assert run.status == Status.SINGULAR_CONFIGURATION or (run.success and near), (method, rtol, level)


@pytest.mark.parametrize("second", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_sweeps_into_the_crossing_end_in_all_units_of_time(formulation, second):
    """The dip of the determinant is found by how the Jacobian changes in a time that is short beside the runs."""
    model, gain = lemniscate(formulation), {"baumgarte_alpha": 10.0 / second, "baumgarte_beta": 10.0 / second}
    p = {m: np.ones(2), a: 1.0, b: 0.0} | (gain if formulation == "baumgarte" else {})
    for method in methods_of(formulation):
        for rtol in (1e-3, 1e-6):
            options = {"method": method, "rtol": rtol, "atol": rtol / 100 / max(second, 1.0), "max_steps": 20_000}
            for angle in (0.15, 0.3, 0.5):
                cases = model.sweep((0, END * second), start(angle, 0.0, 1.0 / second), p, **options)
                assert list(cases.status) == [Status.SINGULAR_CONFIGURATION] * 2, (method, rtol, angle)


def test_short_times_follow_the_duration_of_runs():
    assert [short_time(span) for span in (0.0, 1e-3, 2.5, 1e3, np.inf)] == [0.01] * 5
    assert [short_time(span) for span in (2.5e3, 2.5e6, 2.5e-6)] == [0.01 * 1024, 0.01 * 1024**2, 0.01 / 1024]
