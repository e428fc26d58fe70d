"""Forms chosen for values in place of those of the graph, and their costs along a motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import final

from ..ir import fingerprint as fp
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.ops import GRAPH_OPERATIONS
from .polynomial import Form, Monomial, Polynomial, sign, times

_PRODUCT, _SQUARE = 12.0, 7.0
"""Cost of a product of varying values in a Taylor step of usual order, relative to a sum."""


@final
class Forms:
    """Values of a graph and the form chosen for each; those without one keep the form that the graph has.

    Attributes
    ----------
    moving : int
        Dependency bits of the inputs that vary along a motion.
    uses : mapping of int to int
        Number of uses of the value with an index: as an operand of values in use, or as an output.
    """

    def __init__(self, graph: Graph, moving: int = 0) -> None:
        self.graph, self.moving = graph, moving
        self.uses: Counter[int] = Counter()
        self._chosen: dict[int, Form] = {}
        self._moving_args: dict[int, tuple[int, ...]] = {}
        self._weights: dict[int, float] = {}

    def of(self, node: Node) -> Form:
        """Return the operation and operands of a value."""
        found = self._chosen.get(node.index)
        return (node.op, node.args) if found is None or not node.deps & self.moving else found

    def args(self, node: Node) -> tuple[Node, ...]:
        """Return the operands of a value."""
        return self.of(node)[1]

    def choose(self, node: Node, form: Form) -> None:
        """Set the form of a value. The caller counts its uses."""
        index, moving = node.index, self.moving
        self._chosen[index] = form
        self._moving_args[index] = tuple([arg.index for arg in form[1] if arg.deps & moving])
        self._weights[index] = self.weigh(form)

    def weight(self, node: Node) -> float:
        """Return the cost of the one operation of a value that varies."""
        return self._weights[node.index]

    def weigh(self, form: Form) -> float:
        """Return the cost of one operation."""
        op, args = form
        if not args:
            return 0.0
        if op in ("add", "sub", "neg"):
            return GRAPH_OPERATIONS[op].cost
        if op == "mul" and args[0].deps & self.moving and args[1].deps & self.moving:
            return _SQUARE if args[0] is args[1] else _PRODUCT
        if op == "mul" or (op == "div" and not args[1].deps & self.moving):
            return 1.0
        return GRAPH_OPERATIONS[op].cost + _PRODUCT

    def work(self, nodes: Sequence[Node]) -> float:
        """Return the cost of `nodes` and all that they depend on, shared values counted once."""
        return sum(self.weigh(self.of(n)) for n in self.graph.topological(nodes, self.args) if n.deps & self.moving)

    def acquire(self, node: Node) -> float:
        """Count the uses that the form of `node` makes, and return the cost of what was not used before."""
        uses, added, stack = self.uses, 0.0, [node.index]
        while stack:
            for arg in self._moving_args[stack.pop()]:
                uses[arg] += 1
                if uses[arg] == 1:
                    added += self._weights[arg]
                    stack.append(arg)
        return added

    def release(self, node: Node) -> float:
        """Undo `acquire`."""
        uses, freed, stack = self.uses, 0.0, [node.index]
        while stack:
            for arg in self._moving_args[stack.pop()]:
                uses[arg] -= 1
                if not uses[arg]:
                    freed += self._weights[arg]
                    stack.append(arg)
        return freed


# Values of polynomials as operations on the graph, in forms that share what other values need.
#
# A value is built for a target: from values before it alone, and within a budget of what its operations may cost.

_LAST = 1 << 60


class UnsuitableForm(Exception):
    """Raised for a form that needs a value computed later, or that costs more than the best known form."""


def frequent(p: Polynomial) -> tuple[int, int] | None:
    """Return the atom and the sign of its exponent that most terms have, if two have it."""
    counts: dict[tuple[int, int], int] = {}
    for monomial in p:
        for atom, exponent in monomial:
            key = atom, 1 if exponent > 0 else -1
            counts[key] = counts.get(key, 0) + 1
    if not counts:
        return None
    best, count = max(counts.items(), key=lambda item: (item[1], -item[0][0]))
    return best if count > 1 else None


def _common(monomials: Sequence[Monomial]) -> Monomial:
    """Return the largest monomial that divides all."""
    shared = dict(monomials[0])
    for monomial in monomials[1:]:
        if not shared:
            return ()
        powers = dict(monomial)
        for atom, exponent in list(shared.items()):
            other = powers.get(atom, 0)
            if exponent * other <= 0:
                del shared[atom]
            else:
                shared[atom] = min(exponent, other, key=abs)
    return tuple(sorted(shared.items()))


@final
class FormBuilder:
    """Builder of the forms of one value after the other.

    Parameters
    ----------
    forms : Forms
    order : sequence of Node
        All values, operands first.

    Attributes
    ----------
    pairs : Counter
        How often two atoms meet in a term of the values.
    final : Form
        The form of the target that was built last.
    """

    def __init__(self, forms: Forms, order: Sequence[Node]) -> None:
        self.forms, self.graph = forms, forms.graph
        self.pairs: Counter[tuple[int, int]] = Counter()
        self.final: Form = ("", ())
        self._places = {node.index: (i, _LAST) for i, node in enumerate(order)}
        self._target, self._serial = self.graph.zero, 0
        self._budget, self._counted = 0.0, set[int]()

    def begin(self, target: Node, budget: float) -> None:
        """Prepare to build a form of a value, whose operations may cost so much."""
        self._target, self._budget, self.final = target, budget, ("", ())
        self._counted.clear()

    def build(self, p: Polynomial, factored: bool) -> Node:
        """Return the value of a polynomial, with common factors taken out of its terms."""
        if len(p) == 1:
            ((monomial, c),) = p.items()
            return self._scaled(monomial, c)
        common = _common(list(p))
        if common:
            inner = self.build({times(m, common, -1): c for m, c in p.items()}, factored)
            return self._monomial(times(common, ((inner.index, 1),)))
        factor = frequent(p) if factored else None
        if factor is not None:
            inside = {m: c for m, c in p.items() if dict(m).get(factor[0], 0) * factor[1] > 0}
            rest = {m: c for m, c in p.items() if m not in inside}
            part = self.build(inside, factored)
            return self._sum([(False, part), *self._terms(rest, factored)])
        return self._sum(self._terms(p, factored))

    def _make(self, op: str, *args: Node) -> Node:
        """Return the value, in the form that it has already or, without one, in this form."""
        for arg in args:
            self._bring(arg, (arg.op, arg.args))
        made = self._known(op, args) or self.graph.call(op, *args)
        if made is self._target:
            self.final = op, args
            return made
        self._bring(made, (op, args))
        if made.deps & self.forms.moving and not self.forms.uses[made.index] and made.index not in self._counted:
            self._counted.add(made.index)
            self._budget -= self.forms.weight(made)
            if self._budget < 0:
                raise UnsuitableForm
        return made

    def _bring(self, node: Node, form: Form) -> None:
        """Place a value before the target; one that has no uses yet takes the given form."""
        here = self._places[self._target.index]
        if not node.deps & self.forms.moving or self._places.get(node.index, here) < here:
            return
        unused = not self.forms.uses[node.index]
        args = form[1] if unused else self.forms.args(node)
        if node is self._target or any(self._place(arg) >= here for arg in args):
            raise UnsuitableForm
        if unused:
            self.forms.choose(node, form)
        self._serial += 1
        self._places[node.index] = here[0], self._serial

    def _known(self, op: str, args: tuple[Node, ...]) -> Node | None:
        """Return the value, where the graph holds it already."""
        a, b = args[0].fingerprint, args[-1].fingerprint
        match op:
            case "mul":
                return self.graph.find(a * b % fp.PRIME)
            case "add":
                return self.graph.find((a + b) % fp.PRIME)
            case "sub":
                return self.graph.find((a - b) % fp.PRIME)
            case _:
                return None

    def _place(self, node: Node) -> tuple[int, int]:
        return self._places.get(node.index, (_LAST, 0)) if node.deps & self.forms.moving else (-1, 0)

    def _terms(self, p: Polynomial, factored: bool) -> list[tuple[bool, Node]]:
        """Return (whether negative, value) of what a polynomial is the sum of, terms of one coefficient together."""
        if factored and frequent(p) is not None:
            return [(False, self.build(p, factored))]
        groups: dict[int, list[tuple[bool, Monomial]]] = {}
        for monomial, c in p.items():
            negative, size = sign(c)
            groups.setdefault(size.index if monomial else -1, []).append((negative, monomial))
        terms: list[tuple[bool, Node]] = []
        for index, members in groups.items():
            if index < 0:
                terms.append(sign(p[()]))
                continue
            size = self.graph.nodes[index]
            if size.is_one or len(members) == 1:
                terms += [(negative, self._scaled(monomial, size)) for negative, monomial in members]
            else:
                first = members[0][0]
                total = self._sum([(negative != first, self._monomial(m)) for negative, m in members])
                terms.append((first, self._make("mul", size, total)))
        return terms

    def _sum(self, terms: Sequence[tuple[bool, Node]]) -> Node:
        ordered = [t for t in terms if not t[0]] + [t for t in terms if t[0]]
        negative, total = ordered[0]
        if negative:
            for _, term in ordered[1:]:
                total = self._make("add", total, term)
            return self._make("neg", total)
        for negative, term in ordered[1:]:
            total = self._make("sub" if negative else "add", total, term)
        return total

    def _scaled(self, monomial: Monomial, c: Node) -> Node:
        """Return c times a monomial, the fixed factor last."""
        if not monomial:
            return c
        negative, size = sign(c)
        value = self._monomial(monomial)
        if not size.is_one:
            value = self._make("mul", size, value)
        return self._make("neg", value) if negative else value

    def _monomial(self, monomial: Monomial) -> Node:
        above = self._power([(atom, e) for atom, e in monomial if e > 0])
        below = self._power([(atom, -e) for atom, e in monomial if e < 0])
        return above if below.is_one else self._make("div", above, below)

    def _power(self, powers: Sequence[tuple[int, int]]) -> Node:
        """Return a product of powers: squares of products, and pairs that exist or will be shared first."""
        if not powers:
            return self.graph.one
        half = [(atom, e // 2) for atom, e in powers if e > 1]
        pool = [atom for atom, e in powers if e % 2]
        if half:
            root = self._power(half)
            pool.append(self._make("mul", root, root).index)
        while len(pool) > 1:
            a, b = self._pair(sorted(pool))
            pool.remove(a)
            pool.remove(b)
            pool.append(self._make("mul", self.graph.nodes[a], self.graph.nodes[b]).index)
        return self.graph.nodes[pool[0]]

    def _pair(self, pool: Sequence[int]) -> tuple[int, int]:
        """Return which two factors to multiply first."""
        pairs = [(a, b) for i, a in enumerate(pool) for b in pool[i + 1 :]]
        if len(pairs) == 1:
            return pairs[0]
        nodes = self.graph.nodes
        for a, b in pairs:
            known = self.graph.find(nodes[a].fingerprint * nodes[b].fingerprint % fp.PRIME)
            if known is not None and self.forms.uses[known.index]:
                return a, b
        return max(pairs, key=lambda pair: self.pairs[pair])
