"""Events of single runs: every backend, method and formulation against closed forms."""

import functools

import mpmath
import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import ExpressionError, OptionError, UnknownNameError
from dalembert.methods.status import Status

time = dynamicsymbols._t
x, y, theta = dynamicsymbols("x y theta")
g, m, l = sp.symbols("g m l", positive=True)
pytestmark = pytest.mark.usefixtures("quick_xla")
FALL = {"g": 9.81, "m": 2.0}
SWING = {"g": 9.81, "m": 1.0, "l": 0.8}
METHODS = [
    (backend, method)
    for backend, methods in {
        "llvm": ("taylor", "dop853", "tsit5", "radau"),
        "numba": ("taylor", "dop853", "tsit5", "radau"),
        "numpy": ("dop853", "rk45", "radau", "bdf", "lsoda"),
        "jax": ("dopri8", "tsit5", "taylor", "kvaerno5"),
    }.items()
    for method in methods
]
RUNGE_KUTTA_OR_TAYLOR = [case for case in METHODS if case[1] not in ("bdf", "lsoda", "kvaerno5")]


def ball():
    frame, origin = ReferenceFrame("N"), Point("O")
    scene = da.Scene("ball", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("b", origin.locatenew("P", x * frame.x + y * frame.y), m))
    scene.apply_uniform_gravity(-g * frame.y)
    return scene


def pendulum():
    """A bob whose place follows from an angle, by constraints that one formulation eliminates and one projects."""
    frame, origin = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pendulum", frame=frame, origin=origin, coordinates=[theta, x, y])
    scene.add_bodies(Particle("b", origin.locatenew("P", x * frame.x + y * frame.y), m))
    scene.add_holonomic_constraints(x - l * sp.sin(theta), y + l * sp.cos(theta))
    scene.apply_uniform_gravity(-g * frame.y)
    return scene


@functools.cache
def model(build, backend="llvm", formulation="minimal"):
    if backend == "jax":
        pytest.importorskip("diffrax")
    return da.compile_model(build(), backend=backend, formulation=formulation)


def drop(events, *, backend="llvm", end=20.0, height=1.0, speed=1.0, **options):
    start = {x: 0.0, y: height, x.diff(): speed, y.diff(): 0.0}
    return model(ball, backend).simulate((0.0, end), start, FALL, events=events, **options)


def bounce(e, floor=0, direction=-1):
    return da.Event(y - floor, direction=direction, apply={y.diff(): -sp.Float(e) * y.diff()}, name="floor")


def bounces(e, count, height=1.0):
    """Times of the impacts of a ball dropped from rest."""
    fall = np.sqrt(2 * height / FALL["g"])
    return fall + 2 * fall * e * (1 - e ** np.arange(count)) / (1 - e)


def test_every_method_is_tested():
    assert {backend for backend, _ in METHODS} == set(BACKENDS)
    for backend in BACKENDS:
        assert set(model(ball, backend).methods) == {name for other, name in METHODS if other == backend}


# -- closed forms -------------------------------------------------------------------------


@pytest.mark.parametrize("backend, method", RUNGE_KUTTA_OR_TAYLOR)
@pytest.mark.parametrize("direction", [0, -1])
def test_bouncing_ball(backend, method, direction):
    e = 0.8
    run = drop([bounce(e, 0, direction), x - 1], backend=backend, method=method, end=3.0, rtol=1e-10, atol=1e-12)
    assert run.status is Status.SUCCESS and run.t[-1] == 3.0
    impacts = run.events["floor"]
    exact = bounces(e, 100)
    exact = exact[exact < 3.0]
    assert len(impacts) == len(exact) > 5
    np.testing.assert_allclose(impacts.t, exact, rtol=0, atol=1e-12)
    np.testing.assert_allclose(impacts.after["y_dot"], -e * impacts.before["y_dot"], rtol=1e-14)
    np.testing.assert_allclose(impacts["y"], 0.0, atol=1e-14)
    np.testing.assert_array_equal(impacts.direction, -1)
    np.testing.assert_allclose(run.events["x(t) - 1"].t, 1.0, atol=1e-12)
    highest = run(bounces(e, 3)[1:] - np.diff(bounces(e, 3)) / 2)["y"]
    np.testing.assert_allclose(highest, [e**2, e**4], atol=1e-11)
    twice = run.t[:-1][np.diff(run.t) == 0.0]
    np.testing.assert_array_equal(twice, impacts.t)


@pytest.mark.parametrize("backend, method", METHODS)
def test_pendulum_through_its_lowest_point(backend, method):
    modulus = mpmath.sin(mpmath.mpf("2.5") / 2)
    quarter = float(mpmath.ellipk(modulus**2) / mpmath.sqrt(mpmath.mpf("9.81") / mpmath.mpf("0.8")))
    tight = method not in ("radau", "bdf", "lsoda")
    options = {"rtol": 1e-11, "atol": 1e-12} if tight else {"rtol": 1e-9, "atol": 1e-9}
    for formulation in ("minimal", "projected"):
        if formulation == "projected" and (backend == "jax" or method in ("bdf", "lsoda")):
            continue
        swing = model(pendulum, backend, formulation)
        start = {theta: 2.5, theta.diff(): 0.0}
        run = swing.simulate((0.0, 5.0), start, SWING, method=method, events=["theta", "theta_dot"], **options)
        lowest = quarter * np.arange(1, 100, 2)
        turning = quarter * np.arange(2, 100, 2)
        tolerance = 1e-8 if tight else 1e-5
        np.testing.assert_allclose(run.events["theta"].t, lowest[lowest < 5.0], rtol=0, atol=tolerance)
        np.testing.assert_allclose(run.events["theta_dot"].t, turning[turning < 5.0], rtol=0, atol=tolerance)
        np.testing.assert_allclose(run.events["theta"]["theta"], 0.0, atol=1e-13)
        np.testing.assert_allclose(run.events["theta"]["x"], 0.0, atol=1e-13)
        np.testing.assert_array_equal(run.events["theta"].direction, np.resize([-1, 1], np.sum(lowest < 5.0)))


@pytest.mark.parametrize("backend, method", [("llvm", "taylor"), ("llvm", "dop853"), ("numpy", "radau")])
def test_many_crossings_within_one_step(backend, method):
    run = drop([sp.sin(50 * time), sp.sin(300 * x + 1)], backend=backend, method=method, end=2.0)
    exact = np.arange(1, 1 + np.floor(100 / np.pi)) * np.pi / 50
    found = run.events[0]
    assert len(found) > 10 * run.stats.steps or method != "taylor"
    np.testing.assert_allclose(found.t, exact, rtol=0, atol=2e-15)
    exact = (np.arange(1, 1 + np.floor(601 / np.pi)) * np.pi - 1) / 300
    np.testing.assert_allclose(run.events[1].t, exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("gap", [1e-2, 1e-5, 1e-7])
def test_two_zeros_close_together(gap):
    """The ball's top passes a line just below it."""
    start = {x: 0.0, y: 0.0, x.diff(): 0.0, y.diff(): 9.81}
    line = y - sp.Float(9.81 / 2 * (1 - gap**2))
    run = model(ball).simulate((0.0, 7.0), start, FALL, events=[line], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(run.events[0].t, [1 - gap, 1 + gap], atol=1e-15 / gap)
    np.testing.assert_array_equal(run.events[0].direction, [1, -1])
    missed = model(ball).simulate((0.0, 7.0), start, FALL, events=[y - sp.Float(9.81 / 2 * (1 + gap**2))])
    assert len(missed.events[0]) == 0


def test_touching_zero_is_no_crossing():
    run = drop([(time - sp.Rational(1, 3)) ** 2, (time - sp.Rational(1, 3)) ** 3], end=1.0)
    assert len(run.events[0]) == 0
    np.testing.assert_allclose(run.events[1].t, 1 / 3, atol=1e-5)


def test_poles_are_no_crossings():
    run = drop([1 / (time - sp.Float(0.123456789)), sp.tan(5 * time)], end=1.0)
    assert len(run.events[0]) == 0
    np.testing.assert_allclose(run.events[1].t, [np.pi / 5], atol=1e-15)


# -- what events do -----------------------------------------------------------------------


@pytest.mark.parametrize("direction, count", [(0, 4), (1, 2), (-1, 2)])
def test_direction(direction, count):
    run = drop([da.Event(sp.cos(2 * sp.pi * time), direction=direction)], end=2.0)
    (found,) = run.events.values()
    assert len(found) == count
    assert set(found.direction) <= ({1, -1} if direction == 0 else {direction})


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("terminal", [True, 1, 3])
def test_terminal(backend, terminal):
    run = drop([da.Event(sp.sin(7 * time + x), terminal=terminal, name="n"), y], backend=backend)
    assert run.status is Status.EVENT and run.success and "event" in run.message
    assert len(run.events["n"]) == terminal
    np.testing.assert_allclose(run.t[-1], terminal * np.pi / 8, atol=1e-13)
    assert run.t[-1] == run.events["n"].t[-1]
    np.testing.assert_array_equal(run.y[-1], run.events["n"].y[-1])
    assert len(run.events["y"]) == (run.t[-1] > bounces(0.5, 1)[0])


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("backend, method", [("llvm", "taylor"), ("llvm", "tsit5"), ("numpy", "dop853")])
def test_going_on_from_a_terminal_event_does_not_repeat_it(backend, method, formulation):
    swing = model(pendulum, backend, formulation)
    watch = [da.Event(theta - sp.Rational(1, 3), terminal=True), da.Event(x + y + sp.Rational(1, 7), terminal=True)]
    at, state, times = 0.0, {theta: 2.0, theta.diff(): 0.1}, []
    for _ in range(12):
        run = swing.simulate((at, 3.0), state, SWING, events=watch, method=method)
        if run.status is not Status.EVENT:
            break
        at, state = run.t[-1], {name: run[name][-1] for name in ("theta", "theta_dot", "x", "y", "x_dot", "y_dot")}
        times.append(at)
    whole = swing.simulate(
        (0.0, 3.0), {theta: 2.0, theta.diff(): 0.1}, SWING, method=method, events=[e.expression for e in watch]
    )
    expected = np.sort(np.concatenate([record.t for record in whole.events.values()]))
    assert len(expected) > 4
    np.testing.assert_allclose(times, expected, atol=1e-6)


@pytest.mark.parametrize("e, floor", [(0.7, 0), (0.7, 1), (0.05, 0), (0.05, 1), (1e-9, 0), (1e-9, 1)])
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_accumulation(e, floor, method):
    run = drop([bounce(e, floor)], method=method, height=1.0 + floor)
    assert run.status is Status.EVENTS_ACCUMULATE and not run.success and "accumulate" in run.message
    fall = np.sqrt(2 / FALL["g"])
    np.testing.assert_allclose(run.t[-1], fall + 2 * fall * e / (1 - e), atol=1e-6)
    np.testing.assert_allclose(run["y"][-1], floor, atol=1e-12)
    resolved = [k for k in range(3) if e ** (2 * k) > 1e-9]  # how high the ball was between; the floor is at 1
    np.testing.assert_allclose(run.events[0].t[resolved], bounces(e, 3)[resolved], atol=1e-12)


def test_jumps_of_the_angle_in_every_formulation():
    """A pendulum that hits a wall at its lowest point: the map is made consistent with the constraints."""
    hit = da.Event(
        theta,
        name="wall",
        apply={theta.diff(): -theta.diff() / 2, x.diff(): -x.diff() / 2, "y_dot": -y.diff() / 2},
    )
    for formulation in ("minimal", "projected"):
        run = model(pendulum, "llvm", formulation).simulate(
            (0.0, 2.0), {theta: 1.0, theta.diff(): 0.0}, SWING, events=[hit], rtol=1e-10
        )
        assert run.success and len(run.events["wall"]) > 1
        np.testing.assert_allclose(np.abs(run.constraint_violation).max(), 0.0, atol=1e-9)
        np.testing.assert_allclose(run.events["wall"].after["x_dot"], -run.events["wall"]["x_dot"] / 2, atol=1e-9)
        assert np.all(run["theta"] > -1e-12)


def test_a_jump_that_contradicts_the_constraints_is_a_status():
    hit = da.Event(theta, apply={theta.diff(): -theta.diff() / 2})
    run = model(pendulum, "llvm", "projected").simulate((0, 2), {theta: 1, theta.diff(): 0}, SWING, events=[hit])
    assert run.status is Status.EVENT_STATE and len(run.events[0]) == 1
    assert run.t[-1] == run.events[0].t[0]


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_events_at_one_time_happen_in_their_order(method):
    corner = [
        da.Event(y, direction=-1, apply={y.diff(): -y.diff()}, name="floor"),
        da.Event(time - sp.sqrt(2 / g), apply={x.diff(): -x.diff()}, name="clock"),
        da.Event("x", name="x"),
    ]
    run = drop(corner, end=1.2, method=method)
    assert run.success and [len(run.events[name]) for name in ("floor", "clock", "x")] == [1, 1, 1]
    np.testing.assert_allclose(run.events["x"].t, 2 * np.sqrt(2 / FALL["g"]), atol=1e-12)
    assert run["y"].min() > -1e-12


def test_start_and_end():
    run = drop([x, time - 1, "y_dot"], end=1.0)
    assert [len(record) for record in run.events.values()] == [0, 1, 0]
    assert run.events[1].t[0] == 1.0
    ended = drop([da.Event(x - 1, terminal=True)], end=1.0)
    assert ended.t[-1] == pytest.approx(1.0, abs=1e-15) and ended.status is Status.EVENT


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_backward_in_time(method):
    there = drop([x - sp.Rational(1, 3), y], end=1.0, method=method, rtol=1e-10)
    end = {name: there[name][-1] for name in ("x", "y", "x_dot", "y_dot")}
    back = model(ball).simulate(
        (1.0, 0.0),
        end,
        FALL,
        events=[x - sp.Rational(1, 3), "y", da.Event("y", direction=-1, name="d")],
        method=method,
        rtol=1e-10,
    )
    np.testing.assert_allclose(back.events[0].t, there.events[0].t, atol=1e-9)
    np.testing.assert_allclose(back.events[1].t, there.events[1].t, atol=1e-9)
    assert back.events[1].direction[0] == 1 and there.events[1].direction[0] == -1
    assert len(back.events["d"]) == 0


def test_times_to_record():
    times = np.array([0.0, 0.2, 0.3, 0.5, 1.0, 2.5])
    run = drop([bounce(0.9), da.Event(x - 2, terminal=True)], t_eval=times)
    every = drop([bounce(0.9), da.Event(x - 2, terminal=True)])
    np.testing.assert_array_equal(run.t, times[times <= 2.0])
    np.testing.assert_allclose(run.y, every(run.t).y, atol=1e-14)
    assert run.status is Status.EVENT and every.t[-1] == run.events[1].t[0]


def test_an_event_changes_no_step_of_the_taylor_method():
    plain, watched = drop([], end=3.0), drop([x - 1, y + 2], end=3.0)
    np.testing.assert_array_equal(plain.t, watched.t)
    np.testing.assert_array_equal(plain.y, watched.y)


def test_outputs_and_energies_by_name():
    lagged = da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["X", "Y"])
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    run = lagged.simulate((0, 5), start, {"m": 1, "b": 0.3, "I_C": 0.5}, events=["Y", da.Event("kinetic_energy")])
    fine = run(np.linspace(0, 5, 20001))
    at = np.flatnonzero(np.diff(np.sign(fine["Y"])) != 0)
    assert len(run.events["Y"]) == len(at) > 0
    np.testing.assert_allclose(run.events["Y"].t, fine.t[at], atol=5 / 20000)
    np.testing.assert_allclose(run.events["Y"]["Y"], 0.0, atol=1e-13)


def test_not_a_number_is_a_status():
    run = drop([sp.sqrt(1 - time) - sp.Rational(1, 2)], end=3.0)
    assert run.status is Status.EVENT_NON_FINITE and "expression of an event" in run.message
    np.testing.assert_allclose(run.events[0].t, 0.75, atol=1e-14)
    np.testing.assert_allclose(run.t[-1], 1.0, atol=1e-6)
    ended = drop([da.Event(sp.sqrt(1 - time) - sp.Rational(1, 2), terminal=True)], end=3.0)
    assert ended.status is Status.EVENT


# -- misuse -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "events, error, words",
    [
        (["z"], UnknownNameError, ["'z'", "Known"]),
        ([sp.Symbol("k") * x], UnknownNameError, ["'k'"]),
        ([dynamicsymbols("w")], ExpressionError, ["w(t)", "coordinate"]),
        ([g * m], ExpressionError, ["g*m", "constant"]),
        ([3], ExpressionError, ["constant"]),
        ([x, "x(t)"], OptionError, ["two events", "name="]),
        ([da.Event(x, apply={"z": 1})], UnknownNameError, ["'z'", "y_dot"]),
        ([da.Event(x, apply={g: 1})], UnknownNameError, ["'g'", "jump"]),
        ([da.Event(x, apply={y: sp.Symbol("k")})], UnknownNameError, ["'k'"]),
    ],
)
def test_errors_name_what_is_wrong(events, error, words):
    with pytest.raises(error) as caught:
        drop(events)
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize("options", [{"direction": 2}, {"terminal": -1}, {"terminal": 0.5}, {"apply": {}}])
def test_options_of_an_event_are_checked(options):
    with pytest.raises(OptionError, match=next(iter(options))):
        da.Event(x, **options)


def test_a_reaction_must_be_an_output():
    sleigh = da.compile_model(da.scenes.chaplygin_sleigh())
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    with pytest.raises(UnknownNameError, match="outputs="):
        sleigh.simulate((0, 1), start, {"m": 1, "b": 0.3, "I_C": 0.5}, events=["X"])


# -- expressions that jump at stops ---------------------------------------------------------


@functools.cache
def pushed(backend):
    """A bead on a line and an input, which hardly pushes it."""
    frame, origin, push = ReferenceFrame("N"), Point("O"), dynamicsymbols("push")
    place = origin.locatenew("P", x * frame.x)
    scene = da.Scene("pushed", frame=frame, origin=origin, coordinates=[x])
    scene.add_bodies(Particle("b", place, m))
    scene.add_loads((place, push / 1000 * frame.x))
    scene.add_inputs(push)
    return da.compile_model(scene, backend=backend), push


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize("speed", [0.1, -0.1])
@pytest.mark.parametrize("apply", [{x.diff(): -x.diff()}, {x: 0.0}, {x: x + 0.1}])
def test_a_sign_that_changes_at_a_stop_is_one_event(backend, speed, apply):
    """Before, the value behind the stop counted as what is left of a zero, and the map as a motion through it."""
    bead, push = pushed(backend)
    event = da.Event(x + push, name="changed", apply=apply)
    held = {push: da.samples([0.0, 1.0, 2.0], [1.0, -1.0, -1.0], kind="hold")}
    start = {x: 0.0, x.diff(): speed}
    run = bead.simulate((0, 1.8), start, {m: 1.0}, inputs=held, events=[event])
    np.testing.assert_array_equal(run.events["changed"].t, [1.0])
    assert run.status is Status.SUCCESS and run.t[-1] == 1.8
    assert run.events["changed"].direction == [-1] and np.sum(run.t == 1.0) >= 2
    sweep = bead.sweep((0, 1.8), start | {x: [0.0, 0.1]}, {m: 1.0}, inputs=held, events=[event])
    np.testing.assert_array_equal(sweep.events["changed"].count, [1, 1])
    assert np.all(sweep.status == Status.SUCCESS)


# -- motions that constraints prescribe -----------------------------------------------------


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_motion_without_a_state_is_watched_to_its_end(backend):
    """x = sin t whatever happens, so that no step is taken: events, means and extrema are found all the same."""
    x, N, O = dynamicsymbols("x"), ReferenceFrame("N"), Point("O")
    scene, P = da.Scene("driven", frame=N, origin=O, coordinates=[x]), O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("bead", P, m))
    scene.add_holonomic_constraints(x - sp.sin(time))
    driven = da.compile_model(scene, backend=backend)
    assert driven.layout.state == ()
    half = da.Event(x - sp.Rational(1, 2), name="half")
    run = driven.simulate((0, 20), {}, {m: 1}, events=[half])
    turns = 2 * np.pi * np.arange(4)
    expected = np.sort([*np.pi / 6 + turns, *5 * np.pi / 6 + turns])
    expected = expected[expected < 20]
    np.testing.assert_allclose(run.events["half"].t, expected, rtol=1e-13)
    assert run.t[-1] == 20 and run["x"][-1] == np.sin(20.0)
    kept = {"mean": da.mean(x), "top": da.maximum(x), "first": da.first_crossing(x + sp.Rational(1, 2))}
    sweep = driven.sweep((0, [2.0, 20.0]), {}, {m: 1}, events=[half], reduce=kept)
    np.testing.assert_array_equal(sweep.t, [2.0, 20.0])
    np.testing.assert_array_equal(sweep.events["half"].count, [1, len(expected)])
    np.testing.assert_allclose(sweep["x"], np.sin([2.0, 20.0]), rtol=1e-15)
    np.testing.assert_allclose(sweep.reduced["mean"], (1 - np.cos([2.0, 20.0])) / [2.0, 20.0], rtol=1e-11)
    np.testing.assert_allclose(sweep.reduced["top"], 1.0, rtol=1e-13)
    np.testing.assert_allclose(sweep.reduced["first"], [np.nan, 7 * np.pi / 6], rtol=1e-13)
    stopped = driven.simulate((0, 20), {}, {m: 1}, events=[da.Event(x + sp.Rational(1, 2), terminal=True)])
    assert stopped.status is Status.EVENT and stopped.t[-1] == pytest.approx(7 * np.pi / 6, rel=1e-13)
    assert driven.prepare((0, 1))(driven.state({}, {m: 1}), driven.parameter_vector({m: 1})).shape == (0,)


def test_a_python_function_is_no_event():
    with pytest.raises(ExpressionError, match="a Python function is not called: write it in the symbols of the scene"):
        drop([lambda t, y: y[0]])
