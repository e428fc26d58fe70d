"""Motions of which every component is little against the absolute tolerance are warned of."""

import warnings

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError, PrecisionWarning

VALUES = {"m": 1, "k": 1, "c": 0, "F": 0}


@pytest.fixture(scope="module")
def oscillator():
    frame, origin, x = ReferenceFrame("N"), Point("O"), dynamicsymbols("x")
    m, k, c, force = sp.symbols("m k c F")
    point = origin.locatenew("P", x * frame.x)
    scene = da.Scene("oscillator", frame, origin, [x])
    scene.add_bodies(Particle("body", point, m))
    scene.add_loads((point, (force - k * x - c * x.diff()) * frame.x))
    return da.compile_model(scene)


@pytest.mark.parametrize("size", [1e-14, 1e-10, 1e-9])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_the_suggested_tolerance_serves(oscillator, method, size):
    """At the default atol = 1e-10 an oscillation of 1e-14 was off by 13 times its size, with SUCCESS and no word."""
    with pytest.warns(PrecisionWarning, match=r"no coordinate or rate of this motion exceeds .* atol=\de-\d+") as found:
        loose = oscillator.simulate((0, 10), {"x": size, "x_dot": 0}, VALUES, method=method)
    assert abs(loose["x"][-1] / size - np.cos(10)) > 1e-3
    atol = float(str(found[0].message).split("atol=")[1].split(",")[0])
    right = oscillator.simulate((0, 10), {"x": size, "x_dot": 0}, VALUES, method=method, atol=atol)
    assert right["x"][-1] / size == pytest.approx(np.cos(10), abs=1e-6)


@pytest.mark.parametrize(
    ("start", "values"),
    [
        ({"x": 1e-7, "x_dot": 0}, {}),
        ({"x": 1e-12, "x_dot": 1}, {}),
        ({"x": 1e-12, "x_dot": 0}, {"c": -4}),  # grows
        ({"x": 1, "x_dot": 0}, {"c": 2}),  # decays below atol
        ({"x": 0, "x_dot": 0}, {}),
        ({"x": 0, "x_dot": 0}, {"F": 1e-16}),  # rounding of forces that cancel
    ],
)
def test_no_warning(oscillator, start, values):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert oscillator.simulate((0, 30), start, {**VALUES, **values}).success
        assert np.all(oscillator.sweep((0, 30), start, {**VALUES, **values}).success)


def test_a_small_force_from_rest(oscillator):
    with pytest.warns(PrecisionWarning, match="no coordinate or rate of this motion"):
        oscillator.simulate((0, 10), {"x": 0, "x_dot": 0}, {**VALUES, "F": 1e-10})


def test_cases(oscillator):
    starts = {"x": [1e-12, 1.0, -1e-9, 0.0], "x_dot": 0}
    with pytest.warns(PrecisionWarning, match="at the start and the end of 2 cases") as found:
        oscillator.sweep((0, 10), starts, VALUES)
    assert len(found) == 1
    with pytest.warns(PrecisionWarning, match="of one case"):
        oscillator.sweep((0, 10), {"x": 1e-12, "x_dot": 0}, VALUES, t_eval=[5, 10])


@pytest.mark.parametrize("method", ["auto", "taylor", "dop853", "tsit5", "radau"])
def test_atol_auto_serves(oscillator, method):
    """One number for the whole state, from its start: in single runs, sweeps and derivatives, without a warning."""
    sizes = np.array([1e-14, 2e-14, 1.0, 1e-9, 0.0, 1e-16])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for size in (1e-14, 1e-16):
            run = oscillator.simulate((0, 10), {"x": size, "x_dot": 0}, VALUES, method=method, atol="auto")
            assert run["x"][-1] / size == pytest.approx(np.cos(10), abs=2e-6)
            assert 'by "auto"' in run.stats.note
            assert run.stats.atol <= 2e-9 * size
        swept = oscillator.sweep((0, 10), {"x": sizes, "x_dot": 0}, VALUES, method=method, atol="auto")
        found = oscillator.sensitivity(
            (0, 10), {"x": 1e-14, "x_dot": 0}, VALUES, wrt=["k"], method=method, atol="auto", t_eval=[5, 10]
        )
    assert np.all(swept.success)
    np.testing.assert_allclose(swept["x"], sizes * np.cos(10), rtol=4e-6, atol=0)
    assert 'atol by "auto": ' in swept.stats.note
    assert "1e-24 for " in swept.stats.note
    assert found.jacobian("x", "k")[-1] / 1e-14 == pytest.approx(-5 * np.sin(10), abs=1e-5)
    run = oscillator.simulate((0, 10), {"x": 1, "x_dot": 0}, VALUES, method=method, atol="auto")
    assert run.stats.atol == 1e-10
    assert not run.stats.note


def test_atol_auto_from_rest_and_growing(oscillator):
    """A motion from rest shows its size in a first run; one that grows from 1e-12 needs it from its start."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rest = oscillator.simulate((0, 10), {"x": 0, "x_dot": 0}, {**VALUES, "F": 1e-12}, atol="auto")
        cases = oscillator.sweep((0, 10), {"x": 0, "x_dot": 0}, {**VALUES, "F": [1e-12, 1.0, 3e-14]}, atol="auto")
        grown = oscillator.simulate((0, 30), {"x": 1e-12, "x_dot": 0}, {**VALUES, "c": -2.5}, atol="auto")
        times = oscillator.sweep((5, 30), {"x": [1e-12, 1.0], "x_dot": 0}, VALUES, atol="auto", t_eval=[17.5, 30])
    assert rest["x"][-1] / 1e-12 == pytest.approx(1 - np.cos(10), abs=1e-6)
    np.testing.assert_allclose(cases["x"], np.array([1e-12, 1, 3e-14]) * (1 - np.cos(10)), rtol=1e-6)
    # roots -1/2 and -2 of s**2 + 2.5 s + 1, backward in sign
    exact = 1e-12 * (4 * np.exp(15) - np.exp(60)) / 3
    assert grown["x"][-1] == pytest.approx(exact, rel=1e-5)
    np.testing.assert_allclose(times["x"] / [[1e-12], [1.0]], np.cos([[12.5, 25]] * 2), atol=1e-6)


def test_a_pendulum_of_a_micrometre():
    """Coordinates of 1e-6 m: the exact period, by the arithmetic-geometric mean."""
    frame, origin, theta = ReferenceFrame("N"), Point("O"), dynamicsymbols("theta")
    length, g = sp.symbols("l g")
    body = frame.orientnew("B", "Axis", (theta, frame.z))
    point = origin.locatenew("P", -length * body.y)
    scene = da.Scene("small_pendulum", frame, origin, [theta])
    scene.add_bodies(Particle("bob", point, 1))
    scene.apply_uniform_gravity(-g * frame.y)
    model, size = da.compile_model(scene), 1e-6
    a, b = 1.0, np.cos(size / 2)
    for _ in range(6):
        a, b = (a + b) / 2, np.sqrt(a * b)
    period = 2 * np.pi / a  # of g = l
    start, p = {"theta": size, "theta_dot": 0}, {"l": 1e-6, "g": 1e-6}
    for size in (1e-6, 1e-11):
        start["theta"] = size
        run = model.simulate((0, 3.25 * period), start, p, atol="auto")
        assert abs(run["theta"][-1]) < 1e-6 * size


def test_atol_that_is_no_number(oscillator):
    start = {"x": 1e-14, "x_dot": 0}
    for run in (oscillator.simulate, oscillator.sweep):
        with pytest.raises(OptionError, match=r'atol must be a number, not .*by name, or "auto" in simulate'):
            run((0, 1), start, VALUES, atol="small")
    with pytest.raises(OptionError, match="atol must be a number, not "):
        oscillator.sensitivity((0, 1), start, VALUES, wrt=["k"], atol="small")
    with pytest.raises(OptionError, match="prepared runs do not look at the size of their motions"):
        oscillator.prepare((0, 1), atol="auto")
    with pytest.raises(OptionError, match='atol="auto" is a share of rtol'):
        oscillator.simulate((0, 1), start, VALUES, rtol=0, atol="auto")


def test_atol_auto_falls_back(oscillator):
    """Where the smaller tolerance needs more steps than allowed, the default stays, with a warning."""
    start = {"x": 1e-14, "x_dot": 0}
    for run in (oscillator.simulate, oscillator.sweep):
        with pytest.warns(PrecisionWarning, match=r'atol="auto": .* kept atol = 1e-10, because with atol = 1e-24'):
            found = run((0, 100), start, VALUES, atol="auto", method="dop853", max_steps=25)
        assert np.all(found.success)
        assert "kept atol = 1e-10" in found.stats.note
