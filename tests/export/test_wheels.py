"""Packages: pip installs them, NumPy is their only need, and their runs are those of `simulate`."""

import json
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from codegen.c_programs import compiler
from dalembert.errors import MissingExtraError
from dalembert.export import wheel
from export.test_events import pendulum
from hard_cases.contacts import contact_motion

RUN = """
import json, sys
sys.path.insert(0, sys.argv[1])
import {0} as made
run = made.simulate({1})
loaded = [name for name in ("dalembert", "sympy", "numba", "llvmlite", "scipy") if name in sys.modules]
events = run.pop("events", {{}})
print(json.dumps({{"run": {{name: list(values) for name, values in run.items()}}, "events": events, "loaded": loaded}}))
"""


def unpacked(folder, model, **options):
    """Export a package, unpack it into a folder, as pip does, and return the folder."""
    target, made = folder / "installed", exported(folder, model, **options)
    with zipfile.ZipFile(made) as archive:
        archive.extractall(target)
    return target


def exported(folder, model, **options):
    """Export a package, and return the path of the wheel."""
    compiler()
    (made,) = model.export(folder / "export", "wheel", **options).glob("*.whl")
    return made


def installed(folder, model, **options):
    """Export a package, install it into a folder without a network, and return the folder."""
    target, made = folder / "installed", exported(folder, model, **options)
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--target", target, made]
    done = subprocess.run(command, capture_output=True, text=True)
    if "No module named pip" in done.stderr:
        pytest.skip("no pip")
    assert done.returncode == 0, done.stderr
    return target


def called(target, name, arguments, status=0):
    """Call `simulate` of a package in a process of its own; where it fails, return what that says."""
    command = [sys.executable, "-I", "-c", RUN.format(name, arguments), target]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done.stderr if status else json.loads(done.stdout)


def cart():
    x, push, N, O = *dynamicsymbols("x push"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("class", frame=N, origin=O, coordinates=[x])  # a keyword of Python
    scene.add_bodies(Particle("cart", O.locatenew("P", x * N.x), symbols("m", positive=True)))
    scene.add_inputs(push)
    scene.add_loads((scene.bodies[0].masscenter, push * N.x))
    return scene


def test_a_package_is_installed_and_runs_as_simulate(tmp_path):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["Y"])
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    numbers = {"m": 1, "b": 0.3, "I_C": 0.5}
    target = installed(tmp_path, model, initial=start, parameters=numbers, rtol=1e-10, atol=1e-12)
    found = called(target, "chaplygin_sleigh", "[0, 1.5, 4], {'theta': 0.5}, {'b': 0.2}")
    run = model.simulate(
        (0, 4), {**start, "theta": 0.5}, {**numbers, "b": 0.2}, t_eval=[0, 1.5, 4], rtol=1e-10, atol=1e-12
    )
    assert found["loaded"] == []
    for name in ("t", "x", "y", "theta_dot", "Y"):
        expected = run.t if name == "t" else run[name]
        np.testing.assert_allclose(found["run"][name], expected, rtol=1e-11, atol=1e-11, err_msg=name)
    energy = np.add(found["run"]["kinetic"], found["run"]["potential"])
    np.testing.assert_allclose(energy, run["energy"], rtol=1e-12)
    said = called(target, "chaplygin_sleigh", "[0, 1], {'y': 0.5, 'z': 1}", status=1)
    assert "ValueError: unknown initial values: z; known: x, y, theta" in said
    said = called(target, "chaplygin_sleigh", "[0, 1], None, {'m': -1}", status=1)
    assert "RuntimeError: A parameter or an initial value contradicts" in said


def test_inputs_and_names_that_python_has(tmp_path):
    model = da.compile_model(cart())
    target = installed(tmp_path, model)
    (name,) = (path.name for path in target.iterdir() if (path / "__init__.py").exists())
    assert name.isidentifier() and name != "class"
    found = called(target, name, "[2.0], {'x': 1, 'x_dot': 0}, {'m': 2}, {'push': 3}, begin=0")["run"]
    assert found["x"] == [pytest.approx(4.0, rel=1e-14)]
    assert "missing initial values: x, x_dot" in called(target, name, "[2.0]", status=1)


def test_packages_need_a_compiler(tmp_path, monkeypatch):
    monkeypatch.setattr(wheel, "c_compiler", lambda: None)
    with pytest.raises(MissingExtraError, match=r"no C compiler.*pip install"):
        da.compile_model(cart()).export(tmp_path / "a", "wheel")


def test_contacts_that_change(tmp_path):
    case = contact_motion("bouncing ball").motion
    model = case.compile("auto")
    target = unpacked(tmp_path, model, initial=case.initial, parameters=case.parameters)
    times = [0.0, 0.5, 1.0, 2.0]
    found = called(target, "bouncing_ball", times)["run"]
    run = model.simulate((0, 2), case.initial, case.parameters, t_eval=times)
    for name in model.layout.variables:
        np.testing.assert_allclose(found[name], run[name], rtol=1e-11, atol=1e-11, err_msg=name)


def test_events_are_counted_and_end_runs(tmp_path):
    model, start, numbers, (lowest, stop) = pendulum()
    lowest = da.Event(lowest.expression, direction=1, terminal=2, name="lowest")
    given = {"events": [lowest, stop], "rtol": 1e-10, "atol": 1e-12}
    target, times = unpacked(tmp_path, model, initial=start, parameters=numbers, **given), np.linspace(0, 8, 81)
    said = called(target, "pendulum", times.tolist())
    found, events = said["run"], said["events"]
    run = model.simulate((0, 8), start, numbers, **given)
    reached = times[times <= run.t[-1]]
    assert found["t"] == reached.tolist() and len(reached) < 81
    np.testing.assert_allclose(found["theta"], run(reached)["theta"], rtol=1e-10, atol=1e-10)
    for name, event in events.items():
        assert event == {"count": len(run.events[name].t), "last": pytest.approx(run.events[name].t[-1], rel=1e-12)}
