"""Zero tests for decisions: exact for symbols and rationals, tolerant of the rounding of decimals."""

import random
from fractions import Fraction

import pytest

from dalembert.ir.conditions import CONDITION_TIME
from dalembert.ir.graph import Graph
from dalembert.ir.interning import TOLERANCE
from dalembert.ir.node import unit_names
from dalembert.ir.zero_tests import agree, terms_of, vanishes
from dalembert.transforms.linear import SingularMatrix, factorize


@pytest.fixture
def g():
    return Graph()


@pytest.fixture
def x(g):
    return g.input("x")


@pytest.fixture
def y(g):
    return g.input("y")


def of_decimals(g, x, y):
    d = g.decimal
    root = g.call("sqrt", d(0.7))
    pi = g.named_constant("pi", 3.141592653589793)
    return {
        "sum": d(0.1) + d(0.2) - d(0.3),
        "product": d(0.1) * 3 - d(0.3),
        "sum times symbol": (d(0.1) + d(0.2)) * x - d(0.3) * x,
        "rational beside decimal": x * d(0.3) - x * g.const(Fraction(3, 10)),
        "quotient": d(0.7) / d(0.3) * y - d(0.7) * (y / d(0.3)) + (d(0.1) + d(0.2) - d(0.3)) * y,
        "root": root * root * x - d(0.7) * x,
        "sine": g.sin(x - d(0.3)) - g.sin(x - g.const(Fraction(3, 10))),
        "circle": g.cos(d(0.3)) * g.cos(d(0.3)) - g.sin(d(0.3)) * g.sin(d(0.3)) - g.cos(d(0.1) * 6),
        "pi": d(0.7) * pi - d(2.199114857512855),
        "power": g.call("pow", x, d(0.3)) - g.call("pow", x, d(0.1) * 3),
        "atan2": g.call("atan2", x, d(0.3)) - g.call("atan2", x, d(0.1) * 3),
        "elimination": d(0.7) * d(1.3) * (d(0.2) / d(0.7)) * x - d(0.26) * x,
        "many orders": d(6.02e23) * (d(1.38e-23) * x) - d(6.02e23 * 1.38e-23) * x,
    }


NAMES = list(of_decimals(*(lambda g: (g, g.input("x"), g.input("y")))(Graph())))


@pytest.mark.parametrize("name", NAMES)
def test_what_rounding_leaves_of_zero_vanishes(g, x, y, name):
    nodes = of_decimals(g, x, y)
    node = nodes[name]
    assert all(vanishes(node * other) for other in nodes.values())  # both may be sampled as zero
    assert vanishes(node) and vanishes(3 * node) and vanishes(node * (x + y))
    assert not vanishes(node + g.decimal(1e-6)) and not vanishes(node + x)


def test_what_is_small_does_not_vanish(g, x, y):
    d = g.decimal
    assert not vanishes(d(1e-300) * x)
    assert not vanishes(d(0.1 + 1e-9) - d(0.1))
    assert not vanishes((d(0.1 + 1e-9) * x - d(0.1) * x) * y)
    assert not vanishes(d(1e-20) * x + d(1e-18) * y)
    assert not vanishes(g.call("max", g.zero, x - d(5.5)))  # zero where it is sampled
    assert not vanishes(x / (d(0.1) + d(0.2) - d(0.3)))  # undefined, not zero


def test_what_is_zero_on_one_side_of_a_branch_does_not_vanish(g, x, y):
    d = g.decimal
    for low, high in ((d(0.2), d(0.5)), (d(0.002), d(5.5))):
        clipped = d(0.5) * g.call("max", low, y)
        assert not vanishes(clipped - d(0.5) * y) and not agree([clipped, x], [d(0.5) * y, x])
        behind = d(0.5) * g.call("select", g.call("less", high * 8, x * y), x, y) - d(0.5) * y
        assert not vanishes(behind)
    assert vanishes((d(0.1) + d(0.2)) * g.call("max", x, y) - d(0.3) * g.call("max", x, y))


def test_the_value_of_a_long_recursion_does_not_vanish(g):
    """Each step halves an error and more than doubles its bound, which soon says nothing."""
    value = g.decimal(2.0)
    for k in range(60):
        value = (g.decimal(3.1) * value - g.decimal(2.1) * g.input(f"x{k}")) / value
    assert not vanishes(value)
    rounding = g.decimal(0.1) + g.decimal(0.2) - g.decimal(0.3)
    assert vanishes(rounding * value)


def test_symbols_and_rationals_are_decided_exactly(g, x, y):
    tiny = g.const(Fraction(1, 10**40))
    assert not vanishes(tiny) and not vanishes(x + tiny - x)
    d = g.decimal(0.1)
    assert not vanishes(g.const(1) + tiny - 1) and not vanishes(x * tiny) and d.number == Fraction(0.1)
    root = g.call("sqrt", x)
    assert not vanishes(root * root - x - y)
    assert not Graph().decimals


def test_a_constant_that_is_also_given_as_it_is_counts_as_given(g):
    small = 0.1 + 0.2 - 0.3
    assert vanishes(g.decimal(0.1) + g.decimal(0.2) - g.decimal(0.3))
    exact = Fraction(0.1) + Fraction(0.2) - Fraction(0.3)
    assert not vanishes(g.const(exact)) and small > 0.0


def test_what_is_known_of_decimals_goes_to_other_graphs(g, x):
    node = (g.decimal(0.1) + g.decimal(0.2) - g.decimal(0.3)) * x
    other = Graph()
    (copy,) = other.adopt([node])
    assert vanishes(copy) and not copy.is_zero


def test_unit_quaternions_are_sampled_on_the_sphere(g):
    e = [g.input(name) for name in unit_names(["a", "b", "c", "d"])]
    long = g.sum(g.decimal(0.3) * x * x for x in e) - g.decimal(0.1) * 3
    assert vanishes(long)


def test_sampling_is_the_same_whatever_the_order():
    for order in ("xy", "yx"):
        g = Graph()
        for name in order:
            g.input(name)
        node = g.decimal(0.1) * g.input("x") - g.decimal(0.1 + TOLERANCE / 20) * g.input("x")
        assert vanishes(node)


def test_what_is_zero_but_for_a_short_time_is_not_zero(g, x, y):
    """Conditions on time are not decided at the random times of the test, which are all before the pulse."""
    time = g.input(CONDITION_TIME)
    before, inside = (g.call("less", time, g.decimal(end)) for end in (5.1, 5.2))
    pulse = g.call("select", before, g.zero, g.call("select", inside, g.decimal(0.7), g.zero))
    rounding = (g.decimal(0.1) + g.decimal(0.2) - g.decimal(0.3)) * y
    assert vanishes(rounding) and vanishes(rounding * pulse)
    assert not vanishes(pulse * x + rounding) and not vanishes(pulse)
    assert vanishes((g.decimal(0.1) + g.decimal(0.2)) * pulse * x - g.decimal(0.3) * x * pulse)


@pytest.mark.parametrize("seed", range(5))
def test_gram_matrices_of_decimals_with_dependent_rows_are_singular(seed):
    draw = random.Random(seed)
    rows = [[round(draw.uniform(-3, 3), draw.randrange(1, 17)) for _ in range(4)] for _ in range(2)]
    a, b = draw.uniform(-2, 2), draw.uniform(-2, 2)
    third = [a * u + b * v for u, v in zip(*rows, strict=True)]
    g = Graph()
    for rows_, singular in (([*rows, third], True), ([*rows, [third[0] + 1e-3, *third[1:]]], False)):
        m = [[g.decimal(v) for v in row] for row in rows_]
        gram = [[g.sum(u * v for u, v in zip(p, q, strict=True)) for q in m] for p in m]
        if singular:
            with pytest.raises(SingularMatrix):
                factorize(g, gram)
        else:
            factorize(g, gram)


def test_terms_of_a_pivot(g, x, y):
    size = terms_of(g, x * y - y / x)
    at = g.substitute([size], {x: g.const(2), y: g.const(-3)})[0]
    from dalembert.transforms.lower_kernels import lower_kernel

    assert lower_kernel(g, "k", [at], {}, arguments=()).outputs == (6.0 + 3.0 * 2.0 / 4.0,)


def test_a_difference_that_turns_out_to_be_a_number_keeps_the_size_of_its_decimals(g, x):
    """The slope of the first form is zero exactly; what is left of both constants is rounding."""
    first, second = g.decimal(1.48) * x - g.decimal(0.13 * 1.48), x - g.decimal(0.13)
    left = first - g.decimal(1.48) * second
    assert left.number is None or left.number != 0
    constant = g.substitute([left], {x: g.zero})[0]
    assert constant.number is not None and not constant.is_zero
    assert vanishes(constant) and vanishes(left)
