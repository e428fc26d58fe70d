"""Settings of MJCF files that hold for all of it: <compiler>, <option> and its flags; attributes that are known.

What an attribute changes is read, does not change motions, or is a fault: nothing is passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import final

from ..frozen import frozen
from .mjcf_values import ORIENTATIONS, Angles
from .robot_description import Inertia
from .robot_files import Element, FileReader

LIMITED = {"true": True, "1": True, "false": False, "0": False}
"""Values of attributes that say whether there are limits, and what they mean."""

_SOFT = ("solref", "solimp", "solreflimit", "solimplimit", "solreffriction", "solimpfriction", "solmix")
_TOUCH = (*_SOFT, "margin", "gap")
_COMMON = ("name", "class", "group", "user")
_PLACE = ("pos", *ORIENTATIONS)
_CLIPPED = ("ctrlrange", "ctrllimited", "forcerange", "forcelimited", "actlimited", "actrange", "lengthrange")
_ACTUATOR = (*_COMMON, *_CLIPPED, "joint", "jointinparent", "gear", "inheritrange")

KNOWN = {
    "compiler": (
        *("alignfree", "angle", "assetdir", "autolimits", "balanceinertia", "boundinertia", "boundmass", "conflict"),
        *("convexhull", "coordinate", "discardvisual", "eulerseq", "exactmeshinertia", "fitaabb", "fusestatic"),
        *("inertiafromgeom", "inertiagrouprange", "meshdir", "passthrough", "savecanonical", "savecompiled"),
        *("saveinertial", "settotalmass", "strippath", "texturedir", "usethread"),
    ),
    "option": (
        *("actuatorgroupdisable", "apirate", "ccd_iterations", "ccd_tolerance", "collision", "cone", "density"),
        *("gravity", "impratio", "integrator", "iterations", "jacobian", "ls_iterations", "ls_tolerance", "magnetic"),
        *("mpr_iterations", "mpr_tolerance", "noslip_iterations", "noslip_tolerance", "o_friction", "o_margin"),
        *("o_solimp", "o_solref", "sdf_initpoints", "sdf_iterations", "sleep_tolerance", "solver", "timestep"),
        *("tolerance", "viscosity", "wind"),
    ),
    "flag": (
        *("actuation", "autoreset", "clampctrl", "constraint", "contact", "damper", "diagexact", "energy", "equality"),
        *("eulerdamp", "filterparent", "frictionloss", "fwdinv", "gravity", "invdiscrete", "ipc", "island", "limit"),
        *("midphase", "multiccd", "nativeccd", "override", "passive", "refsafe", "sensor", "sleep", "speculative"),
        *("spring", "warmstart"),
    ),
    "body": ("name", "childclass", "mocap", "gravcomp", "user", "sleep", *_PLACE),
    "frame": ("name", "childclass", *_PLACE),
    "inertial": ("mass", "diaginertia", "fullinertia", *_PLACE),
    "joint": (
        *(*_COMMON, *_TOUCH, "type", "pos", "axis", "range", "limited", "ref", "springref", "damping", "frictionloss"),
        *("stiffness", "armature", "actuatorfrclimited", "actuatorfrcrange", "actuatorgravcomp"),
    ),
    "freejoint": (*_COMMON, "align"),
    "geom": (
        *(*_COMMON, *_TOUCH, *_PLACE, "type", "size", "fromto", "mass", "density", "contype", "conaffinity", "rgba"),
        *("mesh", "material", "condim", "friction", "priority", "hfield", "fluidcoef", "fluidshape", "castshadow"),
        *("adhesion", "surfacevel", "fitscale", "shellinertia"),
    ),
    "mesh": (
        *("name", "class", "content_type", "file", "vertex", "face", "normal", "texcoord", "scale", "inertia"),
        *("refpos", "refquat", "smoothnormal", "maxhullvert", "material", "octree_maxdepth", "needsdf"),
    ),
    "general": (*_ACTUATOR, "gainprm", "biasprm", "biastype", "gaintype", "dyntype", "dynprm"),
    "motor": _ACTUATOR,
    "position": (*_ACTUATOR, "kp", "kv"),
    "velocity": (*_ACTUATOR, "kv"),
}
"""Attributes by tag that are read, or that change no motion of a scene: those of contacts, of a solver, of pictures."""


def unread(element: Element) -> list[str]:
    """Return the attributes of an element that may change its motion, and are not read."""
    return [name for name in element.attributes if name not in KNOWN[element.tag]]


def check_attributes(file: FileReader, element: Element) -> None:
    """Record the attributes of an element that may change its motion, and are not read."""
    for name in unread(element):
        file.fault(element, f"{name}= of <{element.tag}> {file.named(element)} is not supported: leave it out")


@final
@frozen
class Settings:
    """Settings of a file.

    Attributes
    ----------
    angles : Angles
    by_geoms : str
        Whether inertias come from geoms: "true", "false" or "auto".
    groups : (int, int)
        Groups of geoms that do.
    autolimits : bool
        Whether a range is a limit.
    total_mass : float or None
        What masses are scaled to [kg].
    gravity : (float, float, float)
        Its acceleration [m/s^2].
    disabled : frozenset of str
        Flags that are off, with those that "constraint" and "passive" stand for.
    """

    angles: Angles
    by_geoms: str
    groups: tuple[int, int]
    autolimits: bool
    total_mass: float | None
    gravity: tuple[float, float, float]
    disabled: frozenset[str]

    @classmethod
    def of(cls, file: FileReader) -> Settings:
        """Read the settings of a file; faults are recorded."""
        compiler = Element("compiler", {}, 0)
        for element in file.root.all("compiler"):
            check_attributes(file, element)
            compiler.line = element.line
            compiler.attributes |= element.attributes
        sequence = compiler.attributes.get("eulerseq", "xyz")
        if len(sequence) != 3 or not set(sequence) <= set("xyzXYZ"):
            file.fault(compiler, f"eulerseq={sequence!r} of <compiler> must be three of the letters x, y, z, X, Y, Z")
            sequence = "xyz"
        if compiler.attributes.get("coordinate", "local") != "local":
            file.fault(compiler, "coordinate= of <compiler> must be 'local', as in MuJoCo since its version 2.3.4")
        first, last = file.numbers(compiler, "inertiagrouprange", 2, (0.0, 5.0))
        total = file.number(compiler, "settotalmass", -1.0)
        disabled = frozenset(_disabled(file))
        gravity = (0.0, 0.0, -9.81)
        for option in file.root.all("option"):
            x, y, z = file.numbers(option, "gravity", 3, gravity)
            gravity = float(x), float(y), float(z)
        return cls(
            Angles(compiler.attributes.get("angle", "degree") != "radian", sequence),
            compiler.attributes.get("inertiafromgeom", "auto"),
            (int(first), int(last)),
            LIMITED.get(compiler.attributes.get("autolimits", "true"), True),
            total if total > 0.0 else None,
            (0.0, 0.0, 0.0) if "gravity" in disabled else gravity,
            disabled,
        )

    def scaled(self, links: dict[str, Inertia]) -> dict[str, Inertia]:
        """Return inertias, scaled to the total mass where there is one."""
        mass = sum(inertia.mass for inertia in links.values())
        if self.total_mass is None or mass <= 0.0:
            return links
        share = self.total_mass / mass
        return {name: replace(each, mass=each.mass * share, matrix=each.matrix * share) for name, each in links.items()}


_GROUPS = {"constraint": ("equality", "frictionloss", "limit", "contact"), "passive": ("spring", "damper")}
"""Flags that stand for others."""


def _disabled(file: FileReader) -> Iterator[str]:
    for option in file.root.all("option"):
        check_attributes(file, option)
        if option.attributes.get("actuatorgroupdisable", "").strip():
            file.fault(option, "actuatorgroupdisable= of <option> is not supported: leave these actuators out")
        for flag in option.all("flag"):
            check_attributes(file, flag)
            for name, value in flag.attributes.items():
                if value == "disable":
                    yield from (name, *_GROUPS.get(name, ()))
