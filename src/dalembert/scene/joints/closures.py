"""Joints that close loops: constraints between two bodies that the coordinates place already."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Particle, Point, ReferenceFrame
from sympy.physics.vector import Vector

from ...errors import list_names
from ...frozen import frozen
from ..expressions.identity import vanishes
from ..expressions.vector_products import components_on, product_of
from ..frames import Tree
from .parts import add_constraints, body_of, called, constant_in, counted, fixed_on, frame_of, require
from .reactions import (
    NOTHING,
    Connection,
    Triple,
    across,
    connection,
    everything,
    orthogonal,
    require_new_name,
    unknown,
)

if TYPE_CHECKING:
    from ..scene import Scene


@final
@frozen
class Closure:
    """A joint that closes a loop between two bodies of a scene, by holonomic constraints.

    Its equations hold for aligned axes and for opposite ones: start, or assemble, on the side that is meant.
    Constraints that the coordinates fulfil already are left out: a pin in a plane is two equations, in space five.
    The reaction is an output by name, as that of SymPy's joints: "loop.force_x", ..., "loop.torque_z" act on the child
    at `child_point`, with axes of the parent's frame.

    Parameters
    ----------
    name : str
        Name of the joint, for outputs and messages.
    parent, child : str, RigidBody or Particle
        The two bodies, or their names. A parent None is the fixed frame.
    kind : str
        "pin" (points together, axes aligned), "ball" (points together), "weld" (points together, frames aligned),
        "slider" (frames aligned, `child_point` on the line along `axis` through `parent_point`), "universal" (points
        together, axes at right angles), "distance" (points at a given distance).
    parent_point, child_point : Point
        Fixed on parent and child.
    axis : Vector, optional
        Of "pin", "slider" and "universal", fixed in the parent.
    child_axis : Vector, optional
        Of "pin" and "universal", fixed in the child; by default `axis`, where that is fixed in both bodies, as in a
        plane.
    parent_frame, child_frame : ReferenceFrame, optional
        Frames that "weld" and "slider" align, fixed in parent and child; by default those of the bodies.
    distance : expression of parameters, or number
        Of "distance" [m], positive. "loop.force" is then the tension [N].

    Examples
    --------
    A ball on a rod without mass, in coordinates that do not contain the rod::

        x, y = dynamicsymbols("x y")
        swing = da.Scene("swing", frame=N, origin=O, coordinates=[x, y])
        Q = O.locatenew("Q", x * N.x + y * N.y)
        swing.add_bodies(Particle("ball", Q, m))
        swing.add_joints(da.Closure("rod", None, "ball", kind="distance", parent_point=O, child_point=Q, distance=l))
    """

    name: str
    parent: Any
    child: Any
    kind: str
    parent_point: Point
    child_point: Point
    axis: Vector | None = None
    child_axis: Vector | None = None
    parent_frame: ReferenceFrame | None = None
    child_frame: ReferenceFrame | None = None
    distance: Any = None


@final
class _Ends:
    """The parts of a closure: bodies, frames, points, unit axes, and the way from the parent's point to the child's.

    A body None is the fixed frame.
    """

    def __init__(self, scene: Scene, closure: Closure, bodies: tuple[Any, Any]) -> None:
        self.scene, self.closure = scene, closure
        self.parent, self.child = bodies
        self.frame = closure.parent_frame or frame_of(scene, self.parent)
        self.child_frame = closure.child_frame or frame_of(scene, self.child)
        self.axis: Any = None if closure.axis is None else closure.axis.normalize()
        given = closure.axis if closure.child_axis is None else closure.child_axis
        self.child_axis: Any = None if given is None else given.normalize()
        self.way = closure.child_point.pos_from(closure.parent_point)

    def product(self, a: Vector, b: Vector) -> Any:
        """Return the scalar product of two vectors."""
        return product_of(self.scene.frame, a, b)

    def _common_frame(self) -> ReferenceFrame:
        """Return the last frame that carries both bodies."""
        tree = Tree(self.scene.frame, "_dcm_dict")
        ways = [[self.scene.frame, *(tree.path(frame) or ())] for _, frame in self.way.args]
        shared = [nodes[0] for nodes in zip(*ways, strict=False) if all(node is nodes[0] for node in nodes)]
        return shared[-1] if shared else self.scene.frame

    def on_frame(self) -> Any:
        """Return the axis on the parent's frame (3, 1)."""
        return components_on(self.frame, self.axis)

    def across_axis(self) -> list[Vector]:
        """Return two unit vectors across the axis, fixed in the parent."""
        return [Vector([(column, self.frame)]) for column in orthogonal(self.on_frame())]

    def together(self) -> list[Any]:
        """Return the conditions that the points are together: along and across an axis that does not turn."""
        root = self.scene.frame
        if self.axis is not None and constant_in(root, self.axis):
            matrix = components_on(root, self.axis)
            axes = [Vector([(column, root)]) for column in (*orthogonal(matrix), matrix)]
        else:
            axes = list(self._common_frame())
        return [self.product(self.way, axis) for axis in axes]

    def aligned(self) -> list[Any]:
        """Return the conditions that the frames are aligned."""
        p, c = self.frame, self.child_frame
        return [self.product(p.x, c.y), self.product(p.y, c.z), self.product(p.z, c.x)]

    def parallel(self) -> list[Any]:
        """Return the conditions that the axes are parallel."""
        return [self.product(self.child_axis, axis) for axis in self.across_axis()]

    def on_line(self) -> list[Any]:
        """Return the conditions that the child's point is on the axis through the parent's."""
        return [self.product(self.way, axis) for axis in self.across_axis()]

    def at_distance(self) -> list[Any]:
        """Return the condition of the distance; its gradient is of the size of one."""
        length = sp.sympify(self.closure.distance)
        return [(self.product(self.way, self.way) - length**2) / (2 * length)]


def _free(name: str, _: _Ends) -> Triple:
    return everything(name)


def _across(name: str, ends: _Ends) -> Triple:
    return across(name, ends.on_frame())


def _nothing(_: str, __: _Ends) -> Triple:
    return NOTHING


def _about_cross(name: str, ends: _Ends) -> Triple:
    """Return the torque of a universal joint, across both axes."""
    cross = ends.axis.cross(ends.child_axis)
    x, y, z = (unknown(f"{name}_1") * cross.dot(axis) for axis in ends.frame)
    return x, y, z


def _tension(name: str, ends: _Ends) -> Triple:
    """Return the force of a rod on the child's end: the tension is positive."""
    x, y, z = (-unknown(name) * ends.product(ends.way, axis) / sp.sympify(ends.closure.distance) for axis in ends.frame)
    return x, y, z


_Part = Callable[[str, _Ends], Triple]


@final
@frozen
class _Kind:
    """A kind of closure: its constraints, its force and torque, and the arguments that it needs."""

    constraints: tuple[Callable[[_Ends], list[Any]], ...]
    force: _Part
    torque: _Part
    needs: tuple[str, ...] = ()
    turns: bool = True


KINDS = {
    "pin": _Kind((_Ends.together, _Ends.parallel), _free, _across, ("axis", "child_axis")),
    "ball": _Kind((_Ends.together,), _free, _nothing, turns=False),
    "weld": _Kind((_Ends.together, _Ends.aligned), _free, _free, ("parent_frame", "child_frame")),
    "slider": _Kind((_Ends.on_line, _Ends.aligned), _across, _free, ("axis", "parent_frame", "child_frame")),
    "universal": _Kind(
        (_Ends.together, lambda ends: [ends.product(ends.axis, ends.child_axis)]),
        _free,
        _about_cross,
        ("axis", "child_axis"),
    ),
    "distance": _Kind((_Ends.at_distance,), _tension, _nothing, ("distance",), turns=False),
}
"""Kinds of closures; `turns` are those that need the orientation of both bodies."""


def ends_of(scene: Scene, closure: Closure) -> _Ends:
    """Return what a closure connects.

    Raises
    ------
    SceneError
        With every fault of the closure.
    """
    require_new_name(scene, closure.name)
    faults: list[str] = []
    parent, child = (body_of(scene, body, faults.append) for body in (closure.parent, closure.child))
    faults += _arguments(closure) or ([] if faults else _ends_faults(scene, closure, (parent, child)))
    require(scene, closure.name, faults)
    return _Ends(scene, closure, (parent, child))


def reaction_of(ends: _Ends) -> Connection:
    """Return a closure with its reaction, as far as the scene has no constraint for it."""
    closure, kind = ends.closure, KINDS[ends.closure.kind]
    force, torque = kind.force(f"{closure.name}.force", ends), kind.torque(f"{closure.name}.torque", ends)
    bodies = ends.child, ends.parent
    found = connection(closure.name, bodies, closure.child_point, ends.frame, (force, torque), closure)
    tension = {f"{closure.name}.force": unknown(f"{closure.name}.force")} if closure.kind == "distance" else {}
    return replace(found, components={**tension, **found.components}, closes=True)


def add_closure(scene: Scene, closure: Closure) -> None:
    """Add the constraints and the reaction of a closure to a scene.

    Raises
    ------
    SceneError
        With every fault of the closure.
    """
    ends = ends_of(scene, closure)
    rows = [row for rule in KINDS[closure.kind].constraints for row in rule(ends) if not vanishes(row)]
    if not rows:
        why = "the coordinates fulfil it for all their values already; leave it out, or use a joint of SymPy"
        require(scene, closure.name, [why])
    add_constraints(scene, closure.name, rows)
    text = f"{closure.kind} between {called(ends.parent, ends.child)}: {counted(len(rows), 'holonomic constraint')}"
    scene.connections += (replace(reaction_of(ends), text=text),)


# -- arguments --------------------------------------------------------------------------------------


def _arguments(closure: Closure) -> list[str]:
    """Return the faults of the arguments of a closure by themselves."""
    kind = KINDS.get(closure.kind)
    if kind is None:
        return [f"there is no kind {closure.kind!r}; known: {list_names(KINDS)}"]
    faults = []
    expected = {"axis": Vector, "child_axis": Vector, "parent_frame": ReferenceFrame, "child_frame": ReferenceFrame}
    for name in ("parent_point", "child_point"):
        if not isinstance(getattr(closure, name), Point):
            faults.append(f"{name} must be a Point, not {getattr(closure, name)!r}")
    for name, value in ((name, getattr(closure, name)) for name in (*expected, "distance")):
        if value is not None and name not in kind.needs:
            faults.append(f"a closure of kind {closure.kind!r} takes no {name}")
        elif value is not None and name in expected and (not isinstance(value, expected[name]) or value == 0):
            faults.append(f"{name} must be a {expected[name].__name__} such as N.z, not {value!r}")
    if "axis" in kind.needs and closure.axis is None:
        faults.append(f"the axis is missing: give axis=, a vector that is fixed in the parent (kind {closure.kind!r})")
    if closure.kind == "universal" and closure.child_axis is None:
        faults.append("the child_axis is missing: a universal joint has an axis in each body, at right angles")
    if closure.kind == "distance":
        length = closure.distance
        if length is None:
            faults.append("the distance is missing: give distance=, the length between the points")
        elif not isinstance(length, int | float | sp.Expr) or sp.sympify(length).is_positive is False:
            faults.append(f"the distance must be a positive length, not {length!r}")
    return faults


def _ends_faults(scene: Scene, closure: Closure, bodies: tuple[Any, ...]) -> list[str]:
    """Return the faults of the bodies, points, axes and frames of a closure in its scene."""
    faults = []
    kind, points = KINDS[closure.kind], Tree(scene.origin, "_pos_dict")
    moving = sp.sympify(closure.distance).atoms(AppliedUndef) & {*scene.coordinates} if closure.distance else ()
    if moving:
        names = list_names(sorted(q.func.__name__ for q in moving))
        faults.append(
            f"the length {closure.distance} depends on {names}, so that its tension does not act at its ends"
            " alone. For a rope that a drum winds, write the constraint and two joints, da.Joint: the tension on the"
            " body at its end, and the torque of the tension on the drum"
        )
    if bodies[0] is bodies[1]:
        faults.append("its two bodies are the same")
    sides = (("parent", closure.parent, bodies[0]), ("child", closure.child, bodies[1]))
    for side, given, body in sides:
        point = getattr(closure, f"{side}_point")
        name = called(body)
        if points.path(point) is None:
            faults.append(
                f"{side}_point {point.name!r} is not located from {scene.origin.name!r}: locate it from {name}, and add"
                f" the joints that {str(given)!r} hangs on first"
            )
        elif not fixed_on(scene, body, point) and isinstance(body, Particle):
            faults.append(
                f"{side}_point {point.name!r} is not on {name}, a particle, which is at {body.masscenter.name!r} alone:"
                " give that point, or make it a RigidBody"
            )
        elif not fixed_on(scene, body, point):
            faults.append(f"{side}_point {point.name!r} is not fixed on {name}; locate it from a point of {name}")
        if kind.turns and isinstance(body, Particle):
            faults.append(f"{name} is a particle, which has no orientation: take kind='ball', or make it a RigidBody")
            continue
        frame = frame_of(scene, body)
        own = getattr(closure, f"{side}_frame")
        if own is not None and not constant_in(frame, own):
            faults.append(f"{side}_frame {own.name!r} is not fixed in {name}")
        axis = closure.axis if side == "parent" or closure.child_axis is None else closure.child_axis
        if axis is not None and (side == "parent" or "child_axis" in kind.needs) and not constant_in(frame, axis):
            remedy = "give child_axis=, fixed in the child, too" if axis is closure.axis and side == "child" else ""
            faults.append(f"the axis {axis} is not fixed in {name}{remedy and '; ' + remedy}")
    return faults
