"""Contacts by geometry as joints, unilateral contacts and friction: [Scene] -> [Scene]."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.physics.vector import Vector, dot

from ...errors import SceneError
from ...frozen import frozen
from ..joints.joints import Joint, Unknown
from .geometry import GeometricContact
from .laws import FRICTION_LAWS, CoulombFriction, UnilateralContact
from .places import GeometryFault, Places, Touch, chosen_tangents, require_independent, rolling_axes

if TYPE_CHECKING:
    from ..scene import Scene


@final
@frozen
class MadeContact:
    """A contact that was made by geometry: its gap [m] as a result, and its description."""

    name: str
    gap: Any
    text: str


def with_made_contacts(scene: Scene) -> Scene:
    """Return the scene with the joints, contacts and friction of its contacts by geometry; itself without any.

    Raises
    ------
    SceneError
        With the faults of all of them.
    """
    if not any(isinstance(item, GeometricContact) for item in scene.contacts):
        return scene
    twin, faults = scene.copy(), []
    twin.contacts = tuple(item for item in scene.contacts if not isinstance(item, GeometricContact))
    for item in scene.contacts:
        if isinstance(item, GeometricContact):
            try:
                places = Places(scene)
                for touch in item.touches(places):
                    _make(twin, places, item, touch)
            except (GeometryFault, ValueError) as fault:  # SymPy raises the latter for frames that nothing relates
                faults.append(f"contact {item.name!r}: {fault}")
    if faults:
        raise SceneError(scene.name, faults)
    return twin


def _make(scene: Scene, places: Places, declared: GeometricContact, touch: Touch) -> None:
    """Add one point of contact to a scene."""
    normal = Unknown(f"{touch.name}.normal", real=True)
    place = places.position(touch.at, "the contact point")
    velocity, moving = places.relative(touch.body, touch.other, touch.surface, place)
    force, text = normal * touch.normal, f"{touch.text}: normal reaction {normal}"
    if not _frictionless(declared.friction):
        tangents = _tangents(places, declared, touch, velocity)
        names = [Unknown(f"{touch.name}.friction_{i}", real=True) for i in range(1, len(tangents) + 1)]
        slip = [dot(velocity, t) for t in tangents] if moving else None
        force += sum((x * t for x, t in zip(names, tangents, strict=True)), Vector(0))
        one = len(tangents) == 1
        scene.frictions += (
            _law(
                declared.friction,
                {
                    "normal": normal,
                    "tangential": names[0] if one else tuple(names),
                    "slip": slip and (slip[0] if one else tuple(slip)),
                    "name": touch.name,
                },
            ),
        )
        along = (f"{name} along {_short(t)}" for name, t in zip(names, tangents, strict=True))
        text += f", friction {', '.join(along)}"
    torque, resisted = _resistances(scene, places, declared, touch, normal)
    turned = {} if torque == 0 else {"torque": torque}
    scene.joints += (Joint(touch.name, body=touch.body, other=touch.other, at=touch.at, force=force, **turned),)
    scene.contacts += (UnilateralContact(normal, touch.gap, declared.restitution, touch.name),)
    scene.made_contacts += (MadeContact(touch.name, touch.distance, text + resisted),)


def _resistances(
    scene: Scene, places: Places, declared: GeometricContact, touch: Touch, normal: Unknown
) -> tuple[Vector, str]:
    """Add the laws of rolling and drilling resistance to a scene; return their moment and their description."""
    torque, text = Vector(0), ""
    for what, given in (("rolling", declared.rolling_resistance), ("drilling", declared.drilling_resistance)):
        if _frictionless(given):
            continue
        spin, moving = places.spin(touch)
        if what == "rolling":
            axes = rolling_axes(places, touch, declared.tangents, spin)
        elif places.vanishes(dot(spin, touch.normal)):
            raise GeometryFault("it does not turn about its normal: leave drilling_resistance= out")
        else:
            axes = (touch.normal,)
        names = tuple(Unknown(f"{touch.name}.{what}_{i}", real=True) for i in range(1, len(axes) + 1))
        slip = tuple(dot(spin, axis) for axis in axes) if moving else None
        law = {"normal": normal, "tangential": names, "slip": slip, "name": f"{touch.name}.{what}"}
        scene.frictions += (_law(given, law, f"{what}_resistance"),)
        torque += sum((x * axis for x, axis in zip(names, axes, strict=True)), Vector(0))
        about = (f"{name} about {_short(axis)}" for name, axis in zip(names, axes, strict=True))
        text += f", {what} resistance {', '.join(about)}"
    return torque, text


def _short(vector: Vector) -> str:
    text = str(vector)
    return text if len(text) <= 60 else "a direction that turns with the normal"


def _tangents(places: Places, declared: GeometricContact, touch: Touch, velocity: Vector) -> tuple[Vector, ...]:
    """Return the directions of slip of a contact with friction."""
    if declared.tangents is not None:
        return chosen_tangents(declared.tangents, touch.normal)
    found = touch.tangents(lambda vector: not places.vanishes(dot(velocity, vector)))
    if not found:
        raise GeometryFault("its contact point has no velocity along its tangents, so that it cannot slip: friction=0")
    require_independent(places, velocity, found)
    return found


def _frictionless(friction: Any) -> bool:
    return friction is None or (not isinstance(friction, tuple | list | str) and bool(friction == 0))


def _law(friction: Any, reactions: dict[str, Any], keyword: str = "friction") -> Any:
    """Return the law of friction of a contact between its reactions."""
    one, pair = ("a coefficient", "(mu_static, mu)") if keyword == "friction" else ("a length", "(static, moving)")
    if type(friction) in FRICTION_LAWS:
        given = [name for name in ("normal", "tangential", "slip") if getattr(friction, name, None) is not None]
        if given:
            raise GeometryFault(
                f"its law of {keyword} has {', '.join(given)}= of its own; the contact gives these, so leave them out"
            )
        return replace(friction, **reactions)
    if isinstance(friction, tuple | list):
        if len(friction) != 2:
            raise GeometryFault(f"{keyword}= as a pair is {pair}, not {friction!r}")
        return CoulombFriction(**reactions, mu=friction[1], mu_static=friction[0])
    if isinstance(friction, int | float | sp.Expr):
        return CoulombFriction(**reactions, mu=friction)
    raise GeometryFault(f"{keyword}= must be {one}, {pair} or a CoulombFriction, and is {friction!r}")
