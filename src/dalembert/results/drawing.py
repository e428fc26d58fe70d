"""Pictures of motions as surfaces, lines and points over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, list_names
from ..scene.shapes import (
    BODY_SHAPES,
    Box,
    Cylinder,
    Disk,
    Ground,
    Path,
    Rod,
    Shape,
    Sphere,
    Spring,
    force_values,
    length_value,
    vector_value,
)
from . import shape_meshes

if TYPE_CHECKING:
    from ..mechanics.skeleton import Skeleton
    from ..scene import Scene
    from .trajectory import Trajectory

_COLORS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf")
_AXIS_COLORS = ("#d62728", "#2ca02c", "#1f77b4")
_GREY, _GROUND, _ARROW = "#595959", "#c8c8c8", "#d62728"
_FLAT = 1e-9


@final
@dataclass(frozen=True, eq=False)
class Line:
    """A line, or points, over time.

    Attributes
    ----------
    name : str
        Text in the legend; empty without an entry.
    color : str
    points : ndarray (n_t, k, 3), or (n_t, 3) for the path of a point
    width : float
        Of the line [points]; 0 for dots.
    """

    name: str
    color: str
    points: FloatArray
    width: float

    @property
    def is_path(self) -> bool:
        """Whether this is the path of a point."""
        return self.points.ndim == 2

    @property
    def at_rest(self) -> bool:
        """Whether it is the same at all times."""
        return self.is_path


@final
@dataclass(frozen=True, eq=False)
class Surface:
    """A surface of triangles over time: vertices (n_t, k, 3), or (1, k, 3) where it is at rest, and faces (m, 3)."""

    name: str
    color: str
    vertices: FloatArray
    faces: NDArray[np.intp]
    opacity: float

    @property
    def at_rest(self) -> bool:
        """Whether it is the same at all times."""
        return len(self.vertices) == 1


@final
@dataclass(frozen=True, eq=False)
class Drawing:
    """A picture over time.

    Attributes
    ----------
    t : ndarray (n_t,)
        Times of the pictures [s].
    surfaces : tuple of Surface
    lines : tuple of Line
    low, high : ndarray (3,)
        Corners of what is shown [m].
    plane : tuple of int
        The axes along which anything is apart: two for a motion in a plane, else three.
    """

    t: FloatArray
    surfaces: tuple[Surface, ...]
    lines: tuple[Line, ...]
    low: FloatArray
    high: FloatArray
    plane: tuple[int, ...]


def shape_points(scene: Scene) -> list[Any]:
    """Return the points that shapes of a scene need."""
    found = [getattr(shape, name, None) for _, shape in scene.shapes for name in ("at", "start", "end", "point")]
    return [point for point in found if point is not None]


def drawing_of(
    motion: Trajectory,
    scene: Scene,
    drawn: Skeleton,
    constants: FloatArray,
    values: Mapping[str, float],
    reactions: bool,
) -> Drawing:
    """Return the picture of a motion at its recorded times.

    Parameters
    ----------
    constants : ndarray (n_c,) or (n_t, n_c)
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
    positions, axes = drawn.at(motion.elapsed, motion.q, constants)
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    extent = float(np.max(high - low))
    builder = _Builder(scene, drawn, positions, axes, values, extent or 1.0)
    shaped = {name for name, shape in scene.shapes if isinstance(shape, BODY_SHAPES)}
    for name, shape in scene.shapes:
        builder.add(name, shape)
    builder.add_skeleton(shaped)
    if reactions:
        builder.add_reactions(motion)
    boxes = [(positions.min(axis=(0, 1)), positions.max(axis=(0, 1)))]
    boxes += [
        (s.vertices.min(axis=(0, 1)), s.vertices.max(axis=(0, 1))) for s in builder.surfaces if len(s.vertices) > 1
    ]
    low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    reach = 0.12 * float(np.max(high - low)) or 0.1
    plane = _plane(low, high)
    return Drawing(motion.t, tuple(builder.surfaces), tuple(builder.lines), low - reach, high + reach, plane)


def _plane(low: FloatArray, high: FloatArray) -> tuple[int, ...]:
    extent = high - low
    flat = [i for i in (2, 1, 0) if extent[i] <= _FLAT * max(float(extent.max()), _FLAT)]
    return tuple(i for i in range(3) if i != flat[0]) if flat else (0, 1, 2)


class _Builder:
    """Surfaces and lines of one picture under construction."""

    def __init__(
        self,
        scene: Scene,
        drawn: Skeleton,
        positions: FloatArray,
        axes: FloatArray,
        values: Mapping[str, float],
        extent: float,
    ) -> None:
        self.scene, self.drawn, self.positions, self.axes = scene, drawn, positions, axes
        self.values, self.extent = values, extent
        self.surfaces: list[Surface] = []
        self.lines: list[Line] = []

    def color(self, body: int) -> str:
        """Return the colour of a body."""
        return _COLORS[body % len(_COLORS)]

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
        if name not in self.drawn.bodies:
            raise OptionError(
                f"shape {name!r}: no body is called so; the bodies are {list_names(self.drawn.bodies)}. Rods, springs,"
                " paths and grounds may have any name"
            )
        return self.drawn.bodies.index(name)

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
            self.lines.append(Line("", shape.color or _GREY, self.point(shape.point), 1.0))
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

    def _on_body(self, name: str, shape: Sphere | Disk | Box | Cylinder) -> None:
        body = self.body(name)
        frame = getattr(self.scene.bodies[body], "frame", self.scene.frame)
        if isinstance(shape, Sphere):
            mesh = shape_meshes.sphere(self.number(shape.radius, name))
        elif isinstance(shape, Disk):
            mesh = shape_meshes.disk(self.number(shape.radius, name), self.vector(shape.axis, frame, name))
        elif isinstance(shape, Box):
            mesh = shape_meshes.box(np.array([self.number(edge, name) for edge in (shape.x, shape.y, shape.z)]))
        else:
            axis = self.vector(shape.axis, frame, name)
            mesh = shape_meshes.cylinder(self.number(shape.radius, name), self.number(shape.length, name), axis)
        centre = self.positions[:, body] if shape.at is None else self.point(shape.at)
        turned = np.broadcast_to(np.eye(3), (len(centre), 3, 3))
        if body in self.drawn.framed:
            turned = self.axes[:, self.drawn.framed.index(body)]
        color = shape.color or self.color(body)

        def placed(local: FloatArray) -> FloatArray:
            return np.asarray(centre[:, np.newaxis] + local @ turned)

        self.surfaces.append(Surface(name, color, placed(mesh.vertices), mesh.faces, 0.6))
        self.lines += [Line("", color, placed(mark), 1.2) for mark in mesh.marks]

    def add_skeleton(self, shaped: set[str]) -> None:
        """Add paths and mass centres of bodies, links, points, and axes of bodies without a shape."""
        drawn, count = self.drawn, len(self.drawn.bodies)
        for i in range(count):
            self.lines.append(Line("", self.color(i), self.positions[:, i], 1.0))
        for link in drawn.links:
            self.lines.append(Line("", _GREY, self.positions[:, list(link)], 2.0))
        for i, name in enumerate(drawn.bodies):
            self.lines.append(Line(name, self.color(i), self.positions[:, i : i + 1], 0.0))
        if len(drawn.points) > count:
            self.lines.append(Line("", _GREY, self.positions[:, count:], 0.0))
        size = 0.07 * self.extent
        for body, frame in zip(drawn.framed, np.moveaxis(self.axes, 1, 0), strict=True):
            if drawn.bodies[body] in shaped:
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
