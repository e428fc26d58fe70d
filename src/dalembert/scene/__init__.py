"""What the user writes, and how it is read onto the expression graph."""

from .orientation import free_orientation
from .scene import Joint, Scene, Unknown, unknowns

__all__ = ["Joint", "Scene", "Unknown", "free_orientation", "unknowns"]
