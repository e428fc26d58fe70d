"""Directions of slip of contacts by geometry: one where the kinematics are those of a plane, two in space."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import sympy as sp
from sympy.physics.mechanics import ReferenceFrame
from sympy.physics.vector import Vector, cross, dot, dynamicsymbols

from .contact_places import GeometryFault, Moves, Places, Touch, frame_of, several, unit_vector
from .identity import vanishes

_ROTATED = ((2, 3, 6), (3, -6, 2), (6, 2, -3))
"""Seven times three perpendicular unit vectors, along no symmetry of a scene."""


def tangents_of_plane(normal: Vector) -> Callable[[Moves], tuple[Vector, ...]]:
    """Return the tangents of a plane that slip is possible along, axes of its frame where these are tangents."""
    return lambda moves: tuple(t for t in _along_plane(normal) if moves(t))


def _along_plane(normal: Vector) -> tuple[Vector, Vector]:
    frame, n = frame_of(normal, "the normal"), [sp.sympify(x) for x in normal.args[0][0]]
    axes = (frame.x, frame.y, frame.z)
    flat = [i for i in range(3) if n[i] == 0]
    if len(flat) == 2:
        return axes[flat[0]], axes[flat[1]]
    if len(flat) == 1:
        return cross(normal, axes[flat[0]]), axes[flat[0]]
    if not all(x.is_number for x in n):
        raise GeometryFault(
            f"the tangents of its plane with the normal {normal} may be chosen in many ways: give tangents=(t_1, t_2)"
        )
    axis = axes[min(range(3), key=lambda i: abs(n[i]))]
    first = (axis - dot(axis, normal) * normal).normalize()
    return first, cross(normal, first)


def tangents_of_sphere(frame: ReferenceFrame, normal: Vector, unit: Vector) -> Callable[[Moves], tuple[Vector, ...]]:
    """Return the tangents of a sphere: one where all happens in a plane of axes of the frame, two in space.

    Two come from a rotation that turns a fixed vector to the normal, and are singular where that is the opposite of it.
    The fixed vector is along no symmetry of a scene, so that motions do not meet its opposite. `unit` is the normal at
    length one.
    """

    def tangents(moves: Moves) -> tuple[Vector, ...]:
        for axis in (frame.z, frame.y, frame.x):
            if vanishes(dot(normal, axis)) and not moves(axis):
                return (cross(axis, normal),)
        start, *others = ((x * frame.x + y * frame.y + z * frame.z) / sp.Integer(7) for x, y, z in _ROTATED)
        return tuple(b - dot(unit, b) / (1 + dot(unit, start)) * (unit + start) for b in others)

    return tangents


def tangents_of_cylinder(axis: Vector, normal: Vector) -> Callable[[Moves], tuple[Vector, ...]]:
    """Return the tangents along a cylinder and around it."""
    return lambda moves: tuple(t for t in (cross(axis, normal), axis) if moves(t))


def chosen_tangents(given: Any, normal: Vector) -> tuple[Vector, ...]:
    """Return the tangents that a user gave: unit vectors, perpendicular to the normal and to each other."""
    listed = (given,) if isinstance(given, Vector) else several(given, (1, 2), "tangents=")
    found = tuple(unit_vector(t, "each of tangents=") for t in listed)
    pairs = [(t, normal, "the normal") for t in found] + ([(*found, "the other")] if len(found) == 2 else [])
    for first, second, what in pairs:
        if not vanishes(dot(first, second)):
            raise GeometryFault(f"tangents= must be perpendicular: {first} is not perpendicular to {what}")
    return found


def rolling_axes(places: Places, touch: Touch, given: Any, spin: Vector) -> tuple[Vector, ...]:
    """Return the tangents about which a body rolls: one where all turns about one axis of the scene, two in space.

    `given` are the directions of slip that a user chose, None otherwise. `spin` is the relative angular velocity.
    """

    def turns(vector: Vector) -> bool:
        return not places.vanishes(dot(spin, vector))

    if given is not None:
        chosen = chosen_tangents(given, touch.normal)
        found = chosen if len(chosen) == 2 else (cross(touch.normal, chosen[0]),)
    else:
        axes = [axis for axis in places.frame if turns(axis)]
        flat = len(axes) == 1 and vanishes(dot(touch.normal, axes[0]))
        found = (axes[0],) if flat else touch.tangents(lambda vector: True)
    found = tuple(axis for axis in found if turns(axis))
    if not found:
        raise GeometryFault("it turns about no tangent, so that it cannot roll: leave rolling_resistance= out")
    require_independent(places, spin, found, "turn about one axis in its plane")
    return found


def require_independent(
    places: Places, velocity: Vector, tangents: tuple[Vector, ...], does: str = "slip along one direction in its plane"
) -> None:
    """Raise where the components of a velocity along two tangents are multiples of each other: it has one direction.

    Then those at two sets of rates are parallel, whatever the rates are.
    """
    if len(tangents) < 2:
        return
    rates = {q.diff(dynamicsymbols._t): sp.Dummy(real=True) for q in places.scene.coordinates}
    first, second = (dot(velocity, t) for t in tangents)
    if places.vanishes(first * second.xreplace(rates) - second * first.xreplace(rates)):
        raise GeometryFault(
            f"it can {does}, which is none of its tangents: give the direction of slip as tangents=(t,)"
        )
