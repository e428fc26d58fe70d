"""Parts of joints that constrain: bodies, constraints and faults, and places that are constant in a frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Particle, Point, ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from ...errors import SceneError, list_names
from ..expressions.identity import vanishes
from ..expressions.vector_products import far, is_constant
from ..frames import Tree

if TYPE_CHECKING:
    from ..scene import Scene


def counted(number: int, noun: str) -> str:
    """Return a number of things in words."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def require(scene: Scene, name: str, faults: Iterable[str]) -> None:
    """Raise the faults of a joint, if it has any."""
    listed = [f"joint {name!r}: {fault}" for fault in faults]
    if listed:
        raise SceneError(scene.name, listed)


def add_constraints(scene: Scene, name: str, rows: Iterable[Any]) -> None:
    """Add holonomic constraints that messages call by the name of a joint."""
    rows = tuple(rows)
    scene.holonomic_constraints += rows
    scene.constraint_names += tuple((row, name) for row in rows)


def add_velocity_constraints(scene: Scene, name: str, rows: Iterable[Any]) -> None:
    """Add nonholonomic constraints that messages call by the name of a joint."""
    rows = tuple(rows)
    scene.nonholonomic_constraints += rows
    scene.constraint_names += tuple((row, name) for row in rows)


def body_of(scene: Scene, given: Any, fault: Callable[[str], Any]) -> Any:
    """Return a body of a scene by itself or its name, and None for the fixed frame; call `fault` for others."""
    if given is None:
        return None
    named = [body for body in scene.bodies if body is given or str(body.name) == given]
    if named:
        return named[0]
    if not isinstance(given, str) and hasattr(given, "masscenter") and at_rest(scene, given):
        return None
    name = given if isinstance(given, str) else getattr(given, "name", given)
    fault(
        f"{str(name)!r} is no body of the scene; known: {list_names(scene.body_names())}. Add bodies, and the joints"
        " that bring them, first; None is the fixed frame"
    )
    return None


def called(*bodies: Any) -> str:
    """Return how messages call bodies, None being the fixed frame."""
    return " and ".join("the fixed frame" if body is None else repr(str(body.name)) for body in bodies)


def frame_of(scene: Scene, body: Any) -> ReferenceFrame:
    """Return the frame of a body, or the fixed one."""
    frame: ReferenceFrame = getattr(body, "frame", scene.frame)
    return frame


# Places: bodies at rest, points and axes that are fixed on a body.


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
    if far(frame, target):
        return is_constant(frame, target)
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
