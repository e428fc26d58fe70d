"""Children that use a cache: forked from a process that has imported everything, so that one costs little."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import time
import traceback
import warnings
from pathlib import Path

import numpy as np

import dalembert as da
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE
from dalembert.codegen.lane_runs import _advance_code as advance_code
from dalembert.codegen.lane_runs import _check_code as check_code
from dalembert.codegen.llvm.backend import LLVMBackend
from dalembert.codegen.llvm.loops import loop_named
from dalembert.model.model import CompiledModel
from dalembert.pipeline import Compiled

__all__ = ["SCENES", "Outcome", "begun", "ended", "prepared_models"]

SCENES = {
    "chaplygin_sleigh": (
        {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0},
        {"m": 1.0, "b": 0.3, "I_C": 0.5},
    ),
    "rolling_sphere": (
        {"x": 0.0, "y": 0.0, "psi": 0.1, "theta": 1.2, "phi": 0.3, "psi_dot": 0.5, "theta_dot": 0.7, "phi_dot": 0.9},
        {"m": 1.0, "r": 0.5, "g": 9.81},
    ),
}
Outcome = tuple[str, str]
"""What became of a child ("right", "wrong", "error", "signal N"), and what it said."""


def prepared_models() -> dict[str, CompiledModel]:
    """Return the models of the scenes, derived once; what is compiled of them is compiled by the children."""
    return {name: da.compile_model(da.scenes.ALL[name](), cache=False) for name in SCENES}


def _everything(model: CompiledModel, cache: bool) -> bytes:
    """Do with a model, loaded anew, what uses files of every kind; return what came out."""
    for kept in (loop_named, advance_code, check_code):
        kept.cache_clear()
    backend, stages = LLVMBackend(), model.stages
    rendered = backend.render(stages.program)
    engine = backend.load(rendered, cache=cache)
    fresh = CompiledModel.of(Compiled(stages, engine, backend.serving(stages.program)))
    start, p = SCENES[fresh.name]
    run = fresh.simulate((0, 1), start, p)
    name = next(iter(p))
    sweep = fresh.sweep((0, 1), start, p | {name: np.linspace(0.9, 1.1, 5)}, threads=1)
    m = fresh.mass_matrix(run.q[-1], p)
    assert run.success and np.all(sweep.success)
    return run.q[-1].tobytes() + sweep.y.tobytes() + m.tobytes()


def expected_of(model: CompiledModel) -> bytes:
    """Return what comes out without a cache."""
    return _everything(model, cache=False)


def begun(model: CompiledModel, folder: Path, expected: bytes | None) -> tuple[int, int]:
    """Fork a child that uses a cache; return its number, and the end of a pipe from which `ended` reads."""
    reading, writing = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child:
        os.close(writing)
        return child, reading
    said, code = "", 2
    faulthandler.register(signal.SIGUSR1, file=writing, all_threads=True)
    try:
        os.environ[ENVIRONMENT_VARIABLE] = str(folder)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = _everything(model, cache=True)
        kinds = {warning.category.__name__ for warning in caught}
        said = " ".join(sorted(kinds))
        code = 0 if expected is None or found == expected else 1
    except BaseException:
        said = traceback.format_exc()
    finally:
        os.write(writing, said[-3000:].encode())
        os._exit(code)


def _activity(child: int, reading: int) -> str:
    """Return what a child does: its state and seconds of processor time twice, a second apart, and its Python stack."""

    def state() -> str:
        fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
        return f"{fields[0]} {(int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK'):.2f} s"

    before = state()
    os.kill(child, signal.SIGUSR1)
    time.sleep(1.0)
    return f"{before}, then {state()}; {os.read(reading, 4000).decode()}"


def ended(child: int, reading: int, limit: float = 120.0) -> Outcome:
    """Wait for a child and return what became of it; one that takes too long is killed."""
    until = time.monotonic() + limit
    while True:
        number, status = os.waitpid(child, os.WNOHANG)
        if number:
            break
        if time.monotonic() > until:
            said = _activity(child, reading)
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os.close(reading)
            return "does not end", said
        time.sleep(0.002)
    with os.fdopen(reading, "rb") as file:
        said = file.read().decode()
    if os.WIFSIGNALED(status):
        return f"signal {os.WTERMSIG(status)}", said
    return {0: "right", 1: "wrong"}.get(os.WEXITSTATUS(status), "error"), said
