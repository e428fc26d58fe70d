"""Symbolic view of a scene: the derivations of section 13.4 of the text."""

from .actions import Screw
from .energy import lagrange_operator
from .view import LagrangeView, lagrange

__all__ = ["LagrangeView", "Screw", "lagrange", "lagrange_operator"]
