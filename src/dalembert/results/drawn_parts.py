"""Parts of pictures of motions: surfaces, lines and points over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..scene.shapes import Path, Rod, Spring

if TYPE_CHECKING:
    from ..mechanics.skeleton import Skeleton
    from ..scene import Scene
    from .trajectory import Trajectory


@final
@frozen(eq=False)
class Line:
    """A line, or points, over time.

    Attributes
    ----------
    name : str
        Text in the legend; empty without an entry.
    color : str
    points : ndarray (n_t, k, 3), or (n, 3) for the path of a point, see `Drawing.reached`
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
@frozen(eq=False)
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
@frozen(eq=False)
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
    reached : ndarray (n_t,)
        How many points of a path have been passed at each time; paths have points at further times, too.
    """

    t: FloatArray
    surfaces: tuple[Surface, ...]
    lines: tuple[Line, ...]
    low: FloatArray
    high: FloatArray
    plane: tuple[int, ...]
    reached: NDArray[np.intp]


@final
@frozen(eq=False)
class Frames:
    """Times of pictures: the motion there, and along paths at further times, of which `reached` are past at each."""

    motion: Trajectory
    paths: Trajectory
    reached: NDArray[np.intp]


@final
@frozen
class Undrawn:
    """Parts of a skeleton that no shape of the scene draws in another way.

    Attributes
    ----------
    paths : tuple of int
        Bodies whose mass centres have a path: all, or none where a shape is a `Path`.
    axes : tuple of int
        Bodies with axes: those without a shape of their name.
    links : tuple of (int, int)
        Pairs of points with a line between them: none where a shape is a `Rod` or a `Spring`.
    """

    paths: tuple[int, ...]
    axes: tuple[int, ...]
    links: tuple[tuple[int, int], ...]


def undrawn(scene: Scene, drawn: Skeleton) -> Undrawn:
    """Return the parts of the skeleton that are drawn beside the shapes of a scene."""
    names, shapes = {name for name, _ in scene.shapes}, [shape for _, shape in scene.shapes]
    bodies = range(len(drawn.bodies))
    paths = () if any(isinstance(shape, Path) for shape in shapes) else tuple(bodies)
    links = () if any(isinstance(shape, Rod | Spring) for shape in shapes) else drawn.links
    return Undrawn(paths, tuple(i for i in bodies if drawn.bodies[i] not in names), links)
