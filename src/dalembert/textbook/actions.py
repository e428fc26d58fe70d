"""Screws, action screws and power coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Any, final

import sympy as sp
from sympy.physics.mechanics import Particle, Point
from sympy.physics.vector import Vector

from ..errors import SceneError
from ..frozen import frozen
from ..scene import Joint
from ..scene.actuators import loads_of
from .geometry import Geometry

# Screws: kinematic, partial kinematic and action screws alike.


@final
@frozen
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


def centre(body: Any) -> Point:
    """Return the mass centre of a body or particle."""
    return body.point if isinstance(body, Particle) else body.masscenter


class Actions:
    """The actions on the bodies of a scene, and their power in the virtual motion of each coordinate.

    Parameters
    ----------
    geometry : Geometry
    coordinates : sequence of dynamicsymbols
    """

    def __init__(self, geometry: Geometry, coordinates: Sequence[Any]) -> None:
        self.geometry = geometry
        self.scene = geometry.scene
        self.coordinates = tuple(coordinates)
        self.loads = loads_of(self.scene)
        self.bodies = {str(body.name): body for body in self.scene.bodies}

    def kinematic_screw(self, body: Any, point: Point | None = None) -> Screw:
        """Return the kinematic screw of a body at its mass centre, or of its velocity field at `point`."""
        omega = Vector(0) if isinstance(body, Particle) else self.geometry.angular_velocity(body.frame)
        screw = Screw(omega, self.geometry.velocity(centre(body)), centre(body), self.geometry)
        return screw if point is None else screw.at(point)

    def partial_kinematic_screw(self, body: Any, coordinate: Any, point: Point | None = None) -> Screw:
        """Return the part of the kinematic screw that multiplies the rate of `coordinate` (13.4.2)."""
        screw = self.kinematic_screw(body)
        rate = coordinate.diff(self.geometry.time)
        partial = Screw(
            self.geometry.map(screw.resultant, lambda e: e.diff(rate)),
            self.geometry.map(screw.moment, lambda e: e.diff(rate)),
            screw.point,
            self.geometry,
        )
        return partial if point is None else partial.at(point)

    def acted_on(self, joint: Joint) -> tuple[Any, ...]:
        """Return the body that a joint acts on, and the other body, if any, that has the opposite action."""
        return tuple(self.bodies[name] for name in (joint.body, joint.other) if name is not None)

    def action_screw(self, joint: Joint, body: Any = None) -> Screw:
        """Return the action screw of a joint at its reduction point: on its body, or on the body given."""
        force, torque = self.geometry.vector(joint.force), self.geometry.vector(joint.torque)
        own, *other = self.acted_on(joint)
        if body is not None and body is not own:
            if body not in other:
                known = ", ".join(repr(item.name) for item in (own, *other))
                raise SceneError(self.scene.name, [f"joint {joint.name!r} acts on {known}, not on {str(body.name)!r}"])
            force, torque = -force, -torque
        return Screw(force, torque, joint.at, self.geometry)

    def joint_power(self, joint: Joint, coordinate: Any) -> sp.Expr:
        """Return the power coefficient of a joint: its action screws times the partial kinematic screws."""
        powers = (
            self.action_screw(joint, body).product(self.partial_kinematic_screw(body, coordinate))
            for body in self.acted_on(joint)
        )
        return sum(powers, sp.S.Zero)

    def relative_screw(self, joint: Joint) -> Screw:
        """Return the kinematic screw at a joint of its body, relative to the other body if it has one."""
        own, *others = (self.kinematic_screw(body).at(joint.at) for body in self.acted_on(joint))
        for other in others:
            own = Screw(own.resultant - other.resultant, own.moment - other.moment, joint.at, self.geometry)
        return own

    def load_power(self, load: Any, coordinate: Any) -> sp.Expr:
        """Return the power coefficient of a load: a force at a point, a torque on a frame, or a force on a body."""
        if len(load) == 3:
            body, point, force = load
            screw = Screw(self.geometry.vector(force), Vector(0), point, self.geometry)
            return screw.product(self.partial_kinematic_screw(self.bodies.get(body, body), coordinate))
        place, vector = load
        rate = coordinate.diff(self.geometry.time)
        moving = self.geometry.velocity(place) if isinstance(place, Point) else self.geometry.angular_velocity(place)
        return self.geometry.dot(self.geometry.vector(vector), self.geometry.map(moving, lambda e: e.diff(rate)))

    def gravity_power(self, coordinate: Any) -> sp.Expr:
        """Return the power coefficient of gravity on all bodies."""
        if self.scene.gravity is None:
            return sp.S.Zero
        rate, total = coordinate.diff(self.geometry.time), sp.S.Zero
        g = self.geometry.vector(self.scene.gravity)
        for body in self.scene.bodies:
            partial = self.geometry.map(self.geometry.velocity(centre(body)), lambda e: e.diff(rate))
            total += self.geometry.put(body.mass) * self.geometry.dot(g, partial)
        return total

    def gravity_potential(self) -> sp.Expr:
        """Return the potential energy of gravity."""
        if self.scene.gravity is None:
            return sp.S.Zero
        g, total = self.geometry.vector(self.scene.gravity), sp.S.Zero
        for body in self.scene.bodies:
            total -= self.geometry.put(body.mass) * self.geometry.dot(g, self.geometry.position(centre(body)))
        return total

    def given_power(self, coordinate: Any) -> sp.Expr:
        """Return the power coefficient of gravity and all loads."""
        return self.gravity_power(coordinate) + sum(
            (self.load_power(load, coordinate) for load in self.loads), sp.S.Zero
        )

    def joint(self, name: Any) -> Joint:
        """Return a joint by its name."""
        for joint in self.scene.joints:
            if joint is name or joint.name == name:
                return joint
        known = ", ".join(joint.name for joint in self.scene.joints) or "none"
        raise SceneError(self.scene.name, [f"there is no joint {str(name)!r}; known: {known}"])

    def body(self, name: Any) -> Any:
        """Return a body by its name."""
        for body in self.scene.bodies:
            if body is name or body.name == name:
                return body
        known = ", ".join(self.bodies) or "none"
        raise SceneError(self.scene.name, [f"there is no body {str(name)!r}; known: {known}"])
