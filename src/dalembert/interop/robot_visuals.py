"""Shapes of robots for pictures: primitives and meshes of a file, on the axes of the links that carry them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..scene import shape_meshes
from ..scene.shape_meshes import Triangles
from ..scene.shapes import Mesh
from .mesh_files import FORMATS
from .robot_description import Placement

if TYPE_CHECKING:
    from .robot_scenes import RobotBuilder


_WHITE = 0.75
"""Share of all colours from which on a shape has that of its body."""


@final
@frozen(eq=False)
class Visual:
    """A shape of a link.

    Attributes
    ----------
    place : Placement
        Of its axes on those of the link.
    kind : str
        "box", "sphere", "cylinder", "capsule", "ellipsoid" or "mesh".
    size : ndarray
        Edges of a box; radius of a sphere; radius and length along z of a cylinder and of the straight part of a
        capsule; half axes of an ellipsoid; scale (3,) of a mesh.
    source : str
        The file of a mesh, as it is written.
    color : str or None
    """

    place: Placement
    kind: str
    size: FloatArray
    source: str = ""
    color: str | None = None


def color_of(values: Sequence[float]) -> str | None:
    """Return a colour from red, green and blue between 0 and 1; None for what is nearly white, as the picture is."""
    if min(values[:3]) > _WHITE:
        return None
    return "#" + "".join(f"{round(255 * min(max(float(value), 0.0), 1.0)):02x}" for value in values[:3])


def primitive(kind: str, size: FloatArray) -> Triangles:
    """Return the surface of a primitive."""
    z = np.array([0.0, 0.0, 1.0])
    if kind == "box":
        return shape_meshes.box(size)
    if kind == "sphere":
        return shape_meshes.sphere(float(size[0]), 6, 12)
    if kind == "ellipsoid":
        return shape_meshes.sphere(1.0, 6, 12).placed(np.diag(size), np.zeros(3))
    if kind == "cylinder":
        return shape_meshes.cylinder(float(size[0]), float(size[1]), z, 16)
    ball = shape_meshes.sphere(float(size[0]), 7, 12)  # without an equator, at which the halves part
    shift = np.sign(ball.vertices[:, 2:]) * 0.5 * size[1] * z
    return Triangles(ball.vertices + shift, ball.faces)


def add_visuals(builder: RobotBuilder, find: Callable[[str], Path | None]) -> tuple[str, ...]:
    """Add the shapes of all links to the scene, and return what is not drawn, with the reason.

    `find` returns the file of a mesh from what is written.
    """
    undrawn: list[str] = []
    for link, visuals in builder.robot.visuals.items():
        carrier, there = builder.carriers[link]
        at, body = builder.places[carrier], builder.bodies.get(carrier)
        fixed = body is None and builder.rests(carrier)
        if body is None and not fixed:
            undrawn += [f"{visual.kind} of {link!r}, which has no mass" for visual in visuals]
            continue
        meshes = []
        for visual in visuals:
            place = Placement(at.axes, np.zeros(3)).then(there).then(visual.place)
            source, reason = _source(visual, find)
            if reason:
                undrawn.append(f"mesh of {link!r}: {reason}")
                continue
            scale = visual.size if visual.kind == "mesh" else 1.0
            meshes.append(Mesh(source, at.point, visual.color, scale, place.rotation, place.position, fixed))
        if meshes:
            builder.scene.add_shapes({link if body is None else str(body.name): meshes})
    return tuple(undrawn)


def _source(visual: Visual, find: Callable[[str], Path | None]) -> tuple[Any, str]:
    """Return the source of a mesh, or why there is none."""
    if visual.kind != "mesh":
        surface = primitive(visual.kind, visual.size)
        return (surface.vertices, surface.faces), ""
    path = find(visual.source)
    if path is None:
        return None, f"{visual.source!r} is not there"
    known = path.suffix.lower() in FORMATS
    return path, "" if known else f"{path.name!r} has none of the formats {', '.join(FORMATS)}"


def mesh_finder(robot: Path) -> Callable[[str], Path | None]:
    """Return what finds the files that a URDF file names: beside it, or in packages among the folders above it."""
    found: dict[str, Path | None] = {}

    def find(written: str) -> Path | None:
        if written not in found:
            head, _, rest = written.rpartition("://")
            folders = [robot.parent] if head != "package" else list(robot.resolve().parents)
            paths: Iterable[Path] = [folder / rest for folder in folders]
            found[written] = next((path for path in paths if path.is_file()), None)
        return found[written]

    return find
