"""Rewriting to forms with fewer products of varying values, for all outputs of a kernel together.

A Taylor step pays for each product, quotient or square of varying values with a sum over all orders, and next
to nothing for sums and fixed factors. Each value is tried in other forms, got by factoring its polynomial; how
much a form costs is what it adds to what other values need anyway, less what only the old form needed. Both
follow from reference counts: DAG-aware rewriting (Mishchenko, Chatterjee, Brayton, DAC 2006). A form that loses
digits which the value as it came has (`dalembert.ir.accuracy`) is not taken.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import final

from ..ir import fingerprint as fp
from ..ir.accuracy import Probed, loses, probed, probed_form
from ..ir.graph import Graph, Node
from .forms import Forms
from .polynomial import Form, Monomial, Polynomial, Polynomials, pythagorean, sign, times

__all__ = ["rewritten"]

_PASSES = 3
_THOROUGH, _LARGEST = 300, 1000
"""Values up to which every form is tried, and up to which any is: the time goes with their number."""
_FIRST_SLACK = 1.5
"""Factor by which a form may cost more in the first pass: that a product can be shared shows once others do so."""
_LAST = 1 << 60


def rewritten(graph: Graph, nodes: Sequence[Node], fixed: Sequence[str]) -> tuple[Forms, list[Node]]:
    """Return forms for `nodes`, copied to a graph of their own, where inputs called `fixed` do not vary."""
    order = list(islice(graph.topological(nodes), _LARGEST + 1))
    if len(order) > _LARGEST:
        return Forms(graph), list(nodes)
    copy = Graph()
    new: dict[int, Node] = {}
    forms = Forms(copy, 0)
    for node in order:
        made = copy.adopt_one(node, new)
        new[node.index] = made
        if node.op == "input" and str(node.payload) not in fixed:
            forms.moving |= made.deps
    for node in order:
        forms.choose(new[node.index], (node.op, tuple(new[arg.index] for arg in node.args)))
    outputs = [new[node.index] for node in nodes]
    for output in outputs:
        if output.deps & forms.moving:
            forms.uses[output.index] += 1
            if forms.uses[output.index] == 1:
                forms.acquire(output)
    before = forms.work(outputs)
    errors: dict[int, Probed] = {}
    for output in outputs:
        probed(output, errors, forms.of)
    _Rewriter(forms, [new[node.index] for node in order], errors).run()
    after: dict[int, Probed] = {}
    if forms.work(outputs) > before or any(loses(probed(n, after, forms.of), errors[n.index]) for n in outputs):
        return Forms(graph), list(nodes)
    return forms, outputs


class _UnsuitableForm(Exception):
    """Raised for a form that needs a value computed later, or that costs more than the best known form."""


@final
class _Rewriter:
    """Rounds over all values, operands first; each value takes the cheapest of the forms tried."""

    def __init__(self, forms: Forms, order: Sequence[Node], errors: dict[int, Probed]) -> None:
        self.forms, self.graph, self.order, self.errors = forms, forms.graph, order, errors
        self.thorough = len(order) <= _THOROUGH
        self.places = {node.index: (i, _LAST) for i, node in enumerate(order)}
        self.values = Polynomials(self.graph, forms.moving, forms.of)
        self.pairs: Counter[tuple[int, int]] = Counter()
        self.target, self.serial = self.graph.zero, 0
        self.final: Form = ("", ())
        self.budget, self.slack, self.counted = 0.0, 0.0, set[int]()
        self.changed: set[int] | None = None

    def run(self) -> None:
        """Rewrite until nothing gets cheaper."""
        for number in range(_PASSES if self.thorough else 1):
            self._count_pairs()
            self.slack = _FIRST_SLACK if number == 0 and self.thorough else -1e-9
            near, self.changed = self.changed, set()
            for node in self.order:
                if self._is_open(node) and self.forms.uses[node.index] and (near is None or self._touches(node, near)):
                    self._rewrite(node)
            if not self.changed:
                return

    def _touches(self, node: Node, near: set[int]) -> bool:
        """Whether a value, its operands or theirs are among `near`."""
        args = self.forms.args
        return node.index in near or any(a.index in near or any(b.index in near for b in args(a)) for a in args(node))

    def _is_open(self, node: Node) -> bool:
        return bool(node.deps & self.forms.moving) and self.forms.of(node)[0] in ("add", "sub", "mul", "div", "neg")

    def _count_pairs(self) -> None:
        """Count how often two atoms meet in a term, so that products which will be shared are formed first."""
        self.pairs.clear()
        opened = Polynomials(self.graph, self.forms.moving, self.forms.of, lambda node, inside: self._is_product(node))
        whole = {arg.index for n in self.order if not self._is_product(n) for arg in self.forms.args(n)}
        for node in self.order:
            if self.forms.uses[node.index] and self._is_product(node) and node.index in whole:
                for monomial in opened.of(node):
                    atoms = [atom for atom, exponent in monomial if exponent > 0]
                    self.pairs.update((a, b) for i, a in enumerate(atoms) for b in atoms[i + 1 :])

    def _is_product(self, node: Node) -> bool:
        return self.forms.of(node)[0] in ("mul", "div")

    def _rewrite(self, node: Node) -> None:
        """Set the form of `node` to its cheapest one."""
        forms, old = self.forms, self.forms.of(node)
        best_cost, best = forms.weight(node) + forms.release(node), old
        self.target = node
        for p in self._polynomials(node):
            for factored in (True, False) if len(p) > 2 and self._frequent(p) else (True,):
                self.final, self.budget = ("", ()), best_cost + self.slack
                self.counted.clear()
                try:
                    made = self._build(p, factored)
                except _UnsuitableForm:
                    continue
                if made is not node or not self.final[0]:
                    continue
                forms.choose(node, self.final)
                cost = forms.weight(node) + forms.acquire(node)
                forms.release(node)
                if cost < best_cost + self.slack and self._is_accurate(node, self.final):
                    best_cost, best = cost, self.final
        forms.choose(node, best)
        forms.acquire(node)
        if best is not old:
            assert self.changed is not None
            self.changed |= {node.index, *(arg.index for arg in (*old[1], *best[1]))}

    def _is_accurate(self, node: Node, form: Form) -> bool:
        """Return whether a form loses no digit that the original form of the value has."""
        known = dict(self.errors)
        for arg in form[1]:
            probed(arg, known, self.forms.of)
        return not loses(probed_form(*form, known), self.errors[node.index])

    def _polynomials(self, node: Node) -> Iterator[Polynomial]:
        """Yield polynomials of a value, opened more and more deeply; what is in use elsewhere is opened late."""
        uses, graph, forms = self.forms.uses, self.graph, self.forms

        def open_unused(n: Node, inside: bool) -> bool:
            return n is node or (not uses[n.index] and (self._is_product(n) or not inside))

        def open_products(n: Node, inside: bool) -> bool:
            return n is node or self._is_product(n) or not (uses[n.index] or inside)

        def open_unused_sums(n: Node, inside: bool) -> bool:
            return n is node or not uses[n.index] or self._is_product(n)

        seen: list[Polynomial] = []
        for opened in (open_unused, open_products, open_unused_sums) if self.thorough else (open_unused_sums,):
            found = Polynomials(graph, forms.moving, forms.of, opened).of(node)
            seen.append(pythagorean(graph, found, forms.of, canonical=False))
        if self.thorough:
            seen.append(pythagorean(graph, self.values.of(node), forms.of, canonical=False))
        for place, p in enumerate(seen):
            if p not in seen[:place] and p.keys() != {((node.index, 1),)}:
                yield p

    # -- building -------------------------------------------------------------------------

    def _make(self, op: str, *args: Node) -> Node:
        """Return the value, in the form that it has already or, without one, in this form."""
        for arg in args:
            self._bring(arg, (arg.op, arg.args))
        made = self._known(op, args) or self.graph.call(op, *args)
        if made is self.target:
            self.final = op, args
            return made
        self._bring(made, (op, args))
        if made.deps & self.forms.moving and not self.forms.uses[made.index] and made.index not in self.counted:
            self.counted.add(made.index)
            self.budget -= self.forms.weight(made)
            if self.budget < 0:
                raise _UnsuitableForm
        return made

    def _bring(self, node: Node, form: Form) -> None:
        """Place a value before the target; one that has no uses yet takes the given form."""
        here = self.places[self.target.index]
        if not node.deps & self.forms.moving or self.places.get(node.index, here) < here:
            return
        unused = not self.forms.uses[node.index]
        args = form[1] if unused else self.forms.args(node)
        if node is self.target or any(self._place(arg) >= here for arg in args):
            raise _UnsuitableForm
        if unused:
            self.forms.choose(node, form)
        self.serial += 1
        self.places[node.index] = here[0], self.serial

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
        return self.places.get(node.index, (_LAST, 0)) if node.deps & self.forms.moving else (-1, 0)

    def _build(self, p: Polynomial, factored: bool) -> Node:
        """Return the value of a polynomial, with common factors taken out of its terms."""
        if len(p) == 1:
            ((monomial, c),) = p.items()
            return self._scaled(monomial, c)
        common = self._common(list(p))
        if common:
            inner = self._build({times(m, common, -1): c for m, c in p.items()}, factored)
            return self._monomial(times(common, ((inner.index, 1),)))
        factor = self._frequent(p) if factored else None
        if factor is not None:
            inside = {m: c for m, c in p.items() if dict(m).get(factor[0], 0) * factor[1] > 0}
            rest = {m: c for m, c in p.items() if m not in inside}
            part = self._build(inside, factored)
            return self._sum([(False, part), *self._terms(rest, factored)])
        return self._sum(self._terms(p, factored))

    def _terms(self, p: Polynomial, factored: bool) -> list[tuple[bool, Node]]:
        """Return (whether negative, value) of what a polynomial is the sum of, terms of one coefficient together."""
        if factored and self._frequent(p) is not None:
            return [(False, self._build(p, factored))]
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

    def _common(self, monomials: Sequence[Monomial]) -> Monomial:
        """Return the largest monomial that divides all."""
        shared = dict(monomials[0])
        for monomial in monomials[1:]:
            powers = dict(monomial)
            for atom, exponent in list(shared.items()):
                other = powers.get(atom, 0)
                if exponent * other <= 0:
                    del shared[atom]
                else:
                    shared[atom] = min(exponent, other, key=abs)
        return tuple(sorted(shared.items()))

    def _frequent(self, p: Polynomial) -> tuple[int, int] | None:
        """Return the atom and the sign of its exponent that most terms have, if two have it."""
        counts: Counter[tuple[int, int]] = Counter(
            (atom, 1 if exponent > 0 else -1) for monomial in p for atom, exponent in monomial
        )
        if not counts:
            return None
        best, count = max(counts.items(), key=lambda item: (item[1], -item[0][0]))
        return best if count > 1 else None

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
