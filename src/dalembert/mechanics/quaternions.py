"""Frames oriented by unit quaternions, and angular velocities as their quasi-velocities.

SymPy's ``orient(parent, "Quaternion", e)`` is meant, with e.e = 1 among the holonomic constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

from ..ir.graph import Graph, Node
from ..scene.model import FrameModel, SceneModel
from ..transforms.quaternions import rotation_entries, spin_matrix
from .equations import VelocityChoice, VelocityGroup
from .kinematics import Kinematics

__all__ = ["quaternion_groups"]

_AXES = "xyz"


def quaternion_groups(kinematics: Kinematics) -> tuple[VelocityGroup, ...]:
    """Return the groups of frames that are turned by unit quaternions."""
    model = kinematics.model
    groups: list[VelocityGroup] = []
    taken: set[int] = set()
    for frame in model.frames:
        places = _quaternion(kinematics, frame)
        if places is None or taken & set(places):
            continue
        norm = _norm(model, [kinematics.q[i] for i in places])
        if norm:
            taken |= set(places)
            groups.append(VelocityGroup(places, _choices(kinematics, frame, places), norm=norm))
    return tuple(groups)


def _quaternion(kinematics: Kinematics, frame: FrameModel) -> tuple[int, ...] | None:
    """Return the coordinates e0 to e3 of a frame's rotation from its parent, if it is that of a quaternion."""
    if frame.rotation is None:
        return None
    entries = [entry for row in frame.rotation for entry in row]
    deps = 0
    for entry in entries:
        deps |= entry.deps
    found = [i for i, q in enumerate(kinematics.q) if q.deps & deps]
    if len(found) != 4:
        return None
    for places in permutations(found):
        matrix = rotation_entries([kinematics.q[i] for i in places])
        if all(entries[3 * i + j] is matrix[j][i] for i in range(3) for j in range(3)):
            return places
    return None


def _norm(model: SceneModel, e: Sequence[Node]) -> str:
    """Return the label of the constraint that holds the length of a quaternion, if there is one."""
    graph = model.graph
    square = graph.sum(x * x for x in e) - 1
    for constraint in model.holonomic:
        share = graph.div(constraint.expression, square) if not constraint.expression.is_zero else graph.zero
        if share.number is not None and not share.is_zero:
            return constraint.label
    return ""


def _choices(kinematics: Kinematics, frame: FrameModel, places: Sequence[int]) -> tuple[VelocityChoice, ...]:
    graph: Graph = kinematics.graph
    e = [kinematics.q[i] for i in places]
    assert frame.parent is not None
    choices = []
    for name, body in ((frame.name, True), (kinematics.model.frames[frame.parent].name, False)):
        matrix = spin_matrix(e, body=body)
        inverse = tuple(tuple(graph.node(0.5) * entry for entry in row) for row in matrix)
        rows = tuple(tuple(2 * matrix[j][i] for j in range(4)) for i in range(3))
        choices.append(VelocityChoice(tuple(f"omega_{name}_{axis}" for axis in _AXES), rows, inverse))
    return tuple(choices)
