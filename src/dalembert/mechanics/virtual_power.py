"""Mass matrix and forcing from virtual power: partial kinematic screws against momentum and action screws.

The mass matrix is M_ij = sum over bodies of m v^i . v^j + omega^i . I . omega^j, with the
partial kinematic screws {omega^i, v^i} of equation (13.4.2). The bodies beyond a step move as
one composite body when only the coordinate of that step moves, so a column of M is one
composite momentum screw carried towards the origin (Walker and Orin's composite rigid body
method): the work grows with the square of the number of coordinates of a chain.
The forcing is the power of the given actions minus that of the inertia at zero second rates,
both gathered towards the origin once (recursive Newton-Euler).
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import agree
from ..scene.model import BodyModel, Components
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix
from . import kinematics as vec
from .kinematics import Kinematics, Motion, Pose

Screw = tuple[Components, Components]
"""Resultant and moment about the point of a pose."""


@dataclass(frozen=True, slots=True)
class _Inertia:
    """Mass, first moment and inertia about the point of a pose."""

    mass: Node
    moment: Components
    second: tuple[Components, Components, Components]


@dataclass(frozen=True)
class Powers:
    """Equations M q_ddot = forcing from virtual power, with reactions as inputs in the forcing.

    `weighing` is the part of the potential energy that has its forces from no load: that of gravity, also where bodies
    say it themselves.
    """

    mass_matrix: Matrix
    forcing: list[Node]
    kinetic_energy: Node
    potential_energy: Node
    weighing: Node


def powers(kinematics: Kinematics) -> Powers:
    """Return the mass matrix, forcing and energies of the scene of `kinematics`."""
    graph, model = kinematics.graph, kinematics.model
    inertias: dict[Pose, _Inertia] = {}
    wrenches: dict[Pose, Screw] = {}
    kinetic, potential, weighing = graph.zero, graph.zero, graph.zero
    gravity = kinematics.resolve(model.gravity, 0)
    bodies = []
    for body, said in zip(model.bodies, model.potentials, strict=True):
        pose = kinematics.body_pose(body)
        bodies.append(pose)
        second = body.inertia or (vec.zero(graph), vec.zero(graph), vec.zero(graph))
        _add_inertia(inertias, pose, _Inertia(body.mass, vec.zero(graph), second))
        momentum = vec.rotate(second, pose.omega)
        _add_screw(wrenches, pose, inertia_screw(graph, body, pose))
        energy = body.mass * vec.dot(pose.v, pose.v) + vec.dot(pose.omega, momentum)
        kinetic = kinetic + energy / 2
        potential = potential + said
        if not vec.is_zero(gravity):
            weight = -body.mass * vec.dot(gravity, kinematics.position(pose))
            weighing = weighing + weight
            if said.is_zero or not _same_slopes(kinematics, said, weight):
                potential = potential + weight
    _add_actions(kinematics, bodies, wrenches)
    size = len(kinematics.q)
    mass_matrix: Matrix = [[graph.zero] * size for _ in range(size)]
    forcing = [graph.zero] * size
    for pose in reversed(kinematics.poses):
        composite = inertias.get(pose)
        if composite is not None:
            _fill_mass_matrix(mass_matrix, pose, composite)
            if pose.parent is not None:
                _add_inertia(inertias, pose.parent, _carry_inertia(pose, composite))
        wrench = wrenches.get(pose)
        if wrench is not None:
            for motion in pose.motions:
                forcing[motion.coordinate] = forcing[motion.coordinate] - _power(motion, wrench)
            if pose.parent is not None:
                _add_screw(wrenches, pose.parent, _carry_screw(pose, wrench))
    return Powers(mass_matrix, forcing, kinetic, potential, weighing)


def inertia_screw(graph: Graph, body: BodyModel, pose: Pose) -> Screw:
    """Return the rates of momentum and of angular momentum of a body about its mass centre, with the bias of its pose.

    Those of the accelerations that the pose has; gravity is an acceleration of the referential.
    """
    second = body.inertia or (vec.zero(graph), vec.zero(graph), vec.zero(graph))
    momentum = vec.rotate(second, pose.omega)
    rate = vec.add(vec.rotate(second, pose.alpha), vec.cross(pose.omega, momentum))
    return vec.scale(body.mass, pose.a), rate


def _same_slopes(kinematics: Kinematics, a: Node, b: Node) -> bool:
    """Whether two potential energies differ by a constant, up to the rounding of decimals."""
    if kinematics.graph.freed_of(a - b, kinematics.q) is not None:
        return True
    slopes = [[tangents(kinematics.graph, [x], {q: kinematics.graph.one})[0] for q in kinematics.q] for x in (a, b)]
    return agree(slopes[0], slopes[1])


def _add_actions(kinematics: Kinematics, bodies: list[Pose], wrenches: dict[Pose, Screw]) -> None:
    """Subtract the given actions and reactions from the wrenches of inertia."""
    model = kinematics.model
    for action in model.actions:
        if action.on_body:
            assert action.target is not None and action.at is not None
            pose, body = bodies[action.target], model.bodies[action.target]
            arm = vec.zero(kinematics.graph)
            if body.inertia is not None:  # a particle has one point, and does not turn with the frame that carries it
                arm = kinematics.between(body.centre, action.at, pose.frame)
        elif action.kind == "force":
            assert action.at is not None
            pose = kinematics.pose(kinematics.carrier(action.at), action.at)
            arm = vec.zero(kinematics.graph)
        else:
            assert action.target is not None
            carried = [p for p, body in zip(bodies, model.bodies, strict=True) if p.frame == action.target]
            pose = carried[0] if carried else kinematics.pose(action.target, 0)
            arm = vec.zero(kinematics.graph)
        force = kinematics.resolve(action.force, pose.frame)
        torque = vec.add(kinematics.resolve(action.torque, pose.frame), vec.cross(arm, force))
        minus = kinematics.graph.const(-1)
        _add_screw(wrenches, pose, (vec.scale(minus, force), vec.scale(minus, torque)))


def _add_screw(held: dict[Pose, Screw], pose: Pose, screw: Screw) -> None:
    old = held.get(pose)
    held[pose] = screw if old is None else (vec.add(old[0], screw[0]), vec.add(old[1], screw[1]))


def _add_inertia(held: dict[Pose, _Inertia], pose: Pose, new: _Inertia) -> None:
    old = held.get(pose)
    if old is not None:
        a, b = old.second, new.second
        second = (vec.add(a[0], b[0]), vec.add(a[1], b[1]), vec.add(a[2], b[2]))
        new = _Inertia(old.mass + new.mass, vec.add(old.moment, new.moment), second)
    held[pose] = new


def _power(motion: Motion, screw: Screw) -> Node:
    """Return the power coefficient of a screw: its product with a partial kinematic screw."""
    return vec.dot(motion.direction, screw[1] if motion.angular else screw[0])


def _carry_screw(pose: Pose, screw: Screw) -> Screw:
    """Return a screw of `pose` about the point, and in the components, of its parent."""
    resultant, moment = screw
    if pose.offset is not None:
        return resultant, vec.add(moment, vec.cross(pose.offset, resultant))
    assert pose.rotation is not None
    return vec.rotate_back(pose.rotation, resultant), vec.rotate_back(pose.rotation, moment)


def _carry_inertia(pose: Pose, inertia: _Inertia) -> _Inertia:
    """Return an inertia of `pose` about the point, and in the components, of its parent."""
    if pose.rotation is not None:
        c = pose.rotation
        half = [vec.rotate_back(c, row) for row in inertia.second]
        columns = [vec.rotate_back(c, (half[0][j], half[1][j], half[2][j])) for j in range(3)]
        return _Inertia(inertia.mass, vec.rotate_back(c, inertia.moment), _symmetric(columns))
    r, h, m = pose.offset, inertia.moment, inertia.mass
    assert r is not None
    total = vec.add(vec.add(h, h), vec.scale(m, r))
    trace = vec.dot(total, r)
    moment = vec.add(h, vec.scale(m, r))
    columns = []
    for i in range(3):
        # J + (2 h.r + m r.r) 1 - h r^T - r h^T - m r r^T, written with h + m r
        column = [inertia.second[j][i] - moment[j] * r[i] - r[j] * h[i] for j in range(3)]
        column[i] = column[i] + trace
        columns.append((column[0], column[1], column[2]))
    return _Inertia(m, moment, _symmetric(columns))


def _symmetric(columns: list[Components]) -> tuple[Components, Components, Components]:
    """Return a symmetric matrix from the lower parts of its columns."""
    (a, b, c), (_, d, e), (_, _, f) = columns
    return (a, b, c), (b, d, e), (c, e, f)


def _fill_mass_matrix(matrix: Matrix, pose: Pose, composite: _Inertia) -> None:
    """Add the entries of the coordinates of one step with those of the same and all earlier steps."""
    for place, motion in enumerate(pose.motions):
        if motion.angular:
            resultant = vec.cross(motion.direction, composite.moment)
            screw = (resultant, vec.rotate(composite.second, motion.direction))
        else:
            resultant = vec.scale(composite.mass, motion.direction)
            screw = (resultant, vec.cross(composite.moment, motion.direction))
        for other in pose.motions[: place + 1]:
            _add_entry(matrix, motion, other, _power(other, screw), same=other is motion)
        current = pose
        while current.parent is not None:
            screw, current = _carry_screw(current, screw), current.parent
            for other in current.motions:
                _add_entry(matrix, motion, other, _power(other, screw), same=False)


def _add_entry(matrix: Matrix, a: Motion, b: Motion, value: Node, *, same: bool) -> None:
    i, j = a.coordinate, b.coordinate
    if i != j:
        matrix[i][j] = matrix[i][j] + value
        matrix[j][i] = matrix[i][j]
    else:
        matrix[i][i] = matrix[i][i] + (value if same else 2 * value)
