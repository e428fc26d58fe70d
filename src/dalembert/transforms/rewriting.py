"""Forms of values with fewer products of varying values.

A Taylor step pays for each product, quotient or square of varying values with a sum over all orders, and next
to nothing for sums and fixed factors. Each value is tried in other forms, got by factoring its polynomial; how
much a form costs is what it adds to what other values need anyway, less what only the old form needed. Both
follow from reference counts: DAG-aware rewriting (Mishchenko, Chatterjee, Brayton, DAC 2006). A form that loses
digits which the value as it came has (`dalembert.ir.accuracy`) is not taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import final

from ..ir.accuracy import Probed, loses, probed, probed_form
from ..ir.graph import Graph
from ..ir.node import Node
from .forms import FormBuilder, Forms, UnsuitableForm, frequent
from .polynomial import Form, Polynomial, Polynomials, pythagorean

_PASSES = 3
_TWICE, _THOROUGH, _LARGEST = 90, 300, 1000
"""Values up to which all is tried twice, every form is tried, and any is: the time goes with their number."""
_FIRST_SLACKS = (1.5, 13.0)
"""Costs that a form may add in the first pass: a sum, or a product. That one can be shared shows once others do so. The
first finds more in most scenes, the second in those whose products cancel in several values at once, such as double
pendulums and tops: their Taylor steps lose a fifth to two fifths of their operations."""


def rewritten(graph: Graph, nodes: Sequence[Node], fixed: Sequence[str]) -> tuple[Forms, list[Node]]:
    """Return forms for `nodes`, copied to a graph of their own, where inputs called `fixed` do not vary."""
    order = list(islice(graph.topological(nodes), _LARGEST + 1))
    if len(order) > _LARGEST:
        return Forms(graph), list(nodes)
    best, found = math.inf, (Forms(graph), list(nodes))
    slacks = _FIRST_SLACKS if len(order) <= _TWICE else _FIRST_SLACKS[:1]
    copy, errors, moving = Graph(), dict[int, Probed](), 0
    new: dict[int, Node] = {}
    for node in order:
        made = new[node.index] = copy.adopt_one(node, new)
        if node.op == "input" and str(node.payload) not in fixed:
            moving |= made.deps
    for slack in slacks:
        own = copy if slack == slacks[-1] else copy.copy()
        copies = {node: own.nodes[new[node.index].index] for node in order}
        forms, outputs, work = _rewritten(own, copies, nodes, moving, slack, errors)
        if work < best:
            best, found = work, (forms, outputs)
    return found


def _rewritten(
    graph: Graph, new: Mapping[Node, Node], nodes: Sequence[Node], moving: int, slack: float, errors: dict[int, Probed]
) -> tuple[Forms, list[Node], float]:
    """Return forms, the nodes on their graph, and the cost, infinite where they are no cheaper or lose digits.

    `new` are the nodes of the graph, operands first, by what they are copies of; `errors` of their forms are computed
    where they are not known.
    """
    forms = Forms(graph, moving)
    for node, copy in new.items():
        forms.choose(copy, (node.op, tuple(new[arg] for arg in node.args)))
    outputs = [new[node] for node in nodes]
    for output in outputs:
        if output.deps & forms.moving:
            forms.uses[output.index] += 1
            if forms.uses[output.index] == 1:
                forms.acquire(output)
    before = forms.work(outputs)
    for output in outputs:
        probed(output, errors, forms.of)
    _Rewriter(forms, list(new.values()), errors, slack).run()
    after: dict[int, Probed] = {}
    work = forms.work(outputs)
    lost = any(loses(probed(n, after, forms.of), errors[n.index]) for n in outputs)
    return forms, outputs, math.inf if work > before or lost else work


@final
class _Rewriter:
    """Rounds over all values, operands first; each value takes the cheapest of the forms tried."""

    def __init__(self, forms: Forms, order: Sequence[Node], errors: dict[int, Probed], first_slack: float) -> None:
        self.forms, self.graph, self.order, self.errors = forms, forms.graph, order, errors
        self.thorough, self.first_slack = len(order) <= _THOROUGH, first_slack
        self.values = Polynomials(self.graph, forms.moving, forms.of)
        self.builder, self.slack = FormBuilder(forms, order), 0.0
        self.changed: set[int] | None = None

    def run(self) -> None:
        """Rewrite until nothing gets cheaper."""
        for number in range(_PASSES if self.thorough else 1):
            self._count_pairs()
            self.slack = self.first_slack if number == 0 and self.thorough else -1e-9
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
        pairs = self.builder.pairs
        pairs.clear()
        opened = Polynomials(self.graph, self.forms.moving, self.forms.of, lambda node, inside: self._is_product(node))
        whole = {arg.index for n in self.order if not self._is_product(n) for arg in self.forms.args(n)}
        for node in self.order:
            if self.forms.uses[node.index] and self._is_product(node) and node.index in whole:
                for monomial in opened.of(node):
                    atoms = [atom for atom, exponent in monomial if exponent > 0]
                    pairs.update((a, b) for i, a in enumerate(atoms) for b in atoms[i + 1 :])

    def _is_product(self, node: Node) -> bool:
        return self.forms.of(node)[0] in ("mul", "div")

    def _rewrite(self, node: Node) -> None:
        """Set the form of `node` to its cheapest one."""
        forms, builder, old = self.forms, self.builder, self.forms.of(node)
        best_cost, best = forms.weight(node) + forms.release(node), old
        for p in self._polynomials(node):
            for factored in (True, False) if len(p) > 2 and frequent(p) else (True,):
                builder.begin(node, best_cost + self.slack)
                try:
                    made = builder.build(p, factored)
                except UnsuitableForm:
                    continue
                if made is not node or not builder.final[0]:
                    continue
                forms.choose(node, builder.final)
                cost = forms.weight(node) + forms.acquire(node)
                forms.release(node)
                if cost < best_cost + self.slack and self._is_accurate(node, builder.final):
                    best_cost, best = cost, builder.final
        forms.choose(node, best)
        forms.acquire(node)
        if best is not old:
            assert self.changed is not None
            self.changed |= {node.index, *(arg.index for arg in (*old[1], *best[1]))}

    def _is_accurate(self, node: Node, form: Form) -> bool:
        """Return whether a form loses no digit that the original form of the value has."""
        known, count = self.errors, len(self.errors)
        for arg in form[1]:
            probed(arg, known, self.forms.of)
        lost = loses(probed_form(*form, known), known[node.index])
        while len(known) > count:  # other values may have other forms later
            known.popitem()
        return not lost

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
