"""Two contacts in one plane that stick and whose points belong to one link (`points_of_one_link`).

F_1 and F_2 are their friction forces, n is the direction across the line through both points, a parameter of the mode,
and e is that along it. The unknowns of the mode are X = F_1 + F_2 and c = n F_2; the part e F_2 of e X is not
determined. There is one within both cones as long as each |n F_i| is at most its limit L_i, and |e X| at most the sum
of what is left, w_i = sqrt(L_i^2 - (n F_i)^2). Reactions have parts of e X that are proportional to w_1 and w_2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import final

from ...ir.node import Node
from ...mechanics.equations import ConstraintRow, EquationsOfMotion, Guard
from .contact_laws import ContactLaws, mode_parameters


@final
class StickingPair:
    """Two contacts of one link that stick, by their numbers."""

    def __init__(self, laws: ContactLaws, first: int, second: int) -> None:
        contacts = laws.whole.contacts
        self.laws, self.graph, self.numbers = laws, laws.graph, (first, second)
        self.first, self.second = contacts[first], contacts[second]
        self.n = [self.graph.input(name) for name in mode_parameters(self.second)[:2]]
        both = f"{self.first.name} and {self.second.name}"
        self.names = {
            self.first.tangential[0]: f"friction 1 of {both}",
            self.first.tangential[1]: f"friction 2 of {both}",
            self.second.tangential[0]: f"friction across {both}",
        }
        self.x1, self.x2, self.c = (self.graph.input(name) for name in self.names.values())

    def row(self) -> ConstraintRow:
        """Return the difference of the slips across the line as a row: a turn of the link about the normal.

        The slips themselves have entries across the line that vanish where the line has the direction of an axis.
        """

        def across(values: Callable[[ConstraintRow], Sequence[Node]]) -> list[Node]:
            slips = zip(self.n, self.second.slips, self.first.slips, strict=True)
            parts = [[n * (a - b) for a, b in zip(values(x), values(y), strict=True)] for n, x, y in slips]
            return [self.graph.sum(terms) for terms in zip(*parts, strict=True)]

        drift, bias = across(lambda row: (row.drift, row.bias))
        return replace(self.second.slips[0], jacobian=tuple(across(lambda row: row.jacobian)), drift=drift, bias=bias)

    def column(self, powers: Sequence[Node]) -> Node:
        """Return the power coefficient of c in a row of those of all reactions."""
        differences = zip(self.n, self.second.tangential, self.first.tangential, strict=True)
        return self.graph.sum(n * (powers[j] - powers[i]) for n, j, i in differences)

    @cached_property
    def _across(self) -> tuple[Node, Node]:
        """The friction forces n F_1 and n F_2."""
        return self.n[0] * self.x1 + self.n[1] * self.x2 - self.c, self.c

    @cached_property
    def _left(self) -> tuple[Node, Node]:
        """What the cones leave along the line, squared: L_i^2 - (n F_i)^2."""
        contacts = zip((self.first, self.second), self._across, strict=True)
        limits = [(self.laws.most_friction(contact, self.laws.normal(contact)), part) for contact, part in contacts]
        one, other = (most * most - part * part for most, part in limits)
        return one, other

    @cached_property
    def _along(self) -> tuple[Node, Node, Node]:
        """The friction e X along the line, and what the cones leave there."""
        first, second = (self.graph.call("sqrt", self.graph.call("max", left, self.graph.zero)) for left in self._left)
        return self.n[0] * self.x2 - self.n[1] * self.x1, first, second

    def guards(self, i: int) -> list[tuple[Guard, Node]]:
        """Return by how much friction could be more at a contact across the line, and at both of them along it."""
        name, (total, first, second) = self.laws.whole.contacts[i].name, self._along
        most = first + second
        return [
            (Guard(f"hold of {name} across its pair", i, "break"), self._left[self.numbers.index(i)]),
            (Guard(f"hold of {name} with its pair", i, "break"), most * most - total * total),
        ]

    def forces(self) -> dict[Node, Node]:
        """Return the friction forces of both contacts by the inputs of their names."""
        names, (total, first, second) = self.laws.whole.symbols.unknowns, self._along
        most, found = first + second, dict[Node, Node]()
        share = total / self.graph.call("select", self.graph.call("less", self.graph.zero, most), most, self.graph.one)
        pushed = zip((self.first, self.second), self._across, (share * first, share * second), strict=True)
        for contact, across, along in pushed:
            one, other = (self.graph.input(names[i]) for i in contact.tangential)
            found[one] = self.n[0] * across - self.n[1] * along
            found[other] = self.n[1] * across + self.n[0] * along
        return found


def with_pairs(equations: EquationsOfMotion, pairs: Sequence[StickingPair]) -> EquationsOfMotion:
    """Return equations with the unknowns of pairs in place of their friction forces, of which the last one is left."""
    names, reactions = list(equations.symbols.unknowns), [list(row) for row in equations.reactions]
    for pair in pairs:
        for i, name in pair.names.items():
            names[i] = name
        for row in reactions:
            row[pair.second.tangential[0]] = pair.column(row)
    if not pairs:
        return equations
    return replace(equations, symbols=replace(equations.symbols, unknowns=tuple(names)), reactions=reactions)
