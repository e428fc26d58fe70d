"""Derivatives, forward and reverse, operation by operation and on random expressions."""

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings

from dalembert.ir.graph import Graph
from dalembert.ir.ops import GRAPH_OPERATIONS, OPERATIONS
from dalembert.transforms.derivatives import GUARDED, RULES, cotangents, jacobian, tangents
from ir.trees import EXTENDED, POINT, TREES, OutOfDomain, build, evaluate, extended

#: Points inside each operation's domain, away from its kinks and jumps.
POINTS = {
    1: [(0.31,), (-0.72,)],
    2: [(0.31, 0.87), (1.4, 0.55), (-0.6, 0.2), (0.3, -1.7)],
    3: [(0.0, 0.4, 1.9), (1.0, 0.4, 1.9)],
}
POSITIVE = {"sqrt", "log", "pow"}


def cases() -> list:
    found = []
    for name, operation in OPERATIONS.items():
        for point in POINTS[operation.arity]:
            if not (name in POSITIVE and point[0] <= 0):
                found.append(pytest.param(name, point, id=f"{name}{point}"))
    return found


def difference(function, point, direction):
    """Return a directional derivative in extended precision."""
    with mpmath.workdps(60):
        h = mpmath.mpf("1e-20")
        above = [mpmath.mpf(x) + h * d for x, d in zip(point, direction, strict=True)]
        below = [mpmath.mpf(x) - h * d for x, d in zip(point, direction, strict=True)]
        return float((function(*above) - function(*below)) / (2 * h))


@pytest.mark.parametrize(("name", "point"), cases())
def test_rule_is_the_derivative(name, point):
    graph = Graph()
    inputs = [graph.input(f"a{i}") for i in range(len(point))]
    node = graph.call(name, *inputs)
    named = {f"a{i}": value for i, value in enumerate(point)}
    for place in range(len(point)):
        (slope,) = tangents(graph, [node], {inputs[place]: graph.one})
        expected = difference(EXTENDED[name], point, [i == place for i in range(len(point))])
        if name == "select" and place == 0:  # the condition jumps
            expected = 0.0
        assert evaluate(graph, [slope], named)[0] == pytest.approx(expected, rel=1e-13, abs=1e-14)
    weights = [0.7, -1.3, 0.4][: len(point)]
    if name == "select":
        weights[0] = 0.0
    seeds = {node: graph.const(w) for node, w in zip(inputs, weights, strict=True)}
    reverse = cotangents(graph, [node], [graph.one], inputs)
    forward = [tangents(graph, [node], {source: graph.one})[0] for source in inputs]
    assert evaluate(graph, reverse, named) == pytest.approx(evaluate(graph, forward, named), rel=1e-13, abs=1e-14)
    (directional,) = tangents(graph, [node], seeds)
    expected = difference(EXTENDED[name], point, weights)
    assert evaluate(graph, [directional], named)[0] == pytest.approx(expected, rel=1e-13, abs=1e-14)


def test_every_operation_has_a_rule():
    assert set(RULES) == set(GRAPH_OPERATIONS)


ANALYTIC = {
    "sin(x y) exp(-x)": lambda m, x, y: m["sin"](x * y) * m["exp"](-x),
    "root and quotient": lambda m, x, y: m["sqrt"](1 + x * x + y * y) / (2 + m["cos"](x)),
    "tan of tanh": lambda m, x, y: m["tan"](m["tanh"](x) + y / 3),
    "log of cosh": lambda m, x, y: m["log"](m["cosh"](x + y) + m["sinh"](x) * m["sinh"](x)),
}
NUMPY = {name: getattr(np, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "cosh", "sinh")}


@pytest.mark.parametrize("name", ANALYTIC)
def test_compositions_agree_with_the_complex_step(name):
    graph = Graph()
    operations = {op: lambda *a, op=op: graph.call(op, *a) for op in NUMPY}
    x, y = graph.input("x"), graph.input("y")
    node = ANALYTIC[name](operations, x, y)
    slopes = jacobian(graph, [node], [x, y])[0]
    actual = evaluate(graph, slopes, {"x": 0.4, "y": 1.1})
    h = 1e-30
    expected = [
        ANALYTIC[name](NUMPY, 0.4 + 1j * h, 1.1 + 0j).imag / h,
        ANALYTIC[name](NUMPY, 0.4 + 0j, 1.1 + 1j * h).imag / h,
    ]
    assert actual == pytest.approx(expected, rel=1e-13)


def test_reverse_mode_weighs_outputs_and_counts_what_is_used_twice():
    graph = Graph()
    x, y, v, w = (graph.input(name) for name in "xyvw")
    outputs = [x * y + graph.sin(x * y), x, graph.const(3), x]
    found = cotangents(graph, outputs, [v, w, v, v], [x, y, w])
    at = {"x": 0.4, "y": 1.1, "v": -0.7, "w": 1.9}
    slope = -0.7 * (1 + np.cos(0.44))
    assert evaluate(graph, found, at) == pytest.approx([1.1 * slope + 1.9 - 0.7, 0.4 * slope, 0.0], rel=1e-14)


def test_reverse_mode_at_a_root_of_zero_gives_no_nan():
    graph = Graph()
    x, v = graph.input("x"), graph.input("v")
    found = cotangents(graph, [graph.call("sqrt", x * x)], [v], [x], GUARDED)
    assert evaluate(graph, found, {"x": 0.0, "v": 1.0}) == [0.0]


def test_reverse_mode_takes_a_few_times_the_operations_whatever_the_number_of_inputs():
    graph = Graph()
    inputs = [graph.input(f"x{i}") for i in range(20)]
    value = graph.one
    for source in inputs:
        value = graph.sin(value * source) + source
    found = cotangents(graph, [value], [graph.one], inputs)
    assert len(list(graph.topological(found))) <= 4 * len(list(graph.topological([value])))


def test_constants_and_inputs_that_are_not_seeded_have_no_rate():
    graph = Graph()
    x, y = graph.input("x"), graph.input("y")
    assert [d.is_zero for d in tangents(graph, [y, graph.const(3), x * y, x], {x: graph.zero})] == [True] * 4
    assert tangents(graph, [x * y], {x: graph.one})[0] is y
    assert tangents(graph, [x, x], {x: y}) == [y, y]


def test_second_derivatives_commute_and_are_identified():
    graph = Graph()
    x, y = graph.input("x"), graph.input("y")
    node = graph.sin(x * y) / (1 + x * x)
    (by_x,) = tangents(graph, [node], {x: graph.one})
    (by_y,) = tangents(graph, [node], {y: graph.one})
    assert tangents(graph, [by_x], {y: graph.one})[0] is tangents(graph, [by_y], {x: graph.one})[0]


@settings(max_examples=60)
@given(TREES)
def test_random_expressions_differentiate_to_their_slope(tree):
    graph = Graph()
    with mpmath.workdps(60):
        point = {name: mpmath.mpf(value) for name, value in POINT.items()}
        h = mpmath.mpf("1e-18")
        try:
            node = build(graph, tree)
            slopes = [tangents(graph, [node], {graph.input(name): graph.one})[0] for name in point]
            expected = []
            for name in point:
                ends = [extended(tree, {**point, name: point[name] + step}) for step in (-h, h)]
                expected.append((ends[1] - ends[0]) / (2 * h))
            middle = extended(tree, point)
        except (OutOfDomain, ZeroDivisionError):
            assume(False)
        # a kink between the two ends shows as a slope that the two halves do not share
        for name, slope in zip(point, expected, strict=True):
            half = (extended(tree, {**point, name: point[name] + h}) - middle) / h
            assume(abs(half - slope) < 1e-6 * max(1, abs(slope)))
        assume(all(abs(slope) < 1e6 for slope in expected))
        try:
            actual = evaluate(graph, slopes, point)
        except (ZeroDivisionError, OverflowError):
            assume(False)  # a function at the edge of its domain, such as sqrt(0) times 0
        for a, b in zip(actual, expected, strict=True):
            assert abs(a - b) <= 1e-8 * max(1, abs(b))
