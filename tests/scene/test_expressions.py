"""SymPy expressions onto the graph: every supported function keeps its meaning."""

import mpmath
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from dalembert.ir.graph import Graph
from dalembert.scene.expressions.reader import ExpressionReader
from ir.trees import evaluate

a, b = sp.symbols("a b", real=True)
POINT = {"a": 0.37, "b": 1.84}

EXPRESSIONS = [
    a + b,
    a - 2 * b / 3,
    a**2 * b**-3,
    a ** sp.Rational(1, 2),
    b ** sp.Rational(-5, 2),
    b ** sp.Rational(1, 3),
    b**a,
    b ** (-a),
    2**a,
    sp.sqrt(2) * sp.sqrt(3) * a,
    sp.pi * a + sp.E,
    sp.Float("0.1") * a,
    sp.sin(a) * sp.cos(b) + sp.tan(a),
    sp.cot(a) + sp.sec(b) - sp.csc(a),
    sp.asin(a) + sp.acos(a) + sp.atan(b) + sp.atan2(a, -b),
    sp.exp(-a) + sp.log(b) + sp.sinh(a) * sp.cosh(b) - sp.tanh(b),
    sp.Abs(a - b) + sp.sign(a - b) + sp.floor(3 * b) + sp.ceiling(3 * b) + sp.ceiling(-b),
    sp.Min(a, b, 1) + sp.Max(2 * a, b, sp.Rational(1, 2)),
    sp.Heaviside(b - a) + sp.Heaviside(a - b),
    sp.Piecewise((a, a < 0), (b, a < 1), (7, True)),
    sp.Piecewise((a, (a > 0) & (b > 2)), (b, (a >= 0) | (b < 0)), (7, True)),
    sp.Piecewise((a, sp.And(a > 0, b > 0, a < b)), (0, True)),
    sp.Piecewise((1, sp.Or(a > 1, b > 3)), (2, True)),
    sp.Piecewise((1, ~(a > b)), (2, True)),
    sp.Piecewise((1, ~sp.And(a > 1, b > 1, evaluate=False)), (2, True)),
    sp.Piecewise((sp.sin(a) / a, sp.Ne(a, 0)), (1, True)) + sp.Piecewise((5, sp.Eq(a, b)), (b, True)),
    sp.Piecewise((a, a < 0), (b, a >= 0)),
    sp.Piecewise((1, a < 0), (2, (a >= 0) & (a < b)), (3, a >= b)),
    sp.Heaviside(a - a * b / b, 0.25) + sp.Heaviside(0 * a),
    sp.Piecewise((1, (a > 1) ^ (b > 1)), (2, True)),
    sp.Piecewise((sp.log(-a), a < 0), (sp.log(a), True)),
    sp.Integer(10) ** 20 * a / 7,
    sp.sinc(a),
    sp.Mod(b, 1) + sp.Mod(-b, a) + sp.Mod(5 * b, -1),
    sp.Sum(a ** sp.Symbol("n"), (sp.Symbol("n"), 1, 3)) + sp.Integral(sp.Symbol("c"), (sp.Symbol("c"), 0, b)),
    sp.asinh(a) + sp.acosh(b) + sp.atanh(a),
    sp.GoldenRatio * a,
    sp.cbrt(b),
    sp.exp(a) ** 2,
    1 / (1 + sp.exp(-b)),
]

OPTIONAL = (sp.sinc, sp.asinh, sp.Not, sp.Xor)
"""What the reader may refuse, as long as it says so."""


def read(expression):
    graph = Graph()
    reader = ExpressionReader(graph, {})
    return graph, reader, reader.read(expression, "here")


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_expression_keeps_its_value(expression):
    graph, reader, node = read(expression)
    if reader.faults and expression.has(*OPTIONAL):
        assert "cannot be compiled" in reader.faults[0] and reader.faults[0].startswith("here: ")
        return
    assert reader.faults == []
    expected = float(expression.subs({a: sp.Float(POINT["a"], 40), b: sp.Float(POINT["b"], 40)}))
    assert evaluate(graph, [node], POINT)[0] == pytest.approx(expected, rel=1e-13)


@settings(max_examples=60)
@given(st.lists(st.sampled_from(EXPRESSIONS[:19]), min_size=1, max_size=3), st.randoms(use_true_random=False))
def test_combinations_keep_their_value(parts, random):
    expression = sp.Integer(0)
    for part in parts:
        expression = expression + part.subs({a: a * random.choice([1, b])}) * random.choice([a, 1 + b**2, -1])
    with mpmath.workdps(30):
        point = {name: mpmath.mpf(value) for name, value in POINT.items()}
        expected = sp.lambdify([a, b], expression, modules="mpmath")(*point.values())
        if not isinstance(expected, mpmath.mpf):
            return  # left the domain of a function
        graph, reader, node = read(expression)
        assert reader.faults == []
        found = evaluate(graph, [node], {name: float(value) for name, value in point.items()})[0]
        assert found == pytest.approx(float(expected), rel=1e-9, abs=1e-9)


def test_order_of_sympys_arguments_does_not_reach_the_graph():
    """The same sum written in two orders gives the same nodes in the same order."""
    forms = [a * b + sp.sin(a) + b**2, b**2 + sp.sin(a) + b * a]
    listings = []
    for form in forms:
        graph, _, _ = read(form)
        listings.append([(n.op, n.fingerprint, [x.index for x in n.args]) for n in graph.nodes])
    assert listings[0] == listings[1]


def test_faults_are_collected_once_each_and_read_as_zero():
    graph = Graph()
    reader = ExpressionReader(graph, {})
    assert reader.read(sp.gamma(a) + sp.gamma(a) * b, "force").is_zero
    assert reader.read(sp.erf(b), "torque").is_zero
    assert len(reader.faults) == 2
    assert reader.faults[0].startswith("force: gamma") and reader.faults[1].startswith("torque: erf")


def test_what_sympy_cannot_read_is_a_fault():
    _, reader, _ = read(object())
    assert "not a SymPy expression" in reader.faults[0]


@pytest.mark.parametrize("most", [2, sp.oo])
def test_piecewise_without_a_value_somewhere(most):
    f, t = sp.Function("f"), sp.Symbol("t")
    graph = Graph()
    reader = ExpressionReader(graph, {f(t): graph.input("f"), t: graph.input("t")})
    reader.read(sp.Piecewise((1, f(t) < 1), (2, f(t) < 1.5), (a, (f(t) < most) & (a > 0))), "force")
    assert len(reader.faults) == 1 and "end it with (value, True)" in reader.faults[0]
    reader.read(sp.Piecewise((1, f(t) < 1), (2, f(t) >= 1)) + sp.Piecewise((1, t < a), (2, t >= a)), "force")
    assert len(reader.faults) == 1


@pytest.mark.parametrize("value", [-1.0, 0.0, 2.0])
def test_step_has_sympys_value_where_it_steps(value):
    for step in (sp.Heaviside(a), sp.Heaviside(a, 0.25), sp.Heaviside(a, b)):
        graph, _, node = read(step)
        expected = float(step.subs({b: POINT["b"]}).subs(a, sp.nsimplify(value)))
        assert evaluate(graph, [node], {"a": value, "b": POINT["b"]})[0] == expected


def test_relation_is_no_expression():
    _, reader, _ = read(sp.Eq(a, b))
    assert "left side minus right side" in reader.faults[0]
