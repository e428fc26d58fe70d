"""What the user writes, and how it is read onto the expression graph."""

from .scene import Joint, Scene, Unknown, unknowns

__all__ = ["Joint", "Scene", "Unknown", "unknowns"]
