"""The instruction set and the lanes that code is compiled for."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.llvm.target import ENVIRONMENT_VARIABLE, available_targets, target
from dalembert.errors import OptionError

SCRIPT = """
import warnings
import numpy as np
import dalembert as da
from dalembert.codegen.llvm.assembly import instructions
from dalembert.codegen.llvm.target import native_lanes
from dalembert.codegen.llvm.target import target
warnings.simplefilter("error")
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
model = da.compile_model(da.scenes.chaplygin_sleigh())
sweep = model.sweep((0, 1), start, {"m": 1.0, "b": np.linspace(0.1, 0.5, 11), "I_C": 0.5}, rtol=1e-10, threads=1)
run = model.simulate((0, 1), start, {"m": 1.0, "b": 0.1, "I_C": 0.5}, rtol=1e-10, method="dop853")
M = model.mass_matrix(np.zeros(3), {"m": 1.0, "b": 0.1, "I_C": 0.5})
print(target().name, native_lanes(), *sweep["x"], run["x"][-1], *M.ravel())
"""
LANES = {"x86-64-v2": 2, "x86-64-v3": 4, "x86-64-v4": 8}


def outcome(name, folder, script=SCRIPT):
    environment = os.environ | {ENVIRONMENT_VARIABLE: name, "DALEMBERT_CACHE_DIR": str(folder)}
    return subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=200)


def test_targets_give_the_same_motions_with_lanes_of_their_own(tmp_path):
    """They share a cache, in which each has code of its own; ``make test-targets`` compares them all."""
    found, files = {}, set()
    for name in dict.fromkeys((next(iter(available_targets())), "native")):
        run = outcome(name, tmp_path / "cache")
        assert run.returncode == 0, run.stderr
        chosen, lanes, *values = run.stdout.split()
        assert chosen == name and int(lanes) == LANES.get(name, available_targets()["native"].lanes)
        found[name] = np.array([float(value) for value in values])
        kept = set((tmp_path / "cache").rglob("*.o"))
        assert kept - files, f"{name} added no code to the cache"
        files = kept
    for values in found.values():
        np.testing.assert_allclose(values, found["native"], rtol=0, atol=1e-8)


LACKING = "x86-64-v4 of a processor without AVX-512"
REFUSED = f"""
import os, sys
import llvmlite.binding as llvm
import numpy as np
import dalembert as da
import dalembert.codegen.llvm.backend, dalembert.codegen.llvm.target, dalembert.compiler
has = dict(llvm.get_host_cpu_features()) | {{"avx512f": False}}
class Features(dict):
    def flatten(self):
        return ""
for name in sys.argv[1:]:
    if os.fork():
        assert os.wait()[1] == 0
        continue
    os.environ[{ENVIRONMENT_VARIABLE!r}] = name.split()[0]
    if " " in name:
        llvm.get_host_cpu_features = lambda: Features(has)
    try:
        exec({SCRIPT!r})
    except da.errors.OptionError as error:
        print(name, error, sep=": ", flush=True)
    os._exit(0)
"""


@pytest.fixture(scope="module")
def refused(tmp_path_factory):
    """Return the messages of forks of a process with targets that are none, by target, and the cache of them all."""
    folder, environment = tmp_path_factory.mktemp("refused"), {**os.environ}
    environment.pop(ENVIRONMENT_VARIABLE, None)
    command = [sys.executable, "-c", REFUSED, "x86-64-v9", "AVX2", LACKING]
    environment["DALEMBERT_CACHE_DIR"] = str(folder)
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200)
    assert run.returncode == 0, run.stderr
    return dict(line.split(": ", 1) for line in run.stdout.splitlines()), folder


@pytest.mark.parametrize("name", ["x86-64-v9", "AVX2"])
def test_unknown_targets_are_refused_with_those_that_there_are(refused, name):
    messages, folder = refused
    assert name in messages[name] and all(known in messages[name] for known in available_targets())
    assert not list(folder.rglob("*.o"))


def test_targets_that_the_processor_lacks_are_refused(refused):
    assert re.search("lacks: take one of (x86-64-v2|native)", refused[0][LACKING])


def test_a_process_keeps_its_target(monkeypatch):
    chosen = target().name
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "x86-64-v2" if chosen != "x86-64-v2" else "native")
    with pytest.raises(OptionError, match="start a new process"):
        target()
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "" if chosen == "native" else chosen)
    assert target().name == chosen


def test_numba_compiles_for_the_target(tmp_path):
    """The least one has no instruction for a product and a sum."""
    script = """
import dalembert as da
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numba")
run = model.simulate((0, 1), start, {"m": 1.0, "b": 0.1, "I_C": 0.5}, rtol=1e-6)
import numba
codegen = numba.core.registry.cpu_target.target_context.codegen()
print(codegen.magic_tuple()[1], "builder.fma" in model.source, run["x"][-1])
"""
    name = next(iter(available_targets()))
    run = outcome(name, tmp_path / "cache", script)
    assert run.returncode == 0, run.stderr
    processor, fused, x = run.stdout.split()
    assert (processor, fused) == (available_targets()[name].cpu, str(available_targets()[name].fused))
    model = da.compile_model(da.scenes.chaplygin_sleigh(), cache=False)
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    own = model.simulate((0, 1), start, {"m": 1.0, "b": 0.1, "I_C": 0.5}, rtol=1e-6)["x"][-1]
    np.testing.assert_allclose(float(x), own, rtol=1e-10)
    assert list((tmp_path / "cache").rglob("*.nbo"))
