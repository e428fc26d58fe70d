"""Scenes of files of robots: `Scene.from_urdf` and `Scene.from_mjcf`, and the parts of a scene by their names there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

from sympy import Expr
from sympy.physics.mechanics import Point, ReferenceFrame

from ..errors import nesting_named
from ..frozen import frozen

if TYPE_CHECKING:
    from .scene import Scene


@final
@frozen
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
@frozen
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
@frozen
class RobotParts:
    """Links, joints and parameters of the file of a robot, by their names there.

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
    undrawn : tuple of str
        Shapes of the file that pictures do not have, with the reason.

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
    undrawn: tuple[str, ...] = ()


# Class methods of scenes.


@nesting_named
def from_urdf(
    cls: type[Scene],
    path: Any,
    floating_base: bool = False,
    parameters: str = "numbers",
    joint_loads: bool | str = True,
    limits: bool = False,
    *,
    actuated: bool | Sequence[str] = False,
    gravity: Sequence[float] | None = None,
) -> Scene:
    """Return the scene of a robot from its URDF file.

    Coordinates bear the names of the joints: an angle [rad] or a displacement [m]. A planar joint has
    ``name_x``, ``name_y`` (in the plane) and ``name_theta``; a floating one ``name_x``, ``name_y``, ``name_z`` and
    the unit quaternion ``name_e0`` to ``name_e3``, scalar first. A joint that mimics another has no coordinate: its
    value is a multiple of the other's. Links that fixed joints connect are one body, which is called after the link
    that carries them. ``scene.robot`` has the links and joints by their names in the file.

    Pictures, colliding geometry, transmissions, sensors and extensions of simulators are ignored.

    Parameters
    ----------
    path : path-like
        The file, expanded by xacro where it was written for it.
    floating_base : bool
        Whether the root link moves freely, with the coordinates ``base_x``, ``base_y``, ``base_z`` and ``base_e0``
        to ``base_e3``; otherwise it is at rest.
    parameters : str
        "numbers" (default): those of the file are written into the equations, which are small and fast. "symbols":
        masses, mass centres, inertias, places of joints, and coefficients of their loads are parameters, whose
        values in the file are ``scene.robot.parameters``.
    joint_loads : bool or str
        Whether damping and dry friction of the file act; "damping" or "friction" takes one of them. Dry friction is
        Coulomb's law, in which joints stick: the model has contacts that change, called "name.friction".
    limits : bool
        Whether lower and upper limits are stops without restitution, such as "elbow.lower"; see `Stop`.
    actuated : bool or sequence of str
        Joints with a motor: each has an input ``tau_name``, the torque [N m] or force [N] that acts along it
        between its links. True takes all but those that mimic others. Without inputs,
        `CompiledModel.inverse_dynamics` returns generalised forces, which are the same torques.
    gravity : sequence of three float, optional
        Acceleration [m/s^2] in the frame of the scene; (0, 0, -9.81) by default, which is -g with symbols.

    Raises
    ------
    SceneError
        With every fault of the file and its line.
    OptionError
        For options that are not allowed, and a path that cannot be read.

    Examples
    --------
    ::

        arm = da.Scene.from_urdf("arm.urdf", actuated=True)
        model = da.compile_model(arm, outputs=[arm.robot.links["tool0"].point])
    """
    from ..interop.urdf import scene_from_urdf

    return scene_from_urdf(
        path,
        floating_base=floating_base,
        parameters=parameters,
        joint_loads=joint_loads,
        limits=limits,
        actuated=actuated,
        gravity=gravity,
    )


@nesting_named
def from_mjcf(
    cls: type[Scene],
    path: Any,
    parameters: str = "numbers",
    joint_loads: bool | str = True,
    limits: bool = False,
    *,
    actuated: bool | Sequence[str] = True,
    gravity: Sequence[float] | None = None,
    skip: Sequence[str] = (),
) -> Scene:
    """Return the scene of a model of MuJoCo from its MJCF file.

    Coordinates bear the names of the joints: hinges and slides have one; a ball has the unit quaternion ``name_e0``
    to ``name_e3`` from the body to its parent, a free joint the position ``name_x``, ``name_y``, ``name_z`` before
    it. Joints without a name are called after their body, such as ``arm_joint``. Bodies that no joint moves are one
    with their parents. ``scene.robot`` has bodies as links, and the joints, by their names.

    Default classes, angles of the compiler, frames, armatures, springs, damping, dry friction (exact, not smooth),
    and masses from primitive geoms are served; equalities (connect, weld, joint) are exact constraints. Ranges of
    controls and forces, keyframes, sensors and pictures are ignored.

    Parameters
    ----------
    path : path-like
        The file. Files that it includes are looked for beside it.
    parameters, joint_loads, limits, gravity
        As for `from_urdf`; gravity is that of the file by default, and springs are among the damping.
    actuated : bool or sequence of str
        Actuators of joints (motor, position, velocity, general), by name, or all: the control of each is an input
        ``ctrl_name``.
    skip : sequence of str
        What to leave out of the scene where the file has it: "contacts" (geoms that collide), "tendons",
        "actuators" and "equalities" (of other kinds), "fluid", "sizes" (settings that change masses).
        ``scene.robot.skipped`` says what was there.

    Raises
    ------
    SceneError
        With every fault of the file and its line, and all that a scene has no part for and `skip` does not name.
    OptionError
        For options that are not allowed, and a path that cannot be read.

    Examples
    --------
    ::

        hand = da.Scene.from_mjcf("hand.xml", skip=["contacts", "tendons"])
    """
    from ..interop.mjcf import scene_from_mjcf

    return scene_from_mjcf(
        path,
        parameters=parameters,
        joint_loads=joint_loads,
        limits=limits,
        actuated=actuated,
        gravity=gravity,
        skip=skip,
    )
