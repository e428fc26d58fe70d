"""Results that are promised equal to the bit, and those that agree to rounding (the table in docs/accuracy.md)."""

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.cache import directory
from dalembert.codegen.llvm.loops import loop_named

START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1.0, "b": 0.3, "I_C": 0.5}
LENGTHS = np.linspace(0.2, 0.4, 37)
SPAN, RTOL = (0.0, 5.0), 1e-9
COMPILED = [
    ("llvm", "minimal", "taylor"),
    ("llvm", "minimal", "dop853"),
    ("llvm", "projected", "taylor"),
    ("llvm", "projected", "tsit5"),
    ("llvm", "projected", "radau"),
]
PLAIN = [("numpy", "minimal", "dop853"), ("numpy", "projected", "radau")]


def compiled(backend, formulation):
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend, formulation=formulation)


def swept(model, method, lengths, **options):
    parameters = {**PARAMETERS, "b": lengths}
    return model.sweep(SPAN, START, parameters, method=method, rtol=RTOL, **options).y


@pytest.mark.parametrize(("backend", "formulation", "method"), COMPILED + PLAIN)
def test_a_case_has_its_bits_whatever_stands_beside_it(backend, formulation, method):
    model = compiled(backend, formulation)
    together = swept(model, method, LENGTHS)
    order = np.random.default_rng(0).permutation(len(LENGTHS))
    assert np.array_equal(swept(model, method, LENGTHS[order]), together[order])
    assert np.array_equal(swept(model, method, LENGTHS[11:12])[0], together[11])
    assert np.array_equal(swept(model, method, LENGTHS, threads=1), together)


@pytest.mark.parametrize(("backend", "formulation", "method"), COMPILED + PLAIN)
def test_prepared_runs_have_the_bits_of_sweeps_and_single_runs_agree_to_rounding(backend, formulation, method):
    model = compiled(backend, formulation)
    case = swept(model, method, LENGTHS[:3])[1]
    parameters = {**PARAMETERS, "b": LENGTHS[1]}
    run = model.prepare(SPAN, method=method, rtol=RTOL)
    assert np.array_equal(run(model.state(START, parameters), model.parameter_vector(parameters)), case)
    single = model.simulate(SPAN, START, parameters, method=method, rtol=RTOL)
    if backend == "numpy" or method == "radau":
        assert np.array_equal(single.y[-1], case)
    np.testing.assert_allclose(single.y[-1], case, rtol=0.0, atol=1e-11)


PROCESS = """
import hashlib, json
import numpy as np
import dalembert as da

model = da.compile_model(da.scenes.chaplygin_sleigh())
start = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
run = model.simulate((0, 5), start, {"m": 1.0, "b": 0.3, "I_C": 0.5})
lengths = np.linspace(0.2, 0.4, 5)
sweep = model.sweep((0, 5), start, {"m": 1.0, "b": lengths, "I_C": 0.5})
parts = (model.source.encode(), run.y.tobytes(), sweep.y.tobytes())
print(json.dumps([hashlib.sha256(part).hexdigest() for part in parts]))
"""


def test_processes_agree_on_texts_and_results_to_the_bit(tmp_path):
    """This one has compiled other models before, and may use what others have compiled; the other compiles its own.

    Both have the loops that were compiled once for all models (`test_loops.py` compiles some in a process of its own).
    """
    assert loop_named("lane_loop").call and loop_named("taylor_loop").call
    for loops in directory().glob("loops_*"):
        shutil.copytree(loops, tmp_path / loops.name)
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    environment = {**os.environ, "PYTHONHASHSEED": seed, "DALEMBERT_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", PROCESS], env=environment, capture_output=True, check=True)
    own = io.StringIO()
    with contextlib.redirect_stdout(own):
        exec(PROCESS, {})
    assert json.loads(done.stdout) == json.loads(own.getvalue())
