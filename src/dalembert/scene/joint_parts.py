"""Bodies, constraints and faults of joints that constrain."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics import ReferenceFrame

from ..errors import SceneError, list_names
from .places import at_rest

if TYPE_CHECKING:
    from .scene import Scene


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


def frame_of(scene: Scene, body: Any) -> ReferenceFrame:
    """Return the frame of a body, or the fixed one."""
    frame: ReferenceFrame = getattr(body, "frame", scene.frame)
    return frame
