"""Ctrl-C reaches runs in compiled code, and what they return to Python for it changes no bit."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.llvm import prepared, sweeps
from dalembert.methods.status import Status

START = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1.0, "b": 0.3, "I_C": 0.5}


@pytest.fixture(scope="module")
def models():
    return {name: da.compile_model(da.scenes.chaplygin_sleigh(), formulation=name) for name in ("minimal", "projected")}


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_sweeps_that_pause_after_every_round_give_the_same_bits(monkeypatch, models, formulation, method):
    cases = P | {"b": np.linspace(0.05, 0.5, 23)}

    def everything():
        options = {"method": method, "threads": 1}
        plain = models[formulation].sweep((0, 2), START, cases, **options)
        rows = models[formulation].sweep((0, 2), START, cases, t_eval=[0, 0.7, 2], **options)
        seen = models[formulation].sweep((0, 2), START, cases, events=["y"], reduce={"m": da.mean("x")}, **options)
        assert np.all(plain.success) and np.all(rows.success) and np.all(seen.success)
        events = seen.reduced["m"].tobytes() + seen.events["y"].first.tobytes()
        return plain.y.tobytes() + rows["x"].tobytes() + seen.y.tobytes() + events

    expected = everything()
    monkeypatch.setattr(sweeps, "_QUICK", 0.0)
    for rounds in (1, 2, 7):
        monkeypatch.setattr(sweeps, "_FIRST_ROUNDS", rounds)
        assert everything() == expected


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_prepared_runs_that_pause_give_the_same_bits(monkeypatch, models, formulation, method):
    model = models[formulation]
    y, p = model.state(START, P), model.parameter_vector(P)
    for t_span, options in (((0, 20), {}), ((0, -3), {}), ((0, 5), {"max_steps": 7}), ((1, 1), {})):
        monkeypatch.undo()
        run = model.prepare(t_span, method=method, **options)
        expected = run(y, p).tobytes(), run.status
        for patience in (1, 3):
            monkeypatch.setattr(prepared, "_PATIENCE", patience)
            monkeypatch.setattr(prepared, "_QUICK", 0.0)
            run = model.prepare(t_span, method=method, **options)
            assert (run(y, p).tobytes(), run.status) == expected
            assert (run(y, p).tobytes(), run.status) == expected


BEGIN = """
import signal
import numpy as np
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that runs the tests in the background ignores Ctrl-C
import dalembert as da
start = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
p = {"m": 1.0, "b": 0.3, "I_C": 0.5}
long = {"method": METHOD, "max_step": 1e-7, "max_steps": 10**12}
model = da.compile_model(da.scenes.chaplygin_sleigh())
"""
RUNS = {  # each compiles what it runs, says so, and then does not end by itself
    "a small sweep": """
def run(ends):
    return model.sweep((0, ends), start, p | {"b": [0.1, 0.2]}, threads=1, **long)
run([1e-5, 2e-5])
print("ready", flush=True)
print(run([0.01, 1e6]).status.tolist())
""",
    "a sweep in threads": """
def run(end):
    ends = np.r_[1e-5, np.full(299, end)]
    return model.sweep((0, ends), start, p | {"b": np.linspace(0.1, 0.2, 300)}, threads=2, **long)
run(2e-5)
print("ready", flush=True)
done = run(1e6)
print([int(done.status[0]), int(done.status[-1])])
""",
    "a sweep with times": """
def run(end):
    cases = p | {"b": np.linspace(0.1, 0.2, 130)}
    return model.sweep((0, end), start, cases, t_eval=[0.0, end], threads=2, **long)
run(1e-5)
print("ready", flush=True)
print(sorted(set(run(1e6).status.tolist())))
""",
    "a prepared run": """
y, p = model.state(start, p), model.parameter_vector(p)
model.prepare((0, 1e-5), **long)(y, p)
run = model.prepare((0, 1e6), **long)
print("ready", flush=True)
try:
    run(y, p)
except KeyboardInterrupt:
    print("stopped", run.status.name)
""",
}
INTERRUPTED = int(Status.INTERRUPTED)
SAID = {
    "a small sweep": [str([0, INTERRUPTED]), str([INTERRUPTED, INTERRUPTED])],
    "a sweep in threads": [str([0, INTERRUPTED]), str([INTERRUPTED, INTERRUPTED])],
    "a sweep with times": [str([INTERRUPTED])],
    "a prepared run": ["stopped INTERRUPTED"],
}


@pytest.mark.skipif(os.name == "nt", reason="a process cannot send Ctrl-C to another")
@pytest.mark.parametrize("what", RUNS)
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_ctrl_c_reaches_runs_that_do_not_end(what, method):
    script = BEGIN.replace("METHOD", repr(method)) + RUNS[what]
    run = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert run.stdout.readline().strip() == "ready", run.communicate()
        time.sleep(0.3)
        assert run.poll() is None, run.communicate()
        run.send_signal(signal.SIGINT)
        said, errors = run.communicate(timeout=60)
    finally:
        run.kill()
    assert run.returncode == 0, errors
    assert said.strip() in SAID[what]
