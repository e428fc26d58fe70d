"""Contacts by geometry, and those of points, spheres, discs and boxes on planes.

Each makes the joint, the `UnilateralContact` and the `CoulombFriction` of its points of contact
(`dalembert.scene.contacts.made`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import field
from itertools import product
from typing import Any, final

import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame
from sympy.physics.vector import Vector, dot

from ...frozen import frozen
from .places import (
    GeometryFault,
    Places,
    Touch,
    contact_point,
    frame_of,
    length,
    several,
    tangents_of_plane,
    unit_vector,
)


@frozen(eq=False, kw_only=True)
class GeometricContact(ABC):
    """The common part of contacts by geometry.

    Parameters
    ----------
    name : str
        Results call the contact so: ``"heel.gap"`` [m], ``"heel.normal"`` [N], ``"heel.friction_1"`` and
        ``"heel.friction_2"`` [N] along its tangents are outputs.
    restitution : Expr or number
        See `UnilateralContact`.
    friction : Expr, number, (mu_static, mu) or CoulombFriction
        0 (default) for none; a law of friction is given without its reactions: ``CoulombFriction(mu=0.3,
        regularization=1e-3)``.
    rolling_resistance : Expr, number, (static, rolling) or CoulombFriction
        Lever arm [m], 0 (default) for none: a moment up to it times the normal reaction resists rolling, about the
        tangents. ``"heel.rolling_1"`` and ``"heel.rolling_2"`` [N m] are outputs; ``"heel.rolling"`` is a law of its
        own, which slips or sticks.
    drilling_resistance : Expr, number, (static, spinning) or CoulombFriction
        Lever arm [m] of the moment about the normal, ``"heel.drilling_1"`` [N m], which resists spin.
    tangents : Vector or sequence of one or two Vectors, optional
        Unit vectors along which friction acts. By default one where the kinematics of the scene leave the contact point
        no velocity along the other, two where they do; ``model.explain()`` has them.
    """

    name: str = field(kw_only=False)
    restitution: Any = 0
    friction: Any = 0
    rolling_resistance: Any = 0
    drilling_resistance: Any = 0
    tangents: Any = None

    @property
    def label(self) -> str:
        """Name in results."""
        return self.name

    @abstractmethod
    def touches(self, places: Places) -> Sequence[Touch]:
        """Return the points of contact, in the coordinates of a scene."""


@frozen(eq=False, kw_only=True)
class _OnPlane(GeometricContact):
    body: Any
    plane: tuple[Point, Vector]
    other: Any = None

    def _plane(self, places: Places) -> tuple[Point, Vector, str | None]:
        """Return the point and the normal of the plane, and the body that carries it."""
        point, normal = several(self.plane, (2,), "plane=, a point and the normal there,")
        frame_of(unit_vector(normal, "the normal of plane="), "the normal of plane=")
        places.position(point, "the point of plane=")
        return point, normal, None if self.other is None else places.body(self.other)

    def _touch(self, places: Places, name: str, at: Point, gap: Any, what: str) -> Touch:
        point, normal, other = self._plane(places)
        whose = "" if other is None else f" of {other!r}"
        return Touch(
            name=name,
            body=places.body(self.body),
            other=other,
            at=at,
            normal=normal,
            gap=gap,
            distance=gap,
            surface=(point, frame_of(normal, "the normal of plane=")),
            tangents=tangents_of_plane(normal),
            text=f"{what} of {places.body(self.body)!r} on the plane{whose} at {point.name} with the normal {normal}",
        )

    def _height(self, places: Places, point: Any, what: str) -> Any:
        base, normal, _ = self._plane(places)
        return dot(places.position(point, what) - places.position(base, "the point of plane="), normal)


@final
@frozen(eq=False, kw_only=True)
class PointPlane(_OnPlane):
    """A point of a body on a plane; see `GeometricContact` for name, restitution, friction and tangents.

    Parameters
    ----------
    body : str or RigidBody or Particle
    point : Point
        Fixed in the body.
    plane : (Point, Vector)
        A point of the plane, and its normal towards the body, a unit vector on the frame in which the plane is fixed. A
        plane may move as a function of time (a belt, a table that is shaken); friction is that of the slip relative to
        it.
    other : str or RigidBody or Particle, optional
        The body that carries the plane, and has the opposite action.

    Examples
    --------
    The floor under a foot::

        scene.add_contacts(da.PointPlane("heel", body="foot", point=H, plane=(O, N.z), restitution=0.2, friction=0.6))
    """

    point: Point

    def touches(self, places: Places) -> Sequence[Touch]:
        """Return the point of contact."""
        gap = self._height(places, self.point, "point=")
        return [self._touch(places, self.name, self.point, gap, f"point {self.point.name}")]


@final
@frozen(eq=False, kw_only=True)
class SpherePlane(_OnPlane):
    """A sphere of a body, or a circle in a planar scene, on a plane; see `PointPlane`.

    Parameters
    ----------
    centre : Point
        Fixed in the body; where it is not the mass centre, the force of the plane has a moment.
    radius : Expr or number [m]

    Examples
    --------
    A ball on a table::

        scene.add_contacts(da.SpherePlane("cloth", body="ball", centre=G, radius=r, plane=(O, N.z), friction=mu))
    """

    centre: Point
    radius: Any

    def touches(self, places: Places) -> Sequence[Touch]:
        """Return the point of contact."""
        r, (_, normal, _) = length(self.radius, "radius="), self._plane(places)
        gap = self._height(places, self.centre, "centre=") - r
        return [
            self._touch(
                places, self.name, contact_point(self.centre, f"{self.name}.contact", -r * normal), gap, "sphere"
            )
        ]


@final
@frozen(eq=False, kw_only=True)
class DiscPlane(_OnPlane):
    """A thin disc of a body on a plane, which its lowest point touches; see `PointPlane`.

    Where it lies flat, no point is the lowest: a run that comes there ends with a status.

    Parameters
    ----------
    centre : Point
        Fixed in the body.
    radius : Expr or number [m]
    axis : Vector
        Unit vector along the axis of the disc.

    Examples
    --------
    A coin::

        scene.add_contacts(da.DiscPlane("edge", body="coin", centre=G, radius=r, axis=L.y, plane=(O, N.z), friction=mu))
    """

    centre: Point
    radius: Any
    axis: Vector

    def touches(self, places: Places) -> Sequence[Touch]:
        """Return the point of contact."""
        r, axis, (_, normal, _) = length(self.radius, "radius="), unit_vector(self.axis, "axis="), self._plane(places)
        tilt = dot(normal, axis)
        upright = places.vanishes(tilt)
        if places.vanishes(1 - tilt**2):
            raise GeometryFault(
                "axis= is always normal to plane=: the disc lies flat, and no point of it is the lowest"
            )
        steepness = sp.Integer(1) if upright else sp.sqrt(1 - tilt**2)
        down = -r * normal if upright else -r / steepness * (normal - tilt * axis)
        gap = self._height(places, self.centre, "centre=") - r * steepness
        return [self._touch(places, self.name, contact_point(self.centre, f"{self.name}.contact", down), gap, "disc")]


@final
@frozen(eq=False, kw_only=True)
class BoxPlane(_OnPlane):
    """A box of a body on a plane: contacts of its corners, ``"name.corner_1"`` and so on; see `PointPlane`.

    Its corners have friction, and no resistance to rolling or drilling.

    Parameters
    ----------
    frame : ReferenceFrame
        Its edges are along the axes of this frame, in which it is fixed.
    centre : Point
    half_sizes : sequence of two or three Expr or numbers [m]
        Along x, y and z of `frame`. Two make a rectangle with four corners. Of three, an axis along which nothing moves
        and about which the body turns alone is left out, so that a box in the plane has four corners, one in space
        eight.

    Examples
    --------
    A box that tumbles::

        scene.add_contacts(da.BoxPlane("box", body="box", frame=B, centre=G, half_sizes=(a, b), plane=(O, N.y)))
    """

    frame: ReferenceFrame
    centre: Point
    half_sizes: Any

    def touches(self, places: Places) -> Sequence[Touch]:
        """Return a point of contact for each corner."""
        if any(each is not None and each != 0 for each in (self.rolling_resistance, self.drilling_resistance)):
            raise GeometryFault(
                "a box has no resistance to rolling or drilling: its corners are contacts, whose friction holds it"
            )
        sizes = [length(x, "each of half_sizes=") for x in several(self.half_sizes, (2, 3), "half_sizes=")]
        if not isinstance(self.frame, ReferenceFrame):
            raise GeometryFault(f"frame= must be a ReferenceFrame, and is {self.frame!r}")
        edges = [x * axis for x, axis in zip(sizes, self.frame, strict=False)]
        if len(edges) == 3:
            edges = [edge for edge in edges if not self._across(places, edge)]
        found = []
        for number, signs in enumerate(product((-1, 1), repeat=len(edges)), 1):
            offset = sum((sign * edge for sign, edge in zip(signs, edges, strict=True)), Vector(0))
            name = f"{self.name}.corner_{number}"
            corner = contact_point(self.centre, name, offset)
            found.append(self._touch(places, name, corner, self._height(places, corner, "centre="), f"corner {number}"))
        return found

    def _across(self, places: Places, edge: Vector) -> bool:
        """Return whether an edge is across the plane of a planar motion: its ends move alike, and not along it."""
        point, normal, other = self._plane(places)
        surface = point, frame_of(normal, "the normal of plane=")
        centre = places.position(self.centre, "centre=")
        body = places.body(self.body)
        ends = [places.relative(body, other, surface, centre + sign * edge)[0] for sign in (-1, 1)]
        still = places.vanishes(dot(ends[0], edge)) and places.vanishes(dot(normal, edge))
        return still and places.is_zero(ends[1] - ends[0])
