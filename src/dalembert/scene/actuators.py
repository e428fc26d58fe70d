"""Actuators of ``sympy.physics.mechanics`` as loads, with the potential energy that springs store."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Point
from sympy.physics.mechanics.actuator import ActuatorBase, DuffingSpring, ForceActuator, LinearSpring
from sympy.physics.mechanics.pathway import LinearPathway, ObstacleSetPathway

from ..errors import SceneError
from ..frozen import frozen
from .expressions.identity import vanishes
from .expressions.reader import short

if TYPE_CHECKING:
    from .scene import Scene

_KINDS = "LinearSpring, DuffingSpring, LinearDamper, ForceActuator and TorqueActuator"


@final
@frozen
class ActuatorLoads:
    """An actuator as loads.

    Attributes
    ----------
    name : str
        For messages.
    loads : tuple of (Point or ReferenceFrame, Vector)
    potential : Expr or None
        Candidate for its potential energy; None where the kind of the actuator says nothing of one.
    """

    name: str
    loads: tuple[tuple[Any, Any], ...]
    potential: Any


def actuator_loads(actuator: ActuatorBase) -> tuple[tuple[Any, Any], ...]:
    """Return the loads of an actuator as pairs of a point or frame and a vector."""
    return tuple((load[0], load[1]) for load in actuator.to_loads())


def read_actuators(scene: Scene) -> tuple[list[ActuatorLoads], list[str]]:
    """Return the actuators of a scene as loads, and a fault for every other object among them."""
    found: list[ActuatorLoads] = []
    faults: list[str] = []
    for actuator in scene.actuators:
        if not isinstance(actuator, ActuatorBase):
            faults.append(
                f"{actuator!r} is not an actuator of sympy.physics.mechanics, which are {_KINDS}; add forces and"
                " torques with add_loads"
            )
            continue
        name = short(repr(actuator))
        why = _without_length(actuator) or _opposite(scene, actuator)
        if why is not None:
            faults.append(f"{name}: {why}")
            continue
        try:
            found.append(ActuatorLoads(name, actuator_loads(actuator), potential_of(actuator)))
        except (ValueError, TypeError, AttributeError) as error:
            faults.append(f"{name} gives no loads: {error}. Locate its points and orient its frames first")
    return found, faults


def loads_of(scene: Scene) -> tuple[Any, ...]:
    """Return the loads of a scene and of its actuators, for readers that look at loads alone.

    Raises
    ------
    SceneError
        For actuators that give no loads.
    """
    found, faults = read_actuators(scene)
    if faults:
        raise SceneError(scene.name, faults)
    return (*scene.loads, *(load for item in found for load in item.loads))


def potential_of(actuator: ActuatorBase) -> Any:
    """Return the candidate for the potential energy of an actuator along a pathway, by its length; None for others."""
    if not isinstance(actuator, ForceActuator):
        return None
    length = actuator.pathway.length
    if isinstance(actuator, LinearSpring):
        return actuator.stiffness * (length - actuator.equilibrium_length) ** 2 / 2
    if isinstance(actuator, DuffingSpring):
        x = length - actuator.equilibrium_length
        return actuator.linear_stiffness * x**2 / 2 + actuator.nonlinear_stiffness * x**4 / 4
    force = sp.sympify(actuator.force)
    moving = force.has(AppliedUndef) or force.has(sp.physics.vector.dynamicsymbols._t)
    return None if moving else -force * length


def _without_length(actuator: ActuatorBase) -> str | None:
    """Return why the pathway of an actuator has no direction; None where it has one."""
    if not isinstance(actuator, ForceActuator):
        return None
    for first, second in _segments(actuator.pathway):
        try:
            position = second.pos_from(first)
        except ValueError:
            return None  # said with the loads
        if all(vanishes(x) for matrix, _ in position.args for x in matrix):
            return (
                f"its pathway has no direction, because the points {first.name!r} and {second.name!r} are at the same"
                " place; attach it to points that are apart"
            )
    return None


def _opposite(scene: Scene, actuator: ActuatorBase) -> str | None:
    """Return why the loads of an actuator contradict its force: their power is minus force times extension velocity.

    That is so on SymPy's `WrappingPathway` (1.14), whose loads pull the ends together where the force is positive.
    """
    if not isinstance(actuator, ForceActuator) or isinstance(actuator.pathway, LinearPathway | ObstacleSetPathway):
        return None
    pathway = actuator.pathway
    try:
        power = sum(
            vector.dot(point.pos_from(scene.origin).dt(scene.frame)) for point, vector in pathway.to_loads(sp.S.One)
        )
        extension = pathway.extension_velocity
    except (ValueError, TypeError, AttributeError):
        return None  # said with the loads
    if vanishes(extension) or not vanishes(power + extension):
        return None
    return (
        "the loads that SymPy gives its pathway pull the ends together where the force is positive, against what SymPy"
        " says of it, so that a spring pushes: add the loads with the sign that you mean,"
        " scene.add_loads(*pathway.to_loads(-force)) for a force that is positive where it pushes the ends apart"
    )


def straight_parts(scene: Scene) -> list[tuple[str, str, Any]]:
    """Return the straight parts of the pathways of actuators: name of the actuator, names of the ends, length [m]."""
    return [
        (short(repr(actuator)), f"{first.name!r} and {second.name!r}", second.pos_from(first).magnitude())
        for actuator in scene.actuators
        if isinstance(actuator, ForceActuator)
        for first, second in _segments(actuator.pathway)
    ]


def _segments(pathway: Any) -> Iterator[tuple[Point, Point]]:
    """Yield the ends of the straight parts of a pathway."""
    if isinstance(pathway, LinearPathway | ObstacleSetPathway):
        points = pathway.attachments
        yield from pairwise(points)
