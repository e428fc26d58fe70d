"""Times to record at which the state jumps: the state after the jump, by every route."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

x = dynamicsymbols("x")
v = x.diff()
START = {x: 1, v: 0}  # x = 1 - t^2 up to t = 1, where a rate of -2 becomes 1
JUMP = da.Event(x, direction=-1, apply={v: -v / 2})
LAST = da.Event(x, direction=-1, apply={v: -v / 2}, terminal=True)


def ball(contact, drag=0, restitution=sp.S.Half):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, (-2 - drag * (v * sp.sqrt(v**2 + 1) + 3 * sp.sin(3 * x))) * N.x))
    if contact:
        normal = da.unknowns("F")
        scene.add_joints(da.Joint("floor", body="body", at=place, force=normal * N.x))
        scene.add_contacts(da.UnilateralContact(normal, gap=x, name="floor", restitution=restitution))
    return scene


@pytest.fixture(scope="module", params=["llvm", "numpy"])
def models(request):
    return {contact: da.compile_model(ball(contact), backend=request.param) for contact in (False, True)}


def near(t, roundings):
    return t + roundings * np.spacing(t)


@pytest.mark.parametrize("events, contact", [([JUMP], False), ([LAST], False), ([], True)])
def test_the_state_after_the_jump(models, events, contact):
    """Up to rounding of the time at which it is located, in single runs and in sweeps."""
    model = models[contact]
    for method in model.methods:
        if method in ("bdf", "lsoda", "rk45"):
            continue
        whole = model.simulate((0, 1.5), START, {}, events=events, method=method)
        last = max(1.0, whole.t[np.argmax(whole["x_dot"] > 0.0)])  # rounding of stages may move it by some 1e-13
        assert last == pytest.approx(1.0, abs=1e-12)
        times = np.array([0.5, near(last, -3), last])
        run = model.simulate((0, 1.5), START, {}, events=events, t_eval=times, method=method)
        sweep = model.sweep((0, 1.5), {x: [1.0, 1.0], v: 0}, {}, events=events, t_eval=times, method=method)
        rates = np.asarray(sweep["x_dot"])
        for found in (run["x_dot"], *rates):
            reached = found[np.isfinite(found)]  # a terminal event may lie some roundings before t = 1
            np.testing.assert_allclose(reached, [-1.0, 1.0, 1.0][: len(reached)], atol=1e-6, err_msg=method)
        np.testing.assert_array_equal(run.t, times[: len(run.t)])


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
@pytest.mark.parametrize("contact", [False, True])
def test_times_of_a_run_given_to_it_again(contact, method):
    """All occurrences of one run, which another run of the same kind locates a few roundings elsewhere."""
    events = [] if contact else [JUMP]
    model = da.compile_model(ball(contact))
    run = model.simulate((0, 2.5), START, {}, events=events, method=method)
    jumps = np.unique(run.t[1:][np.diff(run.t) == 0])
    again = model.simulate((0, 2.5), START, {}, events=events, method=method, t_eval=jumps)
    assert len(jumps) > 1 and (again["x_dot"] > 0.1).all()
    np.testing.assert_array_equal(again.t, jumps)
    if contact or method == "taylor":  # the steps are the same in a sweep
        sweep = model.sweep((0, 2.5), {x: [1.0], v: 0}, {}, events=events, method=method, t_eval=jumps)
        assert (np.asarray(sweep["x_dot"]) > 0.1).all()


@pytest.fixture(scope="module")
def falling():
    """A ball whose motion no method integrates exactly, so that where its impacts are depends on the steps."""
    return da.compile_model(ball(True, sp.Rational(1, 10), sp.Rational(9, 10)))


def impacts(model, height, method):
    run = model.simulate((0, 2.5), {x: height, v: 0}, {}, method=method)
    return np.unique(run.t[1:][np.diff(run.t) == 0])


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_samples_of_sweeps_at_impacts(falling, method):
    """To the last bit of the time: values after the impact, those of the single run."""
    for height in (0.5, 1.0, 1.5):
        times = impacts(falling, height, method)
        run = falling.simulate((0, 2.5), {x: height, v: 0}, {}, method=method, t_eval=times)
        sweep = falling.sweep((0, 2.5), {x: [height, 0.7], v: 0}, {}, method=method, t_eval=times)
        assert len(times) > 0 and (run["x_dot"] > 0.1).all()
        np.testing.assert_allclose(np.asarray(sweep["x_dot"])[0], run["x_dot"], rtol=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_spans_that_end_at_impacts(falling, method):
    """Their last steps are cut, which moves the impact by the error of a step: the value is the one after it."""
    for height in (0.5, 1.0, 1.5):
        times = impacts(falling, height, method)
        cases = {x: np.full(len(times), height), v: 0}
        ends = falling.sweep((np.zeros(len(times)), times), cases, {}, method=method)
        after = falling.simulate((0, 2.5), {x: height, v: 0}, {}, method=method, t_eval=times)
        np.testing.assert_allclose(ends["x_dot"], after["x_dot"], atol=1e-6)
        assert ends.success.all()
        for t, expected in zip(times, after["x_dot"], strict=True):
            run = falling.simulate((0, t), {x: height, v: 0}, {}, method=method, t_eval=[t])
            assert run["x_dot"][-1] == pytest.approx(expected, rel=1e-6)
            assert falling.prepare((0, t), method=method)(np.array([height, 0.0]), np.zeros(0))[1] == pytest.approx(
                expected, rel=1e-6
            )


def test_a_span_that_ends_before_an_impact(falling):
    """By more than the error of a step: the ball falls, and no contact has met."""
    (time, *_) = impacts(falling, 1.0, "dop853")
    for early in (1e-6, 1e-4):
        run = falling.simulate((0, time - early), {x: 1.0, v: 0}, {}, method="dop853")
        assert run["x_dot"][-1] < 0 and run["x"][-1] > 0


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_samples_inside_steps_on_constraints(method):
    """Those of sweeps are projected as those of single runs are, in the phase in which they are."""
    y, rim = dynamicsymbols("y"), da.unknowns("R")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y])
    place = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, -2 * N.y))
    scene.add_holonomic_constraints(x**2 + y**2 - 1)
    scene.add_joints(da.Joint("floor", body="body", at=place, force=rim * N.y))
    scene.add_contacts(da.UnilateralContact(rim, gap=y + sp.S.Half, name="floor", restitution=sp.S.Half))
    model = da.compile_model(scene, formulation="projected")
    start = {x: 1.0, y: 0.0, "x_dot": 0.0, "y_dot": 0.0}
    times = np.linspace(0.05, 2.0, 40)
    run = model.simulate((0, 2), start, {}, method=method, t_eval=times)
    sweep = model.sweep((0, 2), {**start, x: [1.0, 1.0]}, {}, method=method, t_eval=times)
    assert (np.diff(np.sign(run["y_dot"])) > 0).any()
    for name in ("x", "y", "x_dot", "y_dot"):
        np.testing.assert_allclose(sweep[name], [run[name]] * 2, atol=1e-7)
    assert np.max(np.abs(sweep["x"] ** 2 + sweep["y"] ** 2 - 1)) < 1e-14
    assert np.max(np.abs(sweep["x"] * sweep["x_dot"] + sweep["y"] * sweep["y_dot"])) < 1e-14
    np.testing.assert_array_equal(sweep.mode("floor"), [run.mode("floor")] * 2)


@pytest.mark.parametrize("contact", [False, True])
def test_a_jump_at_the_end_of_the_span(models, contact):
    model, events = models[contact], [] if contact else [JUMP]
    for t_eval in (None, [1.0]):
        run = model.simulate((0, 1), START, {}, events=events, t_eval=t_eval)
        sweep = model.sweep((0, 1), {x: [1.0], v: 0}, {}, events=events, t_eval=t_eval)
        assert run["x_dot"][-1] == pytest.approx(1.0, abs=1e-6)
        assert np.ravel(sweep["x_dot"])[-1] == pytest.approx(1.0, abs=1e-6)


def test_backwards_and_at_a_start_elsewhere():
    """The order is that of the run: what lies behind the jump when time runs back."""
    model = da.compile_model(ball(False))
    up = da.Event(x, apply={v: 2 * v})
    run = model.simulate((4, 2), {x: 0.75, v: 1.0}, {}, events=[up], t_eval=[3.0, 2.5], method="taylor")
    sweep = model.sweep((4, 2), {x: [0.75], v: 1.0}, {}, events=[up], t_eval=[3.0, 2.5], method="taylor")
    for found in (run["x_dot"], np.ravel(sweep["x_dot"])):
        np.testing.assert_allclose(found, _backwards(np.array([3.0, 2.5])), atol=1e-9)


def _backwards(t):
    """x = 0.75 + s - s^2 of s = t - 4 is zero at s = -1/2, where the rate 2 becomes 4."""
    s = t - 4
    return np.where(s > -0.5, 1 - 2 * s, 4 - 2 * (s + 0.5))


def test_kinds_of_times_in_jax():
    pytest.importorskip("jax")
    import jax

    with jax.enable_x64(True):
        model = da.compile_model(ball(False), backend="jax")
        run = model.simulate((0, 1.5), START, {}, events=[JUMP], t_eval=[0.5, 1.0], method="taylor")
        assert run["x_dot"][0] == pytest.approx(-1) and run["x_dot"][1] == pytest.approx(1.0, abs=1e-6)


def test_times_are_recorded_as_they_are_given(models):
    """Also those within rounding before an impact, whose values are those after it."""
    times = np.array([near(1.0, roundings) for roundings in range(-6, 7)])
    for method in {"taylor", "dop853", "radau"} & {*models[True].methods}:
        run = models[True].simulate((0, 1.5), START, {}, t_eval=times, method=method)
        np.testing.assert_array_equal(run.t, times)
        np.testing.assert_array_equal(run(times).t, times)
