"""Release and imposition of coordinates.

SymPy shares points and frames between scenes, so they are left unchanged: a scene records each change as data,
and the readers of the scene apply it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy import Expr
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Point, ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from ..errors import SceneError, list_names, nesting_named
from ..frozen import frozen
from .expressions.identity import equal, vanishes
from .expressions.vector_products import VectorProduct
from .frames import Tree
from .speeds import without_speeds

if TYPE_CHECKING:
    from .scene import Scene


@final
@frozen
class Release:
    """A released coordinate: the component of `target` along `direction` is `coordinate` in place of `value`."""

    coordinate: Any
    target: Point | ReferenceFrame
    direction: Vector
    value: Any


# -- applied by readers of a scene ------------------------------------------------------------


def released_position(scene: Scene, point: Point, position: Any) -> Any:
    """Return the position of `point` from its parent with the released coordinates."""
    for item in scene.releases:
        if item.target is point:
            position = position + (item.coordinate - item.value) * item.direction
    return position


def released_orientation(scene: Scene, frame: ReferenceFrame, parent: ReferenceFrame, matrix: Any) -> Any:
    """Return the matrix from components on `parent` to those on `frame` with the released rotations."""
    for item in scene.releases:
        if item.target is frame:
            own = item.direction.to_matrix(frame)
            if own.has(AppliedUndef):
                matrix = matrix * _rotation(item.direction.to_matrix(parent), item.coordinate).T
            else:
                matrix = _rotation(own, item.coordinate).T * matrix
    return matrix


def _rotation(axis: Any, angle: Any) -> Any:
    """Return Rodrigues' matrix, which turns components about a unit vector."""
    x, y, z = axis
    cross = sp.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return sp.cos(angle) * sp.eye(3) + sp.sin(angle) * cross + (1 - sp.cos(angle)) * axis * axis.T


def with_imposed(expression: Any, imposed: Sequence[tuple[Any, Any]]) -> Any:
    """Return an expression with imposed coordinates, and their rates, in terms of the others."""
    expression = sp.sympify(expression)
    for coordinate, value in imposed:
        if expression.has(coordinate):
            expression = expression.subs(coordinate, value).doit()
    return expression


# -- release ------------------------------------------------------------------------------------


@nesting_named
def release(self: Scene, coordinate: Expr, target: Point | ReferenceFrame, direction: Vector) -> Scene:
    """Return a new scene with a further coordinate that the parametrization had eliminated.

    This scene stays as it is: write ``scene = scene.release(...)``, and compile what it returns.

    This is the "fictitious" coordinate of section 13.4: a further Lagrange equation, which determines
    the reaction that the parametrization hides. The motion stays as it is. Outputs do not need it:
    `dalembert.compile_model` computes reactions that the parametrization hides by itself.

    Parameters
    ----------
    coordinate : dynamicsymbol
        The coordinate; the scene must not have it yet.
    target : Point or ReferenceFrame
        The point to move, and with it all that is located from it; or the frame to turn, and with it all
        that is oriented from it.
    direction : Vector
        Unit vector: `coordinate` takes the place of the component of the position of `target` along it, or is
        the angle of a further rotation about it.

    Returns
    -------
    Scene
        With the coordinate, and the holonomic constraint that sets it to its former value.

    Raises
    ------
    SceneError
        When the coordinate exists, the target is fixed, or the direction is not a unit vector.

    Examples
    --------
    The normal force under the rolling sphere, of which G is the centre::

        scene = scene.release(z, G, N.z)  # with z, and the constraint z - r

    A point from which a body, and all that it carries, is located moves them together: so a pin at the origin is
    released as a point of its own, ``pin = O.locatenew("pin", 0)``.
    """
    scene = without_speeds(self)
    faults = _release_faults(scene, coordinate, target, direction)
    if faults:
        raise SceneError(scene.name, faults)
    try:
        value = _component(scene, target, direction) if isinstance(target, Point) else sp.S.Zero
    except ValueError as unknown:
        why = f"the direction {direction} of the release is not oriented in {scene.frame.name!r}: {unknown}"
        raise SceneError(scene.name, [why]) from None
    twin = scene.copy()
    twin.coordinates += (coordinate,)
    twin.releases += (Release(coordinate, target, direction, value),)
    twin.holonomic_constraints += (coordinate - value,)
    return twin


def _release_faults(scene: Scene, coordinate: Any, target: Any, direction: Any) -> list[str]:
    faults = []
    time = dynamicsymbols._t
    if not (isinstance(coordinate, AppliedUndef) and coordinate.args == (time,)):
        faults.append(f"the coordinate to release must be made with dynamicsymbols, not {coordinate!r}")
    elif coordinate in scene.coordinates:
        faults.append(
            f"{coordinate.func.__name__!r} is a coordinate of the scene already, and hides no reaction;"
            " release a coordinate that the scene does not have"
        )
    if not isinstance(target, Point | ReferenceFrame):
        faults.append(f"release takes a Point to move or a ReferenceFrame to turn, not {target!r}")
    else:
        kind, root = ("point", scene.origin) if isinstance(target, Point) else ("frame", scene.frame)
        tree = Tree(root, "_pos_dict" if kind == "point" else "_dcm_dict")
        if target is root and kind == "point":
            faults.append(
                f"the point {target.name!r} cannot be released, because it is the origin. Locate another there,"
                f" pin = {target.name}.locatenew('pin', 0), locate the bodies that it carries from it, and release that"
            )
        elif target is root or tree.path(target) is None:
            faults.append(
                f"the {kind} {target.name!r} cannot be released; release one that is located from {root.name!r}"
            )
    if not isinstance(direction, Vector):
        faults.append(f"the direction of a release must be a unit vector such as N.z, not {direction!r}")
    elif not equal(direction.dot(direction), 1):
        faults.append(f"the direction of a release must be a unit vector; the length of {direction} is not 1")
    return faults


def _component(scene: Scene, point: Point, direction: Vector) -> Any:
    """Return the component of the position of `point` along `direction`."""
    tree = Tree(scene.origin, "_pos_dict")
    total: Any = Vector(0)
    for node in tree.path(point) or []:
        total = total + released_position(scene, node, node._pos_dict[tree.parent[node]])
    return sp.trigsimp(sp.expand(total.dot(direction)))


# -- impose -------------------------------------------------------------------------------------


@nesting_named
def impose(self: Scene, coordinate: Expr, expression: Expr | None = None) -> Scene:
    """Return a new scene without a coordinate that a holonomic constraint determines: "compatible" equations.

    This scene stays as it is: write ``scene = scene.impose(...)``.

    Parameters
    ----------
    coordinate : dynamicsymbol
        The coordinate to eliminate.
    expression : Expr, optional
        Its value, in the other coordinates and time. Without it, a holonomic constraint that is affine in
        the coordinate is solved for it.

    Returns
    -------
    Scene
        Without the coordinate and without the constraints that this fulfils. Reactions that only held those
        constraints have no power left and become undetermined.

    Raises
    ------
    SceneError
        When no constraint gives the coordinate in closed form, or `expression` contradicts one.
    """
    scene = without_speeds(self)
    if not isinstance(coordinate, sp.Expr) or coordinate not in scene.coordinates:
        known = list_names(str(q.func.__name__) for q in scene.coordinates)
        raise SceneError(scene.name, [f"{coordinate} is no coordinate of the scene, so it cannot be imposed ({known})"])
    value = _solved(scene, coordinate) if expression is None else _expression(expression)
    if value is None:
        raise SceneError(scene.name, [f"{coordinate} is imposed as {expression!r}, which is no SymPy expression"])
    faults = _value_faults(scene, coordinate, value)
    if faults:
        raise SceneError(scene.name, faults)
    twin = scene.copy()
    twin.coordinates = tuple(q for q in scene.coordinates if q != coordinate)
    twin.imposed = (*((q, with_imposed(e, [(coordinate, value)])) for q, e in scene.imposed), (coordinate, value))
    kept = []
    for constraint in scene.holonomic_constraints:
        rest = with_imposed(constraint, twin.imposed)
        if vanishes(rest):
            continue
        if not rest.has(*twin.coordinates):
            faults.append(
                f"{_name(coordinate)} = {value} contradicts the constraint {constraint} = 0; correct one of them"
            )
        kept.append(constraint)
    twin.holonomic_constraints = tuple(kept)
    twin.nonholonomic_constraints = tuple(
        c for c in scene.nonholonomic_constraints if not vanishes(with_imposed(c, twin.imposed))
    )
    if faults:
        raise SceneError(scene.name, faults)
    return twin


def _expression(given: Any) -> Any:
    """Return a value as a SymPy expression, None where it is not one."""
    try:
        value = sp.sympify(given, strict=True)
    except (sp.SympifyError, TypeError, ValueError, AttributeError):
        return None
    return value if isinstance(value, sp.Expr) else None


def _solved(scene: Scene, coordinate: Any) -> Any:
    """Return the coordinate from the first holonomic constraint that is affine in it."""
    holding = []
    for constraint in scene.holonomic_constraints:
        rest = with_imposed(constraint, scene.imposed)
        if not rest.has(coordinate):
            continue
        holding.append(constraint)
        if rest.has(VectorProduct):  # in which angles are not affine
            continue
        slope = sp.diff(rest, coordinate)
        if not slope.has(coordinate) and not vanishes(slope):
            return sp.trigsimp(sp.expand(-rest.subs(coordinate, 0) / slope))
    name = _name(coordinate)
    if holding:
        why = (
            f"no holonomic constraint gives {name} in closed form ({', '.join(f'{c} = 0' for c in holding)} is not"
            f" affine in it): give the branch yourself, impose({name}, expression), or impose another of its"
            " coordinates"
        )
    else:
        why = f"no holonomic constraint contains {name}; give its value, impose({name}, expression)"
        if any(sp.sympify(c).has(coordinate) for c in scene.nonholonomic_constraints):
            why += ". A nonholonomic constraint cannot be used to eliminate a coordinate (section 13.6 of the text)"
    raise SceneError(scene.name, [why])


def _value_faults(scene: Scene, coordinate: Any, value: Any) -> list[str]:
    faults = []
    others = [q for q in scene.coordinates if q != coordinate]
    if value.has(coordinate):
        faults.append(f"{_name(coordinate)} is imposed as {value}, which contains it; solve for it first")
    if value.has(sp.Derivative):
        faults.append(
            f"{_name(coordinate)} is imposed as {value}, which contains rates; only coordinates and time may occur"
        )
    strange = sorted(
        str(f) for f in value.atoms(AppliedUndef) if f not in others and f not in scene.inputs and f != coordinate
    )
    if strange:
        faults.append(f"{_name(coordinate)} is imposed as {value}: {list_names(strange)} is no coordinate of the scene")
    return faults


def _name(coordinate: Any) -> str:
    return str(coordinate.func.__name__)
