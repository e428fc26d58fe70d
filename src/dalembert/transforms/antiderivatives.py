"""Antiderivatives of functions of one value on the graph, by rules without search.

A rule returns a candidate; the caller verifies it by differentiation. Rules cover sums, powers, polynomials,
elementary functions of linear arguments, products that are a function of an inner value times its derivative, and
branches (`Piecewise`, `Max`, `Abs`) at places where a linear function changes sign.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from operator import mul
from typing import final

from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.random_points import Probe, constant_value, directions, lost_at_zero, match, probe
from ..ir.zero_tests import vanishes
from .derivatives import tangents
from .elementary_antiderivatives import elementary_antiderivative

_DEGREE = 8
"""Highest degree of polynomials."""
_CALLS = 300
"""Rules that one antiderivative may apply."""
_COST = 4000.0
"""Cost of an expression from which on it is given up."""
_INNER = 24
"""Inner values that are tried."""
_SEEDS, _PARALLEL = 4, 1e-5
"""Points at which gradients are compared, and the tolerance: they are differences."""


def _parallel(pair: tuple[float, float], slopes: Probe) -> bool:
    """Return whether two covectors agree along two directions, up to a factor."""
    left, right = pair[0] * slopes.b, pair[1] * slopes.a
    return abs(left - right) <= _PARALLEL * max(abs(left), abs(right))


@final
class Antiderivatives:
    """Antiderivatives on one graph.

    Parameters
    ----------
    graph : Graph
    moving : sequence of Node
        The inputs that may change; all others are constants.
    """

    def __init__(self, graph: Graph, moving: Sequence[Node]) -> None:
        self.graph, self.moving = graph, list(moving)
        self._mask = sum(node.deps for node in self.moving)
        self._calls = 0

    # -- functions of one value -----------------------------------------------------------

    def along(self, h: Node, u: Node) -> Node | None:
        """Return the antiderivative of `h` by `u`, where `h` depends on the moving inputs through `u` alone."""
        self._calls = 0
        fixed = self._free(h, self.moving)
        if fixed is not None:
            return fixed * u
        place = next((x for x in self.moving if x.deps & u.deps and not self.slope(u, x).is_zero), None)
        if place is None or not self.depends_through(h, u):
            return None
        if self._jumps(h):
            return self._renamed(h, u)
        return self._centred(h, u, place) or self._polynomial(h, u, place) or self._renamed(h, u)

    def _jumps(self, h: Node) -> bool:
        """Return whether an expression has jumps; the antiderivatives on both sides of one need not agree there."""
        jumping = ("select", "sign", "floor", "less", "less_equal", "table", "surface")
        mask = sum(x.deps for x in self.moving)
        return any(node.op in jumping and node.deps & mask for node in self.graph.topological([h]))

    def _centred(self, h: Node, u: Node, place: Node) -> Node | None:
        """Return the antiderivative of a power of `u`, or of `u` less a constant."""
        found = self._power(h, u, place)
        if found is not None:
            return found
        for v in self.inner_values([h], [place]):
            slope = None if v is u or self.slope(v, place).is_zero else self._by(v, u, place).number
            found = None if slope is None else self._power(h, v, place)
            if found is not None and slope is not None:
                return found / self.graph.const(slope)
        return None

    def depends_through(self, h: Node, u: Node) -> bool:
        """Whether `h` seems to depend on the moving inputs through `u` alone: their gradients are parallel."""
        for seed in range(_SEEDS):
            own, other = probe([h, u], self.moving, seed)
            if math.isfinite(own.a + own.b + other.a + other.b):
                return _parallel((own.a, own.b), other)
        return False

    def with_gradient_along(self, values: Sequence[Node], covector: Sequence[Node]) -> list[Node]:
        """Return those of some values the gradients of which seem to be parallel to a covector."""
        left, found = list(values), []
        for seed in range(_SEEDS):
            if not left:
                break
            probes = probe([*left, *covector], self.moving, seed)
            forces = [item.value for item in probes[len(left) :]]
            work = [sum(map(mul, forces, direction)) for direction in directions(self.moving, seed)]
            known = [math.isfinite(item.a + item.b + sum(work)) for item in probes[: len(left)]]
            pairs = list(zip(left, probes, known, strict=False))
            found += [u for u, item, sure in pairs if sure and _parallel((work[0], work[1]), item)]
            left = [u for u, _, sure in pairs if not sure]
        return sorted(found, key=lambda node: node.cost)

    def slope(self, node: Node, x: Node) -> Node:
        """Return the derivative of a node by an input."""
        return tangents(self.graph, [node], {x: self.graph.one})[0]

    def _inputs(self, nodes: Sequence[Node]) -> dict[Node, Node]:
        """Return all inputs of some expressions as themselves, so that other values may be substituted."""
        return {x: x for x in self.graph.topological(nodes) if x.op == "input"}

    def _free(self, node: Node, inputs: Sequence[Node]) -> Node | None:
        held = [x for x in inputs if x.deps & node.deps]
        found = self.graph.freed_of(node, held)
        if found is None:  # it may have no value where all of them are zero, or one, such as (x - y)/(y - x)
            try:
                places = {x: self.graph.const(Fraction(3 + 2 * i, 7)) for i, x in enumerate(held)}
                fixed = self.graph.substitute([node], places)[0]
            except ZeroDivisionError:
                return None
            found = fixed if fixed is node and not any(x.deps & node.deps for x in held) else None
        return found

    def _by(self, node: Node, u: Node, place: Node) -> Node:
        """Return the derivative of a function of `u` by it, from derivatives by the input `place`."""
        return self.graph.div(self.slope(node, place), self.slope(u, place))

    def _power(self, h: Node, u: Node, place: Node) -> Node | None:
        """Return the antiderivative of a constant times a power of `u`."""
        if h.is_zero:
            return self.graph.zero
        exponent = constant_value(self.graph.div(u * self._by(h, u, place), h))
        if exponent is None:
            return None
        if exponent == -1:
            return h * u * self.graph.call("log", self.graph.call("abs", u))
        return h * u / self.graph.const(exponent + 1)

    def _polynomial(self, h: Node, u: Node, place: Node) -> Node | None:
        """Return the antiderivative of a polynomial in `u`: leading terms from its last derivatives."""
        rest, total = h, self.graph.zero
        for _ in range(_DEGREE + 1):
            found = self._leading(rest, u, place)
            if found is None:
                return None
            factor, degree = found
            if degree == 1 and rest is h:
                return self._square(factor, h - factor * u, u)
            term = factor
            for _ in range(degree):
                term = term * u
            total = total + term * u / self.graph.const(degree + 1)
            rest = rest - term
            if vanishes(rest):
                return total
        return None

    def _square(self, factor: Node, rest: Node, u: Node) -> Node:
        """Return the antiderivative of factor * u + rest, zero where the integrand is unless that needs a division."""
        constant = self._free(rest, self.moving)
        if constant is None:
            constant = rest
        place = constant / factor
        if lost_at_zero(place, [constant, factor], self.moving):
            return factor * u * u / 2 + constant * u
        return factor * (u + place) * (u + place) / 2

    def _leading(self, h: Node, u: Node, place: Node) -> tuple[Node, int] | None:
        """Return coefficient and degree of the leading term of a polynomial in `u`."""
        faculty = Fraction(1)
        for degree in range(_DEGREE + 1):
            fixed = self._free(h, self.moving)
            if fixed is not None:
                return fixed / self.graph.const(faculty), degree
            h = self._by(h, u, place)
            faculty *= degree + 1
            if h.cost > _COST:
                return None
        return None

    def _renamed(self, h: Node, u: Node) -> Node | None:
        """Return the antiderivative with an input in place of `u`, if the form of `h` shows no other moving one."""
        s = self.graph.input("value to integrate by")
        renamed = self.graph.substitute([h], {**self._inputs([h, u]), u: s})[0]
        if renamed.deps & self._mask:
            return None
        found = self.integral(renamed, s)
        return None if found is None else self.graph.substitute([found], {s: u})[0]

    # -- rules ----------------------------------------------------------------------------

    def by_input(self, f: Node, x: Node) -> Node | None:
        """Return the antiderivative of `f` by an input, all others being constants, or None where no rule finds one."""
        self._calls = 0
        return self.integral(f, x)

    def integral(self, f: Node, x: Node, depth: int = 0) -> Node | None:
        """Apply the rules to `f`, which may depend on other inputs."""
        self._calls += 1
        if self._calls > _CALLS or depth > 8 or f.cost > _COST:
            return None
        fixed = self._free(f, [x])
        if fixed is not None:
            return fixed * x
        rules = (self._linear, self._elementary, self._inner, self._branches, self._distributed)
        for rule in rules:
            try:
                found = rule(f, x, depth)
            except ZeroDivisionError:
                continue
            if found is not None and match([self.slope(found, x)], [f]):
                return found
        return None

    def _linear(self, f: Node, x: Node, depth: int) -> Node | None:
        g, op, args = self.graph, f.op, f.args  # a node may change its form while others are made
        if op == "neg":
            inner = self.integral(args[0], x, depth + 1)
            return None if inner is None else -inner
        if op in ("add", "sub"):
            deeper = [depth + (arg.op not in ("add", "sub")) for arg in args]  # a sum may have many terms
            parts = [self.integral(arg, x, level) for arg, level in zip(args, deeper, strict=True)]
            if parts[0] is None or parts[1] is None:
                return None
            return g.call(op, parts[0], parts[1])
        if op == "mul":
            for a, b in (args, args[::-1]):
                if not a.deps & x.deps:
                    inner = self.integral(b, x, depth + 1)
                    return None if inner is None else a * inner
        if op == "div" and not args[1].deps & x.deps:
            inner = self.integral(args[0], x, depth + 1)
            return None if inner is None else inner / args[1]
        if op == "div" and not args[0].deps & x.deps and not args[0].is_one:
            inner = self.integral(g.one / args[1], x, depth + 1)
            return None if inner is None else args[0] * inner
        return None

    def _elementary(self, f: Node, x: Node, depth: int) -> Node | None:
        if len(f.args) != 1 and f.op != "table":
            return None
        slope = self._free(self.slope(f.args[0], x), [x])
        found = None if slope is None else elementary_antiderivative(self.graph, f.op, f.args)
        return None if found is None or slope is None else found / slope

    def _inner(self, f: Node, x: Node, depth: int) -> Node | None:
        """Return the antiderivative of a power or a polynomial of an inner value times the derivative of that."""
        best: tuple[tuple[int, float], Node] | None = None
        for u in self.inner_values([f], [x]):
            slope = self.slope(u, x)
            if slope.is_zero:
                continue
            h = self.graph.div(f, slope)
            own = Antiderivatives(self.graph, [x])
            found = None if own._jumps(h) else own._power(h, u, x) or own._polynomial(h, u, x)
            if found is not None:
                key = (lost_at_zero(found, [f], [x]), found.cost)
                best = min(best or (key, found), (key, found), key=lambda item: item[0])
        return None if best is None else best[1]

    def inner_values(self, nodes: Sequence[Node], inputs: Sequence[Node]) -> list[Node]:
        """Return values inside some expressions that depend on some inputs, cheap ones first, inputs among them."""
        mask = sum(x.deps for x in inputs)
        found = [node for node in self.graph.topological(nodes) if node.deps & mask and node.op not in ("neg", "mul")]
        found.sort(key=lambda node: node.cost)
        return found[:_INNER]

    # -- branches -------------------------------------------------------------------------

    def _switches(self, f: Node) -> Iterator[tuple[Node, Node, Node, Node]]:
        """Yield branching values with the difference whose sign decides, and the values below and above its zero."""
        g = self.graph
        for node in g.topological([f]):
            if node.op in ("min", "max"):
                a, b = node.args
                yield node, a - b, *((a, b) if node.op == "min" else (b, a))
            elif node.op == "abs":
                yield node, node.args[0], -node.args[0], node.args[0]
            elif node.op == "sign":
                yield node, node.args[0], g.const(-1), g.one
            elif node.op == "select" and node.args[0].op in ("less", "less_equal"):
                a, b = node.args[0].args
                yield node, a - b, node.args[1], node.args[2]

    def _branches(self, f: Node, x: Node, depth: int) -> Node | None:
        """Return the antiderivative of either branch, with the constant that makes it continuous where they meet."""
        g = self.graph
        for node, difference, below, above in self._switches(f):
            slope = self._free(self.slope(difference, x), [x])
            if slope is None or slope.is_zero or not node.deps & x.deps:
                continue
            inputs = self._inputs([f])
            sides = [g.substitute([f], {**inputs, node: side})[0] for side in (below, above)]
            low, high = (self.integral(side, x, depth + 1) for side in sides)
            if low is None or high is None:
                return None
            root = -g.substitute([difference], {x: g.zero})[0] / slope
            at = g.substitute([low, high], {x: root})
            return g.call("select", g.call("less", difference, g.zero), low - at[0], high - at[1])
        return None

    def _distributed(self, f: Node, x: Node, depth: int) -> Node | None:
        """Return the antiderivative of a product or quotient of a sum, term by term."""
        products = [f.args, f.args[::-1]] if f.op == "mul" else []
        quotients = [f.args] if f.op == "div" else []
        for factors in (*products, *quotients):
            total, other = factors
            op, terms = total.op, total.args  # a node may change its form while others are made
            if op in ("add", "sub"):
                wanted = [term * other if products else term / other for term in terms]
                parts = [self.integral(term, x, depth + 1) for term in wanted]
                if parts[0] is not None and parts[1] is not None:
                    return self.graph.call(op, parts[0], parts[1])
        return None
