"""Scenes as users write them, and their reading onto the expression graph."""

from .closures import Closure
from .compiled_functions import compiled
from .contact_geometry import BoxPlane, DiscPlane, PointPlane, SpherePlane
from .contact_spheres import SphereInBowl, SphereInCylinder, SphereSphere
from .contacts import CoulombFriction, UnilateralContact
from .controllers import Controller
from .couplings import Gear, Rope
from .joints import Joint, Unknown, unknowns
from .limits import Stop
from .orientation import free_orientation
from .rolling_bodies import RollingDisc, RollingSphere
from .scene import Scene
from .tables import table

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
