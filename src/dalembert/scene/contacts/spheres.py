"""Contacts of spheres by geometry: with each other, and inside hollow spheres and cylinders."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import sympy as sp
from sympy.physics.mechanics import Point
from sympy.physics.vector import Vector, dot

from ...frozen import frozen
from .geometry import GeometricContact
from .places import (
    GeometryFault,
    Places,
    Touch,
    contact_point,
    frame_of,
    length,
    several,
    tangents_of_cylinder,
    tangents_of_sphere,
    unit_vector,
)


@final
@frozen(eq=False, kw_only=True)
class SphereSphere(GeometricContact):
    """Two spheres, or circles in a planar scene; see `GeometricContact` for name, restitution, friction and tangents.

    Parameters
    ----------
    bodies : (str or body, str or body or None)
        The normal reaction pushes the first away from the second; None is a sphere at rest, or one that moves as a
        function of time.
    centres : (Point, Point)
        Each fixed in its body.
    radii : (Expr or number, Expr or number) [m]
        One of them may be 0: a point, such as the edge of a step that a wheel meets in a planar scene.

    Examples
    --------
    Two balls of billiards::

        scene.add_contacts(da.SphereSphere("balls", bodies=("a", "b"), centres=(A, C), radii=(r, r), restitution=0.95))
    """

    bodies: tuple[Any, Any]
    centres: tuple[Point, Point]
    radii: tuple[Any, Any]

    def touches(self, places: Places) -> Sequence[Touch]:
        """Return the point of contact."""
        first, second = several(self.bodies, (2,), "bodies=")
        one, two = several(self.centres, (2,), "centres=")
        r, s = (length(x, "each of radii=", zero=True) for x in several(self.radii, (2,), "radii="))
        length(r + s, "the sum of radii=")
        apart = places.position(one, "each of centres=") - places.position(two, "each of centres=")
        square, normal = dot(apart, apart), apart / (r + s)
        distance = sp.sqrt(square)
        body, other = places.body(first), None if second is None else places.body(second)
        return [
            Touch(
                name=self.name,
                body=body,
                other=other,
                at=contact_point(one, f"{self.name}.contact", -r * normal),
                normal=normal,
                gap=(square - (r + s) ** 2) / (2 * (r + s)),
                distance=distance - r - s,
                surface=(two, places.frame),
                tangents=tangents_of_sphere(places.frame, normal, apart / distance),
                text=f"sphere of {body!r} on sphere{'' if other is None else f' of {other!r}'} at {two.name}",
            )
        ]


@frozen(eq=False, kw_only=True)
class _InHollow(GeometricContact):
    body: Any
    centre: Point
    radius: Any
    other: Any = None

    def _inside(self, places: Places, name: str, base: Point, inner: Any, along: Vector | None) -> Touch:
        """Return the contact inside a sphere about a point, or inside a cylinder whose axis is given."""
        r, hollow = length(self.radius, "radius="), length(inner, f"the radius of {name}=")
        if (hollow - r).is_nonpositive:
            raise GeometryFault(f"radius= {r} must be smaller than that of {name}=, {hollow}")
        body, other = places.body(self.body), None if self.other is None else places.body(self.other)
        apart = places.position(base, f"the point of {name}=") - places.position(self.centre, "centre=")
        if along is not None:
            apart = apart - dot(apart, along) * along
        square, free = dot(apart, apart), hollow - r
        normal = apart / free
        if along is None:
            frame, tangents = places.frame, tangents_of_sphere(places.frame, normal, normal)
        else:
            frame, tangents = frame_of(along, f"the axis of {name}="), tangents_of_cylinder(along, normal)
        whose = "" if other is None else f" of {other!r}"
        return Touch(
            name=self.name,
            body=body,
            other=other,
            at=contact_point(self.centre, f"{self.name}.contact", -r * normal),
            normal=normal,
            gap=(free**2 - square) / (2 * free),
            distance=free - sp.sqrt(square),
            surface=(base, frame),
            tangents=tangents,
            text=f"sphere of {body!r} in the {name}{whose} at {base.name}",
        )


@final
@frozen(eq=False, kw_only=True)
class SphereInBowl(_InHollow):
    """A sphere of a body inside a hollow sphere; see `GeometricContact` and, for `other`, `PointPlane`.

    Parameters
    ----------
    body : str or RigidBody or Particle
    centre : Point
    radius : Expr or number [m]
    bowl : (Point, Expr or number)
        Centre and inner radius [m], larger than `radius`.

    Examples
    --------
    ::

        scene.add_contacts(da.SphereInBowl("bowl", body="ball", centre=G, radius=r, bowl=(O, R), friction=mu))
    """

    bowl: tuple[Point, Any]

    def touches(self, places: Places) -> Sequence[Touch]:
        """Return the point of contact."""
        base, inner = several(self.bowl, (2,), "bowl=, its centre and radius,")
        return [self._inside(places, "bowl", base, inner, None)]


@final
@frozen(eq=False, kw_only=True)
class SphereInCylinder(_InHollow):
    """A sphere of a body inside a hollow cylinder without ends; see `GeometricContact` and `PointPlane`.

    Parameters
    ----------
    body : str or RigidBody or Particle
    centre : Point
    radius : Expr or number [m]
    cylinder : (Point, Vector, Expr or number)
        A point of the axis, the axis as a unit vector, and the inner radius [m], larger than `radius`.

    Examples
    --------
    A ball in a pipe along N.x::

        scene.add_contacts(da.SphereInCylinder("pipe", body="ball", centre=G, radius=r, cylinder=(O, N.x, R)))
    """

    cylinder: tuple[Point, Vector, Any]

    def touches(self, places: Places) -> Sequence[Touch]:
        """Return the point of contact."""
        base, axis, inner = several(self.cylinder, (3,), "cylinder=, a point of its axis, the axis and its radius,")
        return [self._inside(places, "cylinder", base, inner, unit_vector(axis, "the axis of cylinder="))]
