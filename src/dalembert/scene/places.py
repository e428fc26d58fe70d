"""Places that are constant in a frame: bodies at rest, points and axes that are fixed on a body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Particle, Point, ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from .frames import Tree
from .identity import vanishes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from .scene import Scene


def _moves(entries: Iterable[Any]) -> bool:
    return any(sp.sympify(x).has(AppliedUndef, dynamicsymbols._t) for x in entries)


def constant_in(frame: ReferenceFrame, target: ReferenceFrame | Vector) -> bool:
    """Whether a frame or a vector is constant in a frame."""
    tree = Tree(frame, "_dcm_dict")
    frames = [target] if isinstance(target, ReferenceFrame) else [own for _, own in target.args]
    ways = [tree.path(own) for own in frames]
    if any(way is None for way in ways):
        return False
    entries = [x for way in ways for node in way or () for x in node._dcm_dict[tree.parent[node]]]
    if isinstance(target, Vector):
        entries += [x for matrix, _ in target.args for x in matrix]
    if not _moves(entries):
        return True
    if isinstance(target, ReferenceFrame):
        return all(constant_in(frame, axis) for axis in target)
    return all(vanishes(sp.diff(x, dynamicsymbols._t)) for x in target.to_matrix(frame))


def fixed_on(scene: Scene, body: Any, point: Point) -> bool:
    """Whether a point has a constant place on a body, or in the fixed frame (None); on a particle, whether it is it."""
    frame, centre = (scene.frame, scene.origin) if body is None else (getattr(body, "frame", None), body.masscenter)
    if Tree(centre, "_pos_dict").path(point) is None:
        return False
    way = point.pos_from(centre)
    if isinstance(body, Particle):
        return way == 0 or vanishes(way.dot(way))
    return way == 0 or constant_in(frame, way)


def at_rest(scene: Scene, body: Any) -> bool:
    """Whether a body is written at a constant place in the fixed frame, as far as it is located yet."""
    frames, points = Tree(scene.frame, "_dcm_dict"), Tree(scene.origin, "_pos_dict")
    still: dict[ReferenceFrame, bool] = {scene.frame: True}

    def turns(frame: ReferenceFrame) -> bool:
        for node in frames.path(frame) or [frame]:
            if node not in still:
                parent = frames.parent.get(node)
                still[node] = parent is not None and not _moves(node._dcm_dict[parent])
            if not still[node]:
                return True
        return False

    way = points.path(body.masscenter)
    if way is None or (not isinstance(body, Particle) and turns(body.frame)):
        return False
    pieces = (piece for point in way for piece in point._pos_dict[points.parent[point]].args)
    return not any(turns(frame) or _moves(matrix) for matrix, frame in pieces)
