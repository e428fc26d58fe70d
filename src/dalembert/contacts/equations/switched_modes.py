"""One program for all modes of many contacts: [EquationsOfMotion] -> [EquationsOfMotion], rows switched by parameters.

The reactions x of all contacts satisfy (S W S + I - S) x = S (b - J a), with W = J M^-1 P, where J are the rows of gaps
and slip velocities, b what these demand, P the power coefficients of the reactions, with friction -kappa N in the
columns of the normal reactions, and a the accelerations without contacts. S is diagonal, 1 where a row holds in a mode
and 0 where it does not; there x is 0. Entering a mode sets these switches. The program has no constraints but the
lengths of quaternions, which are rows that always hold: reactions are given forces, and Newton corrections by the same
matrix without friction project each step onto the rows that hold. Where M is singular without the lengths L, M + L^T L
takes its place.

Rows that hold in a mode may come to depend on each other where a motion passes. Without friction the pivots of the
matrix are guarded, as those of constraints are (`dalembert.reduction.saddle`). With friction they are not: reactions
that grow without bound there stop what slips, and the motion ends in a jam.

Where a contact sticks whose slip velocity follows from the rows that hold, its own row does not, and it shares the
friction force of another (`dalembert.contacts.equations.dependent_slips`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import final

from ...frozen import frozen
from ...ir.conditions import CONDITION_TIME
from ...ir.node import Node
from ...mechanics.equations import ConstraintRow, ContactRow, EquationsOfMotion, Guard
from ...reduction.base import Projection, ReducedSystem, ReductionSettings
from ...reduction.first_order_states import with_states
from ...reduction.saddle import Projected, SaddlePoint
from ...transforms.linear import Elimination, Matrix, guarded_pivot
from .contact_laws import OPEN, SLIP, STICK, ContactLaws, Mode, mode_parameters
from .dependent_slips import coupled_slips
from .shared_loads import support_distance


def any_mode(count: int) -> Mode:
    """Return the name of the common program of all modes of so many contacts, in place of a mode."""
    return ("any",) * count


def why_unswitched(equations: EquationsOfMotion) -> str:
    """Return why the modes of a scene have no common program; empty where they have one."""
    contacts = equations.contacts
    if any(contact.leader is not None for contact in contacts):
        return "a contact has several laws of friction"
    if any(contact.constraint is None for contact in contacts):
        return "there is friction without a contact"
    if any(contact.regularization is not None for contact in contacts):
        return "there are smooth laws of friction"
    if len(equations.constraints) - len(unit_lengths(equations)) > len(contacts):
        return "there are constraints that always hold"
    if CONDITION_TIME in equations.symbols.parameters:
        decided = equations.graph.input(CONDITION_TIME).deps
        rows = [*equations.constraints, *(slip for contact in contacts for slip in contact.slips)]
        nodes = [node for row in rows for node in (row.position, row.drift, *row.jacobian) if node is not None]
        if any(node.deps & decided for node in (equations.kinetic_energy, *nodes)):
            return "bodies or surfaces move by conditions on time"
    if len(equations.symbols.unknowns) > sum(1 + len(contact.tangential) for contact in contacts):
        return "there are reactions besides those of the contacts"
    return ""


def unit_lengths(equations: EquationsOfMotion) -> list[ConstraintRow]:
    """Return the constraints that make the lengths of quaternions one, which hold in all modes."""
    labels = {group.norm for group in equations.groups if group.norm}
    opening = {contact.constraint for contact in equations.contacts}
    return [row for i, row in enumerate(equations.constraints) if row.label in labels and i not in opening]


def _names(contact: ContactRow) -> list[str]:
    """Return the names of the switches of a contact."""
    return [f"{contact.name} {what}" for what in ("is closed", "slips", "sticks", "holds")]


def switches(contacts: Sequence[ContactRow], mode: Mode, sharing: Mapping[int, int]) -> dict[str, float]:
    """Return the switches of contacts in a mode by name.

    Contacts that share the friction force of another have the number of that one; their own rows do not hold.
    """
    found: dict[str, float] = {}
    for i, (contact, state) in enumerate(zip(contacts, mode, strict=True)):
        values = state != OPEN, state == SLIP, state == STICK, state == STICK and i not in sharing
        found |= dict(zip(_names(contact), map(float, values), strict=True))
    return found


def switched_guards(contacts: Sequence[ContactRow], mode: Mode, sharing: Mapping[int, int]) -> list[Guard]:
    """Return what the guards of the common program are in a mode; one of a contact that has none is constant."""
    found = []
    for i, (contact, state) in enumerate(zip(contacts, mode, strict=True)):
        found.append(Guard(f"contact of {contact.name}", i, "meet" if state == OPEN else "lift"))
        for k in range(2 if contact.tangential else 0):
            kind = {SLIP: "stop", STICK: "share" if i in sharing.values() else "break"}.get(state, "")
            sign = (1, -1)[k] if kind == "break" and len(contact.tangential) == 1 else 0
            found.append(Guard(f"friction {k + 1} of {contact.name}", i, kind, sign))
    return [*found, Guard("uniqueness of reactions", -1, "paradox")]


@final
@frozen
class _Row:
    """A row of a gap, slip velocity or length of a quaternion, its switch, and the number of the reaction along it.

    The reaction of a length is a multiplier, which has no number.
    """

    row: ConstraintRow
    unknown: int | None
    switch: Node
    gap: bool


@final
class _Switched:
    """The rows of contacts, their switches, and what their reactions do."""

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.whole, self.graph, self.contacts = equations, equations.graph, equations.contacts
        self.laws = ContactLaws(equations)
        names = zip(*map(_names, self.contacts), strict=True)
        self.closed, self.slips, self.sticks, self.holds = ([self.graph.input(name) for name in row] for row in names)
        self.lengths = unit_lengths(equations)
        self.rows = [_Row(row, None, self.graph.one, gap=True) for row in self.lengths]
        for i, contact in enumerate(self.contacts):
            assert contact.constraint is not None
            self.rows.append(_Row(equations.constraints[contact.constraint], contact.normal, self.closed[i], True))
            slips = zip(contact.slips, contact.tangential, strict=True)
            self.rows += [_Row(row, unknown, self.holds[i], False) for row, unknown in slips]
        self.inertia = SaddlePoint.of(replace(equations, constraints=tuple(self.lengths)), guarded=False).mass

    def along(self, i: int, a: Sequence[Node]) -> Node:
        """Return the acceleration along a row."""
        return self.graph.sum(x * y for x, y in zip(self.rows[i].row.jacobian, a, strict=True))

    def eliminated(self, columns: Matrix, *, guarded: bool) -> Elimination:
        """Return the factors of S J M^-1 P S + I - S for columns P.

        Where `guarded`, a row that a motion takes to where it depends on those before it is set aside: these hold it.
        """
        rows, size = self.rows, range(len(self.rows))
        moved = [self.inertia.solve(column) for column in columns]
        found = [[rows[i].switch * rows[j].switch * self.along(i, moved[j]) for j in size] for i in size]
        for i in size:
            found[i][i] = found[i][i] + (self.graph.one - rows[i].switch)

        def guard(pivot: Node, terms: Node, _: int) -> Node:
            constant = self.graph.freed_of(pivot, list(self.whole.moving)) is not None
            return pivot if constant else guarded_pivot(pivot, terms)

        return Elimination(self.graph, found, guard if guarded else None)

    def columns(self) -> Matrix:
        """Return the power coefficients of the reactions along the rows."""
        reactions = self.whole.reactions
        return [
            list(each.row.jacobian) if each.unknown is None else [row[each.unknown] for row in reactions]
            for each in self.rows
        ]

    def sharing(self, b: int, d: int) -> Node:
        """Return 1 where contact d shares the friction force of b, else 0."""
        return self.holds[b] * (self.sticks[d] - self.holds[d])


def switched_equations(equations: EquationsOfMotion) -> EquationsOfMotion:
    """Return the equations of a scene in all modes of its contacts, with parameters as switches."""
    switched, graph = _Switched(equations), equations.graph
    laws, contacts, columns = switched.laws, equations.contacts, switched.columns()
    places = {each.unknown: i for i, each in enumerate(switched.rows) if each.unknown is not None}
    rough = any(contact.tangential for contact in contacts)
    plain, pushing = switched.eliminated(columns, guarded=not rough), [list(column) for column in columns]
    factors: dict[int, Node] = {}
    for contact, slips in zip(contacts, switched.slips, strict=True):
        kappa = laws.factors(contact, SLIP, graph.zero, slips) if contact.tangential else []
        factors |= dict(zip(contact.tangential, kappa, strict=True))
        own = pushing[places[contact.normal]]
        for k, factor in zip(contact.tangential, kappa, strict=True):
            own[:] = [a - factor * b for a, b in zip(own, columns[places[k]], strict=True)]
    factored = switched.eliminated(pushing, guarded=not rough)
    free = switched.inertia.solve(equations.forcing)
    x = factored.solve([r.switch * (r.row.bias - switched.along(i, free)) for i, r in enumerate(switched.rows)])
    forcing = list(equations.forcing)
    for each, column, value in zip(switched.rows, pushing, x, strict=True):
        if each.unknown is not None:
            forcing = [f + c * value for f, c in zip(forcing, column, strict=True)]
    unique = graph.one
    for a, b in zip(factored.pivots, plain.pivots, strict=True):
        unique = unique if a is b else unique * (a / b)
    along = {unknown: x[i] for unknown, i in places.items()}
    coupled = coupled_slips(equations)
    kept = [pivot.args[0] if pivot.op == "select" else graph.one for pivot in factored.pivots]
    held = {unknown: x[i] + (graph.one - kept[i]) for unknown, i in places.items()}
    supports = _supports(switched, along, plain) if equations.compliances else {}
    guards = [*_guards(switched, held, coupled, supports), (Guard("uniqueness of reactions", -1, "paradox"), unique)]
    gaps: dict[str, Node] = {}
    for contact in contacts:
        assert contact.constraint is not None and contact.gap is not None
        rate = contact.sense * laws.speed(equations.constraints[contact.constraint])
        gaps |= {f"gap of {contact.name}": contact.gap, f"gap rate of {contact.name}": rate}
    added = {name: 1.0 for contact in contacts for name in mode_parameters(contact) if name}
    added |= {name: 0.0 for contact in contacts for name in _names(contact)}
    return replace(
        equations,
        symbols=replace(equations.symbols, parameters=(*equations.symbols.parameters, *added)),
        forcing=tuple(forcing),
        constraints=tuple(switched.lengths),
        outputs={**equations.outputs, **dict((guard.output, node) for guard, node in guards), **gaps},
        defaults={**equations.defaults, **added},
        guards=tuple(guard for guard, _ in guards),
        reaction_values=_reactions(switched, along, factors, coupled),
        cones=_cones(switched) if coupled else (),
        behind_guards=tuple(laws.behind_guards),
    )


def _reactions(
    switched: _Switched, along: Mapping[int, Node], factors: Mapping[int, Node], coupled: Mapping[tuple[int, int], int]
) -> dict[str, Node]:
    """Return all reactions by name: a friction force that contacts share has equal parts."""
    graph, contacts, names = switched.graph, switched.contacts, switched.whole.symbols.unknowns
    found = dict(along)
    for i, contact in enumerate(contacts):
        parts = graph.sum(switched.sharing(b, d) for b, d in coupled if b == i)
        for k in contact.tangential:
            own = along[k] if parts.is_zero else along[k] / (graph.one + parts)
            found[k] = own - factors[k] * along[contact.normal]
    for (b, d), sign in coupled.items():
        (one,), (other,) = contacts[d].tangential, contacts[b].tangential
        found[one] = found[one] + sign * switched.sharing(b, d) * found[other]
    return {names[i]: node for i, node in found.items()}


def _supports(switched: _Switched, along: Mapping[int, Node], factored: Elimination) -> dict[int, Node]:
    """Return the distances of supports of open contacts, by number (`shared_loads.support_distance`)."""
    rows, graph, found = switched.rows, switched.graph, dict[int, Node]()
    given = {i: switched.whole.compliances.get(name) for i, name in enumerate(switched.whole.symbols.unknowns)}
    soft = {i: compliance * along[i] for i, compliance in given.items() if compliance is not None}
    moves = [soft.get(-1 if each.unknown is None else each.unknown, graph.zero) for each in rows]
    for i, contact in enumerate(switched.contacts):
        own = next(k for k, each in enumerate(rows) if each.unknown == contact.normal)
        moved = switched.inertia.solve(list(rows[own].row.jacobian))
        entries = [each.switch * switched.along(k, moved) for k, each in enumerate(rows)]
        found[i] = support_distance(graph, entries, factored.solve(entries), switched.along(own, moved), moves)
    return found


def _guards(
    switched: _Switched, along: Mapping[int, Node], coupled: Mapping[tuple[int, int], int], supports: Mapping[int, Node]
) -> list[tuple[Guard, Node]]:
    """Return up to three guards of each contact, whose kinds are those of `switched_guards`.

    Reactions are `along` the rows; those that are set aside are not to be zero, so that their contacts stay closed.
    """
    graph, laws, contacts, found = switched.graph, switched.laws, switched.contacts, list[tuple[Guard, Node]]()

    def most(i: int) -> Node:
        return laws.most_friction(contacts[i], along[contacts[i].normal])

    for i, contact in enumerate(contacts):
        closed, slips, holds = switched.closed[i], switched.slips[i], switched.holds[i]
        gap = laws.open_gap(contact, supports.get(i))
        value = closed * along[contact.normal] + (graph.one - closed) * gap + laws.allowance(contact)
        found.append((Guard(f"contact of {contact.name}", i, "lift"), value))
        if not contact.tangential:
            continue
        shared = graph.sum(switched.sharing(b, d) * most(d) for b, d in coupled if b == i)
        holding = laws.holding(i, most(i) + shared, [along[k] for k in contact.tangential])
        stopping = laws.stopping(i)
        for k in range(2):
            value = graph.one - slips - holds
            value = value + holds * (holding[k][1] if k < len(holding) else graph.one)
            value = value + slips * (stopping[k][1] if k < len(stopping) else graph.one)
            found.append((Guard(f"friction {k + 1} of {contact.name}", i, "break"), value))
    return found


def _cones(switched: _Switched) -> tuple[list[Node], ...]:
    """Return the rows of the laws of reactions (`EquationsOfMotion.cones`), which no mode but their own changes."""
    graph, rows = switched.graph, list[list[Node]]()

    def add(*entries: tuple[int, Node]) -> None:
        size = range(len(switched.whole.symbols.unknowns))
        rows.extend([entry if i == number else graph.zero for i in size] for number, entry in entries)

    nothing = -1, graph.zero
    for i, contact in enumerate(switched.contacts):
        sticks, idle = switched.sticks[i], graph.one - switched.sticks[i]
        add((contact.normal, graph.one), nothing, nothing, (contact.normal, idle))
        for k in contact.tangential:
            add(nothing, nothing, nothing, (k, idle))
        if contact.mu_static is not None and contact.tangential:
            first, second = (*contact.tangential, -1)[:2]
            add((contact.normal, sticks * contact.mu_static), (first, sticks), (second, sticks), nothing)
    return tuple(rows)


def switched_system(equations: EquationsOfMotion, whole: EquationsOfMotion, requested: Sequence[str]) -> ReducedSystem:
    """Return the common program's equations in the state q, q_dot, each step projected onto the rows that hold.

    Parameters
    ----------
    equations : EquationsOfMotion
        Of `switched_equations`.
    whole : EquationsOfMotion
        Those they were made of.
    requested : sequence of str
        Outputs besides those that the common program needs.
    """
    switched, graph = _Switched(whole), whole.graph
    contacts = [name for c in whole.contacts for name in (f"gap of {c.name}", f"gap rate of {c.name}")]
    names = [*requested, *(guard.output for guard in equations.guards), *contacts]
    reduced = with_states(Projected().reduce(equations, names, ReductionSettings(regular=True)), equations)
    columns = [list(each.row.jacobian) for each in switched.rows]
    factored, moved = switched.eliminated(columns, guarded=True), [switched.inertia.solve(column) for column in columns]

    def correction(residuals: Sequence[Node]) -> list[Node]:
        weights = factored.solve([-each.switch * r for each, r in zip(switched.rows, residuals, strict=True)])
        return [graph.sum(w * column[j] for w, column in zip(weights, moved, strict=True)) for j in range(len(whole.q))]

    positions = [each.row.position if each.gap else None for each in switched.rows]
    position = correction([graph.zero if p is None else p for p in positions])
    velocity = correction([switched.laws.speed(each.row) for each in switched.rows])
    nothing, states = [graph.zero] * len(whole.q), [graph.zero] * len(whole.states)
    projection = Projection((*position, *nothing, *states), (*nothing, *velocity, *states))
    note = "q and q_dot, all modes by switched rows of contacts, projected onto those that hold at every step"
    return replace(reduced, projection=projection, notes=(note, *reduced.notes[1:]))
