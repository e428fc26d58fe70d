"""Points of contact of bodies: positions, velocities of bodies and surfaces there, and directions of slip."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame
from sympy.physics.vector import Vector, cross, dot, dynamicsymbols

from ...errors import list_names
from ...frozen import frozen
from ..expressions.identity import equal, vanishes
from ..frames import Tree
from ..release_impose import released_position, with_imposed

if TYPE_CHECKING:
    from ..scene import Scene

Moves = Callable[[Vector], bool]
"""Whether a body has, at a contact point, a velocity relative to the other side along a vector."""


class GeometryFault(Exception):
    """A fault of a contact by geometry; the name of the contact stands before the text."""


@final
@frozen(eq=False)
class Touch:
    """One point of contact.

    Attributes
    ----------
    name, body : str
    other : str or None
        The body with the opposite action.
    at : Point
    normal : Vector
        Towards `body`, of length one while the contact is closed.
    gap, distance : Expr
        What the contact constrains, and what results call its gap [m].
    surface : (Point, ReferenceFrame)
        A point of the other side, and a frame in which that is fixed.
    tangents : callable
        Returns the directions in which the contact can slip.
    text : str
        What touches what.
    """

    name: str
    body: str
    other: str | None
    at: Point
    normal: Vector
    gap: Any
    distance: Any
    surface: tuple[Point, ReferenceFrame]
    tangents: Callable[[Moves], tuple[Vector, ...]]
    text: str


@final
class Places:
    """Positions and velocities in a scene, in its coordinates and their rates."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.frame = scene, scene.frame
        self.bodies = {str(getattr(body, "name", body)): body for body in scene.bodies}
        self._points = Tree(scene.origin, "_pos_dict")
        turned = [item.target.name for item in scene.releases if isinstance(item.target, ReferenceFrame)]
        if turned:
            raise GeometryFault(
                f"its geometry is not known where the rotation of {list_names(turned)} is released: write it as a"
                " UnilateralContact and a Joint there"
            )

    def position(self, point: Any, what: str) -> Vector:
        """Return the position of a point from the origin."""
        if not isinstance(point, Point):
            raise GeometryFault(f"{what} must be a Point, and is {point!r}")
        if point not in self._points.parent:
            self._points = Tree(self.scene.origin, "_pos_dict")
        path = self._points.path(point)
        if path is None:
            raise GeometryFault(f"{what}, {point.name!r}, is not located from {self.scene.origin.name!r}")
        steps = [released_position(self.scene, node, node._pos_dict[self._points.parent[node]]) for node in path]
        return sum(steps, Vector(0))

    def body(self, given: Any) -> str:
        """Return the name of a body of the scene, which is given by its name or itself."""
        name = given if isinstance(given, str) else str(getattr(given, "name", given))
        if name not in self.bodies:
            raise GeometryFault(f"{name!r} is no body of the scene; known: {list_names(self.bodies)}")
        return name

    def velocity(self, body: str, place: Vector) -> Vector:
        """Return the velocity that a body has at a place."""
        item = self.bodies[body]
        centre = item.point if isinstance(item, Particle) else item.masscenter
        start = self.position(centre, f"the mass centre of {body!r}")
        if isinstance(item, Particle):
            return start.dt(self.frame)
        return start.dt(self.frame) + cross(item.frame.ang_vel_in(self.frame), place - start)

    def of_surface(self, surface: tuple[Point, ReferenceFrame], place: Vector) -> Vector:
        """Return the velocity at a place of a surface that no body carries: a function of time, mostly zero."""
        point, frame = surface
        start = self.position(point, "the point of the surface")
        velocity = start.dt(self.frame) + cross(frame.ang_vel_in(self.frame), place - start)
        moving = [q for q in self.scene.coordinates if _has(velocity, q.diff(dynamicsymbols._t))]
        if moving:
            raise GeometryFault(
                f"what it touches moves with {list_names(str(q.func.__name__) for q in moving)}: name the body that"
                " carries it, other=..., which then has the opposite action"
            )
        return velocity

    def relative(
        self, body: str, other: str | None, surface: tuple[Point, ReferenceFrame], place: Vector
    ) -> tuple[Vector, bool]:
        """Return the velocity of a body at a place relative to the other side, and whether that moves with time."""
        own = self.velocity(body, place)
        if other is not None:
            return own - self.velocity(other, place), False
        theirs = self.of_surface(surface, place)
        return own - theirs, not self.is_zero(theirs)

    def spin(self, touch: Touch) -> tuple[Vector, bool]:
        """Return the angular velocity of a body relative to the other side, and whether that turns with time."""
        frames = [touch.surface[1]]
        for name in (touch.body, *([] if touch.other is None else [touch.other])):
            item = self.bodies[name]
            if isinstance(item, Particle):
                raise GeometryFault(f"{name!r} is a Particle, which neither rolls nor spins: no resistance acts on it")
            frames.append(item.frame)
        own, theirs = frames[1].ang_vel_in(self.frame), frames[0 if touch.other is None else 2].ang_vel_in(self.frame)
        return own - theirs, touch.other is None and not self.is_zero(theirs)

    def is_zero(self, vector: Vector) -> bool:
        """Return whether a vector vanishes for all positions, rates and times."""
        return all(self.vanishes(x) for matrix, _ in vector.args for x in matrix)

    def vanishes(self, expression: Any) -> bool:
        """Return whether an expression vanishes for all positions, rates and times."""
        return vanishes(with_imposed(expression, self.scene.imposed))


def _has(vector: Vector, expression: Any) -> bool:
    return any(matrix.has(expression) for matrix, _ in vector.args)


def contact_point(centre: Point, name: str, offset: Vector) -> Point:
    """Return the contact point of a contact, located from the centre of what touches: the same one each time."""
    found = next((point for point in centre._pos_dict if point.name == name), None) or Point(name)
    found.set_pos(centre, offset)
    return found


# Arguments.


def unit_vector(vector: Any, what: str) -> Vector:
    """Return a vector of length one."""
    if not isinstance(vector, Vector):
        raise GeometryFault(f"{what} must be a unit vector such as N.z, and is {vector!r}")
    try:
        unit = equal(dot(vector, vector), 1)
    except ValueError as unknown:
        raise GeometryFault(f"{what}: {unknown}") from None
    if not unit:
        raise GeometryFault(f"{what} must be a unit vector; the length of {vector} is not 1")
    return vector


def frame_of(vector: Vector, what: str) -> ReferenceFrame:
    """Return the frame that a vector is written on, and fixed in."""
    frames = [frame for _, frame in vector.args]
    if len(frames) != 1 or vector.args[0][0].has(dynamicsymbols._t):
        raise GeometryFault(
            f"{what}, {vector}, must be constant on one frame, that of what it is fixed in: orient a frame with it"
        )
    return frames[0]


def several(value: Any, numbers: Sequence[int], what: str) -> tuple[Any, ...]:
    """Return a sequence that has one of some lengths as a tuple."""
    found = tuple(value) if isinstance(value, tuple | list) else ()
    if len(found) not in numbers:
        raise GeometryFault(f"{what} must be {' or '.join(map(str, numbers))} values in a tuple, not {value!r}")
    return found


def length(value: Any, what: str, *, zero: bool = False) -> Any:
    """Return a length in parameters, which is positive where that is known; or zero, where that is allowed."""
    try:
        e = None if isinstance(value, str | bytes | bool) else sp.sympify(value)
    except (sp.SympifyError, TypeError, ValueError, AttributeError):
        e = None
    if not isinstance(e, sp.Expr) or e.has(dynamicsymbols._t):
        raise GeometryFault(f"{what} must be a number or an expression of parameters, and is {value!r}")
    if e.is_nonpositive and not (zero and e.is_zero):
        raise GeometryFault(f"{what} is {value}; it must be positive")
    return e


_ROTATED = ((2, 3, 6), (3, -6, 2), (6, 2, -3))
"""Seven times three perpendicular unit vectors, along no symmetry of a scene."""


def tangents_of_plane(normal: Vector) -> Callable[[Moves], tuple[Vector, ...]]:
    """Return the tangents of a plane that slip is possible along, axes of its frame where these are tangents."""
    return lambda moves: tuple(t for t in _along_plane(normal) if moves(t))


def _along_plane(normal: Vector) -> tuple[Vector, Vector]:
    frame, n = frame_of(normal, "the normal"), [sp.sympify(x) for x in normal.args[0][0]]
    axes = (frame.x, frame.y, frame.z)
    flat = [i for i in range(3) if n[i] == 0]
    if len(flat) == 2:
        return axes[flat[0]], axes[flat[1]]
    if len(flat) == 1:
        return cross(normal, axes[flat[0]]), axes[flat[0]]
    if not all(x.is_number for x in n):
        raise GeometryFault(
            f"the tangents of its plane with the normal {normal} may be chosen in many ways: give tangents=(t_1, t_2)"
        )
    axis = axes[min(range(3), key=lambda i: abs(n[i]))]
    first = (axis - dot(axis, normal) * normal).normalize()
    return first, cross(normal, first)


def tangents_of_sphere(frame: ReferenceFrame, normal: Vector, unit: Vector) -> Callable[[Moves], tuple[Vector, ...]]:
    """Return the tangents of a sphere: one where all happens in a plane of axes of the frame, two in space.

    Two come from a rotation that turns a fixed vector to the normal, and are singular where that is the opposite of it.
    The fixed vector is along no symmetry of a scene, so that motions do not meet its opposite. `unit` is the normal at
    length one.
    """

    def tangents(moves: Moves) -> tuple[Vector, ...]:
        for axis in (frame.z, frame.y, frame.x):
            if vanishes(dot(normal, axis)) and not moves(axis):
                return (cross(axis, normal),)
        start, *others = ((x * frame.x + y * frame.y + z * frame.z) / sp.Integer(7) for x, y, z in _ROTATED)
        return tuple(b - dot(unit, b) / (1 + dot(unit, start)) * (unit + start) for b in others)

    return tangents


def tangents_of_cylinder(axis: Vector, normal: Vector) -> Callable[[Moves], tuple[Vector, ...]]:
    """Return the tangents along a cylinder and around it."""
    return lambda moves: tuple(t for t in (cross(axis, normal), axis) if moves(t))


def chosen_tangents(given: Any, normal: Vector) -> tuple[Vector, ...]:
    """Return the tangents that a user gave: unit vectors, perpendicular to the normal and to each other."""
    listed = (given,) if isinstance(given, Vector) else several(given, (1, 2), "tangents=")
    found = tuple(unit_vector(t, "each of tangents=") for t in listed)
    pairs = [(t, normal, "the normal") for t in found] + ([(*found, "the other")] if len(found) == 2 else [])
    for first, second, what in pairs:
        if not vanishes(dot(first, second)):
            raise GeometryFault(f"tangents= must be perpendicular: {first} is not perpendicular to {what}")
    return found


def rolling_axes(places: Places, touch: Touch, given: Any, spin: Vector) -> tuple[Vector, ...]:
    """Return the tangents about which a body rolls: one where all turns about one axis of the scene, two in space.

    `given` are the directions of slip that a user chose, None otherwise. `spin` is the relative angular velocity.
    """

    def turns(vector: Vector) -> bool:
        return not places.vanishes(dot(spin, vector))

    if given is not None:
        chosen = chosen_tangents(given, touch.normal)
        found = chosen if len(chosen) == 2 else (cross(touch.normal, chosen[0]),)
    else:
        axes = [axis for axis in places.frame if turns(axis)]
        flat = len(axes) == 1 and vanishes(dot(touch.normal, axes[0]))
        found = (axes[0],) if flat else touch.tangents(lambda vector: True)
    found = tuple(axis for axis in found if turns(axis))
    if not found:
        raise GeometryFault("it turns about no tangent, so that it cannot roll: leave rolling_resistance= out")
    require_independent(places, spin, found, "turn about one axis in its plane")
    return found


def require_independent(
    places: Places, velocity: Vector, tangents: tuple[Vector, ...], does: str = "slip along one direction in its plane"
) -> None:
    """Raise where the components of a velocity along two tangents are multiples of each other: it has one direction.

    Then those at two sets of rates are parallel, whatever the rates are.
    """
    if len(tangents) < 2:
        return
    rates = {q.diff(dynamicsymbols._t): sp.Dummy(real=True) for q in places.scene.coordinates}
    first, second = (dot(velocity, t) for t in tangents)
    if places.vanishes(first * second.xreplace(rates) - second * first.xreplace(rates)):
        raise GeometryFault(
            f"it can {does}, which is none of its tangents: give the direction of slip as tangents=(t,)"
        )
