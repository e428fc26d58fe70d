"""Files of Python for numba and JAX: alone in a process without dalembert, their runs are those of `simulate`."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import CapabilityError, OptionError
from dalembert.methods.status import Status
from hard_cases import hard_case
from hard_cases.contacts import contact_motion

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
NUMBERS = {"m": 1, "b": 0.3, "I_C": 0.5}
TIMES = [0.0, 1.5, 4.0]
PINNED = "pendulum, Cartesian (IFToMM A01)"

NUMBA = """
run = made.simulate({times})
runs = made.sweep({times}, parameters={{"{name}": np.array([{value}, {value}, -1.0])}}, threads=2)
found = {{"run": run, "runs": runs, "texts": made.STATUSES[int(runs["status"][2])]}}
"""
JAX = """
import jax
def everything(times, several):
    def end(b, steps=None):
        return made.simulate(times, parameters={{"b": b}}, steps=steps)["x"][-1]
    b = several[1]
    return {{
        "run": made.simulate(times),
        "runs": {{"x": jax.vmap(end)(several)}},
        "slopes": {{"forward": jax.jacfwd(end)(b), "reverse": jax.grad(lambda b: end(b, 60))(b)}},
    }}
found = jax.jit(everything)(np.array({times}), np.array([0.2, 0.3]))
"""
CORRECTED = """
corrected = made.simulate(np.array({times}))
apart = made.simulate(np.array({times}), {{"x": 2.0}})["status"]
made.project_position = lambda t, y, c: 1e-4 * made.jnp.ones_like(y)
found = {{"run": corrected, "apart": apart, "others": made.simulate(np.array({times}))["status"]}}
"""
PROCESS = """
import importlib.util, json, sys
import numpy as np
sys.path[:] = [place for place in sys.path if "src" not in place]
sys.modules["dalembert"] = None
results = []
for path, code in json.load(sys.stdin):
    spec = importlib.util.spec_from_file_location("made", path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    names = {"np": np, "made": made}
    exec(code, names)
    results.append(names["found"])
print(json.dumps(results, default=lambda value: np.asarray(value).tolist()))
"""


@pytest.fixture(scope="module")
def sleigh():
    return da.compile_model(da.scenes.chaplygin_sleigh(), outputs=["Y"])


def quickly():
    """Return an environment in which JAX and Numba compile quickly, to code that is slower."""
    try:
        from jax_backend.jax_options import QUICK
    except pytest.skip.Exception:  # there is no JAX
        QUICK = {}
    flags = " ".join(f"--{name}={str(value).lower()}" for name, value in QUICK.items())
    return {**os.environ, "NUMBA_OPT": "0", "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {flags}"}


def found_by(path, code, **names):
    """Run code with a file in a process that cannot import dalembert; return what it finds."""
    return found_by_each((path, code.format(**names)))[0]


def found_by_each(*runs):
    """Return what code finds with a file, each in turn in one such process."""
    given = json.dumps([(str(path), code) for path, code in runs])
    done = subprocess.run([sys.executable, "-c", PROCESS], input=given, capture_output=True, text=True, env=quickly())
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("name", "formulation", "method"),
    [
        ("sleigh through theta = pi/2", "minimal", "taylor"),
        *(pytest.param(PINNED, "projected", method, marks=pytest.mark.matrix) for method in ("taylor", "dop853")),
    ],
)
def test_runs_of_a_file_for_numba_are_those_of_simulate(tmp_path, name, formulation, method):
    """Also of a state that is projected after each step."""
    case = hard_case(name)
    model = case.compile(formulation, backend="numba")
    options = {"rtol": 1e-6, "atol": 1e-8, "method": method}
    path = model.export(tmp_path / "pendulum.py", "numba", initial=case.initial, parameters=case.parameters, **options)
    name, value = next((str(name), value) for name, value in case.parameters.items() if str(name) == "m")
    found = found_by(path, NUMBA, times=TIMES, name=name, value=value)
    run = model.simulate((0, 4), case.initial, case.parameters, t_eval=TIMES, **options)
    for variable in model.layout.variables:
        np.testing.assert_allclose(found["run"][variable], run[variable], rtol=1e-12, atol=1e-13, err_msg=variable)
        assert found["runs"][variable][:2] == [found["run"][variable]] * 2
    assert found["runs"]["status"][:2] == [0, 0] and found["runs"]["status"][2] != 0
    assert "contradicts what its symbol was declared to be" in found["texts"]


def cart(force):
    """Return the model of a cart that an input pushes against a force."""
    z, u, N, O = *dynamicsymbols("z u"), ReferenceFrame("N"), Point("O")
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[z])
    scene.add_bodies(Particle("cart", O.locatenew("P", z * N.x), symbols("m", positive=True)))
    scene.add_inputs(u)
    scene.add_loads((scene.bodies[0].masscenter, (u - force(z)) * N.x))
    return da.compile_model(scene, outputs=["z_ddot"])


def smooth(z):
    return z + z**3 / 9


def tabulated(z):
    return da.table(z, [-9, -1, 1, 9], [-9, -1, 2, 12], kind="cubic")


@pytest.mark.matrix
@pytest.mark.parametrize(
    ("kind", "method", "force"),
    [
        ("numba", "dop853", smooth),
        ("numba", "taylor", tabulated),
        ("jax", "auto", smooth),
    ],
)
def test_inputs_tables_and_time_that_runs_back(tmp_path, kind, method, force):
    pytest.importorskip(kind)
    model, options = cart(force), {"rtol": 1e-9, "atol": 1e-11}
    start, numbers = {"z": 0.5, "z_dot": 1.0}, {"m": 2.0}
    given = {"initial": start, "parameters": numbers, "inputs": {"u": 0.3}}
    path = model.export(tmp_path / "cart.py", kind, method=method, **given, **options)
    code = """
found = {{"forth": made.simulate(np.array({times})), "back": made.simulate(-np.array({times}), inputs={{"u": -0.2}})}}
"""
    found = found_by(path, code, times=TIMES)
    for way, sign, u in (("forth", 1, 0.3), ("back", -1, -0.2)):
        times = [sign * t for t in TIMES]
        run = model.simulate((0, times[-1]), start, numbers, t_eval=times, inputs={"u": u}, rtol=1e-12, atol=1e-14)
        for variable in (*model.layout.variables, "z_ddot"):
            np.testing.assert_allclose(found[way][variable], run[variable], rtol=1e-7, atol=1e-7, err_msg=variable)
        assert not np.any(found[way].get("status", 0))


@pytest.fixture(scope="module")
def of_jax(tmp_path_factory, sleigh):
    """Return what files for JAX find, of the sleigh and of the pinned pendulum, in one process, which imports JAX."""
    pytest.importorskip("jax")
    folder, case = tmp_path_factory.mktemp("jax"), hard_case(PINNED)
    tight = {"rtol": 1e-10, "atol": 1e-12}
    path = sleigh.export(folder / "sleigh.py", "jax", initial=START, parameters=NUMBERS, **tight)
    given = {"initial": case.initial, "parameters": case.parameters, "rtol": 1e-9, "atol": 1e-11}
    pinned = case.compile("projected").export(folder / "pinned.py", "jax", **given)
    return found_by_each((path, JAX.format(times=TIMES)), (pinned, CORRECTED.format(times=TIMES)))


def test_runs_of_a_file_for_jax_are_those_of_simulate(of_jax, sleigh):
    found = of_jax[0]

    def end(b):
        return sleigh.simulate((0, 4), START, {**NUMBERS, "b": b}, t_eval=TIMES, rtol=1e-13, atol=1e-15)

    run = end(0.3)
    for name in ("x", "theta_dot", "Y"):
        np.testing.assert_allclose(found["run"][name], run[name], rtol=1e-9, atol=1e-9, err_msg=name)
    energy = np.add(found["run"]["kinetic"], found["run"]["potential"])
    np.testing.assert_allclose(energy, run["energy"], rtol=1e-9)
    np.testing.assert_allclose(found["runs"]["x"], [end(0.2)["x"][-1], run["x"][-1]], rtol=1e-9)
    slope = (end(0.3 + 1e-5)["x"][-1] - end(0.3 - 1e-5)["x"][-1]) / 2e-5
    np.testing.assert_allclose(list(found["slopes"].values()), slope, rtol=1e-7)
    assert found["run"]["status"] == 0


def test_positions_are_corrected_in_a_file_for_jax_until_nothing_is_left(of_jax):
    case, found = hard_case(PINNED), of_jax[1]
    model = case.compile("projected")
    run = model.simulate((0, 4), case.initial, case.parameters, t_eval=TIMES, rtol=1e-12, atol=1e-14)
    assert found["run"]["status"] == 0
    for variable in model.layout.variables:
        np.testing.assert_allclose(found["run"][variable], run[variable], rtol=1e-7, atol=1e-7, err_msg=variable)
    assert (found["apart"], found["others"]) == (Status.INITIAL_STATE, Status.STEP_TOO_SMALL)


def test_what_files_do_not_carry(tmp_path, sleigh):
    case = contact_motion("bouncing ball").motion
    model = case.compile("auto")
    for kind in ("numba", "jax"):
        with pytest.raises(CapabilityError, match=r"does not carry contacts that change .*model\.mode"):
            model.export(tmp_path / "a.py", kind)
    for method in ("radau", "taylor"):
        with pytest.raises(OptionError, match='give method="dop853"'):
            sleigh.export(tmp_path / "a.py", "jax", method=method)
    with pytest.raises(OptionError, match=r'not "radau": give method="dop853"'):
        sleigh.export(tmp_path / "a.py", "numba", method="radau")
    for kind, message in (("numba", 'Taylor steps alone, .*give method="taylor"'), ("jax", "does not carry tables")):
        with pytest.raises(CapabilityError, match=message):
            cart(tabulated).export(tmp_path / "a.py", kind, method="dop853")
    with pytest.raises(OptionError, match=r"ends in '\.py'"):
        sleigh.export(tmp_path / "a", "numba")
    assert list(tmp_path.iterdir()) == []


def test_only_files_of_exports_are_replaced(tmp_path, sleigh):
    path = sleigh.export(tmp_path / "a.py", "numba")
    assert sleigh.export(path, "jax", method="dop853") == path and "import jax" in path.read_text()
    path.write_text("thesis = 1\n")
    with pytest.raises(OptionError, match="was not written by an export"):
        sleigh.export(path, "numba")
