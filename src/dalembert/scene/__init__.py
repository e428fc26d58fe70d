"""Scenes as users write them, and their reading onto the expression graph."""

from .contact_geometry import BoxPlane, DiscPlane, PointPlane, SpherePlane
from .contact_spheres import SphereInBowl, SphereInCylinder, SphereSphere
from .contacts import CoulombFriction, UnilateralContact
from .controllers import Controller
from .joints import Joint, Unknown, unknowns
from .orientation import free_orientation
from .scene import Scene
from .tables import table

__all__ = [
    "BoxPlane",
    "Controller",
    "CoulombFriction",
    "DiscPlane",
    "Joint",
    "PointPlane",
    "Scene",
    "SphereInBowl",
    "SphereInCylinder",
    "SpherePlane",
    "SphereSphere",
    "UnilateralContact",
    "Unknown",
    "free_orientation",
    "table",
    "unknowns",
]
