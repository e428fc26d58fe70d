"""Descriptions of scenes as data, from which the dalembert scene and the reference are built by separate code.

An expression is a nested tuple, its first item the operation:

- ``("num", "0.7")`` or ``("num", "7/10")``: a decimal or rational number;
- ``("par", "m_1")``, ``("t",)``, ``("q", i)``, ``("u", i)``: parameter, time, coordinate, rate;
- ``("add", a, b, ...)``, ``("mul", a, b, ...)``, ``("div", a, b)``, ``("neg", a)``, ``("pow", a, b)``;
- ``("sin", a)`` and the other functions of one argument; ``("atan2", a, b)``, ``("max", a, b)``, ``("min", a, b)``,
  ``("mod", a, b)``, ``("heaviside", a)``;
- ``("piecewise", a, b, low, high)``: `low` where a < b, else `high`.

A frame is named by a pair (body, moves): the frame of the body after that many moves of its joint, -1 for all of
them; ``GROUND`` is the Newtonian one.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = [
    "GROUND",
    "ZERO",
    "Body",
    "Description",
    "Distance",
    "Equation",
    "Force",
    "PointCondition",
    "Spring",
    "Torque",
    "Variation",
    "from_json",
    "number",
    "to_json",
]

Tree = tuple[Any, ...]
Vector = tuple[Tree, Tree, Tree]
GROUND = (-1, 0)


def number(text: str | float) -> Tree:
    """Return the expression of a number."""
    return ("num", str(text))


ZERO = (number(0), number(0), number(0))


@dataclass(frozen=True)
class Body:
    """A body or particle, and the joint that hangs it on its parent.

    `hinge` is located from the parent's reference point in the parent's frame. `moves` lead from there to the body's
    own reference point and frame: ``("rotate", axis, angle)``, ``("shift", vector)``, ``("quaternion", coordinates)``,
    ``("angles", "Body" | "Space", order, angles)``, ``("matrix", nine numbers)``. `inertia` holds I_xx, I_yy, I_zz,
    I_xy, I_yz, I_zx about the mass centre; without it, the body is a particle.
    """

    name: str
    parent: int
    hinge: Vector
    moves: tuple[Tree, ...]
    centre: Vector
    mass: Tree
    inertia: tuple[Tree, ...] | None
    kind: str = ""


@dataclass(frozen=True)
class Force:
    """A force on a point of a body, by its components on a frame."""

    body: int
    at: Vector
    frame: tuple[int, int]
    components: Vector


@dataclass(frozen=True)
class Torque:
    """A torque on the frame of a body."""

    body: int
    frame: tuple[int, int]
    components: Vector


@dataclass(frozen=True)
class Spring:
    """A spring with a damper between a point of a body and a point of another, or of the ground."""

    body: int
    at: Vector
    other: int
    other_at: Vector
    stiffness: Tree
    length: Tree
    damping: Tree


@dataclass(frozen=True)
class PointCondition:
    """What holds for a point of a body along a direction.

    Holonomic: (position of the point - position of the other's) . direction = value. Nonholonomic: (velocity of the
    point + omega x arm) . direction = value. `reaction` names the unknown force along the direction that holds it.
    """

    holonomic: bool
    body: int
    at: Vector
    other: int
    other_at: Vector
    frame: tuple[int, int]
    direction: Vector
    value: Tree
    arm: Vector = ZERO
    arm_frame: tuple[int, int] = GROUND
    reaction: str = ""


@dataclass(frozen=True)
class Distance:
    """A rod without mass: the distance between two points, squared, less the squared length vanishes."""

    body: int
    at: Vector
    other: int
    other_at: Vector
    length: Tree
    holonomic: bool = True


@dataclass(frozen=True)
class Equation:
    """An expression that vanishes, affine in the rates if it is nonholonomic; `unit`: the length of a quaternion."""

    holonomic: bool
    expression: Tree
    unit: bool = False


@dataclass(frozen=True)
class Variation:
    """What a sweep and the sensitivity vary: a parameter or a coordinate or rate at the start, by its name."""

    name: str
    values: tuple[float, ...]
    """Far below, a little below, in the middle, a little above, far above."""


@dataclass(frozen=True)
class Description:
    """A scene and a run of it.

    `start` holds every coordinate and rate, consistent with the constraints; `left_out` names those that the compared
    code has to find for itself. `stops` are times at which the reference begins a new step.
    """

    seed: int
    style: str
    coordinates: tuple[str, ...]
    parameters: dict[str, float]
    bodies: tuple[Body, ...]
    loads: tuple[Any, ...]
    gravity: Vector | None
    constraints: tuple[Any, ...]
    span: tuple[float, float]
    start: dict[str, float] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    variation: Variation | None = None
    stops: tuple[float, ...] = ()
    family: str = ""
    intent: str = "regular"
    declared_quaternions: bool = False


_KINDS = {kind.__name__: kind for kind in (Force, Torque, Spring, PointCondition, Distance, Equation)}


def to_json(description: Description) -> str:
    """Return a description as one line of JSON."""
    data = asdict(description)
    for name in ("loads", "constraints"):
        items = getattr(description, name)
        data[name] = [[type(item).__name__, asdict(item)] for item in items]
    return json.dumps(data, separators=(",", ":"))


def from_json(text: str) -> Description:
    """Return the description that `to_json` wrote."""
    data = {name: _tuples(value) for name, value in json.loads(text).items()}
    data["bodies"] = tuple(Body(**item) for item in data["bodies"])
    for name in ("loads", "constraints"):
        data[name] = tuple(_KINDS[kind](**item) for kind, item in data[name])
    if data["variation"] is not None:
        data["variation"] = Variation(**data["variation"])
    return Description(**data)


def _tuples(value: Any) -> Any:
    """Return JSON with tuples in place of lists."""
    if isinstance(value, list):
        return tuple(map(_tuples, value))
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return value
