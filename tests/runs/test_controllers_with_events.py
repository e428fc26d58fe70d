"""Events and reductions of runs with sampled controllers: sweeps find what single runs find, in the compiled loops."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import step_blocks
from dalembert.methods.status import Status

t = dynamicsymbols._t
x, u, e = dynamicsymbols("x u e")
m, c, T, r, k_p, k_i, k_d = sp.symbols("m c T r k_p k_i k_d", positive=True)
START = {x: 0.1, x.diff(): 0, e: 0.2}
COUNT = 13
CASES = {
    **{m: 2, c: 0.5, r: 1, k_i: 1, k_d: 6},
    **{k_p: np.linspace(4, 12, COUNT), T: np.linspace(0.04, 0.15, COUNT)},
}
EVENTS = [
    da.Event(x - sp.Rational(1, 2), name="half"),
    da.Event(u - 1, name="low"),  # jumps at instants
    da.Event(x.diff(), name="turn", terminal=3),
    da.Event(x - sp.Rational(9, 10), name="wall", direction=1, apply={x.diff(): -x.diff() / 2}),
]
REDUCED = {
    **{"top": da.maximum(u), "low": da.minimum(x.diff()), "mean": da.mean(x)},
    **{"first": da.first_crossing(x - 0.3), "end": da.final(e)},
}
TIGHT = {"rtol": 1e-11, "atol": 1e-13}


def cart(*controllers, force=u):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    if controllers:
        scene.add_inputs(u)
    scene.add_loads((P, (force - c * x.diff()) * N.x))
    scene.add_controllers(*controllers)
    return da.compile_model(scene)


@pytest.fixture(scope="module")
def model():
    laws = {"states": {e: e + T * (r - x)}, "inputs": {u: k_p * (r - x) + k_i * e - k_d * x.diff()}}
    return cart(da.Controller("pid", period=T, **laws))


@pytest.fixture
def compiled_only(monkeypatch):
    """Cases that are not left to single runs."""

    def refuse(*arguments):
        raise AssertionError("a case was run alone")

    monkeypatch.setattr(step_blocks, "watched_case", refuse)


def case(values, i):
    return {key: np.broadcast_to(value, COUNT)[i] for key, value in values.items()}


def assert_same_events(sweep, i, run, bound=1e-11):
    assert sweep.status[i] == run.status
    for name, found in run.events.items():
        assert sweep.events[name].count[i] == len(found.t), name
        ends = [found.t[0], found.t[-1]] if len(found.t) else [np.nan, np.nan]
        np.testing.assert_allclose([sweep.events[name].first[i], sweep.events[name].last[i]], ends, atol=bound)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_sweeps_are_single_runs(model, compiled_only, method):
    times = np.linspace(0, 5, 23)
    tolerances = {"rtol": 1e-9, "atol": 1e-11} if method == "tsit5" else TIGHT
    options = {"events": EVENTS, "method": method, **tolerances}
    ends = model.sweep((0, 5), START, CASES, **options)
    rows = model.sweep((0, 5), START, CASES, t_eval=times, **options)
    for i in range(COUNT):
        run = model.simulate((0, 5), START, case(CASES, i), **options)
        sampled = model.simulate((0, 5), START, case(CASES, i), t_eval=times, **options)
        assert_same_events(ends, i, run)
        assert_same_events(rows, i, sampled)
        # after an instant a sweep goes on with the size of its last step, a single run chooses one anew
        np.testing.assert_allclose(ends.y[i], run.y[-1], rtol=1e-9 if method == "tsit5" else 1e-11, atol=1e-11)
        for name in ("x", "x_dot", "u", "e"):
            np.testing.assert_allclose(rows[name][i, : len(sampled.t)], sampled[name], rtol=1e-9, atol=1e-10)
            assert np.all(np.isnan(rows[name][i, len(sampled.t) :]))


def test_a_case_has_the_bits_that_it_has_alone(model, compiled_only):
    options = {"events": EVENTS, "reduce": REDUCED, "t_eval": np.linspace(0, 5, 7), **TIGHT}

    def bits(sweep, i):
        found = [sweep.y[i], sweep.t[i], sweep["x"][i], *(sweep.reduced[name][i] for name in REDUCED)]
        found += [part[i] for events in sweep.events.values() for part in (events.count, events.first, events.last)]
        return [np.asarray(part).tobytes() for part in found]

    whole = model.sweep((0, 5), START, CASES, **options)
    for i in range(COUNT):
        alone = model.sweep((0, 5), START, {**case(CASES, i), T: [case(CASES, i)[T]]}, **options)
        assert bits(whole, i) == bits(alone, 0)


def test_reductions_are_those_of_the_whole_span(model, compiled_only):
    sweep = model.sweep((0, 3), START, CASES, reduce=REDUCED, **TIGHT)
    assert np.all(sweep.success)
    for i in range(0, COUNT, 4):
        run = model.simulate((0, 3), START, case(CASES, i), **TIGHT)
        crossing = model.simulate((0, 3), START, case(CASES, i), events=[x - 0.3], **TIGHT).events[x - 0.3].t[0]
        fine = run(np.linspace(0, 3, 20_001))
        found = {name: values[i] for name, values in sweep.reduced.items()}
        np.testing.assert_allclose(found["top"], run["u"].max(), rtol=1e-10)
        np.testing.assert_allclose(found["low"], fine["x_dot"].min(), atol=1e-6)
        np.testing.assert_allclose(found["mean"], np.trapezoid(fine["x"], fine.t) / 3, atol=1e-5)
        np.testing.assert_allclose(found["first"], crossing, atol=1e-11)
        np.testing.assert_allclose(found["end"], run["e"][-1], rtol=1e-10)


def test_a_controller_acts_before_an_event_at_its_instant(compiled_only):
    """The cart passes x = 1 at the instant t = 1, where the controller turns it round, or does not."""
    turn = sp.Symbol("turn")
    law = da.Controller("turn", period=1, inputs={u: sp.Piecewise((turn, t > 0.5), (0, True))})
    turning = cart(law, force=1000 * u)
    start = {x: 0, x.diff(): 1}
    values = {m: 1, c: 0, turn: np.array([0.0, -1.0, 1.0])}
    for expression, terminal in ((x - 1, False), (u, False), (x - 1, True)):
        event = da.Event(expression, name="there", terminal=terminal)
        sweep = turning.sweep((0, 2), start, values, events=[event], **TIGHT)
        for i in range(3):
            own = {**values, turn: values[turn][i]}
            assert_same_events(sweep, i, turning.simulate((0, 2), start, own, events=[event], **TIGHT), 1e-9)


def test_a_jump_at_an_instant_happens_once(model, compiled_only):
    kick = da.Event(t - sp.Rational(1, 2), name="kick", apply={x.diff(): x.diff() + 1})
    values = {**CASES, T: np.where(np.arange(COUNT) % 2, 0.1, 0.07)}
    sweep = model.sweep((0, 1), START, values, events=[kick], **TIGHT)
    np.testing.assert_array_equal(sweep.events["kick"].count, 1)
    for i in range(3):
        run = model.simulate((0, 1), START, case(values, i), events=[kick], **TIGHT)
        np.testing.assert_allclose(sweep.y[i], run.y[-1], atol=1e-11)


@pytest.mark.parametrize("period", [0.1, 0.07, 10.0])
def test_jumps_that_accumulate_do_so_across_instants(compiled_only, period):
    """A ball falls with the acceleration 1 and bounces ever lower: to rest at 3 sqrt(2), whatever the instants."""
    ball = cart(da.Controller("weight", period=T, inputs={u: -m}))
    bounce = da.Event(x, name="bounce", direction=-1, apply={x.diff(): -x.diff() / 2})
    values = {m: 1, c: 0, T: np.array([period, 1.3])}
    sweep = ball.sweep((0, 10), {x: 1, x.diff(): 0}, values, events=[bounce])
    for i in range(2):
        run = ball.simulate((0, 10), {x: 1, x.diff(): 0}, {**values, T: values[T][i]}, events=[bounce])
        assert_same_events(sweep, i, run, 1e-6)
        assert run.status is Status.EVENTS_ACCUMULATE and abs(sweep.t[i] - 3 * np.sqrt(2)) < 1e-3


def test_cases_that_fail_do_so_alone(compiled_only):
    period = sp.Symbol("period")
    model = cart(da.Controller("p", period=period, inputs={u: k_p * (r - x)}))
    values = {m: 2, c: 0.5, r: 1, k_p: np.array([3, 3, np.nan, 3, 3]), period: np.array([0.1, -1, 0.1, 0.1, 0.2])}
    start = {x: np.array([0, 0, 0, -1.0, 0]), x.diff(): 0}
    options = {"events": [da.Event(sp.sqrt(x + r / 2), name="root")], "reduce": {"top": da.maximum(x)}, **TIGHT}
    sweep = model.sweep((0, 1), start, values, **options)
    expected = [Status.SUCCESS, Status.NON_FINITE, Status.NON_FINITE, Status.EVENT_NON_FINITE, Status.SUCCESS]
    assert sweep.status.tolist() == expected
    assert np.array_equal(np.isfinite(sweep.reduced["top"]), sweep.success)
    short = model.sweep((0, 1), start, values, max_steps=4, **options)
    assert {Status(s) for s in short.status[[0, 4]]} == {Status.MAX_STEPS}


def test_conditions_on_time_are_searched_in_the_loops_too(compiled_only):
    """A push that begins and ends at times of each case."""
    first, last = sp.symbols("first last")
    pushed = cart(force=sp.Piecewise((1, (t > first) & (t < last)), (0, True)))
    values = {m: 1, c: 0.5, first: np.array([0.2, 0.7, 1.5]), last: np.array([0.4, 2.0, 1.6])}
    options = {"events": [x - 0.01, x.diff() - 0.09], **TIGHT}
    sweep = pushed.sweep((0, 3), {x: 0, x.diff(): 0}, values, **options)
    for i in range(3):
        own = {key: np.broadcast_to(value, 3)[i] for key, value in values.items()}
        run = pushed.simulate((0, 3), {x: 0, x.diff(): 0}, own, **options)
        assert all(len(found.t) for found in run.events.values())
        assert_same_events(sweep, i, run)
        np.testing.assert_allclose(sweep.y[i], run.y[-1], atol=1e-11)
