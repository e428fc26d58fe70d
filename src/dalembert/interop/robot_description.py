"""Descriptions of robots, as files have them: a tree of links and joints in numbers, whose fixed joints are merged.

Places and rotations are those of the file, rounded where they are multiplied. What differs from 0, 1 or -1 in a
rotation by rounding alone is that number, so that the equations do not carry it on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen

if TYPE_CHECKING:
    from .robot_visuals import Visual

ROUNDING = 1e-15
"""Size, relative to what numbers are added from, that counts as zero in places, rotations and inertias."""

_INDEFINITE = 1e-6
"""Share of the largest principal moment below which a negative one is rounding of a file; squared, also of the mass."""


# Rigid places.


@final
@frozen(eq=False)
class Placement:
    """A place of axes: their rotation (3, 3), to components on the carrier, and their origin (3,) there."""

    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    position: FloatArray = field(default_factory=lambda: np.zeros(3))

    def then(self, other: Placement) -> Placement:
        """Return a place on these axes as one on their carrier."""
        turned = self.rotation @ other.position
        size = float(np.max(np.abs(self.position) + np.abs(self.rotation) @ np.abs(other.position)))
        return Placement(clean_rotation(self.rotation @ other.rotation), cleaned(self.position + turned, size))


def cleaned(values: FloatArray, size: float) -> FloatArray:
    """Return values without those that are rounding beside numbers of some size."""
    return np.where(np.abs(values) <= ROUNDING * size, 0.0, values)


def clean_rotation(matrix: FloatArray) -> FloatArray:
    """Return a rotation matrix whose entries are exactly 0, 1 or -1 where they are so up to rounding."""
    whole = np.round(matrix)
    return np.where(np.abs(matrix - whole) <= ROUNDING, whole, matrix)


def from_angles(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return the rotation by roll, pitch and yaw [rad] about the fixed axes x, y and z, one after the other."""
    (a, b, c), (d, e, f) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, a, -d], [0, d, a]])
    about_y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    about_z = np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]])
    return clean_rotation(clean_rotation(about_z) @ clean_rotation(about_y) @ clean_rotation(about_x))


def to_axis(axis: FloatArray) -> FloatArray:
    """Return the least rotation that takes z to a unit axis; about x by pi where that is -z."""
    x, y, z = axis
    if z < 0.0:
        return clean_rotation(to_axis(-axis) @ np.diag([1.0, -1.0, -1.0]))
    return clean_rotation(
        np.array([[1 - x * x / (1 + z), -x * y / (1 + z), x], [-x * y / (1 + z), 1 - y * y / (1 + z), y], [-x, -y, z]])
    )


# Inertias.


@final
@frozen(eq=False)
class Inertia:
    """Mass [kg], mass centre (3,) [m] and inertia (3, 3) about it [kg m^2], with components on some axes."""

    mass: float = 0.0
    centre: FloatArray = field(default_factory=lambda: np.zeros(3))
    matrix: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def vanishes(self) -> bool:
        """Whether there is neither mass nor inertia."""
        return self.mass == 0.0 and not np.any(self.matrix)

    @property
    def least_moment(self) -> float:
        """The least principal moment of inertia, where that is negative by more than rounding; else 0."""
        moments = np.linalg.eigvalsh(self.matrix)
        rounding = max(_INDEFINITE * float(np.max(np.abs(moments))), _INDEFINITE**2 * self.mass)
        return float(moments[0]) if moments[0] < -rounding else 0.0

    def on(self, place: Placement) -> Inertia:
        """Return the inertia on the axes that carry a place, of one with components on the axes of the place."""
        turned = place.rotation @ self.matrix @ place.rotation.T
        centre = place.position + place.rotation @ self.centre
        size = float(np.max(np.abs(place.position)) + np.max(np.abs(self.centre)))
        matrix = (turned + turned.T) / 2
        return Inertia(self.mass, cleaned(centre, size), cleaned(matrix, float(np.trace(np.abs(matrix)))))

    def plus(self, other: Inertia) -> Inertia:
        """Return the inertia of two bodies that are one."""
        if self.vanishes or other.vanishes:
            return other if self.vanishes else self
        mass = self.mass + other.mass
        if mass == 0.0:
            return Inertia(0.0, self.centre, self.matrix + other.matrix)
        centre = (self.mass * self.centre + other.mass * other.centre) / mass
        matrix = self.matrix + other.matrix
        for each in (self, other):
            r = each.centre - centre
            matrix = matrix + each.mass * (r @ r * np.eye(3) - np.outer(r, r))
        size = float(np.max(np.abs(self.centre)) + np.max(np.abs(other.centre)))
        return Inertia(mass, cleaned(centre, size), cleaned(matrix, float(np.trace(np.abs(matrix)))))


# Trees of links and joints.


@final
@frozen
class Mimic:
    """The value of a joint as multiplier times that of another plus offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@final
@frozen(eq=False)
class JointItem:
    """A joint as a file has it.

    Attributes
    ----------
    name, kind, parent, child : str
        The kind is "revolute", "prismatic", "planar", "floating", "ball" or "fixed"; parent and child are links.
    place : Placement
        Of the joint's axes on those of the parent; those of the child are the same at the value `zero`.
    axis : ndarray (3,)
        Unit axis, of a planar joint the normal of the plane.
    damping, friction : float
        Viscous [N m s] or [N s/m], and dry [N m] or [N].
    stiffness, reference, armature : float
        Of a spring that is at rest at `reference`; inertia of a rotor, felt at the joint.
    lower, upper, effort, velocity : float or None
        Limits.
    zero : float
        Value at which the axes of parent and child are the same.
    mimic : Mimic or None
    line : int
    """

    name: str
    kind: str
    parent: str
    child: str
    place: Placement
    axis: FloatArray
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    reference: float = 0.0
    armature: float = 0.0
    lower: float | None = None
    upper: float | None = None
    effort: float | None = None
    velocity: float | None = None
    zero: float = 0.0
    mimic: Mimic | None = None
    line: int = 0

    @property
    def limits(self) -> tuple[float | None, float | None]:
        """The lower and the upper limit."""
        return self.lower, self.upper


@final
@frozen
class Description:
    """A robot as a tree: links with their inertias, and joints that lead from the root to every other link.

    Attributes
    ----------
    name, root : str
        Of the robot, and of the link that no joint leads to.
    links : mapping of str to Inertia
        On the axes of the links; without mass and inertia where the file has none.
    joints : tuple of JointItem
        Every link's joint before those of what hangs on it.
    gravity : tuple of float or None
        Acceleration [m/s^2], where the file has one.
    skipped : tuple of str
        What of the file is left out, because it was to be skipped.
    labels : mapping of str to str
        Names of bodies by the links that carry them, where they differ.
    has_actuators : bool
        Whether motors are those that the file has, and not those of joints.
    visuals : mapping of str to tuple of Visual
        Shapes of links for pictures.
    lifted : mapping of str to float
        Shares of their weight that forces at the mass centres of links hold up.
    """

    name: str
    root: str
    links: Mapping[str, Inertia]
    joints: tuple[JointItem, ...]
    gravity: tuple[float, float, float] | None = None
    skipped: tuple[str, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    has_actuators: bool = False
    visuals: Mapping[str, tuple[Visual, ...]] = field(default_factory=dict)
    lifted: Mapping[str, float] = field(default_factory=dict)


@final
@frozen
class Merged:
    """A robot without fixed joints.

    Attributes
    ----------
    joints : tuple of JointItem
        Those that move, each placed on the link that carries its parent.
    carriers : mapping of str to (str, Placement)
        For each link the one that carries it, and its place there; links that move by themselves carry themselves.
    inertias : mapping of str to Inertia
        Of the links that carry, with all that they carry, on their axes.
    """

    joints: tuple[JointItem, ...]
    carriers: Mapping[str, tuple[str, Placement]]
    inertias: Mapping[str, Inertia]


def merged(robot: Description) -> Merged:
    """Return a robot whose fixed joints make one body of what they connect."""
    carriers = {robot.root: (robot.root, Placement())}
    moving: list[JointItem] = []
    for joint in robot.joints:
        carrier, place = carriers[joint.parent]
        there = place.then(joint.place)
        if joint.kind == "fixed":
            carriers[joint.child] = carrier, there
        else:
            carriers[joint.child] = joint.child, Placement()
            moving.append(replace(joint, parent=carrier, place=there))
    inertias = {carrier: Inertia() for carrier, _ in carriers.values()}
    for name, (carrier, place) in carriers.items():
        inertias[carrier] = inertias[carrier].plus(robot.links[name].on(place))
    return Merged(tuple(moving), carriers, inertias)


def in_tree_order(root: str, joints: Sequence[JointItem]) -> tuple[JointItem, ...]:
    """Return the joints below a link, each before those of what hangs on it, branch by branch."""
    below: dict[str, list[JointItem]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    found: list[JointItem] = []
    waiting = list(reversed(below.get(root, [])))
    while waiting:
        joint = waiting.pop()
        found.append(joint)
        waiting += reversed(below.get(joint.child, []))
    return tuple(found)
