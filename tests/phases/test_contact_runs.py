"""Reductions, error estimates, prepared runs and users' events of scenes with contacts, against closed forms."""

import math
import threading
from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError
from dalembert.methods.status import Status
from dalembert.phases import case_runs, runner_choice
from dalembert.results import parts
from hard_cases.contacts import corner_plate, incline_scene, table_oscillator

TIME = dynamicsymbols._t
G = 9.81
BALL = {"m": 1.0, "g": G}
DROPPED = {"x": 0.0, "y": 1.0, "x_dot": 0.5, "y_dot": 0.0}
PLATE = {"m": 1.0, "l": 1.0, "h": 0.5, "g": G, "mu": 0.8}
TILTED = {"x": -0.5 / math.tan(0.5), "theta": 0.5, "theta_dot": 0.0}
FINE = {"rtol": 1e-11, "atol": 1e-13}
y = dynamicsymbols("y")


@cache
def ball():
    return da.compile_model(da.scenes.bouncing_ball(), outputs=["N"])


@cache
def plate():
    return da.compile_model(corner_plate(4 + 7 * sp.sin(3 * TIME)), outputs=["N_Q"])


@cache
def belt():
    return da.compile_model(da.scenes.belt_oscillator(), outputs=["F"])


# -- reductions -----------------------------------------------------------------------------------


def test_reductions_of_a_bouncing_ball_are_its_closed_forms():
    """Up to the second impact: heights e^2 and the times between impacts."""
    e = np.array([0.3, 0.6, 0.9])
    first, speed = math.sqrt(2 / G), math.sqrt(2 * G)
    second = first * (1 + 2 * e)
    wanted = {
        "top": da.maximum(y - 1),
        "down": da.minimum("y_dot"),
        "up": da.maximum(sp.Symbol("y_dot")),
        "mean": da.mean(y),
        "load": da.maximum("N"),
        "end": da.final(dynamicsymbols("x")),
        "half": da.first_crossing(y - sp.Rational(1, 2)),
    }
    run = ball().sweep((0, second), DROPPED, {**BALL, "e": e}, reduce=wanted, **FINE)
    found = run.reduced
    area = 2 / 3 * first + (2 / 3) * e**2 * (2 * e * first)
    assert list(found) == list(wanted)
    np.testing.assert_allclose(found["top"], 0, atol=1e-12)
    np.testing.assert_allclose(found["down"], -speed, rtol=1e-11)
    np.testing.assert_allclose(found["up"], e * speed, rtol=1e-11)
    np.testing.assert_allclose(found["mean"], area / second, rtol=1e-11)
    np.testing.assert_allclose(found["load"], 0, atol=1e-12)
    np.testing.assert_allclose(found["end"], 0.5 * second, rtol=1e-11)
    np.testing.assert_allclose(found["half"], math.sqrt(1 / G), rtol=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_reductions_of_a_plate_are_those_of_its_single_runs(method):
    """Fifteen phases: an angle that turns round within them, and a reaction that jumps between them."""
    mu = np.array([0.75, 0.9])
    wanted = {"most": da.maximum("theta"), "least": da.minimum("theta"), "work": da.mean("energy")}
    wanted |= {
        "slow": da.minimum("N_Q"),
        "last": da.final("theta"),
        "turn": da.first_crossing("theta_dot", direction=-1),
    }
    tolerances = {"rtol": 1e-9, "atol": 1e-11}
    run = plate().sweep((0, 4), TILTED, {**PLATE, "mu": mu}, reduce=wanted, method=method, **tolerances)
    assert run.success.all()
    for i, value in enumerate(mu):
        motion = plate().simulate((0, 4), TILTED, {**PLATE, "mu": value}, **FINE)
        t = np.unique(np.concatenate([np.linspace(0, 4, 8001), motion.t]))
        dense, bound = motion(t), 1e-6 if method in ("tsit5", "radau") else 1e-7
        assert run.reduced["most"][i] == pytest.approx(dense["theta"].max(), abs=bound)
        assert run.reduced["least"][i] == pytest.approx(dense["theta"].min(), abs=bound)
        assert run.reduced["work"][i] == pytest.approx(np.trapezoid(dense["energy"], t) / 4, abs=1e-5)
        assert run.reduced["slow"][i] == pytest.approx(min(dense["N_Q"].min(), motion["N_Q"].min()), abs=1e-5)
        assert run.reduced["last"][i] == pytest.approx(dense["theta"][-1], abs=bound)
        before = motion(run.reduced["turn"][i] - 1e-4)["theta_dot"][0]
        after = motion(run.reduced["turn"][i] + 1e-4)["theta_dot"][0]
        assert before > -bound and after < bound and before > after


def test_reductions_do_not_depend_on_who_runs_the_phases(monkeypatch):
    """Compiled code, in one thread or two and with samples, and Python."""
    mu = np.linspace(0.7, 0.95, 13)
    wanted = {
        "most": da.maximum("theta_dot"),
        "mean": da.mean("theta"),
        "turn": da.first_crossing(dynamicsymbols("theta") - sp.Rational(11, 20)),
    }

    def swept(**options):
        run = plate().sweep((0, 3), TILTED, {**PLATE, "mu": mu}, reduce=wanted, **FINE, **options)
        return np.array(list(run.reduced.values()))

    expected = swept(threads=1)
    np.testing.assert_array_equal(swept(threads=2), expected)
    np.testing.assert_allclose(swept(t_eval=np.linspace(0, 3, 7)), expected, rtol=1e-9, atol=1e-10)
    monkeypatch.setattr(runner_choice, "runs_unchecked", lambda model: False)
    np.testing.assert_allclose(swept(), expected, rtol=1e-12, atol=1e-13)


def test_a_block_that_stops_keeps_what_it_reached():
    """It slides up an incline, stops and sticks: the distance v^2 / (2 g (sin + mu cos))."""
    model = da.compile_model(incline_scene())
    v, alpha, mu = np.array([0.5, 1.0, 2.0]), 0.3, 0.6
    slow = G * (math.sin(alpha) + mu * math.cos(alpha))
    reach, stop, end = v**2 / (2 * slow), v / slow, 1.0
    start = {"x": 0.0, "x_dot": v}
    p = {"m": 1.0, "g": G, "alpha": alpha, "mu": mu}
    wanted = {"far": da.maximum("x"), "mean": da.mean("x"), "end": da.final("x"), "fast": da.maximum("x_dot")}
    run = model.sweep((0, end), start, p, reduce=wanted, **FINE)
    np.testing.assert_allclose(run.reduced["far"], reach, rtol=1e-11)
    np.testing.assert_allclose(run.reduced["end"], reach, rtol=1e-11)
    np.testing.assert_allclose(run.reduced["fast"], v, rtol=1e-12)
    np.testing.assert_allclose(run.reduced["mean"], (2 / 3 * reach * stop + reach * (end - stop)) / end, rtol=1e-11)


def test_cases_that_fail_or_take_no_time():
    """A case that starts below the ground has no reductions; one without a span has the values of its start."""
    start = {**DROPPED, "y": [1.0, -1.0, 1.0]}
    wanted = {"top": da.maximum(y), "mean": da.mean(y), "end": da.final(y), "half": da.first_crossing(y - 0.5)}
    run = ball().sweep((0, [0.6, 0.6, 0.0]), start, {**BALL, "e": 0.5}, reduce=wanted)
    assert [Status(s) for s in run.status] == [Status.SUCCESS, Status.INITIAL_STATE, Status.SUCCESS]
    found = np.array(list(run.reduced.values()))
    assert np.all(np.isnan(found[:, 1])) and np.all(np.isfinite(found[:, 0]))
    np.testing.assert_array_equal(found[:, 2], [1, 1, 1, np.nan])


# -- error estimates ------------------------------------------------------------------------------


def test_the_estimate_is_the_error_and_nan_between_the_changes():
    tolerances = {"rtol": 1e-6, "atol": 1e-8, "method": "dop853"}
    run = plate().simulate((0, 4), TILTED, PLATE, t_eval=np.linspace(0, 4, 401), error_estimate=True, **tolerances)
    exact = plate().simulate((0, 4), TILTED, PLATE, **FINE)(run.t)
    estimate = run.error_estimate["theta"]
    known = np.isfinite(estimate)
    assert known.sum() > 390
    error = np.abs(run["theta"] - exact["theta"])[known]
    assert error.max() > 1e-9
    np.testing.assert_allclose(estimate[known], error, rtol=0.2, atol=0.1 * error.max())  # the twin is interpolated
    steps = plate().simulate((0, 4), TILTED, PLATE, error_estimate=True, **tolerances)
    ends = np.isin(steps.t, [phase.t1 for phase in steps.phases[:-1]])
    assert np.isnan(steps.error_estimate["x_dot"]).sum() <= ends.sum() and np.isfinite(steps.error_estimate["x"][-1])
    times = np.array([0.5, 1.2, 2.9, 4.0])
    sweep = plate().sweep((0, 4), TILTED, {**PLATE, "mu": [0.8, 0.9]}, t_eval=times, error_estimate=True, **tolerances)
    error = np.abs(sweep["theta"][0] - plate().simulate((0, 4), TILTED, PLATE, t_eval=times, **FINE)["theta"])
    np.testing.assert_allclose(sweep.error_estimate["theta"][0], error, rtol=0.2, atol=2e-2 * error.max())
    whole = plate().sweep((0, 4), TILTED, PLATE, error_estimate=True, **tolerances)
    assert whole.error_estimate["theta"][0] == pytest.approx(estimate[-1], rel=0.3, abs=1e-9)


def test_an_estimate_is_nan_where_the_twin_is_in_another_phase():
    """A ball between the two times at which the run and its twin bounce, which are moved apart here."""
    run = ball().simulate((0, 1), DROPPED, {**BALL, "e": 0.5}, t_eval=[0.3, 0.45, 0.46, 1.0])
    late = ball().simulate((0, 1), {**DROPPED, "y": 1.05}, {**BALL, "e": 0.5})
    found = run.with_twin(late).error_estimate["y_dot"]
    np.testing.assert_array_equal(np.isnan(found), [False, False, True, False])
    ends = [ball().sweep((0, 0.46), {**DROPPED, "y": h}, {**BALL, "e": 0.5}) for h in (1.0, 1.05)]
    assert np.isnan(ends[0].with_twin(ends[1]).error_estimate["y"][0])
    assert ends[0].with_twin(ends[0]).error_estimate["y"][0] == 0.0


def test_estimates_are_not_for_runs_with_events():
    with pytest.raises(da.errors.OptionError, match="leave out one of the two"):
        ball().simulate((0, 1), DROPPED, {**BALL, "e": 0.5}, events=["y_dot"], error_estimate=True)
    with pytest.raises(da.errors.OptionError, match="leave out one of the two"):
        ball().sweep((0, 1), DROPPED, {**BALL, "e": 0.5}, reduce={"a": da.mean("y")}, error_estimate=True)
    with pytest.raises(da.errors.OptionError, match="error_estimate=True"):
        _ = ball().simulate((0, 1), DROPPED, {**BALL, "e": 0.5}).error_estimate


# -- prepared runs --------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_a_prepared_run_has_the_bits_of_a_sweep(method):
    """With one memory for many motions, one after the other and in threads."""
    model, mu = plate(), np.linspace(0.7, 0.9, 5)
    run = model.prepare((0, 3), method=method)
    sweep = model.sweep((0, 3), TILTED, {**PLATE, "mu": mu}, method=method)
    expected = np.array([sweep[name] for name in ("x", "theta", "x_dot", "theta_dot")]).T
    x = model.state(TILTED, PLATE)
    given = [model.parameter_vector({**PLATE, "mu": value}) for value in mu]
    found = np.array([run(x, p) for p in given])
    np.testing.assert_array_equal(found, expected)
    assert run.status is Status.SUCCESS
    again = {}
    threads = [threading.Thread(target=lambda i=i, p=p: again.update({i: run(x, p)})) for i, p in enumerate(given)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal([again[i] for i in range(len(mu))], expected)


def test_how_prepared_runs_end():
    model, p = ball(), ball().parameter_vector({**BALL, "e": 0.5})
    x = model.state(DROPPED, {**BALL, "e": 0.5})
    run = model.prepare((0, 2))
    assert run(x, p)[1] == 0 and run.status is Status.SUCCESS
    below = x.copy()
    below[1] = -0.5
    run(below, p)
    assert run.status is Status.INITIAL_STATE
    run(np.full(4, np.nan), p)
    assert run.status is Status.NON_FINITE
    np.testing.assert_array_equal(run(x, p)[1], 0)
    assert run.status is Status.SUCCESS
    short = model.prepare((0, 2), max_steps=3)
    short(x, p)
    assert short.status is Status.MAX_STEPS
    back = model.prepare((0.2, 0.0))(model.prepare((0, 0.2))(x, p), p)
    np.testing.assert_allclose(back, x, atol=1e-12)
    with pytest.raises(da.errors.ValueInputError, match=r"state must have shape \(4,\), for x, y, x_dot, y_dot"):
        run(np.zeros(3), p)
    with pytest.raises(da.errors.OptionError, match="project_invariants"):
        model.prepare((0, 1), project_invariants=True)


def test_a_prepared_run_with_jumps_in_time_and_late_starts():
    force = sp.Piecewise((6, TIME < 1), (-6, True))
    model = da.compile_model(corner_plate(force))
    p = {**PLATE, "mu": 0.6}
    expected = model.simulate((0, 1.4), TILTED, p, rtol=1e-11, atol=1e-13)
    found = model.prepare((0, 1.4), rtol=1e-11, atol=1e-13)(model.state(TILTED, p), model.parameter_vector(p))
    np.testing.assert_allclose(found, expected.y[-1], atol=1e-9)
    late = plate().simulate((1e6, 1e6 + 2), TILTED, PLATE, **FINE)
    run = plate().prepare((1e6, 1e6 + 2), **FINE)
    found = run(plate().state(TILTED, PLATE), plate().parameter_vector(PLATE))
    np.testing.assert_allclose(found, late.y[-1], atol=1e-9)


# -- events that map the state, or end a case later -----------------------------------------------


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
@pytest.mark.parametrize("compiled", [True, False])
def test_a_ball_between_the_ground_and_a_shelf(monkeypatch, method, compiled):
    """Thrown up to a shelf that sends it back with half its speed; the case ends at the third bump."""
    if not compiled:
        monkeypatch.setattr(runner_choice, "runs_unchecked", lambda model: False)
    yd = y.diff()
    shelf = da.Event(y - 1, direction=1, apply={yd: -yd / 2}, name="shelf", terminal=3)
    start = {"x": 0.0, "y": 0.0, "x_dot": 0.0, "y_dot": [12.0, 10.0, 8.0, 5.0]}
    tolerances = {"rtol": 1e-10, "atol": 1e-12, "method": method}
    sweep = ball().sweep((0, 2), start, {**BALL, "e": 1.0}, events=[shelf, "y_dot"], **tolerances)
    for i, speed in enumerate(start["y_dot"]):
        run = ball().simulate(
            (0, 2), {**start, "y_dot": speed}, {**BALL, "e": 1.0}, events=[shelf, "y_dot"], **tolerances
        )
        times, t, v = [], 0.0, speed
        while len(times) < 3 and v * v > 2 * G:  # up, bump, down
            top = math.sqrt(v * v - 2 * G)
            t += (v - top) / G
            times.append(t)
            v = math.sqrt(top * top / 4 + 2 * G)
            t += (v - top / 2) / G
        np.testing.assert_allclose(run.events["shelf"].t, times, rtol=1e-9)
        assert sweep.events["shelf"].count[i] == len(times)
        if times:
            assert sweep.events["shelf"].first[i] == pytest.approx(times[0], rel=1e-9)
            assert sweep.events["shelf"].last[i] == pytest.approx(times[-1], rel=1e-9)
        ended = Status.EVENT if len(times) == 3 else Status.SUCCESS
        assert run.status is ended and Status(sweep.status[i]) is ended
        assert sweep.t[i] == pytest.approx(run.t_end, rel=1e-9)
        last = -top / 2 if ended is Status.EVENT else run["y_dot"][-1]
        assert sweep["y_dot"][i] == pytest.approx(last, abs=1e-8)
        assert sweep.events["y_dot"].count[i] == len(run.events["y_dot"])
        assert sweep.phases[i] == len(run.phases)


def test_an_event_ends_a_case_at_its_fourth_occurrence_whatever_the_phases_between():
    """A block on a belt passes a place twice a period, in stick and in slip."""
    p = {"m": 1.0, "k": 4.0, "v_b": 0.3, "mu": 0.2, "mu_s": 0.4, "g": G}
    start = {"x": 0.0, "x_dot": 0.3}
    place = da.Event(dynamicsymbols("x") - sp.Rational(3, 5), terminal=4, name="place")
    run = belt().simulate((0, 30), start, p, events=[place], **FINE)
    sweep = belt().sweep((0, 30), start, {**p, "k": [4.0, 4.0]}, events=[place], t_eval=[0.0, 1.0, 2.0], **FINE)
    assert run.status is Status.EVENT and len(run.events["place"]) == 4 and len(run.phases) > 3
    assert [Status(s) for s in sweep.status] == [Status.EVENT] * 2
    np.testing.assert_allclose(sweep.t, run.t_end, rtol=1e-10)
    np.testing.assert_array_equal(sweep.events["place"].count, 4)


def test_a_jump_that_the_constraints_forbid_ends_its_case():
    xd = dynamicsymbols("x").diff()
    push = da.Event(TIME - sp.Rational(1, 2), apply={xd: xd + 1, y.diff(): 1}, name="push")
    p, start = {"m": 1.0, "k": 4.0, "v_b": 0.3, "mu": 0.2, "mu_s": 0.4, "g": G}, {"x": 0.0, "x_dot": 0.3}
    sweep = belt().sweep((0, [1.0, 0.4]), start, p, events=[push])
    assert [Status(s) for s in sweep.status] == [Status.EVENT_STATE, Status.SUCCESS]
    assert belt().simulate((0, 1), start, p, events=[push]).status is Status.EVENT_STATE


def test_a_jump_through_a_contact_does_not_take_place():
    """The run up to there is kept, and so is its last state; states that contacts refuse at the start are none."""
    dig = da.Event(TIME - sp.Rational(1, 4), apply={y: y - 2}, name="dig")
    times, p = [0.0, 0.2, 0.25, 0.3], {**BALL, "e": 0.5}
    run = ball().simulate((0, 1), DROPPED, p, events=[dig])
    assert run.status is Status.EVENT_STATE and run.t_end == 0.25
    np.testing.assert_allclose(run(0.2)["y"], 1 - 0.02 * G, rtol=1e-13)
    np.testing.assert_allclose(run.events["dig"].after["y"], 1 - G / 32, rtol=1e-13)
    sweep = ball().sweep((0, 0.3), {**DROPPED, "y": [1.0, 9.0, -1.0]}, p, events=[dig], t_eval=times)
    assert [Status(s) for s in sweep.status] == [Status.EVENT_STATE, Status.SUCCESS, Status.INITIAL_STATE]
    fall = 0.5 * G * np.square([0.25, 0.3, np.nan])
    np.testing.assert_allclose(sweep.final["y"], [1, 7, np.nan] - fall, rtol=1e-13)
    assert sweep.final["y"][0] == run["y"][-1] and sweep.phases[0] == len(run.phases)
    np.testing.assert_array_equal(np.isnan(sweep["y"]).sum(axis=1), [2, 0, 4])


def test_a_jump_after_friction_has_failed_turns_friction():
    """A block that 10 t N have torn off at 0.5 s is thrown back at 0.8 s, with v = -1: friction pushes it forwards.

    v = -1 + 5 (t^2 - 0.64) + 5 (t - 0.8) until it turns, where t^2 + t = 1.64; then v' = 10 t - 5.
    """
    model = da.compile_model(table_oscillator(lambda x: 10 * TIME))
    p = {"m": 1.0, "mu": 0.5, "g": 10.0}
    throw = da.Event(TIME - sp.Rational(4, 5), apply={dynamicsymbols("x").diff(): -1}, name="throw")
    run = model.simulate((0, 1.5), {"x": 0.0, "x_dot": 0.0}, p, events=[throw], **FINE)
    turn = (math.sqrt(7.56) - 1) / 2
    assert run.success
    np.testing.assert_allclose([phase.t1 for phase in run.phases], [0.5, 0.8, turn, 1.5], rtol=1e-9)
    assert run["x_dot"][-1] == pytest.approx(5 * (2.25 - turn**2) - 5 * (1.5 - turn), rel=1e-9)


# -- records of single runs -----------------------------------------------------------------------


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_a_single_run_has_the_bits_of_a_sweep(method):
    sweep = plate().sweep((0, 3), TILTED, PLATE, method=method)
    run = plate().simulate((0, 3), TILTED, PLATE, method=method)
    for name in ("x", "theta", "x_dot", "theta_dot"):
        assert run[name][-1] == sweep[name][0]
    assert sweep.steps[0] == run.stats.steps and sweep.phases[0] == len(run.phases)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_a_recorded_run_is_continuous(method):
    """Between its steps as good as at them; where guards cut steps, too; backwards it returns."""
    run = plate().simulate((0, 3), TILTED, PLATE, method=method, rtol=1e-9, atol=1e-11)
    exact = plate().simulate((0, 3), TILTED, PLATE, **FINE)
    t = np.linspace(0, 3, 601)
    np.testing.assert_allclose(run(t)["theta"], exact(t)["theta"], atol=2e-7)
    np.testing.assert_allclose(run(t)["x_dot"], exact(t)["x_dot"], atol=2e-6)
    for part in run._whole:
        np.testing.assert_allclose(part(part.t).y, part.y, rtol=0, atol=1e-13)
    up = ball().simulate(
        (0.3, 0.0), {**DROPPED, "y": 1 - G * 0.09 / 2, "y_dot": -G * 0.3}, {**BALL, "e": 0.5}, method=method
    )
    assert (
        up(0.0)["y"][0] == pytest.approx(1.0, abs=1e-9)
        and up.t[0] == 0.3
        and up(0.1)["y_dot"][0] == pytest.approx(-G * 0.1)
    )


def test_records_longer_than_their_arrays(monkeypatch):
    """Many steps within a phase, many phases, and many events: the loop returns to Python for room."""
    options = {"max_step": 1e-3, "events": [da.Event(sp.sin(2000 * TIME), name="tick")]}
    run = ball().simulate((0, 1.4), DROPPED, {**BALL, "e": 0.6}, **options)
    assert run.stats.steps > 1400
    np.testing.assert_allclose(run.events["tick"].t, np.arange(1, 892) * math.pi / 2000, rtol=1e-12)
    np.testing.assert_array_equal(np.unique(run.events["tick"].direction), [-1, 1])
    np.testing.assert_allclose(run.events["tick"]["x"], 0.5 * run.events["tick"].t, rtol=1e-12)
    monkeypatch.setattr(case_runs, "_LINES", 3)
    short = ball().simulate((0, 1.4), DROPPED, {**BALL, "e": 0.6}, rtol=3e-8)
    plain = ball().simulate((0, 1.4), DROPPED, {**BALL, "e": 0.6})
    assert [phase.modes for phase in short.phases] == [phase.modes for phase in plain.phases]
    np.testing.assert_allclose(short.y[-1], plain.y[-1], atol=1e-12)


def test_every_run_takes_the_first_step_that_it_is_given():
    """The memory of a run, which the next one takes, has modes that are run without it."""
    runs = [plate().simulate((0, 2), TILTED, PLATE, method="dop853", first_step=step) for step in (1e-3, 1e-3, 2e-3)]
    assert [run.t[1] for run in runs] == [1e-3, 1e-3, 2e-3]
    assert np.array_equal(runs[0].y, runs[1].y)


def test_what_is_kept_of_a_run_is_what_was_asked_for():
    p = {**BALL, "e": 0.5}
    bare = ball().simulate((0, 1), DROPPED, p, dense=False, events=[da.Event(y - sp.Rational(1, 2), name="half")])
    assert not bare.can_evaluate and len(bare.events["half"]) == 1
    np.testing.assert_allclose(bare.events["half"]["y"], 0.5, rtol=1e-14)
    some = ball().simulate((0, 1), DROPPED, p, t_eval=[0.0, 0.2, 0.9])
    np.testing.assert_allclose(some["y"][:2], [1, 1 - G * 0.02], rtol=1e-13)
    assert len(ball().simulate((0.5, 0.5), DROPPED, p).t) == 1
    first = ball().simulate((0, 1), DROPPED, p, first_step=1e-3, method="dop853")
    assert first.t[1] <= 1e-3 and len(first.phases) == len(bare.phases)
    assert ball().simulate((0, 2), DROPPED, p, max_steps=4).status is Status.MAX_STEPS


def test_the_state_after_a_jump_is_recorded():
    yd = y.diff()
    turn = da.Event(y - sp.Rational(1, 2), direction=-1, apply={yd: -yd / 2}, name="turn", terminal=2)
    run = ball().simulate((0, 3), DROPPED, {**BALL, "e": 0.5}, events=[turn])
    fall = math.sqrt(G)
    np.testing.assert_allclose(run.events["turn"].before["y_dot"], [-fall, -fall / 2], rtol=1e-12)
    np.testing.assert_allclose(run.events["turn"].after["y_dot"], [fall / 2, fall / 4], rtol=1e-12)
    assert run["y_dot"][-1] == run.events["turn"].after["y_dot"][-1] and run.t[-1] == run.t[-2] == run.t_end
    np.testing.assert_array_equal(run.constraint_violation, 0.0)
    with_gap = ball().simulate((0, 3), DROPPED, {**BALL, "e": 0.5}, events=[turn], method="radau")
    np.testing.assert_allclose(with_gap.events["turn"].after["y_dot"], [fall / 2, fall / 4], rtol=1e-6)


@pytest.mark.parametrize("t0", [10.0, 1000.0, -1000.0])
def test_far_from_zero_the_value_at_an_impact_is_the_one_after(t0):
    """At its time as a run gives it, and as the closed form rounds; well before, the speed is downwards."""
    for height in (1.0, 0.7, 0.33, 1.9):
        start, p, span = DROPPED | {"y": height}, BALL | {"e": 0.5}, (t0, t0 + 1.5)
        found = ball().simulate(span, start, p, method="taylor")
        impacts = np.array([*(phase.t0 for phase in found.phases[1:3]), t0 + math.sqrt(2 * height / G)])
        earlier = impacts - 2 * np.spacing(1000.0)
        times = np.unique([*impacts, *earlier, *span])
        run = ball().simulate(span, start, p, t_eval=times, method="taylor")
        sweep = ball().sweep(span, start | {"y": [height]}, p, t_eval=times, method="taylor")
        np.testing.assert_array_equal(run.t, times)
        np.testing.assert_array_equal(sweep.t_eval, times)
        for speeds in (run["y_dot"], sweep["y_dot"][0], found(times)["y_dot"]):
            assert np.all(speeds[np.isin(times, impacts)] > 0.0)
            assert np.all(speeds[np.isin(times, earlier)] < 0.0)


def test_gains_of_a_sweep_are_given_or_refused_by_name():
    start, given = {"x": 0.0, "y": 1.0, "x_dot": 0.5, "y_dot": 0.0}, {**BALL, "e": np.array([0.3, 0.6])}
    open_gains = da.compile_model(da.scenes.bouncing_ball(), formulation="baumgarte")
    with pytest.raises(OptionError, match=r"need the gains of 'baumgarte'.*gains=\(alpha, beta\)"):
        open_gains.sweep((0.0, 3.0), start, given)
    with pytest.raises(OptionError, match="need the gains of 'baumgarte'"):
        open_gains.prepare((0.0, 3.0))
    model = da.compile_model(da.scenes.bouncing_ball(), formulation="baumgarte", gains=(20.0, 20.0))
    run = model.sweep((0.0, 3.0), start, given)
    assert (run.status == Status.SUCCESS).all()
    np.testing.assert_allclose(run.final["x"], 1.5, rtol=1e-12)
    np.testing.assert_allclose(run.final["y"], 0.0, atol=1e-9)  # both rest on the floor by then


def test_outputs_that_are_explained_are_those_of_a_run():
    run = ball().simulate((0, 3), DROPPED, {**BALL, "e": 0.5})
    lines = [line.split(None, 1) for line in ball().explain().splitlines()]
    outputs = {name for first, *rest in filter(None, lines) if first == "outputs" for name in rest[0].split(", ")}
    assert outputs - {"none"} == {"N"} and np.all(run["N"] >= 0)
    assert [rest[0].split(" (")[0] for first, *rest in filter(None, lines) if first == "guards"] == [
        "gap of ground",
        "press of ground",
    ]


def test_the_variables_of_all_phases_in_one_mode_are_computed_together(monkeypatch):
    """A motion may have hundreds of thousands of phases: no kernel is interpreted for each of them."""
    calls, interpreted = [], parts.interpret_rows
    monkeypatch.setattr(parts, "interpret_rows", lambda *given: calls.append(1) or interpreted(*given))
    run = ball().simulate((0, 1.0), {**DROPPED, "y": 1e-3}, {**BALL, "e": 1.0})
    assert len(run.phases) > 30 and len(calls) <= 2
    np.testing.assert_array_equal(run.y, np.concatenate([part.variables for part in run.parts]))
    np.testing.assert_array_equal(run.q, np.concatenate([part.expanded[0] for part in run.parts]))
    np.testing.assert_array_equal(run.qdot, np.concatenate([part.expanded[1] for part in run.parts]))


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_whatever_occurs_in_one_step_is_recorded(method):
    """More than a thousand times within a step, of which there is room for a few hundred at first."""
    scene = da.scenes.bouncing_ball()
    model, height = da.compile_model(scene), scene.coordinates[1]
    start, p = {"x": 0.0, "y": 5.0, "x_dot": 0.0, "y_dot": 0.0}, {"m": 1.0, "g": 10.0, "e": 0.5}
    waves = da.Event(sp.sin(1000 * height), name="waves")
    run = model.simulate((0.0, 1.0 - 1e-3), start, p, events=[waves], method=method)
    last = 5.0 * (1.0 - (1.0 - 1e-3) ** 2)
    heights = np.pi * np.arange(int(5000.0 / np.pi), int(1000.0 * last / np.pi), -1) / 1000.0
    np.testing.assert_allclose(run.events["waves"].t, np.sqrt((5.0 - heights) / 5.0), rtol=1e-9)
