"""Values of MJCF files: default classes, orientations, inertias and shapes of geoms."""

from __future__ import annotations

from collections.abc import Iterable
from math import pi
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from .robot_description import Inertia, Placement, clean_rotation
from .robot_files import Element, FileReader
from .robot_visuals import Visual, color_of

if TYPE_CHECKING:
    from .mjcf_meshes import Meshes

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
"""Attributes of which one orients an element."""

PRIMITIVES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
"""Types of geoms that are solids, and how many sizes they have."""

ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion")
"""Tags of actuators: in MuJoCo, defaults of one are defaults of all."""

GAINS = ("kp", "kv", "gainprm", "biasprm", "biastype", "gaintype", "dyntype")
"""Attributes of actuators by which defaults of one tag mean another thing for another tag."""

DENSITY = 1000.0
"""Default density of geoms [kg/m^3]."""

BETWEEN_ENDS = ("capsule", "cylinder", "box", "ellipsoid")
"""Types of geoms and sites that two ends in fromto= may place."""

_SHOWN = 2
"""Last group of geoms that is shown; the others are for collisions."""

_WIDE = 4.0
"""Edge of a plane without end [m]."""


@final
class Defaults:
    """Default classes of a file: attributes by class and tag, those of outer classes included."""

    def __init__(self, file: FileReader) -> None:
        self.file = file
        self._classes: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for element in file.root.all("default"):
            self._read(element, element.attributes.get("class", "main"), self._classes["main"])

    def _read(self, element: Element, name: str, outer: dict[str, dict[str, str]]) -> None:
        table = {tag: dict(attributes) for tag, attributes in outer.items()}
        for child in element:
            if child.tag != "default":
                table[child.tag] = {**table.get(child.tag, {}), **child.attributes}
            if child.tag in ACTUATORS:
                shared = {key: value for key, value in child.attributes.items() if key not in GAINS}
                table["actuator"] = {**table.get("actuator", {}), **shared}
        self._classes[name] = table
        for child in element.all("default"):
            self._read(child, self.file.text(child, "class"), table)

    def applied(self, element: Element, within: str) -> Element:
        """Return an element with the defaults of its class, or of the class of the bodies `within` which it stands."""
        name = element.attributes.get("class", within)
        if name not in self._classes:
            self.file.fault(element, f"class={name!r} of <{element.tag}> is no default class of the file")
            return element
        tables = self._classes[name]
        given = {**tables.get(element.tag, {}), **element.attributes}
        if element.tag in ACTUATORS:
            self._refuse_gains_of_others(tables, element)
            given |= {**tables.get("actuator", {}), **element.attributes}
        for what in ORIENTATIONS:  # an orientation of the element takes the place of that of its class
            if what in element.attributes:
                given = {key: value for key, value in given.items() if key == what or key not in ORIENTATIONS}
        return Element(element.tag, given, element.line, element.children)

    def _refuse_gains_of_others(self, tables: dict[str, dict[str, str]], actuator: Element) -> None:
        gains = [tag for tag in ACTUATORS if tag != actuator.tag and tables.get(tag, {}).keys() & set(GAINS)]
        if gains and actuator.tag != "motor":
            self.file.fault(
                actuator,
                f"<{actuator.tag}> {self.file.named(actuator)} has gains of the defaults of <{gains[0]}>, which is not"
                " supported: put them in a class of their own",
            )


@final
@frozen
class Angles:
    """Convention of angles in a file: degrees or not, and axes of Euler angles; capital letters are fixed axes."""

    degrees: bool = True
    sequence: str = "xyz"

    def radians(self, values: FloatArray) -> FloatArray:
        """Return angles in radians."""
        return np.radians(values) if self.degrees else values

    def placement(self, file: FileReader, element: Element) -> Placement:
        """Return the place of an element by its position and one of the orientations, or by its two ends.

        As in MuJoCo, fromto= places the element at the middle, with z from the second end to the first. It replaces an
        orientation, and a position beside it is a fault.
        """
        place = Placement(self.rotation(file, element), file.numbers(element, "pos", 3, (0.0, 0.0, 0.0)))
        if "fromto" not in element.attributes:
            return place
        named = f"fromto= of <{element.tag}> {file.named(element)}"
        kind = element.attributes.get("type", "sphere")
        if kind not in BETWEEN_ENDS:
            file.fault(element, f"{named} is for the types {', '.join(BETWEEN_ENDS)}, not for {kind!r}: give its pos=")
            return place
        if np.any(place.position):
            file.fault(element, f"{named} is given with a position that is not zero: remove fromto= or pos=")
        ends = file.numbers(element, "fromto", 6, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        if np.array_equal(ends[:3], ends[3:]):
            file.fault(element, f"{named} has no length: its two ends are the same point")
            return place
        return Placement(_turned_to(ends[:3] - ends[3:]), (ends[:3] + ends[3:]) / 2)

    def rotation(self, file: FileReader, element: Element) -> FloatArray:
        """Return the rotation (3, 3) from the axes of an element to those around it."""
        given = [what for what in ORIENTATIONS if what in element.attributes]
        if len(given) > 1:
            file.fault(element, f"<{element.tag}> {file.named(element)} has {' and '.join(given)}; give one of them")
        if not given:
            return np.eye(3)
        what = given[0]
        size = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}[what]
        values = file.numbers(element, what, size, None)
        if not np.any(values[: {"euler": 0}.get(what, size)]) and what != "euler":
            file.fault(element, f"{what} of <{element.tag}> {file.named(element)} has no direction")
            return np.eye(3)
        if what == "quat":
            return from_quaternion(values)
        if what == "axisangle":
            return about(values[:3], float(self.radians(values[3:])[0]))
        if what == "euler":
            return self._euler(self.radians(values))
        if what == "xyaxes":
            x = values[:3] / np.linalg.norm(values[:3])
            y = values[3:] - x * (x @ values[3:])
            y /= np.linalg.norm(y)
            return clean_rotation(np.column_stack([x, y, np.cross(x, y)]))
        return _turned_to(values)

    def _euler(self, values: FloatArray) -> FloatArray:
        total = np.eye(3)
        for letter, value in zip(self.sequence, values, strict=True):
            turn = about(np.eye(3)["xyz".index(letter.lower())], float(value))
            total = total @ turn if letter.islower() else turn @ total
        return clean_rotation(total)


def _turned_to(direction: FloatArray) -> FloatArray:
    """Return the least rotation that turns the z axis to a direction."""
    z = direction / np.linalg.norm(direction)
    axis, cosine = np.cross([0.0, 0.0, 1.0], z), float(z[2])
    sine = float(np.linalg.norm(axis))
    return about(axis if sine > 0.0 else np.array([1.0, 0.0, 0.0]), float(np.arctan2(sine, cosine)))


def about(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation by an angle [rad] about an axis."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return clean_rotation(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def from_quaternion(values: FloatArray) -> FloatArray:
    """Return the rotation of a quaternion, scalar first, of any length."""
    w, *v = values / np.linalg.norm(values)
    x, y, z = v
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return clean_rotation(np.eye(3) + 2.0 * (w * cross + cross @ cross))


# Inertias of geoms.


def inertia_of_geoms(file: FileReader, geoms: Iterable[Element], angles: Angles, meshes: Meshes) -> Inertia:
    """Return the inertia of geoms, with their defaults applied, on the axes around them."""
    total = Inertia()
    for geom in geoms:
        total = total.plus(_inertia_of_geom(file, geom, angles, meshes))
    return total


def _inertia_of_geom(file: FileReader, geom: Element, angles: Angles, meshes: Meshes) -> Inertia:
    kind = geom.attributes.get("type", "sphere")
    mass = None if "mass" not in geom.attributes else file.number(geom, "mass", None)
    density = file.number(geom, "density", DENSITY)
    if mass == 0.0 or (mass is None and density == 0.0) or kind == "plane":
        return Inertia()
    advice = "the mass of a body would follow from {}; give the body an <inertial>"
    if kind == "mesh":
        one, place = meshes.inertia(geom), angles.placement(file, geom)
        if mass is not None and one.mass > 0.0:
            density = mass / one.mass
        return Inertia(density * one.mass, one.centre, density * one.matrix).on(place)
    if geom.attributes.get("shellinertia", "false") == "true":
        file.fault(geom, advice.format("a geom with shellinertia="))
    elif kind in PRIMITIVES and "mesh" in geom.attributes:
        file.fault(geom, advice.format(f"a geom of type {kind!r} that is fitted to a mesh"))
    elif kind not in PRIMITIVES:
        file.fault(geom, advice.format(f"a geom of type {kind!r}"))
    else:
        size, place = primitive_of(file, geom, angles)
        if size:
            volume, moments = _solid(kind, size)
            mass = density * volume if mass is None else mass
            return Inertia(mass, np.zeros(3), mass * np.diag(moments)).on(place)
    return Inertia()


def primitive_of(file: FileReader, geom: Element, angles: Angles) -> tuple[list[float], Placement]:
    """Return the size and the place of a geom that is a primitive; no size where it says too little."""
    kind, place = geom.attributes.get("type", "sphere"), angles.placement(file, geom)
    size, needed = [float(word) for word in geom.attributes.get("size", "").split()], PRIMITIVES[kind]
    if "fromto" in geom.attributes and kind in BETWEEN_ENDS:
        ends = file.numbers(geom, "fromto", 6, None)
        half = float(np.linalg.norm(ends[3:] - ends[:3])) / 2
        size = [*size[:1], half] if needed == 2 else [*(size[:1] * 2), half]
        if half == 0.0:  # a fault of its place
            return [], place
    if len(size) < needed or min(size[:needed], default=0.0) <= 0.0:
        file.fault(geom, f"size= of a <geom> of type {kind!r} must be {needed} positive numbers")
        return [], place
    return size, place


def _solid(kind: str, size: list[float]) -> tuple[float, list[float]]:
    """Return the volume of a solid, and its principal moments of inertia for the mass one."""
    a = size[0]
    if kind == "sphere":
        return 4 / 3 * pi * a**3, [0.4 * a * a] * 3
    if kind in ("box", "ellipsoid"):
        x, y, z = (each**2 for each in size[:3])
        share, volume = (1 / 3, 8.0) if kind == "box" else (0.2, 4 / 3 * pi)
        return volume * size[0] * size[1] * size[2], [share * (y + z), share * (x + z), share * (x + y)]
    half = size[1]
    across = a * a / 4 + half * half / 3
    if kind == "cylinder":
        return 2 * pi * a * a * half, [across, across, a * a / 2]
    tube, ball = 2 * pi * a * a * half, 4 / 3 * pi * a**3
    volume = tube + ball
    ends = 0.4 * a * a + half * half + 0.75 * half * a
    side = (tube * across + ball * ends) / volume
    return volume, [side, side, (tube * a * a / 2 + ball * 0.4 * a * a) / volume]


def visual_of(file: FileReader, geom: Element, angles: Angles, meshes: Meshes, around: Placement) -> Visual | None:
    """Return the shape of a geom with its defaults applied, on the axes of a link; None for one that is not shown."""
    kind = geom.attributes.get("type", "mesh" if "mesh" in geom.attributes else "sphere")
    if file.number(geom, "group", 0.0) > _SHOWN:
        return None
    color = color_of(file.numbers(geom, "rgba", 4, None).tolist()) if "rgba" in geom.attributes else None
    if kind in PRIMITIVES and "mesh" not in geom.attributes:
        size, place = primitive_of(file, geom, angles)
        if not size:
            return None
        numbers = np.array(size[: PRIMITIVES[kind]])
        numbers[{"box": 0, "cylinder": 1, "capsule": 1}.get(kind, 3) :] *= 2.0  # files have half edges
        return Visual(around.then(place), kind, numbers, color=color)
    place = around.then(angles.placement(file, geom))
    if kind == "plane":
        half = [float(word) for word in geom.attributes.get("size", "0 0").split()[:2]]
        edges = [2.0 * each if each > 0.0 else _WIDE for each in half]
        return Visual(place, "box", np.array([*edges, 1e-6 * max(edges)]), color=color)
    name = geom.attributes.get("mesh", f"a geom of type {kind}")
    return Visual(place.then(meshes.place(name)), "mesh", np.ones(3), name, color)
