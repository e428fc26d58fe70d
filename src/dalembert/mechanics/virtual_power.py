"""Mass matrix and forcing from virtual power: partial kinematic screws against momentum and action screws.

The mass matrix is M_ij = sum over bodies of m v^i . v^j + omega^i . I . omega^j, with the
partial kinematic screws {omega^i, v^i} of equation (13.4.2). The bodies beyond a step move as
one composite body when only the coordinate of that step moves, so a column of M is one
composite momentum screw carried towards the origin (Walker and Orin's composite rigid body
method): the work grows with the square of the number of coordinates of a chain. For many bodies
it is not done here: their inertia is kept as a tree.
The forcing is the power of the given actions minus that of the inertia at zero second rates,
both gathered towards the origin once (recursive Newton-Euler).

Scenes that prescribe velocities of bodies take Kane's form of the principle. Velocities are affine in the rates,
v = sum v^i q_dot_i + v_t, and need not be the rates of any position: a rolling constraint may be written into them. The
partial velocities are v^i = dv/dq_dot_i, and the mass matrix is the same sum of these. The rates of momentum m v and of
the moment of momentum I . omega are taken in the Newtonian frame, so that an inertia may be written on a frame that its
body turns in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ..errors import SceneError
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import agree
from ..scene.model import BodyModel, Components, GivenBody, GivenLoad, Pieces, SceneModel
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix
from . import screws as vec
from .inertia_tree import WORTH, InertiaTree, fill_mass_matrix
from .kinematics import Kinematics, Pose
from .screws import Inertia, Screw, add_inertia, add_screw, carry_inertia, carry_screw, power

_LEAST = 14
"""Coordinates below which no scene has so many operations that the elimination along the tree is tried."""


@frozen
class Powers:
    """Equations M q_ddot = forcing from virtual power, with reactions as inputs in the forcing.

    `weighing` is the part of the potential energy that has its forces from no load: that of gravity, also where bodies
    say it themselves. `tree` has the bodies where the mass matrix is long; it is made where it is asked for then, and
    `mass_matrix` is None.
    """

    mass_matrix: Matrix | None
    forcing: list[Node]
    kinetic_energy: Node
    potential_energy: Node
    weighing: Node
    tree: InertiaTree | None = None


def powers(kinematics: Kinematics) -> Powers:
    """Return the mass matrix, forcing and energies of the scene of `kinematics`."""
    graph, model = kinematics.graph, kinematics.model
    inertias: dict[Pose, Inertia] = {}
    wrenches: dict[Pose, Screw] = {}
    kinetic, potential, weighing = graph.zero, graph.zero, graph.zero
    gravity, size = kinematics.resolve(model.gravity, 0), len(kinematics.q)
    heavy = not vec.is_zero(gravity)
    long = size >= _LEAST and all(said.is_zero for said in model.potentials)
    bodies = []
    for body, said in zip(model.bodies, model.potentials, strict=True):
        pose = kinematics.body_pose(body)
        bodies.append(pose)
        second = body.inertia or (vec.zero(graph), vec.zero(graph), vec.zero(graph))
        _add_body(inertias, graph, body, pose)
        momentum = vec.rotate(second, pose.omega)
        _gather(wrenches, pose, inertia_screw(graph, body, pose))
        energy = body.mass * vec.dot(pose.v, pose.v) + vec.dot(pose.omega, momentum)
        kinetic = kinetic + energy / 2
        potential = potential + said
        if heavy and not long:
            weight = -body.mass * vec.dot(gravity, kinematics.position(pose))
            weighing = weighing + weight
            if said.is_zero or not _same_slopes(kinematics, said, weight):
                potential = potential + weight
    tree = InertiaTree.of(size, kinematics.poses, inertias) if size >= _LEAST else None
    if long and heavy:
        assert tree is not None
        potential = weighing = -vec.dot(gravity, tree.first_moment(graph))
    _add_actions(kinematics, bodies, wrenches)
    if tree is not None and tree.dense_operations(WORTH) > WORTH:
        return Powers(None, _gathered(kinematics, {}, wrenches, []), kinetic, potential, weighing, tree)
    mass_matrix: Matrix = [[graph.zero] * size for _ in range(size)]
    forcing = _gathered(kinematics, inertias, wrenches, mass_matrix)
    return Powers(mass_matrix, forcing, kinetic, potential, weighing)


def inertia_tree(kinematics: Kinematics) -> InertiaTree:
    """Return the bodies of a scene as a tree of steps."""
    inertias: dict[Pose, Inertia] = {}
    for body in kinematics.model.bodies:
        _add_body(inertias, kinematics.graph, body, kinematics.body_pose(body))
    return InertiaTree.of(len(kinematics.q), kinematics.poses, inertias)


def _add_body(inertias: dict[Pose, Inertia], graph: Graph, body: BodyModel, pose: Pose) -> None:
    second = body.inertia or (vec.zero(graph), vec.zero(graph), vec.zero(graph))
    inertias[pose] = add_inertia(inertias.get(pose), Inertia(body.mass, vec.zero(graph), second))


def given_powers(kinematics: Kinematics) -> list[Node]:
    """Return the power coefficients (n_q) of the given actions and reactions, without inertia and gravity."""
    wrenches: dict[Pose, Screw] = {}
    _add_actions(kinematics, [kinematics.body_pose(body) for body in kinematics.model.bodies], wrenches)
    return _gathered(kinematics, {}, wrenches, [])


def _gathered(
    kinematics: Kinematics, inertias: dict[Pose, Inertia], wrenches: dict[Pose, Screw], mass_matrix: Matrix
) -> list[Node]:
    """Return the forcing, and fill a mass matrix: inertias and wrenches of poses are gathered towards the origin."""
    forcing = [kinematics.graph.zero] * len(kinematics.q)
    for pose in reversed(kinematics.poses):
        composite = inertias.get(pose)
        if composite is not None:
            fill_mass_matrix(mass_matrix, pose.motions, composite, _ancestors(pose))
            if pose.parent is not None:
                inertias[pose.parent] = add_inertia(inertias.get(pose.parent), carry_inertia(pose, composite))
        wrench = wrenches.get(pose)
        if wrench is not None:
            for motion in pose.motions:
                forcing[motion.coordinate] = forcing[motion.coordinate] - power(motion, wrench)
            if pose.parent is not None:
                _gather(wrenches, pose.parent, carry_screw(pose, wrench))
    return forcing


def _gather(held: dict[Pose, Screw], pose: Pose, screw: Screw) -> None:
    held[pose] = add_screw(held.get(pose), screw)


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
        _gather(wrenches, pose, (vec.scale(minus, force), vec.scale(minus, torque)))


def _ancestors(pose: Pose) -> Iterator[tuple[Pose, Pose]]:
    """Yield a pose and its parent, from `pose` to the origin."""
    while pose.parent is not None:
        yield pose, pose.parent
        pose = pose.parent


def kane_powers(kinematics: Kinematics) -> Powers:
    """Return the mass matrix, forcing and kinetic energy from the velocities that a scene gives."""
    graph, given = kinematics.graph, kinematics.model.given
    assert given is not None
    size = len(kinematics.q)
    matrix: Matrix = [[graph.zero] * size for _ in range(size)]
    forcing = load_powers(kinematics, given.loads)
    kinetic = graph.zero
    for body in given.bodies:
        for momentum, velocity, frame in _momenta(kinematics, body):
            partials = _partials(kinematics, velocity, body.name)
            rate = vec.add(_flow(kinematics, momentum), vec.cross(_turning(kinematics, frame), momentum))
            shares = [_tangent(kinematics, momentum, i) for i in range(size)]
            for i, partial in enumerate(partials):
                forcing[i] = forcing[i] - vec.dot(rate, partial)
                for j in range(i + 1):
                    matrix[i][j] = matrix[i][j] + vec.dot(shares[j], partial)
                    matrix[j][i] = matrix[i][j]
            kinetic = kinetic + vec.dot(momentum, velocity) / 2
    return Powers(matrix, forcing, kinetic, graph.sum(kinematics.model.potentials), graph.zero)


def load_powers(kinematics: Kinematics, loads: Sequence[GivenLoad]) -> list[Node]:
    """Return the power coefficients of loads, one a coordinate."""
    total = [kinematics.graph.zero] * len(kinematics.q)
    for load in loads:
        frame = _frame(load.velocity)
        force = kinematics.resolve(load.vector, frame)
        partials = _partials(kinematics, kinematics.resolve(load.velocity, frame), load.name)
        total = [old + vec.dot(force, partial) for old, partial in zip(total, partials, strict=True)]
    return total


def velocities_agree(model: SceneModel) -> bool:
    """Whether the velocities that a scene gives are those that follow from its positions."""
    given, kinematics = model.given, Kinematics(model)
    assert given is not None
    pairs: list[tuple[int, Components, Pieces]] = []
    for body, said in zip(model.bodies, given.bodies, strict=True):
        frame = kinematics.carrier(body.centre) if body.inertia is None else body.frame
        pose = kinematics.pose(frame, body.centre)
        pairs.append((pose.frame, pose.v, said.velocity))
        if body.inertia is not None:
            pairs.append((pose.frame, pose.omega, said.spin))
    for action, load in zip(model.actions, given.loads, strict=True):
        if action.at is not None:
            pose = kinematics.pose(kinematics.carrier(action.at), action.at)
            pairs.append((pose.frame, pose.v, load.velocity))
        elif action.target is not None:
            pose = kinematics.pose(action.target, 0)
            pairs.append((pose.frame, pose.omega, load.velocity))
    return all(agree(found, kinematics.resolve(velocity, frame)) for frame, found, velocity in pairs)


def _momenta(kinematics: Kinematics, body: GivenBody) -> list[tuple[Components, Components, int]]:
    """Return momentum with velocity and moment of momentum with angular velocity, and the frames of the components."""
    frame = _frame(body.velocity)
    velocity = kinematics.resolve(body.velocity, frame)
    found = [(vec.scale(body.mass, velocity), velocity, frame)]
    if body.inertia is not None:
        spin = kinematics.resolve(body.spin, body.frame)
        found.append((vec.rotate(body.inertia, spin), spin, body.frame))
    return found


def _frame(pieces: Pieces) -> int:
    """Return a frame to resolve a vector on: that of most of its components."""
    counts: dict[int, int] = {}
    for piece in pieces:
        counts[piece.frame] = counts.get(piece.frame, 0) + sum(not x.is_zero for x in piece.components)
    return max(counts, key=lambda frame: counts[frame], default=0)


def _turning(kinematics: Kinematics, frame: int) -> Components:
    return kinematics.pose(frame, 0).omega


def _flow(kinematics: Kinematics, a: Components) -> Components:
    x, y, z = tangents(kinematics.graph, a, kinematics.flow)
    return x, y, z


def _tangent(kinematics: Kinematics, a: Components, i: int) -> Components:
    x, y, z = tangents(kinematics.graph, a, {kinematics.qdot[i]: kinematics.graph.one})
    return x, y, z


def _partials(kinematics: Kinematics, velocity: Components, name: str) -> list[Components]:
    """Return the partial velocities of a velocity; ``SceneError`` where it is not affine in the rates."""
    partials = [_tangent(kinematics, velocity, i) for i in range(len(kinematics.q))]
    graph, rates = kinematics.graph, kinematics.qdot
    freed = []
    for partial in partials:
        entries = [graph.freed_of(x, rates) for x in partial]
        x, y, z = entries
        if x is None or y is None or z is None:
            raise SceneError(kinematics.model.name, [f"the velocity of {name!r} is not affine in the rates"])
        freed.append((x, y, z))
    return freed
