"""Scenes of robots: [Description] -> [Scene], with frames, points and bodies of SymPy.

Every frame is a constant rotation of another, or turns about one of its axes, and every position is written on the
frame that carries it, so that no product of rotations is ever formed. Fixed joints are merged before.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, final

import numpy as np
import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody
from sympy.physics.vector import Dyadic, Vector

from ..arrays import FloatArray
from ..errors import FileWarning, SceneError, unknown_name, warn_caller
from ..scene.robots import RobotJoint, RobotLink, RobotParts
from ..scene.scene import Scene
from .robot_description import ROUNDING, Description, Inertia, JointItem, Placement, cleaned, merged, to_axis
from .robot_loads import add_gravity, add_joint_loads
from .robot_values import (
    SIMPLE,
    Drive,
    LinkPlace,
    RobotOptions,
    coordinate,
    coordinate_names,
    free_coordinates,
    free_names,
    identifier,
    is_identity,
    joint_value,
    new_frame,
    number,
    turned_frame,
    vector,
)
from .robot_visuals import add_visuals

BASE = "base"
"""Beginning of the names of the coordinates of a floating base."""


def scene_of(
    robot: Description,
    options: RobotOptions,
    find_mesh: Callable[[str], Path | None],
    extend: Callable[[RobotBuilder], None] | None = None,
) -> Scene:
    """Return the scene of a robot; `extend` adds what its file has beside links and joints.

    `find_mesh` returns the file of a mesh from what is written.

    Raises
    ------
    SceneError
        For joints of the options that the robot does not have, names that would be taken twice, and a robot of which
        nothing moves.
    """
    builder = RobotBuilder(robot, options)
    builder.require_motion()
    builder.add_base()
    for joint in builder.joints:
        builder.add_joint(joint)
    add_joint_loads(builder)
    add_gravity(builder)
    if extend is not None:
        extend(builder)
    builder.require_parameter_names()
    scene = builder.scene
    links = {name: builder.link(name) for name in robot.links}
    undrawn = add_visuals(builder, find_mesh)
    scene.robot = RobotParts(robot.name, links, builder.parts, builder.parameters, robot.skipped, undrawn)
    return scene


@final
class RobotBuilder:
    """One scene of one robot while it is built.

    Attributes
    ----------
    scene : Scene
    joints : tuple of JointItem
        Those that move.
    places : dict of str to LinkPlace
        Of links that carry others.
    bodies : dict of str to RigidBody
        By the names of their links.
    parts : dict of str to RobotJoint
    drives : dict of str to Drive
        Of joints with one coordinate.
    parents, seats : dict of str to str
        The parents of joints in the file, and the links that carry these.
    values : dict of str to Expr
        Coordinates of these joints, or what they are where they mimic others.
    parameters : dict of Symbol to float
    actuators : bool or tuple of str
        Which actuators of the file are wanted, where it has any.
    """

    def __init__(self, robot: Description, options: RobotOptions) -> None:
        self.robot, self.options = robot, options
        whole = merged(robot)
        self.joints, self.carriers, self.inertias = whole.joints, whole.carriers, whole.inertias
        self.scene = Scene(robot.name, frame=ReferenceFrame("world"), origin=Point("origin"))
        self.places: dict[str, LinkPlace] = {}
        self.bodies: dict[str, RigidBody] = {}
        self.parts: dict[str, RobotJoint] = {}
        self.drives: dict[str, Drive] = {}
        self.parameters: dict[Any, float] = {}
        self.parents = {joint.name: joint.parent for joint in robot.joints}
        self.seats = {joint.name: joint.parent for joint in self.joints}
        table = {joint.name: joint for joint in self.joints}
        self.values = {joint.name: joint_value(joint, table) for joint in self.joints if joint.kind in SIMPLE}
        free = [joint.name for joint in self.joints if joint.kind in SIMPLE and joint.mimic is None]
        self.actuators = options.actuated if robot.has_actuators else False
        given = False if robot.has_actuators else options.actuated
        self.actuated: tuple[str, ...] = given if isinstance(given, tuple) else tuple(free if given else ())
        self._faults = [
            f"actuated: {unknown_name('joint', name, free)} Joints that mimic others, and those with several"
            " coordinates, have no input"
            for name in self.actuated
            if name not in free
        ]

    # -- checks -------------------------------------------------------------------------------------

    def require_motion(self) -> None:
        """Raise for a robot of which nothing moves, and for names that are taken twice.

        Raises
        ------
        SceneError
        """
        names = [name for joint in self.joints for name in coordinate_names(joint)]
        names += free_names(BASE) if self.options.floating_base else []
        names += [f"tau_{name}" for name in self.actuated]
        self._faults += [
            f"two coordinates or inputs would be called {name!r}: rename a joint in the file"
            for name in sorted({name for name in names if names.count(name) > 1})
        ]
        if not names:
            self._faults.append("nothing moves: give floating_base=True, or joints that are not fixed")
        self._raise()

    def require_parameter_names(self) -> None:
        """Raise where a parameter has the name of a coordinate or of an input.

        Raises
        ------
        SceneError
        """
        taken = {str(x.func.__name__) for x in (*self.scene.coordinates, *self.scene.inputs)}
        self._faults += [
            f"a joint and a parameter would both be called {name!r}: rename the joint in the file"
            for name in sorted({str(symbol) for symbol in self.parameters} & taken)
        ]
        self._raise()

    def _raise(self) -> None:
        if self._faults:
            raise SceneError(self.robot.name, self._faults)

    # -- values -------------------------------------------------------------------------------------

    def parameter(self, name: str, value: float, **assumptions: bool) -> Any:
        """Return a number, or the symbol that stands for it."""
        if not self.options.symbols:
            return number(value)
        symbol = sp.Symbol(name, **(assumptions or {"real": True}))
        self.parameters[symbol] = float(value)
        return symbol

    def length(self, name: str, values: FloatArray) -> list[Any]:
        """Return components of a position, of which those that are zero stay numbers."""
        pairs = zip("xyz", values, strict=True)
        return [self.parameter(f"{name}_{axis}", value) if value else sp.S.Zero for axis, value in pairs]

    # -- the tree -----------------------------------------------------------------------------------

    def add_base(self) -> None:
        """Place the root, in the fixed frame or on its own."""
        scene, root = self.scene, self.robot.root
        if not self.options.floating_base:
            self.places[root] = LinkPlace(scene.frame, scene.origin, np.eye(3))
            return
        frame, point = new_frame(root), Point(root)
        there = free_coordinates(self.scene, BASE, frame, scene.frame, moves=True)
        point.set_pos(scene.origin, vector(scene.frame, there[:3]))
        self.places[root] = LinkPlace(frame, point, np.eye(3))
        self._add_body(root)

    def add_joint(self, joint: JointItem) -> None:
        """Place the child of a joint, with its body."""
        parent = self.places[joint.parent]
        place = Placement(parent.axes, np.zeros(3)).then(joint.place)
        seat = parent.point.locatenew(
            f"{joint.name} seat", vector(parent.frame, self.length(f"p_{joint.name}", place.position))
        )
        point = Point(joint.child)
        if joint.kind in SIMPLE:
            coordinates = () if joint.mimic is not None else (self.values[joint.name],)
            self.scene.coordinates += coordinates
            add = self._revolute if joint.kind == "revolute" else self._prismatic
            found = add(joint, parent, place.rotation, (seat, point))
        else:
            found, coordinates = self._several(joint, parent, place.rotation, (seat, point))
        if self.options.symbols and not is_identity(found.axes):
            found = LinkPlace(turned_frame(joint.child, found.frame, found.axes), point, np.eye(3))
        self.places[joint.child] = found
        drive = coordinate(f"tau_{joint.name}") if joint.name in self.actuated else None
        limits = {name: getattr(joint, name) for name in ("lower", "upper", "effort", "velocity")}
        self.parts[joint.name] = RobotJoint(
            joint.name,
            joint.kind,
            self.parents[joint.name],
            joint.child,
            coordinates,
            self.values.get(joint.name),
            drive,
            **limits,
        )
        self._add_body(joint.child)

    def _revolute(
        self, joint: JointItem, parent: LinkPlace, rotation: FloatArray, points: tuple[Point, Point]
    ) -> LinkPlace:
        """Return the place of a link that turns about an axis; one that is no axis of the link becomes z."""
        seat, point = points
        along = int(np.argmax(np.abs(joint.axis)))
        others = np.delete(joint.axis, along)
        aside = np.eye(3) if np.max(np.abs(others)) <= ROUNDING else to_axis(joint.axis)
        along, sense = (along, int(np.sign(joint.axis[along]))) if is_identity(aside) else (2, 1)
        base = turned_frame(f"{joint.name} axes", parent.frame, rotation @ aside)
        frame = new_frame(joint.child)
        frame.orient_axis(base, list(base)[along], sense * (self.values[joint.name] - number(joint.zero)))
        point.set_pos(seat, Vector(0))
        self.drives[joint.name] = Drive(sense * list(frame)[along], frame, parent.frame)
        return LinkPlace(frame, point, aside.T)

    def _prismatic(
        self, joint: JointItem, parent: LinkPlace, rotation: FloatArray, points: tuple[Point, Point]
    ) -> LinkPlace:
        """Return the place of a link that moves along an axis, on the frame of its parent."""
        seat, point = points
        axis = vector(parent.frame, [number(x) for x in cleaned(rotation @ joint.axis, 1.0)])
        point.set_pos(seat, (self.values[joint.name] - number(joint.zero)) * axis)
        self.drives[joint.name] = Drive(axis, point, seat)
        return LinkPlace(parent.frame, point, rotation)

    def _several(
        self, joint: JointItem, parent: LinkPlace, rotation: FloatArray, points: tuple[Point, Point]
    ) -> tuple[LinkPlace, tuple[Any, ...]]:
        """Return the place of the link of a joint with several coordinates, and the coordinates."""
        seat, point = points
        frame = new_frame(joint.child)
        if joint.kind == "planar":
            aside = to_axis(joint.axis)
            base = turned_frame(f"{joint.name} axes", parent.frame, rotation @ aside)
            x, y, theta = there = tuple(map(coordinate, coordinate_names(joint)))
            self.scene.coordinates += there
            frame.orient_axis(base, base.z, theta)
            point.set_pos(seat, vector(base, (x, y, 0)))
            return LinkPlace(frame, point, aside.T), there
        base = turned_frame(f"{joint.name} axes", parent.frame, rotation)
        moves = joint.kind == "floating"
        there = free_coordinates(self.scene, identifier(joint.name), frame, base, moves=moves)
        point.set_pos(seat, vector(base, there[:3]) if moves else Vector(0))
        return LinkPlace(frame, point, np.eye(3)), there

    # -- bodies and links ---------------------------------------------------------------------------

    def _add_body(self, name: str) -> None:
        """Add the body of a link with all that is fixed to it; none where it has neither mass nor inertia."""
        own, place = self.inertias[name], self.places[name]
        if own.least_moment:
            warn_caller(
                f"robot {self.robot.name!r}: the inertia of {name!r}, with what is fixed to it, has the negative"
                f" principal moment {own.least_moment:.3g} kg m^2, as no body has: check the file",
                FileWarning,
            )
        if not own.vanishes:
            self.bodies[name] = self._body(name, own.on(Placement(place.axes, np.zeros(3))), place)
            self.scene.add_bodies(self.bodies[name])

    def _body(self, name: str, own: Inertia, place: LinkPlace) -> RigidBody:
        frame, rows = place.frame, own.matrix
        mass = self.parameter(f"m_{name}", own.mass, positive=True) if own.mass else sp.S.Zero
        pairs = list(zip("xyz", own.centre, strict=True))
        offset = [self.parameter(f"c_{name}_{axis}", value) for axis, value in pairs]
        centre = Point(f"{name} centre") if own.mass else place.point
        moments: dict[tuple[int, int], Any] = {}
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            moments[i, j] = moments[j, i] = self.parameter(f"I_{name}_{'xyz'[i]}{'xyz'[j]}", rows[i, j])
        axes = list(frame)
        dyadic = Dyadic([(value, axes[i], axes[j]) for (i, j), value in sorted(moments.items()) if value != 0])
        body = RigidBody(self.robot.labels.get(name, name), centre, frame, mass, (dyadic, centre))
        if own.mass:  # placed last: SymPy looks for the way from the centre to itself among all points it is joined to
            centre.set_pos(place.point, vector(frame, offset))
        return body

    def body_for(self, name: str) -> RigidBody:
        """Return the body of a link that takes part in a joint with reactions, without mass where it has none."""
        if name not in self.bodies:
            self.bodies[name] = self._body(name, Inertia(), self.places[name])
            self.scene.add_bodies(self.bodies[name])
        return self.bodies[name]

    def rests(self, name: str) -> bool:
        """Whether a link that carries others is at rest."""
        return self.places[name].frame is self.scene.frame and self.places[name].point is self.scene.origin

    def link(self, name: str) -> RobotLink:
        """Return a link with its frame and its origin."""
        carrier, there = self.carriers[name]
        at = self.places[carrier]
        place = Placement(at.axes, np.zeros(3)).then(there)
        point = at.point
        if np.any(place.position):
            point = Point(name)
            point.set_pos(at.point, vector(at.frame, [number(x) for x in place.position]))
        frame = turned_frame(name, at.frame, place.rotation)
        return RobotLink(name, frame, point, str(self.bodies[carrier].name) if carrier in self.bodies else None)
