"""Scenes as users write them, and their reading onto the expression graph."""

from .contacts.geometry import BoxPlane, DiscPlane, PointPlane, SpherePlane
from .contacts.laws import CoulombFriction, UnilateralContact
from .contacts.spheres import SphereInBowl, SphereInCylinder, SphereSphere
from .controllers import Controller
from .expressions.compiled_functions import compiled
from .expressions.tables import table
from .joints.closures import Closure
from .joints.couplings import Gear, Rope
from .joints.joints import Joint, Unknown, unknowns
from .joints.limits import Stop
from .joints.rolling_bodies import RollingDisc, RollingSphere
from .orientation import free_orientation
from .scene import Scene

__all__ = [
    "BoxPlane",
    "Closure",
    "Controller",
    "CoulombFriction",
    "DiscPlane",
    "Gear",
    "Joint",
    "PointPlane",
    "RollingDisc",
    "RollingSphere",
    "Rope",
    "Scene",
    "SphereInBowl",
    "SphereInCylinder",
    "SpherePlane",
    "SphereSphere",
    "Stop",
    "UnilateralContact",
    "Unknown",
    "compiled",
    "free_orientation",
    "table",
    "unknowns",
]
