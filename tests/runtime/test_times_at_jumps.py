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


def ball(contact):
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[x])
    place = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, -2 * N.x))
    if contact:
        normal = da.unknowns("F")
        scene.add_joints(da.Joint("floor", body="body", at=place, force=normal * N.x))
        scene.add_contacts(da.UnilateralContact(normal, gap=x, name="floor", restitution=sp.S.Half))
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
    times = np.array([0.5, near(1.0, -3), 1.0])
    for method in model.methods:
        if method in ("bdf", "lsoda", "rk45"):
            continue
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
    if method == "taylor":  # its steps are the same in a sweep
        sweep = model.sweep((0, 2.5), {x: [1.0], v: 0}, {}, events=events, method=method, t_eval=jumps)
        assert (np.asarray(sweep["x_dot"]) > 0.1).all()


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
