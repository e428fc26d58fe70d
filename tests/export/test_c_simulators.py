"""Simulators in C, compiled with warnings as errors and run alone, beside `simulate`."""

import os
import shutil
import subprocess

import numpy as np
import pytest
from sympy import Float, acos, asin, atan, atan2, cos, cosh, exp, log, sin, sinh, symbols, tan, tanh
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import OPTIMISED, SANITIZED, built, compiler, output, same_bits
from corpus.named_scenes import READY
from hard_cases import hard_case

SCENES = ("chaplygin_sleigh", "rolling_sphere", "corner_plate", "edge_plate")
HARD = ("rolling disk", "pendulum, Cartesian (IFToMM A01)", "heavy top, fast precession", "slider-crank")

STEPS = """
#include "{0}.h"
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv)
{{
    static {0}_run run;
    double values[64], state[64];
    int i;
    for (i = 2; i < argc; i++) {{
        values[i - 2] = atof(argv[i]);
    }}
    {0}_start(&run, 0.0, atof(argv[1]), values, values + {1}_INITIAL, 0.0, 0);
    while ({0}_step(&run) <= 0) {{
        {0}_at(&run, {0}_time(&run), state);
        printf("%a", {0}_time(&run));
        for (i = 0; i < {1}_STATES; i++) {{
            printf(" %a", state[i]);
        }}
        printf("\\n");
        if (run.status == 0) {{
            return 0;
        }}
    }}
    return 1;
}}
"""
"""A program that prints the ends of all steps to the last bit."""


def exported(folder, model, initial, parameters, **options):
    """Export a model, and compile its example."""
    path = model.export(folder / "export", initial=initial, parameters=parameters, **options)
    (header,) = path.glob("*.h")
    source, aside = path / f"{header.stem}.c", folder / "alone"
    shutil.copytree(path, aside)
    shutil.rmtree(path)
    return built(aside, ["main.c", source.name], *OPTIMISED), header.stem


def rows(text):
    """Return the columns of comma-separated values by name."""
    head, *lines = text.splitlines()
    values = np.array([[float(number) for number in line.split(",")] for line in lines])
    return dict(zip(head.split(","), values.T, strict=True))


def assert_equal_to(found, run, atol=1e-12):
    for name, values in found.items():
        expected = run.t if name == "t" else run[name]
        np.testing.assert_allclose(values, expected, rtol=1e-11, atol=atol, err_msg=name)


@pytest.mark.parametrize("method", ["auto", "dop853"])
@pytest.mark.parametrize("name", SCENES)
def test_ready_scenes_move_as_in_simulate(tmp_path, name, method):
    case = READY[f"ready: {name}"]
    model = da.compile_model(case.build())
    given = {"t_span": case.span, "method": method}
    program, _ = exported(tmp_path, model, case.initial, case.parameters, **given)
    found = rows(output(program))
    run = model.simulate(case.span, case.initial, case.parameters, method=method, t_eval=found["t"])
    assert_equal_to(found, run)


def steps_of(folder, model, initial, parameters, end, method):
    """Return the ends of the steps of an export: times (k,) and states (k, n)."""
    path = model.export(folder / "export", method=method, rtol=1e-10, atol=1e-12, initial=initial)
    (header,) = path.glob("*.h")
    (path / "steps.c").write_text(STEPS.format(header.stem, header.stem.upper()))
    known = {**model.read_initial(initial), **model.read_parameters(parameters)}
    entries = header.read_text().split("enum {")
    wanted = [line.split("/* ")[1][:-3] for part in entries for line in part.splitlines() if "_initial_" in line or
              ("_parameter_" in line and "=" in line)]  # fmt: skip
    values = [repr(float(known[name])) for name in wanted]
    text = output(built(path, ["steps.c", f"{header.stem}.c"]), end, *values)
    table = np.array([[float.fromhex(number) for number in line.split()] for line in text.splitlines()])
    return table[:, 0], table[:, 1:]


STIFF = ("pendulum, Cartesian (IFToMM A01)", "stiff flyball governor")


@pytest.mark.parametrize(
    ("name", "method"),
    [(name, method) for name in HARD for method in ("taylor", "dop853")] + [(name, "radau") for name in STIFF],
)
def test_steps_are_those_of_simulate_to_the_last_bit(tmp_path, name, method):
    """Also of angles that lose their turns, of loops over the orders, and of projected states."""
    case = hard_case(name)
    model, end = case.compile("auto"), min(case.times()[-1], 4.0)
    t, y = steps_of(tmp_path, model, case.initial, case.parameters, end, method)
    options = {"rtol": 1e-10, "atol": 1e-12, "method": method, "dense": False}
    run = model.simulate((0, end), case.initial, case.parameters, **options)
    assert len(t) == len(run.t) - 1
    if same_bits():
        np.testing.assert_array_equal(t, run.t[1:])
        np.testing.assert_array_equal(y, run.y[1:])
    np.testing.assert_allclose(y, run.y[1:], rtol=1e-8, atol=1e-8)


def elementary_scene():
    """Return a particle on a spring, with losses by every elementary function."""
    x, (m, k, e) = dynamicsymbols("x"), symbols("m k e", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P, z = O.locatenew("P", x * N.x), x.diff() / e
    losses = (
        tanh(z) + atan(z) * exp(-(z**2)) + z * (1 + z**2) ** Float("-0.37") + atan2(z, 2 + sin(x)) + log(1 + z**2) * z
    )
    losses += sinh(z / 4) * cosh(x / 4) + asin(x / 3) - acos(sin(x) / 2) / 9
    scene = da.Scene("lossy", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("particle", P, m))
    scene.add_loads((P, -(k * tan(x / 4) + losses / 10) * N.x))
    return scene


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_elementary_functions_are_those_of_simulate_to_the_last_bit(tmp_path, method):
    model, initial, parameters = (
        da.compile_model(elementary_scene()),
        {"x": 1.0, "x_dot": 0.0},
        {"m": 1, "k": 9, "e": 0.5},
    )
    t, y = steps_of(tmp_path, model, initial, parameters, 4.0, method)
    run = model.simulate((0, 4.0), initial, parameters, rtol=1e-10, atol=1e-12, method=method, dense=False)
    assert len(t) == len(run.t) - 1
    if same_bits():
        np.testing.assert_array_equal(t, run.t[1:])
        np.testing.assert_array_equal(y, run.y[1:])
    np.testing.assert_allclose(y, run.y[1:], rtol=1e-8, atol=1e-8)


def test_sanitizers_find_nothing(tmp_path):
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    model = case.compile("projected")
    for method in ("taylor", "radau"):
        path = model.export(
            tmp_path / method, initial=case.initial, parameters=case.parameters, method=method, t_span=(0, 3)
        )
        name = next(path.glob("*.h")).stem
        try:
            program = built(path, ["main.c", f"{name}.c"], *SANITIZED)
        except AssertionError as reason:
            if "libasan" in str(reason) or "libubsan" in str(reason):
                pytest.skip("the C compiler has no sanitizers")
            raise
        assert len(output(program).splitlines()) == 12


def driven():
    """Return a mass on a spring with a nonlinear table, a force that is an input, and a first-order state."""
    x, force, z = dynamicsymbols("x force z")
    m, k = symbols("m k", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("driven mass", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", O.locatenew("P", x * N.x), m))
    scene.add_inputs(force)
    spring = da.table(x, [-2, -1, 0, 1, 2], [-3, -1, 0, 1, 3], kind="linear", extrapolate="linear")
    scene.add_loads((scene.bodies[0].masscenter, (force - k * spring) * N.x))
    scene.add_states({z: x - z})
    return scene


SET_INPUT = """
#include "driven_mass.h"
#include <stdio.h>
#include <string.h>
int main(void)
{
    const double initial[] = {0.1, 0.0, 0.3}, parameters[] = {2.0, 1.5};
    driven_mass_run run, before;
    double state[DRIVEN_MASS_STATES], values[3];
    int32_t status = driven_mass_start(&run, 0.0, 1.0, initial, parameters, 0.0, 0);
    driven_mass_set_input(&run, driven_mass_input_force, 1.0, 0.5);
    while (status == DRIVEN_MASS_RUNNING) {
        status = driven_mass_step(&run);
    }
    before = run;
    driven_mass_continue(&run, 2.0);
    memset(&run, 0, sizeof run);
    run = before;
    status = driven_mass_continue(&run, 2.5);
    driven_mass_set_input(&run, driven_mass_input_force, -2.0, 0.0);
    status = driven_mass_at(&run, 1.7, state);
    driven_mass_expand(&run, 1.7, state, values);
    printf("%.17g %.17g %.17g\\n", values[0], values[1], values[2]);
    status = driven_mass_at(&run, 2.5, state);
    driven_mass_expand(&run, 2.5, state, values);
    printf("%.17g %.17g %.17g\\n", values[0], values[1], values[2]);
    printf("%d %d ", (int)status, (int)driven_mass_at(&run, 0.5, state));
    status = driven_mass_at(&run, 2.5 - 1e-9, state);
    driven_mass_expand(&run, 2.5, state, values);
    printf("%d %.17g\\n", (int)status, values[0]);
    driven_mass_set_input(&before, driven_mass_input_force, -2.0, 0.0);
    driven_mass_continue(&before, 2.5);
    while (driven_mass_step(&before) == DRIVEN_MASS_RUNNING && driven_mass_time(&before) < 1.7) {
    }
    driven_mass_at(&before, 1.7, state);
    driven_mass_expand(&before, 1.7, state, values);
    printf("%.17g %.17g %.17g\\n", values[0], values[1], values[2]);
    return 0;
}
"""


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_inputs_are_set_while_a_run_goes_on(tmp_path, method):
    """A run that goes on behind its end, from a copy, with another input, is the run with samples."""
    model = da.compile_model(driven())
    path = model.export(tmp_path / "export", method=method, rtol=1e-10, atol=1e-12)
    names = [line.split()[-2] for line in (path / "driven_mass.h").read_text().splitlines() if "_initial_" in line]
    assert names == ["x", "x_dot", "z"]
    (path / "inputs.c").write_text(SET_INPUT)
    at_1_7, at_end, statuses, again = output(built(path, ["inputs.c", "driven_mass.c"])).splitlines()
    assert again == at_1_7  # whether the input is set first, and between steps that are taken one by one
    force = da.samples([0, 1, 1 + 1e-13, 3], [1.0, 1.5, -2.0, -2.0], kind="linear")
    run = model.simulate((0, 2.5), {"x": 0.1, "x_dot": 0, "z": 0.3}, {"k": 2.0, "m": 1.5}, inputs={"force": force},
                         t_eval=[1.7, 2.5], method=method, rtol=1e-10, atol=1e-12)  # fmt: skip
    for line, place in ((at_1_7, 0), (at_end, 1)):
        found = [float(number) for number in line.split()]
        np.testing.assert_allclose(found, [run[name][place] for name in ("x", "x_dot", "z")], rtol=2e-9, atol=2e-9)
    before_end, place = statuses.split()[2:]
    assert statuses.split()[:2] == ["0", "16"]
    assert before_end == "16" or float(place) == pytest.approx(run["x"][1], abs=1e-8)


def pendulum(name="pendulum", x="x", y="y", mass="m", length="l"):
    """Return a pendulum in Cartesian coordinates, with names of a user's choice."""
    x, y = dynamicsymbols(f"{x} {y}")
    m, l, g = symbols(f"{mass} {length} g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bob", O.locatenew("P", x * N.x + y * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    return scene


def test_outputs_energy_and_names_that_mean_something_in_c(tmp_path):
    """Names of C, names that differ in case alone, and a scene called main."""
    model = da.compile_model(pendulum("main", "double", "I", "sin", "SIN"), outputs=["double_ddot"])
    initial = {"double": 0.6, "I": -0.8, "double_dot": 0.0, "I_dot": 0.0}
    parameters = {"sin": 2.0, "SIN": 1.0, "g": 9.81}
    program, prefix = exported(tmp_path, model, initial, parameters, t_span=(0, 2))
    assert prefix != "main"
    found = rows(output(program))
    run = model.simulate((0, 2), initial, parameters, t_eval=found["t"])
    assert_equal_to(found, run, atol=1e-10)
    assert set(found) == {"t", "double", "I", "double_dot", "I_dot", "double_ddot"}


def test_initial_values_that_the_constraints_fix_are_left_out(tmp_path):
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    initial = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    parameters = {"m": 1, "b": 0.3, "I_C": 0.5}
    program, _ = exported(tmp_path, model, initial, parameters, t_span=(0, 1))
    found = rows(output(program))
    assert found["y_dot"][0] == pytest.approx(0.98 * np.tan(0.2), rel=1e-14)


def test_starts_that_are_wrong_are_refused(tmp_path):
    """With the constraint, the declaration of a parameter, and the times."""
    model = da.compile_model(pendulum(), formulation="projected")
    program, _ = exported(tmp_path, model, {"x": 0.6, "y": -0.8, "x_dot": 0, "y_dot": 0}, None)
    right = {"x": 0.6, "y": -0.8, "x_dot": 0.0, "y_dot": 0.0, "g": 9.81, "l": 1.0, "m": 1.0}
    usage = output(program, 1, 3, status=2)
    names = usage.split("of:")[1].split()
    assert sorted(names) == sorted(right)

    def told(**changed):
        values = [str({**right, **changed}[name]) for name in names]
        return output(program, 1, 3, *values, status=1)

    assert "status 5" in told(x=0.7) and "positions: holonomic constraint 1" in told(x=0.7)
    assert "rates: " in told(x_dot=1.0)
    assert "status 15" in told(m=-1.0)
    assert "status 3" in told(x="nan")
    assert "status 16" in output(program, "inf", 3, *[str(right[name]) for name in names], status=1)


def test_the_method_is_that_of_a_run_of_the_example(tmp_path):
    case = hard_case("stiff flyball governor")
    model, given = case.compile("auto"), {"initial": case.initial, "parameters": case.parameters}
    run = model.simulate((0, 10), case.initial, case.parameters, rtol=1e-6, atol=1e-8)
    path = model.export(tmp_path / "export", rtol=1e-6, atol=1e-8, **given)
    assert run.stats.method == "radau" and "steps of the method radau" in (path / "README.md").read_text()


def test_angles_that_lock_end_a_run(tmp_path):
    case = hard_case("sphere through theta = 0, in angles")
    model = case.compile("auto")
    program, _ = exported(tmp_path, model, case.initial, case.parameters, t_span=(0, case.times()[-1]))
    assert "status 14" in output(program, status=1)
    run = model.simulate((0, case.times()[-1]), case.initial, case.parameters)
    assert run.status.name == "SINGULAR_COORDINATES"


def test_runs_go_backward(tmp_path):
    theta, (m, l, g) = dynamicsymbols("theta"), symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("swing", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(Particle("bob", O.locatenew("P", l * sin(theta) * N.x - l * cos(theta) * N.y), m))
    scene.apply_uniform_gravity(-g * N.y)
    model, initial, parameters = da.compile_model(scene), {"theta": 1, "theta_dot": 9.0}, {"m": 1, "l": 1, "g": 9.81}
    for method in ("taylor", "dop853"):
        folder = tmp_path / method
        folder.mkdir()
        program, _ = exported(folder, model, initial, parameters, t_span=(2, -3), method=method)
        found = rows(output(program))
        run = model.simulate((2, -3), initial, parameters, t_eval=found["t"], method=method)
        assert_equal_to(found, run, atol=1e-9)


def test_the_makefile_builds_the_example(tmp_path):
    if shutil.which("make") is None:
        pytest.skip("no make")
    compiler()
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    path = model.export(tmp_path / "export", initial={"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0},
                        parameters={"m": 1, "b": 0.3, "I_C": 0.5})  # fmt: skip
    environment = {**os.environ, "CC": compiler(), "CFLAGS": "-O1"}
    subprocess.run(["make", "-C", path], check=True, capture_output=True, env=environment)
    assert output(path / "chaplygin_sleigh").startswith("t,x,y,theta")
    assert model.export(path, initial=None) == path  # what make has built is no obstacle
