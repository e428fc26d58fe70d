"""Gradients of inverse dynamics along the tree of bodies, by composite bodies.

The terms of inertia of the equations of speeds u are tau = M(q) u_dot + bias(q, u). A coordinate turns or moves, as one
rigid body, all that hangs from its step: with spatial vectors (angular part first) of the twist V and the acceleration
A of the step, and with the twist J of the step relative to its parent, a variation D of the configuration has

    dV = (V - J) x D,    dA = (A - S u_dot - V x J) x D + dV x J,    e = dA - dV x V,

and a variation S of a speed has dV = S, e = 2 V x S + S x J. The force of the bodies beyond changes by I e + B dV,
where I is their composite inertia and B the sum of V x* (I x) + x x* (I V) - I (V x x): S. Singh, R. P. Russell,
P. M. Wensing, "Efficient analytical derivatives of rigid-body dynamics using spatial vector algebra", IEEE Robotics
and Automation Letters 7 (2022). B vanishes on translations, with which forces do not change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..scene.model import Components
from ..transforms.linear import Matrix
from . import screws as vec
from .inertia_tree import InertiaTree, TreeStep
from .kinematics import Motion
from .screws import (
    Inertia,
    Rows,
    Screw,
    Twist,
    add_inertia,
    add_screw,
    carry_inertia,
    carry_screw,
    carry_twist,
    momentum,
    momentum_screw,
    moved_twist,
    power,
    turned,
)


@final
@frozen
class _Composite:
    """All bodies beyond a step: inertia, force, momentum, and the map from angular velocities to moments in B."""

    inertia: Inertia
    force: Screw
    momentum: Components
    moments: Rows

    @staticmethod
    def of(inertia: Inertia, twist: Twist, acceleration: Twist) -> _Composite:
        """Return the bodies of one step."""
        graph, (omega, v), second = inertia.mass.graph, twist, inertia.second
        linear, angular = momentum(inertia, twist)
        gyroscopic = vec.cross(omega, linear), vec.add(vec.cross(omega, angular), vec.cross(v, linear))
        trace, two = second[0][0] + second[1][1] + second[2][2], graph.const(2)
        columns = [vec.cross(omega, column) for column in zip(*second, strict=True)]
        along = vec.dot(inertia.moment, v)
        unit = [[graph.one if i == j else graph.zero for j in range(3)] for i in range(3)]
        moments = []
        for i in range(3):
            own = vec.cross(omega, (unit[0][i], unit[1][i], unit[2][i]))
            columns_of_v = vec.scale(inertia.moment[i], v)
            row = [two * (columns[i][j] - columns_of_v[j] + unit[i][j] * along) - trace * own[j] for j in range(3)]
            moments.append((row[0], row[1], row[2]))
        force = add_screw(momentum(inertia, acceleration), gyroscopic)
        return _Composite(inertia, force, linear, _transposed(moments))

    def plus(self, other: _Composite | None) -> _Composite:
        """Return the bodies of two steps that have the same frame and point."""
        if other is None:
            return self
        x, y, z = (vec.add(a, b) for a, b in zip(self.moments, other.moments, strict=True))
        return _Composite(
            add_inertia(self.inertia, other.inertia),
            add_screw(self.force, other.force),
            vec.add(self.momentum, other.momentum),
            (x, y, z),
        )

    def carried(self, step: TreeStep) -> _Composite:
        """Return the bodies about the point, and in the components, of the parent of a step."""
        inertia, force = carry_inertia(step, self.inertia), carry_screw(step, self.force)
        if step.rotation is not None:
            c = step.rotation
            return _Composite(inertia, force, vec.rotate_back(c, self.momentum), turned(c, self.moments))
        r, p = step.offset, self.momentum
        assert r is not None
        two, along = p[0].graph.const(2), vec.dot(r, p)
        rows = []
        for i in range(3):
            row = [self.moments[i][j] - two * (p[i] * r[j]) for j in range(3)]
            row[i] = row[i] + two * along
            rows.append((row[0], row[1], row[2]))
        return _Composite(inertia, force, p, (rows[0], rows[1], rows[2]))

    def change(self, twist: Twist, rest: Twist) -> Screw:
        """Return the change I e + B dV of the force for dV = `twist` and e = `rest`."""
        two, omega = self.momentum[0].graph.const(2), twist[0]
        further = vec.scale(two, vec.cross(omega, self.momentum)), vec.rotate(self.moments, omega)
        return add_screw(momentum(self.inertia, rest), further)

    def moment_of(self, motion: Motion) -> Components:
        """Return B^T S, which is an angular covector."""
        if motion.angular:
            return vec.rotate_back(self.moments, motion.direction)
        minus_two = self.momentum[0].graph.const(-2)
        return vec.scale(minus_two, vec.cross(motion.direction, self.momentum))


def _transposed(columns: Sequence[Components]) -> Rows:
    a, b, c = zip(*columns, strict=True)
    return a, b, c


def _crossed(a: Twist, b: Twist) -> Twist:
    """Return the spatial product a x b of two twists."""
    return vec.cross(a[0], b[0]), vec.add(vec.cross(a[0], b[1]), vec.cross(a[1], b[0]))


def _sum(a: Twist, b: Twist) -> Twist:
    return vec.add(a[0], b[0]), vec.add(a[1], b[1])


def _difference(a: Twist, b: Twist) -> Twist:
    return vec.subtract(a[0], b[0]), vec.subtract(a[1], b[1])


@final
@frozen
class _Variation:
    """A column of a matrix of gradients: that of a coordinate or of a speed, which enters at a step.

    `twist` and `rest` are dV and e, `beyond` is the change of the force in the components of the step, and `before`
    that with the change of these components.
    """

    matrix: Matrix
    column: int
    twist: Twist
    rest: Twist
    beyond: Screw
    before: Screw

    def add(self, row: int, value: Node) -> None:
        """Add to an entry of the column."""
        self.matrix[row][self.column] = self.matrix[row][self.column] + value


@final
@frozen
class InverseDynamicsGradients:
    """Inertia terms of the equations of speeds at given rates of the speeds.

    Attributes
    ----------
    values : list of Node, length n_u
        M u_dot + bias.
    mass_matrix : Matrix (n_u, n_u)
    by_coordinates, by_speeds : Matrix (n_u, n_q), (n_u, n_u)
    """

    values: list[Node]
    mass_matrix: Matrix
    by_coordinates: Matrix
    by_speeds: Matrix


def inverse_dynamics_gradients(
    graph: Graph,
    trees: tuple[InertiaTree, InertiaTree],
    gravity: Components,
    u: Sequence[Node],
    u_dot: Sequence[Node],
) -> InverseDynamicsGradients:
    """Return inertia terms, gravity among them, with their gradients.

    Parameters
    ----------
    graph : Graph
    trees : (InertiaTree, InertiaTree)
        The bodies with the partial kinematic screws of the coordinates, and with those of the speeds, which must be
        constant in their steps. No step changes otherwise.
    gravity : Components
        Acceleration of gravity on the frame of the scene [m/s^2].
    u, u_dot : sequence of Node, length n_u
        Speeds and their rates.
    """
    return _Recursion(graph, *trees, gravity, u, u_dot).gradients()


@final
class _Recursion:
    """Motions from the root to the leaves, then composite bodies and entries of the gradients back to the root."""

    def __init__(
        self,
        graph: Graph,
        coordinates: InertiaTree,
        speeds: InertiaTree,
        gravity: Components,
        u: Sequence[Node],
        u_dot: Sequence[Node],
    ) -> None:
        self.graph, self.coordinates, self.speeds = graph, coordinates, speeds
        self.nothing: Twist = (vec.zero(graph), vec.zero(graph))
        self.twists, self.accelerations, self.joints = list[Twist](), list[Twist](), list[Twist]()
        self.carried = list[Twist]()
        fall = vec.zero(graph), vec.scale(graph.const(-1), gravity)
        for step in speeds.steps:
            root = step.parent < 0
            twist = self.nothing if root else carry_twist(step, self.twists[step.parent])
            carried = fall if root else carry_twist(step, self.accelerations[step.parent])
            joint = moved_twist(step.motions, None, u) or self.nothing
            twist = _sum(twist, joint)
            moved = moved_twist(step.motions, carried, u_dot) or self.nothing
            self.twists.append(twist)
            self.joints.append(joint)
            self.carried.append(carried)
            self.accelerations.append(_sum(moved, _crossed(twist, joint)))
        n_u = speeds.size
        self.values = [graph.zero] * n_u
        self.mass, self.by_speeds = ([[graph.zero] * n_u for _ in range(n_u)] for _ in range(2))
        self.by_coordinates = [[graph.zero] * coordinates.size for _ in range(n_u)]

    def gradients(self) -> InverseDynamicsGradients:
        """Return the gradients."""
        steps = self.speeds.steps
        wholes: dict[int, _Composite] = {}
        for number in range(len(steps) - 1, -1, -1):
            step, whole = steps[number], wholes.get(number)
            if step.inertia is not None:
                own = _Composite.of(step.inertia, self.twists[number], self.accelerations[number])
                whole = wholes[number] = own.plus(whole)
            if whole is not None and step.parent >= 0:
                wholes[step.parent] = whole.carried(step).plus(wholes.get(step.parent))
        varied = {number: self._variations(number, whole) for number, whole in wholes.items()}
        for number, whole in wholes.items():
            for motion in steps[number].motions:
                k = motion.coordinate
                self.values[k] = self.values[k] + power(motion, whole.force)
                self._rows(number, motion, whole, varied)
            self._columns(number, varied[number])
        return InverseDynamicsGradients(self.values, self.mass, self.by_coordinates, self.by_speeds)

    def _variations(self, number: int, whole: _Composite) -> list[_Variation]:
        """Return the variations of the coordinates and speeds that enter at a step."""
        twist, joint, found = self.twists[number], self.joints[number], list[_Variation]()
        before = _difference(twist, joint)
        for motion in self.coordinates.steps[number].motions:
            turn = self._screw(motion)
            change = _crossed(before, turn)
            moved = _sum(_crossed(self.carried[number], turn), _crossed(change, joint))
            rest = _difference(moved, _crossed(change, twist))
            beyond, (force, moment) = whole.change(change, rest), whole.force
            seen = vec.cross(turn[0], force), vec.add(vec.cross(turn[0], moment), vec.cross(turn[1], force))
            place = self.by_coordinates, motion.coordinate
            found.append(_Variation(*place, change, rest, beyond, add_screw(beyond, seen)))
        for motion in self.speeds.steps[number].motions:
            turn = self._screw(motion)
            rest = _sum(_crossed(_sum(twist, twist), turn), _crossed(turn, joint))
            beyond = whole.change(turn, rest)
            found.append(_Variation(self.by_speeds, motion.coordinate, turn, rest, beyond, beyond))
        return found

    def _screw(self, motion: Motion) -> Twist:
        nothing = self.nothing[0]
        return (motion.direction, nothing) if motion.angular else (nothing, motion.direction)

    def _rows(self, number: int, motion: Motion, whole: _Composite, varied: Mapping[int, Sequence[_Variation]]) -> None:
        """Enter the derivatives of the term of a speed by what enters at its step and before, and its inertias."""
        steps, k = self.speeds.steps, motion.coordinate
        for each in varied[number]:
            each.add(k, power(motion, each.beyond))
        screw, moment = momentum_screw(whole.inertia, motion), whole.moment_of(motion)
        for other in steps[number].motions:
            self.mass[other.coordinate][k] = self.mass[other.coordinate][k] + power(other, screw)
        while (parent := steps[number].parent) >= 0:
            step = steps[number]
            screw = carry_screw(step, screw)
            moment = moment if step.rotation is None else vec.rotate_back(step.rotation, moment)
            number = parent
            for other in steps[number].motions:
                j, value = other.coordinate, power(other, screw)
                self.mass[j][k] = self.mass[j][k] + value
                self.mass[k][j] = self.mass[k][j] + value
            for each in varied[number]:
                through = vec.dot(screw[0], each.rest[1]) + vec.dot(screw[1], each.rest[0])
                each.add(k, through + vec.dot(moment, each.twist[0]))

    def _columns(self, number: int, variations: Sequence[_Variation]) -> None:
        """Enter the derivatives of the terms of speeds that enter before a step by what enters there."""
        steps = self.speeds.steps
        for each in variations:
            screw, place = each.before, number
            while (parent := steps[place].parent) >= 0:
                screw = carry_screw(steps[place], screw)
                place = parent
                for other in steps[place].motions:
                    each.add(other.coordinate, power(other, screw))
