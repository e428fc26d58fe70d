"""The balances that determine reactions which the coordinates hide: [EquationsOfMotion] -> [Released].

Bodies are moved along the directions that the coordinates leave out, in the program of reactions alone; the motion has
no further coordinate. As few bodies and unknowns as serve are taken.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..errors import ConstraintError, list_names
from ..ir.node import Node
from ..scene.model import Piece, Pieces
from .body_balances import BodyBalances, Movement
from .body_samples import BodySample, body_samples, values_at
from .connections import (
    Connections,
    Declared,
    Pair,
    beyond,
    components,
    declared_joints,
    in_span,
    null_space,
    pair_of,
    rank,
    wrench_columns,
)
from .equations import EquationsOfMotion

_SMALL = 1e-8


@final
@dataclass(frozen=True)
class Balance:
    """One equation: the power on a movement vanishes, or that of a coordinate (its number).

    `unknowns` are the numbers of those that have power on it; others may stand in it, and cancel.
    """

    power: Node | None
    coordinate: int | None
    unknowns: tuple[int, ...]


@final
@dataclass(frozen=True)
class Released:
    """Balances on a graph of their own, and a text on what was moved for them."""

    balances: tuple[Balance, ...]
    unknowns: tuple[str, ...]
    text: str


@final
@dataclass(frozen=True)
class _Offer:
    """A movement, or the number of a coordinate, with its powers on the unknowns at each sample.

    `cost` is how many unknowns have power on it and how many bodies it moves.
    """

    cost: tuple[int, int, int]
    movement: Movement | int
    rows: tuple[FloatArray, ...]
    unknowns: tuple[int, ...]


def require_balance(equations: EquationsOfMotion, wanted: Sequence[str]) -> None:
    """Raise where some reactions, which the coordinates' equations give, leave bodies without balance.

    Raises
    ------
    ConstraintError
        With the bodies on which a force or torque is missing.
    """
    search = _Search(equations, wanted)
    if search.samples and not search.balances.floating:
        search.carried()


def released_balances(equations: EquationsOfMotion, wanted: Sequence[str]) -> Released:
    """Return the balances that determine some reactions.

    Raises
    ------
    ConstraintError
        Where a reaction depends on what undeclared connections carry, with the bodies that these connect.
    """
    assert equations.scene is not None
    return _Search(equations, wanted).found()


@final
class _Search:
    """The search for balances of one scene and some of its unknowns."""

    def __init__(self, equations: EquationsOfMotion, wanted: Sequence[str]) -> None:
        assert equations.scene is not None
        self.equations, self.wanted = equations, wanted
        self.balances = BodyBalances(equations.scene)
        self.joints = declared_joints(self.balances)
        self.samples = body_samples(equations, self.balances)
        self.names = [body.name for body in self.balances.model.bodies]
        self.connections = [Connections(self.balances, self.joints, sample) for sample in self.samples]
        self.columns = [sample.unknowns @ sample.mode for sample in self.samples]
        self.known: dict[tuple[int, str, int], FloatArray] = {}
        self.targets = [equations.symbols.unknowns.index(name) for name in wanted]

    def fault(self, why: str) -> ConstraintError:
        """Return the error for the wanted reactions."""
        return ConstraintError(
            f"scene {self.equations.name!r}: the reactions {list_names(self.wanted)} are not determined: {why}"
        )

    # -- what may carry something --------------------------------------------------------------------

    def found(self) -> Released:
        """Return the balances."""
        if not self.samples:
            raise self.fault("no positions were found that satisfy its constraints, to search for their balances")
        if self.balances.floating:
            raise self.fault(
                f"the loads {list_names(self.balances.floating)} act at what is no point or frame of a body; write them"
                " as (body, point, force)"
            )
        bodies, open_pairs = self.carried()
        self._require_determined(open_pairs, bodies)
        return self._chosen(open_pairs, bodies)

    def carried(self) -> tuple[set[int], list[dict[Pair, FloatArray]]]:
        """Return the bodies that matter, and what undeclared connections may carry, where that balances the bodies."""
        bodies = self._bodies()
        for undeclared in self._hypotheses(bodies):
            open_pairs = [self._open(number, undeclared[number], bodies) for number in range(len(self.samples))]
            if self._consistent(open_pairs, bodies):
                return bodies, open_pairs
        raise self._unbalanced(open_pairs, bodies)

    def _bodies(self) -> set[int]:
        """Return the bodies that are connected with those of the wanted reactions."""
        first = self.connections[0]
        pairs = [*first.by_pair, *first.undeclared, *self.balances.ties]
        own = {i for joint in self.joints if self._has(joint, self.wanted) for i in joint.pair if i is not None}
        groups = components(len(self.names), pairs)
        return {body for group in groups if group & own for body in group}

    def _has(self, joint: Declared, wanted: Collection[str]) -> bool:
        names = self.balances.model.symbols.unknowns
        return any(names[i] in wanted for i in joint.unknowns)

    def _hypotheses(self, bodies: set[int]) -> Iterator[list[dict[Pair, FloatArray]]]:
        """Yield undeclared connections at each sample: none where each body has a joint, then all there may be."""
        with_joint = {i for pair in self.connections[0].by_pair for i in pair}
        if bodies <= with_joint:
            yield [{} for _ in self.samples]
        yield [connections.undeclared for connections in self.connections]

    def _open(self, number: int, undeclared: Mapping[Pair, FloatArray], bodies: set[int]) -> dict[Pair, FloatArray]:
        """Return all that may be carried beside the unknowns, by the pairs of bodies."""
        connections = self.connections[number]
        found = {pair: matrix for pair, (matrix, _) in connections.complete.items() if set(pair) & bodies}
        tied = {pair_of(*tie): connections.wrenches(pair_of(*tie)) for tie in self.balances.ties}
        for pair, matrix in (*undeclared.items(), *tied.items()):
            if set(pair) & bodies:
                found[pair] = np.hstack([found[pair], matrix]) if pair in found else matrix
        return found

    def _rows(self, bodies: set[int]) -> list[int]:
        return [6 * body + k for body in sorted(bodies) for k in range(6)]

    def _consistent(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> bool:
        """Whether joints and undeclared connections can exert what the motion needs."""
        rows = self._rows(bodies)
        for sample, columns, pairs in zip(self.samples, self.columns, open_pairs, strict=True):
            whole = np.hstack([columns, wrench_columns(sample, pairs)])[rows]
            if not in_span(sample.demand[rows], whole, float(np.abs(sample.demand[rows]).max())):
                return False
        return True

    def _unbalanced(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> ConstraintError:
        """Return the error for bodies on which some force is missing: on one of those whose balance could be it."""
        sample, columns = self.samples[0], self.columns[0]
        rows = self._rows(bodies)
        whole = np.hstack([columns, wrench_columns(sample, open_pairs[0])])[rows]
        demand, own = sample.demand[rows], np.eye(len(rows))
        size = float(np.abs(demand).max())
        alone = [
            self.names[b]
            for i, b in enumerate(sorted(bodies))
            if in_span(demand, np.hstack([whole, own[:, 6 * i : 6 * i + 6]]), size)
        ]
        names = list_names(map(repr, alone or [self.names[b] for b in sorted(bodies)]))
        what = "exert the reactions of its constraints" if self.equations.constraints else "hold its bodies"
        return ConstraintError(
            f"scene {self.equations.name!r}: its joints cannot {what}: a force or torque on {names} is missing, which no"
            " joint declares. Give a joint of these bodies the unknown force or torque component that holds them"
        )

    def _require_determined(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> None:
        """Raise unless the wanted reactions are the same whatever else is carried."""
        rows, names = self._rows(bodies), self.equations.symbols.unknowns
        own_undeclared = {*self.connections[0].undeclared, *(pair_of(*tie) for tie in self.balances.ties)}
        for sample, columns, pairs in zip(self.samples, self.columns, open_pairs, strict=True):
            parts = {pair: matrix for pair, matrix in pairs.items() if matrix.shape[1]}
            whole = np.hstack([columns, wrench_columns(sample, parts)])[rows]
            scale = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
            free = null_space(whole / scale)
            free = free[:, np.abs(free[self.targets]).max(axis=0, initial=0.0) > _SMALL]
            if not free.shape[1]:
                continue
            moved = np.abs(free).max(axis=1) > _SMALL
            involved, start = [], len(names)
            for pair, matrix in parts.items():
                known = self.connections[0].complete.get(pair, (None, False))[1] and pair not in own_undeclared
                if not known and moved[start : start + matrix.shape[1]].any():
                    involved.append(pair)
                start += matrix.shape[1]
            lost = [name for name, i in zip(self.wanted, self.targets, strict=True) if moved[i]]
            others = [name for name, m in zip(names, moved, strict=False) if m and name not in lost]
            raise self.fault(self._why(lost, others, involved))

    def _why(self, hidden: Sequence[str], others: Sequence[str], pairs: Sequence[Pair]) -> str:
        if not pairs:
            rest = f" with {list_names(others)}" if others else ""
            return f"only a combination of {list_names(hidden)}{rest} appears in the balances of the bodies"
        own, lost = self.connections[0], list_names(hidden)
        labels = [self.equations.constraints[i].label for i in own.unheld()]
        if labels:
            return (
                f"no joint exerts the reaction of {'; '.join(labels)}, and {lost} would be another with another place of"
                " it. Give a joint the unknown force or torque component that holds the constraint"
            )
        structure = [pair for pair in pairs if pair in dict(own.structure)] or list(pairs)
        said = "; ".join(f"{self._body(b)} and {self._body(a)}" for a, b in structure)
        tied = [pair_of(*tie) for tie in self.balances.ties]
        load = " A load acts at what belongs to both: write it as (body, point, force)." if set(pairs) & {*tied} else ""
        return (
            f"{lost} would be another with another force or torque between {said}, which no joint declares.{load}"
            " Declare it, scene.add_joints(da.Joint(name, body, other=..., at=..., force=..., torque=...)), with all"
            " unknown components that this connection has"
        )

    def _body(self, body: int | None) -> str:
        return "the fixed frame" if body is None else repr(self.names[body])

    # -- choice of balances ----------------------------------------------------------------------------

    def _chosen(self, open_pairs: Sequence[Mapping[Pair, FloatArray]], bodies: set[int]) -> Released:
        """Return as few balances as determine the wanted reactions, with few unknowns and bodies."""
        pairs = [pair for pair, matrix in open_pairs[0].items() if matrix.shape[1]]
        opened = [wrench_columns(sample, found) for sample, found in zip(self.samples, open_pairs, strict=True)]
        offers: list[_Offer] = []
        for j in range(len(self.equations.q)):
            self._offer(offers, j, [sample.twists[:, j] for sample in self.samples], opened)
        taken: list[_Offer] = []
        seen: set[str] = set()
        while not taken or not self._determined(taken):
            unknowns = self.equations.symbols.unknowns
            names = {unknowns[i] for offer in offers for i in offer.unknowns} if seen else {*self.wanted}
            joints = [joint for joint in self.joints if joint.name not in seen and self._has(joint, names)]
            if not joints:
                raise self.fault("no movement of bodies was found on which undeclared connections have no power")
            seen |= {joint.name for joint in joints}
            for joint in joints:
                for movement in self._movements(joint, bodies, pairs):
                    self._offer(offers, movement, [self._twist(sample, movement) for sample in self.samples], opened)
            taken = self._taken(offers)
        for item in list(reversed(taken)):
            rest = [other for other in taken if other is not item]
            if rest and self._determined(rest):
                taken = rest
        return self._released(taken)

    def _taken(self, offers: Sequence[_Offer]) -> list[_Offer]:
        """Return independent offers, the cheapest first, until they determine the wanted reactions."""
        taken: list[_Offer] = []
        for offer in sorted(offers, key=lambda each: each.cost):
            if self._independent([*taken, offer]):
                taken.append(offer)
                if self._determined(taken):
                    break
        return taken

    def _offer(
        self,
        offers: list[_Offer],
        movement: Movement | int,
        twists: Sequence[FloatArray],
        opened: Sequence[FloatArray],
    ) -> None:
        """Add a movement on which something that joints declare has power, and nothing else."""
        for twist, columns in zip(twists, opened, strict=True):
            if columns.size and np.abs(twist @ columns).max() > _SMALL * float(np.abs(twist).max()):
                return
        rows = [twist @ columns for twist, columns in zip(twists, self.columns, strict=True)]
        touched = [np.abs(row) > _SMALL * float(np.abs(t).max()) for row, t in zip(rows, twists, strict=True)]
        unknowns = tuple(np.nonzero(np.any(touched, axis=0))[0].tolist())
        if unknowns:
            count = len(movement.bodies) if isinstance(movement, Movement) else len(self.names) + 1
            offers.append(_Offer((len(unknowns), count, len(offers)), movement, tuple(rows), unknowns))

    def _independent(self, taken: Sequence[_Offer]) -> bool:
        return any(
            rank(np.array([offer.rows[i] for offer in taken]).T) == len(taken) for i in range(len(self.samples))
        )

    def _determined(self, taken: Sequence[_Offer]) -> bool:
        for i in range(len(self.samples)):
            matrix = np.array([offer.rows[i] for offer in taken])
            free = null_space(matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-300))
            if free.shape[1] and np.abs(free[self.targets]).max() > 1e-6:
                return False
        return True

    def _movements(self, joint: Declared, bodies: set[int], pairs: Sequence[Pair]) -> Iterator[Movement]:
        """Yield movements of groups of bodies along and about what a joint declares, and along the axes of frames."""
        declared = [pair for pair in self.connections[0].by_pair if set(pair) & bodies]
        undeclared = [pair for pair in pairs if pair not in self.connections[0].by_pair]
        graph, action = self.balances.graph, self.balances.model.actions[joint.action]
        for group in self._groups(joint, list(dict.fromkeys([*declared, *pairs])), undeclared):
            for number in joint.unknowns:
                unknown = graph.input(self.balances.model.symbols.unknowns[number])
                force, torque = (self.balances.along(x, unknown) for x in (action.force, action.torque))
                if force:
                    yield Movement(group, force)
                if torque:
                    yield Movement(group, torque, action.at)
            for frame in self._frames(joint):
                for k in range(3):
                    x, y, z = (graph.one if i == k else graph.zero for i in range(3))
                    yield Movement(group, (Piece(frame, (x, y, z)),))
                    yield Movement(group, (Piece(frame, (x, y, z)),), action.at)

    def _frames(self, joint: Declared) -> list[int]:
        model = self.balances.model
        action = model.actions[joint.action]
        found = [piece.frame for piece in (*action.force, *action.torque)]
        found += [model.bodies[b].frame for b in joint.pair if b is not None and model.bodies[b].inertia is not None]
        return list(dict.fromkeys([*found, 0]))

    def _groups(self, joint: Declared, everything: Sequence[Pair], undeclared: Sequence[Pair]) -> list[tuple[int, ...]]:
        """Return groups of bodies that may move beside the other body of a joint: the smaller first."""
        found: list[set[int | None]] = []
        for body, other in (joint.pair[::-1], joint.pair):
            if body is None:
                continue
            sides = (
                {body},
                beyond(body, undeclared),
                beyond(body, [pair for pair in everything if pair != joint.pair]),
                self._carried(body),
            )
            found += [side for side in sides if other not in side and None not in side]
        groups = [tuple(sorted(body for body in side if body is not None)) for side in found]
        return list(dict.fromkeys(groups))

    def _carried(self, body: int) -> set[int | None]:
        """Return a body with all that is located from it."""
        found: set[int | None] = {body}
        while True:
            more = {b for pair, b in self.connections[0].structure if set(pair) - {b} <= found} - found
            if not more:
                return found
            found |= more

    def _twist(self, sample: BodySample, movement: Movement) -> FloatArray:
        """Return the twists of all bodies in a movement."""
        direction = self._direction(sample, movement.direction)
        twist = np.zeros(len(sample.demand))
        about = None if movement.about is None else self._point(sample, movement.about)
        for body in movement.bodies:
            rigid = self.balances.model.bodies[body].inertia is not None
            if about is None:
                twist[6 * body : 6 * body + 3] = direction
                continue
            at = np.zeros(3) if rigid else sample.places[body]
            twist[6 * body : 6 * body + 3] = np.cross(direction, at - about)
            if rigid:
                twist[6 * body + 3 : 6 * body + 6] = direction
        return twist

    def _direction(self, sample: BodySample, pieces: Pieces) -> FloatArray:
        """Return a vector on the frame of the scene."""
        total, graph, kinematics = np.zeros(3), self.balances.graph, self.balances.kinematics
        for piece in pieces:
            key = id(sample), "frame", piece.frame
            if key not in self.known:
                axes = [tuple(graph.one if i == k else graph.zero for i in range(3)) for k in range(3)]
                nodes = [x for axis in axes for x in kinematics.to_frame((axis[0], axis[1], axis[2]), piece.frame, 0)]
                self.known[key] = values_at(sample, nodes).reshape(3, 3)
            total += self.known[key].T @ values_at(sample, piece.components)
        return total

    def _point(self, sample: BodySample, number: int) -> FloatArray:
        """Return the position of a point."""
        key = id(sample), "point", number
        if key not in self.known:
            self.known[key] = values_at(sample, self.balances.kinematics.between(0, number, 0))
        return self.known[key]

    def _released(self, taken: Sequence[_Offer]) -> Released:
        found: list[Balance] = []
        said: dict[str, None] = {}
        for offer in taken:
            movement = offer.movement
            if isinstance(movement, int):
                found.append(Balance(None, movement, offer.unknowns))
                continue
            found.append(Balance(self.balances.power(movement), None, offer.unknowns))
            bodies = " with ".join(repr(self.names[b]) for b in movement.bodies)
            point = "" if movement.about is None else f" about {self.balances.model.points[movement.about].name}"
            said[f"{bodies}{point}"] = None
        by = f"by moving {', '.join(said)}" if said else "by the equations of coordinates"
        text = f"{list_names(self.wanted)} {by} in the program of reactions alone"
        return Released(tuple(found), tuple(self.wanted), text)
