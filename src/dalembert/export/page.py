"""Pages that simulate: one file of HTML with the simulator as WebAssembly, sliders, curves and a picture in space.

The picture is a kernel of points, axes and lengths of shapes, and the shapes that refer to them.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any, final

from ..codegen.c.contact_simulator import simulator_of
from ..codegen.c.descriptions import CSource, plain
from ..codegen.c.kernels import kernel_variables, source_of
from ..codegen.rendering import banner_lines, render
from ..contacts.equations.contact_laws import STATES
from ..errors import OptionError
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..ir.program import Layout
from ..mechanics.skeleton import Skeleton, skeleton
from ..results.drawing import BODY_COLORS, checked_body, shape_points, triangles_of
from ..results.drawn_parts import undrawn
from ..scene.shapes import BODY_SHAPES, Ground, Mesh, Path, Rod, Spring, length_value, shape_numbers, vector_value
from ..version import __version__
from .compilers import web_assembly
from .fmu import refuse_missing

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


FUNCTIONS = tuple(
    f"page_{name}"
    for name in ("given", "row", "start", "reach", "status", "time", "steps", "status_text", "check_text")
)
"""Functions of ``page/page.c.j2``."""

_TURN, _FAST = 3.1416, 2.0
"""Default ends of the sliders of angles, and of rates that are zero."""


def page_text(source: CSource, finer: CSource, scene: Scene, sliders: Mapping[str, tuple[float, float]] | None) -> str:
    """Return a page.

    Parameters
    ----------
    source, finer : CSource
        Of the run that the page begins with, and of one at tighter tolerances, for the error estimate.
    scene : Scene
        Whose shapes are drawn.
    sliders : mapping of str to (float, float), optional
        Initial values, parameters and inputs that have a slider, and its ends; by default all.

    Raises
    ------
    CapabilityError
        Where numbers of the run are missing.
    OptionError
        For a scene without positions, and shapes that cannot be drawn.
    MissingExtraError
        Without a compiler for WebAssembly.
    """
    refuse_missing(source, "a page")
    layout, numbers = source.program.layout, source.numbers
    picture = picture_of(scene, {name: float(numbers.get(name, 0.0)) for name in layout.parameters}, layout)
    with ThreadPoolExecutor() as pool:  # the compiler is a process of its own
        compile_one = partial(web_assembly, exported=FUNCTIONS, small=source.contacts is not None)
        compiled = pool.map(compile_one, [_texts(each, picture) for each in (source, finer)])
        modules = dict(zip(("run", "finer"), compiled, strict=True))
    variables, shown = len(source.program.kernel("expand").outputs), [*layout.outputs, *_contacts(source)]
    described = {
        "name": source.program.name,
        "span": source.span,
        "method": source.method,
        "order": source.order,
        "tolerances": source.tolerances,
        "formulation": source.program.formulation,
        "version": __version__,
        "given": _given(source, sliders),
        "variables": [*layout.coordinates, *layout.rates, *layout.states],
        "outputs": shown,
        "coordinates": len(layout.coordinates),
        "energy": variables + len(shown),
        "picture": picture.description,
        "size": sum(len(code) for code in modules.values()),
    }
    text = json.dumps(described, allow_nan=False).replace("</", "<\\/")
    title = source.program.name.replace("_", " ")
    codes = {name: _packed(code) for name, code in modules.items()}
    return render("page/page.html.j2", {"title": escape(title), "version": __version__, "model": text, "codes": codes})


def _packed(code: bytes) -> str:
    """Return code as text, compressed as browsers can read it."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    return base64.b64encode(packer.compress(code) + packer.flush()).decode()


def _texts(source: CSource, picture: Picture) -> dict[str, str]:
    """Return the simulator with what a page calls, in C."""
    simulator, layout = simulator_of(source), source.program.layout
    prefix, variables = simulator.prefix, len(source.program.kernel("expand").outputs)
    kernel = kernel_variables(f"{prefix}_picture", picture.kernel, "Points, axes of bodies, and lengths")
    n_contacts = len(_contacts(source))
    first = variables + len(layout.outputs) + n_contacts
    functions = {
        "prefix": prefix,
        "upper": prefix.upper(),
        "n_given": max(len(source.start.given) + len(source.parameters) + len(layout.inputs), 1),
        "n_row": first + 2 + len(picture.kernel.outputs),
        "n_inputs": len(layout.inputs),
        "n_outputs": len(layout.outputs),
        "contact_places": list(range(first - n_contacts, first)),
        "n_variables": variables,
        "first_energy": first,
        "first_picture": first + 2,
        "at": {name: simulator.at[name] for name in ("direction", "time", "steps", "constants")},
    }
    banner = [plain(line) for line in banner_lines(source.program)]
    printed = render("c/kernels.c.j2", {"kernels": [kernel]})
    texts = {name: simulator.files[name] for name in (f"{prefix}.h", f"{prefix}.c")}
    texts["page.c"] = source_of(banner, [f"{prefix}.h"], printed) + render("page/page.c.j2", functions)
    return texts


def _contacts(source: CSource) -> list[str]:
    """Return the names of the curves of contacts that change: what each does, as a number."""
    if source.contacts is None:
        return []
    numbered = {state: f"{STATES.index(state)} {state}" for state in STATES}
    ordered = [(name, sorted(states, key=STATES.index)) for name, states in source.contacts.contacts]
    return [f"{name}: {', '.join(numbered[state] for state in states)}" for name, states in ordered]


def _given(source: CSource, sliders: Mapping[str, tuple[float, float]] | None) -> list[dict[str, Any]]:
    """Return the values that a run begins with, in the order of the simulator, with their sliders."""
    layout, found = source.program.layout, list[dict[str, Any]]()
    kinds = [("start", source.start.given), ("parameter", source.parameters), ("input", layout.inputs)]
    order = {} if sliders is None else {name: place for place, name in enumerate(sliders)}
    for kind, names in kinds:
        for name in names:
            value = float(source.numbers.get(name, 0.0))
            item: dict[str, Any] = {"name": name, "kind": kind, "value": value}
            if sliders is None:
                item |= {"ends": _ends(source, name, value), "place": len(found)}
            elif name in sliders:
                item |= {"ends": sliders[name], "place": order[name]}
            found.append(item)
    return found


def _ends(source: CSource, name: str, value: float) -> tuple[float, float]:
    """Return the ends of a slider: about its value, in the range that is allowed."""
    layout = source.program.layout
    if name in source.angles and abs(value) <= _TURN:
        return -_TURN, _TURN
    if "positive" in layout.assumptions.get(name, ()):
        return 0.1 * value, 2.0 * value
    if value == 0.0:
        return (-_FAST, _FAST) if name in layout.rates else (-1.0, 1.0)
    if name in source.parameters:
        return (0.0, 2.0 * value) if value > 0.0 else (2.0 * value, 0.0)
    return -2.0 * abs(value), 2.0 * abs(value)
