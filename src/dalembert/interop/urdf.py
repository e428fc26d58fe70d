"""Reading of URDF files: links, joints, limits, dynamics, mimics and shapes, with every fault of a file and its line.

Colliding geometry, transmissions, sensors and the extensions of simulators are ignored: the equations of motion do not
depend on them. Tags that look like a misspelt tag of a joint or link are faults.
"""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from .robot_description import Description, Inertia, JointItem, Mimic, Placement, from_angles, in_tree_order
from .robot_files import Element, FileReader
from .robot_scenes import scene_of
from .robot_values import RobotOptions
from .robot_visuals import Visual, color_of, mesh_finder

if TYPE_CHECKING:
    from ..scene.scene import Scene

KINDS = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "planar": "planar",
    "floating": "floating",
}
"""Types of joints of URDF, and the kinds that they are."""

_OF_JOINTS = ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic", "safety_controller", "calibration")
_OF_LINKS = ("inertial", "visual", "collision")
_OF_INERTIALS = ("origin", "mass", "inertia")


def scene_from_urdf(path: str | PathLike[str], **options: Any) -> Scene:
    """Return the scene of the robot of a URDF file; see `dalembert.Scene.from_urdf` for the options."""
    chosen = RobotOptions.of(**options)
    return scene_of(read_urdf(path), chosen, mesh_finder(Path(path)))


def read_urdf(path: str | PathLike[str]) -> Description:
    """Return the robot of a URDF file.

    Raises
    ------
    SceneError
        With every fault of the file and its line.
    """
    return _UrdfReader(FileReader(path, "robot")).description()


@final
class _UrdfReader:
    """One reading of one file."""

    def __init__(self, file: FileReader) -> None:
        self.file, self.root = file, file.root

    def description(self) -> Description:
        """Return the robot; all faults are raised together."""
        file = self.file
        file.misspelt(self.root, ("link", "joint"))
        for element in self.root:
            if element.tag.startswith("xacro:"):
                file.fault(element, f"<{element.tag}> is no URDF: expand the file with xacro first")
        links = file.unique(self.root.all("link"))
        inertias = {name: self._inertia(element) for name, element in links.items()}
        joints = [self._joint(element, links) for element in file.unique(self.root.all("joint")).values()]
        if not links:
            file.fault(self.root, "the robot has no links")
        self._mimics(joints)
        root = self._root(links, joints)
        file.raise_faults()
        name = self.root.attributes.get("name", "").strip() or file.path.stem
        visuals = {name: tuple(self._visuals(element)) for name, element in links.items()}
        return Description(name, root, inertias, in_tree_order(root, joints), visuals=visuals)

    # -- links --------------------------------------------------------------------------------------

    def _inertia(self, link: Element) -> Inertia:
        """Return the inertia of a link on its axes."""
        file = self.file
        file.misspelt(link, _OF_LINKS)
        element = file.only(link, "inertial")
        if element is None:
            return Inertia()
        file.misspelt(element, _OF_INERTIALS)
        mass_element = file.only(element, "mass", needed=True)
        mass = file.number(mass_element, "value", None)
        if mass < 0.0:
            file.fault(
                mass_element or element,
                f"the mass of link {file.named(link)} is {mass:g} kg; it may not be less than 0",
            )
        moments = file.only(element, "inertia", needed=True)
        xx, xy, xz, yy, yz, zz = (
            file.number(moments, f"i{axes}", None) for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
        )
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        place = self._place(file.only(element, "origin"))
        return Inertia(mass, np.zeros(3), matrix).on(place)

    def _visuals(self, link: Element) -> Iterator[Visual]:
        """Yield the shapes of a link; those that say too little are no faults, because no equation depends on them."""
        for element in link.all("visual"):
            place, color = self._place(self.file.only(element, "origin")), self._color(element)
            for shape in (child for geometry in element.all("geometry") for child in geometry):
                given = shape.attributes
                if shape.tag == "mesh":
                    scale = self.file.numbers(shape, "scale", 3, (1.0, 1.0, 1.0))
                    yield Visual(place, "mesh", scale, given.get("filename", ""), color)
                elif shape.tag == "box":
                    yield Visual(place, "box", self.file.numbers(shape, "size", 3, None), color=color)
                elif shape.tag in ("cylinder", "sphere", "capsule"):
                    names = ("radius",) if shape.tag == "sphere" else ("radius", "length")
                    size = np.array([self.file.number(shape, name, None) for name in names])
                    yield Visual(place, shape.tag, size, color=color)

    def _color(self, visual: Element) -> str | None:
        """Return the colour of a shape, which may be said once for all of the same material."""
        for material in visual.all("material"):
            named = [each for each in self.root.all("material") if self.file.named(each) == self.file.named(material)]
            for color in (color for each in (material, *named) for color in each.all("color")):
                return color_of(self.file.numbers(color, "rgba", 4, (0.5, 0.5, 0.5, 1.0)).tolist())
        return None

    def _place(self, origin: Element | None) -> Placement:
        """Return the place of an <origin>, which may be left out."""
        angles = self.file.numbers(origin, "rpy", 3, (0.0, 0.0, 0.0))
        return Placement(from_angles(*angles), self.file.numbers(origin, "xyz", 3, (0.0, 0.0, 0.0)))

    # -- joints -------------------------------------------------------------------------------------

    def _joint(self, element: Element, links: dict[str, Element]) -> JointItem:
        file, name = self.file, element.attributes.get("name", "").strip()
        file.misspelt(element, _OF_JOINTS)
        given = file.text(element, "type", allowed=tuple(KINDS))
        ends = [self._end(element, tag, links) for tag in ("parent", "child")]
        limit, dynamics = file.only(element, "limit"), file.only(element, "dynamics")
        lower, upper = self._limits(element, limit, given)
        losses = [file.number(dynamics, what, 0.0) for what in ("damping", "friction")]
        for what, value in zip(("damping", "friction"), losses, strict=True):
            if value < 0.0:
                file.fault(dynamics or element, f"the {what} of joint {name!r} is {value:g}; it may not be less than 0")
        kind = KINDS.get(given, "fixed")
        return JointItem(
            name,
            kind,
            ends[0],
            ends[1],
            self._place(file.only(element, "origin")),
            self._axis(element) if kind in ("revolute", "prismatic", "planar") else np.array([1.0, 0.0, 0.0]),
            damping=losses[0],
            friction=losses[1],
            lower=lower,
            upper=upper,
            effort=self._optional(limit, "effort"),
            velocity=self._optional(limit, "velocity"),
            mimic=self._mimic(element) if kind != "fixed" else None,
            line=element.line,
        )

    def _end(self, joint: Element, tag: str, links: dict[str, Element]) -> str:
        """Return the name of a link that a joint connects."""
        element = self.file.only(joint, tag, needed=True)
        name = "" if element is None else self.file.text(element, "link")
        if element is not None and name and name not in links:
            self.file.fault(element, f"the {tag} of joint {self.file.named(joint)} is {name!r}, which is no link")
        return name

    def _axis(self, joint: Element) -> FloatArray:
        """Return the unit axis of a joint, (1, 0, 0) by default."""
        element = self.file.only(joint, "axis")
        axis = self.file.numbers(element, "xyz", 3, (1.0, 0.0, 0.0))
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            self.file.fault(element or joint, f"the axis of joint {self.file.named(joint)} has no direction: 0 0 0")
            return np.array([1.0, 0.0, 0.0])
        return axis / length

    def _optional(self, limit: Element | None, what: str) -> float | None:
        given = limit is not None and what in limit.attributes
        return self.file.number(limit, what, 0.0) if given else None

    def _limits(self, joint: Element, limit: Element | None, kind: str) -> tuple[float | None, float | None]:
        """Return the limits of a joint; revolute and prismatic ones have them, 0 where one is not said."""
        if kind not in ("revolute", "prismatic") or limit is None:
            return None, None
        lower, upper = self.file.number(limit, "lower", 0.0), self.file.number(limit, "upper", 0.0)
        if lower > upper:
            text = f"the lower limit {lower:g} of joint {self.file.named(joint)} lies above the upper, {upper:g}"
            self.file.fault(limit, text)
        given = {"lower", "upper"} & set(limit.attributes)
        return (lower, upper) if given else (None, None)

    def _mimic(self, joint: Element) -> Mimic | None:
        element = self.file.only(joint, "mimic")
        if element is None:
            return None
        numbers = self.file.number(element, "multiplier", 1.0), self.file.number(element, "offset", 0.0)
        return Mimic(self.file.text(element, "joint"), *numbers)

    # -- the whole ----------------------------------------------------------------------------------

    def _mimics(self, joints: list[JointItem]) -> None:
        """Record mimics of joints that are not there, have several coordinates, or follow themselves."""
        table = {joint.name: joint for joint in joints}
        simple = ("revolute", "prismatic")
        for joint in joints:
            if joint.mimic is None:
                continue
            followed, seen = joint.mimic.joint, [joint.name]
            if joint.kind not in simple:
                self.file.fault(joint.line, f"joint {joint.name!r} has several coordinates, and cannot mimic another")
            elif followed and (followed not in table or table[followed].kind not in simple):
                what = "is no joint of the robot" if followed not in table else "has not one coordinate"
                self.file.fault(joint.line, f"joint {joint.name!r} mimics {followed!r}, which {what}")
            while followed in table and followed not in seen:
                seen.append(followed)
                follows = table[followed].mimic
                followed = "" if follows is None else follows.joint
            if followed == joint.name:
                self.file.fault(joint.line, f"joint {joint.name!r} mimics itself: {' -> '.join([*seen, followed])}")

    def _root(self, links: dict[str, Element], joints: list[JointItem]) -> str:
        """Return the link that no joint leads to; everything must hang on it, by one joint each."""
        leading: dict[str, JointItem] = {}
        for joint in joints:
            if joint.child in leading:
                first = leading[joint.child]
                self.file.fault(
                    joint.line,
                    f"joints {first.name!r} (line {first.line}) and {joint.name!r} both lead to link {joint.child!r}:"
                    " URDF describes trees; close the loop with da.Closure in the scene",
                )
            elif joint.child:
                leading[joint.child] = joint
        roots = [name for name in links if name not in leading]
        if links and not roots:
            self.file.fault(self.root, "every link hangs on another: the joints form a loop, and no link is the root")
        for name in roots[1:]:
            self.file.fault(links[name], f"link {name!r} hangs on no joint, and neither does the root {roots[0]!r}")
        if len(roots) == 1:
            reached = {roots[0]} | {joint.child for joint in in_tree_order(roots[0], list(leading.values()))}
            for name, element in links.items():
                if name not in reached:
                    self.file.fault(element, f"link {name!r} hangs on itself through its joints, not on {roots[0]!r}")
        return roots[0] if roots else ""
