"""Simulators in C with steps of a fixed size, beside `simulate` and beside the classic method in NumPy."""

import re
import subprocess

import numpy as np
import pytest
from sympy import cos, sign, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import SANITIZED, WARNINGS, built, compiler, output
from dalembert.codegen.c.fixed_simulator import operation_rows
from dalembert.errors import CapabilityError, OptionError
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Kernel
from dalembert.transforms.runge_kutta import corrected_kernel, excess_kernel
from export.fixed_runs import HARD, compilers, example, oscillator, states
from hard_cases import hard_case


def classic(model, y, p, step, count):
    """Return the states (count + 1, n_y) by the classic method in NumPy, from the rates of a model."""
    program = model.stages.program
    c = interpret(program.kernel("prepare"), {"p": p})
    named = {kernel.name: kernel for kernel in program}

    def at(name, t, y):
        return np.array(interpret(named[name], {"t": t, "y": y, "c": c}))

    found = [y]
    for k in range(count):
        t = k * step
        k1 = at("rhs", t, y)
        k2 = at("rhs", t + step / 2, y + step / 2 * k1)
        k3 = at("rhs", t + step / 2, y + step / 2 * k2)
        k4 = at("rhs", t + step, y + step * k3)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        for name, times in (("project_position", 3), ("project_velocity", 2)):
            for _ in range(times if name in named else 0):
                y = y + at(name, t + step, y)
        found.append(y)
    return np.array(found)


@pytest.mark.parametrize("name", ["sleigh", *HARD])
def test_a_step_is_that_of_the_classic_method(tmp_path, name):
    model, initial, parameters = example(name)
    found = states(tmp_path, name, 0.002, 200)
    start, p = model.state(initial, parameters), model.parameter_vector(parameters)
    np.testing.assert_allclose(found, classic(model, start, p, 0.002, 200), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(("name", "step"), [("sleigh", 0.05), (HARD[0], 0.005), (HARD[1], 0.005), (HARD[2], 0.005)])
def test_the_order_is_4(tmp_path, name, step):
    """The error against `simulate` is 16 times smaller for half the size of the steps."""
    model, initial, parameters = example(name)
    run = model.simulate((0, 1), initial, parameters, t_eval=[1.0], rtol=1e-13, atol=1e-14)
    errors = [
        np.max(np.abs(states(tmp_path, name, h, round(1 / h))[-1] - run.y[-1])) for h in (step, step / 2, step / 4)
    ]
    assert errors[2] > 1e-12  # nothing of rounding
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 16, rtol=0.2)


def test_states_stay_on_the_constraints(tmp_path):
    found = states(tmp_path, HARD[0], 0.01, 1000)
    x, y, x_dot, y_dot = found.T
    assert np.max(np.abs(x**2 + y**2 - 1)) < 4e-15
    assert np.max(np.abs(x * x_dot + y * y_dot)) < 1e-14


INPUT = """
#include "oscillator.h"
#include <stdio.h>
int main(void)
{
    const double initial[] = {0.1, 0.0}, parameters[] = {1.5, 2.0};
    oscillator_run run, before;
    double motion[2], energy[2];
    oscillator_start(&run, 0.0, initial, parameters);
    oscillator_set_input(&run, oscillator_input_u, 1.0, 0.5);
    while (run.steps < 1000) {
        oscillator_step(&run);
    }
    before = run;
    oscillator_set_input(&run, oscillator_input_u, -2.0, 0.0);
    while (run.steps < 2500) {
        oscillator_step(&run);
    }
    run = before;
    oscillator_set_input(&run, oscillator_input_u, -2.0, 0.0);
    while (oscillator_time(&run) < 2.4995) {
        oscillator_step(&run);
    }
    oscillator_expand(&run, oscillator_time(&run), run.state, motion);
    oscillator_energy(&run, oscillator_time(&run), run.state, energy);
    printf("%.17g %.17g %.17g %.17g\\n", motion[0], motion[1], energy[0], oscillator_time(&run));
    return (int)run.status + 1;
}
"""


def test_inputs_are_set_between_steps(tmp_path):
    model = da.compile_model(oscillator())
    path = model.export(tmp_path / "export", method="rk4", step=0.001)
    names = [line.split()[-2] for line in (path / "oscillator.h").read_text().splitlines() if "parameter_" in line]
    assert names == ["k", "m"]
    (path / "inputs.c").write_text(INPUT)
    x, x_dot, kinetic, t = map(float, output(built(path, ["inputs.c", "oscillator.c"])).split())
    force = da.samples([0, 1, 1 + 1e-13, 3], [1.0, 1.5, -2.0, -2.0], kind="linear")
    run = model.simulate((0, 2.5), {"x": 0.1, "x_dot": 0}, {"k": 1.5, "m": 2.0}, inputs={"u": force}, t_eval=[2.5],
                         rtol=1e-12, atol=1e-13)  # fmt: skip
    assert t == 2.5
    np.testing.assert_allclose([x, x_dot], [run["x"][0], run["x_dot"][0]], rtol=1e-11)
    assert kinetic == pytest.approx(x_dot**2)


@pytest.mark.parametrize("command", compilers(), ids=lambda command: command[-1])
@pytest.mark.parametrize("name", ["sleigh", HARD[0]])
def test_compilers_warn_of_nothing(tmp_path, name, command):
    model, *_ = example(name)
    path = model.export(tmp_path / "export", method="rk4", step=0.01)
    sources = sorted(item.name for item in path.glob("*.c"))
    for flags in (["-O0"], ["-O2", "-Wshadow", "-Wstrict-prototypes"]):
        done = subprocess.run([*command, *WARNINGS, *flags, "-c", *sources], cwd=path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr[:2000]


def test_sanitizers_find_nothing(tmp_path):
    try:
        for name, precision in (("sleigh", "double"), (HARD[0], "double"), (HARD[0], "single")):
            folder = tmp_path / f"{name} {precision}"
            folder.mkdir()
            assert len(states(folder, name, 0.01, 300, *SANITIZED, precision=precision)) == 301
    except AssertionError as reason:
        if "libasan" in str(reason) or "libubsan" in str(reason):
            pytest.skip("the C compiler has no sanitizers")
        raise


# Operations.


def readme_counts(path):
    return {kind: int(n) for kind, n in re.findall(r"^\| ([^|]+) \| (\d+) \|$", (path / "README.md").read_text(), re.M)
            if "operation" not in kind and not kind.isdigit()}  # fmt: skip


def test_operations_of_an_oscillator(tmp_path):
    """Four times a rate of (2 sums, 2 products for the input, one for the spring, one for the mass), and the method."""
    x = dynamicsymbols("x")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("spring", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("mass", P, symbols("m", positive=True)))
    scene.add_loads((P, -symbols("k", positive=True) * x * N.x))
    path = da.compile_model(scene).export(tmp_path / "export", method="rk4", step=0.1)
    found = readme_counts(path)
    # rates: x times a constant; points: a product and a sum for each of 2 components, in 3 stages, and a sum for time;
    # the end: 5 products and 4 sums for each component; the test of 2 numbers: 2 products, 1 sum; the time: 1 and 1
    assert found["multiplications"] == 4 + 3 * 2 + 2 * 5 + 2 + 1
    assert found["additions and subtractions"] == 3 * (2 + 1) + 2 * 4 + 1 + 1
    assert found["comparisons and choices"] == 1
    assert not {"divisions", "square roots"} & set(found)


@pytest.mark.parametrize("name", ["sleigh", *HARD])
def test_operations_are_those_of_the_text(tmp_path, name):
    """What a step calls is counted in its C."""
    model, *_ = example(name)
    path = model.export(tmp_path / "export", method="rk4", step=0.1)
    (source,) = (item for item in path.glob("*.c") if item.name != "main.c")
    text = source.read_text()
    prefix = source.stem
    body = "".join(re.findall(rf"\n(?:int32_t {prefix}_step|static bool angles_lock)\(.*?\n}}", text, re.S))
    total = {"+-": 1, "*": 1, "/": 0, "sqrt": 0, "angle_of": 0}
    for called in re.findall(rf"    {prefix}_(\w+)\(", body):
        (inner,) = re.findall(rf"static void {prefix}_{called}\(.*?\n}}", text, re.S)
        for value in re.findall(r"(?<== )([^;=]+);", inner):
            fused = value.count("fused(")
            total["+-"] += fused + len(re.findall(r" [+-] ", value))
            total["*"] += fused + value.count(" * ")
            total["/"] += value.count(" / ")
            total["sqrt"] += value.count("sqrt(")
            total["angle_of"] += value.count("angle_of(")
    found = readme_counts(path)
    kinds = ("additions and subtractions", "multiplications", "divisions", "square roots")
    kinds += ("sines and cosines of one angle together",)
    assert list(total.values()) == [found.get(kind, 0) for kind in kinds]


def test_calls_of_the_library_have_names():
    kernel = Kernel.parse("kernel k(t, y, c)\n  a = y[0]\n  b = exp(a)\n  d = atan2(a, b)\n  e = exp(d)\n  out[0] = e")
    assert dict(operation_rows([(kernel, 3)], {}))["calls of `exp`"] == 6
    assert dict(operation_rows([(kernel, 3)], {}))["calls of `atan2`"] == 3


# Steps that fail.


def test_a_step_that_fails_leaves_the_state(tmp_path):
    """Far beyond the limit of stability numbers overflow, and the run stays where they were finite."""
    model = da.compile_model(oscillator())
    given = {"initial": {"x": 1, "x_dot": 0}, "parameters": {"k": 1e8, "m": 1}, "inputs": {"u": 0.0}}
    path = model.export(tmp_path / "export", method="rk4", step=1.0, t_span=(0, 1000), **given)
    program = built(path, ["main.c", "oscillator.c"])
    assert "status 3" in output(program, status=1)
    text = subprocess.run([program], capture_output=True, text=True).stdout
    assert "nan" not in text and "inf" not in text


def test_a_projection_that_does_not_converge_fails(tmp_path):
    model, initial, parameters = example(HARD[0])
    given = {"initial": {**initial, "y_dot": 40.0}, "parameters": parameters}
    path = model.export(tmp_path / "export", method="rk4", step=0.1, **given)
    (source,) = (item.name for item in path.glob("*.c") if item.name != "main.c")
    assert "status 4" in output(built(path, ["main.c", source]), status=1)


def test_corrections_are_tested_by_their_size():
    correction = Kernel.parse("kernel p(t, y, c)\n  a = y[0]\n  b = c[0]\n  d = a * b\n  out[0] = d\n  out[1] = 0.0")
    assert list(interpret(corrected_kernel(correction), {"t": 0.0, "y": [2.0, 3.0], "c": [0.5], "s": []})) == [3.0, 3.0]
    excess = excess_kernel(correction)
    for change, passes in ((1e-5, True), (1e-3, False), (-1e-3, False), (np.nan, False)):
        (value,) = interpret(excess, {"t": 0.0, "y": [2.0, 3.0], "c": [], "s": [2.0 + change, 0.0]})
        assert (value <= 0.0) is passes


def test_angles_that_lock_end_a_run(tmp_path):
    case = hard_case("sphere through theta = 0, in angles")
    given = {"initial": case.initial, "parameters": case.parameters, "t_span": (0, case.times()[-1])}
    path = case.compile("auto").export(tmp_path / "export", method="rk4", step=0.001, **given)
    (source,) = (item.name for item in path.glob("*.c") if item.name != "main.c")
    assert "status 14" in output(built(path, ["main.c", source]), status=1)


def test_starts_that_are_wrong_are_refused(tmp_path):
    model, initial, parameters = example(HARD[0])
    path = model.export(tmp_path / "export", initial=initial, parameters=parameters, method="rk4", step=0.01)
    program = built(path, ["main.c", next(item.name for item in path.glob("*.c") if item.name != "main.c")])
    assert "status 5" in output(program, 1, 2, -1.1, 0, 0, 0, 9.81, 1, status=1)


# What is refused.


def test_contacts_tables_and_jumps_are_refused(tmp_path):
    place, given = tmp_path / "a", {"method": "rk4", "step": 0.01}
    contacts = da.compile_model(da.scenes.corner_plate(friction=True))
    with pytest.raises(CapabilityError, match=r"method='rk4' does not carry contacts that change.*model\.mode"):
        contacts.export(place, **given)
    table = oscillator(lambda x: da.table(x, [-2, 0, 1, 2], [-1, 0, 0, 3], kind="cubic", extrapolate="linear"))
    with pytest.raises(CapabilityError, match=r"does not carry tables .*steps do not end.*method=\"auto\""):
        da.compile_model(table).export(place, **given)
    with pytest.raises(CapabilityError, match=r"rates that jump with the state .*smooth the jumps"):
        da.compile_model(oscillator(lambda x: -sign(x.diff()))).export(place, **given)
    assert list(tmp_path.iterdir()) == []


def test_kinks_are_named(tmp_path):
    model = da.compile_model(oscillator(lambda x: -abs(x)))
    path = model.export(tmp_path / "export", method="rk4", step=0.01)
    assert "have kinks" in (path / "README.md").read_text()
    path = da.compile_model(oscillator(lambda x: sin(x) + cos(x))).export(path, method="rk4", step=0.01)
    assert "have kinks" not in (path / "README.md").read_text()


def test_options_of_fixed_steps(tmp_path):
    model, *_ = example("sleigh")
    place = tmp_path / "a"
    with pytest.raises(OptionError, match="needs the size of its steps"):
        model.export(place, method="rk4")
    with pytest.raises(OptionError, match="method='rk4', and not of 'auto'"):
        model.export(place, step=0.01)
    with pytest.raises(OptionError, match="one of the kind 'c', not of 'numba'"):
        model.export(tmp_path / "a.py", kind="numba", method="rk4", step=0.01)
    with pytest.raises(OptionError, match="have no tolerances"):
        model.export(place, method="rk4", step=0.01, rtol=1e-6)
    for wrong in (0, -0.1, True, "fast", float("inf"), float("nan")):
        with pytest.raises(OptionError, match="step must be a finite number"):
            model.export(place, method="rk4", step=wrong)
    compiler()
    assert list(tmp_path.iterdir()) == []
