"""Loops as machine code: kept, checked when read, called without numba, and the same as in sweeps to the last bit."""

import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE
from dalembert.codegen.llvm.loops import loop_named
from dalembert.errors import CacheWarning
from dalembert.methods.status import Status

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1, "b": 0.3, "I_C": 0.5}

RUN = """
import sys
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected")
run = model.prepare((0, 1), method=sys.argv[1])
p = {"m": 1, "b": 0.3, "I_C": 0.5}
y = model.state({"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}, p)
end = run(y, model.parameter_vector(p)).tolist()
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
end += model.simulate((0, 1), start, p, method=sys.argv[1]).y[-1].tolist()
print("numba" in sys.modules, *end)
"""


SWEEP = """
import sys
import dalembert as da
formulation = "minimal" if sys.argv[1] == "minimal" else "projected"
model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation=formulation)
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
more = {"events": ["theta_dot"], "reduce": {"far": da.maximum("x")}} if sys.argv[1] == "watched" else {}
more = {"t_eval": [0.3, 1.0]} if sys.argv[1] == "sampled" else more
sweep = model.sweep((0, 1), start, {"m": 1, "b": [0.2, 0.3, 0.4], "I_C": 0.5}, **more)
print("numba" in sys.modules, *sweep["x"].ravel().tolist())
"""


def run_in_a_process(folder, method, program=RUN):
    environment = {**os.environ, ENVIRONMENT_VARIABLE: str(folder)}
    code = [sys.executable, "-W", "error::dalembert.errors.CacheWarning", "-c", program, method]
    return subprocess.run(code, capture_output=True, text=True, check=True, env=environment).stdout.split()


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_runs_do_without_numba(tmp_path, method):
    first = run_in_a_process(tmp_path, method)
    second = run_in_a_process(tmp_path, method)
    assert first[0] == second[0] == "False"
    assert first[1:] == second[1:]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.mark.parametrize(
    "what", ["plain", "sampled", "watched"]
)  # each makes a loop that those before it have not made
def test_sweeps_do_without_numba(folder, what):
    first, second = (run_in_a_process(folder, what, SWEEP) for _ in range(2))
    assert first[0] == second[0] == "False"
    assert first[1:] == second[1:]


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_prepared_run_is_the_case_of_a_sweep(formulation, method):
    model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation=formulation)
    lengths = np.linspace(0.1, 0.5, 7)
    options = {"method": method, "rtol": 1e-9, "atol": 1e-9}
    run, sweep = (
        model.prepare((0, 10), **options),
        model.sweep((0, 10), START, {**PARAMETERS, "b": lengths}, **options),
    )
    for i, b in enumerate(lengths):
        p = {**PARAMETERS, "b": b}
        np.testing.assert_array_equal(run(model.state(START, p), model.parameter_vector(p)), sweep.y[i])
        assert run.status is Status.SUCCESS


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_prepared_run_backwards_returns(method):
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    start, p = model.state(START, PARAMETERS), model.parameter_vector(PARAMETERS)
    options = {"method": method, "rtol": 1e-12, "atol": 1e-12}
    there, back = model.prepare((0, 2), **options), model.prepare((2, 0), **options)
    np.testing.assert_allclose(back(there(start, p), p), start, atol=1e-10)


def test_damaged_code_is_rebuilt_with_a_warning(tmp_path, monkeypatch):
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(tmp_path))
    loop_named.cache_clear()
    assert loop_named("prepared_loop").call is not None
    (path,) = tmp_path.rglob("prepared_loop_*.o")
    path.write_bytes(path.read_bytes()[:-1])
    loop_named.cache_clear()
    with pytest.warns(CacheWarning, match="damaged and is rebuilt"):
        assert loop_named("prepared_loop").call is not None
    loop_named.cache_clear()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert loop_named("prepared_loop").call is not None
    loop_named.cache_clear()
