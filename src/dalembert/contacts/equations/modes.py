"""Equations of a scene with contacts in one of its modes: [EquationsOfMotion] -> [EquationsOfMotion].

In a mode every contact is open or closed, and slips or sticks. An open contact has neither constraint nor reactions; a
sticking one has its slip velocity as a further constraint, which the friction force holds; where a contact slips,
friction is a given force (`contacts.equations.sliding_friction`). The result is a scene without contacts, so that every
formulation, backend and method serves it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import final

from ...errors import ConstraintError, list_names
from ...ir.node import Node
from ...mechanics.equations import ConstraintRow, ContactRow, EquationsOfMotion, Guard
from ...reduction.reaction_columns import independent_columns
from .contact_laws import OPEN, SLIP, SMOOTH, STICK, ContactLaws, Mode, mode_parameters
from .dependent_slips import pairs_of_one_link
from .shared_loads import Direction, SharedLaw, lawful_sums, undetermined_directions
from .sliding_friction import SlidingContact, SlidingFriction, sliding_friction
from .sticking_rows import StickingPair, StickingRows, along_lines, with_pairs


def only_mode(contacts: Sequence[ContactRow]) -> Mode | None:
    """Return the only mode of contacts whose laws are smooth and that never open; None where there are others."""
    smooth = all(c.constraint is None and c.regularization is not None for c in contacts)
    return (SMOOTH,) * len(contacts) if smooth else None


def mode_equations(equations: EquationsOfMotion, mode: Mode) -> EquationsOfMotion:
    """Return the equations of a scene in a mode, with its guards as outputs.

    Raises
    ------
    ConstraintError
        When the equations do not determine the normal reaction of a contact that slides.
    """
    return _ModeEquations(equations, mode).equations()


@final
class _ModeEquations:
    """The making of one mode."""

    def __init__(self, equations: EquationsOfMotion, mode: Mode) -> None:
        self.graph, self.laws, self.mode = equations.graph, ContactLaws(equations), mode
        self.contacts = list(zip(equations.contacts, mode, strict=True))
        sticking = [i for i, state in enumerate(mode) if state == STICK]
        self.pairs = [StickingPair(self.laws, b, d) for d, b in pairs_of_one_link(equations, sticking).items()]
        self.second = {pair.second.name: pair for pair in self.pairs}
        self.whole = with_pairs(equations, self.pairs)
        sliding = [(c, state) for c, state in self.contacts if state in (SLIP, SMOOTH) and c.tangential]
        self.sliding = [SlidingContact(c, partial(self.laws.factors, c, state)) for c, state in sliding]
        held = self._stick([c for c, state in self.contacts if state == STICK])
        self.rows, self.groups, self.idle, self.lines = held.rows, held.groups, held.idle, held.lines
        self.whole = along_lines(self.whole, self.lines.values())
        gone = {i for c, state in self.contacts if state == OPEN for i in (c.normal, *c.tangential)}
        gone |= {i for c in (*(c for c, _ in sliding), *self.idle) for i in c.tangential}
        gone |= {pair.second.tangential[1] for pair in self.pairs} | {
            line.contact.tangential[1] for line in self.lines.values()
        }
        gone |= {c.normal for c, _ in self.contacts if c.normal_load is not None}
        self.kept = [i for i in range(len(equations.symbols.unknowns)) if i not in gone]

    def _stick(self, sticking: Sequence[ContactRow]) -> StickingRows:
        """Return the constraints with the slip velocities of contacts that stick."""
        opened = {c.constraint for c, state in self.contacts if state == OPEN}
        rows = [row for i, row in enumerate(self.whole.constraints) if i not in opened]
        paired = {contact.name for pair in self.pairs for contact in (pair.first, pair.second)}
        held = StickingRows(self.whole, rows, paired)
        if sticking and held.redundant:
            self._require_pressing(sticking)
        for contact in sticking:
            pair = self.second.get(contact.name)
            held.add(contact, contact.slips if pair is None else [pair.row()])
        return held

    def _require_pressing(self, sticking: Sequence[ContactRow]) -> None:
        """Raise where the closed contacts of a mode whose constraints are redundant share a load."""
        closed = [c for c, state in self.contacts if state != OPEN and c.constraint is not None]
        friction = {i for c, _ in self.contacts for i in c.tangential}
        opened = {c.normal for c, state in self.contacts if state == OPEN}
        kept = [i for i in range(len(self.whole.symbols.unknowns)) if i not in friction | opened]
        _, undetermined = independent_columns([[row[i] for i in kept] for row in self.whole.reactions])
        shared = {kept[place] for place in undetermined}
        names = [contact.name for contact in closed if contact.normal in shared]
        if names:
            raise ConstraintError(
                f"scene {self.whole.name!r}: the contacts {list_names(map(repr, names))} share a load in more ways than"
                f" the equations of motion determine, and what friction of {list_names(repr(c.name) for c in sticking)}"
                " holds depends on that: let at most three contacts of a rigid body with friction touch a plane, or"
                " give all contacts friction=0, and compliances to the normal reactions that share the load"
            )

    def equations(self) -> EquationsOfMotion:
        """Return the equations in this mode."""
        whole, graph = self.whole, self.graph
        names = whole.symbols.unknowns
        frictionless = self._without_friction(self.rows, self.kept)
        idle = {contact.name: contact.tangential for contact in self.idle}
        idle |= {name: line.contact.tangential[1:] for name, line in self.lines.items()}
        friction = sliding_friction(frictionless, whole, self.kept, self.sliding, idle)
        known: dict[Node, Node] = {}
        kept_names = list(names)
        for item, kappa in zip(self.sliding, friction.factors, strict=True):
            pressing = self.laws.normal(item.contact)
            for i, k in zip(item.contact.tangential, kappa, strict=True):
                known[graph.input(names[i])] = -k * pressing
        for contact, _ in self.contacts:
            if contact.normal_load is not None:
                given = contact.normal_load if contact.normal_value is None else contact.normal_value
                known[graph.input(names[contact.normal])] = given
        for pair in self.pairs:
            known |= pair.forces()
        for line in self.lines.values():
            known |= line.forces(graph, names)
            kept_names = line.named(kept_names)
        for contact in self.idle:
            known |= {graph.input(names[i]): graph.zero for i in contact.tangential}
        for contact, state in self.contacts:
            if state == OPEN:
                known |= {graph.input(names[i]): graph.zero for i in (contact.normal, *contact.tangential)}
        outputs = dict(zip(whole.outputs, graph.substitute(list(whole.outputs.values()), known), strict=True))
        outputs |= {str(node.payload): value for node, value in known.items()}
        guards = self._guards(friction)
        added: dict[str, float] = {}
        for contact, state in self.contacts:
            second = contact.name in self.second  # whose direction has no value that serves by default
            parameters = mode_parameters(contact, SLIP if second else state)
            direction = (math.nan, math.nan) if second else (1.0, 0.0)
            values = *direction, float(not contact.opens), 1e-9
            added |= {name: value for name, value in zip(parameters, values, strict=True) if name}
        symbols = replace(
            whole.symbols,
            unknowns=tuple(kept_names[i] for i in self.kept),
            parameters=(*whole.symbols.parameters, *added),
        )
        return replace(
            frictionless,
            symbols=symbols,
            forcing=friction.forcing,
            outputs=outputs | {guard.output: node for guard, node in guards},
            defaults={**whole.defaults, **added},
            guards=tuple(guard for guard, _ in guards),
            mode_reactions={str(node.payload): value for node, value in known.items()},
            minimum_norm=bool(self.groups),
            cones=self._cones() if self.groups else (),
            behind_guards=tuple(self.laws.behind_guards),
        )

    def _cones(self) -> tuple[list[Node], ...]:
        """Return the rows of the laws of reactions that are not determined (`EquationsOfMotion.cones`)."""
        zero, one = self.graph.zero, self.graph.one
        rows: list[list[Node]] = []

        def add(*entries: tuple[int, Node]) -> None:
            rows.extend([entry if i == number else zero for i in self.kept] for number, entry in entries)

        for contact, state in self.contacts:
            if contact.normal_load is not None:  # it holds by itself
                continue
            press, sticks = self.laws.side(contact), state == STICK and contact not in self.idle
            fixed = one if state in (SLIP, SMOOTH) and contact.tangential else zero
            if contact.leader is None and state != OPEN and (contact.opens or state in (SLIP, STICK)):
                add((contact.normal, press), (-1, zero), (-1, zero), (contact.normal, fixed))
            elif state == SMOOTH:
                add((-1, zero), (-1, zero), (-1, zero), (contact.normal, fixed))
            if sticks and contact.mu_static is not None:
                line, (first, second) = self.lines.get(contact.name), (*contact.tangential, -1)[:2]
                forces = ((first, one), (second, one)) if line is None else line.entries()
                add((contact.normal, contact.mu_static * press), *forces, (-1, zero))
        return tuple(rows)

    def _without_friction(self, rows: Sequence[ConstraintRow], kept: Sequence[int]) -> EquationsOfMotion:
        """Return the equations with some constraints and some reactions, and no friction."""
        reactions = [[row[i] for i in kept] for row in self.whole.reactions]
        return replace(self.whole, constraints=tuple(rows), reactions=reactions)

    # -- guards of the mode ----------------------------------------------------------------

    def _guards(self, friction: SlidingFriction) -> list[tuple[Guard, Node]]:
        """Return the guards of the mode with their values; reactions in them are inputs."""
        graph, names = self.graph, self.whole.symbols.unknowns
        directions = self._undetermined()
        guards: list[tuple[Guard, Node]] = []
        laws: list[SharedLaw] = []
        for i, (contact, state) in enumerate(self.contacts):
            name = contact.name
            if state == OPEN and contact.leader is not None:
                continue
            if state == OPEN:
                gap = self.laws.open_gap(contact, self._support(contact))
                guards.append((Guard(f"gap of {name}", i, "meet"), gap + self.laws.allowance(contact)))
                continue
            guards += [(Guard(f"kink {n} of {name}", -2, "kink"), kink) for n, kink in enumerate(contact.kinks, 1)]
            press = self.laws.normal(contact) * self.laws.side(contact)
            if any(j in direction for direction in directions for j in (contact.normal, *contact.tangential)):
                laws += self._shared_laws(contact, state, press, directions)
            else:
                sided = not contact.opens and contact.normal_load is None and state in (SLIP, STICK)
                if contact.constraint is not None or sided:
                    kind = "turn" if sided else "lift"
                    guards.append((Guard(f"press of {name}", i, kind), press + self.laws.allowance(contact)))
                paired = [pair for pair in self.pairs if i in pair.numbers]
                guards += [guard for pair in paired for guard in pair.guards(i)]
                if not paired and state == STICK and contact not in self.idle:
                    line = self.lines.get(contact.name)
                    forces = [graph.input(names[j]) for j in contact.tangential]
                    forces = forces if line is None else [*line.parts(graph, names)]
                    guards += self.laws.holding(i, self.laws.most_friction(contact, press), forces)
            if state == SLIP:
                guards += self.laws.stopping(i)
        if laws:
            owner = next(i for i, (contact, _) in enumerate(self.contacts) if contact.name in self.groups)
            sums = lawful_sums(graph, self.whole.name, laws)
            guards += [(Guard(f"shared load {n}", owner, "share"), value) for n, value in enumerate(sums, 1)]
        if any(state == SLIP for state in self.mode):
            guards.append((Guard("uniqueness of reactions", -1, "paradox"), friction.determinant))
        return guards

    def _support(self, contact: ContactRow) -> Node | None:
        """Return the distance of the support of an open contact that others hold where it is; None for other contacts.

        As its reaction grows by one, those of the others change, and the elastic energy by their sum of compliance,
        reaction and change: while that is positive, the contact bears nothing.
        """
        graph, names, given = self.graph, self.whole.symbols.unknowns, self.whole.compliances
        if names[contact.normal] not in given:
            return None
        columns = [*self.kept, contact.normal]
        frictionless = self._without_friction(self.rows, columns)
        if len(columns) - 1 not in independent_columns(frictionless.reactions)[1]:
            return None
        (direction,) = undetermined_directions(frictionless, columns, [contact.normal])
        changes = {names[j]: change for j, change in direction.items() if j in self.kept}
        return graph.sum(given[name] * graph.input(name) * change for name, change in changes.items() if name in given)

    def _undetermined(self) -> tuple[Direction, ...]:
        """Return the directions in which the reactions of contacts that hold each other are not determined."""
        shared = list(
            dict.fromkeys(i for group in self.groups.values() for contact in group for i in contact.tangential)
        )
        return undetermined_directions(self._without_friction(self.rows, self.kept), self.kept, shared)

    def _shared_laws(
        self, contact: ContactRow, state: str, press: Node, directions: Sequence[Direction]
    ) -> list[SharedLaw]:
        """Return what must not be negative of a contact whose reactions are not determined."""
        graph, side = self.graph, self.laws.side(contact)
        slopes = [side * direction.get(contact.normal, graph.zero) for direction in directions]
        if state != STICK or contact in self.idle or len(contact.tangential) > 1:
            return [SharedLaw(press + self.laws.allowance(contact), tuple(slopes))]
        assert contact.mu_static is not None
        (number,), most = contact.tangential, contact.mu_static * press + self.laws.allowance(contact)
        force = graph.input(self.whole.symbols.unknowns[number])
        changes = [direction.get(number, graph.zero) for direction in directions]
        return [
            SharedLaw(
                most + sign * force,
                tuple(contact.mu_static * a + sign * b for a, b in zip(slopes, changes, strict=True)),
            )
            for sign in (1, -1)
        ]
