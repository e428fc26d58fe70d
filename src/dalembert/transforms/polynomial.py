"""Polynomial forms of values, in which equal, common and cancelling terms are visible.

A term is a coefficient, which is fixed along a motion (numbers and parameters), times whole powers of atoms.
An atom is whatever is not opened into terms: an input, a function, or a sum that stands in too large a product
or in a denominator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import final

from ..ir.graph import Graph
from ..ir.node import Node

Monomial = tuple[tuple[int, int], ...]
"""(index of the atom, exponent other than 0), by index."""

Polynomial = dict[Monomial, Node]
"""Monomial -> its coefficient, which is not zero."""

Form = tuple[str, tuple[Node, ...]]
"""An operation and its operands."""

_TERMS = 12
_HIGHEST = 24
"""Powers up to which squares of cosines and sines are opened: half as many terms come of each."""


def times(a: Monomial, b: Monomial, sign: int = 1) -> Monomial:
    """Return a * b**sign."""
    if not b:
        return a
    if not a and sign > 0:
        return b
    powers = dict(a)
    for atom, exponent in b:
        powers[atom] = powers.get(atom, 0) + sign * exponent
    return tuple(sorted([power for power in powers.items() if power[1]]))


def sign(c: Node) -> tuple[bool, Node]:
    """Return whether the form of a coefficient is negative, and the coefficient without its sign."""
    if c.op == "neg" or (c.number is not None and c.number < 0):
        return True, -c
    return False, c


def _added(graph: Graph, terms: Sequence[tuple[Monomial, Node]]) -> Polynomial:
    total: Polynomial = {}
    for monomial, coefficient in terms:
        known = total.get(monomial)
        total[monomial] = coefficient if known is None else graph.add(known, coefficient)
    return {monomial: c for monomial, c in total.items() if not c.is_zero}


@final
class Polynomials:
    """The polynomials of values, each computed once.

    Parameters
    ----------
    moving : int
        Dependency bits of the inputs that vary along a motion.
    form : callable
        Node -> the operation and the operands by which it is read.
    opened : callable
        (node, whether it stands in a product) -> whether to open a sum, product or quotient.
    """

    def __init__(
        self,
        graph: Graph,
        moving: int,
        form: Callable[[Node], Form] = lambda node: (node.op, node.args),
        opened: Callable[[Node, bool], bool] = lambda node, inside: True,
    ) -> None:
        self._graph, self._moving, self._form, self._opened = graph, moving, form, opened
        self._known: dict[tuple[int, bool], Polynomial] = {}

    def of(self, node: Node, inside: bool = False) -> Polynomial:
        """Return the polynomial of `node`, which may stand inside a product."""
        key = node.index, inside
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = self._new(node, inside)
        return found

    def _new(self, node: Node, inside: bool) -> Polynomial:
        if not node.deps & self._moving:
            return {} if node.is_zero else {(): node}
        op, args = self._form(node)
        if op in ("add", "sub", "neg", "mul", "div") and self._opened(node, inside):
            found = self._sum(op, args, inside) if op in ("add", "sub", "neg") else self._product(op, args)
            if found is not None and len(found) <= _TERMS:
                return found
        return {((node.index, 1),): self._graph.one}

    def _sum(self, op: str, args: tuple[Node, ...], inside: bool) -> Polynomial:
        terms: list[tuple[Monomial, Node]] = []
        for place, arg in enumerate(args):
            negative = op == "neg" or (op == "sub" and place == 1)
            terms += [(m, self._graph.neg(c) if negative else c) for m, c in self.of(arg, inside).items()]
        return _added(self._graph, terms)

    def _product(self, op: str, args: tuple[Node, ...]) -> Polynomial | None:
        graph, (a, b) = self._graph, (self.of(arg, True) for arg in args)
        if op == "mul":
            if len(a) * len(b) <= _TERMS:
                return _added(graph, [(times(m, n), graph.mul(c, d)) for m, c in a.items() for n, d in b.items()])
            if len(a) > 1 and len(b) > 1:
                return None
            single, other = (a, args[1]) if len(a) == 1 else (b, args[0])
            return {times(m, ((other.index, 1),)): c for m, c in single.items()}
        if len(b) == 1:
            ((below, divisor),) = b.items()
        else:
            below, divisor = ((args[1].index, 1),), graph.one
        return {times(m, below, -1): graph.div(c, divisor) for m, c in a.items()}


def pythagorean(graph: Graph, p: Polynomial, form: Callable[[Node], Form], *, canonical: bool) -> Polynomial:
    """Return `p` with squares of a cosine or a sine written in the other.

    Where `canonical`, no square of a cosine stays, so that equal polynomials are the same; otherwise a square
    is replaced only where fewer terms come of it, because 1 - sin**2 has lost digits where cos**2 has not.
    """
    angles: dict[int, Node] = {}
    if any(exponent > _HIGHEST for monomial in p for _, exponent in monomial):
        return p
    for monomial in p:
        for atom, exponent in monomial:
            if exponent < 2:
                continue
            op, args = form(graph.nodes[atom])
            if op in ("sin", "cos"):
                angles.setdefault(args[0].index, args[0])
    for angle in angles.values():
        cosine, sine = graph.cos(angle).index, graph.sin(angle).index
        reduced = _without_square(graph, p, cosine, sine)
        if not canonical:
            reduced = min(reduced, _without_square(graph, p, sine, cosine), key=len)
        if canonical or len(reduced) < len(p):
            p = reduced
    return p


def _without_square(graph: Graph, p: Mapping[Monomial, Node], old: int, new: int) -> Polynomial:
    """Return `p` with old**2 replaced by 1 - new**2."""
    while any(atom == old and exponent > 1 for monomial in p for atom, exponent in monomial):
        terms: list[tuple[Monomial, Node]] = []
        for monomial, c in p.items():
            if dict(monomial).get(old, 0) > 1:
                rest = times(monomial, ((old, 2),), -1)
                terms += [(rest, c), (times(rest, ((new, 2),)), graph.neg(c))]
            else:
                terms.append((monomial, c))
        p = _added(graph, terms)
    return dict(p)
