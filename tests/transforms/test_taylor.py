"""Taylor recurrences of every operation, against series computed in extended precision."""

import ctypes
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.llvm import target as lane_types
from dalembert.codegen.llvm.assembly import assembly, compile_object, load_object
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.llvm.order_loops import order_loop_assembly
from dalembert.codegen.llvm.pair_printer import in_order
from dalembert.codegen.llvm.series_loops import series_loop_assembly
from dalembert.codegen.llvm.target import native_lanes
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Assignment
from dalembert.ir.ops import OPERATIONS
from dalembert.transforms.lower_kernels import lower_kernel
from dalembert.transforms.taylor.expansion import FAITHFUL_ORDER
from dalembert.transforms.taylor.order_pass import LEAST_ORDER
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import order_for, paired_step, series_kernel, step_kernel
from ir.trees import EXTENDED

ORDER = 9
X, Y = "x", "y"

# a function of the two components of the state; each must be smooth at (0.7, 0.4)
FUNCTIONS = {
    "add": lambda g, x, y: x + y,
    "sub": lambda g, x, y: x - y,
    "mul": lambda g, x, y: x * y,
    "div": lambda g, x, y: x / y,
    "neg": lambda g, x, y: -x,
    "sqrt": lambda g, x, y: g.call("sqrt", x),
    "pow": lambda g, x, y: g.call("pow", x, y),
    "sin": lambda g, x, y: g.sin(x),
    "cos": lambda g, x, y: g.cos(x),
    "tan": lambda g, x, y: g.call("tan", x),
    "asin": lambda g, x, y: g.call("asin", x),
    "acos": lambda g, x, y: g.call("acos", x),
    "atan": lambda g, x, y: g.call("atan", x),
    "atan2": lambda g, x, y: g.call("atan2", x, y),
    "exp": lambda g, x, y: g.call("exp", x),
    "log": lambda g, x, y: g.call("log", x),
    "sinh": lambda g, x, y: g.call("sinh", x),
    "cosh": lambda g, x, y: g.call("cosh", x),
    "tanh": lambda g, x, y: g.call("tanh", x),
    "abs": lambda g, x, y: g.call("abs", -x),
    "sign": lambda g, x, y: g.call("sign", x) * y,
    "floor": lambda g, x, y: g.call("floor", x) + y,
    "min": lambda g, x, y: g.call("min", x, y),
    "max": lambda g, x, y: g.call("max", x, y),
    "less": lambda g, x, y: g.call("less", x, y) + y,
    "less_equal": lambda g, x, y: g.call("less_equal", y, x) * x,
    "select": lambda g, x, y: g.call("select", g.call("less", y, x), x * y, x + y),
}


def with_a_constant(name, place, value):
    """Return a function whose operand at `place` does not vary: a number, or a parameter."""

    def function(g, x, y):
        operands = [x * y + 1, y + 2, x][: OPERATIONS[name].arity]
        operands[place] = g.input("c0") if value == "c0" else g.node(value)
        return g.call(name, *operands) + y

    return function


WITH_CONSTANTS = {
    f"{name} {place} {value}": with_a_constant(name, place, value)
    for name, operation in OPERATIONS.items()
    if operation.arity > 1
    for place in range(operation.arity)
    for value in (2.0, "c0")
}


def constants(g, x, y):
    """Return a function with every operation that can have a constant operand."""
    return g.sum(function(g, x, y) for function in WITH_CONSTANTS.values()) * g.node(1 / 64)


def everything(g, x, y):
    """Return a function with sums of every kind, more than fill a pack."""
    angle, root = g.sin(x * y), g.call("sqrt", x + y * y)
    quotient = (x - angle) / (root * g.call("exp", y))
    return quotient * angle + g.cos(y) * root - (x * x) * (quotient * quotient) + g.call("log", x) * angle * 0.5 - x


def poles(g, x, y):
    """Return inverse powers that are nothing as yet, and within the reach of whose series steps stay."""
    a, b = x - 0.5, y - 0.5
    return g.node(1e-30) * (a / g.power(a * a + b * b, 7) - 1 / g.power(y - 9, 9))


def lengths(g, x, y):
    """Return what has three lengths, two of which vanish soon: x falls through 0.6, y through 0.2."""
    near = g.call("sqrt", g.power(x - g.node(0.6), 2)) + g.call("sqrt", g.power(y - g.node(0.2), 2))
    return near * g.node(1 / 256) + g.call("sqrt", 1 + x * x) - g.node(4.0)


SCENES = (
    FUNCTIONS | WITH_CONSTANTS | {"everything": everything, "constants": constants, "poles": poles, "lengths": lengths}
)


def kernel_of(function):
    graph = Graph()
    x, y = graph.input(X), graph.input(Y)
    t, c = graph.input("t"), graph.input("c0")
    f = function(graph, x, y)
    rates = [c * f + graph.sin(t) / 3, y * x * graph.node(0.5) - f * f]
    inputs = {x: ("y", 0), y: ("y", 1), t: ("t", None), c: ("c", 0)}
    return lower_kernel(graph, "rhs", rates, inputs, arguments=("t", "y", "c"))


def residual(kernel, coefficients, t0, c, h):
    """Return how far the polynomial with these coefficients is from solving the equations at t0 + h."""
    with mpmath.workdps(40):
        h = mpmath.mpf(h)
        y = [sum(mpmath.mpf(a) * h**k for k, a in enumerate(row)) for row in coefficients]
        slope = [sum(k * mpmath.mpf(a) * h ** (k - 1) for k, a in enumerate(row) if k) for row in coefficients]
        c = [mpmath.mpf(value) for value in c]
        rates = interpret(kernel, {"t": mpmath.mpf(t0) + h, "y": y, "c": c}, EXTENDED, literal=mpmath.mpf)
        return float(max(abs(a - b) for a, b in zip(slope, rates, strict=True)))


def test_every_operation_has_a_case():
    assert set(FUNCTIONS) == set(OPERATIONS) == set(EXTENDED)


@pytest.mark.parametrize(
    "name, order",
    [(name, order) for name in FUNCTIONS for order in (2, 3, 5, 7)] + [(name, 4) for name in WITH_CONSTANTS],
)
def test_series_solves_the_equations_to_its_order(name, order):
    kernel = kernel_of(SCENES[name])
    t0, y0, c = 0.3, [0.7, 0.4], [0.8]
    flat = interpret(series_kernel(recurrences(kernel), order), {"t": t0, "y": y0, "c": c})
    coefficients = np.reshape(flat, (2, order + 1))
    h = 0.1
    while residual(kernel, coefficients, t0, c, h) > 1e-7:
        h /= 2
    large, small = (residual(kernel, coefficients, t0, c, x) for x in (h, h / 2))
    assert large / small > 2 ** (order - 0.5) or small < 3e-15


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_step_sums_its_series(name):
    step = step_kernel(recurrences(kernel_of(FUNCTIONS[name])), ORDER, dense=True)
    h = 0.002
    out = interpret(step, {"t": 0.3, "y": [0.7, 0.4, h], "c": [0.8], "s": [h, -1.0, 1.0]})
    assert out[2] == h and out[3] == 0.0
    series = np.reshape(out[4:], (2, ORDER + 1))
    assert np.allclose(out[:2], series @ (-h) ** np.arange(ORDER + 1), rtol=4e-16, atol=0)


def outcomes(texts, count, lanes, largest=0.002):
    """Return what modules with one step each make of the same states: outputs (count, lanes) of each.

    The states (3, lanes) have two components, and behind them the size of the step before.
    """
    rng = np.random.default_rng(5)
    t, c = np.full((1, lanes), 0.3), np.full((1, lanes), 0.8)
    y = np.array([[0.7], [0.4], [1.0]]) + 0.05 * rng.random((3, lanes))
    s = np.array([[largest], [1.0], [1.0]]) * np.ones(lanes)
    results = []
    for text in texts:
        code = load_object(compile_object(with_definitions(text)))
        run = ctypes.CFUNCTYPE(None, *(ctypes.c_void_p,) * 5)(code.address("step"))
        out = np.zeros((count, lanes))
        run(*(a.ctypes.data for a in (t, y, c, s, out)))
        results.append(out)
    return results, y, c, s


@pytest.mark.parametrize("lanes", [1, "native"])
@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("name", [*FUNCTIONS, "constants"])
def test_loops_and_unrolled_code_agree(name, dense, lanes):
    lanes = native_lanes() if lanes == "native" else 1
    known = recurrences(kernel_of(SCENES[name]))
    step = step_kernel(known, ORDER, dense=dense)
    texts = (assembly([("step", step)], lanes), series_loop_assembly("step", known, ORDER, lanes, dense=dense))
    results, y, c, s = outcomes(texts, len(step.outputs), lanes)
    reference = np.transpose(
        [
            interpret(step, {"t": 0.3, "y": y[:, k].tolist(), "c": c[:, k].tolist(), "s": s[:, k].tolist()})
            for k in range(lanes)
        ]
    )
    scale = np.abs(reference).max(axis=1, keepdims=True) + 1e-3
    assert np.all(np.abs(results[0] - reference) <= 1e-12 * scale)
    assert np.all(np.abs(results[1] - reference) <= 1e-12 * scale)


SHAPES = [(1, 1), (1, 2), (1, 4), (1, 8), (4, 1)]
ORDERS = [LEAST_ORDER, LEAST_ORDER + 1, FAITHFUL_ORDER + 1]


@pytest.mark.parametrize(
    "name, order, lanes, width",
    [(name, ORDER, 1, 4) for name in (*FUNCTIONS, "constants", "poles", "lengths")]
    + [("everything", order, *shape) for order in ORDERS for shape in SHAPES]
    + [(name, order, 4, 1) for name in ("poles", "lengths") for order in ORDERS],
)
def test_a_loop_over_the_orders_gives_the_bits_of_unrolled_code(name, order, lanes, width):
    known = recurrences(kernel_of(SCENES[name]))
    step = step_kernel(known, order, dense=True)
    loop = order_loop_assembly("step", known, order, lanes, width, dense=True)
    (unrolled, looped), *_ = outcomes((assembly([("step", step)], lanes), loop), len(step.outputs), lanes)
    np.testing.assert_array_equal(looped, unrolled)


@pytest.mark.parametrize("name", [*FUNCTIONS, "constants", "poles", "lengths", "everything"])
@pytest.mark.parametrize("order", ORDERS)
def test_pairs_of_operations_give_the_bits_of_operations_one_by_one(name, order):
    known = recurrences(kernel_of(SCENES[name]))
    step, pairs = paired_step(known, order, dense=True)
    assert pairs
    texts = [assembly([("step", step)], 1, pairs=each) for each in (None, pairs)]
    (alone, together), *_ = outcomes(texts, len(step.outputs), 1)
    np.testing.assert_array_equal(together, alone)


def test_most_operations_of_a_step_go_in_pairs():
    known = recurrences(da.compile_model(da.scenes.rolling_sphere()).stages.program.kernel("rhs"))
    step, pairs = paired_step(known, 19, dense=False)
    assert len(pairs) > 0.75 * len(step.body)
    text = assembly([("step", step)], 1, pairs=pairs)
    assert text.count(" = call <2 x double> @llvm.fm") > 0.35 * sum(line.op == "fma" for line in step.body)


def test_pairs_that_need_each_other_are_an_error():
    lines = [Assignment(name, "neg", (of,)) for name, of in (("a", "x"), ("b", "a"), ("c", "x"), ("d", "c"))]
    pairs = {"a": ("a", "d"), "d": ("a", "d"), "b": ("b", "c"), "c": ("b", "c")}
    with pytest.raises(AssertionError, match="need each other"):
        in_order(lines, pairs)
    assert [line.target for line in in_order(lines, {"a": ("a", "c"), "c": ("a", "c")})] == ["a", "c", "b", "d"]


@pytest.mark.parametrize("order", [4, 5, ORDER])
def test_steps_stay_within_the_reach_of_poles(order):
    """In every form of a step; the rest of the rates would allow for more."""
    known = recurrences(kernel_of(poles))
    step = step_kernel(known, order, dense=False)
    without = step_kernel(replace(known, poles=()), order, dense=False)
    texts = [assembly([("step", step)], 1), series_loop_assembly("step", known, order, 1, dense=False)]
    if order >= LEAST_ORDER:
        texts.append(order_loop_assembly("step", known, order, 1, 4, dense=False))
    (free, *held), *_ = outcomes([assembly([("step", without)], 1), *texts], 4, 1, largest=5.0)
    for out in held:
        assert 0.05 < out[2, 0] < 0.9 * free[2, 0]
        np.testing.assert_allclose(out, held[0], rtol=1e-9)


@pytest.mark.parametrize("order", [4, 5, ORDER])
def test_steps_end_where_the_first_of_the_lengths_vanishes(order):
    """In every form of a step, most of the way to the zero, and not past it."""
    known = recurrences(kernel_of(lengths))
    assert len(known.roots) == 3
    step = step_kernel(known, order, dense=False)
    without = step_kernel(replace(known, roots=()), order, dense=False)
    texts = [assembly([("step", step)], 1), series_loop_assembly("step", known, order, 1, dense=False)]
    if order >= LEAST_ORDER:
        texts.append(order_loop_assembly("step", known, order, 1, 4, dense=False))
    (free, *held), y, *_ = outcomes([assembly([("step", without)], 1), *texts], 4, 1, largest=0.5)
    assert free[0, 0] < 0.6 < y[0, 0] and free[1, 0] < 0.2 < y[1, 0]
    for out in held:
        assert 0.6 < out[0, 0] and 0.2 < out[1, 0] < 0.2 + 0.3 * (y[1, 0] - 0.2)
        np.testing.assert_allclose(out, held[0], rtol=1e-9)


@pytest.mark.parametrize("value", ["x", "1 + x", "x + c0", "2 + x + y"])
def test_roots_are_watched(value):
    """Those of squares and a positive number, too: without it their series would come to zero."""
    graph = Graph()
    x, y, c0 = graph.input(X), graph.input(Y), graph.input("c0")
    terms = {"x": x * x, "y": y * y, "c0": c0 * c0}
    total = graph.sum(terms[term] if term in terms else graph.node(int(term)) for term in value.split(" + "))
    inputs = {x: ("y", 0), y: ("y", 1), c0: ("c", 0)}
    kernel = lower_kernel(graph, "rhs", [graph.call("sqrt", total), x], inputs, arguments=("t", "y", "c"))
    assert len(recurrences(kernel).roots) == 1


def test_a_loop_over_the_orders_squares_what_does_not_move():
    graph = Graph()
    x, y = graph.input(X), graph.input(Y)
    kernel = lower_kernel(
        graph, "rhs", [y * y * x, graph.node(0.0)], {x: ("y", 0), y: ("y", 1)}, arguments=("t", "y", "c")
    )
    known = recurrences(kernel)
    step = step_kernel(known, ORDER, dense=True)
    loop = order_loop_assembly("step", known, ORDER, 1, 4, dense=True)
    (unrolled, looped), *_ = outcomes((assembly([("step", step)], 1), loop), len(step.outputs), 1)
    np.testing.assert_array_equal(looped, unrolled)


def test_what_a_loop_over_the_orders_does_not_write():
    known = recurrences(kernel_of(everything))
    short, long = (order_loop_assembly("step", known, ORDER, 1, 4, dense=dense) for dense in (False, True))
    (alone, beside), *_ = outcomes((short, long), 4 + 2 * (ORDER + 1), 1)
    np.testing.assert_array_equal(alone[:4], beside[:4])
    assert np.all(alone[4:] == 0.0) and np.all(beside[4:8] != 0.0)


def test_rows_that_outgrow_the_stack_lie_elsewhere(monkeypatch):
    known = recurrences(kernel_of(everything))
    near = order_loop_assembly("step", known, ORDER, 1, 4, dense=True)
    monkeypatch.setattr(lane_types, "_LARGEST_FRAME", 0)
    far = order_loop_assembly("step", known, ORDER, 1, 4, dense=True)
    assert "call ptr @malloc" in far and "call ptr @malloc" not in near
    (one, other), *_ = outcomes((near, far), 4 + 2 * (ORDER + 1), 1)
    np.testing.assert_array_equal(one, other)


def test_order_grows_with_the_digits_asked_for():
    assert [order_for(tolerance) for tolerance in (1e-6, 1e-9, 1e-12)] == [10, 14, 19]
    assert order_for(0.5) == 6
