"""Slip velocities of contacts that stick as constraints, without those that other rows imply.

What others imply of a contact leaves its friction forces undetermined. Contacts that can only slip together share them
(`contacts.equations.shared_loads`), and one that cannot slip at all needs none. Constraints may leave a contact in a
plane one direction of slip, as a puck on a table at a wall: its slip velocities are then s_b = a s_a, whatever else
moves. Across that line, friction and the reactions of the constraints share a load that the equations of motion do not
determine. The motion does not depend on the shares, and friction needs least where it has none of it: its force is
along the line, F_b = a F_a. Where a wall would have to pull for that, it opens, and friction has all of the load.

Of two contacts in one plane whose points belong to one link (`dependent_slips`), F_1 and F_2 are the friction
forces, n is the direction across the line through both points, a parameter of the mode, and e is that along it. The
unknowns of the mode are X = F_1 + F_2 and c = n F_2; the part e F_2 of e X is not determined. There is one within both
cones as long as each |n F_i| is at most its limit L_i, and |e X| at most the sum of what is left,
w_i = sqrt(L_i^2 - (n F_i)^2). Reactions have parts of e X that are proportional to w_1 and w_2.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import final

from ...errors import ConstraintError, list_names
from ...frozen import frozen
from ...ir.graph import Graph
from ...ir.node import Node
from ...mechanics.equations import ConstraintRow, ContactRow, EquationsOfMotion, Guard
from ...reduction.unit_sphere import unit_values
from ...transforms.linear import dependence
from .contact_laws import ContactLaws, mode_parameters


@final
@frozen
class SlipLine:
    """A contact in a plane, and the factors of its two friction forces: they are these times the force along the line.

    That is an unknown in place of the first friction force.
    """

    contact: ContactRow
    factors: tuple[Node, Node]

    def parts(self, graph: Graph, names: Sequence[str]) -> tuple[Node, Node]:
        """Return both friction forces in terms of the one along the line."""
        force = graph.input(self.named(names)[self.contact.tangential[0]])
        return self.factors[0] * force, self.factors[1] * force

    def forces(self, graph: Graph, names: Sequence[str]) -> dict[Node, Node]:
        """Return both friction forces by their inputs."""
        inputs = (graph.input(names[i]) for i in self.contact.tangential)
        return dict(zip(inputs, self.parts(graph, names), strict=True))

    def entries(self) -> tuple[tuple[int, Node], tuple[int, Node]]:
        """Return both friction forces as numbers of unknowns and factors."""
        own = self.contact.tangential[0]
        return (own, self.factors[0]), (own, self.factors[1])

    def named(self, names: Sequence[str]) -> list[str]:
        """Return the names of unknowns with that of the force along the line."""
        own = self.contact.tangential[0]
        return [f"friction of {self.contact.name} along its line" if i == own else name for i, name in enumerate(names)]


def along_lines(equations: EquationsOfMotion, lines: Iterable[SlipLine]) -> EquationsOfMotion:
    """Return equations in which forces along lines, and across them, have the power of both friction forces."""
    reactions = [list(row) for row in equations.reactions]
    for line in lines:
        (first, second), (a, b) = line.contact.tangential, line.factors
        for row in reactions:
            row[first], row[second] = a * row[first] + b * row[second], a * row[second] - b * row[first]
    return replace(equations, reactions=reactions)


@final
class StickingRows:
    """Constraints of a mode: those of the scene that it has, and what is added of contacts that stick.

    Attributes
    ----------
    rows : list of ConstraintRow
        The constraints, then the slip velocities that none of the rows before implies.
    groups : dict of str to list of ContactRow
        By the name of the contact that holds them, the others that cannot slip while it does not.
    idle : list of ContactRow
        Contacts that cannot slip anyway, and need no friction.
    lines : dict of str to SlipLine
        Contacts in a plane, by name, that can slip in one direction.
    """

    def __init__(self, equations: EquationsOfMotion, rows: Sequence[ConstraintRow], paired: Collection[str]) -> None:
        self._name, self._graph, self._paired = equations.name, equations.graph, paired
        self._own = Graph()  # weights are not computed here as forces will be
        self._units = unit_values(equations)  # where a quaternion has length one, contacts of its body may be dependent
        self.rows = [*rows]
        self.groups: dict[str, list[ContactRow]] = {}
        self.idle: list[ContactRow] = []
        self.lines: dict[str, SlipLine] = {}
        self._owners: list[ContactRow] = []

    @cached_property
    def _independent(self) -> list[list[Node]]:
        """The rows of the Jacobian that do not depend on others, those of `_owners` last."""
        found: list[list[Node]] = []
        for row in self.rows:
            slopes = self._slopes(row)
            if dependence(self._own, found, slopes) is None:
                found.append(slopes)
        return found

    @property
    def redundant(self) -> bool:
        """Whether some constraints of the scene imply others."""
        return len(self._independent) < len(self.rows)

    def add(self, contact: ContactRow, slips: Sequence[ConstraintRow]) -> None:
        """Add the slip velocities of a contact that sticks.

        Raises
        ------
        ConstraintError
            Where it is not determined which of several contacts slips first.
        """
        tied: list[tuple[int, Node]] = []
        for k, row in enumerate(slips):
            slopes = self._slopes(row)
            weights = dependence(self._own, self._independent, slopes)
            if weights is None:
                self.rows.append(row)
                self._independent.append(slopes)
                self._owners.append(contact)
                continue
            weights = weights[len(self._independent) - len(self._owners) :]
            holding = [owner for owner, weight in zip(self._owners, weights, strict=True) if not weight.is_zero]
            if self._may_be_tied(contact) and all(owner is contact for owner in holding):
                tied.append((k, weights[-1] if holding else self._own.zero))
            else:
                self._share(contact, holding)
        if tied:
            self._tie(contact, tied)

    def _slopes(self, row: ConstraintRow) -> list[Node]:
        """Return the row of the Jacobian in the graph of the weights."""
        return self._own.adopt(self._graph.substitute(row.jacobian, self._units) if self._units else row.jacobian)

    def _may_be_tied(self, contact: ContactRow) -> bool:
        """Whether constraints may leave a contact one direction of slip, of two of its own."""
        return len(contact.slips) > 1 and contact.name not in self._paired

    def _share(self, contact: ContactRow, holding: Sequence[ContactRow]) -> None:
        """Note that a contact cannot slip while others stick; where there are none, it cannot slip at all."""
        along_lines_only = all(len(each.slips) == 1 for each in (contact, *holding))
        given = any(each.normal_load is not None for each in (contact, *holding))
        further = any(each.leader is not None for each in (contact, *holding))
        if not along_lines_only or (len(holding) > 1 and not further) or (holding and given):
            others = dict.fromkeys(owner.name for owner in holding if owner is not contact)
            raise ConstraintError(
                f"scene {self._name!r}: the contacts {contact.name!r} and"
                f" {list_names(repr(o) for o in others)} hold each other while they stick, and which of"
                " them slips first is not determined: give one of them friction=0 or a regularization, or write"
                " those with given normal loads as one law with the sum of the loads"
            )
        for owner in holding:
            self.groups.setdefault(owner.name, []).append(contact)
        if not holding:
            self.idle.append(contact)

    def _tie(self, contact: ContactRow, tied: Sequence[tuple[int, Node]]) -> None:
        """Note that constraints leave a contact in a plane one direction of slip, or none."""
        (k, share), *more = tied
        if more:
            self.idle.append(contact)
            return
        own, other = self._along_line(contact, k, share)
        a, b = factors = (own, other) if k == 1 else (other, own)
        self.lines[contact.name] = SlipLine(contact, factors)
        first, second = contact.slips
        self.rows[-1] = replace(
            self.rows[-1],
            jacobian=tuple(a * x + b * y for x, y in zip(first.jacobian, second.jacobian, strict=True)),
            drift=a * first.drift + b * second.drift,
            bias=a * first.bias + b * second.bias,
        )

    def _along_line(self, contact: ContactRow, k: int, share: Node) -> tuple[Node, Node]:
        """Return the factors of the slip velocity that decides and of slip velocity k, which is a share of it.

        Where the share varies, they have length one: the slip velocity that decides may vanish on the way.
        """
        graph = self._graph
        if not share.deps:
            return graph.one, graph.adopt([share])[0]
        others = [*self._independent[:-1], self._slopes(contact.slips[k])]
        inverse = dependence(self._own, others, self._independent[-1])
        assert inverse is not None
        share, inverse_share = graph.adopt([share, inverse[-1]])
        small = graph.call("less", graph.call("abs", share), graph.one)
        sizes = [graph.call("sqrt", graph.one + each * each) for each in (share, inverse_share)]
        own = graph.call("select", small, graph.one / sizes[0], inverse_share / sizes[1])
        return own, graph.call("select", small, share / sizes[0], graph.one / sizes[1])


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
