"""Simulators of scenes with contacts that change and events, run beside `simulate`."""

from functools import cache

import numpy as np
import pytest
from sympy import Rational, symbols
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from codegen.c_programs import SANITIZED, built, compiler, output, same_bits
from dalembert.methods.status import Status
from export.pages import need_pages, run_of
from export.test_contact_simulators import block
from export.test_events import INPUTS, TOLERANCES, program_alone, run_alone, states_alone
from hard_cases.contacts import contact_motion

x, y = dynamicsymbols("x y")


@cache
def ball():
    """Return a ball over a floor, its start, its parameters and its events, which have two of their own.

    What the events do is a matter of numbers: a kick lifts the ball, or drops it by a depth.
    """
    case = contact_motion("bouncing ball").motion
    k, depth, low = symbols("k depth low")
    faster = {x.diff(): -x.diff(), y: y - depth, y.diff(): k * y.diff()}
    kick = da.Event(y - Rational(1, 2), direction=-1, apply=faster, name="kick")
    events = [
        kick,
        da.Event(y.diff(), direction=-1, name="top"),
        da.Event(y - low, direction=-1, terminal=2, name="low"),
    ]
    numbers = {str(key): value for key, value in case.parameters.items()}
    start = {str(key): value for key, value in case.initial.items()}
    return da.compile_model(da.scenes.bouncing_ball()), start, {**numbers, "k": 1.1, "depth": 0, "low": -1}, events


def assert_same_run(found, run, model, last=None, expected=None):
    """Assert that a run alone is that of `simulate`, and its last state that of a sweep to the last bit.

    Its states are those `expected`, by default of the run between its steps.
    """
    times, states, status, time, pairs = found
    assert status == run.status and time == pytest.approx(run.t[-1], rel=1e-13)
    expected = run(times) if expected is None else expected
    for state, name in zip(states.T, model.layout.variables, strict=True):
        np.testing.assert_allclose(state, expected[name], rtol=1e-10, atol=1e-10, err_msg=name)
    for (count, at), label in zip(pairs, run.events, strict=True):
        assert count == len(run.events[label].t)
        assert at == pytest.approx(run.events[label].t[-1], rel=1e-12) if count else np.isnan(at)
    if last is not None and same_bits():
        assert [*states[-1]] == [last[name][0] for name in model.layout.variables]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return a function that runs the ball by steps of a method with other numbers; sanitizers find nothing."""
    programs = {}

    def run(method, **changed):
        model, start, numbers, events = ball()
        if method not in programs:
            given = {"events": events, "method": method, **TOLERANCES}
            options = SANITIZED if method == "taylor" else ()
            programs[method] = program_alone(tmp_path_factory.mktemp(method), model, start, numbers, *options, **given)
        return states_alone(programs[method], {**start, **numbers, **changed}, 2.5)

    return run


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_events_are_counted_and_map_the_state_between_impacts(alone, method):
    model, start, numbers, events = ball()
    given = {"events": events, "method": method, **TOLERANCES}
    run = model.simulate((0, 2.5), start, numbers, **given)
    last = model.sweep((0, 2.5), start, numbers, threads=1, **given)
    assert len(run.phases) == 7 and [len(run.events[label].t) for label in ("kick", "top")] == [2, 3]
    assert_same_run(alone(method), run, model, last)


def test_events_are_counted_while_a_block_slips_and_sticks(tmp_path):
    """The method fits the modes of the example, and one map turns the block on its belt."""
    case = contact_motion("block on a belt").motion
    model, end = case.compile("auto"), 20.0
    turn = {x.diff(): -x.diff() / 2}
    events = [da.Event(x.diff(), name="turns"), da.Event(x - 1, direction=-1, apply=turn, name="strikes")]
    start, numbers = dict(model.read_initial(case.initial)), dict(model.read_parameters(case.parameters))
    found = run_alone(tmp_path, model, start, numbers, end, events, t_span=(0, end), **TOLERANCES)
    run = model.simulate((0, end), start, numbers, events=events, **TOLERANCES)
    assert {*(phase.modes[model.contacts[0]] for phase in run.phases)} == {"slip", "stick"}
    assert all(len(run.events[label].t) > 1 for label in ("turns", "strikes"))
    assert_same_run(found, run, model)


@pytest.mark.parametrize("mapped", [False, True])
def test_an_event_ends_a_run(tmp_path, alone, mapped):
    model, start, numbers, (kick, top, low) = ball()
    events, numbers = [kick, top, low], {**numbers, "low": 0.4}
    if mapped:
        last = da.Event(kick.expression, direction=-1, terminal=2, apply=kick.apply, name="last")
        events, numbers = [top, last], {key: value for key, value in numbers.items() if key != "low"}
        found = run_alone(tmp_path, model, start, numbers, 2.5, events, **TOLERANCES)
    else:
        found = alone("taylor", **numbers)
    run = model.simulate((0, 2.5), start, numbers, events=events, **TOLERANCES)
    assert run.status == Status.EVENT and run.t[-1] < 2.4 and found[4][-1][0] == 2
    assert_same_run(found, run, model)


@pytest.mark.parametrize(
    ("changed", "status"),
    [({"depth": 1.5}, Status.EVENT_STATE), ({"k": -0.5}, Status.EVENTS_ACCUMULATE)],
    ids=["into the floor", "without end"],
)
def test_maps_that_end_a_run(alone, changed, status):
    """One into the floor, which does not take place, and one that turns the ball where it occurs, without end."""
    model, start, numbers, events = ball()
    run = model.simulate((0, 2.5), start, {**numbers, **changed}, events=events, method="taylor", **TOLERANCES)
    assert run.status == status
    assert_same_run(alone("taylor", **changed), run, model)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_inputs_are_set_beside_events_and_contacts(tmp_path, method):
    """A block that is pushed slips, sticks, and is turned at a place; sanitizers find nothing."""
    compiler()
    scene, place = block(push=dynamicsymbols("u"))
    model, start, numbers = da.compile_model(scene), {"x": 0, "x_dot": 0}, {"m": 1, "mu": 0.2}
    turn = da.Event(place - Rational(1, 10), direction=1, apply={place.diff(): -place.diff()}, name="turn")
    events = [turn, da.Event(dynamicsymbols("u") - place, name="balance")]
    given = {"events": events, "method": method, **TOLERANCES}
    path = model.export(tmp_path / "export", initial=start, parameters=numbers, **given)
    text = INPUTS.replace("pushed", "block").replace("PUSHED_EVENTS", "2").replace("PUSHED", "BLOCK")
    text = text.replace("{0.2, 2.0}", "{0.0, 0.0}").replace("{0.9, 9.81, 1.0, 1.0}", "{1.0, 0.2}")
    (path / "inputs.c").write_text(text.replace("state[1]);", "state[BLOCK_STATES / 2]);"))
    lines = output(built(path, ["inputs.c", "block.c"], *SANITIZED), 0.7).splitlines()
    found = np.array([[float.fromhex(item) for item in line.split()] for line in lines])
    times, forces = [0.0, *found[:, 0]], [1.0, -2.0, 3.0, 0.5, -4.0, 2.0, 2.0]
    run = model.simulate((0, times[-1]), start, numbers, inputs={"u": da.samples(times, forces, kind="hold")}, **given)
    assert {phase.modes["table"] for phase in run.phases} == {"slip", "stick"} and len(run.events["turn"].t) > 0
    assert found[-1, 1:3] == pytest.approx([run["x"][-1], run["x_dot"][-1]], rel=1e-9, abs=1e-9)
    for (count, last), label in zip(found[-1, 3:].reshape(-1, 2), run.events, strict=True):
        assert count == len(run.events[label].t) and last == pytest.approx(run.events[label].t[-1], rel=1e-9)


def test_a_page_has_events_beside_contacts(tmp_path):
    need_pages()
    model, start, numbers, events = ball()
    given = {"events": events, **TOLERANCES}
    path = model.export(tmp_path / "page.html", "page", initial=start, parameters=numbers, t_span=(0, 2.5), **given)
    times = np.linspace(0, 2.5, 21)
    printed, found = run_of(path, times)
    run = model.simulate((0, 2.5), start, numbers, t_eval=times, **given)
    assert printed["status"] == 0 and path.stat().st_size < 500_000
    for name in model.layout.variables:
        np.testing.assert_allclose(found[name], run[name], rtol=1e-10, atol=1e-10, err_msg=name)
