"""Simulators of scenes with events, compiled with warnings as errors, and run beside `simulate`."""

from functools import cache

import numpy as np
import pytest
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import OPTIMISED, SANITIZED, built, compiler, output, same_bits
from dalembert.errors import CapabilityError, ExpressionError, UnknownNameError
from dalembert.methods.status import Status
from export.pages import need_pages, run_of
from hard_cases import hard_case

TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}

PROGRAM = """
#include "{0}.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{{
    static {0}_run run, copy;
    double values[64], state[64], last;
    int i, k, rows = atoi(argv[2]);
    for (i = 3; i < argc; i++) {{
        values[i - 3] = atof(argv[i]);
    }}
    {0}_start(&run, 0.0, atof(argv[1]), values, values + {1}_INITIAL, 0.0, 0);
    for (k = 0; k <= rows; k++) {{
        double t = k == rows ? atof(argv[1]) : atof(argv[1]) * k / rows;
        copy = run; /* holds no addresses */
        if ({0}_at(&run, t, state) > 0) {{
            break;
        }}
        {0}_at(&copy, t, state);
        run = copy;
        printf("%a", t);
        for (i = 0; i < {1}_STATES; i++) {{
            printf(" %a", state[i]);
        }}
        printf("\\n");
    }}
    printf("%d %a", (int)run.status, {0}_time(&run));
    for (i = 0; i < EVENTS; i++) {{
        k = (int){0}_event(&run, i, &last);
        printf(" %d %a", k, last);
    }}
    printf("\\n");
    return {0}_event(&run, EVENTS, NULL) == -1 && {0}_event(&run, 0, NULL) >= 0 ? 0 : 1;
}}
"""
"""A program that prints states at equal distances, then status, time, and number and last time of each event."""


def program_alone(folder, model, initial, parameters, *options, events, **given):
    """Export a model with events, and compile `PROGRAM` with it."""
    compiler()
    path = model.export(folder / "export", initial=initial, parameters=parameters, events=events, **given)
    (header,) = path.glob("*.h")
    name = header.stem
    (path / "events.c").write_text(PROGRAM.format(name, name.upper()).replace("EVENTS", str(len(events))))
    return built(path, ["events.c", f"{name}.c"], *options)


def states_alone(program, numbers, end, rows=40):
    """Return times (k,), states (k, n_y), and the status, time, and numbers of events of a program with numbers."""
    (header,) = program.parent.glob("*.h")
    lines = header.read_text().splitlines()
    entries = [line.split("/* ")[1][:-3] for line in lines if f"{header.stem}_initial_" in line]
    entries += [line.split("/* ")[1][:-3] for line in lines if f"{header.stem}_parameter_" in line]
    known = {str(key): value for key, value in numbers.items()}
    values = [repr(float(known[entry])) for entry in entries]
    *lines, last = output(program, end, rows, *values).splitlines()
    table = np.array([[float.fromhex(number) for number in line.split()] for line in lines])
    status, time, *found = last.split()
    pairs = [(int(count), float.fromhex(t)) for count, t in zip(found[::2], found[1::2], strict=True)]
    return table[:, 0], table[:, 1:], int(status), float.fromhex(time), pairs


def run_alone(folder, model, initial, parameters, end, events, *options, rows=40, **given):
    """Return what `states_alone` returns of an export."""
    program = program_alone(folder, model, initial, parameters, *options, events=events, **given)
    return states_alone(program, {**initial, **parameters}, end, rows)


@cache
def pendulum():
    """Return a pendulum that strikes a stop, its start, its parameters and its events, which have one of their own."""
    theta, (m, l, g, e) = (
        dynamicsymbols("theta"),
        (*symbols("m l", positive=True), symbols("g"), symbols("e", positive=True)),
    )
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("bob", O.locatenew("P", l * (sin(theta) * N.x - cos(theta) * N.y)), m))
    scene.apply_uniform_gravity(-g * N.y)
    stop = da.Event(theta - 0.5, direction=1, apply={theta.diff(): -e * theta.diff()}, name="stop")
    lowest = da.Event(theta, direction=1, name="lowest")
    start, numbers = {"theta": 0.2, "theta_dot": 2.0}, {"m": 1, "l": 1, "g": 9.81, "e": 0.9}
    return da.compile_model(scene), start, numbers, [lowest, stop]


def assert_same_run(found, run, model, labels, expected=None):
    """Assert that a run alone is that of `simulate`, and its end to the last bit where both fuse or do not.

    Its states are those `expected`, by default of the run between its steps.
    """
    times, states, status, time, pairs = found
    assert status == run.status and time == pytest.approx(run.t[-1], rel=1e-14)
    expected = run(times) if expected is None else expected
    for state, name in zip(states.T, model.layout.state, strict=True):
        np.testing.assert_allclose(state, expected[name], rtol=1e-11, atol=1e-11, err_msg=name)
    for (count, last), label in zip(pairs, labels, strict=True):
        assert count == len(run.events[label].t)
        assert last == pytest.approx(run.events[label].t[-1], rel=1e-13)
    if same_bits() and status == Status.SUCCESS:
        assert [*states[-1]] == [run[name][-1] for name in model.layout.state]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return a function that runs the pendulum by steps of a method, with other numbers; sanitizers find nothing."""
    programs = {}

    def run(method, end, **changed):
        model, start, numbers, events = pendulum()
        if method not in programs:
            given = {"events": events, "method": method, **TOLERANCES}
            options = SANITIZED if method == "taylor" else OPTIMISED
            programs[method] = program_alone(tmp_path_factory.mktemp(method), model, start, numbers, *options, **given)
        return states_alone(programs[method], {**start, **numbers, **changed}, end)

    return run


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_events_are_counted_and_map_the_state(alone, method):
    model, start, numbers, events = pendulum()
    run = model.simulate((0, 8), start, numbers, events=events, method=method, **TOLERANCES)
    assert len(run.events["stop"].t) > 3
    assert_same_run(alone(method, 8.0), run, model, ["lowest", "stop"])


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_states_stay_on_constraints_behind_a_map(tmp_path, method):
    """A bead on a circle in Cartesian coordinates, whose speed is turned where it passes a line; speed alone is set."""
    x, y, (m, l, g) = *dynamicsymbols("x y"), symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", O.locatenew("P", x * N.x + y * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    model = da.compile_model(scene, formulation="projected")
    turned = {x.diff(): -0.8 * x.diff(), y.diff(): -0.8 * y.diff()}
    events = [da.Event(x - 0.5, direction=1, apply=turned, name="line")]
    start, numbers = {"x": 0.0, "y": -1.0, "x_dot": 2.5, "y_dot": 0.0}, {"m": 1, "l": 1, "g": 9.81}
    given = {"method": method, **TOLERANCES}
    found = run_alone(tmp_path, model, start, numbers, 5.0, events, **given)
    run = model.simulate((0, 5), start, numbers, events=events, **given)
    assert len(run.events["line"].t) > 2
    assert_same_run(found, run, model, ["line"])
    assert np.abs(found[1][:, 0] ** 2 + found[1][:, 1] ** 2 - 1).max() < 1e-12


def test_an_event_ends_a_run_and_the_state_there_is_given(tmp_path):
    model, start, numbers, (lowest, stop) = pendulum()
    events = [da.Event(lowest.expression, direction=1, terminal=2, name="lowest"), stop]
    times, states, status, time, pairs = run_alone(tmp_path, model, start, numbers, 8.0, events, **TOLERANCES)
    run = model.simulate((0, 8), start, numbers, events=events, **TOLERANCES)
    assert status == run.status == Status.EVENT and pairs[0][0] == 2 and time == run.t[-1]
    assert times[-1] < time <= times[-1] + 0.2 and len(states) < 41


def test_an_expression_that_is_zero_at_the_start_has_not_occurred(alone):
    model, _, numbers, events = pendulum()
    start = {"theta": 0.5, "theta_dot": -1.0}
    found = alone("taylor", 4.0, **start)
    run = model.simulate((0, 4), start, numbers, events=events, method="taylor", **TOLERANCES)
    assert run.events["stop"].t[0] > 0.1
    assert_same_run(found, run, model, ["lowest", "stop"])


def test_runs_with_events_end_where_angles_lock(tmp_path):
    case = hard_case("sphere through theta = 0, in angles")
    model, end = case.compile("auto"), case.times()[-1]
    events = [da.Event(dynamicsymbols("phi") - 0.5, name="passed")]
    start, numbers = model.read_initial(case.initial), model.read_parameters(case.parameters)
    times, _, status, *_ = run_alone(tmp_path, model, dict(start), dict(numbers), end, events)
    run = model.simulate((0, end), case.initial, case.parameters, events=events)
    assert status == run.status == Status.SINGULAR_COORDINATES and times[-1] <= 1


def test_events_without_end_end_a_run(alone):
    model, _, numbers, events = pendulum()
    start, numbers = {"theta": 0.4, "theta_dot": 1.0}, {**numbers, "g": -9.81, "e": 0.5}
    found = alone("taylor", 8.0, **start, **numbers)
    run = model.simulate((0, 8), start, numbers, events=events, method="taylor", **TOLERANCES)
    assert found[2] == run.status == Status.EVENTS_ACCUMULATE and found[3] == pytest.approx(run.t[-1], rel=1e-12)


def test_a_page_has_events(tmp_path):
    need_pages()
    model, start, numbers, events = pendulum()
    path = tmp_path / "page.html"
    model.export(path, "page", initial=start, parameters=numbers, t_span=(0, 8), events=events, **TOLERANCES)
    times = np.linspace(0, 8, 33)
    printed, found = run_of(path, times)
    run = model.simulate((0, 8), start, numbers, events=events, **TOLERANCES)
    assert printed["status"] == 0 and path.stat().st_size < 500_000
    for name in ("theta", "theta_dot"):
        np.testing.assert_allclose(found[name], run(times)[name], rtol=1e-10, atol=1e-10)


INPUTS = """
#include "pushed.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{
    static const double forces[] = {1.0, -2.0, 3.0, 0.5, -4.0, 2.0};
    const double initial[] = {0.2, 2.0}, parameters[] = {0.9, 9.81, 1.0, 1.0};
    static pushed_run run, copy;
    const double end = atof(argv[argc - 1]);
    double state[PUSHED_STATES], last;
    int32_t k, e, status = pushed_start(&run, 0.0, end, initial, parameters, 0.0, 0);
    for (k = 0; k < 6 && status <= PUSHED_SUCCESS; k++) {
        pushed_set_input(&run, pushed_input_u, forces[k], 0.0);
        copy = run;
        while (pushed_step(&run) == PUSHED_RUNNING) {
            pushed_step(&copy); /* holds no addresses */
            run = copy;
            if (end > 1.0 && pushed_time(&run) >= 0.7 * (k + 1)) {
                break;
            }
        }
        status = pushed_at(&run, pushed_time(&run), state);
        printf("%a %a %a", pushed_time(&run), state[0], state[1]);
        for (e = 0; e < PUSHED_EVENTS; e++) {
            printf(" %d", (int)pushed_event(&run, e, &last));
            printf(" %a", last);
        }
        printf("\\n");
        pushed_continue(&run, 0.7 * (k + 2));
    }
    return status > PUSHED_SUCCESS;
}
"""
"""A program that sets an input at times, and prints them, the state there, and number and last time of each event.

Its argument is the end of the first run; where that is late, the input is set between steps.
"""


@cache
def pushed():
    """Return a pendulum that strikes a stop and is pushed, its start, its parameters and its events."""
    (theta, u), (m, l, g, e) = dynamicsymbols("theta u"), symbols("m l g e")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", l * (sin(theta) * N.x - cos(theta) * N.y))
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("bob", P, m))
    scene.add_inputs(u)
    scene.add_loads((P, u * N.x - m * g * N.y))
    stop = da.Event(theta - 0.5, direction=1, apply={theta.diff(): -e * theta.diff()}, name="stop")
    balance = da.Event(u - 3 * theta, name="balance")
    events = [stop, da.Event(theta, direction=1, name="lowest"), balance]
    return da.compile_model(scene), {"theta": 0.2, "theta_dot": 2}, {"m": 1, "l": 1, "g": 9.81, "e": 0.9}, events


@pytest.fixture(scope="module")
def beside_inputs(tmp_path_factory):
    """Return a function of a method, what further events there are, and the end of a first run.

    It returns what `INPUTS` prints (6, 3 + 2 n_events), and the run of `simulate` with the same inputs.
    """
    compiler()
    model, start, numbers, known = pushed()
    programs = {}

    def run(method, end, *further):
        events = [*known, *further]
        given = {"events": events, "method": method, **TOLERANCES}
        if (method, len(further)) not in programs:
            folder = tmp_path_factory.mktemp(method)
            path = model.export(folder / "export", initial=start, parameters=numbers, **given)
            (path / "inputs.c").write_text(INPUTS.replace("PUSHED_EVENTS", str(len(events))))
            programs[method, len(further)] = built(path, ["inputs.c", "pushed.c"], *SANITIZED)
        lines = output(programs[method, len(further)], end).splitlines()
        found = np.array([[float.fromhex(item) for item in line.split()] for line in lines])
        times, forces = [0.0, *found[:, 0]], [1.0, -2.0, 3.0, 0.5, -4.0, 2.0, 2.0]
        inputs = {"u": da.samples(times, forces, kind="hold")}
        return found, model.simulate((0, times[-1]), start, numbers, inputs=inputs, **given)

    return run


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_inputs_are_set_beside_events_where_runs_end(beside_inputs, method):
    """A jump of an input that changes the sign of an expression is an event at that time."""
    found, run = beside_inputs(method, 0.7)
    (end, *state), pairs = found[-1, :3], found[-1, 3:].reshape(-1, 2)
    assert end == run.t[-1] == pytest.approx(4.2)
    for (count, last), label in zip(pairs, ["stop", "lowest", "balance"], strict=True):
        assert count == len(run.events[label].t) > 1
        assert last == pytest.approx(run.events[label].t[-1], rel=1e-13)
    assert {0.7 * 2, 0.7 * 5} < set(run.events["balance"].t)
    assert state == pytest.approx([run["theta"][-1], run["theta_dot"][-1]], rel=1e-12)
    if same_bits():
        assert state == [run["theta"][-1], run["theta_dot"][-1]]


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_inputs_are_set_beside_events_between_steps(beside_inputs, method):
    found, run = beside_inputs(method, 9.0)
    assert found[0, 0] > 0.7 and found[-1, 3::2].tolist() == [len(run.events[label].t) for label in run.events]
    assert found[-1, 1:3] == pytest.approx([run["theta"][-1], run["theta_dot"][-1]], rel=1e-8)
    np.testing.assert_allclose(found[-1, 4::2], [run.events[label].t[-1] for label in run.events], rtol=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_an_event_where_a_run_ends_occurs_once(beside_inputs, method):
    """It occurs at the end of the run, which then goes on from the state behind its map."""
    t, theta = dynamicsymbols._t, dynamicsymbols("theta")
    turn = da.Event(t - 1.4, apply={theta.diff(): -theta.diff()}, name="turn")
    found, run = beside_inputs(method, 0.7, turn)
    assert found[:, -2].tolist() == [0, 1, 1, 1, 1, 1] and found[-1, -1] == run.events["turn"].t[0] == 1.4
    assert found[1, 2] == pytest.approx(run.events["turn"].after["theta_dot"][0], rel=1e-9)
    assert found[-1, 3::2].tolist() == [len(run.events[label].t) for label in run.events]
    assert found[-1, 1:3] == pytest.approx([run["theta"][-1], run["theta_dot"][-1]], rel=1e-8)


def test_a_page_has_events_beside_inputs(tmp_path):
    need_pages()
    model, start, numbers, events = pushed()
    path, given = tmp_path / "page.html", {"inputs": {"u": 1.0}, "events": events, **TOLERANCES}
    model.export(path, "page", initial=start, parameters=numbers, t_span=(0, 4), **given)
    times = np.linspace(0, 4, 17)
    printed, found = run_of(path, times)
    run = model.simulate((0, 4), start, numbers, **given)
    assert printed["status"] == 0 and path.stat().st_size < 500_000
    for name in ("theta", "theta_dot"):
        np.testing.assert_allclose(found[name], run(times)[name], rtol=1e-10, atol=1e-10)


def test_what_exports_with_events_do_not_carry(tmp_path):
    model, start, numbers, events = pendulum()
    given = {"initial": start, "parameters": numbers, "events": events}
    for kind in ("numba", "jax"):
        with pytest.raises(CapabilityError, match=rf"kind='{kind}' does not carry events \(lowest, stop\)"):
            model.export(tmp_path / "run.py", kind, **given)
    with pytest.raises(CapabilityError, match="method='rk4' does not carry events"):
        model.export(tmp_path / "run", method="rk4", step=0.01, **given)
    with pytest.raises(ExpressionError, match="constant along every motion"):
        model.export(tmp_path / "run", events=["m"])
    with pytest.raises(UnknownNameError):
        model.export(tmp_path / "run", events=["nothing"])
    assert not any(tmp_path.iterdir())
