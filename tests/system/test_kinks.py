"""Forces with a kink or a jump: right by every method, also by power series, whose steps end before them."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS, backend_named

c, g = sp.symbols("c g", positive=True)
t, x, v = dynamicsymbols._t, dynamicsymbols("x"), dynamicsymbols("x", 1)


def pushed(force):
    """A particle of mass 1 on a line, under a force."""
    x = dynamicsymbols("x")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, force * N.x))
    return scene


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_fall_from_rest_with_quadratic_drag(backend):
    """v = sqrt(g/c) tanh(t sqrt(g c)), where |v| has its kink at the very start, and later on."""
    model = da.compile_model(pushed(g - c * v * sp.Abs(v)), backend=backend)
    p = {"g": 9.81, "c": 0.5}
    turning = np.arctan(1.5 * np.sqrt(0.5 / 9.81)) / np.sqrt(9.81 * 0.5)
    for method in ("auto", *model.methods):
        for before, speed in ((0.0, 0.0), (turning, -1.5)):
            end = before + 1.0
            run = model.simulate((0, end), {"x": 0, "x_dot": speed}, p, method=method)
            exact = np.sqrt(9.81 / 0.5) * np.tanh(np.sqrt(9.81 * 0.5))
            assert run["x_dot"][-1] == pytest.approx(exact, rel=1e-6), method
    sweep = model.sweep((0, 1), {"x": 0, "x_dot": 0}, p)
    assert sweep["x_dot"][0] == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    "force",
    [sp.Heaviside(t - 1), sp.Piecewise((0, t < 1), (1, True)), sp.Max(0, sp.sign(t - 1)), sp.floor(t / 2 + sp.S.Half)],
    ids=str,
)
def test_force_that_sets_in_later(force):
    """It is nothing before t = 1, and 1 from there to t = 3."""
    model = da.compile_model(pushed(force), backend="llvm", cache=False)
    for method in ("auto", "taylor"):
        run = model.simulate((0, 2.5), {"x": 0, "x_dot": 0}, {}, method=method)
        sweep = model.sweep((0, 2.5), {"x": 0, "x_dot": 0}, {}, method=method)
        assert run["x_dot"][-1] == pytest.approx(1.5, rel=1e-6)
        assert sweep["x_dot"][0] == pytest.approx(1.5, rel=1e-6)


HERTZ, LEAK = 100 * sp.Max(0, -x) ** sp.Rational(3, 2) - 1, -sp.sqrt(sp.Max(0, x))
STOP, TURNS, SATURATED = 100 * sp.Max(0, -x) - 1, sp.sign(sp.sin(3 * t)), -sp.Max(-1, sp.Min(1, 5 * x))


@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
@pytest.mark.parametrize(
    "force, place, end",
    [(HERTZ, 1, 5), (LEAK, 1, 5), (STOP, 1, 5), (TURNS, 0, 6), (SATURATED, 2, 20), (-x - v * sp.Abs(v) / 2, 2, 20)],
    ids=["Hertz", "root", "stop", "turns", "saturated", "drag"],
)
def test_power_series_come_to_a_kink_and_go_on_behind_it(force, place, end, rtol):
    """As near the motion as steps of a pair are, which are cut there too; the pair is run at 1e-13 for comparison."""
    model = da.compile_model(pushed(force), backend="llvm")
    start, tight = {"x": place, "x_dot": 0}, {"rtol": 1e-13, "atol": 1e-14, "max_step": 1e-2}
    exact = model.simulate((0, end), start, {}, method="dop853", **tight)
    run = model.simulate((0, end), start, {}, method="taylor", rtol=rtol, atol=rtol / 100)
    assert run.success and run.stats.steps < 500
    np.testing.assert_allclose(run.q[-1], exact.q[-1], rtol=0, atol=100 * rtol)


@pytest.mark.parametrize("name", BACKENDS)
def test_kinks_at_which_no_step_ends_are_left_to_pairs(name):
    """Compiled Taylor steps end at kinks, but not at those in a root; XLA takes pairs for all of them."""
    backend = backend_named(name)
    rough = da.compile_model(pushed(-c * sp.sqrt(sp.Max(v, 0))), backend=name)
    ended = da.compile_model(pushed(-c * sp.Abs(v)), backend=name)
    smooth = da.compile_model(pushed(-c * v + sp.Abs(c)), backend=name)
    assert set(rough.methods) == set(smooth.methods) == set(backend.methods)
    compiled = name in ("llvm", "numba")
    for many in (False, True):
        assert rough.choose_method("auto", 1e-8, 1e-10, many=many) not in backend.series
        assert (ended.choose_method("auto", 1e-8, 1e-10, many=many) in backend.series) == compiled
    assert ("auto takes another method" in rough.explain()) == bool(backend.series)
    assert ("auto takes another method" in ended.explain()) == (bool(backend.series) and not compiled)
    assert "kink" not in smooth.explain()


@pytest.mark.parametrize("force", ["Piecewise", "Min"])
def test_a_chain_that_slides_off_a_table(force):
    """Taylor steps end where the last link leaves the table; the pair that "auto" took was 1e-4 off."""
    weight = 9.81 * (sp.Piecewise((x, x < 1), (1, True)) if force == "Piecewise" else sp.Min(x, 1))
    model, start = da.compile_model(pushed(weight)), {"x": 0.01, "x_dot": 0}
    rate = np.sqrt(9.81)
    leaves = np.arccosh(100) / rate
    speed, fall = 0.01 * rate * np.sinh(rate * leaves), 3 - leaves
    exact = 1 + speed * fall + 9.81 / 2 * fall**2
    for rtol in (1e-4, 1e-6, 1e-8, 1e-12):
        run = model.simulate((0, 3), start, {}, rtol=rtol, atol=1e-2 * rtol)
        swept = model.sweep((0, 3), start, {}, rtol=rtol, atol=1e-2 * rtol)
        assert run.stats.method == swept.stats.method == "taylor"
        assert run.stats.steps < 20
        assert abs(run["x"][-1] - exact) < 0.3 * rtol * exact + 1e-13
        assert abs(swept["x"][0] - exact) < 0.3 * rtol * exact + 1e-13


REST_ENDS = [
    # a second mass at t - 1 ends the rest of x at a kink: x = s - sin(s), s = 2
    (lambda x, y: -sp.Abs(x) + sp.Max(y, 0), 2 - np.sin(2)),
    (lambda x, y: -4 * sp.Max(x, 0) + sp.Max(y, 0), 2 / 4 - np.sin(4) / 8),
    (lambda x, y: sp.Piecewise((-4 * x, x > 0), (0, True)) + sp.Piecewise((y, y > 0), (0, True)), 0.5 - np.sin(4) / 8),
]


@pytest.mark.parametrize(("force", "exact"), REST_ENDS)
def test_a_rest_at_a_kink_that_another_coordinate_ends(force, exact):
    """Taylor steps were 2,000 at 1e-10: terms that take a motion back to a kink counted without those before them."""
    frame, origin, y = ReferenceFrame("N"), Point("O"), dynamicsymbols("y")
    scene = da.Scene("rest_at_a_kink", frame, origin, [x, y])
    for name, q, load in (("a", x, force(x, y)), ("b", y, 0)):
        point = origin.locatenew(name, q * frame.x)
        scene.add_bodies(Particle(name, point, 1))
        scene.add_loads((point, load * frame.x))
    model, start = da.compile_model(scene), {"x": 0, "x_dot": 0, "y": -1, "y_dot": 1}
    for method in ("auto", "taylor", "dop853", "tsit5", "radau"):
        run = model.simulate((0, 3), start, {}, method=method, rtol=1e-10, atol=1e-12)
        swept = model.sweep((0, 3), start, {}, method=method, rtol=1e-10, atol=1e-12)
        assert abs(run["x"][-1] - exact) < 2e-10
        assert abs(swept["x"][0] - exact) < 2e-10
        if run.stats.method == "taylor":
            assert run.stats.steps < 12


def test_powers_written_as_decimals_are_powers():
    """x**2.0 has a power series where x is zero, too."""
    x = dynamicsymbols("x")
    run = da.compile_model(pushed(-(x**2.0) - x**3.0)).simulate((0, 1), {"x": 0, "x_dot": 0.3}, {}, rtol=1e-10)
    same = da.compile_model(pushed(-(x**2) - x**3)).simulate((0, 1), {"x": 0, "x_dot": 0.3}, {}, rtol=1e-10)
    np.testing.assert_array_equal(run.q, same.q)
    assert run.success and run.stats.method == "taylor"


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_radau_sees_a_jump_behind_its_stages(rtol):
    """After a rejected step nothing foretells the stages: the first iteration evaluates before the jump alone."""
    model = da.compile_model(pushed(-(sp.Abs(x) - sp.S.Half) * sp.sign(x)))
    run = model.simulate((0, 10), {"x": 1, "x_dot": -0.3}, {}, method="radau", rtol=rtol, atol=rtol / 100)
    energy = run["x_dot"] ** 2 / 2 + (np.abs(run["x"]) - 0.5) ** 2 / 2
    assert run.success and np.abs(energy - energy[0]).max() < rtol


@pytest.mark.parametrize("power", [1, 2, 3, 5])
@pytest.mark.parametrize("place", [0, sp.Rational(1, 2)])
def test_start_at_rest_without_acceleration(power, place):
    """A force t^power, and a further one of 1/2 beyond `place`, where the motion is later on, or begins."""
    begun = (float(place) * (power + 1) * (power + 2)) ** (1 / (power + 2))
    exact = 2.0 ** (power + 2) / ((power + 1) * (power + 2)) + (2.0 - begun) ** 2 / 4
    model = da.compile_model(pushed(t**power + sp.Heaviside(x - place) / 2))
    start = {"x": 0, "x_dot": 0}
    for end in (
        model.simulate((0, 2), start, {}, method="taylor", rtol=1e-10)["x"][-1],
        model.sweep((0, 2), start, {}, method="taylor", rtol=1e-10)["x"][0],
        model.prepare((0, 2), method="taylor", rtol=1e-10)(np.zeros(2), np.zeros(0))[0],
    ):
        assert end == pytest.approx(exact, rel=1e-7)
