"""Values of expressions at random points, for candidates and filters that are verified elsewhere.

What decides, up to the rounding of decimals, stands in `zero_tests`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Container, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

from .conditions import CONDITION_TIME, DECIDED, weighted_select
from .graph import Graph
from .node import Node
from .ops import GRAPH_OPERATIONS
from .zero_tests import BRANCHING, DECADES

_DIFFERENCE = 1e-5
_CANDIDATE_POINTS, _CANDIDATE_DRAWS = 3, 24
_SPREAD_POINTS = 48
_CROSSINGS = 4
_ALIKE_DRAWS, _ALIKE = 32, 1e-10
"""Points at which vectors are compared, half of which at least must have values, and the share by which they differ."""


class Probe(NamedTuple):
    """The value of an expression at a random point, and its derivatives along two random directions."""

    value: float
    a: float
    b: float


def random_inputs(nodes: Sequence[Node], draw: random.Random) -> dict[Node, float]:
    """Return a positive number of moderate size for every input that some expressions depend on.

    Conditions on time have a random value of their own, as inputs have: random times may all be on one side.
    """
    deciding = nodes[0].graph.known_mask(CONDITION_TIME) if nodes else 0
    return {
        node: draw.uniform(0.4, 1.3)
        for node in Graph.topological(nodes)
        if node.op == "input" or (deciding & node.deps and node.op in DECIDED)
    }


def alike(first: Sequence[Node], second: Sequence[Node], positive: Container[str]) -> bool:
    """Return whether two vectors have the same values, up to rounding, at points with inputs of both signs.

    They may be written differently, as ``2*sqrt(x**4)/x`` and ``2*x**3/sqrt(x**4)``. Inputs that are `positive`, by
    name, stay so.
    """
    nodes, draw, found = [*first, *second], random.Random(0), 0
    inputs = [node for node in Graph.topological(nodes) if node.op == "input"]
    signs = [(1.0,) if str(node.payload) in positive else (-1.0, 1.0) for node in inputs]
    for _ in range(_ALIKE_DRAWS):
        at = [draw.choice(sign) * 10.0 ** draw.uniform(-1.0, 1.0) for sign in signs]
        values = values_of(nodes, dict(zip(inputs, at, strict=True)))
        if all(map(math.isfinite, values)):
            found += 1
            pairs = zip(values[: len(first)], values[len(first) :], strict=True)
            if max(abs(a - b) for a, b in pairs) > _ALIKE * max(map(abs, values)):
                return False
    return 2 * found >= _ALIKE_DRAWS


def values_of(nodes: Sequence[Node], inputs: Mapping[Node, float]) -> list[float]:
    """Return the values of some expressions; NaN or infinity where they have none."""
    return values_in_order(nodes, [node for node in Graph.topological(nodes) if node not in inputs], inputs)


def values_in_order(nodes: Sequence[Node], order: Sequence[Node], inputs: Mapping[Node, float]) -> list[float]:
    """Return the values of some expressions; `order` has all nodes below them that are no inputs, operands first."""
    known = {node.index: value for node, value in inputs.items()}
    for node in order:
        known[node.index] = _constant_at(node) if node.op == "const" else _operation_at(node, known)
    return [known[node.index] for node in nodes]


def _constant_at(node: Node) -> float:
    try:
        return float(node.payload)  # type: ignore[arg-type]
    except OverflowError:
        return math.inf


def _operation_at(node: Node, known: Mapping[int, float]) -> float:
    if node.op == "select":
        return weighted_select(*(known[arg.index] for arg in node.args))
    try:
        return float(GRAPH_OPERATIONS[node.op].evaluate(*[known[arg.index] for arg in node.args]))
    except (OverflowError, ValueError, ZeroDivisionError):
        return math.nan


def probe(nodes: Sequence[Node], moving: Sequence[Node], seed: int) -> list[Probe]:
    """Return expressions and their derivatives at a random point, NaN where they have no value.

    The components of the directions are `directions(moving, seed)`. Derivatives are central differences.
    """
    inputs = random_inputs([*nodes, *moving], random.Random(f"point {seed}"))
    order = [node for node in Graph.topological(nodes) if node not in inputs]
    points = [inputs]
    for direction in directions(moving, seed):
        for sign in (_DIFFERENCE, -_DIFFERENCE):
            points.append(inputs | {x: inputs[x] + sign * d for x, d in zip(moving, direction, strict=True)})
    center, *rest = (values_in_order(nodes, order, point) for point in points)
    a, b = ([(x - y) / (2.0 * _DIFFERENCE) for x, y in zip(*pair, strict=True)] for pair in (rest[:2], rest[2:]))
    return [Probe(*numbers) for numbers in zip(center, a, b, strict=True)]


def directions(moving: Sequence[Node], seed: int) -> list[list[float]]:
    """Return the two directions of `probe`."""
    draw = random.Random(f"directions {seed}")
    return [[draw.uniform(-1.0, 1.0) for _ in moving] for _ in range(2)]


def match(first: Sequence[Node], second: Sequence[Node], *, points: int = 8, tolerance: float = 1e-9) -> bool:
    """Whether two vectors have the same values at random points of either sign, to a relative tolerance.

    This is for candidates that were derived, such as an antiderivative with other branches or roots than what it is
    compared with, which exact identity does not see. Vectors with branches are compared at `spread_points`, too.
    """
    if all((a - b).is_zero for a, b in zip(first, second, strict=True)):
        return True
    both, half, found = [*first, *second], len(first), 0
    for seed in range(8 * points):
        draw = random.Random(seed)
        inputs = {node: draw.choice((-1.0, 1.0)) * value for node, value in random_inputs(both, draw).items()}
        values = values_of(both, {x: abs(v) if seed % 4 == 0 else v for x, v in inputs.items()})
        if not all(map(math.isfinite, values)):
            continue
        if not _near(values[:half], values[half:], tolerance):
            return False
        found += 1
        if found == points:
            break
    spread = (values_of(both, point) for point in spread_points(both))
    known = (values for values in spread if all(map(math.isfinite, values)))
    return found == points and all(_near(values[:half], values[half:], tolerance) for values in known)


def _near(first: Sequence[float], second: Sequence[float], tolerance: float) -> bool:
    """Return whether two vectors differ by less than a fraction of their largest component."""
    size = max(map(abs, (*first, *second)))
    return all(abs(a - b) <= tolerance * size for a, b in zip(first, second, strict=True))


def spread_points(nodes: Sequence[Node]) -> Iterator[dict[Node, float]]:
    """Yield points with inputs of many orders of magnitude, if some expressions have branches.

    Inputs of moderate size may all lie on one side of a branch, such as where a clipped force is at its bound.
    """
    if not any(node.op in BRANCHING for node in Graph.topological(nodes)):
        return
    for seed in range(_SPREAD_POINTS):
        draw = random.Random(f"spread {seed}")
        shared = draw.uniform(-DECADES, DECADES)
        point = random_inputs(nodes, draw)
        for node in [node for node in point if node.op == "input"]:
            exponent = draw.uniform(-DECADES, DECADES) if seed % 2 else shared
            sign = draw.choice((-1.0, 1.0)) if seed % 4 < 2 else 1.0
            point[node] *= sign * 10.0**exponent
        yield point


def jumps(node: Node, moving: Sequence[Node]) -> bool:
    """Return whether an expression jumps where one of its branches changes, on lines between random points.

    Derivatives do not show it: x * Heaviside(y) has the derivative 0 by y on both sides.

    Parameters
    ----------
    node : Node
    moving : sequence of Node
        The inputs that change along a line.
    """
    deciding = [
        item for item in Graph.topological([node]) if item.op in DECIDED and any(item.deps & x.deps for x in moving)
    ]
    tested: dict[Node, int] = {}

    def on_line(start: Mapping[Node, float], share: float) -> list[float]:
        point = {x: value * (1.0 - 2.0 * share) if x in moving else value for x, value in start.items()}
        return values_of([node, *deciding], point)

    for start in spread_points(deciding and [node, *moving]):
        samples = [(share, on_line(start, share)) for share in (0.0, 0.3, 0.47, 0.51, 0.7, 1.0)]
        for (low, below), (high, above) in pairwise(samples):
            changed = [i for i, (a, b) in enumerate(zip(below[1:], above[1:], strict=True), 1) if a != b]
            fresh = [i for i in changed if tested.get(deciding[i - 1], 0) < _CROSSINGS]
            if not fresh or not all(map(math.isfinite, (below[0], above[0]))):
                continue
            place = fresh[0]
            tested[deciding[place - 1]] = tested.get(deciding[place - 1], 0) + 1
            while low < (middle := 0.5 * (low + high)) < high:
                values = on_line(start, middle)
                if values[place] == below[place]:
                    low, below = middle, values
                else:
                    high, above = middle, values
            size = max(abs(values[0]) for _, values in samples if math.isfinite(values[0]))
            if abs(above[0] - below[0]) > 1e-9 * size:
                return True
    return False


def lost_at_zero(node: Node, reference: Sequence[Node], moving: Sequence[Node]) -> int:
    """Return the number of special points at which an expression has no value and a reference has one.

    Points with a parameter that is zero, and those with moving inputs that are all zero, or all one.
    """
    inputs = random_inputs([node, *reference], random.Random(0))
    points = [{x: 0.0} for x in inputs if x not in moving]
    points += [{x: 1.0} for x in inputs if x.op in DECIDED]
    points += [{x: value for x in inputs if x in moving} for value in (0.0, 1.0)]
    count = 0
    for point in points:
        values = values_of([node, *reference], inputs | point)
        count += not math.isfinite(values[0]) and all(map(math.isfinite, values[1:]))
    return count


def constant_value(node: Node) -> Fraction | None:
    """Return the simple rational number that an expression is at random points, or None where it is none.

    An expression with roots may be a number that its form does not show: sqrt(u) * sqrt(u) / u.
    """
    if node.number is not None:
        return node.number
    found: list[float] = []
    for seed in range(_CANDIDATE_DRAWS):
        value = values_of([node], random_inputs([node], random.Random(seed)))[0]
        if math.isfinite(value):
            found.append(value)
        if len(found) == _CANDIDATE_POINTS:
            break
    if len(found) < _CANDIDATE_POINTS:
        return None
    spread = [values_of([node], point)[0] for point in spread_points([node])]
    found += [value for value in spread if math.isfinite(value)]
    simple = Fraction(found[0]).limit_denominator(64)
    return simple if all(abs(value - simple) < 1e-9 * (1.0 + abs(simple)) for value in found) else None
