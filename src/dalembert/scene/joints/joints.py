"""Joints with unknown reactions, and requested outputs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, final

from sympy import Basic, Derivative, Symbol, symbols
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Point
from sympy.physics.vector import ReferenceFrame, Vector, dynamicsymbols

from ...errors import OptionError, list_names, nesting_named
from ...frozen import frozen
from ...naming import acceleration_name, unwritable
from ...values import listed as members


@final
@frozen
class Joint:
    """A contact of a body with the fixed frame, or with another body: an action screw with unknown components.

    The power of the screw is taken with the body's own velocity field at `at`
    (v_G + omega x (at - G)), so the point may travel over the body. A particle has the velocity of its point, takes no
    torque, and a joint acts on it at that point. With `other`, the opposite screw acts on that body
    at the same point, with the velocity field of that body there.

    Parameters
    ----------
    name : str
        Name of the joint, for messages.
    body : str
        Name of the body that the action is exerted on.
    at : Point
        Reduction point of the screw.
    force, torque : Vector
        Resultant [N] and moment about `at` [N m] of the action on `body`; their unknowns are made by `unknowns`.
    other : str, optional
        Name of the body that exerts the action, and has the opposite one; without it, that is the fixed frame.

    Examples
    --------
    A pin at P that holds rod b to rod a, of which R_x and R_y are the force on b::

        da.Joint("pin", body="b", other="a", at=P, force=R_x*N.x + R_y*N.y)
    """

    name: str
    body: str
    at: Point
    force: Vector | int = 0
    torque: Vector | int = 0
    other: str | None = None


@final
@frozen
class Place:
    """A component of the position of a point from the origin of a scene, on its frame: an output."""

    point: Point
    axis: int

    def __str__(self) -> str:
        return f"{self.point.name}_{'xyz'[self.axis]}"


# Unknown reaction components.


class Unknown(Symbol):  # type: ignore[misc]
    """A component of a reaction that the equations of motion are to determine."""

    __slots__ = ()


@nesting_named
def unknowns(names: str) -> Any:
    """Return reaction components to be solved for, as ``sympy.symbols`` returns symbols.

    Parameters
    ----------
    names : str
        Names separated by spaces or commas.

    Returns
    -------
    Unknown or tuple of Unknown
        One symbol for one name, a tuple for several.

    Raises
    ------
    OptionError
        For an argument that is no text with names.

    Examples
    --------
    ::

        X, Y = da.unknowns("X Y")
    """
    given: Any = names
    if not isinstance(given, str) or not given.strip(" ,"):
        raise OptionError(f"unknowns takes names as one text, such as 'X Y', not {names!r}")
    try:
        return symbols(names, cls=Unknown, real=True)
    except (ValueError, TypeError, UnicodeError) as error:
        raise OptionError(f"unknowns takes names as one text, such as 'X Y', not {names!r}: {error}") from None


# Requested outputs of a model.

_KINDS = str | Basic | Point | Vector
_ALLOWED = "names, expressions of the scene's symbols, Vectors or Points"


@final
@frozen
class Component:
    """A component of a vector on the frame of a scene."""

    vector: Vector
    axis: int


@final
@frozen
class NamedOutput:
    """An output with a name: of the user's choice, or made from that of a coordinate or the text of a vector.

    `value` is a name of the scene, an expression, a `Place` or a `Component`.
    """

    name: str
    value: Any

    def __str__(self) -> str:
        return self.name


def requested(outputs: Any) -> tuple[Any, ...]:
    """Return the requested outputs as a tuple, with three components for points and vectors.

    Parameters
    ----------
    outputs : iterable of names, expressions, Points, Vectors and mappings, or mapping of names to them
        One name, expression, Point or Vector is the only one.

    Raises
    ------
    OptionError
        For what is no output, and for two outputs of the same name.
    """
    if isinstance(outputs, Mapping):
        parts: list[Any] = _entries(outputs)
    else:
        alone = isinstance(outputs, _KINDS | ReferenceFrame) or not isinstance(outputs, Iterable)
        listed = (outputs,) if alone else tuple(members("outputs", outputs, "names"))
        strange = [repr(output) for output in listed if not isinstance(output, _KINDS | Mapping)]
        if strange:
            raise OptionError(f"outputs are {_ALLOWED}, or a mapping from names to them, not {list_names(strange)}")
        parts = [part for output in listed for part in _parts(output)]
    unique = tuple(dict.fromkeys(parts))
    names = [str(part) for part in unique if not isinstance(part, str)]
    unique = tuple(part for part in unique if not (isinstance(part, str) and part in names))
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise OptionError(
            f"two outputs have the name {list_names(twice)}: give outputs= as a mapping with a name for each. Points"
            " and vectors have three, with _x, _y and _z behind theirs"
        )
    return unique


def placed(points: Iterable[Any]) -> tuple[list[Place], list[str]]:
    """Return a component of each of the points that were given as such, to be read, and the names of all of them."""
    listed = members("points", points, "points or their names")
    places = [Place(point, 0) for point in listed if isinstance(point, Point)]
    return places, [point.name if isinstance(point, Point) else str(point) for point in listed]


def _parts(output: Any) -> Sequence[Any]:
    """Return an output without a name as those that have one: a mapping as its entries."""
    if isinstance(output, Mapping):
        return _entries(output)
    if isinstance(output, Point):
        return [Place(output, axis) for axis in range(3)]
    if isinstance(output, Vector):
        return _named(str(output), output)
    if isinstance(output, Derivative) and isinstance(output.expr, AppliedUndef):
        if output.variable_count == ((dynamicsymbols._t, 2),):
            return [NamedOutput(acceleration_name(output.expr.func.__name__), output)]
    return [output]


def _entries(outputs: Mapping[Any, Any]) -> list[NamedOutput]:
    return [part for name, output in outputs.items() for part in _named(name, output)]


def _renamed(name: str, reaction: Mapping[Any, Any]) -> dict[str, Any]:
    """Return outputs with a name in place of that of their joint, which all of them begin with, and a dot."""
    names = [str(own) for own in reaction]
    heads = [names[0][: i + 1] for i, letter in enumerate(names[0]) if letter == "."] if names else []
    joint = max((head for head in heads if all(own.startswith(head) for own in names)), key=len, default="")
    return {f"{name}.{own.removeprefix(joint)}": output for own, output in zip(names, reaction.values(), strict=True)}


def _named(name: Any, output: Any) -> Sequence[NamedOutput]:
    """Return an output that a user gave a name."""
    if not isinstance(name, str) or not name or unwritable(name):
        raise OptionError(f"the name of an output must be a text with characters that can be written, not {name!a}")
    if isinstance(output, Point | Vector):
        values = [Place(output, axis) if isinstance(output, Point) else Component(output, axis) for axis in range(3)]
        return [NamedOutput(f"{name}_{'xyz'[axis]}", value) for axis, value in enumerate(values)]
    if isinstance(output, Mapping):
        return _entries(_renamed(name, output))
    if not isinstance(output, str | Basic):
        raise OptionError(f"outputs are {_ALLOWED}, but {name!r} is {output!r}")
    return [NamedOutput(name, output)]
