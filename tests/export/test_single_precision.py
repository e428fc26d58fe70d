"""Exports in single precision: the same steps as in double precision but for rounding, and no double in their code."""

import re
import subprocess

import numpy as np
import pytest

import dalembert as da
from codegen.c_programs import WARNINGS, built, output
from dalembert.codegen.c.fixed_simulator import in_single, kernel_in_single, single
from dalembert.errors import CapabilityError, OptionError
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Kernel
from export.fixed_runs import HARD, compilers, example, oscillator, states

EPSILON = 2.0**-23
DOUBLE = re.compile(
    r"\b(double|DBL_\w+|sin|cos|tan|sqrt|fabs|exp|log|pow|floor|atan2|fma)\b|(?<![\w.])\d+\.\d*(e[+-]?\d+)?(?![\w.])"
)
"""What code in double precision has."""


def code(path):
    """Return the source and the header of an export without comments and strings."""
    (header,) = path.glob("*.h")
    text = header.read_text() + (path / f"{header.stem}.c").read_text()
    return re.sub(r'/\*.*?\*/|"[^"\n]*"', "", text, flags=re.S)


@pytest.mark.parametrize("name", ["sleigh", *HARD, "double pendulum, Cartesian"])
def test_states_are_those_of_doubles_but_for_rounding(tmp_path, name):
    """Steps of 0.01 s for a second: errors of a step of some spacings of floats add up, and motions amplify them."""
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
    found, expected = (
        states(folder, name, 0.01, 100, precision=precision)
        for folder, precision in zip(folders, ("single", "double"), strict=True)
    )
    assert np.array_equal(found, found.astype(np.float32))
    scale = np.max(np.abs(expected))
    difference = np.max(np.abs(found - expected)) / scale
    assert 0 < difference < 100 * EPSILON


def test_states_in_single_precision_stay_on_the_constraints(tmp_path):
    x, y, x_dot, y_dot = states(tmp_path, HARD[0], 0.01, 1000, precision="single").T
    assert np.max(np.abs(x**2 + y**2 - 1)) < 4 * EPSILON
    assert np.max(np.abs(x * x_dot + y * y_dot)) < 8 * EPSILON * np.max(np.hypot(x_dot, y_dot))


@pytest.mark.parametrize("command", compilers(), ids=lambda command: command[-1])
@pytest.mark.parametrize("name", ["sleigh", HARD[0], "rolling disk"])
def test_no_double_is_left(tmp_path, name, command):
    model, *_ = example(name)
    path = model.export(tmp_path / "export", method="rk4", step=0.01, precision="single")
    text = code(path)
    assert DOUBLE.search(text) is None, DOUBLE.search(text)
    assert name == HARD[0] or "sinf(" in text
    sources = sorted(item.name for item in path.glob("*.c"))
    flags = [*WARNINGS, "-O2", "-Wdouble-promotion", "-c"]
    done = subprocess.run([*command, *flags, *sources], cwd=path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:2000]


def test_what_marks_doubles_finds_them(tmp_path):
    model, *_ = example("sleigh")
    text = code(model.export(tmp_path / "export", method="rk4", step=0.01))
    assert {"double", "fabs", "0.0"} <= {match[0] for match in DOUBLE.finditer(text)}


def test_the_example_reads_and_prints(tmp_path):
    """With inputs, outputs and all formats, and calls of the library that the README counts."""
    model, initial, parameters = example("sleigh")
    given = {"initial": initial, "parameters": parameters, "method": "rk4", "step": 0.001, "precision": "single"}
    path = model.export(tmp_path / "export", **given)
    last = output(built(path, ["main.c", "chaplygin_sleigh.c"], "-Wdouble-promotion"), 1, 2).splitlines()[-1]
    run = model.simulate((0, 1), initial, parameters, t_eval=[1.0])
    t, x, y, theta, *_ = map(float, last.split(","))
    assert t == pytest.approx(1, abs=1e-7)
    np.testing.assert_allclose([x, y, theta], run.q[-1], rtol=1e-5)
    assert "| calls of `sinf` | 4 |" in (path / "README.md").read_text()
    driven = da.compile_model(oscillator(), outputs=["x_ddot"])
    given = {"initial": {"x": 0, "x_dot": 0}, "parameters": {"m": 1, "k": 1}, "inputs": {"u": 0.5}}
    path = driven.export(tmp_path / "driven", method="rk4", step=0.01, precision="single", **given)
    rows = output(built(path, ["main.c", "oscillator.c"], "-Wdouble-promotion"), 1, 2).splitlines()
    assert float(rows[-1].split(",")[1]) == pytest.approx(0.5 * (1 - np.cos(1)), rel=1e-5)


def test_starts_are_tested_within_the_rounding_of_floats(tmp_path):
    model, initial, parameters = example(HARD[0])
    given = {"initial": initial, "parameters": parameters, "method": "rk4", "step": 0.01, "precision": "single"}
    path = model.export(tmp_path / "export", **given)
    (source,) = (item.name for item in path.glob("*.c") if item.name != "main.c")
    program = built(path, ["main.c", source])
    assert output(program, 1, 2, 0.6, -0.8, 0.4, 0.3, 9.81, 1).count("\n") == 3
    assert "status 5" in output(program, 1, 2, 0.6001, -0.8, 0.4, 0.3, 9.81, 1, status=1)
    assert "status 5" in output(program, 1, 2, 0.6, -0.8, 0.401, 0.3, 9.81, 1, status=1)


def test_texts_in_single_precision():
    text = 'double f(double x) { return sin(x) * 1.5e-3 + x_exp[10] - 2.0; } /* double 1.0 */ "sin(1.0)"'
    expected = 'float f(float x) { return sinf(x) * 0.0015f + x_exp[10] - 2.0f; } /* double 1.0 */ "sin(1.0)"'
    assert in_single(text) == expected
    assert (single(0.0), float(single(1e-300)[:-1])) == ("0.0f", np.finfo(np.float32).smallest_normal)
    with pytest.raises(CapabilityError, match=r"1e\+39, is beyond the range of float"):
        in_single("x = 1e39;")


def test_pivots_are_set_aside_within_the_rounding_of_floats():
    """As in the rates of loops: a pivot is compared with the rounding of its terms, and replaced by a float."""
    text = "kernel k(t, y, c)\n  a = y[0]\n  b = c[0]\n  w = b < a\n  d = select(w, a, 1e+300)\n  out[0] = d"
    adapted = kernel_in_single(Kernel.parse(text))
    for pivot, found in ((2.0**-28, 2.0**-28), (2.0**-30, 1e30)):
        assert interpret(adapted, {"t": 0.0, "y": [pivot], "c": [2.0**-58]}) == [found]


def test_what_has_no_single_precision(tmp_path):
    model, *_ = example("sleigh")
    place = tmp_path / "a"
    for method in ("auto", "dop853"):
        with pytest.raises(OptionError, match="which the rounding of float"):
            model.export(place, method=method, precision="single")
    with pytest.raises(OptionError, match="precisions 'double', 'single'"):
        model.export(place, method="rk4", step=0.1, precision="half")
    assert list(tmp_path.iterdir()) == []
