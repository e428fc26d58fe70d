"""Kinks and jumps of the state: passages so slow or so short that they lie between the points of a step."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from system.test_kinks import pushed
from system.test_vanishing_lengths import exact

x, y, z = dynamicsymbols("x y z")
e = sp.Symbol("e", positive=True)
v = x.diff()

SPRINGS = {
    "sign": -(sp.Abs(x) - sp.S.Half) * sp.sign(x),
    "Piecewise": sp.Piecewise((-(x - sp.S.Half), x > 0), (-(x + sp.S.Half), True)),
    "Heaviside": -(x - sp.S.Half) - sp.Heaviside(-x, 0),
}


@pytest.mark.parametrize("spring", SPRINGS)
def test_slow_passages(spring):
    """A spring whose force turns round at x = 0, where the motion turns back soon after; an unstable place."""
    model = da.compile_model(pushed(SPRINGS[spring]))
    for method in ("taylor", "dop853", "tsit5", "radau"):
        for rtol in (1e-5, 1e-7, 1e-9, 1e-11):
            for speed in [1e-4, *np.geomspace(1e-3, 0.3, 20)]:
                if method != "taylor" and speed**2 < rtol:  # shallower than the tolerance
                    continue
                if method == "radau" and rtol < 1e-9:
                    continue
                run = model.simulate((0, 6), {"x": 1.0, "x_dot": -speed}, {}, method=method, rtol=rtol, atol=rtol / 100)
                allowed = 100 * rtol * max(1.0, 0.01 / speed)
                assert run.success
                np.testing.assert_allclose(
                    run["x"], exact(run.t, speed), rtol=0, atol=allowed, err_msg=f"{method} {rtol} {speed}"
                )


def gate(push):
    """An oscillator y, and a particle that is pushed while y or its rate is nearly 1."""
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("gate", frame=N, origin=O, coordinates=[y, z])
    first, second = O.locatenew("A", y * N.x), O.locatenew("B", z * N.y)
    scene.add_bodies(Particle("a", first, 1), Particle("b", second, 1))
    scene.add_loads((first, -y * N.x), (second, push * N.y))
    return scene


def width(depth):
    return 2 * np.arccos(1 - depth)


def area(depth):
    """The integral of max(0, cos(s) - 1 + depth) / depth; the difference of two nearly equal numbers below."""
    half = np.arccos(1 - depth)
    return np.where(depth > 1e-5, 2 * (np.sin(half) - (1 - depth) * half) / depth, 4 / 3 * half)


GATES = {
    "Heaviside": (lambda g: sp.Heaviside(g, 0), width),
    "sign": (lambda g: (1 + sp.sign(g)) / 2, width),
    "Piecewise": (lambda g: sp.Piecewise((1, sp.And(g > 0, z < 1e9)), (0, True)), width),
    "floor": (lambda g: 1 + sp.floor(g / 10), width),
    "Max": (lambda g: sp.Max(0, g) / e, area),
    "Min": (lambda g: -sp.Min(0, -g) / e, area),
    "Abs": (lambda g: (g + sp.Abs(g)) / 2 / e, area),
}
DEPTHS = np.geomspace(1e-7, 0.1, 19)
PHASES = 1.0 + 0.21 * np.arange(19)


def check_gate(model, of_rate, method, rtol, impulse, **options):
    """Compare the speed that three passages leave, of cases with many depths and phases."""
    deep = DEPTHS > (1 if method == "taylor" else 10) * rtol
    depths, phases = DEPTHS[deep], PHASES[deep]
    start = {"y": np.cos(phases), "y_dot": np.sin(phases), "z": 0.0, "z_dot": 0.0}
    if of_rate:
        start |= {"y": -np.sin(phases), "y_dot": np.cos(phases)}
    end = 20.0
    passages = sum((phases + 2 * np.pi * k > 0.5) & (phases + 2 * np.pi * k < end - 0.5) for k in range(5))
    whole = np.all([np.abs(phases + 2 * np.pi * k - end) > 0.5 for k in range(5)], axis=0)
    sweep = model.sweep((0, end), start, {"e": depths}, method=method, rtol=rtol, atol=rtol / 100, **options)
    assert sweep.success.all()
    expected = passages * impulse(depths)
    at_kinks = 300 if method == "taylor" else 10_000  # pairs may pass one with an error of some thousand tolerances
    allowed = rtol * (at_kinks + 100 / np.sqrt(2 * depths))
    error = np.abs(sweep["z_dot"] - expected)[whole]
    assert (error < allowed[whole]).all(), (method, rtol, error / allowed[whole])
    return sweep


@pytest.mark.parametrize("of_rate", [False, True])
@pytest.mark.parametrize("name", GATES)
def test_short_passages(name, of_rate):
    """Of a coordinate and of a rate, in sweeps by the loop over lanes."""
    push, impulse = GATES[name]
    model = da.compile_model(gate(push((y.diff() if of_rate else y) - 1 + e)))
    for method in ("taylor", "dop853", "tsit5"):
        for rtol in (1e-5, 1e-7, 1e-9):
            check_gate(model, of_rate, method, rtol, impulse)


@pytest.mark.parametrize("backend, method", [("numpy", "dop853"), ("jax", "tsit5")])
def test_short_passages_on_other_backends(backend, method):
    if backend == "jax":
        pytest.importorskip("jax")
    model = da.compile_model(gate(sp.Heaviside(y - 1 + e, 0)), backend=backend)
    start = {"y": np.cos(1.3), "y_dot": np.sin(1.3), "z": 0.0, "z_dot": 0.0}
    for depth in (1e-2, 1e-4):
        run = model.simulate((0, 8), start, {"e": depth}, method=method, rtol=1e-7, atol=1e-9)
        assert run["z_dot"][-1] == pytest.approx(2 * width(depth), abs=1e-4)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_short_passages_backwards(method):
    model = da.compile_model(gate(sp.Heaviside(y - 1 + e, 0)))
    start = {"y": np.cos(1.3), "y_dot": -np.sin(1.3), "z": 0.0, "z_dot": 0.0}
    run = model.simulate((0, -8), start, {"e": 1e-3}, method=method, rtol=1e-7, atol=1e-9)
    assert run["z_dot"][-1] == pytest.approx(-2 * width(1e-3), abs=1e-4)


def test_power_series_need_few_steps_at_kinks():
    saturated = da.compile_model(pushed(-sp.Max(-1, sp.Min(1, 5 * x))))
    run = saturated.simulate((0, 20), {"x": 2, "x_dot": 0}, {}, method="taylor", rtol=1e-8)
    fine = saturated.simulate((0, 20), {"x": 2, "x_dot": 0}, {}, method="dop853", rtol=1e-12, max_step=0.01)
    assert run.success and run.stats.steps < 30
    np.testing.assert_allclose(run.q[-1], fine.q[-1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
@pytest.mark.parametrize(
    "force, place", [(sp.Max(0, x), 0.0), (-sp.sign(x), 0.0), (-v - sp.Heaviside(x - 100, 0), 1.0)]
)
def test_rest_at_a_jump_and_far_from_one_costs_nothing(force, place, method):
    run = da.compile_model(pushed(force)).simulate((0, 20), {"x": place, "x_dot": 0}, {}, method=method)
    assert run.success and run["x"][-1] == place and run.stats.steps < 15


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_dry_friction_by_a_sign_goes_on(method):
    """Steps that a jump cuts do not become shorter and shorter where the motion sticks to it."""
    model = da.compile_model(pushed(-x - v / 5 - sp.sign(v) / 5))
    run = model.simulate((0, 12), {"x": 1, "x_dot": 0}, {}, method=method, rtol=1e-3, atol=1e-5, max_steps=400_000)
    assert run.success and abs(run["x"][-1]) < 0.21 and abs(run["x_dot"][-1]) < 1e-2


@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_decay_towards_a_kink_has_no_limits(method):
    """A coordinate that only comes near zero: steps are as long as without the kink."""
    steps = []
    for kink in (sp.Abs(x), 1):
        model = da.compile_model(pushed(-1001 * v - 1000 * x - sp.Rational(1, 100) * kink * x))
        run = model.simulate((0, 20), {"x": 1, "x_dot": -1}, {}, method=method, rtol=1e-5, atol=1e-7)
        steps.append(run.stats.steps)
    assert run.success and steps[0] < 1.2 * steps[1]


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_short_passages_of_runs_with_derivatives(method):
    """The variational program has the limits of the model: the impulse b times the area, and its derivative by b."""
    b = sp.Symbol("b", positive=True)
    model = da.compile_model(gate(b * sp.Max(0, y - 1 + e) / e))
    for depth in (1e-3, 1e-5):
        for phase in np.linspace(1, 5, 6):
            start = {"y": np.cos(phase), "y_dot": np.sin(phase), "z": 0.0, "z_dot": 0.0}
            options = {"method": method, "rtol": 1e-7, "atol": 1e-9}
            found = model.sensitivity((0, phase + 1), start, {"e": depth, "b": 2.0}, wrt=["b"], **options)
            assert found["z_dot"][-1] == pytest.approx(2 * area(depth), abs=1e-3)
            assert found.jacobian("z_dot", "b")[-1] == pytest.approx(area(depth), abs=1e-3)
