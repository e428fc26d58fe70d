"""Start-up: from a new process to the first trajectory, with empty caches and with what that left behind."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

__all__ = ["first_and_second", "first_trajectory", "import_seconds", "with_bytecode"]

Record = dict[str, Any]

_BYTECODE = """
import sys
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), backend=sys.argv[1])
initial = {"x": 0, "y": 0, "theta": 0.2, "theta_dot": 2.0, "x_dot": 0.98}
for what, b in ((model.sweep, [0.2, 0.3, 0.4]), (model.simulate, 0.3)):
    what((0, 1), initial, {"m": 1, "b": b, "I_C": 0.5})
"""

_CHILD = """
import json, sys, time
begin = time.perf_counter()
import dalembert as da
imported = time.perf_counter()
scene = da.scenes.chaplygin_sleigh()
built = time.perf_counter()
model = da.compile_model(scene, backend=sys.argv[1])
compiled = time.perf_counter()
initial = {"x": 0, "y": 0, "theta": 0.2, "theta_dot": 2.0, "x_dot": 0.98}
what, b = (model.sweep, [0.2, 0.3, 0.4]) if sys.argv[2] == "sweep" else (model.simulate, 0.3)
what((0, 10), initial, {"m": 1, "b": b, "I_C": 0.5})
simulated = time.perf_counter()
what((0, 10), initial, {"m": 1, "b": b, "I_C": 0.5})
again = time.perf_counter()
print(json.dumps({
    "import": imported - begin, "scene": built - imported, "compile_model": compiled - built,
    "first call": simulated - compiled, "second call": again - simulated, "stages": model.stages.seconds,
}))
"""


def _child(code: str, *arguments: str, **environment: str) -> tuple[float, str]:
    """Run Python in a new process, which may keep bytecode; return its seconds, and what it printed."""
    held = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**held, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - begin
    if done.returncode:
        raise RuntimeError(f"a process of the start-up benchmark failed:\n{done.stderr}")
    return seconds, done.stdout


def first_trajectory(backend: str, repetitions: int = 1, what: str = "simulate") -> dict[str, Record]:
    """Return the seconds of the sleigh's first trajectory, or first sweep, in a first and in a second process.

    Both caches (dalembert's, with the loops of the library, and numba's) are empty folders before the first process
    of each repetition. Python's bytecode is there, as an installer leaves it. Medians over the repetitions.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = with_bytecode(backend, folder)
        pairs = [first_and_second(backend, what, f"{folder}/{i}", environment) for i in range(repetitions)]
    return {name: _medians([pair[name] for pair in pairs]) for name in pairs[0]}


def with_bytecode(backend: str, folder: str, environment: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
    """Write Python's bytecode of all that a start needs below `folder`; return the environment that uses it."""
    found = {**environment, "PYTHONPYCACHEPREFIX": f"{folder}/bytecode"}
    _child(
        _BYTECODE, backend, **{**found, "DALEMBERT_CACHE_DIR": f"{folder}/none", "NUMBA_CACHE_DIR": f"{folder}/none"}
    )
    return found


def first_and_second(backend: str, what: str, folder: str, environment: Mapping[str, str]) -> dict[str, Record]:
    """Return seconds by stage of a process with empty caches, and of one that finds what the first left in `folder`."""
    own = {**environment, "DALEMBERT_CACHE_DIR": f"{folder}/modules", "NUMBA_CACHE_DIR": f"{folder}/numba"}
    found = {}
    for name in ("first process", "second process"):
        wall, text = _child(_CHILD, backend, what, **own)
        found[name] = {**json.loads(text), "process": wall}
    return found


def _medians(samples: Sequence[Record]) -> Record:
    medians: Record = {}
    for name, value in samples[0].items():
        values = [sample[name] for sample in samples]
        medians[name] = _medians(values) if isinstance(value, dict) else round(statistics.median(values), 5)
    return medians


def import_seconds(repetitions: int = 5) -> dict[str, float]:
    """Return the median seconds of ``import dalembert`` in a new process, and of its larger dependencies alone."""
    code = "import sys, time; b = time.perf_counter(); __import__(sys.argv[1]); print(time.perf_counter() - b)"
    names = ("dalembert", "sympy.physics.mechanics", "llvmlite.binding", "numba", "numpy")
    samples: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(repetitions):
        for name in names:
            samples[name].append(float(_child(code, name)[1]))
    return {name: round(statistics.median(values), 4) for name, values in samples.items()}
