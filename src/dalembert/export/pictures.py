"""The drawing of a page: points, axes and lengths of shapes as a kernel, and the shapes that refer to them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, final

from ..errors import OptionError
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..ir.program import Layout
from ..mechanics.skeleton import Skeleton, skeleton
from ..results.drawing import BODY_COLORS, checked_body, shape_points, triangles_of
from ..results.drawn_parts import undrawn
from ..scene.shapes import BODY_SHAPES, Ground, Mesh, Path, Rod, Spring, length_value, shape_numbers, vector_value

if TYPE_CHECKING:
    from ..scene import Scene

_NAMED = ("blue", "orange", "green", "red", "purple", "brown", "pink", "gray", "olive", "cyan")
_COLORS = {f"tab:{name}": color for name, color in zip(_NAMED, BODY_COLORS, strict=True)}
"""Colours of matplotlib that HTML does not have."""


@final
@frozen
class Picture:
    """A kernel with all numbers of a picture, arguments (t, q, c), and what they are, for JSON."""

    kernel: Kernel
    description: Mapping[str, Any]


def picture_of(scene: Scene, values: Mapping[str, float], layout: Layout) -> Picture:
    """Return the picture of a scene.

    Parameters
    ----------
    values : mapping of str to float
        Parameters by name, with which lengths are checked.

    Raises
    ------
    OptionError
        For a scene without positions, shapes of bodies that do not exist, and lengths that are no positive numbers.
    """
    known = {**values, **{symbol: values[name] for symbol, name in layout.aliases.items() if name in values}}
    shapes = [(name, shape, _body_frame(scene, name, shape)) for name, shape in scene.shapes]
    numbers, places = list[Any](), list[tuple[int, int]]()
    for name, shape, frame in shapes:
        own = shape_numbers(shape, frame, scene.frame)
        _check(name, shape, frame, scene, known)
        places.append((len(numbers), len(own)))
        numbers += own
    drawn = skeleton(scene, layout.parameters, shape_points(scene), numbers)
    left = undrawn(scene, drawn)
    described = [_shape(drawn, item, place) for item, place in zip(shapes, places, strict=True)]
    description = {
        "points": drawn.points,
        "bodies": drawn.bodies,
        "framed": drawn.framed,
        "links": left.links,
        "paths": left.paths,
        "axes": left.axes,
        "colors": [BODY_COLORS[i % len(BODY_COLORS)] for i in range(len(drawn.bodies))],
        "shapes": described,
        "numbers": len(numbers),
        "up": _up(scene, known),
    }
    return Picture(drawn.kernel, description)


def _body_frame(scene: Scene, name: str, shape: Any) -> Any:
    """Return the frame that a shape is fixed in."""
    if not isinstance(shape, BODY_SHAPES) or _still(shape):
        return scene.frame
    body = checked_body(name, tuple(scene.body_names()))
    return getattr(scene.bodies[body], "frame", scene.frame)


def _still(shape: Any) -> bool:
    """Whether a shape is a mesh that is fixed in the frame of the scene."""
    return isinstance(shape, Mesh) and shape.fixed


def _check(name: str, shape: Any, frame: Any, scene: Scene, values: Mapping[str, float]) -> None:
    """Reject lengths that are no positive numbers, and axes that move."""
    for length in ("radius", "length", "x", "y", "z", "size"):
        if not isinstance(shape, Rod) and getattr(shape, length, None) is not None:
            length_value(getattr(shape, length), values, name)
    for vector, where in (("axis", frame), ("normal", scene.frame)):
        if hasattr(shape, vector):
            vector_value(getattr(shape, vector), where, values, name)


def _shape(drawn: Skeleton, item: tuple[str, Any, Any], place: tuple[int, int]) -> dict[str, Any]:
    """Return a shape: its kind, points, frame, colour, and the place of its numbers."""
    name, shape, _ = item
    found: dict[str, Any] = {"kind": type(shape).__name__.lower(), "first": place[0], "count": place[1]}
    found["color"] = _COLORS.get(shape.color, shape.color)
    if isinstance(shape, Rod | Spring):
        found["ends"] = [drawn.points.index(point.name) for point in (shape.start, shape.end)]
        found |= {"coils": shape.coils} if isinstance(shape, Spring) else {}
    elif isinstance(shape, Path):
        found["point"] = drawn.points.index(shape.point.name)
    elif isinstance(shape, Ground):
        found["point"] = -1 if shape.at is None else drawn.points.index(shape.at.name)
    elif _still(shape):
        found |= {"point": -1 if shape.at is None else drawn.points.index(shape.at.name), "frame": -1, "body": -1}
    else:
        body = drawn.bodies.index(name)
        found["point"] = body if shape.at is None else drawn.points.index(shape.at.name)
        found |= {"body": body, "frame": drawn.framed.index(body) if body in drawn.framed else -1}
    if isinstance(shape, Mesh):
        surface = triangles_of(name, shape)
        found["vertices"] = [[float(f"{x:.6g}") for x in vertex] for vertex in surface.vertices]
        found["faces"] = surface.faces.tolist()
    return found


def _up(scene: Scene, values: Mapping[str, float]) -> list[float] | None:
    """Return the direction that is upward on the screen: against gravity, or normal to a ground; None where none is."""
    grounds = [shape.normal for _, shape in scene.shapes if isinstance(shape, Ground)]
    for vector in (*grounds, *([] if scene.gravity is None else [-scene.gravity])):
        try:
            return [float(x) for x in vector_value(vector, scene.frame, values, "up")]
        except OptionError:
            continue
    return None
