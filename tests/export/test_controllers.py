"""Simulators of scenes with sampled controllers, alone and beside events, run beside `simulate`."""

import subprocess
from functools import cache

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import SANITIZED, built, compiler, output, same_bits
from export.pages import need_pages, run_of
from export.test_contact_simulators import block
from export.test_events import TOLERANCES, assert_same_run, program_alone, run_alone, states_alone
from export.test_events_beside_contacts import assert_same_run as assert_same_motion

METHODS = pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
START = {"theta": 0.2, "theta_dot": 2.0, "e": 0.0, "w": 0.3}
NUMBERS = {"m": 1, "l": 1, "g": 9.81, "k": 4, "c": 0.5, "T": 0.07}


@cache
def held():
    """Return a pendulum that a law of two rates pushes, and its coordinate."""
    theta, u, w, e = dynamicsymbols("theta u w e")
    m, l, g, k, c, T = symbols("m l g k c T")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", l * (sin(theta) * N.x - cos(theta) * N.y))
    scene = da.Scene("held", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("bob", P, m))
    scene.add_inputs(u, w)
    scene.add_loads((P, u * N.x - m * g * N.y))
    plan = da.Controller("plan", period=1, offset=0.35, inputs={w: cos(dynamicsymbols._t)})
    law = {"states": {e: e + T * (w - theta)}, "inputs": {u: k * (w - theta) - c * theta.diff() + e}}
    scene.add_controllers(plan, da.Controller("pid", period=T, **law))
    return da.compile_model(scene), theta


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Return a function of a method, of the program of the example of the pendulum."""
    compiler()

    @cache
    def program(method):
        folder, given = tmp_path_factory.mktemp(method), {"method": method, **TOLERANCES}
        path = held()[0].export(folder / "export", initial=START, parameters=NUMBERS, t_span=(0, 4.2), **given)
        return built(path, ["main.c", "held.c"])

    return program


@METHODS
def test_controllers_act_where_steps_end(example, method):
    """Also at times that are instants, where the state is that behind the controllers; by the example of the folder."""
    model, given = held()[0], {"method": method, **TOLERANCES}
    names, *rows = output(example(method), 4.2, 61).splitlines()
    assert len(set(names.split(","))) == len(names.split(","))
    found = dict(zip(names.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))
    run = model.simulate((0, 4.2), START, NUMBERS, t_eval=found["t"], **given)
    last = model.simulate((0, 4.2), START, NUMBERS, **given)
    assert len(set(found["u"])) > 45
    for name in model.layout.variables:
        np.testing.assert_allclose(found[name], run[name], rtol=1e-11, atol=1e-11, err_msg=name)
        if same_bits():
            assert found[name][-1] == last[name][-1]


def with_events():
    """Return the pendulum with its events: a stop, and a force that jumps."""
    model, theta = held()
    stop = da.Event(theta - 0.25, direction=1, apply={theta.diff(): -0.9 * theta.diff()}, name="stop")
    return model, [stop, da.Event(dynamicsymbols("u"), name="jump")]


@METHODS
def test_controllers_act_beside_events(tmp_path, method):
    """Sanitizers find nothing in Taylor steps."""
    model, events = with_events()
    given = {"method": method, "events": events, **TOLERANCES}
    options = SANITIZED if method == "taylor" else ()
    program = program_alone(tmp_path, model, START, NUMBERS, *options, **given)
    found = states_alone(program, START | NUMBERS, 4.2)
    run = model.simulate((0, 4.2), START, NUMBERS, **given)
    assert len(run.events["stop"].t) > 2 and len(run.events["jump"].t) > 1
    at_times = model.simulate((0, 4.2), START, NUMBERS, t_eval=found[0], **given)
    assert_same_run(found, run, model, ["stop", "jump"], at_times)


STEERED = """
#include "steered.h"
#include <stdio.h>
int main(void)
{
    static const double values[] = {0.5, -1.0, 2.0}, ends[] = {0.5, 1.0, 2.0};
    double state[STEERED_STATES];
    const double initial[] = {0.0, 1.0, 0.0}, parameters[] = {0.1, 2.0, 1.0};
    static steered_run run;
    int32_t k, i, status = steered_start(&run, 0.0, ends[0], initial, parameters, 0.0, 0);
    for (k = 0; k < 3; k++) {
        steered_set_input(&run, steered_input_v, values[k], 0.0);
        for (; status == STEERED_RUNNING; status = steered_step(&run)) {
            steered_at(&run, steered_time(&run), state);
        }
        status = steered_at(&run, ends[k], state);
        for (i = 0; i < STEERED_STATES; i++) {
            printf("%a ", state[i]);
        }
        status = k < 2 ? steered_continue(&run, ends[k + 1]) : status;
    }
    return status;
}
"""
"""A program that sets an input at instants of a law that reads it, and prints the states there."""


@METHODS
@pytest.mark.parametrize("watched", [False, True])
def test_laws_read_inputs_that_are_set_where_a_run_starts_or_continues(tmp_path, method, watched):
    compiler()
    x, u, v = dynamicsymbols("x u v")
    m, k, T = symbols("m k T")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("steered", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", O.locatenew("P", x * N.x), m))
    scene.add_inputs(u, v)
    scene.add_loads((scene.bodies[0].masscenter, (u + v) * N.x))
    scene.add_controllers(da.Controller("brake", period=T, inputs={u: v - x - k * x.diff()}))
    model, start, numbers = da.compile_model(scene), {"u": 0, "x": 0, "x_dot": 1}, {"T": 0.1, "k": 2, "m": 1}
    wall = da.Event(x - 0.3, direction=1, apply={x.diff(): -x.diff()}, name="wall")
    given = {"method": method, "events": [wall] if watched else [], **TOLERANCES}
    path = model.export(tmp_path / "export", initial=start, parameters=numbers, **given)
    (path / "inputs.c").write_text(STEERED)
    printed = output(built(path, ["inputs.c", "steered.c"], *SANITIZED)).split()
    found = np.reshape([float.fromhex(number) for number in printed], (3, -1))
    inputs = {"v": da.samples([0, 0.5, 1, 2], [0.5, -1, 2, 2], kind="hold")}
    run = model.simulate((0, 2), start, numbers, inputs=inputs, **given)
    assert found[0, model.layout.state.index("u")] != 0 and (not watched or len(run.events["wall"].t) > 1)
    for value, name in zip(found[-1], model.layout.state, strict=True):
        assert value == pytest.approx(run[name][-1], rel=1e-11)
        if same_bits() and method == "taylor":
            assert value == run[name][-1]


def test_a_period_that_is_none_is_refused_at_the_start(example):
    program = example("taylor")
    values = {name: NUMBERS[name] for name in sorted(NUMBERS)} | {"T": -0.1}
    done = subprocess.run(
        [program, "1", "2", *map(str, [*(START[name] for name in sorted(START)), *values.values()])],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1 and "a controller has no period above 0" in done.stderr


def test_a_page_has_controllers_beside_events(tmp_path):
    need_pages()
    model, events = with_events()
    path, given = tmp_path / "page.html", {"events": events, **TOLERANCES}
    model.export(path, "page", initial=START, parameters=NUMBERS, t_span=(0, 4.2), **given)
    times = np.linspace(0, 4.2, 41)
    printed, found = run_of(path, times)
    run = model.simulate((0, 4.2), START, NUMBERS, t_eval=times, **given)
    assert printed["status"] == 0 and path.stat().st_size < 500_000
    for name in model.layout.variables:
        np.testing.assert_allclose(found[name], run[name], rtol=1e-10, atol=1e-10, err_msg=name)


def pulled(events=False):
    """Return a block on a rough table that a law pulls to and fro, with its start and its parameters."""
    u = dynamicsymbols("u")
    scene, x = block(push=u)
    k, T = symbols("k"), symbols("T")
    scene.add_controllers(da.Controller("pull", period=T, offset=0.2, inputs={u: k * cos(3 * dynamicsymbols._t) - x}))
    turn = da.Event(x - 0.05, direction=1, apply={x.diff(): -x.diff()}, name="turn")
    start, numbers = {"x": 0, "x_dot": 0, "u": 0}, {"m": 1, "mu": 0.2, "k": 4, "T": 0.3}
    return da.compile_model(scene), start, numbers, [turn, da.Event(u - x, name="balance")] if events else []


@METHODS
def test_controllers_act_beside_contacts_that_change(tmp_path, method):
    compiler()
    model, start, numbers, _ = pulled()
    given = {"method": method, **TOLERANCES}
    path = model.export(tmp_path / "export", initial=start, parameters=numbers, t_span=(0, 5.5), **given)
    names, *rows = output(built(path, ["main.c", "block.c"]), 5.5, 56).splitlines()
    found = dict(zip(names.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))
    run = model.simulate((0, 5.5), start, numbers, t_eval=found["t"], **given)
    last = model.sweep((0, 5.5), start, numbers, threads=1, **given)
    assert {phase.modes["table"] for phase in run.phases} == {"slip", "stick"} and len(run.phases) > 8
    assert len(set(found["u"])) > 15
    for name in model.layout.variables:
        np.testing.assert_allclose(found[name], run[name], rtol=1e-10, atol=1e-10, err_msg=name)
        if same_bits():
            assert found[name][-1] == last[name][0]


def test_controllers_act_beside_contacts_and_events(tmp_path):
    model, start, numbers, events = pulled(events=True)
    given = {"method": "taylor", "events": events, **TOLERANCES}
    found = run_alone(tmp_path, model, start, numbers, 5.5, **given)
    run = model.simulate((0, 5.5), start, numbers, **given)
    assert all(len(record.t) > 1 for record in run.events.values())
    last = model.sweep((0, 5.5), start, numbers, events=events, threads=1, method="taylor", **TOLERANCES)
    at_times = model.simulate((0, 5.5), start, numbers, t_eval=found[0], **given)
    assert_same_motion(found, run, model, last, at_times)
