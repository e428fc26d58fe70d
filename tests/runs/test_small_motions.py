"""Motions of which every component is little against the absolute tolerance are warned of."""

import warnings

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import PrecisionWarning

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
