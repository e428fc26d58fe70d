"""Taylor steps with tables: written out, as loops over the orders, and by numba, they are the same steps."""

import ctypes

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.llvm.assembly import assembly, compile_object, load_object
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.llvm.order_loops import order_loop_assembly
from dalembert.codegen.llvm.series_loops import series_loop_assembly
from dalembert.ir.interpret import interpret
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import step_kernel
from table_cases import KINDS, oscillator

ORDER = 8
LARGEST = 5.0


def compiled(text):
    return load_object(compile_object(with_definitions(text)))


def called(library, lanes, states, constants):
    """Return the outputs of a step from states (2, lanes)."""
    out, y = np.zeros((4, lanes)), np.ascontiguousarray(states)
    t, c = np.full(lanes, 0.3), np.repeat(constants[:, np.newaxis], lanes, axis=1).copy()
    s = np.repeat(np.array([LARGEST, 1.0, 1e-3])[:, np.newaxis], lanes, axis=1).copy()
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(library.address("step"))
    function(*(array.ctypes.data for array in (t, y, c, s, out)))
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_every_form_of_a_step_is_the_same(kind):
    program = da.compile_model(oscillator(kind), backend="numpy").stages.program
    constants = np.array(interpret(program.kernel("prepare"), {"p": [0.1, 1.0]}))
    known = recurrences(program.kernel("rhs"))
    states = np.random.default_rng(1).uniform(-1.9, 1.9, (2, 4))
    straight = compiled(assembly([("step", step_kernel(known, ORDER, dense=False))], 1))
    alone = np.hstack([called(straight, 1, states[:, i : i + 1], constants) for i in range(4)])
    assert np.all(alone[2] < LARGEST)
    if kind != "hold":
        expected = interpret(
            step_kernel(known, ORDER, dense=False),
            {"t": 0.3, "y": list(states[:, 0]), "c": constants, "s": [LARGEST, 1.0, 1e-3]},
        )
        assert alone[:, 0] == pytest.approx(expected, rel=1e-2)  # but for the rough logarithms of compiled code
    for lanes in (1, 4):
        for form in (
            order_loop_assembly("step", known, ORDER, lanes, 4, dense=False),
            series_loop_assembly("step", known, ORDER, lanes, dense=False),
        ):
            found = called(compiled(form), lanes, states[:, :lanes], constants)
            np.testing.assert_allclose(found, alone[:, :lanes], rtol=1e-12, atol=1e-13)


def test_loops_of_numba_are_the_same():
    from dalembert.codegen.numba import texts
    from dalembert.codegen.numba.backend import load_functions
    from dalembert.codegen.numba.taylor_loops import taylor_loop
    from dalembert.codegen.rendering import render

    program = da.compile_model(oscillator("linear"), backend="numpy").stages.program
    constants = np.array(interpret(program.kernel("prepare"), {"p": [0.1, 1.0]}))
    known = recurrences(program.kernel("rhs"))
    text = render("numba/taylor.py.j2", taylor_loop("step", known, ORDER, dense=False))
    library = load_functions(None, "step", lambda: texts.joined(text), ["step"])
    straight = compiled(assembly([("step", step_kernel(known, ORDER, dense=False))], 1))
    states = np.array([[1.3], [-0.7]])
    found, expected = (called(code, 1, states, constants) for code in (library, straight))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
