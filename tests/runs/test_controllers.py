"""Sampled controllers, against the closed form of sampled linear loops: a matrix exponential a period."""

import re

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import (
    CapabilityError,
    InitialStateError,
    OptionError,
    SceneError,
    UnknownNameError,
    ValueInputError,
)
from dalembert.methods.status import Status
from dalembert.reduction import FORMULATIONS

t = dynamicsymbols._t
x, y, u, v, e, f = dynamicsymbols("x y u v e f")
m, c, T, r, k_p, k_i, k_d = sp.symbols("m c T r k_p k_i k_d", positive=True)
START = {x: 0.1, x.diff(): 0, e: 0.2}
VALUES = {m: 2, c: 0.5, T: 0.1, r: 1, k_p: 8, k_i: 1, k_d: 6}
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
A = np.array([[0.0, 1.0, 0.0], [0.0, -0.25, 0.5], [0.0, 0.0, 0.0]])  # x, x_dot, held force
_MADE = {}


def cart(*controllers, inputs=(u,), force=u, states=None):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_inputs(*inputs)
    scene.add_states(states or {})
    scene.add_loads((P, (force - c * x.diff()) * N.x))
    scene.add_controllers(*controllers)
    return scene


def pid(**options):
    laws = {"states": {e: e + T * (r - x)}, "inputs": {u: k_p * (r - x) + k_i * e - k_d * x.diff()}}
    return da.Controller("pid", period=T, **{**laws, **options})


def model_of(backend="llvm", formulation="auto"):
    key = backend, formulation
    if key not in _MADE:
        _MADE[key] = da.compile_model(cart(pid()), backend=backend, formulation=formulation)
    return _MADE[key]


def loop(count, gain=8.0, step=0.1, z=(0.1, 0.0, 0.0), total=0.2):
    """Return x, x_dot, u, e right behind each of some instants, and at the end of the last period."""
    z, found, over = np.array(z), [], expm(A * step)
    for _ in range(count):
        z[2] = gain * (1 - z[0]) + total - 6 * z[1]
        total += step * (1 - z[0])
        found.append([*z, total])
        z = over @ z
    return np.array([*found, [*z, total]])


def compare(run, expected, bound=1e-9):
    for i, name in enumerate(("x", "x_dot", "u", "e")):
        np.testing.assert_allclose(run[name], expected[:, i], rtol=0, atol=bound, err_msg=name)


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_backend_against_the_closed_form(backend):
    run = model_of(backend).simulate((0, 3), START, VALUES, t_eval=np.linspace(0, 3, 31), **TIGHT)
    compare(run, loop(30))


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_every_formulation_and_method(formulation):
    model = model_of(formulation=formulation)
    for method in model.methods:
        run = model.simulate((0, 1), START, VALUES, t_eval=np.linspace(0, 1, 11), method=method, **TIGHT)
        compare(run, loop(10))


def test_accepted_steps_and_continuous_output_hold_what_follows_an_instant():
    run = model_of().simulate((0, 1), START, VALUES, **TIGHT)
    expected = loop(10)
    at = np.searchsorted(run.t, np.linspace(0, 1, 11)[:-1] - 1e-12)
    np.testing.assert_allclose(run["u"][at], expected[:-1, 2], atol=1e-9)
    assert np.all(np.diff(run.t) > 0)
    np.testing.assert_allclose(run([0.5, 0.55, 0.59999])["u"], expected[5, 2], atol=1e-9)
    assert {"u", "e"} <= set(run.names) and "u" in run.to_xarray()
    late = model_of().simulate((1.7e9, 1.7e9 + 1), START, VALUES, t_eval=1.7e9 + np.array([0.0, 1.0]), **TIGHT)
    compare(late, expected[[0, -1]])


def test_sweeps_are_single_runs():
    model, times = model_of(), np.linspace(0, 2, 21)
    values = {**VALUES, k_p: np.array([6.0, 8.0, 10.0]), T: np.array([0.1, 0.05, 0.07])}
    sweep = model.sweep((0, 2), START, values, t_eval=times, **TIGHT)
    ends = model.sweep((0, 2), START, values, **TIGHT)
    watched = model.sweep((0, 2), START, values, reduce={"top": da.maximum(u)}, **TIGHT)
    for i in range(3):
        own = {key: np.broadcast_to(value, 3)[i] for key, value in values.items()}
        run = model.simulate((0, 2), START, own, t_eval=times, **TIGHT)
        for name in ("x", "u", "e"):
            np.testing.assert_allclose(sweep[name][i], run[name], rtol=1e-11, atol=1e-12)
            np.testing.assert_allclose(ends[name][i], run[name][-1], rtol=1e-11, atol=1e-12)
            np.testing.assert_allclose(watched[name][i], run[name][-1], rtol=1e-9, atol=1e-10)
        dense = model.simulate((0, 2), START, own, **TIGHT)
        np.testing.assert_allclose(watched.reduced["top"][i], dense["u"].max(), rtol=1e-9)
    compare({name: sweep[name][1][:2] for name in ("x", "x_dot", "u", "e")}, loop(3, step=0.05)[[0, 2]])


def test_prepared_runs_and_sensitivities():
    model, expected = model_of(), loop(20)
    final = model.prepare((0, 2), **TIGHT)(model.state(START, VALUES), model.parameter_vector(VALUES))
    np.testing.assert_allclose(final, expected[-1][[0, 1, 3, 2]], atol=1e-9)
    found = model.sensitivity((0, 2), START, VALUES, wrt=[k_p, "e", m], rtol=1e-11, atol=1e-13)
    assert found.of == ("x", "x_dot", "e", "u")
    sides = [loop(20, gain=8 + h)[-1] for h in (1e-6, -1e-6)]
    np.testing.assert_allclose(found.jacobians[-1, :, 0], ((sides[0] - sides[1]) / 2e-6)[[0, 1, 3, 2]], atol=1e-7)
    sides = [loop(20, total=0.2 + h)[-1] for h in (1e-4, -1e-4)]
    np.testing.assert_allclose(found.jacobians[-1, :, 1], ((sides[0] - sides[1]) / 2e-4)[[0, 1, 3, 2]], atol=1e-9)
    with pytest.raises(OptionError, match="instants of controllers depend on T"):
        model.sensitivity((0, 2), START, VALUES, wrt=[T])


def test_several_rates_and_an_offset():
    """A slow loop sets the speed that a fast one follows; a third, which begins later, adds to the force."""
    slow = da.Controller("slow", period=0.3, inputs={v: 2 * (r - x)})
    fast = da.Controller("fast", period=0.1, inputs={u: 5 * (v - x.diff())})
    late = da.Controller("late", period=0.2, offset=0.15, inputs={y: -x}, states={f: f + 1})
    scene = cart(slow, fast, late, inputs=(u, v, y), force=u + y)
    model, start = da.compile_model(scene), {x: 0.1, x.diff(): 0, f: 0}
    times = np.linspace(0, 1.2, 25)
    with pytest.raises(InitialStateError, match="missing for the states y"):
        model.simulate((0, 1.2), start, {m: 2, c: 0.5, r: 1})
    run = model.simulate((0, 1.2), {**start, y: 0.5}, {m: 2, c: 0.5, r: 1}, t_eval=times, **TIGHT)
    over, z, speed, force, more, count, found = expm(A * 0.05), np.array([0.1, 0.0, 0.0]), 0.0, 0.0, 0.5, 0, []
    for k in range(25):
        if k % 6 == 0 and k < 24:
            speed = 2 * (1 - z[0])
        if k % 2 == 0 and k < 24:
            force = 5 * (speed - z[1])
        if k >= 3 and (k - 3) % 4 == 0:
            more, count = -z[0], count + 1
        z[2] = force + more
        found.append([z[0], z[1], force, speed, more, count])
        z = over @ z
    for i, name in enumerate(("x", "x_dot", "u", "v", "y", "f")):
        np.testing.assert_allclose(run[name], np.array(found)[:, i], atol=1e-9, err_msg=name)


def test_states_of_first_order_and_time_in_laws():
    """A lag behind a held force, a law in time, and a law that uses the new input in its state."""
    law = da.Controller("law", period=sp.Rational(1, 5), inputs={u: sp.sin(3 * t) + y}, states={e: u + e})
    model = da.compile_model(cart(law, force=y, states={y: (u - y) / 2}))
    run = model.simulate(
        (0, 1), {x: 0, x.diff(): 0, y: 0.1, e: 0}, {m: 2, c: 0.5}, t_eval=np.linspace(0, 1, 6), **TIGHT
    )
    lag, total = 0.1, 0.0
    for k in range(5):
        held = np.sin(0.6 * k) + lag
        total += held
        np.testing.assert_allclose([run["u"][k], run["e"][k]], [held, total], atol=1e-9)
        lag = held + (lag - held) * np.exp(-0.1)
    np.testing.assert_allclose(run["y"][-1], lag, atol=1e-9)


def test_events_between_and_at_instants():
    model, kick = model_of(), {x.diff(): x.diff() + 1}
    for at in (0.53, 0.5):
        event = da.Event(t - sp.Rational(str(at)), name="kick", apply=kick)
        run = model.simulate((0, 1), START, VALUES, events=[event], **TIGHT)
        swept = model.sweep((0, 1), START, VALUES, events=[event], **TIGHT)
        before = loop(6)[5]  # right behind the instant at 0.5
        z = expm(A * (at - 0.5)) @ before[:3] + [0, 1, 0]
        z = expm(A * (0.6 - at)) @ z
        expected = loop(4, z=[*z[:2], 0.0], total=before[3])[-1]
        for found in (run, swept):
            values = [found[name][-1] for name in ("x", "x_dot", "u", "e")]
            np.testing.assert_allclose(values, expected, atol=1e-8, err_msg=str(at))
    crossing = model.simulate((0, 1), START, VALUES, events=[da.Event(u - 1, name="low", terminal=False)], **TIGHT)
    np.testing.assert_allclose(crossing.events["low"].t, [0.1 * np.flatnonzero(loop(10)[:-1, 2] < 1)[0]], atol=1e-12)


def test_python_functions_do_the_same_in_single_runs():
    calls = []

    def law(now, q, qdot, states, parameters):
        calls.append(now)
        p = {name: parameters[name] for name in ("k_p", "k_i", "k_d", "r", "T")}
        force = p["k_p"] * (p["r"] - q[0]) + p["k_i"] * states["e"] - p["k_d"] * qdot[0]
        return [force], {"e": states["e"] + p["T"] * (p["r"] - q[0])}

    scene = cart(da.Controller("own", period=T, states=[e], inputs=[u], function=law))
    scene.add_loads((scene.bodies[0].point, (k_p + k_i + k_d + r - 16) * scene.frame.x))  # so that they are parameters
    model = da.compile_model(scene)
    run = model.simulate((2, 3), START, VALUES, t_eval=np.linspace(2, 3, 11), **TIGHT)
    compare(run, loop(10))
    np.testing.assert_allclose(calls, 2 + 0.1 * np.arange(10), atol=1e-12)
    state, p = model.state(START, VALUES), model.parameter_vector(VALUES)
    for refused in (
        lambda: model.sweep((0, 1), START, VALUES),
        lambda: model.prepare((0, 1))(state, p),
        lambda: model.sensitivity((0, 1), START, VALUES, wrt=["m"]),
    ):
        with pytest.raises(CapabilityError, match=r"calls no Python functions, .*own.* write them as expressions"):
            refused()
    for given in ([1, 2], [1j], {u: 1j}, ["1"]):
        law = da.Controller("own", period=0.1, inputs=[u], function=lambda *a, given=given: (given, None))
        with pytest.raises(ValueInputError, match=r"returned inputs .*; it must give finite numbers for u"):
            da.compile_model(cart(law)).simulate((0, 1), {x: 0, x.diff(): 0}, {m: 1, c: 1})


FAULTS = {
    "an unknown coordinate": (lambda: pid(inputs={u: -y}), "input 'u' of controller 'pid': y.* is no coordinate"),
    "no input": (lambda: pid(inputs={v: x}), "gives 'v', which is no input of the scene; declare it with add_inputs"),
    "nothing": (lambda: pid(inputs={}), "controller 'pid' gives no inputs"),
    "a period of zero": (lambda: da.Controller("pid", period=0, inputs={u: x}), "period of controller 'pid' is 0 s"),
    "a period that moves": (
        lambda: da.Controller("pid", period=x, inputs={u: x}),
        "period of controller 'pid' must be a number or a function of parameters",
    ),
    "a coordinate as state": (lambda: pid(states={x: x}), "state 'x' is a coordinate of the scene too"),
    "no mapping": (lambda: da.Controller("pid", period=1, inputs=[u]), "without function=, states and inputs must be"),
    "both": (
        lambda: da.Controller("pid", period=1, inputs={u: x}, function=max),
        "with function=, which must be callable, states and inputs list symbols alone",
    ),
    "no controller": (lambda: "pid", "'pid' is not a Controller"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(fault):
    make, text = FAULTS[fault]
    with pytest.raises(SceneError, match=text):
        da.compile_model(cart(make()))


def test_what_controllers_cannot_do_is_refused_by_name():
    model = model_of()
    with pytest.raises(UnknownNameError, match="'u' is set by a controller of the scene"):
        model.simulate((0, 1), START, VALUES, inputs={"u": 1.0})
    with pytest.raises(OptionError, match="runs forwards in time"):
        model.simulate((1, 0), START, VALUES)
    with pytest.raises(CapabilityError, match=r"does not support sampled controllers .*pid"):
        model.trim(START, VALUES)
    with pytest.raises(SceneError, match="two controllers are called 'pid'"):
        da.compile_model(cart(pid(), pid()))
    with pytest.raises(SceneError, match="'u' belongs to controller 'pid' too"):
        da.compile_model(cart(pid(), da.Controller("more", period=1, inputs={u: x})))
    with pytest.raises(SceneError, match="'u' is set at sampling instants and held in between, so that it has no rate"):
        da.compile_model(cart(pid(), force=u.diff()))
    with pytest.raises(ValueInputError, match=r"acts 1e.* times"):
        model.simulate((0, 1), START, {**VALUES, T: 1e-9})
    assert "pid sets u by expressions, with the states e, and holds them in between" in model.explain()
    assert "controller pid, every T, sets" in str(da.lagrange(cart(pid())))


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_a_sampled_torque_on_a_sleigh_against_scipy_stopped_at_instants(formulation):
    scene = da.scenes.chaplygin_sleigh()
    S, theta = scene.bodies[0].frame, scene.coordinates[2]
    scene.add_inputs(u)
    scene.add_loads((S, u * S.z))
    scene.add_controllers(da.Controller("turn", period=0.25, inputs={u: sp.sin(t) - 2 * theta.diff()}))
    model = da.compile_model(scene, formulation=formulation)
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": np.cos(0.2), "theta_dot": 0.5}
    run = model.simulate((0, 2), start, {"m": 1.0, "b": 0.3, "I_C": 0.5}, t_eval=np.linspace(0, 2, 9), **TIGHT)
    z = np.array([0.0, 0.0, 0.2, 1.0, 0.5])
    for k in range(8):
        force = np.sin(0.25 * k) - 2 * z[4]
        found = [run[name][k] for name in ("x", "y", "theta", "theta_dot", "u")]
        np.testing.assert_allclose(found, [*z[[0, 1, 2, 4]], force], atol=1e-9)

        def right(s, w, force=force):
            speeds = [w[3] * np.cos(w[2]), w[3] * np.sin(w[2]), w[4]]
            return [*speeds, 0.3 * w[4] ** 2, (-0.3 * w[3] * w[4] + force) / 0.5]

        z = solve_ivp(right, (0, 0.25), z, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    np.testing.assert_allclose(run["theta"][-1], z[2], atol=1e-9)


def test_a_case_with_a_period_that_makes_no_sense_fails_alone():
    period = sp.Symbol("T_s")
    model = da.compile_model(cart(da.Controller("p", period=period, inputs={u: k_p * (r - x)})))
    values = {m: 2, c: 0.5, r: 1, k_p: 3, period: np.array([0.1, -1.0, 0.2, 0.0])}
    sweep = model.sweep((0, 1), {x: 0, x.diff(): 0}, values, t_eval=[0, 1])
    assert sweep.success.tolist() == [True, False, True, False]
    watched = model.sweep((0, 1), {x: 0, x.diff(): 0}, values, events=[da.Event(x - r / 10, name="there")])
    assert watched.success.tolist() == [True, False, True, False]
    np.testing.assert_allclose(watched["x"][::2], sweep["x"][::2, -1], rtol=1e-8)
    alone = model.simulate((0, 1), {x: 0, x.diff(): 0}, {**values, period: 0.2})
    np.testing.assert_allclose(sweep["x"][2, -1], alone["x"][-1], rtol=1e-9)
    with pytest.raises(ValueInputError, match="controller 'p' has the period -1 s"):
        model.simulate((0, 1), {x: 0, x.diff(): 0}, {**values, period: -1.0})


def test_a_function_far_from_zero_is_given_the_time_itself():
    calls = []

    def law(now, q, qdot, states, parameters):
        calls.append((now, sorted(parameters)))
        return [0.0], None

    model = da.compile_model(cart(da.Controller("own", period=0.5, inputs=[u], function=law)))
    model.simulate((1.7e9, 1.7e9 + 1), {x: 0, x.diff(): 0}, {m: 1, c: 1})
    assert calls == [(1.7e9, ["c", "m"]), (1.7e9 + 0.5, ["c", "m"])]


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_a_case_without_instants_fails_alone_where_constraints_are_searched(backend):
    N, O = ReferenceFrame("N"), Point("O")
    P, period = O.locatenew("P", x * N.x + y * N.y), sp.Symbol("period")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("P", P, m))
    scene.add_holonomic_constraints(x**2 + y**2 - 1)
    scene.add_inputs(u)
    scene.add_loads((P, u * N.x))
    scene.add_controllers(da.Controller("p", period=period, inputs={u: -x}))
    model = da.compile_model(scene, formulation="augmented", backend=backend)
    sweep = model.sweep((0, 1), {x: 0.6, y: -0.8, x.diff(): 0}, {m: 1, period: [0.1, -1.0, 0.2]})
    assert sweep.status.tolist() == [Status.SUCCESS, Status.NON_FINITE, Status.SUCCESS]
    assert sweep.t.tolist() == [1.0, 0.0, 1.0]


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_unstable_loop_is_called_divergent(backend):
    model, start = model_of(backend), {x: 0, x.diff(): 0, e: 0}
    run = model.simulate((0, 50), start, {**VALUES, k_p: 1e6})
    assert run.status is Status.DIVERGED and not run.success
    assert re.search(r"lower the gains.*Note: 'x_dot' grew to \S+ at t = \d+\S*, from 0 at the start", run.message)
    sweep = model.sweep((0, 50), start, {**VALUES, k_p: np.array([8.0, 1e6])})
    assert sweep.status.tolist() == [Status.SUCCESS, Status.DIVERGED]
    (failure,) = sweep.failures()
    assert failure.t == run.t[-1] and "loop is unstable" in failure.message
    stopped = model.simulate((0, 100), start, VALUES, max_steps=20)  # a budget alone is no divergence
    assert stopped.status is Status.MAX_STEPS


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_unstable_loop_in_a_prepared_run(backend):
    model, start = model_of(backend), {x: 0, x.diff(): 0, e: 0}
    for gain, status in ((8.0, Status.SUCCESS), (1e6, Status.DIVERGED)):
        run = model.prepare((0, 50))
        run(model.state(start, {**VALUES, k_p: gain}), model.parameter_vector({**VALUES, k_p: gain}))
        assert run.status is status


def test_an_unstable_loop_whose_steps_become_small_is_called_divergent():
    angle, (ell, gravity) = dynamicsymbols("angle"), sp.symbols("ell gravity", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    C = O.locatenew("C", x * N.x)
    B = C.locatenew("B", ell * sp.sin(angle) * N.x + ell * sp.cos(angle) * N.y)
    scene = da.Scene("pole", frame=N, origin=O, coordinates=[x, angle])
    scene.add_bodies(Particle("cart", C, m), Particle("bob", B, m))
    scene.add_inputs(u)
    scene.add_loads((C, u * N.x))
    scene.apply_uniform_gravity(-gravity * N.y)
    scene.add_controllers(da.Controller("loop", period=T, inputs={u: k_p * (angle - x)}))
    start = {x: 0, x.diff(): 0, angle: 0.1, angle.diff(): 0}
    values = {m: 1, ell: 1, gravity: 9.81, T: 0.1, k_p: 1e6}
    run = da.compile_model(scene).simulate((0, 20), start, values, max_steps=200_000)
    assert run.status is Status.DIVERGED and "'x_dot' grew to" in run.message
