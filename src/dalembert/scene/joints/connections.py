"""The functions that add joints to a scene, by their classes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics.joint import Joint as SympyJoint

from ...errors import nesting_named
from ..shapes import Rod
from .closures import Closure, add_closure
from .couplings import Gear, Rope, add_gear, add_rod, add_rope
from .joints import Joint
from .limits import Stop, add_stop
from .reactions import require_new_name
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


@nesting_named
def add_joints(self: Scene, *joints: Any) -> None:
    """Add joints: those of ``sympy.physics.mechanics``, those that constrain, or a `Joint` with unknown reactions.

    `PinJoint`, `PrismaticJoint`, `CylindricalJoint`, `PlanarJoint`, `SphericalJoint` and `WeldJoint` build a tree.
    Each adds its bodies and coordinates, unless the scene has them, and its speeds. A parent at rest is the fixed
    frame. `Closure`, `Rod`, `Gear`, `RollingDisc` and `RollingSphere` add constraints, `Rope` and `Stop` contacts.
    The reaction of a joint "elbow" is an output by name: "elbow.force_x", ..., "elbow.torque_z" act on the child at
    the joint's ``child_point``, with axes of its ``parent_interframe``. See `reaction` for other axes.

    A reaction need not have power on the coordinates. It is computed where it is the same whatever connections of
    bodies carry that no joint declares; otherwise the error names the bodies.

    Raises
    ------
    SceneError
        For a second joint of the same name, and for arguments that contradict the scene, such as a SymPy joint that
        closes a loop.
    """
    for joint in joints:
        if isinstance(joint, Joint):
            if any(joint.name == item.name for item in self.connections):
                require_new_name(self, joint.name)
            self.joints += (joint,)
        elif not add_connection(self, joint):
            self.joints += (joint,)
