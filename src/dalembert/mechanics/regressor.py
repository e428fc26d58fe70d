"""Power coefficients of the inertia of bodies, by the ten parameters that they are linear in.

With the partial kinematic screw {omega^i, v^i} of a body at a point P that is fixed in it, its angular acceleration
alpha and the acceleration a of P less gravity, a body of mass m, first moment h = m c and inertia I about P has

    v^i . (m a + alpha x h + omega x (omega x h)) + omega^i . (I alpha + omega x I omega + h x a)

for coordinate i (equation (13.4.2) with d'Alembert's inertia screw). It is linear in m, h and I (C. G. Atkeson,
C. H. An, J. M. Hollerbach, International Journal of Robotics Research 5 (1986) 101-119).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..frozen import frozen
from ..ir.node import Node
from ..ir.program import hidden_parameters
from ..scene.model import BodyModel, Components
from . import screws as vec
from .kinematics import Kinematics, Pose
from .screws import Twist, carry_twist, moved_twist

TEN = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_xy", "I_xz", "I_yy", "I_yz", "I_zz")
"""Parameters of a body about its reference point, on the axes of its frame; a particle has the first alone."""

_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@final
@frozen
class BodyColumns:
    """The columns of one body.

    Attributes
    ----------
    name : str
    columns : tuple of tuple of Node
        Power coefficients (n_q) by each parameter: ten of them, or one of a particle.
    values : tuple of Node
        The parameters.
    """

    name: str
    columns: tuple[tuple[Node, ...], ...]
    values: tuple[Node, ...]


def body_columns(kinematics: Kinematics, second: Sequence[Node]) -> list[BodyColumns]:
    """Return the columns of all bodies with second rates of the coordinates (n_q,)."""
    bodies = kinematics.model.bodies
    places = [_reference(kinematics, body) for body in bodies]
    ones = [kinematics.graph.one] * len(kinematics.q)
    partial: dict[Pose, dict[int, Twist]] = {}
    rates: dict[Pose, Twist | None] = {}
    for pose in kinematics.poses:
        before = {} if pose.parent is None else partial[pose.parent]
        rate = None if pose.parent is None else rates[pose.parent]
        partial[pose] = {i: carry_twist(pose, twist) for i, twist in before.items()}
        for motion in pose.motions:
            moved = moved_twist([motion], partial[pose].get(motion.coordinate), ones)
            assert moved is not None
            partial[pose][motion.coordinate] = moved
        rates[pose] = moved_twist(pose.motions, None if rate is None else carry_twist(pose, rate), second)
    return [
        _columns(kinematics, body, (pose, centre), partial[pose], rates[pose])
        for body, (pose, centre) in zip(bodies, places, strict=True)
    ]


def _reference(kinematics: Kinematics, body: BodyModel) -> tuple[Pose, Components]:
    """Return the pose of a body at its reference point, and the mass centre from there.

    It is the first point on the way from the origin that is fixed in the body, such as the joint that it hangs from.
    """
    symbols, graph = kinematics.model.symbols, kinematics.graph
    hidden = [name for each in symbols.inputs for name in hidden_parameters(each.name)]
    moving = graph.mask((symbols.time, *symbols.coordinates, *symbols.states, *hidden))
    pose, centre = kinematics.body_pose(body), vec.zero(graph)
    if body.inertia is None:
        return pose, centre
    while (offset := pose.offset) is not None and not any(x.deps & moving for x in offset):
        assert pose.parent is not None
        pose, centre = pose.parent, vec.add(centre, offset)
    return pose, centre


def _columns(
    kinematics: Kinematics,
    body: BodyModel,
    place: tuple[Pose, Components],
    partial: dict[int, Twist],
    rate: Twist | None,
) -> BodyColumns:
    pose, centre = place
    graph, size = kinematics.graph, len(kinematics.q)
    omega, alpha, a = pose.omega, pose.alpha, pose.a
    if rate is not None:
        alpha, a = vec.add(alpha, rate[0]), vec.add(a, rate[1])
    count = 1 if body.inertia is None else len(TEN)
    columns = [[graph.zero] * size for _ in range(count)]
    for i, (w, v) in partial.items():
        columns[0][i] = vec.dot(v, a)
        if body.inertia is None:
            continue
        moment = vec.add(vec.cross(v, alpha), vec.cross(vec.cross(v, omega), omega))
        moment = vec.add(moment, vec.cross(a, w))
        turned = vec.cross(w, omega)
        for k in range(3):
            columns[1 + k][i] = moment[k]
        for number, (j, k) in enumerate(_PAIRS):
            entry = w[j] * alpha[k] + turned[j] * omega[k]
            columns[4 + number][i] = entry if j == k else entry + w[k] * alpha[j] + turned[k] * omega[j]
    return BodyColumns(body.name, tuple(map(tuple, columns)), _values(body, centre))


def _values(body: BodyModel, centre: Components) -> tuple[Node, ...]:
    """Return the parameters of a body with a mass centre there."""
    if body.inertia is None:
        return (body.mass,)
    moment = vec.scale(body.mass, centre)
    square = vec.dot(centre, moment)
    second = [body.inertia[j][k] - centre[j] * moment[k] for j, k in _PAIRS]
    second = [entry + square if j == k else entry for entry, (j, k) in zip(second, _PAIRS, strict=True)]
    return (body.mass, *moment, *second)
