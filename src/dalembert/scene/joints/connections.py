"""Joints that constrain, by their classes: functions that add them to a scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics.joint import Joint as SympyJoint

from ..shapes import Rod
from .closures import Closure, add_closure
from .couplings import Gear, Rope, add_gear, add_rod, add_rope
from .limits import Stop, add_stop
from .rolling_bodies import RollingDisc, RollingSphere, add_rolling
from .sympy_joints import add_sympy_joint

if TYPE_CHECKING:
    from ..scene import Scene


ADDING: dict[type, Callable[[Scene, Any], None]] = {
    SympyJoint: add_sympy_joint,
    Closure: add_closure,
    Rod: add_rod,
    Rope: add_rope,
    Gear: add_gear,
    RollingDisc: add_rolling,
    RollingSphere: add_rolling,
    Stop: add_stop,
}
"""Classes of joints that constrain, each with the function that adds one to a scene."""


def add_connection(scene: Scene, joint: Any) -> bool:
    """Add a joint that constrains; return whether it is one."""
    for kind, add in ADDING.items():
        if isinstance(joint, kind):
            add(scene, joint)
            return True
    return False
