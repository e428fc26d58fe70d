"""Scenes without generalized speeds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sympy as sp

from ..errors import SceneError
from .actuators import loads_of

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["without_speeds"]


def without_speeds(scene: Scene) -> Scene:
    """Return a scene in coordinates and rates alone, for readers that do not support speeds.

    Raises
    ------
    SceneError
        When the scene has no positions, or a kinematic equation has more than one speed.
    """
    if scene.lagrangian is not None or scene.velocities:
        what = "a Lagrangian" if scene.lagrangian is not None else "velocities that are not the rates of positions"
        raise SceneError(scene.name, [f"the scene came from SymPy with {what}; write it as a Scene, with positions"])
    if not scene.speeds:
        return scene
    values: dict[Any, Any] = {}
    for equation in scene.kinematic_equations:
        held = [u for u in scene.speeds if equation.has(u)]
        if len(held) != 1:
            raise SceneError(
                scene.name,
                [f"the kinematic equation {equation} = 0 has not one speed but {len(held)}; write the scene in rates"],
            )
        slope = equation.diff(held[0])
        values[held[0]] = sp.S(held[0] - equation / slope).expand()
    twin = scene.copy()
    twin.speeds = twin.kinematic_equations = ()
    twin.holonomic_constraints = tuple(c.xreplace(values) for c in scene.holonomic_constraints)
    twin.nonholonomic_constraints = tuple(c.xreplace(values) for c in scene.nonholonomic_constraints)
    twin.loads = tuple((*load[:-1], load[-1].xreplace(values)) for load in loads_of(scene))
    twin.actuators = ()
    return twin
