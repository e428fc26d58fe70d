"""Connections between bodies that no joint declares, and the reactions that are the same whatever these carry.

The coordinates of a scene connect bodies: each to what it is located from, where a point belongs to several to each of
these, and to others that share a coordinate with it. What no joint declares may carry every wrench without power on the
motion that the coordinates allow between its two bodies. A reaction is determined where the balances of all bodies give
it for every value of those. All is decided by numbers at random states that satisfy the constraints.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import combinations
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from .body_balances import BodyBalances
from .body_samples import BodySample, values_at

_SMALL = 1e-8
"""Relative size that counts as zero at random states."""

Pair = tuple[int | None, int]
"""Two bodies; None is the fixed frame."""


def pair_of(a: int | None, b: int | None) -> Pair:
    """Return two bodies in their order, the fixed frame first."""
    if a is None or b is None:
        known = a if b is None else b
        assert known is not None
        return (None, known)
    return (min(a, b), max(a, b))


@final
@frozen
class Declared:
    """A joint between two bodies: number of its action, its point, and the numbers of its unknowns."""

    name: str
    pair: Pair
    action: int
    unknowns: tuple[int, ...]


def declared_joints(balances: BodyBalances) -> list[Declared]:
    """Return the joints with unknowns."""
    model = balances.model
    masks = [balances.graph.mask([name]) for name in model.symbols.unknowns]
    found, seen = [], set()
    for number, action in enumerate(model.actions):
        if not action.of_joint:
            continue
        deps = action.deps
        mine = tuple(i for i, mask in enumerate(masks) if deps & mask)
        pair = pair_of(action.target, action.other)
        if mine and (action.name, action.at, pair) not in seen:  # a joint between bodies is two opposite actions
            seen.add((action.name, action.at, pair))
            found.append(Declared(action.name, pair, number, mine))
    return found


def null_space(matrix: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the vectors that a matrix takes to zero, as columns."""
    if not matrix.size:
        return np.eye(matrix.shape[1])
    rows = matrix / max(float(np.abs(matrix).max()), 1e-300)
    _, values, right = np.linalg.svd(rows)
    return np.asarray(right[int(np.sum(values > _SMALL)) :].T)


def _unit(columns: FloatArray) -> FloatArray:
    return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))


def rank(columns: FloatArray) -> int:
    """Return the rank of columns of any size."""
    return int(np.linalg.matrix_rank(_unit(columns), tol=_SMALL)) if columns.size else 0


def in_span(vector: FloatArray, columns: FloatArray, size: float) -> bool:
    """Whether a vector is a combination of columns, beside a size."""
    rest = vector
    if columns.size:
        left, values, _ = np.linalg.svd(_unit(columns), full_matrices=False)
        basis = left[:, values > _SMALL]
        rest = vector - basis @ (basis.T @ vector)
    return bool(np.abs(rest).max(initial=0.0) <= 1e-7 * max(size, 1e-300))


@final
class Connections:
    """Connections at one sample: of declared joints, and of what none declares."""

    def __init__(self, balances: BodyBalances, joints: Sequence[Declared], sample: BodySample) -> None:
        self.balances, self.joints, self.sample = balances, joints, sample
        self.size = len(balances.poses)
        self.by_pair: dict[Pair, list[Declared]] = {}
        for joint in joints:
            self.by_pair.setdefault(joint.pair, []).append(joint)
        self.complete = {pair: self._declared_rest(pair) for pair in self.by_pair}
        self.structure = [(pair_of(parent, b), b) for b in range(self.size) for parent in self._parents(b)]

    # -- wrenches between two bodies -------------------------------------------------------------

    def rigid(self, body: int | None) -> bool:
        """Whether a body is rigid, as the fixed frame is."""
        return body is None or self.balances.model.bodies[body].inertia is not None

    def wrenches(self, pair: Pair, at: FloatArray | None = None) -> FloatArray:
        """Return the wrenches between two bodies as columns: forces at a point, and couples between rigid bodies."""
        a, b = pair
        both_rigid = self.rigid(a) and self.rigid(b)
        if not both_rigid and at is None:
            at = self.sample.places[b if not self.rigid(b) else a]
        at = np.zeros(3) if at is None else at
        matrix = np.zeros((6 * self.size, 6 if both_rigid else 3))
        for body, sign in ((b, 1.0), (a, -1.0)):
            if body is None:
                continue
            matrix[6 * body : 6 * body + 3, :3] = sign * np.eye(3)
            if self.rigid(body):
                matrix[6 * body + 3 : 6 * body + 6, :3] = sign * np.cross(at, np.eye(3)).T
                matrix[6 * body + 3 : 6 * body + 6, 3:] = sign * np.eye(3)[:, : matrix.shape[1] - 3]
        return matrix

    def ideal(self, pair: Pair, at: FloatArray | None = None, *, anywhere: bool = False) -> FloatArray:
        """Return the wrenches without power on the motions that the coordinates allow between two bodies.

        With `anywhere`, a particle that moves relative to a body may stand for a body that only translates: a force
        between them acts on any line.
        """
        wrenches = self.wrenches(pair, at)
        if anywhere and self.rigid(pair[0]) != self.rigid(pair[1]) and self.moved_by(pair):
            body = pair[0] if self.rigid(pair[0]) else pair[1]
            if body is not None:
                wrenches = np.hstack([wrenches, self.wrenches((None, body))[:, 3:]])
        return np.asarray(wrenches @ null_space(self.sample.twists.T @ wrenches))

    def moved_by(self, pair: Pair) -> set[int]:
        """Return the numbers of the coordinates that move two bodies relative to each other."""
        power = np.abs(self.sample.twists.T @ self.wrenches(pair)).max(axis=1)
        return set(np.nonzero(power > _SMALL)[0].tolist())

    def _columns(self, joint: Declared) -> FloatArray:
        return self.sample.unknowns[:, list(joint.unknowns)]

    def _declared_rest(self, pair: Pair) -> tuple[FloatArray, bool]:
        """Return what joints do not fix of the connection of their bodies, and whether they can be all of it.

        At each of their points that are the forces and couples across to the declared ones. Where these do not hold
        all that the coordinates leave out, such as the axle of a wheel beside a contact at its rim, there is another
        connection, which may carry every ideal wrench. Bodies that are `_apart`, such as those at which a loop closes,
        are connected by constraints alone, of which `unheld` finds those without joints.
        """
        joints, (_, b) = self.by_pair[pair], pair
        declared = np.hstack([self._columns(joint) for joint in joints])
        own = declared[6 * b : 6 * b + 6]
        couples = own[3:] @ null_space(own[:3])
        rest = []
        for joint in joints:
            whole = self.wrenches(pair, self.place(joint))
            forces, turns = whole[:, :3], whole[:, 3:]
            rest.append(forces @ null_space(np.vstack([own[:3].T, self.sample.twists.T @ forces])))
            if turns.shape[1]:
                rest.append(turns @ null_space(np.vstack([couples.T, self.sample.twists.T @ turns])))
        found, ideal = np.hstack(rest), self.ideal(pair, self.place(joints[0]))
        known = np.hstack([declared, found])
        if rank(np.hstack([known, ideal])) == rank(known):
            return found, True
        return (found, True) if self._apart(pair) else (ideal, False)

    def _apart(self, pair: Pair) -> bool:
        """Whether neither of two bodies may carry the other, and no coordinate moves both beside what carries them."""
        carrying = [
            {pair_of(parent, b) for some in self.balances.parents(b) for parent in some} for b in pair if b is not None
        ]
        moving = [set[int]().union(*map(self.moved_by, pairs)) for pairs in carrying]
        return len(carrying) == 2 and pair not in carrying[0] | carrying[1] and not moving[0] & moving[1]

    def place(self, joint: Declared) -> FloatArray:
        """Return the position of the point of a joint."""
        action = self.balances.model.actions[joint.action]
        assert action.at is not None
        return values_at(self.sample, self.balances.kinematics.between(0, action.at, 0))

    # -- connections that no joint declares --------------------------------------------------------

    def _parents(self, body: int) -> list[int | None]:
        """Return what may carry a body; of all that a point belongs to, what a joint connects the body with.

        One that is located from the centre of another and oriented from its axes, with coordinates of its own, is
        carried by that.
        """
        beside, turned, located = self.balances.parents(body)
        joined = [parent for parent in located if self._explained(pair_of(parent, body))]
        own: list[int | None] = [
            parent for parent in turned if parent in (*beside, *located) and not self._moved(parent, body)
        ]
        joined = own or joined
        return list(dict.fromkeys([*beside, *turned, *(joined or located)]))

    def _moved(self, parent: int, body: int) -> bool:
        """Whether a body moves with some coordinate that another moves with relative to it."""
        moving = sorted(self.moved_by(pair_of(parent, body)))
        return bool(np.abs(self.sample.twists[6 * parent : 6 * parent + 6, moving]).max(initial=0.0) > _SMALL)

    def _explained(self, pair: Pair) -> bool:
        """Whether a joint holds all that the coordinates leave out between two bodies, at a point that rests on one."""
        if pair not in self.by_pair or not self.complete[pair][1]:
            return False
        points = [self.balances.model.actions[joint.action].at for joint in self.by_pair[pair]]
        ends = [end for end in pair if end is not None]
        return any(at is not None and self.balances.carries(end, at) for at in points for end in ends)

    @cached_property
    def beside_joints(self) -> dict[Pair, FloatArray]:
        """Return the undeclared connections of bodies whose places no joint explains."""
        explained = {body for pair in self.by_pair if self._explained(pair) for body in pair}
        pairs = [pair for pair, body in self.structure if pair not in self.by_pair and body not in explained]
        return {pair: self.ideal(pair, anywhere=True) for pair in pairs}

    @cached_property
    def undeclared(self) -> dict[Pair, FloatArray]:
        """Return the connections that no joint declares: of the structure, of shared coordinates, of constraints."""
        found = {pair: self.ideal(pair, anywhere=True) for pair, _ in self.structure if pair not in self.by_pair}
        moved = [(pair, b, self.moved_by(pair)) for pair, b in self.structure]
        for (first, b, one), (second, c, other) in combinations(moved, 2):
            pair = pair_of(b, c) if b != c else first
            if one & other and pair not in self.by_pair and pair not in found and first != second:
                found[pair] = self.ideal(pair, anywhere=True)
        for pair, wrenches in self._of_constraints(moved).items():
            known = found.get(pair)
            found[pair] = wrenches if known is None else np.hstack([known, wrenches])
        return found

    def unheld(self) -> list[int]:
        """Return the constraints whose reactions the declared joints cannot exert."""
        power = self.sample.twists.T @ self.sample.unknowns @ self.sample.mode
        found = []
        for number, row in enumerate(self.sample.constraints):
            size = float(np.abs(row).max())
            bodily = in_span(row, self.sample.twists.T, size)  # the length of a quaternion moves no body
            if bodily and not in_span(row, power, size):
                found.append(number)
        return found

    def _of_constraints(self, moved: Sequence[tuple[Pair, int, set[int]]]) -> dict[Pair, FloatArray]:
        """Return what may hold the constraints that no joint does.

        A constraint on one joint's own coordinates is held within that joint, across to what it declares. Any other may
        be held between all bodies that its coordinates move.
        """
        found: dict[Pair, FloatArray] = {}
        for number in self.unheld():
            row = self.sample.constraints[number]
            moving = set(np.nonzero(np.abs(row) > _SMALL * np.abs(row).max())[0].tolist())
            pairs = list(dict.fromkeys(pair for pair, _, by in moved if by & moving))
            if len(pairs) == 1:
                found[pairs[0]] = self._within(pairs[0])
                continue
            bodies = sorted({-1 if body is None else body for pair in pairs for body in pair})
            for a, b in combinations(bodies, 2):
                pair = pair_of(None if a < 0 else a, b)
                found[pair] = self.wrenches(pair)
        return found

    def _within(self, pair: Pair) -> FloatArray:
        if pair not in self.by_pair:
            return self.wrenches(pair)
        _, b = pair
        joints = self.by_pair[pair]
        own = np.hstack([self._columns(joint) for joint in joints])[6 * b : 6 * b + 6]
        whole, couples = self.wrenches(pair, self.place(joints[0])), own[3:] @ null_space(own[:3])
        parts = [whole[:, :3] @ null_space(own[:3].T)]
        if whole.shape[1] > 3:
            parts.append(whole[:, 3:] @ null_space(couples.T))
        return np.hstack(parts)


# Groups of bodies.


def components(size: int, pairs: Iterable[Pair]) -> list[set[int]]:
    """Return the bodies in groups that pairs connect, not through the fixed frame."""
    group = list(range(size))
    for a, b in pairs:
        if a is not None:
            old, new = group[b], group[a]
            group = [new if g == old else g for g in group]
    return [{b for b in range(size) if group[b] == g} for g in dict.fromkeys(group)]


def beyond(start: int, pairs: Iterable[Pair]) -> set[int | None]:
    """Return the bodies, and the fixed frame as None, that pairs connect with one."""
    pairs, found = list(pairs), {start}
    reached: set[int | None] = {start}
    while found:
        found = {c for pair in pairs if reached & set(pair) for c in pair if c not in reached}  # type: ignore[misc]
        reached |= found
    return reached


def wrench_columns(sample: BodySample, open_pairs: Mapping[Pair, FloatArray]) -> FloatArray:
    """Return the wrenches of undeclared connections, side by side."""
    parts = [matrix for matrix in open_pairs.values() if matrix.shape[1]]
    return np.hstack(parts) if parts else np.zeros((len(sample.demand), 0))
