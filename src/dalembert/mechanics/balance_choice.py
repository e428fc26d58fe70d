"""The choice of balances that determine reactions: movements of few bodies, with power on few unknowns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..errors import ConstraintError, list_names
from ..frozen import frozen
from ..ir.node import Node
from ..scene.model import Piece, Pieces
from .body_balances import BodyBalances, Movement
from .body_samples import BodySample, body_samples, values_at
from .connections import Connections, Declared, Pair, beyond, declared_joints, null_space, rank, wrench_columns
from .equations import EquationsOfMotion

_SMALL = 1e-8


@final
@frozen
class Balance:
    """One equation: the power on a movement vanishes, or that of a coordinate (its number).

    `unknowns` are the numbers of those that have power on it; others may stand in it, and cancel.
    """

    power: Node | None
    coordinate: int | None
    unknowns: tuple[int, ...]


@final
@frozen
class Released:
    """Balances on a graph of their own, and a text on what was moved for them.

    Of `unknowns`, the balances do not determine those that share loads by their compliances, by number in `shared`.
    """

    balances: tuple[Balance, ...]
    unknowns: tuple[str, ...]
    text: str
    shared: frozenset[int] = frozenset()


@final
@frozen
class _Offer:
    """A movement, or the number of a coordinate, with its powers on the unknowns at each sample.

    `cost` is how many unknowns have power on it and how many bodies it moves.
    """

    cost: tuple[int, int, int]
    movement: Movement | int
    rows: tuple[FloatArray, ...]
    unknowns: tuple[int, ...]


def self_stresses(columns: FloatArray) -> FloatArray:
    """Return the orthogonal projector (n, n) on the combinations of wrenches (6 n_bodies, n) that balance each other.

    Each wrench is scaled to length one.
    """
    free = null_space(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
    return np.asarray(free @ free.T)


def tied_together(projector: FloatArray) -> list[set[int]]:
    """Return the groups of wrenches that take part in self-stresses together, from a projector (n, n)."""
    left = {int(i) for i in np.flatnonzero(np.diag(projector) > _SMALL**2)}
    groups = []
    while left:
        group, new = set(), {min(left)}
        while new:
            group |= new
            beside = np.flatnonzero(np.abs(projector[sorted(new)]).max(axis=0) > _SMALL)
            new = {int(i) for i in beside} - group
        groups.append(group)
        left -= group
    return groups


@final
class BodySystem:
    """Bodies of a scene with their balances, joints and connections at random states, and the wanted unknowns.

    `shared` are the numbers of those unknowns that share loads by their compliances, `rigid` the bodies between which
    connections that no joint declares take part in that.
    """

    def __init__(self, equations: EquationsOfMotion, wanted: Sequence[str]) -> None:
        assert equations.scene is not None
        self.equations, self.wanted = equations, wanted
        self.balances = BodyBalances(equations.scene)
        self.joints = declared_joints(self.balances)
        self.samples = body_samples(equations, self.balances)
        self.names = [body.name for body in self.balances.model.bodies]
        self.connections = [Connections(self.balances, self.joints, sample) for sample in self.samples]
        self.columns = [sample.unknowns @ sample.mode for sample in self.samples]
        self.targets = [equations.symbols.unknowns.index(name) for name in wanted]
        self.shared: set[int] = set()
        self.rigid: dict[str, None] = {}

    def share(self, group: Collection[int], beside: Sequence[str]) -> None:
        """Let some unknowns share loads by their compliances, all of them wanted from now on."""
        names = self.equations.symbols.unknowns
        new = sorted({*group} - {*self.targets})
        self.wanted, self.targets = [*self.wanted, *(names[i] for i in new)], [*self.targets, *new]
        self.shared |= {*group}
        self.rigid |= dict.fromkeys(beside)

    def fault(self, why: str) -> ConstraintError:
        """Return the error for the wanted reactions."""
        return ConstraintError(
            f"scene {self.equations.name!r}: the reactions {list_names(self.wanted)} are not determined: {why}"
        )

    def has(self, joint: Declared, wanted: Collection[str]) -> bool:
        """Whether some of the wanted unknowns are those of a joint."""
        names = self.balances.model.symbols.unknowns
        return any(names[i] in wanted for i in joint.unknowns)


@final
class BalanceChoice:
    """The choice among movements of some bodies on which undeclared connections have no power."""

    def __init__(self, system: BodySystem, bodies: set[int], open_pairs: Sequence[Mapping[Pair, FloatArray]]) -> None:
        self.system, self.bodies, self.open_pairs = system, bodies, open_pairs
        self.known: dict[tuple[int, str, int], FloatArray] = {}
        pairs = zip(system.samples, open_pairs, strict=True)
        self.opened = [wrench_columns(sample, found) for sample, found in pairs]

    def released(self) -> Released:
        """Return the balances."""
        bodies, open_pairs = self.bodies, self.open_pairs
        pairs = [pair for pair, matrix in open_pairs[0].items() if matrix.shape[1]]
        offers: list[_Offer] = []
        for j in range(len(self.system.equations.q)):
            self._offer(offers, j, [sample.twists[:, j] for sample in self.system.samples])
        taken: list[_Offer] = []
        seen: set[str] = set()
        while not taken or not self._determined(taken):
            unknowns = self.system.equations.symbols.unknowns
            names = {unknowns[i] for offer in offers for i in offer.unknowns} if seen else {*self.system.wanted}
            joints = [joint for joint in self.system.joints if joint.name not in seen and self.system.has(joint, names)]
            if not joints:
                raise self.system.fault("no movement of bodies was found on which undeclared connections have no power")
            seen |= {joint.name for joint in joints}
            for joint in joints:
                for movement in self._movements(joint, bodies, pairs):
                    self._offer(offers, movement, [self._twist(sample, movement) for sample in self.system.samples])
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

    def _offer(self, offers: list[_Offer], movement: Movement | int, twists: Sequence[FloatArray]) -> None:
        """Add a movement on which something that joints declare has power, and nothing else."""
        for twist, columns in zip(twists, self.opened, strict=True):
            if columns.size and np.abs(twist @ columns).max() > _SMALL * float(np.abs(twist).max()):
                return
        rows = [twist @ columns for twist, columns in zip(twists, self.system.columns, strict=True)]
        touched = [np.abs(row) > _SMALL * float(np.abs(t).max()) for row, t in zip(rows, twists, strict=True)]
        unknowns = tuple(np.nonzero(np.any(touched, axis=0))[0].tolist())
        if unknowns:
            count = len(movement.bodies) if isinstance(movement, Movement) else len(self.system.names) + 1
            offers.append(_Offer((len(unknowns), count, len(offers)), movement, tuple(rows), unknowns))

    def _independent(self, taken: Sequence[_Offer]) -> bool:
        return any(
            rank(np.array([offer.rows[i] for offer in taken]).T) == len(taken) for i in range(len(self.system.samples))
        )

    def _determined(self, taken: Sequence[_Offer]) -> bool:
        """Whether offers determine the wanted reactions; those that share loads up to their self-stresses, alone."""
        shared = sorted(self.system.shared)
        single = [i for i in self.system.targets if i not in self.system.shared]
        for i, columns in enumerate(self.system.columns):
            matrix = np.array([offer.rows[i] for offer in taken])
            free = null_space(matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-300))
            if free.shape[1] and np.abs(free[single]).max(initial=0.0) > 1e-6:
                return False
            if not shared:
                continue
            projector = free @ free.T
            if np.abs(np.delete(projector[shared], shared, axis=1)).max(initial=0.0) > 1e-6:
                return False
            stresses = self_stresses(np.hstack([columns, self.opened[i]]))[shared]
            if round(np.trace(projector[np.ix_(shared, shared)])) != np.linalg.matrix_rank(stresses, tol=1e-6):
                return False
        return True

    def _movements(self, joint: Declared, bodies: set[int], pairs: Sequence[Pair]) -> Iterator[Movement]:
        """Yield movements of groups of bodies along and about what a joint declares, and along the axes of frames."""
        declared = [pair for pair in self.system.connections[0].by_pair if set(pair) & bodies]
        undeclared = [pair for pair in pairs if pair not in self.system.connections[0].by_pair]
        graph, action = self.system.balances.graph, self.system.balances.model.actions[joint.action]
        for group in self._groups(joint, list(dict.fromkeys([*declared, *pairs])), undeclared):
            for number in joint.unknowns:
                unknown = graph.input(self.system.balances.model.symbols.unknowns[number])
                force, torque = (self.system.balances.along(x, unknown) for x in (action.force, action.torque))
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
        model = self.system.balances.model
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
            sides: tuple[set[int | None], ...] = (
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
            more = {b for pair, b in self.system.connections[0].structure if set(pair) - {b} <= found} - found
            if not more:
                return found
            found |= more

    def _twist(self, sample: BodySample, movement: Movement) -> FloatArray:
        """Return the twists of all bodies in a movement."""
        direction = self._direction(sample, movement.direction)
        twist = np.zeros(len(sample.demand))
        about = None if movement.about is None else self._point(sample, movement.about)
        for body in movement.bodies:
            rigid = self.system.balances.model.bodies[body].inertia is not None
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
        total, graph, kinematics = np.zeros(3), self.system.balances.graph, self.system.balances.kinematics
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
            self.known[key] = values_at(sample, self.system.balances.kinematics.between(0, number, 0))
        return self.known[key]

    def _released(self, taken: Sequence[_Offer]) -> Released:
        found: list[Balance] = []
        said: dict[str, None] = {}
        for offer in taken:
            movement = offer.movement
            if isinstance(movement, int):
                found.append(Balance(None, movement, offer.unknowns))
                continue
            found.append(Balance(self.system.balances.power(movement), None, offer.unknowns))
            bodies = " with ".join(repr(self.system.names[b]) for b in movement.bodies)
            point = "" if movement.about is None else f" about {self.system.balances.model.points[movement.about].name}"
            said[f"{bodies}{point}"] = None
        by = f"by moving {', '.join(said)}" if said else "by the equations of coordinates"
        text = f"{list_names(self.system.wanted)} {by} in the program of reactions alone"
        unknowns = self.system.equations.symbols.unknowns
        if self.system.shared:
            together = list_names(unknowns[i] for i in sorted(self.system.shared))
            text += f"; {together} share loads by their compliances (least elastic energy)"
            if self.system.rigid:
                between = "; ".join(self.system.rigid)
                text += f", beside rigid connections that no joint declares between {between}"
        return Released(tuple(found), tuple(self.system.wanted), text, frozenset(self.system.shared))
