"""Forces with a kink or a jump: right by every method that is offered, and no power series across them."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS, backend_named
from dalembert.errors import OptionError

c, g = sp.symbols("c g", positive=True)
t, v = dynamicsymbols._t, dynamicsymbols("x", 1)


def pushed(force):
    """A particle of mass 1 on a line, under a force."""
    x = dynamicsymbols("x")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, force * N.x))
    return scene


@pytest.mark.parametrize("backend", ["numba", "numpy"])
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
    model = da.compile_model(pushed(force), backend="numba", cache=False)
    run = model.simulate((0, 2.5), {"x": 0, "x_dot": 0}, {})
    assert run["x_dot"][-1] == pytest.approx(1.5, rel=1e-6)


@pytest.mark.parametrize("name", BACKENDS)
def test_no_power_series_across_a_kink(name):
    backend = backend_named(name)
    rough = da.compile_model(pushed(-c * sp.Abs(v)), backend=name)
    smooth = da.compile_model(pushed(-c * v + sp.Abs(c)), backend=name)
    assert set(rough.methods) == set(backend.methods) - set(backend.series)
    assert set(smooth.methods) == set(backend.methods)
    for method in backend.series:
        with pytest.raises(OptionError, match=rf"'{method}' does not serve 'pushed'.*kink.*abs.*Take one of: auto, "):
            rough.simulate((0, 1), {"x": 0, "x_dot": 0}, {"c": 1}, method=method)
        assert f"{method!r} does not serve" in rough.explain() and "kink" not in smooth.explain()


@pytest.mark.parametrize("backend", ["numba", "jax"])
def test_what_is_below_rounding_where_a_step_begins(backend):
    """tanh(50 (t - 1)) is -1 with all its derivatives 0 up to t = 0.6."""
    model = da.compile_model(pushed((1 + sp.tanh(50 * (t - 1))) / 2), backend=backend)
    assert "taylor" in model.methods and "auto leaves power series aside: tanh" in model.explain()
    assert model._method("auto", 1e-8, 1e-10, many=True) != "taylor"
    if backend == "jax":
        return
    exact = (3 + (np.logaddexp(100, -100) - np.logaddexp(50, -50)) / 50) / 2
    for runs in (model.simulate, model.sweep):
        done = runs((0, 3), {"x": 0, "x_dot": 0}, {})
        assert done["x_dot"][-1] == pytest.approx(exact, rel=1e-6) and done.stats.method != "taylor"


def test_powers_written_as_decimals_are_powers():
    """x**2.0 has a power series where x is zero, too."""
    x = dynamicsymbols("x")
    run = da.compile_model(pushed(-(x**2.0) - x**3.0)).simulate((0, 1), {"x": 0, "x_dot": 0.3}, {}, rtol=1e-10)
    same = da.compile_model(pushed(-(x**2) - x**3)).simulate((0, 1), {"x": 0, "x_dot": 0.3}, {}, rtol=1e-10)
    np.testing.assert_array_equal(run.q, same.q)
    assert run.success and run.stats.method == "taylor"
