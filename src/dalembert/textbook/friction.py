"""Coulomb's law between unknown reaction components, as equation (4) of example 13.4.2 has it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import sympy as sp

from ..errors import ConstraintError, SceneError
from ..scene import CoulombFriction
from .actions import Actions
from .energy import readable

__all__ = ["friction_forces", "friction_laws", "refuse_friction"]


def friction_forces(laws: Sequence[CoulombFriction]) -> set[str]:
    """Return the names of the unknowns that are friction forces."""
    return {str(x) for law in laws for x in _parts(law.tangential)}


def friction_laws(actions: Actions) -> dict[Any, Any]:
    """Return the friction forces of a scene while its contacts slip, in their normal reactions and the rates.

    One component is -mu N sign(w), where w is the slip velocity that it has power on: its size is mu N where the
    normal reaction N presses, and it opposes slip. Two components are -mu N w / |w|.

    Raises
    ------
    SceneError
        For a force that no joint exerts.
    """
    found: dict[Any, Any] = {}
    put = actions.geometry.put
    for law in actions.scene.frictions:
        forces = _parts(law.tangential)
        given = law.slip is not None
        slips = [readable(put(e)) for e in _parts(law.slip)] if given else [_slip(actions, x) for x in forces]
        smooth = 0 if law.regularization is None else put(law.regularization)
        if smooth == 0 and len(forces) == 1:
            ways = [sp.sign(slips[0])]
        else:
            size = sp.sqrt(sum((w**2 for w in slips), sp.sympify(smooth) ** 2))
            ways = [w / size for w in slips]
        found |= {force: -put(law.mu) * law.normal * way for force, way in zip(forces, ways, strict=True)}
    return found


def _slip(actions: Actions, force: Any) -> Any:
    """Return the slip velocity at a joint along a reaction component, on which the component has power.

    That of a component of a torque is an angular velocity.
    """
    geometry = actions.geometry
    for joint in actions.scene.joints:
        for kind, given in (("moment", joint.force), ("resultant", joint.torque)):
            vector = geometry.vector(given)
            held = {str(x): x for matrix, _ in vector.args for x in matrix.free_symbols}
            if str(force) in held:
                along = geometry.map(vector, partial(_slope, held[str(force)]))
                return readable(geometry.dot(along, getattr(actions.relative_screw(joint), kind)))
    raise SceneError(actions.scene.name, [f"friction: {force} is no component of the action of a joint"])


def refuse_friction(scene: str, laws: Sequence[CoulombFriction], what: str) -> None:
    """Raise for a scene with friction where the derivation needs ideal joints.

    Raises
    ------
    ConstraintError
        For a scene with friction.
    """
    if laws:
        names = ", ".join(repr(law.label) for law in laws)
        raise ConstraintError(
            f"scene {scene!r} has friction ({names}), and {what} are derived here for ideal joints. The Lagrange"
            " equations, the constraints and friction_laws determine the motion: compile the scene to have it, or take"
            " the view of the scene without friction"
        )


def _slope(symbol: Any, expression: Any) -> Any:
    return expression.diff(symbol)


def _parts(value: Any) -> tuple[Any, ...]:
    return tuple(value) if isinstance(value, Sequence) else (value,)
