"""Zero tests with a tolerance for decimals: pivots, rank, redundancy, consistency.

Identity on the graph is exact, and so is the zero test of values of symbols and rationals. Decimal numbers are rounded
before they reach the graph: 0.1 + 0.2 - 0.3 is 2.8e-17 there, and means zero. A value of decimals therefore counts as
zero in a decision where it is smaller than `TOLERANCE` times the size of the terms that it came from, at
random points. That size is to first order what the value would change by if every decimal changed by its own size,
as in a running error analysis; of a product of two zeros it is the term of second order. Along many steps of a
recursion that bound is far too large: a value is zero only if small changes of the decimals change it as a whole, too.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence

from .algebra import Algebra
from .conditions import CONDITION_TIME, DECIDED, weighted_select
from .graph import Graph
from .interning import TOLERANCE
from .node import Node, UnitName
from .ops import GRAPH_OPERATIONS, TABLE_ARGUMENTS

_ROUNDING = 0.01
"""Rounding of an operation of this test, as a share of its result: 1e-15 after `TOLERANCE`."""

_POINTS, _DRAWS, _CHANGES = 3, 8, 3
_WIDE, _WIDE_DRAWS = 1000, 24
"""Draws from `_WIDE` on have inputs of many orders of magnitude; its multiples are used."""

BRANCHING = (*DECIDED, "select", "min", "max", "abs")
"""Operations with branches."""

DECADES = 3.0
"""Orders of magnitude of inputs, up and down, at points on both sides of branches."""

_STEP = 1e-7

Sized = tuple[float, float, bool]
"""A value, the size of the terms that it came from, and whether decimal numbers are among them."""

_UNDEFINED = (math.nan, math.inf, True)


def vanishes(node: Node) -> bool:
    """Return whether a value is zero: exactly, or up to the rounding of the decimals that it was computed from."""
    if node.is_zero:
        return True
    graph = node.graph
    if not graph.decimals:
        return False
    found = 0
    for draw in range(_DRAWS):
        value, size, decimal = _sampled(graph, node, draw)
        if not decimal:
            return False
        if not (math.isfinite(value) and math.isfinite(size)):
            continue
        if size == 0.0 or abs(value) > TOLERANCE * size or not _is_rounding(graph, node, draw, value):
            return False
        found += 1
        if found == _POINTS:
            return not _differs_by_branch(graph, [node])
    return False


def _differs_by_branch(graph: Algebra, nodes: Sequence[Node]) -> bool:
    """Return whether values with branches are not zero at some points with inputs of many orders of magnitude.

    Inputs of moderate size may all lie on one side of a branch.
    """
    if not any(node.op in BRANCHING for node in Graph.topological(nodes)):
        return False
    sampled = (_sampled(graph, node, _WIDE * draw) for draw in range(1, 1 + _WIDE_DRAWS) for node in nodes)
    return any(abs(value) > TOLERANCE * size for value, size, _ in sampled if math.isfinite(value + size))


def _is_rounding(graph: Algebra, node: Node, draw: int, value: float) -> bool:
    """Return whether changes of the decimals, each by up to `TOLERANCE` of its size, change a value as a whole."""
    moved = (_sampled(graph, node, draw, change)[0] for change in range(1, _CHANGES + 1))
    return any(not abs(other - value) < 0.5 * abs(value) for other in moved)


def agree(first: Sequence[Node], second: Sequence[Node]) -> bool:
    """Return whether two vectors are equal: exactly, or up to the rounding of the decimal numbers in them.

    A component may be what rounding has left of a difference, which SymPy has evaluated: the largest component counts.
    """
    rest = [a - b for a, b in zip(first, second, strict=True) if a is not b and not (a - b).is_zero]
    if not rest:
        return True
    graph = rest[0].graph
    if not graph.decimals:
        return False
    found = 0
    for draw in range(_DRAWS):
        sampled = [_sampled(graph, node, draw) for node in rest]
        if not all(decimal for _, _, decimal in sampled):
            return False
        sizes = [size for _, size, _ in sampled]
        sizes += [abs(_sampled(graph, node, draw)[0]) for node in (*first, *second)]
        if not all(map(math.isfinite, sizes)):
            continue
        if any(abs(value) > TOLERANCE * max(sizes) for value, _, _ in sampled):
            return False
        found += 1
        if found == _POINTS:
            return not _differs_by_branch(graph, rest)
    return False


def magnitude(node: Node) -> float:
    """Return the absolute value of a node at one random point of its inputs; NaN where it has none there."""
    return abs(_sampled(node.graph, node, 0)[0])


def terms_of(graph: Graph, node: Node) -> Node:
    """Return the size of the terms of a value, as an expression of the same inputs.

    Sums of the absolute values of what is added, all else as it is; so that the rounding error of the value is a few
    1e-16 of it.
    """
    done: dict[int, Node] = {}

    def size(node: Node) -> Node:
        a = [done[arg.index] for arg in node.args]
        if node.op in ("add", "sub"):
            return a[0] + a[1]
        if node.op == "mul":
            return a[0] * a[1]
        if node.op == "div":
            below = graph.call("abs", node.args[1])
            return a[0] * a[1] / (below * below)
        return a[0] if node.op == "neg" else graph.call("abs", node)

    graph.visit([node], done, size)
    return done[node.index]


def _sampled(graph: Algebra, node: Node, draw: int, change: int = 0) -> Sized:
    """Return a value at a random point of its inputs, the same one in every process, with a change of the decimals."""
    known = graph.samples.setdefault(draw + change * _DRAWS, {})
    deciding = graph.known_mask(CONDITION_TIME)
    stack = [node]
    while stack:
        top = stack[-1]
        if top.index in known:
            stack.pop()
            continue
        pending = [arg for arg in top.args if arg.index not in known]
        if pending:
            stack.extend(pending)
            continue
        stack.pop()
        if top.op == "input":
            known[top.index] = (_place(top, draw), 0.0, False)
        elif top.op == "const":
            known[top.index] = _constant(graph, top, change)
        elif deciding & top.deps and top.op in DECIDED:  # random times may all lie on one side of a jump
            known[top.index] = (random.Random(f"{top.fingerprint} {draw}").uniform(0.4, 1.3), 0.0, False)
        else:
            args = [known[arg.index] for arg in top.args]
            nothing = top.op == "div" and not change and _divides_by_rounding(graph, top, draw, *args[1][:2])
            known[top.index] = _UNDEFINED if nothing else _operation(top.op, args)
    return known[node.index]


def _divides_by_rounding(graph: Algebra, quotient: Node, draw: int, value: float, size: float) -> bool:
    return abs(value) <= TOLERANCE * size and _is_rounding(graph, quotient.args[1], draw, value)


def _place(node: Node, draw: int) -> float:
    """Return the value of an input: positive, or a component of a unit quaternion."""
    name = node.payload
    if isinstance(name, UnitName):
        source = random.Random(f"{name.quaternion} {draw}")
        four = [source.uniform(0.2, 1.0) for _ in range(4)]
        return four[name.place] / math.hypot(*four)
    value = random.Random(f"{name} {draw}").uniform(0.4, 1.3)
    if draw < _WIDE:
        return value
    source = random.Random(f"{name if draw // _WIDE % 2 else ''} {draw} magnitude")
    return float(value * 10.0 ** source.uniform(-DECADES, DECADES))


def _constant(graph: Algebra, node: Node, change: int) -> Sized:
    try:
        value = float(node.payload)  # type: ignore[arg-type]
    except OverflowError:
        return _UNDEFINED
    size = graph.decimals.get(node.index, 0.0)
    if change and size:
        value += TOLERANCE * size * random.Random(f"{node.fingerprint} {change}").uniform(-1.0, 1.0)
    return value, size + _ROUNDING * abs(value), size > 0.0


def _operation(op: str, args: Sequence[Sized]) -> Sized:
    """Return an operation on values, with the size of its terms to first order."""
    decimal = any(arg[2] for arg in args)
    a, s = args[0][:2]
    if op in ("add", "sub"):
        value = a + args[1][0] if op == "add" else a - args[1][0]
        return value, s + args[1][1] + _ROUNDING * abs(value), decimal
    if op == "mul":
        b, r = args[1][:2]
        value = a * b
        return value, abs(a) * r + abs(b) * s + TOLERANCE * r * s + _ROUNDING * abs(value), decimal
    if op == "neg":
        return -a, s, decimal
    if op == "div":
        b, r = args[1][:2]
        value = a / b if b else math.nan
        return value, (s + abs(value) * r) / abs(b) + _ROUNDING * abs(value) if b else math.inf, decimal
    x = [arg[0] for arg in args]
    function: Callable[..., float] = weighted_select if op == "select" else GRAPH_OPERATIONS[op].evaluate
    try:
        value = float(function(*x))
    except (OverflowError, ValueError):
        return _UNDEFINED
    size = _ROUNDING * abs(value)
    for place, (point, error, _) in enumerate(args):
        named = place >= TABLE_ARGUMENTS.get(op, len(args))
        if error and op not in DECIDED and not named and not (op == "select" and place == 0):
            step = _STEP * max(1.0, abs(point))
            moved = float(function(*x[:place], point + step, *x[place + 1 :]))
            size += abs(moved - value) / step * error
    return value, size, decimal
