"""Derivatives on the graph, forward and reverse."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ..ir.calls import CALLS, function_of
from ..ir.graph import Graph
from ..ir.node import Node, deps_of
from ..ir.surfaces import surface_of
from ..ir.tables import table_of


class Form(NamedTuple):
    """A node and its form before differentiation, which may give the node a cheaper form."""

    node: Node
    op: str
    args: tuple[Node, ...]


Rule = Callable[[Graph, Form, tuple[Node, ...]], Node]


def _piecewise_zero(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    return graph.zero


def _extremum(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    a, b = node.args
    low, high = tangent if node.op == "min" else tangent[::-1]
    return graph.call("select", graph.call("less_equal", a, b), low, high)


def _power(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    base, exponent = node.args
    result = exponent * graph.call("pow", base, exponent - 1) * tangent[0]
    if not tangent[1].is_zero:
        result = result + node.node * graph.call("log", base) * tangent[1]
    return result


def _table(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    x, key, order = node.args
    assert key.number is not None and order.number is not None
    if order.number >= table_of(float(key.number)).degree:
        return graph.zero
    return graph.call("table", x, key, order + 1) * tangent[0]


def _surface(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    x, y, key, *orders = node.args
    i, j = (int(order.number or 0) for order in orders)
    degrees = surface_of(float(key.number or 0)).degrees
    total = graph.zero
    if i < degrees[0] and not tangent[0].is_zero:
        total = total + graph.call("surface", x, y, key, graph.const(i + 1), graph.const(j)) * tangent[0]
    if j < degrees[1] and not tangent[1].is_zero:
        total = total + graph.call("surface", x, y, key, graph.const(i), graph.const(j + 1)) * tangent[1]
    return total


def _call(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    *values, key = node.args
    function, total = function_of(key.number), graph.zero
    for place, rate in enumerate(tangent[:-1]):
        if not rate.is_zero:
            total = total + graph.call(node.op, *values, graph.const(function.slope(place).key)) * rate
    return total


_REACH = 6e-6
"""Share of an argument, or of 1, for central differences: the third root of the spacing of doubles."""


def _difference(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    *values, key = node.args
    if function_of(key.number).slopes:
        return _call(graph, node, tangent)
    total = graph.zero
    for place, (x, rate) in enumerate(zip(values, tangent, strict=False)):
        if rate.is_zero:
            continue
        h = graph.const(_REACH) * graph.call("max", graph.one, graph.call("abs", x))
        above, below = (graph.call(node.op, *values[:place], at, *values[place + 1 :], key) for at in (x + h, x - h))
        total = total + (above - below) / (2 * h) * rate
    return total


def _atan2(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
    y, x = node.args
    return (x * tangent[0] - y * tangent[1]) / (x * x + y * y)


RULES: dict[str, Rule] = {
    "add": lambda g, n, d: d[0] + d[1],
    "sub": lambda g, n, d: d[0] - d[1],
    "mul": lambda g, n, d: d[0] * n.args[1] + n.args[0] * d[1],
    "div": lambda g, n, d: (d[0] - n.node * d[1]) / n.args[1],
    "neg": lambda g, n, d: -d[0],
    "sqrt": lambda g, n, d: d[0] / (2 * n.node),
    "pow": _power,
    "sin": lambda g, n, d: g.cos(n.args[0]) * d[0],
    "cos": lambda g, n, d: -(g.sin(n.args[0]) * d[0]),
    "tan": lambda g, n, d: (1 + n.node * n.node) * d[0],
    "asin": lambda g, n, d: d[0] / g.call("sqrt", 1 - n.args[0] * n.args[0]),
    "acos": lambda g, n, d: -d[0] / g.call("sqrt", 1 - n.args[0] * n.args[0]),
    "atan": lambda g, n, d: d[0] / (1 + n.args[0] * n.args[0]),
    "atan2": _atan2,
    "exp": lambda g, n, d: n.node * d[0],
    "log": lambda g, n, d: d[0] / n.args[0],
    "sinh": lambda g, n, d: g.call("cosh", n.args[0]) * d[0],
    "cosh": lambda g, n, d: g.call("sinh", n.args[0]) * d[0],
    "tanh": lambda g, n, d: (1 - n.node * n.node) * d[0],
    "abs": lambda g, n, d: g.call("sign", n.args[0]) * d[0],
    "sign": _piecewise_zero,
    "floor": _piecewise_zero,
    "min": _extremum,
    "max": _extremum,
    "less": _piecewise_zero,
    "less_equal": _piecewise_zero,
    "select": lambda g, n, d: g.call("select", n.args[0], d[1], d[2]),
    "table": _table,
    "surface": _surface,
    "piece": _piecewise_zero,
    "entry": _piecewise_zero,
    **dict.fromkeys(CALLS, _call),
}
"""The derivative of each operation: (graph, node, tangents of its operands) -> tangent of the node.

Operations that jump (sign, floor, comparisons, pieces of tables) have derivative zero, which holds between their jumps.
"""


def _zero_where(test: Callable[[Graph, Form], Node], rule: Rule) -> Rule:
    """Return a rule whose derivative is zero where the test gives zero."""

    def guarded(graph: Graph, node: Form, tangent: tuple[Node, ...]) -> Node:
        return graph.call("select", test(graph, node), rule(graph, node, tangent), graph.zero)

    return guarded


APPROXIMATE: dict[str, Rule] = RULES | dict.fromkeys(CALLS, _difference)
"""`RULES` for matrices that need not be exact: calls without known derivatives have differences."""

GUARDED: dict[str, Rule] = RULES | {
    "sqrt": _zero_where(lambda g, n: n.args[0], RULES["sqrt"]),
    "pow": _zero_where(lambda g, n: n.args[0], RULES["pow"]),
    "atan2": _zero_where(lambda g, n: n.args[0] * n.args[0] + n.args[1] * n.args[1], RULES["atan2"]),
    "asin": _zero_where(lambda g, n: 1 - n.args[0] * n.args[0], RULES["asin"]),
    "acos": _zero_where(lambda g, n: 1 - n.args[0] * n.args[0], RULES["acos"]),
}
"""`RULES` for derivatives that are evaluated: zero where an operation has none, so that rest and zero angles give no
NaN (a root's infinite derivative at zero, times a tangent that is zero)."""


def tangents(
    graph: Graph, outputs: Sequence[Node], seeds: Mapping[Node, Node], rules: Mapping[str, Rule] = RULES
) -> list[Node]:
    """Return the directional derivatives of `outputs`.

    Parameters
    ----------
    graph : Graph
        The graph of all nodes.
    outputs : sequence of Node
        Nodes to differentiate.
    seeds : mapping of Node to Node
        The rate of each input that varies; inputs not named are constant.
    rules : mapping of str to Rule
        The derivative of each operation.

    Returns
    -------
    list of Node
        One derivative an output: sum over inputs x of (d output / d x) * seeds[x].
    """
    varying = deps_of(seeds)
    tangent: dict[int, Node] = {source.index: rate for source, rate in seeds.items()}

    def differentiate(node: Node) -> Node:
        form = Form(node, node.op, node.args)
        rates = tuple(tangent.get(arg.index, graph.zero) for arg in form.args)
        if not node.deps & varying or all(rate.is_zero for rate in rates):
            return graph.zero
        return rules[form.op](graph, form, rates)

    graph.visit(outputs, tangent, differentiate, varying)
    return [tangent[output.index] for output in outputs]


def cotangents(
    graph: Graph,
    outputs: Sequence[Node],
    weights: Sequence[Node],
    inputs: Sequence[Node],
    rules: Mapping[str, Rule] = RULES,
) -> list[Node]:
    """Return the derivatives of the sum of weights * outputs by the inputs, in a few times the operations of `outputs`.

    A rule is linear in its tangents: what an operand gets is the rule's answer where that operand alone has a tangent,
    the cotangent of the node.
    """
    varying = deps_of(inputs)
    forms = [Form(node, node.op, node.args) for node in graph.topological(outputs) if node.deps & varying]
    found: dict[int, Node] = {}
    for output, weight in zip(outputs, weights, strict=True):
        found[output.index] = found.get(output.index, graph.zero) + weight
    for form in reversed(forms):
        own = found.get(form.node.index, graph.zero)
        for place, arg in enumerate(form.args):
            if arg.deps & varying and not own.is_zero:
                alone = tuple(own if i == place else graph.zero for i in range(len(form.args)))
                found[arg.index] = found.get(arg.index, graph.zero) + rules[form.op](graph, form, alone)
    return [found.get(source.index, graph.zero) for source in inputs]


def jacobian(
    graph: Graph, outputs: Sequence[Node], inputs: Sequence[Node], rules: Mapping[str, Rule] = RULES
) -> list[list[Node]]:
    """Return the matrix of partial derivatives, one row an output, one column an input."""
    columns = [tangents(graph, outputs, {source: graph.one}, rules) for source in inputs]
    return [[column[row] for column in columns] for row in range(len(outputs))]
