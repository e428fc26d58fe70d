"""One row an operation: every table covers all of them, and all tables mean the same."""

import functools
import itertools
import math

import numpy as np
import pytest

from dalembert.codegen.printers import JAX, NUMPY, PRINTERS, PYTHON
from dalembert.ir import ieee
from dalembert.ir.interpret import ARRAY_OPERATIONS, interpret, interpret_rows
from dalembert.ir.kernel import Assignment, Kernel, Load, count_operations, describe_counts
from dalembert.ir.ops import CALL_OPERATIONS, OPERATIONS, TABLE_OPERATIONS
from dalembert.transforms.derivatives import RULES
from ir.trees import EXTENDED

approx = functools.partial(pytest.approx, rel=1e-13, abs=1e-15)

TABLES = {
    "derivatives": RULES,
    "arrays": ARRAY_OPERATIONS,
    "extended precision (tests)": EXTENDED,
    **{f"printer {printer.name}": printer.formats for printer in PRINTERS},
}


@pytest.mark.parametrize("table", TABLES)
def test_table_covers_every_operation_and_no_other(table):
    on_tables = {"derivatives": {"table", "surface", "piece", "entry"}, "extended precision (tests)": set()}
    calls = set() if table in ("extended precision (tests)", "printer jax") else set(CALL_OPERATIONS)  # jax refuses
    assert set(TABLES[table]) == set(OPERATIONS) | on_tables.get(table, {"piece", "entry"}) | calls
    assert on_tables["derivatives"] == set(TABLE_OPERATIONS)


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_is_registered_under_its_name(name):
    operation = OPERATIONS[name]
    assert operation.name == name
    assert operation.cost > 0  # what keeps the graph acyclic
    assert operation.flops in (0, 1)


def operands(name):
    arity = OPERATIONS[name].arity
    rows = [(0.31, 0.87, -2.0), (0.5, 0.5, 3.0), (0.0, 1.0, 2.0), (1.0, 0.25, 0.5)]
    if name not in ("sqrt", "log", "pow"):
        rows += [(-0.9, 0.4, 1.0), (-0.5, -0.5, 7.0)]
    if name in ("log", "div", "pow"):
        rows = [row for row in rows if row[0] != 0.0]
    return [row[:arity] for row in rows]


def kernel_of(name):
    arity = OPERATIONS[name].arity
    loads = tuple(Load(f"a{i}", "y", i) for i in range(arity))
    names = tuple(load.target for load in loads)
    return Kernel("outputs", ("t", "y", "c"), loads, (Assignment("z", name, names),), ("z",))


@pytest.mark.parametrize("name", OPERATIONS)
def test_scalar_array_and_extended_meaning_agree(name):
    rows = operands(name)
    expected = [float(EXTENDED[name](*row)) for row in rows]
    scalar = [interpret(kernel_of(name), {"t": 0.0, "y": row, "c": []})[0] for row in rows]
    columns = interpret_rows(kernel_of(name), np.zeros(len(rows)), np.array(rows), np.empty(0))
    assert scalar == approx(expected)
    assert columns[:, 0] == approx(expected)


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize(("printer", "library"), [(PYTHON, math), (NUMPY, ieee)], ids=["python", "numpy"])
def test_printed_python_means_the_same(printer, library, name):
    lines = printer.lines(kernel_of(name))
    for row in operands(name):
        scope = {"math": library, "y": row}
        exec("\n".join(lines), scope)
        assert isinstance(scope["z"], float)
        assert scope["z"] == approx(float(EXTENDED[name](*row)))


@pytest.mark.parametrize("name", OPERATIONS)
def test_printed_jax_means_the_same(name):
    jax = pytest.importorskip("jax")
    from dalembert.jax import functions

    for row in operands(name):
        scope = {"jnp": jax.numpy, "fn": functions, "y": row}
        with jax.enable_x64(True):
            exec("\n".join(JAX.lines(kernel_of(name))), scope)
        assert float(scope["z"]) == approx(float(EXTENDED[name](*row)))


@pytest.mark.parametrize("printer", PRINTERS, ids=lambda printer: printer.name)
@pytest.mark.parametrize("value", [0.1, -0.1, 1e-300, -1e300, 1 / 3, 5e-324, -2.0])
def test_printed_literals_keep_every_digit(printer, value):
    assert eval(printer.operand(value)) == value
    assert eval(f"1.0 - {printer.operand(value)}") == 1.0 - value


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (1.0, 0.0, math.inf),
        (-1.0, 0.0, -math.inf),
        (1.0, -0.0, -math.inf),
        (0.0, 0.0, math.nan),
        (math.nan, 0.0, math.nan),
    ],
)
def test_division_by_zero_is_that_of_ieee_754(a, b, expected):
    assert OPERATIONS["div"].evaluate(a, b) == pytest.approx(expected, nan_ok=True)


def test_operations_are_counted_by_kind_and_as_flops():
    body = (
        Assignment("a", "mul", ("u", "v")),
        Assignment("b", "add", ("a", 1.0)),
        Assignment("c", "div", ("b", "a")),
        Assignment("d", "neg", ("c",)),
        Assignment("e", "sin", ("d",)),
        Assignment("f", "sin", ("c",)),
        Assignment("g", "sqrt", ("f",)),
    )
    loads = (Load("u", "y", 0), Load("v", "y", 1))
    kernel = Kernel("rhs", ("t", "y", "p"), loads, body, ("g", "e"))
    counts = count_operations(kernel)
    assert counts["flops"] == 4
    assert (counts["mul"], counts["add"], counts["div"], counts["neg"], counts["sin"], counts["sqrt"]) == (
        1,
        1,
        1,
        1,
        2,
        1,
    )
    assert describe_counts(kernel) == "4 flops, 2 sin"


OUTSIDE = [
    ("sqrt", (-1.0,), math.nan),
    ("log", (-1.0,), math.nan),
    ("log", (0.0,), -math.inf),
    ("asin", (2.0,), math.nan),
    ("acos", (-2.0,), math.nan),
    ("pow", (-2.0, 0.5), math.nan),
    ("pow", (10.0, 400.0), math.inf),
    ("pow", (0.0, -1.0), math.inf),
    ("exp", (1e4,), math.inf),
    ("cosh", (-1e4,), math.inf),
    ("sinh", (-1e4,), -math.inf),
    ("sin", (math.inf,), math.nan),
    ("floor", (math.nan,), math.nan),
    ("floor", (-math.inf,), -math.inf),
]


@pytest.mark.parametrize(("name", "row", "expected"), OUTSIDE)
def test_outside_of_its_domain_an_operation_is_that_of_ieee_754(name, row, expected):
    """A branch that is not taken must do no harm."""
    wanted = pytest.approx(expected, nan_ok=True)
    assert interpret(kernel_of(name), {"t": 0.0, "y": row, "c": []})[0] == wanted
    assert interpret_rows(kernel_of(name), np.zeros(1), np.array([row]), np.empty(0))[0, 0] == wanted
    scope = {"math": ieee, "y": row}
    exec("\n".join(NUMPY.lines(kernel_of(name))), scope)
    assert scope["z"] == wanted


SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, 3.0, 1e-320, 1e308, -1e308, np.inf, -np.inf, np.nan)


@pytest.mark.parametrize("name", [name for name in OPERATIONS if name in ARRAY_OPERATIONS])
def test_a_single_state_has_the_bits_of_an_array_of_one(name):
    count, random = len(operands(name)[0]), np.random.default_rng(0)
    rows = [*itertools.islice(itertools.product(SPECIAL, repeat=count), 2000)]
    rows += [*(random.normal(size=(200, count)) * 10.0 ** random.integers(-5, 6, (200, 1))).tolist()]
    kernel = kernel_of(name)
    for row in rows:
        with np.errstate(all="ignore"):
            wanted = np.asarray(ARRAY_OPERATIONS[name](*(np.array([number]) for number in row)), dtype=float)
        found = interpret_rows(kernel, np.zeros(1), np.array([row]), np.empty(0))[0]
        np.testing.assert_array_equal(found, wanted, err_msg=str(row))
        if wanted[0] == 0.0:
            assert np.signbit(found[0]) == np.signbit(wanted[0])
