"""Sampled controllers in scenes whose contacts change, against closed forms from instant to instant."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen import BACKENDS
from dalembert.errors import CapabilityError, InitialStateError, OptionError, ValueInputError
from dalembert.methods.status import Status
from dalembert.phases import host_runners, runner_choice

t = dynamicsymbols._t
x, y, u, v, count = dynamicsymbols("x y u v count")
m, g, r, mu, T, c, a = sp.symbols("m g r mu T c a", positive=True)
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
BALL = {m: 2.0, g: 9.81, r: 0.6, T: 0.05}
DROP = {y: 0.3, "y_dot": 0}
_MADE = {}


def model_of(name, make, backend="llvm"):
    if (name, backend) not in _MADE:
        _MADE[name, backend] = da.compile_model(make(), backend=backend)
    return _MADE[name, backend]


def ball(*controllers, inputs=(u,), force=u, states=()):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", y * N.y)
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[y])
    scene.add_bodies(Particle("P", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    n = da.unknowns("n")
    scene.add_joints(da.Joint("floor", body="P", at=P, force=n * N.y))
    scene.add_contacts(da.UnilateralContact(normal=n, gap=y, restitution=r))
    scene.add_inputs(*inputs)
    scene.add_loads((P, force * N.y))
    scene.add_controllers(*controllers)
    return scene


def hand(**options):
    return da.Controller("hand", **{"period": T, "inputs": {u: 3 - 4 * y}, **options})


def block(backend="llvm", way="controllers"):
    """A block on a floor that it may leave, pulled and lifted by controllers, by inputs, or by conditions on time."""

    def make():
        N, O = ReferenceFrame("N"), Point("O")
        P = O.locatenew("P", x * N.x + y * N.y)
        scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
        scene.add_bodies(Particle("P", P, m))
        scene.apply_uniform_gravity(-g * N.y)
        n, f = da.unknowns("n f")
        scene.add_joints(da.Joint("floor", body="P", at=P, force=n * N.y + f * N.x))
        scene.add_contacts(da.UnilateralContact(normal=n, gap=y))
        scene.add_friction(da.CoulombFriction(normal=n, tangential=f, mu=mu))
        if way != "conditions":
            scene.add_inputs(u, v)
        lifted = sp.And(t >= sp.Rational(1, 2), t < sp.Rational(7, 10))
        steps = a * sp.floor(10 * t), sp.Piecewise((30, lifted), (0, True))
        forces = steps if way == "conditions" else (u, v)
        scene.add_loads((P, forces[0] * N.x + (forces[1] - c * t) * N.y))
        if way == "controllers":
            pull = da.Controller("pull", period=T, states={count: count + 1}, inputs={u: a * count})
            held = sp.Piecewise((30, sp.And(count > 5, count < 8)), (0, True))
            scene.add_controllers(pull, da.Controller("lift", period=T, inputs={v: held}))
        return scene

    return model_of(way, make, backend)


def bounced(height, speed, push, period, restitution=0.6):
    """Return height and speed of the ball after a time with a constant force, impact by impact."""
    rate, left = push / 2.0 - 9.81, period
    while True:
        root = np.sqrt(speed**2 - 2 * rate * height)
        times = [s for s in ((-speed - root) / rate, (-speed + root) / rate) if s > 1e-12]
        if not times or min(times) >= left:
            return height + speed * left + rate * left**2 / 2, speed + rate * left
        left -= min(times)
        height, speed = 0.0, -restitution * (speed + rate * min(times))


def loop(steps, period):
    """Return y, y_dot and u right behind each of some instants, and at the end of the last period."""
    height, speed, found = 0.3, 0.0, []
    for _ in range(steps):
        force = 3 - 4 * height
        found.append([height, speed, force])
        height, speed = bounced(height, speed, force, period)
    return np.array([*found, [height, speed, force]])


def compare(run, expected, some=slice(None)):
    for i, name in enumerate(("y", "y_dot", "u")):
        np.testing.assert_allclose(run[name][..., some], expected[:, i], rtol=0, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_bouncing_ball_in_every_backend(backend):
    model, times = model_of("ball", lambda: ball(hand()), backend), np.linspace(0, 1, 21)
    run = model.simulate((0, 1), DROP, BALL, t_eval=times, **TIGHT)
    compare(run, loop(20, 0.05))
    assert len(run.phases) == 6 and run.status is Status.SUCCESS
    values = {**BALL, T: np.array([0.05, 0.1, 0.05])}
    sweep = model.sweep((0, 1), DROP, values, t_eval=times, **TIGHT)
    for name in ("y", "y_dot", "u"):
        np.testing.assert_allclose(sweep[name][[0, 2]], [run[name], run[name]], rtol=0, atol=1e-9)
    compare({name: sweep[name][1] for name in ("y", "y_dot", "u")}, loop(10, 0.1), slice(None, None, 2))
    np.testing.assert_array_equal(sweep["u"][1][1::2], sweep["u"][1][:-1:2])
    np.testing.assert_array_equal(sweep.phases, [6, sweep.phases[1], 6])
    ends = model.sweep((0, 1), DROP, values, **TIGHT)
    compare({name: ends[name][[0, 2]] for name in ("y", "y_dot", "u")}, loop(20, 0.05)[[-1, -1]])
    final = model.prepare((0, 1), **TIGHT)(model.state(DROP, BALL), model.parameter_vector(BALL))
    np.testing.assert_allclose(final, loop(20, 0.05)[-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_every_method_and_what_lies_between_instants(method):
    model = model_of("ball", lambda: ball(hand()))
    run = model.simulate((0, 1), DROP, BALL, method=method, **TIGHT)
    expected = loop(20, 0.05)
    np.testing.assert_allclose(run(np.arange(20) * 0.05 + 0.0499)["u"], expected[:-1, 2], atol=1e-9)
    compare(run(np.arange(20) * 0.05), expected[:-1])
    assert len(run.phases) == 6 and np.all(np.diff(run.t) >= 0)
    late = model.simulate((1e6, 1e6 + 1), DROP, BALL, method=method, t_eval=[1e6, 1e6 + 0.5, 1e6 + 1], **TIGHT)
    compare(late, expected[[0, 10, 20]])


def test_prepared_runs_of_one_period_close_the_same_loop():
    """The loop closed by hand: a prepared run of one period, with the inputs that hold in it."""
    model = model_of("plain", lambda: ball())
    run, numbers = model.prepare((0, 0.05), **TIGHT), model.parameter_vector({m: 2.0, g: 9.81, r: 0.6})
    state, expected = np.array([0.3, 0.0]), loop(20, 0.05)
    for k in range(20):
        state = run(state, numbers, np.array([3 - 4 * state[0]]))
        np.testing.assert_allclose(state, expected[k + 1, :2], rtol=0, atol=1e-9)


def pulled(times):
    """Return x, x_dot, y, y_dot, u, v of the block at times: SciPy stopped at the instants and where it lands."""
    state, found, air, sliding = np.zeros(4), [], False, False

    def rates(s, z):
        normal = 20.0 + 4.0 * s - lift
        friction = 0.5 * normal if sliding and not air else pull if not air else 0.0
        return [z[1], (pull - friction) / 2, z[3], -normal / 2 if air else 0.0]

    def lands(s, z):
        return z[2]

    lands.terminal, lands.direction = True, -1
    for k in range(12):
        now, end, pull, lift = 0.1 * k, 0.1 * (k + 1), 3.0 * k, 30.0 if 5 <= k < 7 else 0.0
        air, sliding = air or lift > 20.0 + 4.0 * now, sliding or pull > 0.5 * (20.0 + 4.0 * now)
        while now < end:
            options = {"rtol": 1e-13, "atol": 1e-14, "events": lands if air else None, "dense_output": True}
            run = solve_ivp(rates, (now, end), state, "DOP853", **options)
            here = [s for s in times if now - 1e-12 <= s < run.t[-1] - 1e-12]
            found += [[*run.sol(max(s, now)), pull, lift] for s in here]
            now, state = run.t[-1], run.y[:, -1]
            if run.status == 1:
                air, state = False, np.array([state[0], state[1] + 0.5 * state[3], 0.0, 0.0])
    return np.array([*found, [*state, pull, lift]])


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_a_held_force_that_jumps_ends_sticking_and_lifts_and_lowers(backend):
    """The pull rises at every instant until the block slips; later it is lifted for two periods, and lands.

    The load on the floor rises all the time: where the block is lifted, the normal reaction is negative and rises.
    """
    model, start = block(backend), {x: 0, y: 0, "x_dot": 0, "y_dot": 0, count: 0}
    values = {m: 2.0, g: 10.0, mu: 0.5, T: 0.1, a: 3.0, c: 4.0}
    times = np.linspace(0, 1.2, 49)
    run = model.simulate((0, 1.2), start, values, t_eval=times, **TIGHT)
    expected = pulled(times)
    for i, name in enumerate(("x", "x_dot", "y", "y_dot", "u", "v")):
        np.testing.assert_allclose(run[name], expected[:, i], rtol=0, atol=1e-9, err_msg=name)
    assert [phase.modes["n"] for phase in run.phases] == ["stick", "slip", "open", "slip"]
    np.testing.assert_allclose([phase.t1 for phase in run.phases[:2]], [0.4, 0.5], rtol=1e-15)
    for given in ({}, {"t_eval": times}):
        sweep = model.sweep((0, 1.2), start, {**values, mu: np.array([0.5, 0.3, 0.5])}, **given, **TIGHT)
        for i, name in enumerate(("x", "x_dot", "y", "y_dot", "u", "v")):
            found = sweep[name][[0, 2]] if given else sweep[name][[0, 2], np.newaxis]
            theirs = expected[:, i] if given else expected[-1:, i]
            np.testing.assert_allclose(found, [theirs, theirs], rtol=0, atol=1e-9, err_msg=name)
        np.testing.assert_array_equal(sweep.phases[[0, 2]], 4)


def test_an_act_at_the_start_lifts():
    model = model_of("lifted", lambda: ball(da.Controller("once", period=T, inputs={u: 30 - 40 * y})))
    values, expected = {**BALL, T: 0.2}, [0.0, 0.0]
    run = model.simulate((0, 0.2), {y: 0, "y_dot": 0}, values, **TIGHT)
    assert [phase.modes["n"] for phase in run.phases] == ["open"]
    expected = [(15 - 9.81) * 0.02, (15 - 9.81) * 0.2]
    np.testing.assert_allclose([run["y"][-1], run["y_dot"][-1]], expected, rtol=0, atol=1e-12)
    sweep = model.sweep((0, 0.2), {y: 0, "y_dot": 0}, {**values, m: [2.0, 4.0]}, **TIGHT)
    np.testing.assert_allclose(sweep["y"], [expected[0], 0.0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(sweep.phases, 1)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_an_act_at_the_time_of_an_impact(backend):
    """The ball is let go so high that it strikes the floor where the controller acts."""
    model, values = model_of("ball", lambda: ball(hand()), backend), {**BALL, T: 0.25}
    height = (9.81 - 1.5) * 0.25**2 / 2 / (1 - 2 * 0.25**2 / 2)
    speed = -0.25 * (9.81 - (3 - 4 * height) / 2)
    expected = bounced(0.0, -0.6 * speed, 3.0, 0.25)
    for way in ("simulate", "sweep"):
        run = getattr(model, way)((0, 0.5), {y: height, "y_dot": 0}, values, **TIGHT)
        np.testing.assert_allclose([run["y"].flat[-1], run["y_dot"].flat[-1]], expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(run["u"].flat[-1], 3.0, rtol=0, atol=1e-12)


def test_several_rates_offsets_and_laws_that_see_impacts():
    """A law of the speed, one that begins later, and one that counts; closed form from instant to instant."""
    fast = da.Controller("fast", period=sp.Rational(3, 100), inputs={u: 2 - y.diff()})
    slow = da.Controller("slow", period=0.1, offset=0.05, inputs={v: u - 3 * y}, states={count: count + 1})
    model = model_of("rates", lambda: ball(fast, slow, inputs=(u, v), force=u + v))
    start, values = {**DROP, count: 0}, {m: 2.0, g: 9.81, r: 0.6}
    with pytest.raises(InitialStateError, match="missing for the states v"):
        model.simulate((0, 0.6), start, values)
    times = np.arange(0, 61) / 100
    height, speed, held, found, acts = 0.3, 0.0, [0.0, 0.5], [], 0
    for k in range(61):
        if k % 3 == 0 and k < 60:
            held[0] = 2 - speed
        if k >= 5 and (k - 5) % 10 == 0:
            held[1], acts = held[0] - 3 * height, acts + 1
        found.append([height, speed, *held, acts])
        height, speed = bounced(height, speed, sum(held), 0.01)
    for way in ("simulate", "sweep"):
        run = getattr(model, way)((0, 0.6), {**start, v: 0.5}, values, t_eval=times, **TIGHT)
        for i, name in enumerate(("y", "y_dot", "u", "v", "count")):
            np.testing.assert_allclose(run[name].ravel(), np.array(found)[:, i], rtol=0, atol=1e-9, err_msg=name)


def test_events_of_users_see_what_is_held():
    model, times = model_of("ball", lambda: ball(hand())), np.linspace(0, 1, 21)
    low = da.Event(u - 2.5, name="low", terminal=False)
    kick = da.Event(t - 0.3, name="kick", apply={y.diff(): y.diff() + 2})
    expected = loop(20, 0.05)
    crossings = 0.05 * (1 + np.flatnonzero(np.diff(np.sign(expected[:-1, 2] - 2.5))))
    run = model.simulate((0, 1), DROP, BALL, events=[low], **TIGHT)
    np.testing.assert_allclose(run.events["low"].t, crossings, rtol=0, atol=1e-12)
    for given in ({}, {"t_eval": times}):
        sweep = model.sweep((0, 1), DROP, BALL, events=[low], reduce={"top": da.maximum(u)}, **given, **TIGHT)
        np.testing.assert_array_equal(sweep.events["low"].count, len(crossings))
        np.testing.assert_allclose(sweep.events["low"].last, crossings[-1], rtol=0, atol=1e-12)
        np.testing.assert_allclose(sweep.reduced["top"], expected[:-1, 2].max(), rtol=0, atol=1e-9)
    before = expected[6]
    height, speed = before[0], before[1] + 2
    for k in range(14):
        force = before[2] if k == 0 else 3 - 4 * height
        height, speed = bounced(height, speed, force, 0.05)
    for way in ("simulate", "sweep"):
        run = getattr(model, way)((0, 1), DROP, BALL, events=[kick], **TIGHT)
        np.testing.assert_allclose([run["y"].flat[-1], run["y_dot"].flat[-1]], [height, speed], rtol=0, atol=1e-8)


def test_python_functions_and_what_is_refused():
    calls = []

    def law(now, q, qdot, states, parameters):
        calls.append(now)
        return {u: 3 - 4 * q[0]}, [states["count"] + 1]

    own = da.Controller("own", period=0.05, states=[count], inputs=[u], function=law)
    model, times = da.compile_model(ball(own)), np.linspace(0, 1, 21)
    values = {m: 2.0, g: 9.81, r: 0.6}
    run = model.simulate((2, 3), {**DROP, count: 0}, values, t_eval=2 + times, **TIGHT)
    compare(run, loop(20, 0.05))
    np.testing.assert_allclose(calls, 2 + 0.05 * np.arange(20), atol=1e-12)
    np.testing.assert_array_equal(run["count"], np.minimum(np.arange(1, 22), 20))
    with pytest.raises(CapabilityError, match=r"a sweep calls no Python functions, .*own"):
        model.sweep((0, 1), {**DROP, count: 0}, values)
    plain = model_of("ball", lambda: ball(hand()))
    with pytest.raises(OptionError, match="runs forwards in time"):
        plain.simulate((1, 0), DROP, BALL)
    with pytest.raises(ValueInputError, match=r"T = nan|period nan s"):
        plain.simulate((0, 1), DROP, {**BALL, T: np.nan})
    with pytest.raises(CapabilityError, match="linearize does not support sampled controllers"):
        plain.linearize(0.0, DROP, BALL)
    assert "hand" in plain.explain()
    period = sp.Symbol("period")
    model = da.compile_model(ball(hand(period=period)))
    alone = model.sweep((0, 1), DROP, {**values, period: np.array([0.05, -1.0])}, **TIGHT)
    np.testing.assert_array_equal(alone.status, [0, Status.NON_FINITE])
    compare({name: alone[name][:1] for name in ("y", "y_dot", "u")}, loop(20, 0.05)[-1:])
    open_run = plain.mode(n="open").simulate((0, 0.2), DROP, BALL, t_eval=[0, 0.05, 0.1, 0.15], **TIGHT)
    compare(open_run, loop(4, 0.05)[:4])


def samples(kind="hold"):
    knots = np.arange(13) / 10
    return {u: da.samples(knots, 3.0 * np.arange(13), kind), v: da.samples(knots, [0] * 5 + [30] * 2 + [0] * 6, kind)}


@pytest.mark.parametrize("way", ["samples", "conditions"])
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_knots_and_conditions_do_not_return_to_python(way, method, monkeypatch):
    """The same forces by records, and by conditions on time: compiled code alone, and a sweep has the bits of a run."""
    model, start = block("llvm", way), {x: 0, y: 0, "x_dot": 0, "y_dot": 0}
    values, given = {m: 2.0, g: 10.0, mu: 0.5, c: 4.0}, {"inputs": samples()} if way == "samples" else {}
    values |= {a: 3.0} if way == "conditions" else {}
    times = np.linspace(0, 1.2, 49)

    def refuse(*given, **named):
        raise AssertionError("a phase was run by Python")

    monkeypatch.setattr("dalembert.phases.host_runners.simulate_in_own_time", refuse)
    monkeypatch.setattr("dalembert.phases.host_runners.sweep_in_own_time", refuse)
    run = model.simulate((0, 1.2), start, values, method=method, **given, **TIGHT)
    at, expected = run(times), pulled(times)
    for i, name in enumerate(("x", "x_dot", "y", "y_dot")):
        np.testing.assert_allclose(at[name], expected[:, i], rtol=0, atol=1e-9, err_msg=name)
    if way == "samples":
        np.testing.assert_allclose(at["v"][1::4], expected[1::4, 5], rtol=0, atol=1e-12)
    assert [phase.modes["n"] for phase in run.phases] == ["stick", "slip", "open", "slip"]
    sweep = model.sweep((0, 1.2), start, {**values, mu: np.array([0.3, 0.5])}, method=method, **given, **TIGHT)
    np.testing.assert_array_equal([sweep[name][1] for name in "xy"], [run[name][-1] for name in "xy"])
    np.testing.assert_array_equal(sweep.phases[1], 4)
    assert sweep.steps[1] == run.stats.steps + 2  # those in which guards fired at once are not recorded
    sampled = model.sweep((0, 1.2), start, {**values, mu: [0.5]}, method=method, t_eval=times, **given, **TIGHT)
    np.testing.assert_allclose(sampled["x"][0], expected[:, 0], rtol=0, atol=1e-9)
    if way == "samples":
        final = model.prepare((0, 1.2), method=method, **given, **TIGHT)(
            model.state(start, values, inputs={u: 0.0, v: 0.0}), model.parameter_vector(values)
        )
        np.testing.assert_array_equal(final[:2], [run["x"][-1], run["y"][-1]])


@pytest.mark.parametrize("by_python", ["stick", "slip", "open"])
@pytest.mark.parametrize("way", ["controllers", "samples", "conditions"])
def test_modes_of_which_python_runs_some(way, by_python, monkeypatch):
    """Cases go to and fro between compiled code and Python; times to record lie on instants, knots and breaks."""
    model, start = block("llvm", way), {x: 0, y: 0, "x_dot": 0, "y_dot": 0}
    values, given = {m: 2.0, g: 10.0, mu: 0.5, c: 4.0}, {"inputs": samples()} if way == "samples" else {}
    values |= {} if way == "samples" else {a: 3.0}
    values |= {T: 0.1} if way == "controllers" else {}
    start |= {count: 0} if way == "controllers" else {}
    calls = []
    for name in ("simulate_in_own_time", "sweep_in_own_time"):
        own = getattr(host_runners, name)
        monkeypatch.setattr(host_runners, name, lambda *about, own=own: calls.append(own) or own(*about))
    monkeypatch.setattr(runner_choice, "runs_unchecked", lambda model: by_python not in model.stages.mode)
    options = {"method": "taylor", "max_steps": 99_999, **given, **TIGHT}  # no recorder is kept for these
    times = np.linspace(0, 1.2, 49)
    expected = pulled(times)
    names = ["x", "x_dot", "y", "y_dot"] + (["u", "v"] if way == "controllers" else [])
    run = model.simulate((0, 1.2), start, values, t_eval=times, **options)
    steps = model.simulate((0, 1.2), start, values, **options)
    for i, name in enumerate(names):
        np.testing.assert_allclose(run[name], expected[:, i], rtol=0, atol=1e-9, err_msg=name)
        behind = steps(np.minimum(times + 1e-13, 1.2))[name]  # instants may differ by rounding
        np.testing.assert_allclose(behind, expected[:, i], rtol=0, atol=1e-9, err_msg=name)
    assert [phase.modes["n"] for phase in run.phases] == ["stick", "slip", "open", "slip"]
    assert np.all(np.diff(steps.t) >= 0) and steps.t[-1] == 1.2
    for sampled in ({}, {"t_eval": times}):
        sweep = model.sweep((0, 1.2), start, {**values, mu: np.array([0.3, 0.5])}, **sampled, **options)
        for i, name in enumerate(names):
            found, theirs = (sweep[name][1], expected[:, i]) if sampled else (sweep[name][1:], expected[-1:, i])
            np.testing.assert_allclose(found, theirs, rtol=0, atol=1e-9, err_msg=name)
        np.testing.assert_array_equal(sweep.phases[1], 4)
    assert len(set(calls)) == 2


def test_single_runs_by_python_do_not_derive_what_only_sweeps_watch(monkeypatch):
    def width(mode):
        raise AssertionError("margins of ranks are watched in sweeps alone, and take seconds to derive")

    model, start = block("llvm"), {x: 0, y: 0, "x_dot": 0, "y_dot": 0, count: 0}
    monkeypatch.setattr(runner_choice, "runs_unchecked", lambda model: False)
    monkeypatch.setattr(host_runners.HostMode, "_width", property(width))
    options = {"method": "taylor", "max_steps": 99_998, **TIGHT}  # no recorder is kept for these
    run = model.simulate((0, 1.2), start, {m: 2.0, g: 10.0, mu: 0.5, c: 4.0, a: 3.0, T: 0.1}, **options)
    np.testing.assert_allclose(run["x"][-1], pulled(np.array([0.0, 1.2]))[-1, 0], rtol=0, atol=1e-9)


def test_each_case_its_own_record_and_backwards():
    model, start = block("llvm", "samples"), {x: 0, y: 0, "x_dot": 0, "y_dot": 0}
    values, knots, sizes = {m: 2.0, g: 10.0, mu: 0.5, c: 0.0}, np.linspace(0, 2, 41), np.array([11.0, 14.0, 9.0])
    pulls = sizes[:, np.newaxis] * np.sin(5 * knots)
    inputs = {u: da.samples(knots, pulls, "linear"), v: 0.0}
    sweep = model.sweep((0, 2), {name: np.zeros(3) for name in start}, values, inputs=inputs, **TIGHT)
    for i, pull in enumerate(pulls):
        run = model.simulate((0, 2), start, values, inputs={u: da.samples(knots, pull, "linear"), v: 0.0}, **TIGHT)
        np.testing.assert_array_equal([sweep["x"][i], sweep["x_dot"][i]], [run["x"][-1], run["x_dot"][-1]])
        np.testing.assert_allclose(run(knots)["u"], pull, rtol=0, atol=1e-12)
        assert (len(run.phases) > 2) == (i < 2)
    flying = {x: 0, y: 5, "x_dot": 1, "y_dot": 0}
    there = model.simulate((0, 0.9), flying, values, inputs=samples("linear"), **TIGHT)
    end = {name: there[name][-1] for name in ("x", "y", "x_dot", "y_dot")}
    back = model.simulate((0.9, 0), end, values, inputs=samples("linear"), **TIGHT)
    np.testing.assert_allclose([back[name][-1] for name in ("x", "y", "x_dot", "y_dot")], [0, 5, 1, 0], atol=1e-9)


LAWS = {
    "after": (sp.Piecewise((1, t > 1), (0, True)), 0.0),
    "from": (sp.Piecewise((1, t >= 1), (0, True)), 1.0),
    "until": (sp.Piecewise((1, t <= 1), (0, True)), 1.0),
    "half": (sp.Heaviside(t - 1), 0.5),
    "given": (sp.Heaviside(t - 1, sp.Rational(1, 4)), 0.25),
    "sign": (sp.sign(t - 1), 0.0),
    "parameter": (sp.Piecewise((1, t > a), (0, True)), 0.0),
}


@pytest.mark.parametrize("backend", [backend for backend in BACKENDS if backend != "jax"])
@pytest.mark.parametrize("law", LAWS)
def test_conditions_on_time_are_decided_as_of_the_instant(law, backend):
    """Scenes with contacts decided them as of the time behind it."""
    expression, wanted = LAWS[law]
    held = da.Controller("held", period=T, inputs={u: expression})
    touching = da.compile_model(ball(held, force=m * (g + u)), backend=backend)
    given, p = DROP | {y: 1.0}, {key: value for key, value in BALL.items() if key != T} | {T: 0.5}
    p |= {a: 1.0} if law == "parameter" else {}
    run = touching.simulate((0, 1.4), given, p, t_eval=[0, 0.7, 1.2])
    assert run["u"][-1] == wanted
    assert run["y_dot"][-1] - run["y_dot"][1] == pytest.approx(0.2 * wanted + 0.3 * run["u"][1], abs=1e-9)
    cases = touching.sweep((0, 1.4), given, p | {T: np.array([0.25, 0.5])}, t_eval=[0, 0.7, 1.2])
    assert cases["u"][:, -1].tolist() == [wanted, wanted]


@pytest.mark.parametrize("backend", ["llvm", "numba", "numpy"])
def test_an_unstable_loop_on_a_floor_is_called_divergent(backend):
    """Motions, cases and prepared runs whose steps fail because a sampled loop grows without bound."""
    (x, z, u), (k, period) = dynamicsymbols("x z u"), sp.symbols("k period", positive=True)
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("B", x * frame.x + z * frame.z)
    scene = da.Scene("loop", frame, origin, [x, z])
    scene.add_bodies(Particle("b", point, 1))
    scene.add_inputs(u)
    scene.add_loads((point, u * frame.x - 10 * frame.z))
    scene.add_contacts(da.PointPlane("floor", body="b", point=point, plane=(origin, frame.z), friction=0.1))
    scene.add_controllers(da.Controller("p", period=period, inputs={u: -k * x}))
    model, start = da.compile_model(scene, backend=backend), {x: 1, x.diff(): 0, z: 0, z.diff(): 0}
    p, options = {k: 1e6, period: 0.5}, {"method": "dop853", "max_steps": 100_000}
    run = model.simulate((0, 400), start, p, **options)
    assert run.status is Status.DIVERGED
    assert "loop is unstable" in run.message
    assert "'x' grew to" in run.message
    assert "from 1 at the start" in run.message
    sweep = model.sweep((0, 400), start, {**p, k: [0.01, 1e6]}, **options)
    assert sweep.status.tolist() == [Status.SUCCESS, Status.DIVERGED]
    assert "loop is unstable" in sweep.failures()[0].message
    prepared = model.prepare((0, 400), **options)
    prepared(model.state(start, p), model.parameter_vector(p))
    assert prepared.status is Status.DIVERGED
