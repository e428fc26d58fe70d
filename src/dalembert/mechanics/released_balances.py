"""The balances that determine reactions which the coordinates hide: [EquationsOfMotion] -> [Released].

Bodies are moved along the directions that the coordinates leave out, in the program of reactions alone; the motion has
no further coordinate. As few bodies and unknowns as serve are taken. Friction has hidden normal reactions by the same
balances.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..errors import ConstraintError, list_names
from ..ir.node import Node
from ..ir.zero_tests import vanishes
from ..naming import acceleration_input
from ..transforms.derivatives import tangents
from .balance_choice import BalanceChoice, BodySystem, Released, self_stresses, tied_together
from .body_samples import reaction_direction
from .connections import Pair, components, in_span, null_space, pair_of, rank, wrench_columns
from .equations import ContactRow, EquationsOfMotion

_SMALL = 1e-8


def require_balance(equations: EquationsOfMotion, wanted: Sequence[str]) -> None:
    """Raise where some reactions, which the coordinates' equations give, leave bodies without balance.

    Raises
    ------
    ConstraintError
        With the bodies on which a force or torque is missing.
    """
    system = BodySystem(equations, wanted)
    if system.samples and not system.balances.floating:
        _Search(system).carried()


def released_balances(equations: EquationsOfMotion, wanted: Sequence[str]) -> Released:
    """Return the balances that determine some reactions.

    Raises
    ------
    ConstraintError
        Where a reaction depends on what undeclared connections carry, with the bodies that these connect.
    """
    return _Search(BodySystem(equations, wanted)).found()


@final
class _Search:
    """The wrenches of undeclared connections, and whether they change the wanted reactions."""

    def __init__(self, system: BodySystem) -> None:
        self.system = system

    def found(self) -> Released:
        """Return the balances."""
        if not self.system.samples:
            raise self.system.fault(
                "no positions were found that satisfy its constraints, to search for their balances"
            )
        if self.system.balances.floating:
            raise self.system.fault(
                f"the loads {list_names(self.system.balances.floating)} act at what is no point or frame of a body;"
                " write them as (body, point, force)"
            )
        bodies, open_pairs = self.carried()
        self._require_determined(open_pairs, bodies)
        return BalanceChoice(self.system, bodies, open_pairs).released()

    def carried(self) -> tuple[set[int], list[dict[Pair, FloatArray]]]:
        """Return the bodies that matter, and what undeclared connections may carry, where that balances the bodies.

        Declared joints that hold all bodies by themselves are taken to be all joints of the bodies whose places they
        explain.
        """
        bodies, connections = self._bodies(), self.system.connections
        if bodies <= {i for pair in connections[0].by_pair for i in pair}:
            declared = self._open([{} for _ in connections], bodies)
            if self._consistent(declared, bodies) and self._hold(declared, bodies):
                return bodies, self._open([own.beside_joints for own in connections], bodies)
        open_pairs = self._open([own.undeclared for own in connections], bodies)
        if self._consistent(open_pairs, bodies) and self._move(open_pairs, bodies):
            return bodies, open_pairs
        raise self._unbalanced(open_pairs, bodies)

    def _bodies(self) -> set[int]:
        """Return the bodies that are connected with those of the wanted reactions."""
        first = self.system.connections[0]
        pairs = [*first.by_pair, *first.undeclared, *self.system.balances.ties]
        own = {
            i
            for joint in self.system.joints
            if self.system.has(joint, self.system.wanted)
            for i in joint.pair
            if i is not None
        }
        groups = components(len(self.system.names), pairs)
        return {body for group in groups if group & own for body in group}

    def _open(self, undeclared: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> list[dict[Pair, FloatArray]]:
        """Return at each sample all that may be carried beside the unknowns, by the pairs of bodies."""
        opened = []
        for connections, beside in zip(self.system.connections, undeclared, strict=True):
            found = {pair: matrix for pair, (matrix, _) in connections.complete.items() if set(pair) & bodies}
            tied = {pair_of(*tie): connections.wrenches(pair_of(*tie)) for tie in self.system.balances.ties}
            for pair, matrix in (*beside.items(), *tied.items()):
                if set(pair) & bodies:
                    found[pair] = np.hstack([found[pair], matrix]) if pair in found else matrix
            opened.append(found)
        return opened

    def _rows(self, bodies: set[int]) -> list[int]:
        return [6 * body + k for body in sorted(bodies) for k in range(6)]

    def _consistent(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> bool:
        """Whether joints and undeclared connections can exert what the motion needs."""
        rows = self._rows(bodies)
        for sample, columns, pairs in zip(self.system.samples, self.system.columns, open_pairs, strict=True):
            whole = np.hstack([columns, wrench_columns(sample, pairs)])[rows]
            if not in_span(sample.demand[rows], whole, float(np.abs(sample.demand[rows]).max())):
                return False
        return True

    def _hold(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> bool:
        """Whether joints and undeclared connections can exert what any motion and any load would need."""
        rows = [row for row in self._rows(bodies) if row % 6 < 3 or self.system.connections[0].rigid(row // 6)]
        for sample, columns, pairs in zip(self.system.samples, self.system.columns, open_pairs, strict=True):
            motions = sample.twists @ null_space(sample.constraints)
            if rank(np.hstack([columns, wrench_columns(sample, pairs), motions])[rows]) < len(rows):
                return False
        return True

    def _move(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> bool:
        """Whether joints and undeclared connections can make all bodies follow one that is pushed along its motion.

        A wheel that rolls freely beside a cart needs nothing to turn with it; pushed on, its contact is missing.
        """
        rows = self._rows(bodies)
        for sample, columns, pairs in zip(self.system.samples, self.system.columns, open_pairs, strict=True):
            motions = sample.twists @ null_space(sample.constraints)
            whole = np.hstack([columns, wrench_columns(sample, pairs), motions])[rows]
            pushes = [np.where(np.arange(len(motions))[:, np.newaxis] // 6 == body, motions, 0.0) for body in bodies]
            if rank(np.hstack([whole, np.hstack(pushes)[rows]])) > rank(whole):
                return False
        return True

    def _unbalanced(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> ConstraintError:
        """Return the error for bodies on which some force is missing: on one of those whose balance could be it."""
        sample, columns = self.system.samples[0], self.system.columns[0]
        rows = self._rows(bodies)
        whole = np.hstack([columns, wrench_columns(sample, open_pairs[0])])[rows]
        demand, own = sample.demand[rows], np.eye(len(rows))
        size = float(np.abs(demand).max())
        alone = [
            self.system.names[b]
            for i, b in enumerate(sorted(bodies))
            if in_span(demand, np.hstack([whole, own[:, 6 * i : 6 * i + 6]]), size)
        ]
        suspects = alone or [self.system.names[b] for b in sorted(bodies)]
        names = list_names(map(repr, suspects))
        what = "exert the reactions of its constraints" if self.system.equations.constraints else "hold its bodies"
        lost = self._unheld([self.system.names.index(name) for name in suspects])
        part = "torque" if lost and "(a torque" in lost[0] else "force"
        remedy = (
            f", which no joint declares: what holds {'; '.join(lost)}. Give a joint of these bodies that unknown, as in"
            f' R = da.unknowns("R"), scene.add_joints(da.Joint("rail", body={suspects[0]!r}, at=P, {part}=R * n)), with'
            " the point P at which it acts and its direction n"
            if lost
            else ", which no joint declares. Give a joint of these bodies the unknown component that holds them"
        )
        return ConstraintError(
            f"scene {self.system.equations.name!r}: its joints cannot {what}: a force or torque on {names} is missing"
            f"{remedy}"
        )

    def _unheld(self, bodies: Sequence[int]) -> list[str]:
        """Return the constraints on some bodies that no joint holds, with the directions of their reactions."""
        sample, equations = self.system.samples[0], self.system.equations
        rows = [6 * body + k for body in bodies for k in range(6)]
        names = self.system.balances.model.symbols.unknowns
        own = [i for i, x in enumerate(names) if x not in equations.mode_reactions]  # normal forces without friction
        ideal, found = sample.twists.T @ sample.unknowns[:, own], []
        for number in self.system.connections[0].unheld():
            row = sample.constraints[number]
            size = float(np.abs(row).max())
            if np.abs(sample.twists[rows] * row).max() > _SMALL * size and not in_span(row, ideal, size):
                found.append(equations.constraints[number].label + self._along(number))
        return found

    def _along(self, number: int) -> str:
        """Return the direction of the one force or torque that holds a constraint; empty where it is not fixed."""
        bodies = self.system.balances.model.bodies
        wrench = reaction_direction(self.system.samples, number, [body.inertia is not None for body in bodies])
        if wrench is None:
            return ""
        kind, part = ("force", wrench[:3]) if wrench[:3].any() else ("torque", wrench[3:])
        frame = self.system.balances.model.frames[0].name
        text = " + ".join(f"{c:.4g}*{frame}.{axis}" for c, axis in zip(part, "xyz", strict=True) if c)
        return f" (a {kind} along {re.sub(r'(?<![0-9.])1[*]', '', text).replace('+ -', '- ')})"

    def _require_determined(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> None:
        """Raise unless the wanted reactions are the same whatever else is carried, or share it by their compliances.

        All that share a load with a wanted one are determined together. Connections that no joint declares are rigid
        beside them.
        """
        rows, names = self._rows(bodies), self.system.equations.symbols.unknowns
        own_undeclared = {*self.system.connections[0].undeclared, *(pair_of(*tie) for tie in self.system.balances.ties)}
        for sample, columns, pairs in zip(self.system.samples, self.system.columns, open_pairs, strict=True):
            parts = {pair: matrix for pair, matrix in pairs.items() if matrix.shape[1]}
            whole = np.hstack([columns, wrench_columns(sample, parts)])[rows]
            groups = [group for group in tied_together(self_stresses(whole)) if group & {*self.system.targets}]
            moved = np.zeros(whole.shape[1], bool)
            for group in groups:
                moved[list(group)] = True
            involved, start = [], len(names)
            for pair, matrix in parts.items():
                known = self.system.connections[0].complete.get(pair, (None, False))[1] and pair not in own_undeclared
                if not known and moved[start : start + matrix.shape[1]].any():
                    involved.append(pair)
                start += matrix.shape[1]
            together = {i for group in groups for i in group if i < len(names)}
            if all(names[i] in self.system.equations.compliances for i in together):
                self.system.share(together, [f"{self._body(b)} and {self._body(a)}" for a, b in involved])
                continue
            lost = [name for name, i in zip(self.system.wanted, self.system.targets, strict=True) if moved[i]]
            others = [name for name, m in zip(names, moved, strict=False) if m and name not in lost]
            raise self.system.fault(self._why(lost, others, involved))

    def _why(self, hidden: Sequence[str], others: Sequence[str], pairs: Sequence[Pair]) -> str:
        bare = [name for name in (*hidden, *others) if name not in self.system.equations.compliances]
        if not pairs or len(bare) < len(hidden) + len(others):
            rest = f" with {list_names(others)}" if others else ""
            return (
                f"only a combination of {list_names(hidden)}{rest} appears in the balances of the bodies. How elastic"
                f" supports share the load follows from compliances of {list_names(bare)}, such as"
                f" scene.add_compliances({{{bare[0]!r}: c}})"
            )
        own, lost = self.system.connections[0], list_names(hidden)
        labels = [self.system.equations.constraints[i].label for i in own.unheld()]
        if labels:
            return (
                f"no joint exerts the reaction of {'; '.join(labels)}, and {lost} would be another with another place"
                " of it. Give a joint the unknown force or torque component that holds the constraint"
            )
        structure = [pair for pair in pairs if pair in dict(own.structure)] or list(pairs)
        said = "; ".join(f"{self._body(b)} and {self._body(a)}" for a, b in structure)
        tied = [pair_of(*tie) for tie in self.system.balances.ties]
        load = " A load acts at what belongs to both: write it as (body, point, force)." if set(pairs) & {*tied} else ""
        return (
            f"{lost} would be another with another force or torque between {said}, which no joint declares.{load}"
            " Declare it, scene.add_joints(da.Joint(name, body, other=..., at=..., force=..., torque=...)), with all"
            f" unknown components that this connection has{self._carried(structure)}"
        )

    def _carried(self, pairs: Sequence[Pair]) -> str:
        """Return the remedy for bodies that are located from the fixed frame, and that a joint connects with another.

        Such is a wheel on a moving table.
        """
        by_pair, actions = self.system.connections[0].by_pair, self.system.balances.model.actions
        found = [
            f". If nothing but {joint.name!r} holds {self._body(b)}, locate its points along the axes of"
            f" {self._body(other)} or from a point that moves with it, or make what they leave out a coordinate,"
            " such as a height, with its constraint"
            for a, b in pairs
            for joint in (joint for joints in by_pair.values() for joint in joints)
            if a is None and actions[joint.action].target == b and (other := actions[joint.action].other) is not None
        ]
        return "".join(dict.fromkeys(found))

    def _body(self, body: int | None) -> str:
        return "the fixed frame" if body is None else repr(self.system.names[body])


# Friction on normal reactions that the coordinates hide.


def with_hidden_normals(equations: EquationsOfMotion) -> EquationsOfMotion:
    """Return equations in which friction has the hidden normal reactions that balances of bodies give.

    A block in the coordinate along its floor has no equation across it. Where the balance of its bodies gives the
    normal reaction without accelerations and without other reactions, its friction is that of a given load. Otherwise
    friction and the normal reaction depend on each other, which needs the coordinate that `Scene.release` adds.
    Other normal reactions stay as they are. So do all in scenes with contacts that open: an impact may press on one,
    and transmits no friction of a given load.
    """
    contacts = equations.contacts
    if equations.scene is None or any(contact.gap is not None for contact in contacts):
        return equations
    found = tuple(_with_balance(equations, contact) for contact in contacts)
    return replace(equations, contacts=found)


def _with_balance(equations: EquationsOfMotion, contact: ContactRow) -> ContactRow:
    hidden = all(vanishes(row[contact.normal]) for row in equations.reactions)
    if contact.normal_load is not None or not contact.tangential or not hidden:
        return contact
    value = _by_balance(equations, contact.normal)
    if value is None:
        return contact
    return replace(contact, normal_load=equations.graph.call("abs", value), normal_value=value)


def _by_balance(equations: EquationsOfMotion, number: int) -> Node | None:
    """Return a reaction by one balance in terms of coordinates, rates, states and time; None where there is none."""
    graph, unknown = equations.graph, equations.unknowns[number]
    try:
        released = released_balances(equations, [equations.symbols.unknowns[number]])
    except ConstraintError:
        return None
    if len(released.balances) != 1:
        return None
    (balance,) = released.balances
    if balance.power is None or balance.unknowns != (number,):
        return None
    (power,) = graph.adopt([balance.power])
    slope = graph.freed_of(tangents(graph, [power], {unknown: graph.one})[0], equations.unknowns)
    (rest,) = graph.substitute([power], dict.fromkeys(equations.unknowns, graph.zero))
    seconds = graph.mask(map(acceleration_input, equations.symbols.coordinates))
    if slope is None or (slope.deps | rest.deps) & seconds:
        return None
    return -rest / slope
