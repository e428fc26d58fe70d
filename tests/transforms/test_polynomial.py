"""Polynomials are the values that they are taken from."""

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dalembert.ir.graph import Graph
from dalembert.transforms.polynomial import Polynomials, pythagorean, times
from ir.trees import NAMES, TREES, OutOfDomain, build


def form(node):
    return node.op, node.args


def value(graph, polynomial):
    """Return the sum of the terms, multiplied out one by one."""
    total = graph.zero
    for monomial, c in polynomial.items():
        term = c
        for atom, exponent in monomial:
            for _ in range(abs(exponent)):
                term = term * graph.nodes[atom] if exponent > 0 else term / graph.nodes[atom]
        total = total + term
    return total


@settings(max_examples=150)
@given(TREES, st.sets(st.sampled_from(NAMES)), st.booleans())
def test_a_polynomial_is_its_value(tree, fixed, canonical):
    graph = Graph()
    try:
        node = build(graph, tree)
    except OutOfDomain:
        assume(False)
    moving = graph.mask([name for name in NAMES if name not in fixed])
    plain = Polynomials(graph, moving).of(node)
    assert value(graph, plain) is node
    assert all(not c.deps & moving and not c.is_zero for c in plain.values())
    assert value(graph, pythagorean(graph, plain, form, canonical=canonical)) is node


def test_equal_terms_meet_and_cancelled_ones_go():
    graph = Graph()
    x, y, a, b = (graph.input(name) for name in "xyab")
    values = Polynomials(graph, graph.mask("xy"))
    both = ((x.index, 1), (y.index, 1))
    assert values.of(x * (a * y) - y * (b * x)) == {both: a - b}
    assert values.of((x + y) * (x - y) + y * y) == {((x.index, 2),): graph.one}
    assert values.of(a * y / x) == {tuple(sorted((((x.index, -1)), (y.index, 1)))): a}


def test_squares_of_cosines_are_replaced_where_terms_go():
    graph = Graph()
    a, b, q = (graph.input(name) for name in "abq")
    sine, cosine = graph.sin(q), graph.cos(q)
    values = Polynomials(graph, graph.mask("q"))

    def shape(p, canonical=False):
        return set(pythagorean(graph, p, form, canonical=canonical))

    square = ((sine.index, 2),), ((cosine.index, 2),)
    same = {square[0]: a, square[1]: a}
    assert shape(same) == {()}
    assert shape(same, canonical=True) == {()}
    assert shape({square[0]: a, square[1]: b}) == set(square)
    assert shape({square[0]: a, square[1]: b}, canonical=True) == {(), square[0]}
    assert shape(values.of(cosine * cosine)) == {square[1]}


def test_monomials_multiply_and_divide():
    assert times(((1, 2), (3, 1)), ((1, -2), (2, 1))) == ((2, 1), (3, 1))
    assert times((), ((1, 1),), -1) == ((1, -1),)
    assert times((), ((1, 1),)) == ((1, 1),)
