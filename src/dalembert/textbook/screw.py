"""Screws: kinematic, partial kinematic and action screws alike."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

import sympy as sp
from sympy.physics.mechanics import Point
from sympy.physics.vector import Vector

from .geometry import Geometry

__all__ = ["Screw"]


@final
@dataclass(frozen=True)
class Screw:
    """A screw, given by its resultant and its moment at one point.

    Attributes
    ----------
    resultant : Vector
        Angular velocity of a kinematic screw [rad/s], force of an action screw [N].
    moment : Vector
        Velocity of the body at `point` [m/s], or moment of the action about `point` [N m].
    point : Point
        Reduction point.
    geometry : Geometry
        The scene's positions and orientations, for transport.
    """

    resultant: Vector
    moment: Vector
    point: Point
    geometry: Geometry = field(repr=False, compare=False)

    def at(self, point: Point) -> Screw:
        """Return the same screw reduced at another point: M_B = M_A + BA x R."""
        if point is self.point:
            return self
        arm = self.geometry.position(self.point, point)
        return Screw(self.resultant, self.moment + self.geometry.cross(arm, self.resultant), point, self.geometry)

    def product(self, other: Screw) -> sp.Expr:
        """Return the screw product R1 . M2 + M1 . R2, which does not depend on the reduction point."""
        other = other.at(self.point)
        dot = self.geometry.dot
        return dot(self.resultant, other.moment) + dot(self.moment, other.resultant)

    def __add__(self, other: Screw) -> Screw:
        other = other.at(self.point)
        return Screw(self.resultant + other.resultant, self.moment + other.moment, self.point, self.geometry)

    def __str__(self) -> str:
        from .printing import text

        return f"{{ {text(self.resultant)} ; {text(self.moment)} }} at {self.point.name}"

    def _latex(self, _printer: object = None) -> str:
        from .printing import latex

        rows = f"{latex(self.resultant)} \\\\ {latex(self.moment)}"
        return f"\\begin{{Bmatrix}} {rows} \\end{{Bmatrix}}_{{{self.point.name}}}"

    def _repr_latex_(self) -> str:
        return f"$\\displaystyle {self._latex()}$"
