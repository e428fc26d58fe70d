"""Frames that the contents of a scene depend on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody
from sympy.physics.vector import Dyadic, Vector

from .actuators import loads_of
from .tree import Tree

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["frames_in_use"]


def frames_in_use(scene: Scene, frames: Tree) -> set[ReferenceFrame]:
    """Return the frames that bodies, loads, actuators, joints and gravity are written on, and their ancestors.

    Other frames may be attached to those of a scene, such as the ones of another scene in the same notebook.

    Parameters
    ----------
    scene : Scene
    frames : Tree
        Below the frame of the scene.
    """
    points = Tree(scene.origin, "_pos_dict")
    found: set[ReferenceFrame] = set()
    for frame in _written_on(_contents(scene), points):
        found.update(frames.path(frame) or ())
    return found


def _contents(scene: Scene) -> Iterator[Any]:
    """Yield the points, frames, vectors and dyadics of a scene."""
    yield scene.gravity
    for body in scene.bodies:
        if isinstance(body, Particle):
            yield body.point
        elif isinstance(body, RigidBody):
            yield from (body.masscenter, body.frame, body.central_inertia)
    for load in loads_of(scene):
        if isinstance(load, Sequence):
            yield from load
    for joint in scene.joints:
        yield from (getattr(joint, name, None) for name in ("at", "force", "torque"))


def _written_on(items: Iterable[Any], points: Tree) -> Iterator[ReferenceFrame]:
    """Yield the frames that some points, frames, vectors and dyadics are written on."""
    for item in items:
        if isinstance(item, ReferenceFrame):
            yield item
        elif isinstance(item, Point):
            path = points.path(item) or ()
            yield from _written_on([node._pos_dict[points.parent[node]] for node in path], points)
        elif isinstance(item, Vector):
            yield from (frame for _, frame in item.args)
        elif isinstance(item, Dyadic):
            yield from _written_on([side for _, first, second in item.args for side in (first, second)], points)
