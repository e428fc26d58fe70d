"""Joints with unknown reactions, and components of positions as outputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from sympy.physics.mechanics import Point
from sympy.physics.vector import Vector

__all__ = ["Joint", "Place"]


@final
@dataclass(frozen=True)
class Joint:
    """A contact of a body with the fixed frame, or with another body: an action screw with unknown components.

    The power of the screw is taken with the body's own velocity field at `at`
    (v_G + omega x (at - G)), so the point may travel over the body. A particle has the velocity of its point, takes no
    torque, and a joint acts on it at that point. With `other`, the opposite screw acts on that body
    at the same point, with the velocity field of that body there.

    Parameters
    ----------
    name : str
        Name of the joint, for messages.
    body : str
        Name of the body that the action is exerted on.
    at : Point
        Reduction point of the screw.
    force, torque : Vector
        Resultant [N] and moment about `at` [N m] of the action on `body`; their unknowns are made by `unknowns`.
    other : str, optional
        Name of the body that exerts the action, and has the opposite one; without it, that is the fixed frame.

    Examples
    --------
    A pin at P that holds rod b to rod a, of which R_x and R_y are the force on b::

        da.Joint("pin", body="b", other="a", at=P, force=R_x*N.x + R_y*N.y)
    """

    name: str
    body: str
    at: Point
    force: Vector | int = 0
    torque: Vector | int = 0
    other: str | None = None


@final
@dataclass(frozen=True)
class Place:
    """A component of the position of a point from the origin of a scene, on its frame: an output."""

    point: Point
    axis: int

    def __str__(self) -> str:
        return f"{self.point.name}_{'xyz'[self.axis]}"
