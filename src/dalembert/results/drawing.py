"""Pictures of motions as surfaces, lines and points over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import FileWarning, OptionError, UnknownNameError, list_names, warn_caller
from ..interop.mesh_files import read_mesh
from ..scene import shape_meshes
from ..scene.shapes import (
    Box,
    Cylinder,
    Disk,
    Ground,
    Mesh,
    Path,
    Rod,
    Shape,
    Sphere,
    Spring,
    force_values,
    length_value,
    vector_value,
)
from ..stops.segments import Constants, constants_at
from .drawn_parts import Drawing, Frames, Line, Surface, Undrawn, undrawn

if TYPE_CHECKING:
    from ..mechanics.skeleton import Skeleton
    from ..scene import Scene
    from .trajectory import Trajectory

BODY_COLORS = (
    "#1f77b4",
    "#ff7f0e",
    "#2ca02c",
    "#d62728",
    "#9467bd",
    "#8c564b",
    "#e377c2",
    "#7f7f7f",
    "#bcbd22",
    "#17becf",
)
_AXIS_COLORS = ("#d62728", "#2ca02c", "#1f77b4")
_GREY, _GROUND, _ARROW = "#595959", "#c8c8c8", "#d62728"
_FLAT = 1e-9
_MOST_VERTICES = 400
"""Vertices of a mesh of a file: those of every picture are on a page."""


def triangles_of(name: str, shape: Mesh) -> shape_meshes.Triangles:
    """Return the surface of a mesh on the axes of its body, or of the scene for one that is fixed."""
    if isinstance(shape.source, str | PathLike):
        found = read_mesh(shape.source, name).thinned(_MOST_VERTICES)
    else:
        vertices, faces = shape.source
        found = shape_meshes.Triangles(np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.intp))
    return found.placed(*shape.rigid)


def shape_points(scene: Scene) -> list[Any]:
    """Return the points that shapes of a scene need."""
    found = [getattr(shape, name, None) for _, shape in scene.shapes for name in ("at", "start", "end", "point")]
    return [point for point in found if point is not None]


def drawing_of(
    frames: Frames,
    scene: Scene,
    drawn: Skeleton,
    constants: Constants,
    values: Mapping[str, float],
    reactions: bool,
) -> Drawing:
    """Return the pictures of a motion.

    Parameters
    ----------
    constants : ndarray (n_c,), or the constants of segments
    values : mapping of str to float
        Parameters by name.
    reactions : bool
        Whether to draw the forces of joints whose components the motion has.

    Raises
    ------
    OptionError
        For shapes of bodies that do not exist, lengths that are no positive numbers, and reactions that are no
        outputs.
    """
    motion = frames.motion
    positions, axes = drawn.at(motion.elapsed, motion.q, constants_at(constants, motion.elapsed))
    along = frames.paths
    traced, _ = drawn.at(along.elapsed, along.q, constants_at(constants, along.elapsed))
    low, high = traced.min(axis=(0, 1)), traced.max(axis=(0, 1))
    extent = float(np.max(high - low))
    builder = _Builder(scene, drawn, positions, traced, axes, values, extent or 1.0)
    spheres = [(name, shape) for name, shape in scene.shapes if isinstance(shape, Sphere)]
    for name, shape in scene.shapes:
        if not isinstance(shape, Sphere):
            builder.add(name, shape)
    flat = [i for i in _flat_axes(*builder.bounds()) if all(builder.turns_about(name, i) for name, _ in spheres)]
    builder.normal = flat[0] if flat else None
    for name, shape in spheres:
        builder.add(name, shape)
    builder.add_skeleton(undrawn(scene, drawn))
    if scene.robot is not None and scene.robot.undrawn:
        text = "; ".join(scene.robot.undrawn)
        warn_caller(f"scene {scene.name!r}: pictures are without {text}", FileWarning)
    if reactions:
        builder.add_reactions(motion)
    low, high = builder.bounds()
    reach = 0.12 * float(np.max(high - low)) or 0.1
    plane = tuple(i for i in range(3) if i != builder.normal)
    surfaces, lines = tuple(builder.surfaces), tuple(builder.lines)
    return Drawing(motion.t, surfaces, lines, low - reach, high + reach, plane, frames.reached)


def checked_body(name: str, bodies: Sequence[str]) -> int:
    """Return the number of the body that a shape is of.

    Raises
    ------
    OptionError
        Where no body has that name.
    """
    if name not in bodies:
        raise OptionError(
            f"shape {name!r}: no body is called so; the bodies are {list_names(bodies)}. Rods, springs,"
            " paths and grounds may have any name"
        )
    return bodies.index(name)


def _flat_axes(low: FloatArray, high: FloatArray) -> list[int]:
    """Return the axes along which nothing is apart, the last first."""
    extent = high - low
    return [i for i in (2, 1, 0) if extent[i] <= _FLAT * max(float(np.max(extent)), _FLAT)]


class _Builder:
    """Surfaces and lines of one picture under construction."""

    def __init__(
        self,
        scene: Scene,
        drawn: Skeleton,
        positions: FloatArray,
        traced: FloatArray,
        axes: FloatArray,
        values: Mapping[str, float],
        extent: float,
    ) -> None:
        self.scene, self.drawn, self.positions, self.traced, self.axes = scene, drawn, positions, traced, axes
        self.values, self.extent = values, extent
        self.surfaces: list[Surface] = []
        self.lines: list[Line] = []
        self.normal: int | None = None  # of the plane of a motion in a plane, where spheres are drawn as circles

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the corners (3,) of what moves."""
        moving = [surface.vertices for surface in self.surfaces if not surface.at_rest]
        found = [(x.min(axis=(0, 1)), x.max(axis=(0, 1))) for x in (self.positions, self.traced, *moving)]
        low, high = np.array([low for low, _ in found]), np.array([high for _, high in found])
        return np.asarray(low.min(axis=0), float), np.asarray(high.max(axis=0), float)

    def turning(self, body: int) -> FloatArray:
        """Return the axes (n_t, 3, 3) of a body, one a row; those of the scene for one without a frame."""
        if body in self.drawn.framed:
            return np.asarray(self.axes[:, self.drawn.framed.index(body)])
        return np.broadcast_to(np.eye(3), (len(self.positions), 3, 3))

    def turns_about(self, name: str, axis: int) -> bool:
        """Return whether a body only turns about an axis of the scene, if at all."""
        fixed = self.turning(self.body(name))[:, :, axis]
        return bool(np.max(np.abs(fixed - fixed[0])) <= _FLAT)

    def color(self, body: int) -> str:
        """Return the colour of a body."""
        return BODY_COLORS[body % len(BODY_COLORS)]

    def number(self, expression: Any, name: str) -> float:
        """Return a length as a number."""
        return length_value(expression, self.values, name)

    def vector(self, vector: Any, frame: Any, name: str) -> FloatArray:
        """Return a vector that is fixed in a frame as numbers (3,)."""
        return vector_value(vector, frame, self.values, name)

    def point(self, point: Any) -> FloatArray:
        """Return the positions (n_t, 3) of a point of the skeleton."""
        return np.asarray(self.positions[:, self.drawn.points.index(point.name)])

    def body(self, name: str) -> int:
        """Return the number of a body."""
        return checked_body(name, self.drawn.bodies)

    def add(self, name: str, shape: Shape) -> None:
        """Add a shape."""
        if isinstance(shape, Rod):
            ends = np.stack([self.point(shape.start), self.point(shape.end)], axis=1)
            self.lines.append(Line("", shape.color or _GREY, ends, 5.0))
        elif isinstance(shape, Spring):
            radius = 0.04 * self.extent if shape.radius is None else self.number(shape.radius, name)
            helix = shape_meshes.coil(self.point(shape.start), self.point(shape.end), radius, shape.coils)
            self.lines.append(Line("", shape.color or _GREY, helix, 1.2))
        elif isinstance(shape, Path):
            path = self.traced[:, self.drawn.points.index(shape.point.name)]
            self.lines.append(Line("", shape.color or _GREY, path, 1.0))
        elif isinstance(shape, Ground):
            self._ground(name, shape)
        else:
            self._on_body(name, shape)

    def _ground(self, name: str, shape: Ground) -> None:
        normal = self.vector(shape.normal, self.scene.frame, name)
        size = 1.5 * self.extent if shape.size is None else self.number(shape.size, name)
        mesh = shape_meshes.square(size, normal)
        at = np.zeros(3) if shape.at is None else self.point(shape.at)[0]
        if shape.size is None:
            middle = 0.5 * (self.positions.min(axis=(0, 1)) + self.positions.max(axis=(0, 1)))
            unit = normal / np.linalg.norm(normal)
            at = middle - unit * float(np.dot(middle - at, unit))
        self.surfaces.append(Surface(name, shape.color or _GROUND, (mesh.vertices + at)[np.newaxis], mesh.faces, 0.35))

    def _on_body(self, name: str, shape: Sphere | Disk | Box | Cylinder | Mesh) -> None:
        if isinstance(shape, Mesh) and shape.fixed:
            mesh, at = triangles_of(name, shape), np.zeros(3) if shape.at is None else self.point(shape.at)[0]
            still = (mesh.vertices + at)[np.newaxis]
            self.surfaces.append(Surface(name, shape.color or _GREY, still, mesh.faces, 0.6))
            return
        body = self.body(name)
        frame = getattr(self.scene.bodies[body], "frame", self.scene.frame)
        turned = self.turning(body)
        if isinstance(shape, Sphere) and self.normal is not None:
            mesh = shape_meshes.disk(self.number(shape.radius, name), turned[0, :, self.normal])
        elif isinstance(shape, Sphere):
            mesh = shape_meshes.sphere(self.number(shape.radius, name))
        elif isinstance(shape, Disk):
            mesh = shape_meshes.disk(self.number(shape.radius, name), self.vector(shape.axis, frame, name))
        elif isinstance(shape, Box):
            mesh = shape_meshes.box(np.array([self.number(edge, name) for edge in (shape.x, shape.y, shape.z)]))
        elif isinstance(shape, Mesh):
            mesh = triangles_of(name, shape)
        else:
            axis = self.vector(shape.axis, frame, name)
            mesh = shape_meshes.cylinder(self.number(shape.radius, name), self.number(shape.length, name), axis)
        centre = self.positions[:, body] if shape.at is None else self.point(shape.at)
        color = shape.color or self.color(body)

        def placed(local: FloatArray) -> FloatArray:
            return np.asarray(centre[:, np.newaxis] + local @ turned)

        self.surfaces.append(Surface(name, color, placed(mesh.vertices), mesh.faces, 0.6))
        self.lines += [Line("", color, placed(mark), 1.2) for mark in mesh.marks]

    def add_skeleton(self, left: Undrawn) -> None:
        """Add the mass centres of bodies, points, and paths, links and axes that no shape replaces."""
        drawn, count = self.drawn, len(self.drawn.bodies)
        for i in left.paths:
            self.lines.append(Line("", self.color(i), self.traced[:, i], 1.0))
        for link in left.links:
            self.lines.append(Line("", _GREY, self.positions[:, list(link)], 2.0))
        for i, name in enumerate(drawn.bodies):
            self.lines.append(Line(name, self.color(i), self.positions[:, i : i + 1], 0.0))
        if len(drawn.points) > count:
            self.lines.append(Line("", _GREY, self.positions[:, count:], 0.0))
        size = 0.07 * self.extent
        for body, frame in zip(drawn.framed, np.moveaxis(self.axes, 1, 0), strict=True):
            if body not in left.axes:
                continue
            for axis, color in enumerate(_AXIS_COLORS):
                start = self.positions[:, body]
                self.lines.append(Line("", color, np.stack([start, start + size * frame[:, axis]], axis=1), 1.2))

    def add_reactions(self, motion: Trajectory) -> None:
        """Add the forces of joints, the largest a third of the picture long."""
        forces = [(joint, self._force(joint, motion)) for joint in self.scene.joints if joint.force != 0]
        if not forces:
            raise OptionError("reactions=True needs joints with forces; this scene has none")
        largest = max(float(np.nanmax(np.linalg.norm(force, axis=1))) for _, force in forces) or 1.0
        for joint, force in forces:
            start = self.point(joint.at)
            ends = np.stack([start, start + force * (0.33 * self.extent / largest)], axis=1)
            self.lines.append(Line(f"force of {joint.name}", _ARROW, ends, 2.5))

    def _force(self, joint: Any, motion: Trajectory) -> FloatArray:
        """Return the force of a joint (n_t, 3) on the frame of the scene."""
        known = partial(self._known, joint.name, motion)
        return force_values(joint.force, self.scene.frame, self.values, motion.elapsed, known)

    @staticmethod
    def _known(joint: str, motion: Trajectory, key: Any) -> FloatArray:
        try:
            return motion[key]
        except UnknownNameError:
            raise OptionError(
                f"reactions=True needs the force of joint {joint!r}, and this motion has no {str(key)!r}: request it"
                f" with compile_model(scene, outputs=[{str(key)!r}, ...])"
            ) from None
