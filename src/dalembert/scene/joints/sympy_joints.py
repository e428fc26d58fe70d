"""Joints of ``sympy.physics.mechanics`` in a scene: bodies, coordinates, speeds and reactions of a tree."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import sympy as sp
from sympy.physics.mechanics import (
    CylindricalJoint,
    PinJoint,
    PlanarJoint,
    PrismaticJoint,
    SphericalJoint,
    WeldJoint,
)
from sympy.physics.mechanics.joint import Joint as AnyJoint

from ...errors import SceneError, list_names
from ..frames import Tree
from .parts import at_rest
from .reactions import NOTHING, Connection, Triple, across, connection, everything, has_body, require_new_name

if TYPE_CHECKING:
    from ..scene import Scene

_Components = Callable[[AnyJoint], tuple[Triple, Triple]]


def _axis(joint: Any) -> Any:
    """Return the axis of a joint (3, 1) on its parent's intermediate frame, as a unit matrix."""
    return joint.joint_axis.normalize().to_matrix(joint.parent_interframe)


def _normal(joint: Any) -> Any:
    return joint.rotation_axis.to_matrix(joint.parent_interframe)


def _along_normal(joint: Any) -> Triple:
    x, y, z = everything(f"{joint.name}.force")
    return x * _normal(joint)[0], y * _normal(joint)[1], z * _normal(joint)[2]


REACTIONS: dict[type, _Components] = {
    PinJoint: lambda j: (everything(f"{j.name}.force"), across(f"{j.name}.torque", _axis(j))),
    PrismaticJoint: lambda j: (across(f"{j.name}.force", _axis(j)), everything(f"{j.name}.torque")),
    CylindricalJoint: lambda j: (across(f"{j.name}.force", _axis(j)), across(f"{j.name}.torque", _axis(j))),
    PlanarJoint: lambda j: (_along_normal(j), across(f"{j.name}.torque", _normal(j))),
    SphericalJoint: lambda j: (everything(f"{j.name}.force"), NOTHING),
    WeldJoint: lambda j: (everything(f"{j.name}.force"), everything(f"{j.name}.torque")),
}
"""Joints by their classes, each with the components of force and torque that it can exert on its child."""


def reaction_of(joint: AnyJoint) -> Connection:
    """Return a joint of SymPy with its reaction, on the axes of its parent's intermediate frame at its child's point.

    Components along which the joint lets its bodies move are zero.
    """
    action = REACTIONS[type(joint)](joint)
    bodies = joint.child, joint.parent
    return connection(joint.name, bodies, joint.child_point, joint.parent_interframe, action, joint)


def add_sympy_joint(scene: Scene, joint: Any) -> None:
    """Add a joint with its bodies, coordinates and speeds. Bodies at rest that it hangs on are the fixed frame.

    Raises
    ------
    SceneError
        For a class that is not known, a name that another joint has, a closed loop, or speeds that contradict those of
        another joint.
    """
    require_new_name(scene, joint.name)
    if type(joint) not in REACTIONS:
        known = list_names(kind.__name__ for kind in REACTIONS)
        raise SceneError(scene.name, [f"joint {joint.name!r} is a {type(joint).__name__}; known: {known}"])
    parent, child = (has_body(scene, body) for body in (joint.parent, joint.child))
    resting = not parent and at_rest(scene, joint.parent)
    reversed_ = not (child or resting) and at_rest(scene, joint.child) and not at_rest(scene, joint.parent)
    faults = _closed_loop(scene, joint, (resting, reversed_)) + _other_speeds(scene, joint)
    if faults:
        raise SceneError(scene.name, faults)
    bodies = zip((joint.parent, joint.child), (resting, reversed_), strict=True)
    scene.add_bodies(*(body for body, ground in bodies if not ground))
    scene.coordinates += tuple(q for q in joint.coordinates if q not in scene.coordinates)
    named = tuple(u for u in joint.speeds if not isinstance(u, sp.Derivative) and u not in scene.speeds)
    scene.kinematic_equations += tuple(equation for equation in joint.kdes if named and equation.has(*named))
    scene.speeds += named
    scene.connections += (reaction_of(joint),)


def tree_of(scene: Scene) -> list[Any]:
    """Return the joints of SymPy that a scene has."""
    return [item.source for item in scene.connections if isinstance(item.source, AnyJoint)]


def _closed_loop(scene: Scene, joint: Any, grounds: tuple[bool, bool]) -> list[str]:
    """Return a fault where a joint connects bodies that others connect already."""
    above: dict[int, int] = {}

    def root(body: Any, *, ground: bool) -> int:
        end = 0 if ground else id(body)
        while end in above:
            end = above[end]
        return end

    for other in tree_of(scene):
        ends = [root(body, ground=not has_body(scene, body)) for body in (other.parent, other.child)]
        above[ends[1]] = ends[0]
    ends = [root(body, ground=rest) for body, rest in zip((joint.parent, joint.child), grounds, strict=True)]
    if ends[0] != ends[1]:
        return []
    return [
        f"joint {joint.name!r} closes a loop: other joints connect {str(joint.parent.name)!r} and"
        f" {str(joint.child.name)!r} already. SymPy's joints build a tree; close the loop with dalembert.Closure in"
        " place of this joint"
    ]


def _other_speeds(scene: Scene, joint: Any) -> list[str]:
    """Return a fault for every coordinate that has another speed in another joint."""
    known = {q: u for other in tree_of(scene) for q, u in zip(other.coordinates, other.speeds, strict=True)}
    return [
        f"joint {joint.name!r} gives the coordinate {q.func.__name__!r} the speed {u}, and another joint gives it"
        f" {known[q]}: name the same speed, or leave one coordinate to each joint"
        for q, u in zip(joint.coordinates, joint.speeds, strict=True)
        if known.get(q, u) != u
    ]


def tree_faults(scene: Scene, frames: Tree, points: Tree) -> list[str]:
    """Return a fault for every SymPy joint that does not hold its bodies in place.

    Parameters
    ----------
    scene : Scene
    frames, points : Tree
        Below the frame and the origin of the scene.
    """
    faults = []
    for joint in tree_of(scene):
        name, parent, child = joint.name, str(joint.parent.name), str(joint.child.name)
        ends = joint.parent_point, joint.child_point
        turns = joint.parent_interframe, joint.child_interframe
        if any(points.path(end) is None for end in ends) or any(frames.path(turn) is None for turn in turns):
            faults.append(
                f"joint {name!r} hangs on {parent!r}, which nothing connects with the frame {scene.frame.name!r} and"
                f" the origin {scene.origin.name!r} of the scene. Connect it by a joint; or make the ground from them,"
                f" RigidBody('ground', masscenter={scene.origin.name}, frame={scene.frame.name}); or make the scene"
                " from the ground, with frame=ground.frame and origin=ground.masscenter"
            )
        for tree, pair, verb in ((points, ends, "located"), (frames, turns, "oriented")):
            if pair[0] is not pair[1] and not any(tree.parent.get(pair[i]) is pair[1 - i] for i in (0, 1)):
                if all(tree.path(end) is not None for end in pair):
                    faults.append(
                        f"joint {name!r} contradicts how {child!r} is {verb} already: leave out what else places"
                        f" {child!r}, or the joint"
                    )
    return faults
