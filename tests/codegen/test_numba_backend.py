"""The numba backend: it agrees with the default one, runs what it shows, and keeps what it compiled.

``make test-all`` compares every ready scene in every formulation by every method (`test_numba_matrix`).
"""

import ast
import ctypes
import os
import shutil
import subprocess
import sys
import threading

import numba
import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from codegen.ready_scenes import assert_agreement, ready
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE
from dalembert.codegen.elementary import ELEMENTARY
from dalembert.codegen.llvm import assembly as printer
from dalembert.codegen.llvm.assembly import compile_object, load_object
from dalembert.codegen.llvm.backend import LLVMLibrary
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.numba import backend as numba_backend
from dalembert.codegen.numba import texts
from dalembert.codegen.printers import NUMBA
from dalembert.codegen.rendering import template_directory
from dalembert.errors import OptionError
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.ir.ops import ALL_OPERATIONS, CALL_OPERATIONS, TABLE_OPERATIONS
from system.test_jumps_in_time import PULSE, oscillator

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
P = {"m": 1.0, "b": 0.3, "I_C": 0.5}
SLOWER = dynamicsymbols("theta").diff() - 1
BATCH = {"m": 1.0, "b": np.linspace(0.1, 0.5, 9), "I_C": 0.5}


def sleigh(backend="numba", **options):
    return da.compile_model(da.scenes.chaplygin_sleigh(), backend=backend, cache=False, **options)


@pytest.fixture(scope="module")
def models():
    return {backend: sleigh(backend, outputs=["X"]) for backend in ("llvm", "numba")}


# -- agreement ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "formulation", "method"),
    [
        ("chaplygin_sleigh", "projected", "taylor"),
        ("chaplygin_sleigh", "projected", "dop853"),
        ("chaplygin_sleigh", "ggl", "radau"),
        ("rolling_sphere", "minimal", "auto"),
        ("belt_oscillator", "auto", "auto"),
    ],
)
def test_motions_agree_with_llvm(scene, formulation, method):
    assert_agreement(scene, formulation, "simulate", method=method)


def test_single_runs_and_outputs_agree_with_llvm(models):
    options = {"t_eval": np.linspace(0.0, 3.0, 7), "events": [SLOWER]}
    ours, theirs = (models[backend].simulate((0, 3), START, P, **options) for backend in ("numba", "llvm"))
    assert len(ours.events) == len(theirs.events) == 1
    for key in ("x", "theta_dot", "X", "energy"):
        np.testing.assert_allclose(ours[key], theirs[key], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_sweeps_with_events_and_reductions_agree_with_llvm(models, method):
    options = {"events": [SLOWER], "reduce": {"far": da.maximum("x")}, "t_eval": [1.0, 2.5]}
    ours, theirs = (models[backend].sweep((0, 3), START, BATCH, method=method, **options) for backend in models)
    assert np.all(ours.success)
    np.testing.assert_array_equal(ours.steps, theirs.steps)
    for found, expected in ((ours.y, theirs.y), (ours["x"], theirs["x"]), (ours.reduced["far"], theirs.reduced["far"])):
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)


def test_prepared_runs_sensitivities_and_linearisations_agree_with_llvm(models):
    def found(model):
        p = model.parameter_vector(P)
        end = model.prepare((0, 2))(model.state(START, P), p)
        slopes = model.sensitivity((0, 2), START, P, wrt=["b"], of=["x"]).jacobian("x", "b")
        A = model.linearize(0.0, START, P).A
        return np.concatenate([end, slopes[-1:], np.ravel(A), np.ravel(model.mass_matrix([0.0, 0.0, 0.3], P))])

    np.testing.assert_allclose(found(models["numba"]), found(models["llvm"]), rtol=1e-11, atol=1e-12)


@pytest.mark.matrix
def test_loops_over_orders_and_calls_of_the_right_hand_side_change_little(models, monkeypatch):
    """What long right-hand sides take: the same numbers as code written out, up to rounding."""
    monkeypatch.setattr(texts, "_LARGEST_STRAIGHT", 0)
    monkeypatch.setattr(texts, "_LARGEST_INLINED", 0)
    model = sleigh(formulation="projected")
    assert "for k in range(1, " in model.source_of("taylor")
    for method in ("taylor", "tsit5"):
        ours = model.sweep((0, 3), START, BATCH, method=method)
        theirs = sleigh("llvm", formulation="projected").sweep((0, 3), START, BATCH, method=method)
        np.testing.assert_array_equal(ours.steps, theirs.steps)
        np.testing.assert_allclose(ours.y, theirs.y, rtol=1e-11, atol=1e-12)


def columns(operation):
    """Return operands of an operation, (k, arity), within its domain and beyond."""
    rng = np.random.default_rng(5)
    rows = rng.uniform(0.05, 0.95, (6, operation.arity)) * rng.choice([1.0, -1.0, 9.0], (6, operation.arity))
    return np.vstack([rows, np.zeros(operation.arity), np.full(operation.arity, np.nan)])


def test_every_operation_means_what_it_means_to_llvm():
    """Equal bits, but for the elementary functions that LLVM has in lanes, where numba has those of the C library."""
    assert set(NUMBA.formats) | set(TABLE_OPERATIONS) == set(ALL_OPERATIONS)
    operations = [op for op in ALL_OPERATIONS.values() if op.name not in TABLE_OPERATIONS | CALL_OPERATIONS]
    loads = tuple(Load(f"a{i}", "y", i) for i in range(3))
    names = tuple(load.target for load in loads)
    body = tuple(Assignment(f"z_{op.name}", op.name, names[: op.arity]) for op in operations)
    kernel = Kernel("k", ("t", "y", "c", "s"), loads, body, tuple(line.target for line in body))
    codes = (
        load_object(compile_object(with_definitions(printer.assembly([("k", kernel)], 1)))),
        numba_backend.load_functions(None, "k", lambda: texts.kernel("k", kernel), ("k",)),
    )
    calls = [ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(code.address("k")) for code in codes]
    for op in operations:
        for row in columns(op):
            y, found = np.append(row, np.zeros(3)), np.zeros((2, len(body)))
            for call, out in zip(calls, found, strict=True):
                call(0, y.ctypes.data, 0, 0, out.ctypes.data)
            place = [line.op for line in body].index(op.name)
            close = {"rtol": 1e-13, "atol": 1e-15} if op.name in ("sin", "cos") else {"rtol": 0, "atol": 0}
            close = {"rtol": 4e-16, "atol": 0} if op.name in ELEMENTARY else close
            np.testing.assert_allclose(*found[:, place], **close, err_msg=op.name)


# -- what runs ----------------------------------------------------------------------------


def refuse(*arguments, **options):
    raise AssertionError("the LLVM backend prints a kernel")


def test_nothing_of_the_llvm_backend_prints_kernels(monkeypatch):
    monkeypatch.setattr(printer, "assembly", refuse)
    for name in ("kernel_text", "step_text", "attempt_text"):
        monkeypatch.setattr(LLVMLibrary, name, refuse)
    model = sleigh(outputs=["X"])
    assert model.simulate((0, 1), START, P).success
    assert np.all(model.sweep((0, 1), START, BATCH, method="tsit5").success)


def test_a_changed_template_changes_what_runs(tmp_path, monkeypatch):
    copy = tmp_path / "templates"
    shutil.copytree(template_directory(), copy)
    for name, place in (("kernel", "{{ result }}[{{ loop.index0 }}]"), ("function", "{{ store.place }}")):
        path = copy / "numba" / f"{name}.py.j2"
        path.write_text(path.read_text().replace(f"{place} = ", f"{place} = 2.0 * "))
    right = sleigh().simulate((0, 1), START, P, method="dop853")
    monkeypatch.setattr("dalembert.codegen.rendering.template_directory", lambda: copy)
    model = sleigh()
    wrong = model.simulate((0, 1), START, P, method="dop853")
    assert abs(wrong["x"][-1] - right["x"][-1]) > 0.1
    assert "2.0 * " in model.source


@pytest.mark.parametrize("method", ["taylor", "radau"])
def test_every_function_of_a_run_stands_in_the_source(method, monkeypatch):
    compiled, make = [], numba_backend._compiled
    monkeypatch.setattr(
        numba_backend, "_compiled", lambda text, functions: (compiled.append(text), make(text, functions))[1]
    )
    model = sleigh()
    assert model.simulate((0, 1), START, P, method=method, rtol=1e-6).success
    model.accelerations(0.0, [0, 0, 0.2], [1, 0.2, 0.4], P)
    source = model.source_of(method, 1e-6)
    assert len(compiled) >= 2 and all(text.strip() in source for text in compiled)
    assert model.source == model.source_of("auto") != source
    for text in (source, model.source):
        imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
        assert [alias.name for node in imports for alias in node.names] == ["math", "numba"]


# -- functions for people's own code ------------------------------------------------------


def test_kernels_can_be_called_in_compiled_code(models):
    model = models["numba"]
    prepare, rhs = model.kernels.prepare, model.kernels.rhs
    c, p, y = np.empty(model.layout.constants), model.parameter_vector(P), model.state(START, P)

    @numba.njit
    def euler(p, c, y, h, steps):
        prepare(p, c)
        rate = np.empty_like(y)
        for _ in range(steps):
            rhs(0.0, y, c, rate)
            y = y + h * rate
        return y

    end = euler(p, c, y, 1e-5, 100_000)
    np.testing.assert_allclose(end, model.simulate((0, 1), START, P).y[-1], atol=1e-4)
    out = np.empty(9)
    model.kernels.mass_matrix(0.0, np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0]), c, out)
    np.testing.assert_array_equal(out.reshape(3, 3), model.mass_matrix([0.0, 0.0, 0.3], P))


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_other_backends_say_which_one_has_kernels(backend):
    with pytest.raises(OptionError, match='compile with backend="numba"'):
        _ = sleigh(backend).kernels


# -- the cache, threads, and what numba is told --------------------------------------------

SCRIPT = """
import sys
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numba", outputs=["X"])
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
run = model.simulate((0, 1), start, {"m": 1, "b": 0.3, "I_C": 0.5})
print("numba" in sys.modules, run["x"][-1].hex(), run["X"][-1].hex())
"""


def process(folder, **environment):
    environment = os.environ | {ENVIRONMENT_VARIABLE: str(folder)} | environment
    return subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, timeout=300)


def test_a_second_process_finds_everything_compiled_and_does_without_numba(tmp_path):
    first = process(tmp_path / "cache")
    assert first.returncode == 0, first.stderr
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*")}
    assert any(path.suffix == ".nbo" for path in stamps)
    second = process(tmp_path / "cache", NUMBA_DISABLE_JIT="1")  # nothing is compiled
    assert second.stdout.split() == ["False", *first.stdout.split()[1:]], second.stderr
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*")} == stamps


def test_numba_that_compiles_nothing_is_an_error_with_a_name(tmp_path):
    run = process(tmp_path / "cache", NUMBA_DISABLE_JIT="1")
    assert run.returncode == 1 and "OptionError: NUMBA_DISABLE_JIT is set" in run.stderr


def test_threads_that_compile_at_once_get_what_one_gets(models):
    model, found = sleigh(outputs=["X"]), {}
    methods = ["taylor", "dop853", "radau", "tsit5"] * 2

    def run(place):
        found[place] = model.simulate((0, 1), START, P, method=methods[place], rtol=1e-7).y[-1]

    threads = [threading.Thread(target=run, args=(place,)) for place in range(len(methods))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for place, method in enumerate(methods):
        alone = models["numba"].simulate((0, 1), START, P, method=method, rtol=1e-7).y[-1]
        np.testing.assert_array_equal(found[place], alone)


def test_scenes_with_pieces_of_time_have_no_kernels():
    model = oscillator(PULSE, backend="numba", cache=False)
    with pytest.raises(OptionError, match="kinks or jumps"):
        _ = model.kernels
    run, values = (0, 3), {"A": 2.0, "tp": 1.2, "m": 1.0}
    ours = model.simulate(run, {"x": 0.0, "x_dot": 0.0}, values)
    theirs = oscillator(PULSE).simulate(run, {"x": 0.0, "x_dot": 0.0}, values)
    np.testing.assert_allclose(ours.y[-1], theirs.y[-1], rtol=1e-12, atol=1e-13)


def test_a_ready_scene_is_there_for_every_name():
    assert all(ready(name).initial for name in da.scenes.ALL)
