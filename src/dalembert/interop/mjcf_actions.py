"""Actuators and equalities of MJCF files: inputs with their forces, and exact constraints.

An actuator of a joint exerts gear (gain ctrl + bias_0 + bias_1 gear q + bias_2 gear q_dot). Equalities hold exactly:
those of bodies at the places that they have in the posture of the file, those of joints as polynomials.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, final

import numpy as np
import sympy as sp
from sympy.physics.mechanics import ReferenceFrame
from sympy.physics.vector import dynamicsymbols

from ..arrays import FloatArray
from ..errors import SceneError, list_names, unknown_name
from ..frozen import frozen
from ..scene.joints.closures import Closure
from ..scene.joints.parts import add_constraints
from .mjcf_settings import unread
from .mjcf_values import from_quaternion
from .robot_description import Description, Placement
from .robot_files import Element
from .robot_loads import push_joint
from .robot_values import coordinate, matrix, number, vector

if TYPE_CHECKING:
    from .mjcf import MjcfReader
    from .robot_scenes import RobotBuilder

_ACTUATORS = ("motor", "position", "velocity", "general")
_EQUALITIES = ("connect", "weld", "joint")


@final
@frozen
class Actuator:
    """An actuator of a joint: its force is gear (gain ctrl + bias (1, gear q, gear q_dot))."""

    name: str
    joint: str
    gear: float
    gain: float
    bias: tuple[float, float, float]


@final
@frozen(eq=False)
class Together:
    """Two places that are together: of links, with the frames aligned where it is a weld.

    A place of None is found from that of the other link in the posture of the file.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[Placement, Placement | None]


@final
@frozen
class Coupled:
    """A joint whose value is a polynomial of that of another, both from their values in the file."""

    name: str
    joint: str
    other: str
    coefficients: tuple[float, ...]


@final
@frozen
class Actions:
    """Actuators and equalities of a file."""

    actuators: tuple[Actuator, ...]
    together: tuple[Together, ...]
    coupled: tuple[Coupled, ...]


# Reading.


def read_actions(reader: MjcfReader) -> Actions:
    """Return the actuators and equalities of a file; faults are recorded."""
    off = reader.settings.disabled
    groups = [] if "actuation" in off else reader.root.all("actuator")
    actuators = [_actuator(reader, each) for group in groups for each in group]
    equalities = [each for group in ([] if "equality" in off else reader.root.all("equality")) for each in group]
    together: list[Together] = []
    coupled: list[Coupled] = []
    for place, element in enumerate(equalities, 1):
        applied = reader.defaults.applied(Element("equality", element.attributes, element.line), "main")
        name = element.attributes.get("name", "").strip() or f"{element.tag}_{place}"
        if applied.attributes.get("active", "true") in ("false", "0"):
            continue
        if element.tag not in _EQUALITIES:
            reader.leave_out("equalities", element, f"<{element.tag}> {name!r}")
        elif element.tag == "joint":
            coupled += _coupled(reader, element, name)
        else:
            together += _together(reader, element, name)
    found = [actuator for actuator in actuators if actuator is not None]
    return Actions(tuple(found), tuple(together), tuple(coupled))


def _actuator(reader: MjcfReader, given: Element) -> Actuator | None:
    file, element = reader.file, reader.defaults.applied(given, "main")
    attributes = element.attributes
    joint = attributes.get("joint", attributes.get("jointinparent", ""))
    name = attributes.get("name", "").strip() or joint or f"actuator_{int(given.line)}"
    what = f"<{given.tag}> {name!r}"
    special = given.tag in _ACTUATORS and unread(element)
    dynamic = attributes.get("dyntype", "none") != "none" or attributes.get("gaintype", "fixed") != "fixed"
    bias_kind = attributes.get("biastype", "none")
    if given.tag not in _ACTUATORS or not joint or special or dynamic or bias_kind not in ("none", "affine"):
        reader.leave_out("actuators", given, what)
        return None
    if joint not in reader.joints or reader.joints[joint].kind not in ("revolute", "prismatic"):
        file.fault(given, f"{what} acts on {joint!r}, which is no hinge or slide; known: {list_names(reader.joints)}")
        return None
    gear = _listed(reader, element, "gear", (1.0,))[0]
    gain, bias = 1.0, (0.0, 0.0, 0.0)
    if given.tag == "position":
        gain, damping = file.number(element, "kp", 1.0), file.number(element, "kv", 0.0)
        bias = (0.0, -gain, -damping)
    elif given.tag == "velocity":
        gain = file.number(element, "kv", 1.0)
        bias = (0.0, 0.0, -gain)
    elif given.tag == "general":
        gain = _listed(reader, element, "gainprm", (1.0,))[0]
        rest = [*_listed(reader, element, "biasprm", (0.0,)), 0.0, 0.0, 0.0]
        bias = (rest[0], rest[1], rest[2]) if bias_kind == "affine" else bias
    return Actuator(name, joint, gear, gain, bias)


def _listed(reader: MjcfReader, element: Element, attribute: str, default: tuple[float, ...]) -> list[float]:
    """Return numbers of which there may be any count from one."""
    given = element.attributes.get(attribute)
    if given is None:
        return list(default)
    return [float(x) for x in reader.file.numbers(element, attribute, max(len(given.split()), 1), default)]


def _coupled(reader: MjcfReader, element: Element, name: str) -> list[Coupled]:
    file, joint, other = reader.file, file_text(reader, element, "joint1"), element.attributes.get("joint2", "")
    for each in (joint, other):
        if each and (each not in reader.joints or reader.joints[each].kind not in ("revolute", "prismatic")):
            file.fault(element, f"equality {name!r}: {each!r} is no hinge or slide; known: {list_names(reader.joints)}")
            return []
    coefficients = _listed(reader, element, "polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
    return [Coupled(name, joint, other, tuple(coefficients))] if joint else []


def file_text(reader: MjcfReader, element: Element, attribute: str) -> str:
    """Return an attribute that must be there."""
    return reader.file.text(element, attribute)


def _together(reader: MjcfReader, element: Element, name: str) -> list[Together]:
    file, attributes = reader.file, element.attributes
    if "site1" in attributes or "site2" in attributes:
        sites = [file_text(reader, element, f"site{i}") for i in (1, 2)]
        unknown = [site for site in sites if site and site not in reader.sites]
        for site in unknown:
            file.fault(element, f"equality {name!r}: {site!r} is no site; known: {list_names(reader.sites)}")
        if unknown or not all(sites):
            return []
        (one, first), (two, second) = (reader.sites[site] for site in sites)
        return [Together(name, element.tag, (one, two), (first, second))]
    bodies = file_text(reader, element, "body1"), attributes.get("body2", "world")
    unknown = [body for body in bodies if body and body not in reader.bodies]
    for body in unknown:
        file.fault(element, f"equality {name!r}: {body!r} is no body; known: {list_names(reader.bodies)}")
    if unknown or not bodies[0]:
        return []
    links = reader.bodies[bodies[0]], reader.bodies[bodies[1]]
    if element.tag == "connect":
        anchor = file.numbers(element, "anchor", 3, None)
        return [Together(name, "connect", links, (Placement(np.eye(3), anchor), None))]
    pose = file.numbers(element, "relpose", 7, (0.0,) * 7)
    if not np.any(pose[3:]):  # as in the posture of the file
        return [Together(name, "weld", (links[1], links[0]), (Placement(), None))]
    return [Together(name, "weld", links, (Placement(from_quaternion(pose[3:]), pose[:3]), Placement()))]


# Adding to scenes.


def add_actions(builder: RobotBuilder, actions: Actions, postures: Mapping[str, Placement]) -> None:
    """Add actuators and equalities to a scene while it is built.

    `postures` are the places of links in the posture of the file.

    Raises
    ------
    SceneError
        For names of actuators that the file does not have.
    """
    names = [actuator.name for actuator in actions.actuators]
    wanted = builder.actuators
    if not isinstance(wanted, bool):
        unknown = [f"actuated: {unknown_name('actuator', name, names)}" for name in wanted if name not in names]
        if unknown:
            raise SceneError(builder.robot.name, unknown)
    for actuator in actions.actuators:
        if wanted is True or (not isinstance(wanted, bool) and actuator.name in wanted):
            _add_actuator(builder, actuator)
    for coupled in actions.coupled:
        row = _difference(builder, coupled.joint)
        x = _difference(builder, coupled.other) if coupled.other else sp.S.Zero
        row -= sum((number(c) * x**k for k, c in enumerate(coupled.coefficients) if c and (x != 0 or not k)), sp.S.Zero)
        add_constraints(builder.scene, coupled.name, [row])
    for each in actions.together:
        _add_together(builder, each, postures)


def _add_actuator(builder: RobotBuilder, actuator: Actuator) -> None:
    control, value = coordinate(f"ctrl_{actuator.name}"), builder.values[actuator.joint]
    constant, by_value, by_rate = map(number, actuator.bias)
    gear = number(actuator.gear)
    rate = value.diff(dynamicsymbols._t)
    builder.scene.add_inputs(control)
    terms = (number(actuator.gain) * control, constant, by_value * gear * value, by_rate * gear * rate)
    for size in terms:  # each of its own, so that springs have their potential energy
        if size != 0:
            push_joint(builder, actuator.joint, gear * size)


def _difference(builder: RobotBuilder, joint: str) -> sp.Expr:
    """Return the value of a joint from that in the file."""
    zero = next(item.zero for item in builder.joints if item.name == joint)
    return builder.values[joint] - number(zero)


def _add_together(builder: RobotBuilder, each: Together, postures: Mapping[str, Placement]) -> None:
    one, two = each.links
    first = each.places[0]
    second = each.places[1] or _relative(postures[two], postures[one].then(first))
    frames, points, bodies = [], [], []
    for side, link, place in (("1", one, first), ("2", two, second)):
        carrier, _ = builder.carriers[link]
        bodies.append(None if carrier == builder.robot.root else builder.body_for(carrier))
        found = builder.link(link)
        frame = found.frame
        if not np.all(place.rotation == np.eye(3)) and each.kind == "weld":
            frame = ReferenceFrame(f"{each.name} axes {side}")
            frame.orient_explicit(found.frame, matrix(place.rotation))
        frames.append(frame)
        where = vector(found.frame, [number(float(x)) for x in place.position])
        points.append(found.point.locatenew(f"{each.name} point {side}", where))
    if each.kind == "connect":
        closure = Closure(each.name, bodies[0], bodies[1], "ball", points[0], points[1])
    else:
        closure = Closure(
            each.name,
            bodies[0],
            bodies[1],
            "weld",
            points[0],
            points[1],
            parent_frame=frames[0],
            child_frame=frames[1],
        )
    builder.scene.add_joints(closure)


def _relative(place: Placement, other: Placement) -> Placement:
    """Return a place in the world as one on the axes of another."""
    turn: FloatArray = place.rotation.T
    return Placement(turn @ other.rotation, turn @ (other.position - place.position))


def postures(robot: Description, starts: Mapping[str, Placement]) -> dict[str, Placement]:
    """Return the places of all links in the world where the joints have the values of the file.

    `starts` are those of links that are free there.
    """
    found = {"world": Placement()}
    for joint in robot.joints:
        found[joint.child] = starts.get(joint.child) or found[joint.parent].then(joint.place)
    return found
