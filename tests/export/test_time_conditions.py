"""Simulators of scenes with functions of time that have kinks, jumps or pulses, run beside `simulate`."""

import itertools
from functools import cache, partial

import numpy as np
import pytest
from sympy import (
    Abs,
    Derivative,
    Heaviside,
    Max,
    Min,
    Mod,
    Piecewise,
    cos,
    exp,
    floor,
    sign,
    sin,
    sqrt,
    symbols,
    tanh,
)  # fmt: skip
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import built, compiler, output, same_bits
from dalembert.errors import CapabilityError
from dalembert.ir.conditions import CONDITION_TIME
from dalembert.ir.interpret import ARRAY_OPERATIONS, interpret
from dalembert.ir.intervals import INTERVAL_OPERATIONS, Interval
from dalembert.stops.breakpoints import break_times
from dalembert.stops.interval_roots import kinds_of, kinds_of_numbers
from dalembert.transforms.interval_kernels import interval_kernel, traced_kernel
from export.pages import need_pages, parts, run_of
from export.test_events import assert_same_run, run_alone
from export.units import Unit, unpacked

METHODS = pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
TOLERANCES = {"rtol": 1e-9, "atol": 1e-11}
t, x, u = dynamicsymbols._t, *dynamicsymbols("x u")
T, w, a, k, c = symbols("T w a k c", positive=True)
VALUES = {"T": 0.7, "w": 5.3, "a": 0.4, "k": 9.0, "c": 0.3}


def compiled(force, name="pushed", **given):
    """Return a block on a spring that a function of time pushes."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, 1))
    scene.add_loads((P, (force - k * x - c * x.diff()) * N.x))
    if "controllers" in given:
        scene.add_inputs(u)
        scene.add_loads((P, u * N.x))
        scene.add_controllers(*given.pop("controllers"))
    return da.compile_model(scene, **given)


def numbers(model):
    """Return values of the parameters of a model."""
    return {name: VALUES[name] for name in model.layout.given}


# The search.

ARITHMETIC = {
    "threshold": Heaviside(t - T, 0),
    "ramps": Max(0, Min(1, (t - T) / a)),
    "parabola": sign((t - 1) * (t - T) * (t + 2)),
    "saw": Mod(t, T),
    "saw in a saw": Piecewise((Mod(t, T) - a, Mod(t, T) > a), (0, True)),
    "steps of steps": floor(floor(t / a) / 3 + t / 7),
    "touches": Abs((t - 1) ** 2 * (t - 3)),
    "rational": sign(t / (1 + t**2) - T / 2),
}
FURTHER = {
    "square wave": sign(sin(w * t)),
    "rectified": Abs(sin(w * t) + a),
    "mixed": Piecewise((sin(w * t), t < T), (exp(-t), t < sqrt(T) + 1), (cos(t) ** 2, True)),
    "powers": sign(exp(-(t**2)) - tanh(t / 3)),
    "pulses": exp(-(((t - T) / 0.001) ** 2)) + tanh((t - 2) / 0.003),
    "pulse where the search cuts": exp(-(((t - 1.5) / 0.001) ** 2)),
    "smooth": exp(-t) * sqrt(2 + sin(w * t)),
}
SPANS = [(0.0, 4.0), (-3.0, 9.1), (4.0, 0.0), (0.0, 0.001), (0.0, 1.0)]

LISTING = """
#include "pushed.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{
    const double initial[] = {0.0, 0.0};
    double parameters[8];
    pushed_run run;
    int64_t i;
    for (i = 3; i < argc; i++) {
        parameters[i - 3] = atof(argv[i]);
    }
    if (pushed_start(&run, atof(argv[1]), atof(argv[2]), initial, parameters, 0.0, 0) != PUSHED_RUNNING) {
        fprintf(stderr, "%d: %s", (int)run.status, pushed_status_text(run.status));
        return 1;
    }
    for (i = 0; i < run.instants.breaks.search.count; i++) {
        printf("%.17g ", run.instants.breaks.times[i]);
    }
    return 0;
}
"""


def listing(folder, model, **given):
    """Return a program that prints the breaks of a run of given ends and parameters."""
    compiler()
    path = model.export(folder / "export", initial={"x": 0, "x_dot": 0}, parameters=numbers(model), **given)
    (path / "main.c").write_text(LISTING)
    return built(path, ["main.c", "pushed.c"])


@pytest.mark.parametrize("name", [*ARITHMETIC, *FURTHER])
def test_breaks_are_those_of_simulate(tmp_path, name):
    """To the bit where functions are arithmetic; sines of NumPy and of the C library differ by rounding."""
    model = compiled((ARITHMETIC | FURTHER)[name])
    program, layout = listing(tmp_path, model, method="dop853"), model.layout
    conditions, given = model.stages.program.conditions, numbers(model)
    p = np.array([0.0 if name == CONDITION_TIME else given[name] for name in layout.parameters])
    counts = []
    for span in SPANS:
        found = np.array(output(program, *span, *given.values()).split(), float)
        expected = break_times(conditions, p, *span)
        if name in ARITHMETIC:
            np.testing.assert_array_equal(found, expected)
        else:
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
        counts.append(len(found))
    assert max(counts) > 0 or name == "smooth"


def test_more_breaks_than_there_is_room_for(tmp_path):
    model = compiled(sign(sin(w * t)))
    program = listing(tmp_path, model, method="dop853")
    values = [VALUES[name] for name in model.layout.given]
    assert len(output(program, 0, 500, *values).split()) == int(500 * VALUES["w"] / np.pi)
    said = output(program, 0, 5000, *values, status=1)
    assert said.startswith("16: ") and "more than 1000 kinks and jumps" in said


def test_kernels_of_bounds_are_the_rules():
    """Of functions with all operations, over intervals and at points; and so are the tests of intervals."""
    force = Abs(sin(w * t) * exp(-t) - cos(t) ** 3 / (2 + t**2)) + sign(tanh(t) - floor(t) / 3)
    model, rng = compiled(force), np.random.default_rng(5)
    low, sizes = rng.normal(size=200), 10.0 ** rng.integers(-9, 2, 200)
    ranges = [(low, low + sizes, 1.0), (low, low, 0.0)]
    for kernel in model.stages.program.conditions.functions:
        made, found = interval_kernel(kernel), []
        for begin, end, rate in ranges:
            rows = {"p": np.full((9, 200), 1.3)}
            time = Interval(begin, end, np.full(200, rate), np.full(200, rate))
            with np.errstate(all="ignore"):
                (bounds,) = interpret(kernel, rows | {"t": time}, INTERVAL_OPERATIONS)
                lines = interpret(made, rows | {"t": [begin, end, np.full(200, rate)]}, ARRAY_OPERATIONS)
            found.append(bounds)
            for line, own in zip(lines, (bounds.low, bounds.high, bounds.rate_low, bounds.rate_high), strict=True):
                np.testing.assert_array_equal(np.broadcast_to(line, 200), np.broadcast_to(own, 200))
        for kind in ("zero", "whole"):
            whole, centre = found
            given = [low, low + sizes, whole.low, whole.high, whole.rate_low, whole.rate_high, centre.low, centre.high]
            lines = interpret(traced_kernel(partial(kinds_of_numbers, kind), "test", 8), {"t": given}, ARRAY_OPERATIONS)
            for line, own in zip(lines, kinds_of(kind, low, low + sizes, whole, centre), strict=True):
                np.testing.assert_array_equal(np.broadcast_to(line, 200), own)


# Runs.

FORCE = Piecewise((0, t < T), (sign(sin(w * t)), t < 2), (Abs(cos(w * t)) - a, True)) + 20 * exp(
    -(((t - 2.3) / 0.004) ** 2)
)
START = {"x": 0.1, "x_dot": 0.0}

AT_TIMES = """
#include "pushed.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{
    const double initial[] = {0.1, 0.0}, parameters[] = PARAMETERS;
    double state[PUSHED_STATES], outputs[PUSHED_OUTPUTS];
    pushed_run run;
    int i;
    int32_t status = pushed_start(&run, atof(argv[1]), atof(argv[2]), initial, parameters, 0.0, 0);
    for (i = 3; i < argc; i++) {
        const double t = atof(argv[i]);
        status = status == PUSHED_SUCCESS && t != pushed_time(&run) ? pushed_continue(&run, t) : status;
        status = pushed_at(&run, t, state);
        if (status > PUSHED_SUCCESS) {
            return 1;
        }
        pushed_outputs(&run, t, state, outputs);
        printf("%.17g %.17g %.17g\\n", state[0], state[1], outputs[0]);
    }
    return 0;
}
"""


@cache
def forced():
    """Return a block that `FORCE` pushes, with its acceleration as an output."""
    return compiled(FORCE, outputs=[Derivative(x, t, 2)])


@pytest.fixture(scope="module")
def values_at(tmp_path_factory):
    """Return a function of a method, a span and times.

    It returns position, speed and output of an exported run at times (k, 3); behind its end it continues.
    """
    compiler()
    own = numbers(forced())

    @cache
    def program(method):
        folder = tmp_path_factory.mktemp(method)
        path = forced().export(folder / "export", initial=START, parameters=own, method=method, **TOLERANCES)
        text = "{" + ", ".join(map(repr, own.values())) + "}"
        (path / "main.c").write_text(AT_TIMES.replace("PARAMETERS", text))
        return built(path, ["main.c", "pushed.c"])

    def values(method, span, times):
        return np.array([line.split() for line in output(program(method), *span, *times).splitlines()], float)

    return values


def equal(found, expected):
    """Check the last of some states: to the bit where the processor fuses as code of this process does."""
    np.testing.assert_allclose(found[:2], [expected["x"][-1], expected["x_dot"][-1]], rtol=1e-11, atol=1e-12)
    if same_bits():
        assert [*found[:2]] == [expected["x"][-1], expected["x_dot"][-1]]


@METHODS
@pytest.mark.parametrize("span", [(0.0, 3.1), (3.1, -0.4)])
def test_runs_end_steps_at_breaks(values_at, method, span):
    """Forward and backward; outputs are those of before a break until it, and of behind it from there on."""
    model = forced()
    given, own = {"method": method, **TOLERANCES}, numbers(model)
    last = model.simulate(span, START, own, **given)
    breaks = last.t[np.isin(last.t, break_times(model.stages.program.conditions, parameters_of(model), *span))]
    assert len(breaks) > 5
    near = np.concatenate([breaks, breaks - 1e-6, breaks + 1e-6, np.linspace(*span, 41)])
    times = np.sort(near[(near >= min(span)) & (near <= max(span))])[:: 1 if span[1] > span[0] else -1]
    found = values_at(method, span, times)
    run = model.simulate(span, START, own, t_eval=times, **given)
    for column, expected in zip(found.T, (run["x"], run["x_dot"], run[model.layout.outputs[0]]), strict=True):
        np.testing.assert_allclose(column, expected, rtol=1e-10, atol=1e-10)
    equal(found[-1], last)


def parameters_of(model):
    """Return the parameters of a program in its order."""
    given = numbers(model)
    return np.array([given.get(name, 0.0) for name in model.layout.parameters])


@METHODS
def test_runs_that_continue_find_the_breaks_that_follow(values_at, method):
    """As further calls of `simulate` from where the last one ended, which may be a break."""
    model = forced()
    own, ends = numbers(model), [0.3, VALUES["T"], 1.9, 2.5]
    found = values_at(method, (0.0, 0.3), ends)
    run = model.simulate((0.0, 2.5), START, own, t_eval=ends, method=method, **TOLERANCES)
    np.testing.assert_allclose(found[:, 0], run["x"], rtol=1e-7, atol=1e-8)


@METHODS
def test_controllers_beside_breaks(tmp_path, method):
    """Instants between breaks, at one, and within rounding of one; at the start, where conditions are as of there."""
    law = {u: -2 * x.diff() + Heaviside(t - T, 0) * a - sign(sin(w * t))}
    model = compiled(FORCE, controllers=[da.Controller("law", period=T / 7, inputs=law)], outputs=[Derivative(x, t, 2)])
    start, given = START, {"method": method, **TOLERANCES}
    own = numbers(model)
    path = model.export(tmp_path / "export", initial=start, parameters=own, t_span=(0, 3.1), **given)
    names, *rows = output(built(path, ["main.c", "pushed.c"]), 3.1, 63).splitlines()
    found = dict(zip(names.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))
    run = model.simulate((0, 3.1), start, own, t_eval=found["t"], **given)
    last = model.simulate((0, 3.1), start, own, **given)
    for name in model.layout.variables:
        np.testing.assert_allclose(found[name], run[name], rtol=1e-10, atol=1e-10, err_msg=name)
        if same_bits():
            assert found[name][-1] == last[name][-1]


@METHODS
def test_events_beside_breaks(tmp_path, method):
    """Their signs are those of constants behind breaks; one of them maps the state, and one jumps with a force."""
    model = forced()
    wall = da.Event(x - a / 4, direction=1, apply={x.diff(): -0.8 * x.diff()}, name="wall")
    jump = da.Event(sign(sin(w * t)) * (x + 1), name="jump")
    given, own = {"method": method, "events": [wall, jump], **TOLERANCES}, numbers(model)
    found = run_alone(tmp_path, model, START, own, 3.1, **given)
    run = model.simulate((0, 3.1), START, own, **given)
    assert len(run.events["wall"].t) > 1 and len(run.events["jump"].t) > 3
    at_times = model.simulate((0, 3.1), START, own, t_eval=found[0], **given)
    assert_same_run(found, run, model, ["wall", "jump"], at_times)


def test_units_find_breaks_between_communication_points(tmp_path):
    """For co-simulation alone; with events, too, whose wall maps the state."""
    model = forced()
    own = numbers(model)
    wall = da.Event(x - a / 4, direction=1, apply={x.diff(): -0.8 * x.diff()}, name="wall")
    times = [0.0, 0.1, 0.65, 0.95, 1.97, 2.3, 2.4, 3.1]
    for number, events in enumerate(([], [wall])):
        given = {"initial": START, "parameters": own, "events": events, **TOLERANCES}
        unit, found = Unit(*unpacked(model, tmp_path / f"{number}.fmu", **given)), []
        assert unit.begin(0.0) == 0
        for before, after in itertools.pairwise(times):
            assert unit.step(before, after - before) == 0
            found.append([unit.get(name) for name in ("x", "x_dot", model.layout.outputs[0])])
        run = model.simulate((0, 3.1), START, own, t_eval=times, events=events, **TOLERANCES)
        for column, name in zip(np.transpose(found), ("x", "x_dot", model.layout.outputs[0]), strict=True):
            np.testing.assert_allclose(column, run[name][1:], rtol=1e-6, atol=1e-6, err_msg=name)
        assert "ModelExchange" not in (tmp_path / f"{number}.fmu").read_bytes().decode("latin-1")


def test_packages_and_pages_move_as_in_simulate(tmp_path):
    model = forced()
    own, times = numbers(model), np.linspace(0, 3.1, 32)
    run = model.simulate((0, 3.1), START, own, t_eval=times)
    need_pages()
    page = model.export(tmp_path / "page.html", "page", t_span=(0, 3.1), initial=START, parameters=own)
    printed, found = run_of(page, times)
    assert printed["status"] == 0
    for name in ("x", "x_dot", model.layout.outputs[0]):
        np.testing.assert_allclose(found[name], run[name], rtol=1e-8, atol=1e-8, err_msg=name)
    described, _ = parts(page)
    assert [item["name"] for item in described["given"]] == [*sorted(START), *own]


def test_what_is_not_carried(tmp_path):
    law = da.Controller("law", period=T, inputs={u: -x})
    model = compiled(FORCE, controllers=[law])
    with pytest.raises(CapabilityError, match=r"pulses beside sampled controllers \(pushed, law\): take one"):
        model.export(tmp_path / "a.fmu", "fmu")
    table = da.table(t, [0, 1, 2, 4], [0, 1, 0, 2], extrapolate="hold", kind="cubic")
    with pytest.raises(CapabilityError, match=r"conditions have tables.*write the curves as expressions"):
        compiled(sign(table - T)).export(tmp_path / "b")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + Max(0, t - 1) * N.y)
    scene = da.Scene("lifted", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, 1))
    with pytest.raises(CapabilityError, match="prescribed velocities that jump"):
        da.compile_model(scene).export(tmp_path / "c")
    assert list(tmp_path.iterdir()) == []
