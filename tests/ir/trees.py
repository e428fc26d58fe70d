"""Random expressions, built on the graph and evaluated directly: two routes to the same value."""

from fractions import Fraction

import mpmath
from hypothesis import strategies as st

from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.transforms.lower_kernels import lower_kernel

NAMES = ("x", "y", "z")
POINT = {"x": "0.7310585786300049", "y": "1.3862943611198906", "z": "-0.4142135623730951"}

#: Operations of SymPy's world in extended precision; conditions give 1 or 0, as in the graph.
EXTENDED = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": mpmath.sqrt,
    "pow": mpmath.power,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "tan": mpmath.tan,
    "asin": mpmath.asin,
    "acos": mpmath.acos,
    "atan": mpmath.atan,
    "atan2": mpmath.atan2,
    "exp": mpmath.exp,
    "log": mpmath.log,
    "sinh": mpmath.sinh,
    "cosh": mpmath.cosh,
    "tanh": mpmath.tanh,
    "abs": abs,
    "sign": mpmath.sign,
    "floor": mpmath.floor,
    "min": min,
    "max": max,
    "less": lambda a, b: mpmath.mpf(a < b),
    "less_equal": lambda a, b: mpmath.mpf(a <= b),
    "select": lambda c, a, b: a if c != 0 else b,
}

_UNARY = ("neg", "sin", "cos", "tan", "sqrt", "exp", "abs", "tanh", "atan")
_BINARY = ("add", "sub", "mul", "div", "min", "max", "atan2")


def _grow(children):
    return st.one_of(
        st.tuples(st.sampled_from(_UNARY), children),
        st.tuples(st.sampled_from(_BINARY), children, children),
        # the forms that the fingerprints know identities of get more than their share
        st.tuples(st.sampled_from(("add", "sub", "mul")), children, children),
        st.tuples(st.sampled_from(("sin", "cos")), children),
    )


_LEAVES = st.one_of(
    st.sampled_from(NAMES),
    st.builds(Fraction, st.integers(-6, 6), st.sampled_from((1, 2, 4))),
)

#: Nested tuples (operation, operands...); leaves are names and dyadic rationals, which floats hold exactly.
TREES = st.recursive(_LEAVES, _grow, max_leaves=14)


class OutOfDomain(Exception):
    """A tree has no real value at the point, or one so large or so close to a pole that no digit is left."""


def build(graph: Graph, tree):
    """Return the node of a tree."""
    if isinstance(tree, str):
        return graph.input(tree)
    if isinstance(tree, Fraction):
        return graph.const(tree)
    op, *children = tree
    try:
        return graph.call(op, *(build(graph, child) for child in children))
    except ZeroDivisionError:
        raise OutOfDomain from None


def extended(tree, point):
    """Return the value of a tree in extended precision."""
    if isinstance(tree, str):
        return point[tree]
    if isinstance(tree, Fraction):
        return mpmath.mpf(tree.numerator) / tree.denominator
    op, *children = tree
    operands = [extended(child, point) for child in children]
    if op == "div" and abs(operands[1]) < mpmath.mpf("1e-4"):
        raise OutOfDomain
    if op == "sqrt" and operands[0] < mpmath.mpf("1e-8"):
        raise OutOfDomain
    if op == "tan" and abs(mpmath.cos(operands[0])) < mpmath.mpf("1e-4"):
        raise OutOfDomain
    if op == "atan2" and max(map(abs, operands)) < mpmath.mpf("1e-4"):
        raise OutOfDomain
    if op == "exp" and abs(operands[0]) > 12:
        raise OutOfDomain
    value = EXTENDED[op](*operands)
    if abs(value) > 1e6:
        raise OutOfDomain
    return value


def evaluate(graph: Graph, nodes, point, fixed=None):
    """Return the values of nodes in the arithmetic of the numbers in `point`, through a lowered kernel.

    With `fixed`, names of inputs that do not vary, the kernel has few products of the others.
    """
    inputs = {graph.input(name): ("y", place) for place, name in enumerate(point)}
    still = None if fixed is None else [graph.input(name) for name in fixed]
    kernel = lower_kernel(graph, "outputs", nodes, inputs, fixed=still)
    arguments = {"y": list(point.values()), "t": 0, "p": []}
    if any(isinstance(value, mpmath.mpf) for value in point.values()):
        return interpret(kernel, arguments, EXTENDED, mpmath.mpf)
    return interpret(kernel, arguments)
