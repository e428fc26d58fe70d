"""Quasi-velocities that the frames of a scene offer, those oriented by unit quaternions among them.

Constraints and inertia are simple when velocities are resolved on the right frame: the speed
of the sleigh's blade along the blade, the angular velocity of a sphere. Two kinds of groups are
found, without a word in the scene:

* coordinates whose rates are the components of a point's velocity on some frame (Cartesian
  coordinates) may give way to the components of the same velocity on any other frame;
* three coordinates that orient one frame relative to another may give way to the components
  of the angular velocity on any frame between the two.

Which of these is used, if any, is decided by the `minimal` formulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..scene.model import Components, FrameModel, SceneModel
from ..transforms.linear import rotation_entries, spin_matrix
from . import screws as vec
from .kinematics import Kinematics, Pose

_AXES = "xyz"
_MOST_FRAMES = 8
"""Frames on which the velocity of a point is resolved: each is tried, and far from the root of a tree none pays."""


@final
@frozen
class VelocityChoice:
    """Quasi-velocities that may replace the rates of a group: speeds = rows . rates.

    `inverse` is what gives the rates of a quaternion, rates = inverse . speeds; empty where rows have an inverse.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[Node, ...], ...]
    inverse: tuple[tuple[Node, ...], ...] = ()


@final
@frozen
class VelocityGroup:
    """Coordinates that together move a point or turn a frame, with the quasi-velocities the scene's frames offer.

    Attributes
    ----------
    coordinates : tuple of int
    choices : tuple of VelocityChoice
    angles : bool
        Whether they are three angles that turn a frame.
    norm : str
        For the four coordinates of a quaternion, the label of the constraint that makes its length one; else empty.
    """

    coordinates: tuple[int, ...]
    choices: tuple[VelocityChoice, ...]
    angles: bool = False
    norm: str = ""

    def lock(self, graph: Graph) -> Node:
        """Return what vanishes where three angles lock, on a graph: the determinant of the rows of the first choice."""
        a, b, c = (graph.adopt(row) for row in self.choices[0].rows)
        cross = [a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3] for i in range(3)]
        return graph.sum(x * y for x, y in zip(cross, c, strict=True))


def velocity_groups(kinematics: Kinematics) -> tuple[VelocityGroup, ...]:
    """Return the groups of a scene; no coordinate is in two of them."""
    groups: list[VelocityGroup] = []
    taken: set[int] = set()
    for pose in list(kinematics.poses):
        group = _translation(kinematics, pose) if pose.offset is not None else None
        if group is not None and not taken & set(group.coordinates):
            groups.append(group)
            taken |= set(group.coordinates)
    frames = sorted({pose.frame for pose in kinematics.poses}, key=lambda frame: len(kinematics.ancestry(frame)))
    for frame in frames:
        rotation = _rotation(kinematics, frame)
        if rotation is not None and not taken & set(rotation.coordinates):
            groups.append(rotation)
            taken |= set(rotation.coordinates)
    return tuple(groups)


def _translation(kinematics: Kinematics, pose: Pose) -> VelocityGroup | None:
    """Return the group of a moving step whose partial velocities are constant and orthonormal."""
    motions = pose.motions
    if len(motions) not in (2, 3):
        return None
    for i, motion in enumerate(motions):
        if any(x.number is None for x in motion.direction):
            return None
        products = (vec.dot(motion.direction, other.direction) for other in motions)
        if any(not (x.is_one if i == j else x.is_zero) for j, x in enumerate(products)):
            return None
    choices = []
    others = [frame for frame in range(len(kinematics.model.frames)) if frame != pose.frame]
    near = sorted(others, key=lambda frame: len(kinematics.ancestry(frame)))[:_MOST_FRAMES]
    for frame in sorted(near):
        columns = [kinematics.to_frame(motion.direction, pose.frame, frame) for motion in motions]
        rows = [[column[axis] for column in columns] for axis in range(3)]
        used = [axis for axis in range(3) if not all(x.is_zero for x in rows[axis])]
        if len(used) == len(motions):
            name = kinematics.model.frames[frame].name
            choices.append(
                VelocityChoice(tuple(f"v_{name}_{_AXES[a]}" for a in used), tuple(tuple(rows[a]) for a in used))
            )
    return VelocityGroup(tuple(motion.coordinate for motion in motions), tuple(choices))


def _rotation(kinematics: Kinematics, frame: int) -> VelocityGroup | None:
    """Return the group of the last three coordinates that turn `frame`, with no body on the frames between."""
    path = kinematics.ancestry(frame)
    stretch = [frame]
    carrying = {body.frame for body in kinematics.model.bodies if body.inertia is not None}
    axes: dict[int, list[tuple[int, Components]]] = {}
    for number in reversed(path[1:]):
        step = _turning(kinematics, number)
        for coordinate, direction in step:
            axes.setdefault(coordinate, []).append((number, direction))
        parent = kinematics.model.frames[number].parent
        assert parent is not None
        stretch.append(parent)
        if len(axes) >= 3 or parent in carrying:
            break
    if len(axes) != 3:
        return None
    coordinates = tuple(sorted(axes))
    choices = []
    for target in stretch:
        columns = []
        for coordinate in coordinates:
            total = vec.zero(kinematics.graph)
            for number, direction in axes[coordinate]:
                total = vec.add(total, kinematics.to_frame(direction, number, target))
            columns.append(total)
        rows = tuple(tuple(column[axis] for column in columns) for axis in range(3))
        name = kinematics.model.frames[target].name
        choices.append(VelocityChoice(tuple(f"omega_{name}_{axis}" for axis in _AXES), rows))
    return VelocityGroup(coordinates, tuple(choices), angles=True)


def _turning(kinematics: Kinematics, frame: int) -> list[tuple[int, Components]]:
    for pose in kinematics.poses:
        if pose.frame == frame and pose.rotation is not None:
            return [(motion.coordinate, motion.direction) for motion in pose.motions]
    return []


# Frames oriented by unit quaternions, and angular velocities as their quasi-velocities.
#
# SymPy's ``orient(parent, "Quaternion", e)`` is meant, with e.e = 1 among the holonomic constraints.


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
