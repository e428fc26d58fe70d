"""Reading of MJCF files: bodies, joints and inertias of a MuJoCo model, with every fault of a file and its line.

Bodies with several joints become as many links. Actuators and equalities are read by `mjcf_actions`. What a scene has
no part for is named in one error, or left out where the user asks for it by `skip`.
"""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..errors import OptionError, list_names
from ..frozen import frozen
from ..values import listed
from .mjcf_actions import add_actions, postures, read_actions
from .mjcf_meshes import Meshes
from .mjcf_settings import LIMITED, Settings, check_attributes
from .mjcf_values import Defaults, inertia_of_geoms, visual_of
from .robot_description import Description, Inertia, JointItem, Placement, in_tree_order
from .robot_files import Element, FileReader
from .robot_scenes import scene_of
from .robot_values import RobotOptions
from .robot_visuals import Visual

if TYPE_CHECKING:
    from ..scene.scene import Scene

SKIPPABLE = {
    "contacts": "geoms that collide",
    "tendons": "tendons",
    "actuators": "actuators that are no forces of joints",
    "equalities": "equalities other than connect, weld and joint",
    "fluid": "forces of a fluid",
    "sizes": "settings that change masses",
}
"""Names of parts of a file that may be left out of a scene, with their descriptions."""

_IGNORED = ("asset", "visual", "statistic", "size", "sensor", "keyframe", "custom", "deformable", "extension")
_KNOWN = ("compiler", "option", "default", "worldbody", "contact", "equality", "tendon", "actuator", *_IGNORED)
_IN_BODIES = ("body", "joint", "freejoint", "inertial", "geom", "site", "frame", "camera", "light")
_UNSERVED = ("replicate", "composite", "flexcomp", "attach", "plugin", "model")
_KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}


def scene_from_mjcf(path: str | PathLike[str], *, skip: Any, **options: Any) -> Scene:
    """Return the scene of the model of an MJCF file; see `dalembert.Scene.from_mjcf` for the options."""
    chosen = RobotOptions.of(floating_base=False, **options)
    left_out = listed("skip", skip, "names of what to leave out")
    unknown = [name for name in left_out if name not in SKIPPABLE]
    if unknown:
        raise OptionError(f"skip: {list_names(map(repr, unknown))} cannot be left out; known: {list_names(SKIPPABLE)}")
    file = FileReader(path, "mujoco")
    file.include("include")
    reader = MjcfReader(file, tuple(left_out))
    robot, actions = reader.description(), read_actions(reader)
    reader.raise_faults()
    skipped = tuple(SKIPPABLE[kind] for kind in reader.unserved)
    robot = replace(robot, skipped=skipped, visuals=reader.visuals)
    return scene_of(
        robot, chosen, reader.meshes.find, lambda builder: add_actions(builder, actions, postures(robot, reader.starts))
    )


@final
@frozen(eq=False)
class _Around:
    """Where an element stands: its link, the place of its axes there, and the default class."""

    link: str
    place: Placement
    within: str


@final
class MjcfReader:
    """One reading of one file.

    Attributes
    ----------
    file : FileReader
    defaults : Defaults
    settings : Settings
    meshes : Meshes
    bodies : dict of str to str
        Links by the names of the bodies; "world" is the root.
    sites : dict of str to (str, Placement)
        Links and places of sites.
    joints : dict of str to JointItem
        Those that move, by name.
    """

    def __init__(self, file: FileReader, skip: tuple[str, ...]) -> None:
        self.file, self.root, self.skip = file, file.root, skip
        self.unserved: dict[str, list[tuple[int, str]]] = {}
        self.defaults = Defaults(file)
        self.settings = Settings.of(file)
        self.angles = self.settings.angles
        self.meshes = Meshes(file, self.defaults, self.angles)
        for compiler in self.root.all("compiler"):
            for name in ("boundmass", "boundinertia", "balanceinertia"):
                if compiler.attributes.get(name, "0") not in ("0", "false"):
                    self.leave_out("sizes", compiler, f"{name}= of <compiler>")
        self.links: dict[str, Inertia] = {"world": Inertia()}
        self.bodies: dict[str, str] = {"world": "world"}
        self.sites: dict[str, tuple[str, Placement]] = {}
        self.joints: dict[str, JointItem] = {}
        self.labels: dict[str, str] = {}
        self.lifted: dict[str, float] = {}
        self.starts: dict[str, Placement] = {}
        self._edges: list[JointItem] = []
        self._geoms: list[tuple[_Around, Element]] = []

    # -- faults -------------------------------------------------------------------------------------

    def leave_out(self, kind: str, element: Element, what: str) -> None:
        """Record what a scene has no part for."""
        self.unserved.setdefault(kind, []).append((element.line, what))

    def raise_faults(self) -> None:
        """Raise all faults, and what is not supported and not skipped.

        Raises
        ------
        SceneError
        """
        for kind, items in self.unserved.items():
            if kind not in self.skip:
                line, first = items[0]
                more = f" and {len(items) - 1} more" if len(items) > 1 else ""
                self.file.fault(
                    line, f"{SKIPPABLE[kind]} are not supported: {first}{more}; leave them out with skip=[{kind!r}]"
                )
        self.file.raise_faults()

    # -- the tree -----------------------------------------------------------------------------------

    def description(self) -> Description:
        """Return the robot; faults are recorded."""
        self.file.misspelt(self.root, _KNOWN)
        self._refuse_unserved(self.root)
        for option in self.root.all("option"):
            if any(self.file.number(option, what, 0.0) for what in ("density", "viscosity")):
                self.leave_out("fluid", option, "density= or viscosity= of <option>")
        pairs = () if "contact" in self.settings.disabled else self.root.all("contact")
        for pair in (pair for contact in pairs for pair in contact.all("pair")):
            self.leave_out("contacts", pair, "<pair>")
        for tendon in (each for tendons in self.root.all("tendon") for each in tendons):
            self.leave_out("tendons", tendon, f"tendon {self.file.named(tendon)}")
        for world in self.root.all("worldbody"):
            self._inside(world, _Around("world", Placement(), "main"))
        return Description(
            self.root.attributes.get("model", "").strip() or self.file.path.stem,
            "world",
            self.settings.scaled(self.links),
            in_tree_order("world", self._edges),
            self.settings.gravity,
            labels=self.labels,
            has_actuators=True,
            lifted=self.lifted,
        )

    @property
    def visuals(self) -> dict[str, tuple[Visual, ...]]:
        """The shapes of all links, once there are no faults: what they lack is none."""
        found: dict[str, tuple[Visual, ...]] = {}
        for around, geom in self._geoms:
            visual = visual_of(self.file, geom, self.angles, self.meshes, around.place)
            if visual is not None:
                found[around.link] = (*found.get(around.link, ()), visual)
        return found

    def _refuse_unserved(self, element: Element) -> None:
        for child in element:
            if child.tag in _UNSERVED:
                self.file.fault(child, f"<{child.tag}> is not supported: write out what it stands for")

    def _inside(self, element: Element, around: _Around) -> None:
        """Read what stands in the world, in a body after its joints, or in a frame."""
        self.file.misspelt(element, _IN_BODIES)
        self._refuse_unserved(element)
        within = element.attributes.get("childclass", around.within)
        for child in element:
            if child.tag == "frame":
                check_attributes(self.file, child)
                place = around.place.then(self.angles.placement(self.file, child))
                self._inside(child, _Around(around.link, place, within))
            elif child.tag == "body":
                self._body(child, _Around(around.link, around.place, within))
            elif child.tag == "site":
                site = self.defaults.applied(child, within)
                place = around.place.then(self.angles.placement(self.file, site))
                if "name" in site.attributes:
                    self.sites[site.attributes["name"]] = around.link, place
            elif child.tag == "geom":
                geom = self.defaults.applied(child, within)
                self._collision(geom)
                self._geoms.append((around, geom))

    def _collision(self, geom: Element) -> None:
        check_attributes(self.file, geom)
        self.angles.placement(self.file, geom)  # its faults, whether or not it has mass
        if "contact" in self.settings.disabled:
            return
        if any(self.file.number(geom, what, 1.0) for what in ("contype", "conaffinity")):
            self.leave_out("contacts", geom, f"a <geom> with contype= or conaffinity=, {self.file.named(geom)}")

    def _body(self, element: Element, around: _Around) -> None:
        file = self.file
        check_attributes(file, element)
        name = element.attributes.get("name", "").strip() or f"body_{len(self.bodies)}"
        if name in self.bodies:
            file.fault(element, f"a second <body> is called {name!r}")
            name = f"{name}_{len(self.bodies)}"
        if element.attributes.get("mocap", "false") == "true":
            file.fault(element, f"body {name!r} is a mocap body, which is not supported: leave it out")
        share = file.number(element, "gravcomp", 0.0)
        if share:
            self.lifted[name] = share
        within = element.attributes.get("childclass", around.within)
        place = around.place.then(self.angles.placement(file, element))
        link, place = self._chain(element, name, around.link, place, within)
        self.links[name] = self._inertia(element, within)
        axis = np.array([0.0, 0.0, 1.0])  # of no use where nothing moves
        self._edges.append(JointItem(f"{name} mount", "fixed", link, name, place, axis, line=element.line))
        if link != around.link:
            self.labels[link] = name
        self.bodies[name] = name
        self._inside(element, _Around(name, Placement(), within))

    def _chain(self, element: Element, name: str, link: str, place: Placement, within: str) -> tuple[str, Placement]:
        """Add the joints of a body; return the last link that they move, and the place of the body's axes there."""
        file, given = self.file, [child for child in element if child.tag in ("joint", "freejoint")]
        for number, child in enumerate(given, 1):
            joint = self.defaults.applied(child, within) if child.tag == "joint" else child
            check_attributes(file, joint)
            kind = "free" if child.tag == "freejoint" else joint.attributes.get("type", "hinge")
            if kind not in _KINDS:
                file.fault(child, f"type={kind!r} of <joint>: known are {list_names(_KINDS)}")
                continue
            default = f"{name}_joint{number if len(given) > 1 else ''}"
            own = child.attributes.get("name", "").strip() or default
            anchor = Placement(np.eye(3), file.numbers(joint, "pos", 3, (0.0, 0.0, 0.0)))
            if kind == "free":
                if link != "world" or len(given) > 1:
                    file.fault(child, f"the free joint {own!r} must be the only joint of a body of the world")
                self.starts[f"{name} by {own}"] = place
                anchor = place = Placement()
            item = self._joint(joint, own, kind, (link, f"{name} by {own}"), place.then(anchor))
            if own in self.joints:
                file.fault(child, f"a second <joint> is called {own!r}; the first is in line {self.joints[own].line}")
            self.joints[own] = item
            self._edges.append(item)
            link = item.child
            self.links[link] = Inertia()
            place = Placement(np.eye(3), -anchor.position)
        return link, place

    def _joint(self, joint: Element, name: str, kind: str, ends: tuple[str, str], place: Placement) -> JointItem:
        file, turns = self.file, kind in ("hinge", "ball")
        off = self.settings.disabled
        losses = {
            what: 0.0 if flag in off else file.number(joint, what, 0.0)
            for what, flag in (("damping", "damper"), ("frictionloss",) * 2, ("stiffness", "spring"), ("armature", ""))
        }
        if kind in ("ball", "free"):
            for what, value in losses.items():
                if value and (kind, what) != ("ball", "damping"):
                    file.fault(joint, f"{what}= of the {kind} joint {name!r} is not supported; leave it out")
        for what, value in losses.items():
            if value < 0.0:
                file.fault(joint, f"the {what} of joint {name!r} is {value:g}; it may not be less than 0")
        axis = file.numbers(joint, "axis", 3, (0.0, 0.0, 1.0))
        if not np.any(axis):
            file.fault(joint, f"the axis of joint {name!r} has no direction: 0 0 0")
            axis = np.array([0.0, 0.0, 1.0])
        simple = kind in ("hinge", "slide")
        in_angles = (lambda x: float(self.angles.radians(np.array(x)))) if turns else float
        by_range = self.settings.autolimits and "range" in joint.attributes
        limited = LIMITED.get(joint.attributes.get("limited", "auto"), by_range) and "limit" not in off
        lower, upper = file.numbers(joint, "range", 2, (0.0, 0.0)) if simple else (0.0, 0.0)
        return JointItem(
            name,
            _KINDS[kind],
            *ends,
            place,
            axis / float(np.linalg.norm(axis)),
            damping=losses["damping"],
            friction=losses["frictionloss"],
            stiffness=losses["stiffness"],
            armature=losses["armature"],
            reference=in_angles(file.number(joint, "springref", 0.0)),
            zero=in_angles(file.number(joint, "ref", 0.0)),
            lower=in_angles(float(lower)) if limited and simple else None,
            upper=in_angles(float(upper)) if limited and simple else None,
            line=joint.line,
        )

    def _inertia(self, body: Element, within: str) -> Inertia:
        """Return the inertia of a body on its axes, given or from its geoms."""
        file, element = self.file, self.file.only(body, "inertial")
        if self.settings.by_geoms == "true" or (element is None and self.settings.by_geoms == "auto"):
            return self._from_geoms(body, within, Placement())
        if element is None:
            return Inertia()
        check_attributes(file, element)
        mass = file.number(element, "mass", None)
        if mass < 0.0:
            file.fault(element, f"the mass of body {file.named(body)} is {mass:g} kg; it may not be less than 0")
        if "fullinertia" in element.attributes:
            xx, yy, zz, xy, xz, yz = file.numbers(element, "fullinertia", 6, None)
            matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            matrix = np.diag(file.numbers(element, "diaginertia", 3, None))
        return Inertia(mass, np.zeros(3), matrix).on(self.angles.placement(file, element))

    def _from_geoms(self, element: Element, within: str, place: Placement) -> Inertia:
        first, last = self.settings.groups
        geoms = [self.defaults.applied(geom, within) for geom in element.all("geom")]
        geoms = [geom for geom in geoms if first <= self.file.number(geom, "group", 0.0) <= last]
        total = inertia_of_geoms(self.file, geoms, self.angles, self.meshes).on(place)
        for frame in element.all("frame"):
            there = place.then(self.angles.placement(self.file, frame))
            total = total.plus(self._from_geoms(frame, frame.attributes.get("childclass", within), there))
        return total
