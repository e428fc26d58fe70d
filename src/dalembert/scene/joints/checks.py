"""Check that the points of joints and loads belong to bodies, and that particles have no torques."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics import Particle

from ...ir.graph import Graph
from ...ir.node import Node, deps_of
from ..expressions.identity import vanishes
from ..model import Action, BodyModel, FrameModel, Pieces, PointModel
from .joints import Unknown

if TYPE_CHECKING:
    from ..scene import Scene
    from .joints import Joint


def torques_on_particles(scene: Scene, joint: Joint) -> list[str]:
    """Return a fault for every particle that a joint with a torque acts on."""
    return [
        f"joint {joint.name!r} has a torque, but {str(body.name)!r} is a particle, which has no orientation: make it a"
        " RigidBody, or leave the torque out"
        for body in scene.bodies
        if joint.torque != 0 and isinstance(body, Particle) and str(body.name) in (joint.body, joint.other)
    ]


def points_off_particles(scene: Scene) -> list[str]:
    """Return a fault for every joint on a particle at another point than that of the particle.

    Where constraints or contacts may bring the two together, and for pairs of opposite actions, they may differ.
    """
    if scene.holonomic_constraints or scene.contacts:
        return []
    faults = []
    unknowns = [_unknowns(joint.force) | _unknowns(joint.torque) for joint in scene.joints]
    for number, joint in enumerate(scene.joints):
        paired = any(found & unknowns[number] for other, found in enumerate(unknowns) if other != number)
        for body in scene.bodies:
            if paired or not isinstance(body, Particle) or str(body.name) not in (joint.body, joint.other):
                continue
            apart = joint.at.pos_from(body.point)
            if not all(vanishes(x) for matrix, _ in apart.args for x in matrix):
                faults.append(
                    f"joint {joint.name!r} acts on {str(body.name)!r} at {joint.at.name!r}, which is not the point"
                    f" {body.point.name!r} of that particle: let it act at {body.point.name!r}, or, where it acts on"
                    " what carries the particle, make that a RigidBody"
                )
    return faults


def _unknowns(vector: Any) -> set[Unknown]:
    """Return the unknown components in a vector."""
    return set() if vector == 0 else {x for matrix, _ in vector.args for x in matrix.atoms(Unknown)}


def foreign_points(
    graph: Graph,
    coordinates: Sequence[Node],
    frames: Mapping[int, FrameModel],
    points: Mapping[int, PointModel],
    bodies: Sequence[BodyModel],
    actions: Sequence[Action],
    unknowns: Iterable[str],
) -> list[str]:
    """Return a fault for every action with unknowns at a point that moves with another body than its own.

    A contact may travel over its body, and a joint, or a pair of opposite actions with the same unknowns, may act
    between two bodies at a point of either. Everything else that changes with a coordinate which moves other bodies,
    but not this one, is the wrong point or the wrong body.
    """
    poses: list[int] = []
    searched = graph.mask(unknowns)
    faults: dict[str, None] = {}
    for action in actions:
        held = action.deps & searched
        if not action.of_joint or action.target is None or action.at is None or not held:
            continue
        poses = poses or [_frame(frames, body.frame) | _point(frames, points, body.centre) for body in bodies]
        own = sorted({action.target} if action.other is None else {action.target, action.other})
        others, moving = 0, 0
        for number, pose in enumerate(poses):
            others, moving = (others, moving | pose) if number in own else (others | pose, moving)
        apart = [_apart(frames, points, bodies[i], action.at) & others & ~moving for i in own]
        strange = apart[0] if all(apart) else 0
        shared = action.other is None and any(
            other.of_joint and other.target != action.target and other.deps & held for other in actions
        )
        names = [str(q.payload) for q in coordinates if q.deps & strange]
        if names and not shared:
            faults[_foreign(action.name, [bodies[i].name for i in own], points[action.at].name, names)] = None
    return list(faults)


def travelling_points(
    frames: Mapping[int, FrameModel],
    points: Mapping[int, PointModel],
    bodies: Sequence[BodyModel],
    actions: Sequence[Action],
    moving: int,
) -> list[str]:
    """Return a warning for every load (point, force) whose point is located from a body and moves over all of them.

    `moving` are the inputs that change along motions, as a mask. The power of such a load is that of the velocity of
    the point, so that a force at the lowest point of a wheel exerts no torque on the wheel.
    """
    centres = {body.centre: body for body in bodies}
    found = []
    for action in actions:
        if action.kind != "force" or action.actuator is not None or action.at in centres or not action.force:
            continue
        assert action.at is not None
        path = _path(points, action.at)
        start = max((place for place, number in enumerate(path) if place and number in centres), default=0)
        if start == 0 or centres[path[start]].inertia is None:  # from the origin, or from a particle
            continue
        pieces = [piece for number in path[start + 1 :] for piece in points[number].position]
        carried = [body.frame for body in bodies if body.inertia is not None]
        if all(
            not any(x.deps & moving for x in piece.components)
            and any(not _turning(frames, piece.frame, frame) & moving for frame in carried)
            for piece in pieces
        ):
            continue
        body = centres[path[start]].name
        found.append(
            f"the {action.name} acts at a point that is located from {body!r} and moves over it, so that its power is"
            f" that of the velocity of the point, not of {body!r}: write it as (body, point, force), with the body"
            f" {body!r}, where it acts on that body there, such as the force of the road on a tyre"
        )
    return found


def _turning(frames: Mapping[int, FrameModel], first: int, second: int) -> int:
    """Return the inputs that the rotation from one frame to another depends on, as a mask."""
    paths = []
    for number in (first, second):
        current: int | None = number
        path = []
        while current is not None:
            path.append(current)
            current = frames[current].parent
        paths.append(path[::-1])
    while paths[0] and paths[1] and paths[0][0] == paths[1][0]:
        del paths[0][0], paths[1][0]
    passed = (*paths[0], *paths[1])
    return deps_of(entry for number in passed for row in frames[number].rotation or () for entry in row)


def _foreign(joint: str, bodies: Sequence[str], point: str, names: Sequence[str]) -> str:
    """Return the fault of a joint at a point of no body of its own."""
    moves = ", ".join(names)
    if len(bodies) == 1:
        (body,) = bodies
        return (
            f"joint {joint!r} acts on {body!r} at {point!r}, which is not a point of that body: its place on the body"
            f" changes with {moves}, which does not move {body!r}. Name the body that {point!r} belongs to, or locate"
            f" the point from {body!r}"
        )
    both = " and ".join(map(repr, bodies))
    return (
        f"joint {joint!r} acts between {both} at {point!r}, which is a point of neither: its place on both changes with"
        f" {moves}, which moves neither. Name the bodies that {point!r} belongs to, or locate the point from one of"
        " them"
    )


def _frame(frames: Mapping[int, FrameModel], number: int) -> int:
    mask = 0
    current: int | None = number
    while current is not None:
        model = frames[current]
        mask |= deps_of(entry for row in model.rotation or () for entry in row)
        current = model.parent
    return mask


def _pieces(frames: Mapping[int, FrameModel], pieces: Pieces) -> int:
    mask = 0
    for piece in pieces:
        mask |= _frame(frames, piece.frame) | deps_of(piece.components)
    return mask


def _path(points: Mapping[int, PointModel], number: int) -> list[int]:
    path = []
    current: int | None = number
    while current is not None:
        path.append(current)
        current = points[current].parent
    return path[::-1]


def _point(frames: Mapping[int, FrameModel], points: Mapping[int, PointModel], number: int) -> int:
    mask = 0
    for node in _path(points, number):
        mask |= _pieces(frames, points[node].position)
    return mask


def _apart(frames: Mapping[int, FrameModel], points: Mapping[int, PointModel], body: BodyModel, at: int) -> int:
    """Return the inputs, other than the body's own pose, that the vector from the mass centre to a point depends on."""
    ahead, behind = _path(points, at), _path(points, body.centre)
    while ahead and behind and ahead[0] == behind[0]:
        del ahead[0], behind[0]
    mask = 0
    for node in (*ahead, *behind):
        mask |= _pieces(frames, points[node].position)
    return mask
