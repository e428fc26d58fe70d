"""Generated kernels against the reference interpreter, for every kernel, formulation and backend."""

import ctypes
import functools
import math

import numpy as np
import pytest

import dalembert as da
from codegen.programs import PROGRAMS
from dalembert.codegen import BACKENDS, backend_named
from dalembert.errors import MissingExtraError
from dalembert.ir.interpret import interpret, interpret_rows
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.ir.ops import ALL_OPERATIONS, CALL_OPERATIONS, TABLE_OPERATIONS
from dalembert.reduction import FORMULATIONS

OUTPUTS = {"chaplygin_sleigh": ["X", "Y"], "rolling_sphere": ["F_u", "F_v"]}
SCENES = sorted(OUTPUTS)
ROWS = 20


def loaded(backend):
    try:
        return backend_named(backend)
    except MissingExtraError:
        pytest.skip(f"the extra for {backend} is not installed")


@functools.cache
def compiled(scene, formulation, backend):
    loaded(backend)
    scene = da.scenes.ALL[scene]()
    return da.compile_model(scene, backend=backend, formulation=formulation, outputs=OUTPUTS[scene.name], cache=False)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("scene", SCENES)
def test_kernels_equal_the_interpreter(scene, formulation, backend):
    if backend == "jax" and formulation == "projected":  # which it refuses
        formulation = "augmented"
    model = compiled(scene, formulation, backend)
    program = model.stages.program
    rng = np.random.default_rng(17)
    p = rng.uniform(0.5, 2.0, len(program.layout.parameters))
    c = np.array(interpret(program.kernel("prepare"), {"p": p.tolist()}))
    checked = []
    for kernel in program:
        if kernel.name == "prepare":
            continue
        state = "rhs expand outputs project_position project_velocity".split()
        layout = program.layout
        width = len(layout.state) if kernel.name in state else 2 * len(layout.coordinates)
        t = rng.uniform(-1, 1, ROWS)
        y = rng.uniform(0.4, 1.4, (ROWS, width))  # away from the poles of the angles
        expected = np.array([interpret(kernel, {"t": t[i], "y": y[i].tolist(), "c": c}) for i in range(ROWS)])
        found = np.asarray(model.engine.evaluate(kernel.name, t, y, c))
        scale = np.abs(expected).max(initial=1.0)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13 * scale, err_msg=kernel.name)
        np.testing.assert_allclose(interpret_rows(kernel, t, y, c), expected, rtol=1e-12, atol=1e-13 * scale)
        checked.append(kernel.name)
    assert {"rhs", "expand", "outputs", "initial", "mass_matrix", "forcing", "accelerations"} <= set(checked)


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_operation_means_the_same_in_every_backend(backend):
    program = PROGRAMS["every_operation"]()
    engine = loaded(backend)
    engine = engine.load(engine.render(program), cache=False)
    kernel = program.kernel("outputs")
    t, y = np.array([0.4, -0.6, 0.0]), np.array([[0.3, 0.8], [0.9, 0.25], [0.5, 0.5]])
    expected = [interpret(kernel, {"t": float(t[i]), "y": y[i].tolist(), "c": []}) for i in range(3)]
    np.testing.assert_allclose(engine.evaluate("outputs", t, y, np.empty(0)), expected, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("backend", BACKENDS)
def test_values_outside_of_a_domain_are_not_exceptions(backend):
    program = PROGRAMS["every_operation"]()
    engine = loaded(backend)
    engine = engine.load(engine.render(program), cache=False)
    y = np.array([[-3.0, 0.0], [0.0, 0.0], [-0.5, 0.5], [1e200, 1e200], [np.nan, 1.0]])
    found = np.asarray(engine.evaluate("outputs", np.zeros(len(y)), y, np.empty(0)))
    names = [line.op for line in program.kernel("outputs").body]
    assert np.isnan(found[0, names.index("sqrt")])
    assert np.isnan(found[0, names.index("log")])
    assert found[0, names.index("div")] == -math.inf
    assert np.isnan(found[2, names.index("pow")])
    assert np.isfinite(found[2, names.index("mul")])


@pytest.mark.parametrize("backend", BACKENDS)
def test_results_are_the_callers_to_keep(backend):
    model = compiled("chaplygin_sleigh", "minimal", backend)
    p = {"m": 1.0, "b": 0.3, "I_C": 0.5}
    first = np.array(model.accelerations(0.0, [0, 0, 0.2], [1, 0.2, 0.4], p))
    kept = model.accelerations(0.0, [0, 0, 0.2], [1, 0.2, 0.4], p)
    model.accelerations(0.0, [0, 0, 1.2], [3, 0.2, -0.4], p)
    np.testing.assert_array_equal(kept, first)


# -- machine code -------------------------------------------------------------------------


def aligned(values):
    """Return a copy that starts at a multiple of 64 bytes."""
    values = np.asarray(values, dtype=float)
    buffer = np.empty(values.size + 8)
    offset = -buffer.ctypes.data % 64 // 8
    view = buffer[offset : offset + values.size]
    view[:] = values.ravel()
    return view


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
@pytest.mark.parametrize("name", [name for name in ALL_OPERATIONS if name not in TABLE_OPERATIONS | CALL_OPERATIONS])
def test_machine_code_means_the_same_in_every_lane(name, lanes):
    from dalembert.codegen.llvm.assembly import assembly, compile_object, load_object
    from dalembert.codegen.llvm.definitions import with_definitions

    operation = ALL_OPERATIONS[name]
    loads = tuple(Load(f"a{i}", "y", i) for i in range(operation.arity))
    line = Assignment("z", name, tuple(load.target for load in loads))
    kernel = Kernel("k", ("y",), loads, (line, Assignment("w", "mul", ("z", -1.5))), ("z", "w", 0.25))
    library = load_object(compile_object(with_definitions(assembly([("k", kernel)], lanes))))
    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(library.address("k"))
    rng = np.random.default_rng(3)
    rough = {"rough_log2": 1e-2, "rough_exp2": 2e-4}.get(name)
    for _ in range(6):
        columns = rng.uniform(0.05, 0.95, (operation.arity, lanes))
        if name not in ("sqrt", "log", "pow", "rough_log2"):
            columns *= rng.choice([-1.0, 1.0], columns.shape)
        y, out = aligned(columns), aligned(np.zeros((3, lanes)))
        function(y.ctypes.data, out.ctypes.data)
        expected = [operation.evaluate(*map(float, columns[:, i])) for i in range(lanes)]
        rows = out.reshape(3, lanes)
        np.testing.assert_allclose(rows[0], expected, rtol=0 if rough else 1e-13, atol=rough or 1e-15)
        np.testing.assert_allclose(rows[1], -1.5 * rows[0], rtol=1e-15)
        np.testing.assert_array_equal(rows[2], 0.25)


@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sines_of_machine_code_hold_at_large_angles_and_beyond(name, lanes):
    from dalembert.codegen.llvm.assembly import assembly, compile_object, load_object
    from dalembert.codegen.llvm.definitions import with_definitions

    kernel = Kernel("k", ("y",), (Load("a", "y", 0),), (Assignment("z", name, ("a",)),), ("z",))
    library = load_object(compile_object(with_definitions(assembly([("k", kernel)], lanes))))
    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(library.address("k"))
    points = [0.0, 1e-9, math.pi / 2, math.pi, -7.5, 100.25, -1e4, 123456.789, 1e9, 1e15]
    for point in points:
        out = aligned(np.zeros(lanes))
        y = aligned(np.full(lanes, point))
        function(y.ctypes.data, out.ctypes.data)
        expected = getattr(math, name)(point)
        np.testing.assert_allclose(out, expected, rtol=1e-14, atol=4e-16, err_msg=str(point))
    for point in (math.inf, math.nan):
        out, y = aligned(np.zeros(lanes)), aligned(np.full(lanes, point))
        function(y.ctypes.data, out.ctypes.data)
        assert np.isnan(out).all()


def test_formulations_are_all_rendered():
    """The registry has no formulation that the tests above would overlook without a word."""
    assert {"minimal", "projected", "augmented"} <= set(FORMULATIONS)
