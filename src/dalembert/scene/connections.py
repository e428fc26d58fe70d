"""Joints that constrain, by their classes: functions that add them to a scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics.joint import Joint as SympyJoint

from .closures import Closure, add_closure
from .sympy_joints import add_sympy_joint

if TYPE_CHECKING:
    from .scene import Scene


ADDING: dict[type, Callable[[Scene, Any], None]] = {SympyJoint: add_sympy_joint, Closure: add_closure}


def add_connection(scene: Scene, joint: Any) -> bool:
    """Add a joint that constrains; return whether it is one."""
    for kind, add in ADDING.items():
        if isinstance(joint, kind):
            add(scene, joint)
            return True
    return False
