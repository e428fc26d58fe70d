"""Functions on lanes: how accurate they are, and that no lane knows of its neighbours."""

import ctypes
import functools

import mpmath
import numpy as np
import pytest

from dalembert.codegen.elementary import ELEMENTARY
from dalembert.codegen.llvm.assembly import assembly, compile_object, load_object
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.llvm.target import is_fused, native_lanes
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.ir.ops import ALL_OPERATIONS, CALL_OPERATIONS, TABLE_OPERATIONS

LANES = (1, 2, 4)
# those of tables and compiled functions have tests of their own
NUMERICAL = [name for name in ALL_OPERATIONS if name not in TABLE_OPERATIONS | CALL_OPERATIONS]
REPEATED = (1, native_lanes())


@functools.cache
def machine_code(names, lanes, exact=False):
    """Return a function from columns (arity, k) to the results (len(names), k) of the operations named."""
    arity = max(ALL_OPERATIONS[name].arity for name in names)
    loads = tuple(Load(f"a{i}", "y", i) for i in range(arity))
    arguments = [tuple(load.target for load in loads[: ALL_OPERATIONS[name].arity]) for name in names]
    body = tuple(Assignment(f"z_{name}", name, args) for name, args in zip(names, arguments, strict=True))
    kernel = Kernel("k", ("y",), loads, body, tuple(line.target for line in body))
    library = load_object(compile_object(with_definitions(assembly([("k", kernel)], lanes, exact=exact))))
    code = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(library.address("k"))

    def run(columns):
        columns = np.atleast_2d(np.asarray(columns, dtype=float))
        count = columns.shape[1]
        padded = np.concatenate([columns, np.repeat(columns[:, -1:], -count % lanes, axis=1)], axis=1)
        out = np.empty((len(names), padded.shape[1]))
        for first in range(0, padded.shape[1], lanes):
            y, results = np.ascontiguousarray(padded[:, first : first + lanes]), np.empty((len(names), lanes))
            code(y.ctypes.data, results.ctypes.data)
            out[:, first : first + lanes] = results
        return out[:, :count]

    run.library = library  # the code is good as long as this lives
    return run


def units_in_the_last_place(found, x, function):
    """Return how far `found` lies from function(x) in 50 digits, in units of the last place of the result."""
    worst = 0.0
    with mpmath.workdps(50):
        for value, at in zip(found, x, strict=True):
            exact = function(mpmath.mpf(float(at)))
            unit = np.spacing(abs(float(exact))) or 5e-324
            worst = max(worst, abs(float((mpmath.mpf(float(value)) - exact) / mpmath.mpf(float(unit)))))
    return worst


def angles():
    rng = np.random.default_rng(11)
    quarters = np.concatenate([np.arange(1, 40), rng.integers(1, 636_000, 400)]) * (np.pi / 2)
    near = np.concatenate([quarters, np.nextafter(quarters, 0.0), np.nextafter(quarters, 1e9), quarters * (1 + 1e-12)])
    spread = np.concatenate([rng.uniform(-1e6, 1e6, 800), rng.uniform(-4, 4, 800), 10.0 ** rng.uniform(-300, 6, 400)])
    x = np.concatenate([near[near < 1e6], -near[:40], spread, [0.0, 1e6, -1e6, 999999.9999]])
    return np.where(np.abs(x) <= 1e6, x, 1.0)


@pytest.mark.parametrize("lanes", LANES)
def test_sine_and_cosine_are_accurate_to_two_units(lanes):
    x = angles()
    sine, cosine = machine_code(("sin", "cos"), lanes)(x)
    assert units_in_the_last_place(sine, x, mpmath.sin) <= 2.0
    assert units_in_the_last_place(cosine, x, mpmath.cos) <= 2.0


@pytest.mark.parametrize("lanes", LANES)
def test_sine_and_cosine_of_large_angles_are_correct(lanes):
    rng = np.random.default_rng(12)
    x = np.concatenate([10.0 ** rng.uniform(6.0, 22.0, 300), -(10.0 ** rng.uniform(6.0, 22.0, 100)), [1e22, 1e300]])
    sine, cosine = machine_code(("sin", "cos"), lanes)(x)
    for found, function in ((sine, mpmath.sin), (cosine, mpmath.cos)):
        with mpmath.workdps(350):
            exact = np.array([float(function(mpmath.mpf(float(at)))) for at in x])
        np.testing.assert_array_max_ulp(found, exact, 1)
    for value in (np.nan, np.inf, -np.inf):
        assert np.all(np.isnan(machine_code(("sin", "cos"), lanes)([value] * lanes)))


@pytest.mark.parametrize("lanes", (2, 4, native_lanes()))
def test_a_large_angle_changes_no_neighbour(lanes):
    x = np.random.default_rng(13).uniform(-50.0, 50.0, 200 * lanes)
    clean = machine_code(("sin", "cos"), lanes)(x)
    for value in (1e7, 1e300, np.inf, np.nan):
        spoilt = x.copy()
        spoilt[1::lanes] = value
        found = machine_code(("sin", "cos"), lanes)(spoilt)
        others = np.arange(len(x)) % lanes != 1
        np.testing.assert_array_equal(found[:, others], clean[:, others])


def spread(name):
    """Return arguments (arity, k) of an elementary function, over all of its range and where its parts meet."""
    rng = np.random.default_rng(16)
    both = np.array([-1.0, 1.0])
    near = np.concatenate([b * (1.0 + rng.uniform(-1e-3, 1e-3, 60)) for b in (0.4375, 0.625, 0.6875, 1.1875, 2.4375)])
    match name:
        case "tan":
            return np.concatenate([rng.uniform(-1.6, 1.6, 300), rng.uniform(-1e6, 1e6, 300), angles()[:200]])[
                np.newaxis
            ]
        case "exp":
            return np.concatenate([rng.uniform(-708.0, 709.7, 300), rng.normal(0.0, 1.0, 300)])[np.newaxis]
        case "log":
            return np.concatenate([10.0 ** rng.uniform(-307, 308, 300), rng.uniform(0.5, 2.0, 300)])[np.newaxis]
        case "sinh" | "cosh":
            joined = [b * (1.0 + rng.uniform(-1e-3, 1e-3, 60)) for b in (1.0, -1.0)]
            return np.concatenate([rng.normal(0.0, 1.0, 300), rng.uniform(-710.0, 710.0, 300), *joined])[np.newaxis]
        case "asin" | "acos":
            joined = [b * (1.0 + rng.uniform(-1e-3, 1e-3, 60)) for b in (0.5, -0.5)]
            ends = np.concatenate([1.0 - 10.0 ** rng.uniform(-16, -1, 100), 10.0 ** rng.uniform(-300, 0, 100)])
            return np.concatenate([rng.uniform(-1.0, 1.0, 300), *joined, ends, -ends])[np.newaxis]
        case "tanh":
            return np.concatenate([rng.normal(0.0, 1.0, 300), rng.uniform(-30.0, 30.0, 100), near])[np.newaxis]
        case "atan":
            return np.concatenate([rng.normal(0.0, 1.0, 300), 10.0 ** rng.uniform(-20, 300, 100), -near])[np.newaxis]
        case "atan2":
            sizes = 10.0 ** rng.uniform(-140, 140, (2, 200))
            far = sizes * rng.choice(both, (2, 200))
            turned = np.array([near, np.full(len(near), -1.0)])
            return np.concatenate([rng.normal(0.0, 1.0, (2, 300)), far, turned], axis=1)
        case _:
            wide = np.array([10.0 ** rng.uniform(-150, 150, 200), rng.uniform(-2.0, 2.0, 200)])
            steep = np.array([rng.uniform(0.5, 2.0, 200), rng.uniform(-700.0, 700.0, 200)])
            return np.concatenate([wide, steep, [10.0 ** rng.uniform(-3, 3, 200), rng.uniform(-5, 5, 200)]], axis=1)


ELEMENTARY_OF = {"tan": mpmath.tan, "exp": mpmath.exp, "log": mpmath.log, "tanh": mpmath.tanh, "atan": mpmath.atan} | {
    "atan2": mpmath.atan2,
    "pow": mpmath.power,
    "sinh": mpmath.sinh,
    "cosh": mpmath.cosh,
    "asin": mpmath.asin,
    "acos": mpmath.acos,
}


@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("name", ELEMENTARY)
def test_elementary_functions_are_accurate_to_a_unit(name, lanes):
    """To 0.99 of one where products are not rounded on their own, as measured on 1e7 arguments; the tangent to 1.24."""
    columns = spread(name)
    found = machine_code((name,), lanes)(columns)[0]
    worst = 0.0
    with mpmath.workdps(50):
        for value, *at in zip(found, *columns, strict=True):
            exact = ELEMENTARY_OF[name](*map(mpmath.mpf, map(float, at)))
            unit = mpmath.mpf(float(np.spacing(abs(float(exact)))))
            worst = max(worst, abs(float((mpmath.mpf(float(value)) - exact) / unit)))
    most = 1.25 if name == "tan" else 1.0
    assert worst <= (most if is_fused() else most + 1.0)


SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, 1e-310, -1e-310, 2.0**-1022, 1.7976931348623157e308]
SPECIAL += [-745.0, -745.2, -746.0, 709.78, 709.79, 711.0, -720.3, 0.5, 2.0, 3.0, -3.0, 1e-300, 1e300]


@pytest.mark.parametrize("lanes", REPEATED)
@pytest.mark.parametrize("name", ELEMENTARY)
def test_elementary_functions_of_special_values_are_those_of_the_c_library(name, lanes):
    given = np.array(SPECIAL)[np.newaxis]
    if ALL_OPERATIONS[name].arity == 2:
        given = np.array(list(map(np.ravel, np.meshgrid(SPECIAL, SPECIAL))))
    found = machine_code((name,), lanes)(given)[0]
    named = {"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "atan2": np.arctan2, "pow": np.power}
    with np.errstate(all="ignore"):
        expected = named.get(name, getattr(np, name, None))(*given)
    np.testing.assert_array_max_ulp(found, expected, 2)
    numbers = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found[numbers]), np.signbit(expected[numbers]))


@pytest.mark.parametrize("name", ["atan2", "pow"])
def test_an_unusual_argument_changes_no_neighbour(name):
    lanes, x = native_lanes(), spread(name)
    x = x[:, : x.shape[1] // native_lanes() * native_lanes()]
    clean = machine_code((name,), lanes)(x)
    for value in (0.0, -1.0, np.inf, np.nan):
        spoilt = x.copy()
        spoilt[:, 1::lanes] = value
        found = machine_code((name,), lanes)(spoilt)
        others = np.arange(x.shape[1]) % lanes != 1
        np.testing.assert_array_equal(found[:, others], clean[:, others])


@pytest.mark.parametrize("lanes", LANES)
def test_rough_functions_are_as_good_as_they_say(lanes):
    rng = np.random.default_rng(14)
    x = np.concatenate([10.0 ** rng.uniform(-300, 300, 2000), 1.0 + np.linspace(0, 1, 500)])
    assert np.abs(machine_code(("rough_log2",), lanes)(x)[0] - np.log2(x)).max() < 5e-3
    y = np.concatenate([rng.uniform(-1000, 1000, 2000), np.linspace(-2, 2, 500)])
    np.testing.assert_allclose(machine_code(("rough_exp2",), lanes)(y)[0], np.exp2(y), rtol=1e-4)
    ends = machine_code(("rough_exp2",), lanes)([-1e9, -np.inf, 1e9, np.inf])[0]
    assert np.all(ends[:2] < 1e-300) and np.all(ends[2:] > 1e300) and np.all(np.isfinite(ends))
    assert machine_code(("rough_log2",), lanes)([0.0] * lanes)[0, 0] < -1000


def operands(name):
    """Return random operands (arity, 240), special values among them."""
    rng = np.random.default_rng(15)
    arity = ALL_OPERATIONS[name].arity
    columns = rng.uniform(-3.0, 3.0, (arity, 240))
    if name in ("asin", "acos"):
        columns /= 3.0
    if name in ("sqrt", "log", "pow", "rough_log2"):
        columns = np.abs(columns)
    if name in ("select", "less", "less_equal", "sign", "min", "max", "floor"):
        columns[:, ::5] = np.round(columns[:, ::5])
    return columns


@pytest.mark.parametrize("lanes", REPEATED)
@pytest.mark.parametrize("name", NUMERICAL)
def test_every_operation_is_what_the_interpreter_says(name, lanes):
    columns = operands(name)
    found = machine_code((name,), lanes)(columns)[0]
    loads = tuple(Load(f"a{i}", "y", i) for i in range(len(columns)))
    kernel = Kernel("k", ("y",), loads, (Assignment("z", name, tuple(load.target for load in loads)),), ("z",))
    expected = [interpret(kernel, {"y": column.tolist()})[0] for column in columns.T]
    tolerance = {"rough_log2": 0.0, "rough_exp2": 1e-4}.get(name, 1e-15)
    absolute = {"rough_log2": 5e-3, "fma": 2e-15}.get(name, 1e-300)
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=absolute)


@pytest.mark.parametrize("name", NUMERICAL)
def test_every_operation_gives_the_same_bits_in_every_lane(name):
    columns = operands(name)
    alone = machine_code((name,), 1)(columns)
    for lanes in {2, 4, native_lanes()}:
        np.testing.assert_array_equal(machine_code((name,), lanes)(columns), alone)


@pytest.mark.parametrize("lanes", sorted({2, 4, native_lanes()}))
def test_exact_functions_are_those_of_python_however_often_an_argument_repeats(lanes):
    names = ("sin", "cos", "exp", "atan")
    x = np.array([0.2, 0.2, 0.2, 0.2, 0.0, -0.0, 0.0, 0.3, 0.3, -0.3, 0.3, 1e7, 1e7, 1.0, 2.0, 2.0])
    found = machine_code(names, lanes, exact=True)(x)
    expected = [[ALL_OPERATIONS[name].evaluate(float(value)) for value in x] for name in names]
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))
