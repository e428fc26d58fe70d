"""Traced runs with events, reductions and contacts, beside sweeps of the compiled backend."""

import pickle

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import (
    CapabilityError,
    OptionError,
    PrecisionWarning,
    RunFailedError,
    UnknownNameError,
    ValueInputError,
)
from dalembert.methods.status import Status

jax = pytest.importorskip("jax")

pytestmark = pytest.mark.usefixtures("quick_xla")

QUICK = {"xla_backend_optimization_level": 0}
OPTIONS = {"method": "tsit5", "rtol": 1e-10, "atol": 1e-12}
T = np.array([0.5, 0.7, 0.9, 1.5])
P = {"m": 1.0, "g": 9.81, "e": 0.8}
h, (m, g, e, level) = dynamicsymbols("h"), sp.symbols("m g e level", positive=True)
speed = h.diff()


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def ball(backend):
    frame, origin = ReferenceFrame("N"), Point("O")
    scene = da.Scene("ball", frame=frame, origin=origin, coordinates=[h])
    scene.add_bodies(Particle("ball", origin.locatenew("B", h * frame.y), m))
    scene.apply_uniform_gravity(-g * frame.y)
    return da.compile_model(scene, backend=backend, outputs={"momentum": m * speed})


@pytest.fixture(scope="module")
def model():
    return ball("jax")


@pytest.fixture(scope="module")
def bouncing():
    return da.compile_model(da.scenes.bouncing_ball(), backend="jax")


def test_jumps_and_reductions_of_a_batch_are_those_of_a_sweep(model):
    impact = da.Event(h, direction=-1, apply={speed: -e * speed}, name="impact")
    watched = {
        "events": [impact, speed],
        "reduce": {"top": da.maximum(h), "mean": da.mean(h), "when": da.first_crossing(h)},
    }
    solve = model.solve_fn([h, speed], **watched, **OPTIONS)
    starts, bounces = np.array([1.0, 0.5, 0.8]), np.array([0.9, 0.5])
    values = {"m": 1.0, "g": 9.81}

    def run(start, e):
        return solve(T, {"h": start, "h_dot": 0.3}, {**values, "e": e})

    found = jax.jit(jax.vmap(jax.vmap(run, (None, 0)), (0, None)))(starts, bounces)
    every = {"h": np.repeat(starts, 2), "h_dot": 0.3}, {**values, "e": np.tile(bounces, 3)}
    sweep = ball("llvm").sweep((0.5, 1.5), *every, t_eval=T, **watched, **OPTIONS)

    def same(one, other):
        np.testing.assert_array_equal(np.reshape(one, np.shape(other)), other)

    same(found.q[..., 0], sweep["h"])
    same(found.qdot[..., 0], sweep["h_dot"])
    same(found.outputs[..., 0], sweep["momentum"])
    same(found.steps, sweep.steps)
    same(found.end.q[..., 0], sweep.final["h"])
    for name in ("impact", "h_dot"):
        for part in ("count", "first", "last"):
            same(getattr(found.events[name], part), getattr(sweep.events[name], part))
    assert np.min(found.events["impact"].count) >= 1
    for name, kept in found.reduced.items():
        same(kept, sweep.reduced[name])
    alone = run(starts[1], bounces[1])
    np.testing.assert_allclose(alone.y, found.y[1, 1], rtol=1e-13)
    with pytest.raises(OptionError, match=r"derivatives across jumps.*impact.*terminal=True"):
        jax.grad(lambda start: run(start, 0.5).q[-1, 0])(1.0)


def test_a_terminal_event_ends_the_run_and_is_differentiated(model):
    """Thrown up, the ball falls to a level that is a parameter of the event alone, and passes another height twice."""
    ends = da.Event(h - level, direction=-1, terminal=True, name="end")
    solve = model.solve_fn(events=[da.Event(h - 0.9, name="passes"), ends], **OPTIONS)

    def run(start, level, t0):
        return solve(T - 0.5 + t0, start, {"m": 2.0, "g": 9.81, "level": level})

    def found(start, level, t0):
        solved = run(start, level, t0)
        passes, end = solved.events["passes"], solved.end
        return jax.numpy.stack(
            [solved.q[1, 0], end.t, end.y[1], end.outputs[0], passes.first, passes.last, solved.events["end"].last]
        )

    def exact(start, level, t0):
        (place, speed), root = start, jax.numpy.sqrt
        time = lambda at, sign: (speed + sign * root(speed**2 + 2 * 9.81 * (place - at))) / 9.81  # noqa: E731
        last = speed - 9.81 * time(level, 1.0)
        times = [time(level, 1.0), time(0.9, -1.0), time(0.9, 1.0)]
        row = [place + speed * 0.2 - 9.81 * 0.02, t0 + times[0], last, 2.0 * last, t0 + times[1], t0 + times[2]]
        return jax.numpy.stack([*row, t0 + times[0]])

    at = np.array([0.6, 3.0]), 0.1, 0.5
    run_and_slopes = jax.jit(lambda *a: (run(*a), found(*a), jax.jacrev(found, (0, 1, 2))(*a)), compiler_options=QUICK)
    solved, values, slopes = run_and_slopes(*at)
    assert (int(solved.status), int(solved.events["passes"].count)) == (Status.EVENT, 2)
    assert np.all(np.isnan(solved.q[3])) and np.all(np.isfinite(solved.q[:3]))
    wanted, exact_slopes = jax.jit(lambda *a: (exact(*a), jax.jacfwd(exact, (0, 1, 2))(*a)))(*at)
    np.testing.assert_allclose(values, wanted, rtol=1e-9, atol=1e-10)
    for one, other in zip(slopes, exact_slopes, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-8)
    with pytest.raises(OptionError, match="first derivatives only"):
        jax.make_jaxpr(jax.jacfwd(jax.jacfwd(lambda level: run(at[0], level, 0.5).end.t)))(0.1)
    copy = pickle.loads(pickle.dumps(solve))
    np.testing.assert_array_equal(copy(T, at[0], {"m": 2.0, "g": 9.81, "level": 0.1}).q[:3], solved.q[:3])


def test_failures_are_statuses(model):
    solve = model.solve_fn(reduce=[h], **OPTIONS)
    batch = jax.jit(jax.vmap(lambda t, g: solve(t, [1.0, 0.0], {"m": 1.0, "g": g}), (0, 0)))
    times = np.array([[0.0, 0.1, 0.2], [0.0, 0.1, 0.2], [0.0, 0.2, 0.1], [0.3, 0.2, 0.1], [0.0, np.nan, 0.1]])
    found = batch(times, np.array([9.0, np.nan, 9.0, 9.0, 9.0]))
    wrong = int(Status.TIMES_IN_NO_ORDER)
    np.testing.assert_array_equal(found.status, [0, int(Status.NON_FINITE), wrong, 0, wrong])
    np.testing.assert_allclose(found.reduced["h"], [0.82, np.nan, np.nan, 0.82, np.nan])
    np.testing.assert_allclose(found.q[3, :, 0], [1.0, 0.955, 0.82])
    with pytest.raises(OptionError, match=r"derivatives of reductions \(h\)"):
        jax.grad(lambda g: solve([0.0, 0.1], [1.0, 0.0], {"m": 1.0, "g": g}).reduced["h"])(9.0)


@pytest.mark.matrix
def test_a_failed_run_ends_where_it_did_and_has_no_derivative_there(model):
    solve = model.solve_fn(events=[h], method="tsit5", max_step=0.1, max_steps=4)

    def found(g):
        run = solve([0.0, 1e-6, 5.0], [1.0, 2.0], {"m": 1.0, "g": g})
        return jax.numpy.stack([run.q[1, 0], run.end.t])

    run = solve([0.0, 1e-6, 5.0], [1.0, 2.0], {"m": 1.0, "g": 9.81})
    values, slopes = jax.jit(lambda g: (found(g), jax.jacrev(found)(g)), compiler_options=QUICK)(9.81)
    assert int(run.status) == Status.MAX_STEPS and 0.0 < float(run.end.t) < 5.0
    np.testing.assert_array_equal(values, [run.q[1, 0], run.end.t])
    np.testing.assert_allclose(slopes[0], -0.5e-12, rtol=1e-6)
    assert np.isnan(slopes[1])


def test_contacts_run_in_traced_code_forward(bouncing):
    times, start = np.linspace(0.0, 1.5, 4), {"x": 0.0, "y": 1.0, "x_dot": 1.0, "y_dot": 0.0}
    solve = bouncing.solve_fn(start, events=["y_dot"], reduce={"top": da.maximum("y")}, **OPTIONS)
    bounces = np.array([0.5, 0.7, 0.9])
    run = jax.jit(jax.vmap(lambda e: solve(times, start, {**P, "e": e})))
    found = run(bounces)
    compiled = da.compile_model(da.scenes.bouncing_ball())
    sweep = compiled.sweep(
        (0.0, 1.5),
        start,
        {**P, "e": bounces},
        t_eval=times,
        events=["y_dot"],
        reduce={"top": da.maximum("y")},
        **OPTIONS,
    )
    for i, name in enumerate(("x", "y")):
        np.testing.assert_array_equal(found.q[..., i], sweep[name])
        np.testing.assert_array_equal(found.end.qdot[..., i], sweep.final[f"{name}_dot"])
    np.testing.assert_array_equal(found.events["y_dot"].count, sweep.events["y_dot"].count)
    np.testing.assert_array_equal(found.reduced["top"], sweep.reduced["top"])
    with pytest.raises(OptionError, match=r"across changes of contacts \(ground\).*model\.mode\(ground='open'\)"):
        jax.grad(lambda e: solve(times, start, {**P, "e": e}).q[-1, 1])(0.5)
    with pytest.raises(OptionError, match=r"contacts that change \(ground\) are calls of the host, which jax\.export"):
        bouncing.solve_fn(start, portable=True)
    few = bouncing.solve_fn(start, max_steps=1, throw=True, **OPTIONS)
    with pytest.raises(RunFailedError, match="MAX_STEPS"):
        few(times, start, P)


def test_dense_output_is_that_of_the_wanted_times(bouncing):
    start = {"x": 0.0, "y": 1.0, "x_dot": 1.0, "y_dot": 0.0}
    stop = da.Event("x", direction=1, terminal=True, name="never")
    solve = bouncing.solve_fn(start, events=[da.Event("y_dot", name="top"), stop], dense=True, **OPTIONS)
    times, bounces = np.array([1.1, 0.0, 0.3, 1.5, 1.6, -0.1]), np.array([0.5, 0.9])
    motions = jax.jit(jax.vmap(lambda e: solve([0.0, 1.5], start, {**P, "e": e})))(bounces).dense
    found = jax.vmap(lambda motion: motion(times))(motions)
    wanted = jax.vmap(lambda e: solve(np.sort(times[:4]), start, {**P, "e": e}))(bounces)
    order = np.argsort(times[:4])
    for name in ("y", "q", "qdot", "outputs"):
        rows = np.asarray(getattr(found, name))
        np.testing.assert_array_equal(rows[:, :4][:, order], getattr(wanted, name))
        assert np.all(np.isnan(rows[:, 4:]))
    one = jax.tree.map(lambda leaf: leaf[1], motions)(0.3)
    assert one.q.shape == (2,)
    np.testing.assert_array_equal(one.q, found.q[1, 2])
    with pytest.raises(ValueInputError, match="time or times"):
        motions(np.zeros((2, 2)))


@pytest.mark.matrix
def test_dense_output_is_differentiated_up_to_the_end(model):
    ends = da.Event(h - level, direction=-1, terminal=True, name="end")
    solve = model.solve_fn(events=[ends], dense=True, **OPTIONS)

    def place(t, g):
        run = solve(T - 0.5, [0.6, 3.0], {"m": 2.0, "g": g, "level": 0.1})
        return run.dense(jax.numpy.stack([t, run.end.t])).q[:, 0]

    both = jax.jit(lambda *a: (place(*a), jax.jacfwd(place, (0, 1))(*a)), compiler_options=QUICK)
    values, (by_t, by_g) = both(0.2, 9.81)
    np.testing.assert_allclose(values, [1.2 - 9.81 * 0.02, 0.1], rtol=1e-10)
    np.testing.assert_allclose(by_t[0], 3.0 - 9.81 * 0.2, rtol=1e-9)
    np.testing.assert_allclose(by_g, [-0.02, 0.0], rtol=1e-8, atol=1e-9)
    assert np.all(np.isnan(both(0.9, 9.81)[0][:1]))


@pytest.mark.matrix
def test_single_precision_has_double_runs_on_the_host(model, bouncing):
    start, times = {"x": 0.0, "y": 1.0, "x_dot": 1.0, "y_dot": 0.0}, np.float32([0.0, 0.5, 1.0, 1.5])
    contacts = bouncing.solve_fn(start, events=["y_dot"], reduce={"top": da.maximum("y")}, dense=True)
    double = contacts(times, start, P)
    ends = da.Event(h - level, direction=-1, terminal=True, name="end")
    solve = model.solve_fn(events=[ends], method="tsit5", dense=True)
    with jax.enable_x64(False):
        found = contacts(times, start, {name: np.float32(value) for name, value in P.items()})
        np.testing.assert_allclose(found.q, double.q, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(found.status, double.status)
        assert {leaf.dtype.name for leaf in jax.tree.leaves(found)} == {"float32", "int32"}

        def end(level):
            run = solve(times, [0.6, 3.0], {"m": 2.0, "g": 9.81, "level": level})
            return run.end.t, run.dense(run.end.t).y

        (time, y), slope = jax.jit(lambda level: (end(level), jax.grad(lambda at: end(at)[0])(level)))(0.1)
        rate = -np.sqrt(9.0 + 2 * 9.81 * 0.5)
        np.testing.assert_allclose([time, *y], [(3.0 - rate) / 9.81, 0.1, rate], rtol=1e-5)
        np.testing.assert_allclose(slope, 1.0 / rate, rtol=1e-4)
        small = model.solve_fn(events=[ends], method="tsit5", rtol=1e-12)
        with pytest.warns(PrecisionWarning, match="rtol = 1e-12 asks"):
            jax.make_jaxpr(
                jax.grad(lambda level: small(times, [0.6, 3.0], {"m": 2.0, "g": 9.81, "level": level}).end.t)
            )(0.1)


def test_faults(model, bouncing):
    for each in (model, bouncing):
        with pytest.raises(UnknownNameError, match="'altitude'"):
            each.solve_fn(events=["altitude"])
        with pytest.raises(OptionError, match="euler"):
            each.solve_fn(events=["t"], method="euler")
    solve = model.solve_fn(events=[h - level])
    with pytest.raises(UnknownNameError, match="missing parameters: level"):
        solve(T, [1.0, 0.0], {"m": 1.0, "g": 9.81})
    with pytest.raises(CapabilityError, match='backend="jax"'):
        da.compile_model(da.scenes.bouncing_ball()).solve_fn()


@pytest.mark.parametrize("events", [(), (da.Event(h, direction=-1, name="floor"),)], ids=["traced", "hosted"])
def test_values_by_symbols(model, events):
    """Symbols are keys as in `simulate`; a name beside its symbol is an error, and no value of the two is taken."""
    solve = model.solve_fn([h, speed], events=events, **OPTIONS)
    falls = solve([0.0, 0.25], {h: 1.0, speed: 0.5}, {m: 1.0, g: 9.81})
    assert falls.q[-1, 0] == solve([0.0, 0.25], {"h": 1.0, "h_dot": 0.5}, {"m": 1.0, "g": 9.81}).q[-1, 0]
    for initial, p in (
        ({h: 1.0, "h": 2.0, speed: 0.5}, {m: 1.0, g: 9.81}),
        ({h: 1.0, speed: 0}, {m: 1.0, "m": 2, g: 1}),
    ):
        with pytest.raises(UnknownNameError, match=r"'(h|m)' is given twice"):
            solve([0.0, 0.25], initial, p)
