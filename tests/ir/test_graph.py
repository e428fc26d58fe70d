"""What the graph identifies, and what it must not."""

import math
from fractions import Fraction

import mpmath
import pytest
from hypothesis import assume, given, settings

from dalembert.ir import fingerprint as fp
from dalembert.ir.graph import Graph
from dalembert.ir.random_points import values_of
from dalembert.transforms.derivatives import tangents
from ir.trees import NAMES, POINT, TREES, OutOfDomain, build, evaluate, extended

HALF = Fraction(1, 2)


@pytest.fixture
def g():
    return Graph()


@pytest.fixture
def x(g):
    return g.input("x")


@pytest.fixture
def y(g):
    return g.input("y")


@pytest.fixture
def z(g):
    return g.input("z")


def assert_acyclic(graph):
    for node in graph.nodes:
        for arg in node.args:
            assert arg.cost < node.cost, f"{node!r} costs {node.cost}, its operand {arg!r} {arg.cost}"


IDENTITIES = {
    "Pythagoras": lambda g, x, y: (g.sin(x) * g.sin(x) + g.cos(x) * g.cos(x), g.one),
    "Pythagoras of a sum": lambda g, x, y: (g.sin(x + y) * g.sin(x + y), 1 - g.cos(x + y) * g.cos(x + y)),
    "Pythagoras of a product": lambda g, x, y: (g.sin(x * y) * g.sin(x * y), 1 - g.cos(y * x) * g.cos(y * x)),
    "sine of a sum": lambda g, x, y: (g.sin(x + y), g.sin(x) * g.cos(y) + g.cos(x) * g.sin(y)),
    "sine of a difference": lambda g, x, y: (g.sin(x - y), g.sin(x) * g.cos(y) - g.cos(x) * g.sin(y)),
    "cosine of a sum": lambda g, x, y: (g.cos(x + y), g.cos(x) * g.cos(y) - g.sin(x) * g.sin(y)),
    "cosine of a difference": lambda g, x, y: (g.cos(y - x), g.cos(x) * g.cos(y) + g.sin(x) * g.sin(y)),
    "double angle": lambda g, x, y: (g.sin(2 * x), 2 * g.sin(x) * g.cos(x)),
    "triple angle": lambda g, x, y: (g.cos(3 * x), 4 * g.cos(x) * g.cos(x) * g.cos(x) - 3 * g.cos(x)),
    "half angle, cosine": lambda g, x, y: (g.cos(x), 2 * g.cos(x / 2) * g.cos(x / 2) - 1),
    "half angle, sine": lambda g, x, y: (g.sin(x), 2 * g.sin(x / 2) * g.cos(g.const(HALF) * x)),
    "third of an angle": lambda g, x, y: (
        g.sin(x),
        3 * g.sin(x / 3) - 4 * g.sin(x / 3) * g.sin(x / 3) * g.sin(x / 3),
    ),
    "halves of a sum": lambda g, x, y: (
        g.sin(x) + g.sin(y),
        2 * g.sin(x / 2 + y / 2) * g.cos(x / 2 - y / 2),
    ),
    "angle of a negative": lambda g, x, y: (g.sin(-x) * g.cos(-x), -(g.sin(x) * g.cos(x))),
    "tangent": lambda g, x, y: (g.call("tan", x) * g.cos(x), g.sin(x)),
    "tangent of a sum": lambda g, x, y: (
        g.call("tan", x + y),
        (g.call("tan", x) + g.call("tan", y)) / (1 - g.call("tan", x) * g.call("tan", y)),
    ),
    "commuted sum": lambda g, x, y: (x + y, y + x),
    "commuted product": lambda g, x, y: (x * y, y * x),
    "re-associated product": lambda g, x, y: ((x * y) * (x * y), x * (y * (x * y))),
    "distributed": lambda g, x, y: ((x + y) * (x - y), x * x - y * y),
    "cancelled sum": lambda g, x, y: (x * y - y * x, g.zero),
    "cancelled quotient": lambda g, x, y: (x * y / y, x),
    "cancelled factor": lambda g, x, y: ((x * x - y * y) / (x - y), x + y),
    "common denominator": lambda g, x, y: (1 / x + 1 / y, (x + y) / (x * y)),
    "double negative": lambda g, x, y: (g.neg(g.neg(x)), x),
    "negated difference": lambda g, x, y: (-(x - y), y - x),
    "exact rationals": lambda g, x, y: (x / 3 + x / 6, x / 2),
    "square of a root, in any order": lambda g, x, y: (
        (x * g.call("sqrt", x + y)) * g.call("sqrt", y + x),
        x * (g.call("sqrt", y + x) * g.call("sqrt", x + y)),
    ),
    "product of numeric roots": lambda g, x, y: (
        g.call("sqrt", g.const(2)) * g.call("sqrt", g.const(3)),
        g.call("sqrt", g.const(6)),
    ),
    "root with a square factor": lambda g, x, y: (g.call("sqrt", g.const(12)), 2 * g.call("sqrt", g.const(3))),
    "root of a quotient": lambda g, x, y: (
        g.call("sqrt", g.const(HALF)) * g.call("sqrt", g.const(2)),
        g.one,
    ),
    "root of a square number": lambda g, x, y: (g.call("sqrt", g.const(Fraction(9, 4))), g.const(Fraction(3, 2))),
    "rational power": lambda g, x, y: (g.power(x, Fraction(5, 2)), x * x * g.call("sqrt", x)),
    "negative power": lambda g, x, y: (g.power(x, Fraction(-2)), 1 / (x * x)),
    "the same branches": lambda g, x, y: (g.call("select", g.call("less", x, y), x, x), x),
    "function of equal arguments": lambda g, x, y: (g.call("exp", x + y), g.call("exp", y + x)),
}


@pytest.mark.parametrize("name", IDENTITIES)
def test_equal_values_are_one_node(g, x, y, name):
    a, b = IDENTITIES[name](g, x, y)
    assert a is b
    assert_acyclic(g)


@pytest.mark.parametrize("name", IDENTITIES)
def test_identities_hold_numerically(g, x, y, name):
    """The table above is itself right: both sides, built on graphs of their own, have one value."""
    values = []
    for side in (0, 1):
        graph = Graph()
        node = IDENTITIES[name](graph, graph.input("x"), graph.input("y"))[side]
        values += evaluate(graph, [node], {"x": 0.83, "y": 1.71})
    assert values[0] == pytest.approx(values[1], rel=1e-13, abs=1e-14)


DIFFERENT = {
    # a root is hashed; were its square rewritten where it shows, one value would have two fingerprints
    "square of a root": lambda g, x, y: (g.call("sqrt", x + y) * g.call("sqrt", y + x), x + y),
    "root of a square": lambda g, x, y: (g.call("sqrt", x * x), x),
    "absolute value": lambda g, x, y: (g.call("abs", x), x),
    "absolute value of the opposite": lambda g, x, y: (g.call("abs", x), -x),
    "smaller of two": lambda g, x, y: (g.call("min", x, y), x),
    "larger of two": lambda g, x, y: (g.call("max", x, y), y),
    "min and max": lambda g, x, y: (g.call("min", x, y), g.call("max", x, y)),
    "a clearance that is closed at the usual values": lambda g, x, y: (g.call("max", x - 100, g.zero), g.zero),
    "sine of a number and its float": lambda g, x, y: (g.sin(g.const(1.0)), g.const(0.8414709848078965)),
    "pi and its float": lambda g, x, y: (
        g.named_constant("pi", 3.141592653589793),
        g.const(3.141592653589793),
    ),
    "inputs with other names": lambda g, x, y: (x, g.input("x2")),
    "input and constant of that name": lambda g, x, y: (g.input("pi"), g.named_constant("pi", 3.141592653589793)),
    "sine and cosine": lambda g, x, y: (g.sin(x), g.cos(x)),
    "angle and its root": lambda g, x, y: (g.cos(x), g.call("sqrt", 1 - g.sin(x) * g.sin(x))),
    "close floats": lambda g, x, y: (g.const(0.1), g.const(0.1 + 1e-16)),
    "float and rational near it": lambda g, x, y: (g.const(0.1), g.const(Fraction(1, 10))),
    "sine of tangent of half": lambda g, x, y: (g.sin(x), g.call("tan", x / 2)),
    "strict and lax comparison": lambda g, x, y: (g.call("less", x, y), g.call("less_equal", x, y)),
    "swapped branches": lambda g, x, y: (g.call("select", x, y, g.one), g.call("select", x, g.one, y)),
    "floor": lambda g, x, y: (g.call("floor", x), x),
    "arc sine of sine": lambda g, x, y: (g.call("asin", g.sin(x)), x),
    "arc tangent with swapped arguments": lambda g, x, y: (g.call("atan2", x, y), g.call("atan2", y, x)),
    "root of a product": lambda g, x, y: (g.call("sqrt", x * y), g.call("sqrt", x) * g.call("sqrt", y)),
    "period": lambda g, x, y: (g.sin(x + 6), g.sin(x)),
}


@pytest.mark.parametrize("name", DIFFERENT)
def test_different_values_stay_apart(g, x, y, name):
    a, b = DIFFERENT[name](g, x, y)
    assert a is not b
    assert a.fingerprint != b.fingerprint
    assert not (a - b).is_zero


def test_float_near_rational_is_not_taken_for_it():
    """Floats are taken exactly, as the numbers they are; only dyadic rationals equal them."""
    g = Graph()
    assert g.const(0.25) is g.const(Fraction(1, 4))
    assert g.const(0.1).number == Fraction(0.1)


def test_field_is_what_the_fingerprints_rely_on():
    assert fp.PRIME.bit_length() == 127
    assert fp.PRIME % 4 == 3
    assert all(pow(2, fp.PRIME - 1, fp.PRIME) == 1 and pow(a, fp.PRIME - 1, fp.PRIME) == 1 for a in (3, 5, 7, 11))
    for number in (2, 3, 5, 7, 11, 13, 17, 19, 23, 360, 9999 // 9):
        root = fp.square_root(number)
        if root is not None:
            assert root * root % fp.PRIME == number
    assert None not in [fp.square_root(p) for p in (2, 3, 5, 7, 11, 13, 17, 19, 23)]


@pytest.mark.parametrize("value", [0, 1, 17, fp.PRIME - 1])
def test_points_lie_on_the_unit_circle(value):
    cosine, sine = fp.circle_from(value)
    assert (cosine * cosine + sine * sine) % fp.PRIME == 1
    assert fp.turn(fp.turns((cosine, sine), 5), fp.turns((cosine, sine), -5)) == (1, 0)


def test_constants_fold_and_units_vanish(g, x):
    two, three = g.const(2), g.const(3)
    assert (two * three).number == 6
    assert (two / three).number == Fraction(2, 3)
    assert x + 0 is x and x * 1 is x and x / 1 is x and 0 + x is x
    assert (x * 0).is_zero and (0 / x).is_zero
    assert g.sin(g.zero).is_zero and g.cos(g.zero).is_one
    before = len(g.nodes)
    x + 0, x * 1, x * 0
    assert len(g.nodes) == before


def test_constants_are_exact_and_do_not_grow_without_end(g, x):
    """Beyond 1,024 bits a value is kept to 256 bits, and what it is equal to is still known exactly."""
    node = g.const(Fraction(1, 3))
    for _ in range(12):
        node = node * node
    assert node.number is not None and node.number.numerator.bit_length() <= 257
    assert abs(node.number * 3**4096 - 1) < Fraction(1, 2**250)
    assert (node * g.const(3**4096)).is_one and (node + x - node) is x
    tenth, third = g.const(0.1), g.const(Fraction(1, 3))
    assert (tenth * tenth).number == Fraction(0.1) ** 2 and (tenth * third / third).number == Fraction(0.1)
    assert (tenth * (tenth * x)) is (tenth * tenth) * x


def test_cosines_of_numbers_obey_the_addition_theorems(g, x):
    small, large = g.const(Fraction(3, 10)), g.const(Fraction(3, 5))
    c, s = g.cos(small), g.sin(small)
    assert c * c - s * s is g.cos(large) and 2 * s * c is g.sin(large)
    assert g.sin(x - small) is g.sin(x) * c - g.cos(x) * s
    assert g.sin(x + g.const(-0.3)) is g.sin(x - g.const(0.3))
    assert g.sin(-small) is -s and g.cos(g.const(0.3)) is not c


def test_a_value_that_turns_out_to_be_a_number_becomes_a_constant(g):
    two, three = g.call("sqrt", g.const(2)), g.call("sqrt", g.const(3))
    product = two * three * g.call("sqrt", g.const(6))
    assert g.const(6) is product and product.number == 6


def test_dividing_by_what_is_identically_zero_is_an_error(g, x):
    with pytest.raises(ZeroDivisionError, match="identically zero"):
        g.div(g.one, g.sin(x) * g.sin(x) + g.cos(x) * g.cos(x) - 1)


def test_a_node_adopts_the_cheaper_form(g, x, y):
    expanded = x * x + 2 * (x * y) + y * y
    dear = expanded.cost
    assert (x + y) * (x + y) is expanded
    assert expanded.cost < dear
    assert expanded.op == "mul"
    assert (x * x + 2 * (x * y)) + y * y is expanded
    assert expanded.op == "mul"


@pytest.mark.parametrize("order", ["dear form first", "cheap form first"])
def test_substitution_leaves_no_trace_of_the_input(order):
    """(1 + x)**8 in its cheapest known form mentions y; replacing y by something dear must drop it all the same."""
    g = Graph()
    x, y = g.input("x"), g.input("y")

    def expanded():
        powers = [g.one, x]
        while len(powers) < 9:
            powers.append(powers[-1] * x)
        return g.sum(g.const(c) * p for c, p in zip((1, 8, 28, 56, 70, 56, 28, 8, 1), powers, strict=True))

    def shifted():
        base = x + y + 1 - y
        square = base * base
        return square * square * square * square

    nodes = [expanded(), shifted()] if order == "dear form first" else [shifted(), expanded()]
    assert nodes[0] is nodes[1]
    replaced = g.substitute([nodes[0], g.sin(nodes[0])], {y: g.call("tan", g.call("exp", x))})
    found = evaluate(g, replaced, {"x": 0.3})
    assert found == pytest.approx([1.3**8, math.sin(1.3**8)], rel=1e-12)


def test_freed_of_tells_dependence_in_value(g, x, y):
    hidden = g.sin(x) * g.sin(x) * y + g.cos(x) * g.cos(x) * y
    assert hidden is y
    kinked = g.call("abs", x) * y
    assert g.freed_of(kinked, [x]) is None
    assert g.freed_of(g.call("max", x - 100, g.zero), [x]) is None
    assert g.freed_of(y * y, [x]) is y * y
    assert g.freed_of(x - x + y, [x]) is y


def test_freed_of_does_not_mistake_a_dependence_that_zero_and_one_hide(g, x, y):
    """x (x - 1) vanishes at 0 and at 1, and is not constant."""
    assert g.freed_of(x * (x - 1) + y, [x]) is None


@pytest.mark.parametrize("name", ["pulse", "abs", "sinh", "log"])
def test_what_cancels_leaves_a_form_with_a_value(g, x, y, name):
    """The functions are zero where a cancelling input is set to 0 or 1."""
    pulse = g.call("select", g.call("less", x, g.const(2)), g.zero, g.const(5))
    f = pulse if name == "pulse" else g.call(name, x)
    a, b = g.decimal(0.4), g.decimal(0.3)
    (value,) = values_of([g.freed_of((f * a + f * b) / (f * b), [x])], {})
    assert value == pytest.approx(7 / 3)
    assert g.freed_of((f * a * y) / (f * b * y + 1), [x]) is None
    ratio = g.freed_of((f * a + f * y) / (f * b), [x])
    assert values_of([ratio], {y: 2.0})[0] == pytest.approx(8.0)


def test_substitution_reidentifies(g, x, y, z):
    node = g.sin(x) * g.cos(y) + g.cos(x) * g.sin(y)
    (turned,) = g.substitute([node], {y: -x})
    assert turned.is_zero
    (named,) = g.substitute([x * y], {x: z, y: z})
    assert named is z * z


def test_substitution_is_simultaneous(g, x, y):
    assert g.substitute([x - y], {x: y, y: x})[0] is y - x


def test_topological_order_has_operands_first_and_no_repeats(g, x, y):
    node = g.sin(x * y) + g.cos(x * y) / (x + y)
    seen = []
    for item in g.topological([node, node, x]):
        assert all(arg in seen for arg in item.args)
        assert item not in seen
        seen.append(item)
    assert seen[-1] is node or x in seen


def test_deep_graphs_do_not_overflow_the_stack(g, x, y):
    node = x
    for i in range(5000):
        node = g.sin(node) + y * g.const(i + 2)
    assert len(list(g.topological([node]))) > 10_000
    assert g.substitute([node], {y: g.zero})[0] is not node


def test_nodes_print_as_what_they_are(g, x):
    assert repr(x) == "<x>"
    assert repr(g.const(Fraction(1, 3))) == "<1/3>"
    assert "sin" in repr(g.sin(x))


@settings(max_examples=250)
@given(TREES)
def test_random_expressions_keep_their_value(tree):
    with mpmath.workdps(50):
        point = {name: mpmath.mpf(value) for name, value in POINT.items()}
        graph = Graph()
        try:
            expected = extended(tree, point)
            node = build(graph, tree)
        except OutOfDomain:
            assume(False)
        (actual,) = evaluate(graph, [node], point)
        assert abs(actual - expected) <= 1e-9 * max(1, abs(expected))
        assert_acyclic(graph)


@settings(max_examples=80)
@given(TREES, TREES, TREES)
def test_random_building_keeps_the_graph_acyclic(a, b, c):
    """Many forms of the same values on one graph, with derivatives and substitutions in between."""
    graph = Graph()
    try:
        nodes = [build(graph, tree) for tree in (a, b, c)]
        sums = [nodes[0] + nodes[1], (nodes[0] + nodes[1]) * nodes[2], nodes[0] * nodes[2] + nodes[1] * nodes[2]]
        x, y, z = (graph.input(name) for name in NAMES)
        slopes = tangents(graph, [*nodes, *sums], {x: graph.one, y: x})
        graph.substitute([*sums, *slopes], {x: y + z, z: -y})
    except (OutOfDomain, ZeroDivisionError):
        assume(False)
    assert sums[1] is sums[2]
    assert_acyclic(graph)
    assert len({node.fingerprint for node in graph.nodes}) == len(graph.nodes)


@settings(max_examples=60)
@given(TREES, TREES)
def test_numbering_and_forms_do_not_depend_on_the_process(a, b):
    """Two graphs built by the same calls are the same, node by node."""
    graphs = []
    for _ in range(2):
        graph = Graph()
        try:
            build(graph, a), build(graph, b)
        except OutOfDomain:
            assume(False)
        graphs.append([(n.op, [m.index for m in n.args], n.payload, n.fingerprint) for n in graph.nodes])
    assert graphs[0] == graphs[1]
