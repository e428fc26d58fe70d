"""Discs and spheres that roll on a plane: contact points, constraints and reactions."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Particle, Point
from sympy.physics.vector import Vector

from ...frozen import frozen
from ..expressions.identity import equal, vanishes
from ..frames import Tree
from .parts import add_constraints, add_velocity_constraints, body_of, constant_in, counted, fixed_on, frame_of, require
from .reactions import ActionPair, Connection, has_body, orthogonal, require_new_name, unknown

if TYPE_CHECKING:
    from ..scene import Scene


@final
@frozen
class RollingDisc:
    """A thin disc, or a wheel, that rolls on a plane without slip.

    The velocities of its contact point along and across its heading vanish: constraints on rates. A height of its
    centre that the coordinates do not fix is a constraint on positions. "wheel.normal", "wheel.friction_1" (along the
    heading, axis x normal) and "wheel.friction_2" (across) are its reaction [N] on the body, "wheel.slip_1" and
    "wheel.slip_2" the velocities that vanish [m/s]. The disc must not lie flat.

    Parameters
    ----------
    name : str
    body : str or RigidBody
        That rolls.
    centre : Point
        Of the disc, fixed on the body.
    radius : expression of parameters, or number
        [m]
    axis : Vector
        Of the disc, fixed in the body; a unit vector.
    plane : (Point, Vector)
        A point of the plane, and its unit normal on the side of the disc. A normal on a frame that turns about it as a
        function of time makes the plane a turntable.
    other : str or RigidBody, optional
        The body that the plane is fixed on; by default the fixed frame.

    Examples
    --------
    A wheel on a floor::

        x, phi = dynamicsymbols("x phi")
        W = N.orientnew("W", "Axis", (phi, N.z))
        C = O.locatenew("C", x * N.x + l * N.y)
        track = da.Scene("track", frame=N, origin=O, coordinates=[x, phi])
        track.add_bodies(RigidBody("wheel", C, W, m, (inertia(W, 0, 0, m * l**2), C)))
        track.add_joints(da.RollingDisc("floor", "wheel", centre=C, radius=l, axis=W.z, plane=(O, N.y)))
    """

    name: str
    body: Any
    centre: Point
    radius: Any
    axis: Vector
    plane: tuple[Point, Vector]
    other: Any = None

    @cached_property
    def sine(self) -> Any:
        """Sine of the angle between axis and normal; from the height of the centre, where that is in the coordinates.

        The square root of its square would not say which side of the disc is up.
        """
        square = 1 - self.plane[1].dot(self.axis) ** 2
        height = self.centre.pos_from(self.plane[0]).dot(self.plane[1])
        if vanishes(height**2 - self.radius**2 * square):
            return height / self.radius
        return sp.sqrt(square)

    @cached_property
    def arm(self) -> Vector:
        """Vector from the centre to the contact point."""
        normal, axis = self.plane[1], self.axis
        return -self.radius / self.sine * (normal - normal.dot(axis) * axis)

    @cached_property
    def contact_point(self) -> Point:
        """Point of contact, which travels over the body."""
        return self.centre.locatenew(f"{self.name}_contact", self.arm)

    @cached_property
    def tangents(self) -> tuple[Vector, Vector]:
        """Unit vectors along and across the heading."""
        normal, axis = self.plane[1], self.axis
        heading = axis.cross(normal) / self.sine
        return heading, normal.cross(heading)

    @cached_property
    def height(self) -> Any:
        """Height of the lowest point over the plane."""
        return self.centre.pos_from(self.plane[0]).dot(self.plane[1]) - self.radius * self.sine


@final
@frozen
class RollingSphere:
    """A sphere that rolls on a plane without slip; it may spin about the normal.

    As `RollingDisc`; its two directions are fixed in the plane.

    Parameters
    ----------
    name : str
    body : str or RigidBody
    centre : Point
    radius : expression of parameters, or number
        [m]
    plane : (Point, Vector)
        A point of the plane, and its unit normal on the side of the sphere; see `RollingDisc` for turntables.
    other : str or RigidBody, optional
        The body that the plane is fixed on; by default the fixed frame.

    Examples
    --------
    A ball on a floor::

        x, phi = dynamicsymbols("x phi")
        W = N.orientnew("W", "Axis", (phi, N.z))
        C = O.locatenew("C", x * N.x + l * N.y)
        track = da.Scene("track", frame=N, origin=O, coordinates=[x, phi])
        track.add_bodies(RigidBody("ball", C, W, m, (inertia(W, 0, 0, m * l**2 * 2 / 5), C)))
        track.add_joints(da.RollingSphere("floor", "ball", centre=C, radius=l, plane=(O, N.y)))
    """

    name: str
    body: Any
    centre: Point
    radius: Any
    plane: tuple[Point, Vector]
    other: Any = None

    @cached_property
    def arm(self) -> Vector:
        """Vector from the centre to the contact point."""
        return -self.radius * self.plane[1]

    @cached_property
    def contact_point(self) -> Point:
        """Point of contact, which travels over the body."""
        return self.centre.locatenew(f"{self.name}_contact", self.arm)

    @cached_property
    def tangents(self) -> tuple[Vector, Vector]:
        """Unit vectors in the plane."""
        frame = self.plane[1].args[0][1]
        first, second = orthogonal(self.plane[1].to_matrix(frame))
        return Vector([(first, frame)]), Vector([(second, frame)])

    @cached_property
    def height(self) -> Any:
        """Height of the lowest point over the plane."""
        return self.centre.pos_from(self.plane[0]).dot(self.plane[1]) - self.radius


Rolling = RollingDisc | RollingSphere


def slip_of(scene: Scene, rolling: Rolling) -> tuple[Any, Any]:
    """Return the velocity of the contact point of the body relative to the plane, along the tangents [m/s]."""
    body, other = (body_of(scene, each, lambda _: None) for each in (rolling.body, rolling.other))
    velocity = _velocity(scene, body, rolling.centre, rolling.arm)
    if other is None:
        velocity = velocity - _spin_of_plane(scene, rolling).cross(rolling.contact_point.pos_from(rolling.plane[0]))
    else:
        velocity = velocity - _velocity(scene, other, rolling.contact_point, 0)
    first, second = (velocity.dot(tangent) for tangent in rolling.tangents)
    return first, second


def _spin_of_plane(scene: Scene, rolling: Rolling) -> Any:
    """Return the angular velocity of a plane that no body carries.

    It is that of the frame of its normal where that is a function of time. A frame that turns with coordinates, such as
    the heading of a wheel, is not the plane's.
    """
    (_, frame), *more = rolling.plane[1].args
    spin = Vector(0) if more else frame.ang_vel_in(scene.frame)
    coordinates = {*scene.coordinates}
    turns = any(matrix.atoms(AppliedUndef) & coordinates for matrix, _ in spin.args)
    return Vector(0) if turns else spin


def _velocity(scene: Scene, body: Any, point: Point, arm: Any) -> Any:
    """Return the velocity of a body's point at `arm` from a point: by the body's velocity field from its centre."""
    centre: Any = body.masscenter
    way = point.pos_from(centre) + arm
    return centre.pos_from(scene.origin).dt(scene.frame) + body.frame.ang_vel_in(scene.frame).cross(way)


def add_rolling(scene: Scene, rolling: Rolling) -> None:
    """Add the constraints and the reaction of a body that rolls.

    Raises
    ------
    SceneError
        With every fault of it.
    """
    name = rolling.name
    require_new_name(scene, name)
    faults: list[str] = []
    body, other = (body_of(scene, each, faults.append) for each in (rolling.body, rolling.other))
    require(scene, name, faults or _faults(scene, rolling, body, other))
    slip = slip_of(scene, rolling)
    slips = [component for component in slip if not vanishes(component)]
    heights = [] if vanishes(rolling.height) else [rolling.height]
    if not slips:
        require(scene, name, ["its contact point has no velocity, so that there is nothing to hold; leave it out"])
    add_constraints(scene, name, heights)
    add_velocity_constraints(scene, name, slips)
    normal, *friction = (unknown(f"{name}.{part}") for part in ("normal", "friction_1", "friction_2"))
    force = normal * rolling.plane[1]
    for component, tangent in zip(friction, rolling.tangents, strict=True):
        force = force + component * tangent
    components = {str(x): x for x in (normal, *friction)}
    others = {f"{name}.slip_{i}": component for i, component in enumerate(slip, 1)}
    pair = ActionPair(body, other, rolling.contact_point, force)
    text = (
        f"{str(body.name)!r} rolls on {'the fixed frame' if other is None else repr(str(other.name))}:"
        f" {counted(len(slips), 'constraint')} on velocities"
        + (", 1 on its height" if heights else ", its height is in the coordinates")
    )
    scene.connections += (Connection(name, (pair,), components, force, Vector(0), True, rolling, text, others),)


def _faults(scene: Scene, rolling: Rolling, body: Any, other: Any) -> list[str]:
    """Return the faults of the arguments of a body that rolls."""
    faults = []
    if body is None or isinstance(body, Particle) or not has_body(scene, body):
        return ["its body must be a RigidBody of the scene, which can turn"]
    if isinstance(other, Particle):
        return ["its plane cannot be that of a particle, which has no orientation"]
    plane: Any = rolling.plane
    if not (isinstance(plane, tuple | list) and len(plane) == 2):
        return [f"plane must be a point and a normal, such as (O, N.z), not {plane!r}"]
    for what, value, kind in (
        ("centre", rolling.centre, Point),
        ("the point of plane", plane[0], Point),
        ("the normal of plane", plane[1], Vector),
        ("axis", getattr(rolling, "axis", plane[1]), Vector),
    ):
        if not isinstance(value, kind) or value == 0:
            faults.append(f"{what} must be a {kind.__name__}, not {value!r}")
    if not isinstance(rolling.radius, int | float | sp.Expr) or sp.sympify(rolling.radius).is_positive is False:
        faults.append(f"radius must be a positive length, not {rolling.radius!r}")
    if faults:
        return faults
    points = Tree(scene.origin, "_pos_dict")
    for point, carrier in ((rolling.centre, body), (plane[0], other)):
        named = "the fixed frame" if carrier is None else repr(str(carrier.name))
        if points.path(point) is None:
            faults.append(f"the point {point.name!r} is not located from {scene.origin.name!r}")
        elif not fixed_on(scene, carrier, point):
            faults.append(f"the point {point.name!r} is not fixed on {named}; locate it from a point of {named}")
    named = "the fixed frame" if other is None else repr(str(other.name))
    for what, vector, frame, where in (
        ("normal", plane[1], frame_of(scene, other), named),
        *((("axis", rolling.axis, body.frame, repr(str(body.name))),) if isinstance(rolling, RollingDisc) else ()),
    ):
        if not constant_in(frame, vector):
            faults.append(f"the {what} {vector} is not fixed in {where}")
        elif not equal(vector.dot(vector), 1):
            faults.append(f"the {what} {vector} is not a unit vector")
    return faults
