"""Forces that are nothing where a step begins and large within it: power series do not see them, and steps look."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm.backend import LLVMLibrary
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.transforms.lower_kernels import lower_kernel
from dalembert.transforms.taylor.nonsmooth import LEAST_INVERSE, LEAST_POWER, nonanalytic_operations
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import order_for, step_kernel
from hard_cases.contacts import table_oscillator

pytestmark = pytest.mark.usefixtures("quick_xla")

x, t = dynamicsymbols("x"), dynamicsymbols._t
v = x.diff()
LATE = (1 + sp.tanh(50 * (t - 1))) / 2
PULSE = sp.exp(-50 * (t - sp.Rational(3, 2)) ** 2)


def step_up(width):
    """Return the speed that 1/(1 + exp(-(t - 1)/width)) gives up to t = 3."""
    return width * (np.logaddexp(0, 2 / width) - np.logaddexp(0, -1 / width))


def _cosines(power, end):
    """Return the integral of cos(t)**power, an even one, from 0 on: cos = (e^(it) + e^(-it))/2."""
    terms = (math.comb(power, k) * np.sinc((power - 2 * k) * end / np.pi) * end for k in range(power + 1))
    return sum(terms) / 2**power


# force, x and v at the start, the end, and the speed there; where it is not in closed form, by DOP853 at 1e-13
CASES = {
    "step in time": (LATE, 0, 0, 3, step_up(0.01)),
    "logistic": (1 / (1 + sp.exp(-200 * (t - 1))), 0, 0, 3, step_up(0.005)),
    "pulse in time": (PULSE, 0, 0, 3, math.sqrt(math.pi / 50) * math.erf(1.5 * math.sqrt(50))),
    "pulse in a long time": (PULSE, 0, 0, 100, math.sqrt(math.pi / 50)),
    "high power of a cosine": (sp.cos(t) ** 40, 0, 0, 7, _cosines(40, 7.0)),
    "high power of time": (t**25, 0, 0, 1.5, 1.5**26 / 26),
    "friction with a spring": (-x - 0.3 * sp.tanh(100 * v), 2, 0.5, 6, 0.5494949983658),
    "friction": (-0.3 * sp.tanh(100 * v) - x / 10, 0, 3, 6, -0.7410072803906),
    "wall": (-1 + sp.exp(-100 * x), 1, 0, 6, -0.1743068894213),
    "hill": (-5 / sp.cosh(10 * x) ** 2, -3, 1, 6, -1.0),
    "hill of a high negative power": (0.5 * (0.04 / (x**2 + 0.04)) ** 10, -2, 1, 4, 1.056662009812),
}
METHODS = ("auto", "taylor")


def scene(force):
    """A particle of mass 1 on a line, under a force."""
    N, O = ReferenceFrame("N"), Point("O")
    made = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    made.add_bodies(Particle("body", place, 1))
    made.add_loads((place, force * N.x))
    return made


def check(model, name, method, rtol):
    """Check a run, and a sweep of as many cases as fill a pack and more."""
    _, place, speed, end, exact = CASES[name]
    given = {"method": method, "rtol": rtol, "atol": rtol / 100}
    run = model.simulate((0, end), {"x": place, "x_dot": speed}, {}, **given)
    assert run.success and run["x_dot"][-1] == pytest.approx(exact, abs=10 * rtol * max(1, abs(exact)))
    sweep = model.sweep((0, end), {"x": np.full(9, float(place)), "x_dot": speed}, {}, **given)
    np.testing.assert_allclose(sweep["x_dot"], exact, rtol=0, atol=10 * rtol * max(1, abs(exact)))
    return run


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_right(name):
    model = da.compile_model(scene(CASES[name][0]), backend="llvm")
    for rtol in (1e-6, 1e-10):
        runs = [check(model, name, method, rtol) for method in METHODS]
    assert runs[0].stats.steps < 400 and runs[1].stats.method == "taylor"


@pytest.mark.parametrize(
    "name, tolerances", [("pulse in time", (1e-6, 1e-10)), ("high power of a cosine", [1e-6]), ("friction", [1e-10])]
)
def test_numbers_of_jax_are_right(name, tolerances):
    model = da.compile_model(scene(CASES[name][0]), backend="jax")
    for rtol in tolerances:
        check(model, name, "taylor", rtol)
    assert model.choose_method("auto", 1e-6, 1e-8, many=True) == "taylor"


def test_prepared_runs_and_runs_back():
    model = da.compile_model(scene(CASES["pulse in time"][0]), backend="llvm")
    exact = CASES["pulse in time"][-1]
    ends = model.prepare((0, 3), method="taylor")
    for _ in range(2):  # what one run leaves behind is nothing to the next
        assert ends(np.zeros(2), np.zeros(0))[1] == pytest.approx(exact, rel=1e-7)
    back = model.simulate((3, 0), {"x": 0, "x_dot": 0}, {}, method="taylor")
    assert back["x_dot"][-1] == pytest.approx(-exact, rel=1e-7)


def test_cases_of_a_sweep_know_nothing_of_those_before():
    """More cases than lanes, after others with other steps: all to the bit as if alone."""
    a = sp.Symbol("a", positive=True)
    model = da.compile_model(scene(sp.exp(-50 * (t - a) ** 2)), backend="llvm")
    places = np.linspace(0.5, 2.5, 37)
    together = model.sweep((0, 3), {"x": 0, "x_dot": 0}, {"a": places}, method="taylor")
    for i in (0, 17, 36):
        alone = model.sweep((0, 3), {"x": 0, "x_dot": 0}, {"a": places[i : i + 1]}, method="taylor")
        assert alone["x_dot"][0] == together["x_dot"][i]
    inside = [math.erf((3 - p) * math.sqrt(50)) + math.erf(p * math.sqrt(50)) for p in places]
    np.testing.assert_allclose(together["x_dot"], np.sqrt(np.pi / 200) * np.array(inside), atol=1e-7)


def test_where_the_series_tells_all_the_control_changes_nothing():
    """A force that decays slowly: as many steps with the control as without, but for the first ones."""
    kernel = da.compile_model(scene(-x + sp.exp(-t / 5)), backend="numpy").stages.program.kernel("rhs")
    looking = recurrences(kernel)
    assert looking.controlled
    blind = replace(looking, controlled=(), step_growth_limited=False)
    for order in (10, 13, 17):
        texts = [step_kernel(known, order, dense=False) for known in (looking, blind)]
        steps = [walked(step, [1.0, 0.0], 20.0) for step in texts]
        assert steps[1] <= steps[0] <= steps[1] + 8


def walked(step, y, end):
    """Return how many steps lead to the end."""
    now, before, count = 0.0, 0.0, 0
    while now < end:
        out = interpret(step, {"t": now, "y": [*y, before], "c": [], "s": [end - now, 1.0, 1e-2]})
        y, before = out[:2], out[2]
        now, count = now + before if before < end - now else end, count + 1
    return count


PLAIN = {
    "sine": lambda g, x, t: g.sin(x) * g.cos(t),
    "quotient": lambda g, x, t: x / (1 + x * x),
    "root": lambda g, x, t: g.call("sqrt", 1 + x * x * t),
    "low powers": lambda g, x, t: g.power(x, LEAST_POWER - 1) + 1 / g.power(t, LEAST_INVERSE - 1),
    "many factors": lambda g, x, t: g.sin(x) * g.cos(x) * g.sin(t) * g.cos(t) * x * t * x,
    "a fraction of a power": lambda g, x, t: g.call("pow", x, g.node(1.5)),
    "gravity": lambda g, x, t: x / g.call("sqrt", g.power(1 + x * x, 3)),
    "a constant": lambda g, x, t: x * g.call("exp", g.input("c0")) * g.call("abs", g.input("c0")),
}
STEEP = {
    "exp": lambda g, x, t: g.call("exp", x),
    "tanh": lambda g, x, t: g.call("tanh", t),
    "abs": lambda g, x, t: g.call("abs", x),
    "select": lambda g, x, t: g.call("select", g.call("less", x, t), x, t),
    "high power": lambda g, x, t: g.power(g.sin(x), LEAST_POWER),
    "inverse power": lambda g, x, t: 1 / g.power(x, LEAST_INVERSE),
    "inverse power of a distance": lambda g, x, t: x / g.call("sqrt", g.power(1 + x * x, LEAST_INVERSE)),
    "nested powers": lambda g, x, t: g.power(1 / (g.power(1 + x * x, 3)), 2),
    "power by a parameter": lambda g, x, t: g.call("pow", x, g.input("c0")),
    "power by the state": lambda g, x, t: g.call("pow", g.input("c0"), x),
}


def kernel_of(make):
    graph = Graph()
    q, time, c = graph.input("x"), graph.input("t"), graph.input("c0")
    inputs = {q: ("y", 0), time: ("t", None), c: ("c", 0)}
    return lower_kernel(graph, "rhs", [make(graph, q, time)], inputs, arguments=("t", "y", "c"))


def repelling(power):
    """A particle in a plane that is pushed away from the origin."""
    N, O = ReferenceFrame("N"), Point("O")
    y = dynamicsymbols("y")
    made = da.Scene("repelled", frame=N, origin=O, coordinates=[x, y])
    place = O.locatenew("P", x * N.x + y * N.y)
    made.add_bodies(Particle("body", place, 1))
    made.add_loads((place, sp.sqrt(x**2 + y**2) ** (-power - 1) * place.pos_from(O)))
    return made


@pytest.mark.parametrize("power", [5, 7, 13])
def test_what_is_far_away_is_not_passed_over(power):
    """From 1e4 times the shortest distance, where the force is 1e-20 to 1e-52: energy and angular momentum are kept."""
    model = da.compile_model(repelling(power), backend="llvm")
    start = {"x": -1e4, "y": 0.5, "x_dot": 1, "y_dot": 0}
    for run in (model.simulate((0, 2e4), start, {}), model.sweep((0, 2e4), start, {})):
        x1, y1, vx, vy = (float(np.ravel(run[name])[-1]) for name in ("x", "y", "x_dot", "y_dot"))
        assert run.stats.method == "taylor" and run.stats.steps < 150
        assert vx < 0.5 and np.hypot(vx, vy) == pytest.approx(1, abs=1e-6)
        assert x1 * vy - y1 * vx == pytest.approx(-0.5, abs=1e-8 * 2e4)


def test_a_pulse_lets_go_what_sticks():
    """While the block rests, no rate depends on the pulse, and steps do not grow at once all the same."""
    k = sp.Symbol("k", positive=True)
    model = da.compile_model(table_oscillator(lambda q: -k * q + 30 * sp.exp(-200 * (t - 2) ** 2)))
    start, p = {"x": 0.9, "x_dot": 0}, {"g": 9.81, "k": 4, "m": 1, "mu": 0.3}
    exact = model.simulate((0, 5), start, p, method="dop853", rtol=1e-12, atol=1e-13, max_step=0.01)
    assert len(exact.phases) == 5
    for method in METHODS:
        run = model.simulate((0, 5), start, p, method=method)
        sweep = model.sweep((0, 5), start, p, method=method)
        assert run["x"][-1] == pytest.approx(exact["x"][-1], abs=1e-7)
        assert float(np.ravel(sweep["x"])[0]) == pytest.approx(exact["x"][-1], abs=1e-7)


@pytest.mark.parametrize("name", PLAIN)
def test_what_a_series_tells_is_let_alone(name):
    kernel = kernel_of(PLAIN[name])
    assert not nonanalytic_operations(kernel) and not recurrences(kernel).controlled
    step = step_kernel(recurrences(kernel), 13, dense=True)
    assert all(load.target != "previous_" for load in step.loads)


@pytest.mark.parametrize("name", STEEP)
def test_what_a_series_may_not_tell_is_found(name):
    kernel = kernel_of(STEEP[name])
    known = recurrences(kernel)
    assert nonanalytic_operations(kernel)
    if name in ("abs", "select"):  # steps end at their zeros, and need no control
        assert known.switches and not known.controlled and not known.hidden
    else:
        assert known.controlled == (0,)


def test_a_switch_that_depends_on_what_a_series_may_not_tell_is_left_to_the_control():
    for make in (
        lambda g, x, t: g.call("sign", g.call("tanh", x) - 0.5) + g.call("abs", x),
        lambda g, x, t: g.call("select", x, x * t, g.call("abs", x)),  # a condition that is no decision
    ):
        known = recurrences(kernel_of(make))
        assert [switch.line.op for switch in known.switches] == ["abs"] and known.controlled == (0,)


@pytest.mark.parametrize("name", da.scenes.ALL)
def test_ready_scenes_have_no_control(name):
    model = da.compile_model(da.scenes.ALL[name](), backend="numpy")
    library = LLVMLibrary(model.stages.program, None)
    assert library.control(order_for(1e-8)) == (0, 0) and not library.nonsmooth
    assert "previous_" not in library.source("taylor", order_for(1e-8))
    assert "defect" not in model.explain()


def test_only_rates_that_need_it_are_looked_at():
    """The rate of the place is the speed: its series tells all."""
    program = da.compile_model(scene(LATE), backend="numpy").stages.program
    assert recurrences(program.kernel("rhs")).controlled == (program.layout.state.index("x_dot"),)


def test_explanation():
    text = da.compile_model(scene(LATE + sp.cos(t) ** 40), backend="llvm").explain()
    assert "high powers" in text and "tanh" in text and "taylor checks the residual of its steps" in text


SMOOTH = {
    "root": lambda v, eps: v / sp.sqrt(v**2 + eps**2),
    "arctangent": lambda v, eps: 2 / sp.pi * sp.atan(v / eps),
    "tanh": lambda v, eps: sp.tanh(v / eps),
}


@pytest.mark.parametrize("eps", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("law", SMOOTH)
@pytest.mark.parametrize("number", [True, False])
def test_a_smooth_law_of_friction_stops_a_block(law, eps, number):
    """Taylor steps passed its rest as if it slid on: 1 cm off, with SUCCESS, from eps = 1e-4 on."""
    width = sp.Symbol("eps", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x])
    block = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("block", block, 1))
    scene.add_loads((block, -3 * SMOOTH[law](v, eps if number else width) * N.x))
    model = da.compile_model(scene)
    for rtol in (1e-4, 1e-6, 1e-8):
        p = {} if number else {width: eps}
        run = model.simulate((0, 1 + 20 * eps), {x: 0, v: 3}, p, method="taylor", rtol=rtol, max_steps=10**5)
        way = _way(law, eps)
        assert run.success and abs(run["x_dot"][-1]) < 2 * eps
        assert abs(run["x"][-1] - way) < 30 * rtol + 1e-9, (rtol, run["x"][-1] - way)


def _way(law, eps):
    """Return how far a block of unit mass slides from 3 m/s under a smooth law of 3 N, by energy: v dv / F(v)."""
    force = {
        "root": lambda v: v / np.hypot(v, eps),
        "arctangent": lambda v: 2 / np.pi * np.arctan(v / eps),
        "tanh": lambda v: np.tanh(v / eps),
    }[law]
    edges = np.concatenate([[1e-9 * eps], np.geomspace(1e-3 * eps, 3.0, 60)])
    parts = [quad(lambda v: v / (3 * force(v)), a, b, epsabs=0, epsrel=1e-11)[0] for a, b in itertools.pairwise(edges)]
    return sum(parts)
