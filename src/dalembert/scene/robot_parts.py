"""Parts of a scene that a file of a robot describes: its links and joints by their names in the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from sympy import Expr
from sympy.physics.mechanics import Point, ReferenceFrame


@final
@dataclass(frozen=True)
class RobotLink:
    """A link of a robot by its name, also one that is fixed to another.

    Attributes
    ----------
    frame : ReferenceFrame
        Axes of the link in the file.
    point : Point
        Origin of these axes.
    body : str or None
        Name of the body of the scene that it is part of; None where that has no mass or does not move.
    """

    name: str
    frame: ReferenceFrame
    point: Point
    body: str | None


@final
@dataclass(frozen=True)
class RobotJoint:
    """A joint of a robot that moves, by its name.

    Attributes
    ----------
    kind : str
        It is "revolute", "prismatic", "planar", "ball" or "floating".
    parent, child : str
        Names of the links that it connects.
    coordinates : tuple of dynamicsymbols
        Coordinates of the scene; none of a joint that mimics another.
    value : Expr or None
        Angle [rad] or displacement [m], of a joint that has one; in the coordinates of the joint that it mimics.
    input : dynamicsymbol or None
        Torque [N m] or force [N] of its motor, where it is actuated.
    lower, upper : float or None
        Limits of the value.
    effort, velocity : float or None
        Limits of the motor in the file; the equations do not have them.
    """

    name: str
    kind: str
    parent: str
    child: str
    coordinates: tuple[Any, ...]
    value: Expr | None
    input: Expr | None = None
    lower: float | None = None
    upper: float | None = None
    effort: float | None = None
    velocity: float | None = None


@final
@dataclass(frozen=True)
class RobotParts:
    """What a scene has from the file of a robot, with the name of the robot, by the names of the file.

    Attributes
    ----------
    links : mapping of str to RobotLink
        All links; ``robot.links["tool0"].point`` is a point for outputs, loads and contacts.
    joints : mapping of str to RobotJoint
        The joints that move, in the order of the coordinates.
    parameters : mapping of Symbol to float
        Values in the file of the parameters of the scene; none where the scene has numbers.
    skipped : tuple of str
        What of the file the scene does not have, because it was to be skipped.

    Examples
    --------
    ::

        scene = da.Scene.from_urdf("arm.urdf", parameters="symbols")
        tool = scene.robot.links["tool0"].point
        model = da.compile_model(scene, outputs=[tool])
        traj = model.simulate((0, 1), initial, {**scene.robot.parameters, "m_hand": 2.0})
    """

    name: str
    links: Mapping[str, RobotLink]
    joints: Mapping[str, RobotJoint]
    parameters: Mapping[Any, float]
    skipped: tuple[str, ...] = ()
