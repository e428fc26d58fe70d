"""Loops as machine code: kept, checked when read, called without numba, and the same as in sweeps to the last bit."""

import gc
import os
import subprocess
import sys
import warnings
import weakref

import numpy as np
import pytest
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.codegen import engine, kernel_code, lane_runs, steppers
from dalembert.codegen import library as kernel_library
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE
from dalembert.codegen.llvm import assembly
from dalembert.codegen.llvm import backend as llvm_library
from dalembert.codegen.llvm.loops import SOURCES, loop_named
from dalembert.codegen.subset import loop_assembly
from dalembert.contacts import contact_decisions
from dalembert.errors import CacheWarning
from dalembert.loops import lane_loop
from dalembert.methods.status import Status
from dalembert.model import derived
from dalembert.subset.compiled_subset import NESTED

pytestmark = pytest.mark.usefixtures("small_heap")

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1, "b": 0.3, "I_C": 0.5}

RUN = """
import sys
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected")
p = {"m": 1, "b": 0.3, "I_C": 0.5}
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
y = model.state(start, p)
for method in ("taylor",):
    end = model.prepare((0, 1), method=method)(y, model.parameter_vector(p)).tolist()
    end += model.simulate((0, 1), start, p, method=method).y[-1].tolist()
    print(method, "numba" in sys.modules, *end)
"""


SWEEP = """
import sys
import dalembert as da
model = da.compile_model(da.scenes.chaplygin_sleigh(), formulation="projected")
start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
kinds = {  # each makes a loop that those before it have not made
    "plain": {},
    "sampled": {"t_eval": [0.3, 1.0]},
    "watched": {"events": ["theta_dot"], "reduce": {"far": da.maximum("x")}},
}
for kind, more in kinds.items():
    sweep = model.sweep((0, 1), start, {"m": 1, "b": [0.2, 0.3, 0.4], "I_C": 0.5}, **more)
    print(kind, "numba" in sys.modules, *sweep["x"].ravel().tolist())
"""


def forget_loops():
    """Forget all code that belongs to no scene, unload what nothing holds, and load other code in its place."""
    for kept in (loop_named, lane_runs._advance_code, lane_runs._check_code):
        kept.cache_clear()
    gc.collect()
    for name in ("lane_loop", "prepared_loop", "contact_decisions"):
        assert loop_named(name).call is not None


def run_in_a_process(folder, program):
    """Return what a program prints, by the first word of each line."""
    environment = {**os.environ, ENVIRONMENT_VARIABLE: str(folder)}
    code = [sys.executable, "-W", "error::dalembert.errors.CacheWarning", "-c", program]
    done = subprocess.run(code, capture_output=True, text=True, check=True, env=environment)
    return {name: found for name, *found in map(str.split, done.stdout.splitlines())}


@pytest.mark.parametrize(
    ("program", "names"),
    [(RUN, ["taylor"]), (SWEEP, ["plain", "sampled", "watched"])],
    ids=["runs", "sweeps"],
)
def test_first_and_later_processes_do_without_numba_and_agree(tmp_path, program, names):
    """All loops are compiled without it by ``compile_once.py``, with which ``make test`` begins."""
    first, second = (run_in_a_process(tmp_path, program) for _ in range(2))
    assert first == second
    assert [*first] == names
    assert [found[0] for found in first.values()] == ["False"] * len(names)


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


@pytest.mark.parametrize("what", ["prepared", "sweep", "contacts"])
def test_what_is_ready_to_run_outlives_the_caches_of_code(what):
    """Was a segmentation fault, or a run of other code that had taken the address."""
    if what == "contacts":
        model = da.compile_model(da.scenes.bouncing_ball())
        start, p = {"x": 0, "y": 1.0, "x_dot": 1, "y_dot": 0}, {"m": 2.0, "e": 0.5, "g": 10.0}
        run = lambda: model.simulate((0, 2), start, p).y[-1]  # noqa: E731
    elif what == "sweep":
        model = da.compile_model(da.scenes.chaplygin_sleigh())
        options = {"reduce": {"far": da.maximum("x")}, "events": [da.Event("theta_dot", terminal=2)]}
        run = lambda: model.sweep((0, 1), START, {**PARAMETERS, "b": [0.2, 0.3]}, **options).y  # noqa: E731
    else:
        model = da.compile_model(da.scenes.chaplygin_sleigh())
        prepared = model.prepare((0, 1))
        run = lambda: prepared(model.state(START, PARAMETERS), model.parameter_vector(PARAMETERS))  # noqa: E731
    first = run()
    for _ in range(3):
        forget_loops()
        np.testing.assert_array_equal(run(), first)


class Engines:
    """Counts the loaded pieces of code that are made from now on and still live."""

    def __init__(self, monkeypatch):
        self._made, load = weakref.WeakSet(), assembly.load_object

        def counted(*codes):
            code = load(*codes)
            self._made.add(code._engine)
            return code

        monkeypatch.setattr(llvm_library, "load_object", counted)

    def count(self):
        gc.collect()
        return len(self._made)


@pytest.mark.parametrize("what", ["events", "reductions"])
def test_code_of_a_model_is_bounded(monkeypatch, what):
    """Each distinct event or reduction used to keep its code as long as the model lived, 0.2 MB."""
    monkeypatch.setattr(derived, "_MOST", 2)
    monkeypatch.setattr(steppers, "_MOST_EVENTS", 2)
    monkeypatch.setattr(lane_runs, "_MOST_LANES", 2)
    for module in (engine, kernel_code, kernel_library):
        monkeypatch.setattr(module, "MOST_FURTHER", 4)
    model, engines, counts = da.compile_model(da.scenes.chaplygin_sleigh()), Engines(monkeypatch), []

    def swept(number):
        level = 0.21 + 0.01 * number
        events = [da.Event(dynamicsymbols("theta") - level, terminal=2)] if what == "events" else []
        reduce = {"far": da.maximum(level * dynamicsymbols("theta"))} if what == "reductions" else None
        options = {"events": events, "reduce": reduce, "method": "taylor"}
        return model.sweep((0, 0.1), START, {**PARAMETERS, "b": [0.2, 0.3]}, **options).y

    first = swept(0)
    for number in range(1, 6):
        swept(number)
        counts.append(engines.count())
    assert counts[-1] == counts[-2] == counts[-3] < 22, counts
    np.testing.assert_array_equal(swept(0), first)


def test_code_of_a_model_lives_as_long_as_what_runs_it():
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    state, p = model.state(START, PARAMETERS), model.parameter_vector(PARAMETERS)
    run, engine = model.prepare((0, 1)), weakref.ref(model.engine.steps.prepare().owner)
    first = run(state, p)
    del model
    gc.collect()
    np.testing.assert_array_equal(run(state, p), first)
    assert engine() is not None
    del run
    gc.collect()
    assert engine() is None


def test_long_functions_of_a_loop_stay_apart():
    _, module = assembly._compiled(loop_assembly(lane_loop.LOOP), SOURCES["lane_loop"][2])
    lengths = [str(function).count("\n") for function in module.functions if not function.is_declaration]
    assert max(lengths) < sum(lengths) / 4, "LLVM's time grows faster than the length of a function"


def test_functions_with_nested_loops_are_marked():
    heads = [line for line in loop_assembly(contact_decisions.LOOP).splitlines() if line.startswith("define internal")]
    marked = [line for line in heads if f'"{NESTED}"' in line]
    assert any("@decompose_" in line for line in marked)
    assert 0 < len(marked) < len(heads) / 2, "LLVM takes longer for these"
