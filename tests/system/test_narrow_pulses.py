"""What depends on time alone and is over within milliseconds is not stepped over, however smooth it is."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.stops.breakpoints import break_times

t, x = dynamicsymbols._t, dynamicsymbols("x")
tp, w = sp.symbols("tp w")
WIDTH, END = 0.005, 3.0
TIMES = np.linspace(0.3, 2.7, 41)
REST = {"x": 0.0, "x_dot": 0.0}
u = (t - tp) / w

PULSES = {
    "Gaussian": sp.exp(-(u**2)),
    "derivative of a Gaussian": u * sp.exp(-(u**2)),
    "Gaussian of any size": sp.exp(60 - u**2) * sp.Float(1e-26),
    "Lorentzian": 1 / (1 + u**2),
    "third power of a Lorentzian": 1 / (1 + u**2) ** 3,
    "two smooth steps": sp.tanh(u) - sp.tanh(u - 10),
    "logistic steps": 1 / (1 + sp.exp(-u)) - 1 / (1 + sp.exp(9 - u)),
    "arc tangents": sp.atan(u) - sp.atan(u - 10),
    "flat top": 1 - sp.tanh(u**2),
    "algebraic steps": u / sp.sqrt(1 + u**2) - (u - 9) / sp.sqrt(1 + (u - 9) ** 2),
    "high power": sp.cos(sp.pi * (t - tp) / 3) ** 2000,
    "train of pulses": sp.exp(-((sp.sin(4 * (t - tp)) / w) ** 2)),
}


@cache
def model(name, backend="llvm", formulation="auto"):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene(f"at rest, {name}", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, 1))
    scene.add_loads((P, (PULSES[name] - x) * N.x))
    return da.compile_model(scene, backend=backend, formulation=formulation)


def exact(name, time, width=WIDTH):
    """Return the state at the end: the force times the response to an impulse, by the trapezoidal rule."""
    force = sp.lambdify(t, PULSES[name].xreplace({tp: sp.Float(time), w: sp.Float(width)}), "numpy")
    times = np.linspace(0.0, END, 300_001)
    with np.errstate(all="ignore"):
        return np.trapezoid(force(times) * np.sin(END - times), times)


@pytest.mark.parametrize("share", [0.5, 0.125, 0.8125])
def test_where_the_search_cuts_the_run(share):
    """There its place is found twice, from both sides."""
    run = model("Gaussian").simulate((0.0, END), REST, {tp: share * END, w: WIDTH})
    assert run["x"][-1] == pytest.approx(exact("Gaussian", share * END), abs=1e-7)


@pytest.mark.parametrize("name", PULSES)
def test_every_method_finds_it(name):
    for method in ("auto", "taylor", "dop853", "tsit5", "radau") if name == "Gaussian" else ("taylor", "dop853"):
        values = {tp: 1.234, w: WIDTH} if PULSES[name].has(w) else {tp: 1.234}
        run = model(name).simulate((0.0, END), REST, values, method=method)
        assert run.success and run["x"][-1] == pytest.approx(exact(name, 1.234), abs=1e-7), method


@pytest.mark.parametrize("name", ["Gaussian", "two smooth steps", "Lorentzian"])
def test_sweeps_find_it_in_every_case(name):
    sweep = model(name).sweep((0.0, END), REST, {tp: TIMES, w: WIDTH})
    assert np.all(sweep.success)
    np.testing.assert_allclose(sweep.final["x"], [exact(name, time) for time in TIMES], atol=1e-7)


def test_other_runs_and_backends_find_it():
    right = exact("Gaussian", 1.234)
    values = {tp: 1.234, w: WIDTH}
    own = model("Gaussian", "numpy")
    for method in own.methods:
        assert own.simulate((0.0, END), REST, values, method=method)["x"][-1] == pytest.approx(right, abs=1e-7)
    own = model("Gaussian", "llvm", "projected")
    assert own.simulate((0.0, END), REST, values)["x"][-1] == pytest.approx(right, abs=1e-7)
    backward = model("Gaussian").simulate((END, 0.0), REST, values)
    assert abs(backward["x"][-1] - WIDTH * np.sqrt(np.pi) * np.sin(1.234)) < 1e-6
    found = model("Gaussian").sensitivity((0.0, END), REST, values, of=[x], wrt=[tp])
    slope = (exact("Gaussian", 1.235) - exact("Gaussian", 1.233)) / 0.002
    assert found.jacobian(x, tp)[-1] == pytest.approx(slope, abs=1e-6)


@pytest.mark.usefixtures("quick_xla")
def test_jax_finds_it_and_traced_runs_have_no_further_parameter():
    jax = pytest.importorskip("jax")
    own, values = model("Gaussian", "jax"), {tp: 1.234, w: WIDTH}
    run = own.simulate((0.0, END), REST, values, method="taylor")
    assert run["x"][-1] == pytest.approx(exact("Gaussian", 1.234), abs=1e-7)
    assert set(own.layout.parameters) == {"tp", "w"}
    with jax.enable_x64(True):
        solve = own.solve_fn(("x", "x_dot"), method="tsit5", max_step=0.01)
        found = solve(np.array([0.0, END]), REST, {"tp": 1.234, "w": WIDTH})
    assert float(found.y[-1, 0]) == pytest.approx(exact("Gaussian", 1.234), abs=1e-6)


@pytest.mark.parametrize("width", [1e-3, 1e-5, 1e-8])
def test_its_width_does_not_matter(width):
    run = model("Gaussian").simulate((0.0, END), REST, {tp: 1.234, w: width}, rtol=1e-9, atol=1e-16)
    assert run["x"][-1] == pytest.approx(width * np.sqrt(np.pi) * np.sin(END - 1.234), rel=1e-5)


def test_what_is_not_narrow_makes_no_breaks():
    conditions = model("Gaussian").stages.program.conditions
    names = model("Gaussian").layout.parameters

    def breaks(width, end=END):
        values = {"tp": 1.234, "w": width}
        return break_times(conditions, np.array([values.get(name, 0.0) for name in names]), 0.0, end)

    assert len(breaks(0.5)) == 0 and len(breaks(0.01)) == 5 and len(breaks(0.5, 1000.0)) == 5
    assert len(breaks(0.01, 1.0)) == 0


@pytest.mark.parametrize(
    "force",
    [sp.exp(-t / 7), sp.exp(sp.sin(50 * t)), sp.exp(sp.sin(1 / (t + sp.Float(1e-9)))), 1 / (2 + sp.cos(30 * t))],
)
def test_what_is_smooth_is_left_alone(force):
    PULSES[str(force)] = force
    own = model(str(force))
    assert len(break_times(own.stages.program.conditions, np.zeros(1), 0.0, END)) == 0
