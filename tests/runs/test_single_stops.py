"""Stops of single runs, which their loops pass in place: records, laws called once, and precision."""

import math

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import ValueInputError
from dalembert.methods.status import Status
from dalembert.runs import segments
from stops.test_stops import START, TIGHT, TIMES, e, of_case, pendulum, record_of, w

t = dynamicsymbols._t
x, u = dynamicsymbols("x u")
m, T = sp.symbols("m T", positive=True)
METHODS = ["taylor", "dop853", "tsit5", "radau"]


@pytest.fixture
def in_place(monkeypatch):
    """No run is integrated piece by piece."""

    def refuse(*arguments, **options):
        raise AssertionError("a run was cut")

    monkeypatch.setattr(segments, "in_pieces", refuse)


def cart(force, *controllers, backend="llvm"):
    """Return a particle on a line, with a force."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_inputs(u)
    scene.add_loads((P, force * N.x))
    scene.add_controllers(*controllers)
    return da.compile_model(scene, backend=backend)


@pytest.mark.parametrize(
    ("method", "formulation", "backend"),
    [
        *((method, "augmented", "llvm") for method in METHODS),
        ("taylor", "projected", "llvm"),
        ("radau", "ggl", "llvm"),
        ("dop853", "projected", "numba"),
    ],
)
def test_single_runs_end_where_prepared_ones_do(in_place, method, formulation, backend):
    model = pendulum(formulation, backend)
    for i in (0, 3):
        case = of_case(i)
        options = {"method": method, "inputs": record_of(i), **TIGHT}
        run = model.simulate((0, 3), START, case, **options)
        p = model.parameter_vector(case, inputs={w: 0.0})  # the run has its own
        last = model.prepare((0, 3), **options)(model.state(START, case, inputs={w: 0.0}), p)
        asked = model.simulate((0, 3), START, case, t_eval=TIMES, **options)
        bound = 1e-8 if formulation == "ggl" else 1e-9
        np.testing.assert_allclose(run.y[-1], last, rtol=0, atol=bound)
        for name in ("x", "x_dot"):
            between = 1e-7 if method == "radau" else 1e-8
            np.testing.assert_allclose(asked[name], run(TIMES)[name], rtol=0, atol=between)
        assert np.all(np.diff(run.t) > 0) and asked.t.tolist() == TIMES.tolist()


@pytest.mark.parametrize("method", METHODS)
def test_steps_and_requested_times_hold_what_follows_an_instant(in_place, method):
    model = cart(u - x, da.Controller("c", 0.5, inputs={u: t}))
    run = model.simulate((0, 2), {x: 1, x.diff(): 0}, {m: 1}, method=method, **TIGHT)
    asked = model.simulate((0, 2), {x: 1, x.diff(): 0}, {m: 1}, method=method, t_eval=[0, 0.5, 0.7, 1.5, 2], **TIGHT)
    for instant in (0.0, 0.5, 1.0, 1.5):
        (here,) = np.flatnonzero(run.t == instant)
        assert run["u"][here] == run(np.array([instant]))["u"][0] == instant
    before = np.nextafter([0.5, 1.0, 1.5, 2.0], 0.0)
    np.testing.assert_array_equal(run(before)["u"], [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_array_equal(asked["u"], [0.0, 0.5, 0.5, 1.5, 1.5])
    assert run["u"][-1] == 1.5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("span", [(0, 2), (2, 0)])
def test_prescribed_velocities_that_jump(in_place, method, span):
    N, O = ReferenceFrame("N"), Point("O")
    sway = sp.Piecewise((0, t < 1), (0.3 * (t - 1), True))
    hook = O.locatenew("hook", sway * N.x)
    bob = hook.locatenew("bob", sp.sin(x) * N.x - sp.cos(x) * N.y)
    scene = da.Scene("crane", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("bob", bob, m))
    scene.apply_uniform_gravity(-9.81 * N.y)
    run = da.compile_model(scene).simulate(span, {x: 0.4, x.diff(): 0}, {m: 1}, method=method, **TIGHT)
    (here,) = np.flatnonzero(run.t == 1.0)
    angle = run["x"][here]
    sides = run(np.array([np.nextafter(1.0, span[0]), np.nextafter(1.0, span[1])]))["x_dot"]
    assert abs(run["x_dot"][here] - sides[0]) < 1e-12  # accepted steps hold the state before
    np.testing.assert_allclose(sides[1] - sides[0], (span[0] - span[1]) / 2 * 0.3 * math.cos(angle), rtol=1e-9)


@pytest.mark.parametrize("method", ["auto", "taylor", "dop853", "radau"])
def test_a_law_in_python_is_called_once_an_instant(in_place, method):
    called = []

    def law(time, q, qdot, states, parameters):
        called.append((time, q[0], states["e"]))
        return [-q[0]], [states["e"] + 1.0]

    model = cart(u - 3e4 * x.diff(), da.Controller("c", T, states=[e], inputs=[u], function=law))
    start = {x: 1, x.diff(): 0, e: 0}
    run = model.simulate((0, 1), start, {m: 1, T: 0.25}, method=method, rtol=1e-6, atol=1e-8, max_steps=100_000)
    assert run.success and [time for time, _, _ in called] == [0.0, 0.25, 0.5, 0.75]
    assert [before for _, _, before in called] == [0.0, 1.0, 2.0, 3.0] and run["e"][-1] == 4.0
    for time, position, _ in called:
        assert run["x"][run.t == time] == position
    assert method != "auto" or run.stats.method == "radau"


def test_errors_of_laws_in_python_reach_the_caller(in_place):
    model = cart(u, da.Controller("c", 0.5, inputs=[u], function=lambda *given: ([1.0, 2.0], [])))
    for method in METHODS:
        with pytest.raises(ValueInputError, match="controller 'c' returned inputs"):
            model.simulate((0, 2), {x: 1, x.diff(): 0}, {m: 1}, method=method)


def test_laws_read_angles_that_have_wound_up(in_place):
    """The motion depends on the angle modulo a turn, the law does not."""
    model = cart(1e-9 * sp.sin(x) + u * 0, da.Controller("c", 1.0, inputs={u: x}))
    run = model.simulate((0, 1000.5), {x: 0, x.diff(): 50.0}, {m: 1}, method="taylor", max_step=0.5, **TIGHT)
    np.testing.assert_allclose(run["u"][-1], 50_000.0, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_no_law_acts_where_a_run_has_used_up_its_steps(in_place, method):
    model = cart(u, da.Controller("c", 1.0, inputs={u: t + 1}))
    run = model.simulate((0, 3), {x: 1, x.diff(): 0}, {m: 1}, method=method, max_step=0.25, **TIGHT)
    (here,) = np.flatnonzero(run.t == 1.0)
    most = int(here) + (0 if method == "taylor" else run.stats.rejected)
    cut = model.simulate((0, 3), {x: 1, x.diff(): 0}, {m: 1}, method=method, max_step=0.25, max_steps=most, **TIGHT)
    assert (cut.status, cut.t[-1], cut["u"][-1], run["u"][here]) == (Status.MAX_STEPS, 1.0, 1.0, 2.0)


def test_sums_keep_their_digits_across_stops():
    """What is not set at a stop keeps what rounding took from it."""
    model = cart(u, da.Controller("c", 0.1, inputs={u: 0 * x}))
    run = model.simulate((0, 2000), {x: 0, x.diff(): 0.1}, {m: 1}, method="taylor", dense=False, max_steps=100_000)
    exact = 0.1 * run.t
    assert run.stats.steps == 20_000 and np.max(np.abs(run["x"] - exact) / np.spacing(exact + 1e-9)) <= 2.0


def test_knots_conditions_and_instants_at_one_time(in_place):
    """All three change what follows, in every method alike."""
    force = u + w + sp.Piecewise((0, t < 1), (3, True))
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_inputs(u, w)
    scene.add_loads((P, force * N.x))
    scene.add_controllers(da.Controller("c", 1, inputs={u: x.diff()}))
    model, record = da.compile_model(scene), {w: da.samples([0, 1, 2], [0.5, 2.0, 2.0], "hold")}
    for method in METHODS:
        run = model.simulate((0, 2), {x: 0, x.diff(): 1}, {m: 1}, inputs=record, method=method, **TIGHT)
        # a = 1 + 0.5 up to 1, then 2.5 + 2 + 3
        np.testing.assert_allclose([run["x_dot"][-1], run["x"][-1]], [10.0, 1.75 + 2.5 + 3.75], rtol=1e-9)
        assert run["u"][-1] == pytest.approx(2.5, rel=1e-12)
