"""Kane's form of the principle of virtual power, for scenes that prescribe velocities of bodies.

Velocities are affine in the rates, v = sum v^i q_dot_i + v_t, and need not be the rates of any position: a rolling
constraint may be written into them. The partial velocities are v^i = dv/dq_dot_i, and as for other scenes
M_ij = sum over bodies of m v^i . v^j + omega^i . I . omega^j. The rates of momentum m v and of the moment of momentum
I . omega are taken in the Newtonian frame, so that an inertia may be written on a frame that its body turns in.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import SceneError
from ..ir.node import Node
from ..ir.zero_tests import agree
from ..scene.model import Components, GivenBody, GivenLoad, Pieces, SceneModel
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix
from . import screws as vec
from .kinematics import Kinematics
from .virtual_power import Powers


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
