"""Joints that constrain, by their classes: functions that add them to a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics.joint import Joint as SympyJoint

from .sympy_joints import add_sympy_joint

if TYPE_CHECKING:
    from .scene import Scene


def add_connection(scene: Scene, joint: Any) -> bool:
    """Add a joint that constrains; return whether it is one."""
    if isinstance(joint, SympyJoint):
        add_sympy_joint(scene, joint)
        return True
    return False
