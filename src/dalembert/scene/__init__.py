"""Scenes as users write them, and their reading onto the expression graph."""

from .closures import Closure
from .contacts import CoulombFriction, UnilateralContact
from .controllers import Controller
from .joints import Joint, Unknown, unknowns
from .orientation import free_orientation
from .scene import Scene
from .tables import table

__all__ = [
    "Closure",
    "Controller",
    "CoulombFriction",
    "Joint",
    "Scene",
    "UnilateralContact",
    "Unknown",
    "free_orientation",
    "table",
    "unknowns",
]
