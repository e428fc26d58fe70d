"""No form that is chosen for a value loses digits that the expression as it was written has."""

import random
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from dalembert.ir import accuracy
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.ir.node import unit_names
from dalembert.ir.ops import OPERATIONS
from dalembert.transforms.lower_kernels import lower_kernel
from ir.trees import EXTENDED, OutOfDomain, build

NAMES = ("x", "y", "a")
EPSILON = 2.0**-53
ONE, HALF = Fraction(1), Fraction(1, 2)


def square(u):
    return ("mul", u, u)


def half(u):
    return ("mul", HALF, u)


# equal values, of which the first form is the most accurate one
PAIRS = {
    "haversine": (
        lambda u, v: ("mul", Fraction(2), square(("sin", half(u)))),
        lambda u, v: ("sub", ONE, ("cos", u)),
        lambda u, v: ("div", square(("sin", u)), ("add", ONE, ("cos", u))),
    ),
    "sine squared": (lambda u, v: square(("sin", u)), lambda u, v: ("sub", ONE, square(("cos", u)))),
    "cosine squared": (lambda u, v: square(("cos", u)), lambda u, v: ("sub", ONE, square(("sin", u)))),
    "difference of squares": (
        lambda u, v: ("mul", ("sub", u, v), ("add", u, v)),
        lambda u, v: ("sub", square(u), square(v)),
    ),
    "tangent squared": (
        lambda u, v: square(("tan", u)),
        lambda u, v: ("sub", ("div", ONE, square(("cos", u))), ONE),
    ),
    "factor of a sum": (
        lambda u, v: ("mul", ("sub", u, v), ("add", ONE, square(u))),
        lambda u, v: ("sub", ("add", u, ("mul", u, square(u))), ("add", v, ("mul", v, square(u)))),
    ),
    "quotient": (
        lambda u, v: ("sub", u, v),
        lambda u, v: ("div", ("sub", square(u), square(v)), ("add", u, v)),
    ),
}


def random_tree(draw, depth):
    """Return a random expression in which much may cancel."""
    if depth == 0 or draw.random() < 0.2:
        return draw.choice(NAMES)
    u, v = random_tree(draw, depth - 1), random_tree(draw, depth - 1)
    kind = draw.choice(("pair", "pair", "add", "sub", "sub", "mul", "mul", "sin", "cos", "neg", "half"))
    match kind:
        case "pair":
            return draw.choice(draw.choice(list(PAIRS.values())))(u, v)
        case "half":
            return half(u)
        case "sin" | "cos" | "neg":
            return (kind, u)
    return (kind, u, v)


def random_point(draw):
    """Return inputs near each other, or near what is special, at a random distance."""
    distance = 10.0 ** draw.uniform(-12.0, -2.0)
    centres = (0.0, np.pi / 2, np.pi, 0.6180339887)
    return {name: draw.choice(centres) + distance * draw.uniform(-1.0, 1.0) for name in NAMES}


def bounded(tree, point):
    """Return the value of a tree, and what rounding of its operations makes of it to first order."""
    if isinstance(tree, str):
        return mpmath.mpf(point[tree]), mpmath.mpf(0)
    if isinstance(tree, Fraction):
        return mpmath.mpf(tree.numerator) / tree.denominator, mpmath.mpf(0)
    op, *children = tree
    parts = [bounded(child, point) for child in children]
    values = [value for value, _ in parts]
    value, error, step = EXTENDED[op](*values), mpmath.mpf(0), mpmath.mpf(10) ** -30
    for place, (_, own) in enumerate(parts):
        moved = [*values[:place], values[place] + step, *values[place + 1 :]]
        error += abs((EXTENDED[op](*moved) - value) / step) * own
    return value, error + EPSILON * abs(value)


def computed(graph, nodes, point, fixed=None):
    inputs = {graph.input(name): ("y", place) for place, name in enumerate(NAMES)}
    kernel = lower_kernel(graph, "rhs", nodes, inputs, arguments=("t", "y", "c"), fixed=fixed)
    return interpret(kernel, {"t": 0.0, "y": [point[name] for name in NAMES], "c": []})


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("name", PAIRS)
def test_the_most_accurate_form_that_is_written_stays(name, order):
    graph = Graph()
    graph.written = True
    trees = [pair("x", "y") for pair in PAIRS[name]]
    nodes = [build(graph, tree) for tree in trees[::order]]
    assert len(set(nodes)) == 1
    draw = random.Random(name)
    with mpmath.workdps(80):
        for _ in range(20):
            point = random_point(draw)
            value, error = bounded(trees[0], point)
            for fixed in (None, [graph.input("a")]):
                (found,) = computed(graph, nodes[:1], point, fixed)
                assert abs(found - value) <= 40 * error, (point, found)


@pytest.mark.parametrize("seed", range(60))
def test_random_expressions_lose_nothing(seed):
    draw = random.Random(seed)
    graph = Graph()
    graph.written = True
    trees = [random_tree(draw, 3) for _ in range(3)]
    try:
        nodes = [build(graph, tree) for tree in trees]
    except OutOfDomain:
        return
    with mpmath.workdps(80):
        for _ in range(12):
            point = random_point(draw)
            try:
                expected = [bounded(tree, point) for tree in trees]
            except ZeroDivisionError:
                continue
            for fixed in (None, [graph.input("a")]):
                for tree, found, (value, error) in zip(
                    trees, computed(graph, nodes, point, fixed), expected, strict=True
                ):
                    if error < 1e-6 * abs(value):
                        assert abs(found - value) <= 200 * error + 1e-300, (tree, point, found)


def test_the_vector_of_a_unit_quaternion_keeps_its_digits_near_the_identity():
    graph = Graph()
    e = [graph.input(name) for name in unit_names(["e0", "e1", "e2", "e3"])]
    turned = graph.sum(x * x for x in e[1:])
    assert 1 - e[0] * e[0] is turned
    inputs = {node: ("y", place) for place, node in enumerate(e)}
    kernel = lower_kernel(graph, "rhs", [turned], inputs, arguments=("t", "y", "c"))
    small = [1.0, 3e-9, -4e-9, 0.0]
    assert interpret(kernel, {"t": 0.0, "y": small, "c": []}) == [pytest.approx(2.5e-17, rel=1e-12)]


def test_costs_stay_above_those_of_operands_when_a_dearer_form_is_taken():
    graph = Graph()
    x, y = graph.input("x"), graph.input("y")
    lossy = 1 - graph.cos(x)
    users = [lossy * y, graph.sin(lossy), graph.sin(lossy) + lossy * y]
    graph.written = True
    sine = graph.sin(graph.node(HALF) * x)
    assert 2 * (sine * sine) is lossy and lossy.op == "mul"
    for node in (*users, lossy, *graph.nodes):
        assert all(arg.cost < node.cost for arg in node.args)


def test_every_operation_has_a_rule():
    graph = Graph()
    operands = [graph.input("p"), graph.input("q"), graph.input("r")]
    known = {node.index: accuracy.probed(node, {}) for node in operands}
    for name, operation in OPERATIONS.items():
        value, error = accuracy.probed_form(name, tuple(operands[: operation.arity]), known)
        assert value.shape == error.shape
        finite = np.isfinite(value)
        with np.errstate(all="ignore"):
            rows = zip(*(known[node.index][0] for node in operands[: operation.arity]), strict=True)
            right = np.array([operation.evaluate(*map(float, row)) for row in rows])
        np.testing.assert_allclose(value[finite], right[finite], rtol=1e-13)
        assert np.all(error[finite & np.isfinite(error)] >= 0.0)
