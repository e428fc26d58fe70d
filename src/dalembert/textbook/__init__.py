"""The symbolic view of a scene: what section 13.4 of the text derives by hand."""

from .energy import lagrange_operator
from .screw import Screw
from .view import LagrangeView, lagrange

__all__ = ["LagrangeView", "Screw", "lagrange", "lagrange_operator"]
