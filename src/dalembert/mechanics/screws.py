"""Vectors of three components; screws, twists and inertias, from step to step of a tree of bodies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, final

from ..ir.graph import Graph
from ..ir.node import Node
from ..scene.model import Components

if TYPE_CHECKING:
    from .kinematics import Motion

Rows = tuple[Components, Components, Components]
Screw = tuple[Components, Components]
"""Resultant and moment about the point of a step."""
Twist = tuple[Components, Components]
"""Angular velocity and velocity of the point of a step, or their rates."""


class Step(Protocol):
    """Rotation of a frame or displacement of its point."""

    @property
    def rotation(self) -> Rows | None:
        """Rows such that components here = rotation * components of the parent."""

    @property
    def offset(self) -> Components | None:
        """Position from the point of the parent, where nothing turns."""


# Three-component vectors of graph nodes.


def zero(graph: Graph) -> Components:
    """Return the zero vector."""
    return graph.zero, graph.zero, graph.zero


def is_zero(a: Components) -> bool:
    """Whether all components are identically zero."""
    return all(x.is_zero for x in a)


def add(a: Components, b: Components) -> Components:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Components, b: Components) -> Components:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(factor: Node, a: Components) -> Components:
    """Return factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


def cross(a: Components, b: Components) -> Components:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Components, b: Components) -> Node:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def rotate(matrix: Sequence[Components], a: Components) -> Components:
    """Return matrix a."""
    return dot(matrix[0], a), dot(matrix[1], a), dot(matrix[2], a)


def rotate_back(matrix: Sequence[Components], a: Components) -> Components:
    """Return the transposed matrix times a."""
    return (
        matrix[0][0] * a[0] + matrix[1][0] * a[1] + matrix[2][0] * a[2],
        matrix[0][1] * a[0] + matrix[1][1] * a[1] + matrix[2][1] * a[2],
        matrix[0][2] * a[0] + matrix[1][2] * a[1] + matrix[2][2] * a[2],
    )


# Screws and inertias.


@final
@dataclass(frozen=True, slots=True)
class Inertia:
    """Mass, first moment and inertia about the point of a step."""

    mass: Node
    moment: Components
    second: Rows


def power(motion: Motion, screw: Screw) -> Node:
    """Return the power coefficient of a screw: its product with a partial kinematic screw."""
    return dot(motion.direction, screw[1] if motion.angular else screw[0])


def add_screw(old: Screw | None, screw: Screw) -> Screw:
    """Return the sum of two screws about one point."""
    return screw if old is None else (add(old[0], screw[0]), add(old[1], screw[1]))


def carry_screw(step: Step, screw: Screw) -> Screw:
    """Return a screw of a step about the point, and in the components, of its parent."""
    resultant, moment = screw
    if step.offset is not None:
        return resultant, add(moment, cross(step.offset, resultant))
    assert step.rotation is not None
    return rotate_back(step.rotation, resultant), rotate_back(step.rotation, moment)


def carry_twist(step: Step, twist: Twist) -> Twist:
    """Return what a step has of the twist of its parent."""
    omega, v = twist
    if step.offset is not None:
        return omega, add(v, cross(omega, step.offset))
    assert step.rotation is not None
    return rotate(step.rotation, omega), rotate(step.rotation, v)


def moved_twist(motions: Iterable[Motion], twist: Twist | None, x: Sequence[Node]) -> Twist | None:
    """Return a twist with what coordinates add to it whose rates are x; None for a twist that is zero."""
    for motion in motions:
        rate = x[motion.coordinate]
        nothing = zero(rate.graph)  # type: ignore[arg-type]  # an Algebra
        omega, v = twist or (nothing, nothing)
        part = scale(rate, motion.direction)
        twist = (add(omega, part), v) if motion.angular else (omega, add(v, part))
    return twist


def momentum(inertia: Inertia, twist: Twist) -> Screw:
    """Return the momentum of bodies and its moment."""
    omega, v = twist
    moment = add(rotate(inertia.second, omega), cross(inertia.moment, v))
    return add(scale(inertia.mass, v), cross(omega, inertia.moment)), moment


def momentum_screw(inertia: Inertia, motion: Motion) -> Screw:
    """Return the momentum of bodies that move with a partial kinematic screw."""
    if motion.angular:
        return cross(motion.direction, inertia.moment), rotate(inertia.second, motion.direction)
    return scale(inertia.mass, motion.direction), cross(inertia.moment, motion.direction)


def add_inertia(old: Inertia | None, new: Inertia) -> Inertia:
    """Return the inertia of two bodies about one point."""
    if old is None:
        return new
    a, b = old.second, new.second
    second = (add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2]))
    return Inertia(old.mass + new.mass, add(old.moment, new.moment), second)


def carry_inertia(step: Step, inertia: Inertia) -> Inertia:
    """Return an inertia of a step about the point, and in the components, of its parent."""
    if step.rotation is not None:
        c = step.rotation
        half = [rotate_back(c, row) for row in inertia.second]
        columns = [rotate_back(c, (half[0][j], half[1][j], half[2][j])) for j in range(3)]
        return Inertia(inertia.mass, rotate_back(c, inertia.moment), symmetric(columns))
    r, h, m = step.offset, inertia.moment, inertia.mass
    assert r is not None
    total = add(add(h, h), scale(m, r))
    trace = dot(total, r)
    moment = add(h, scale(m, r))
    columns = []
    for i in range(3):
        # J + (2 h.r + m r.r) 1 - h r^T - r h^T - m r r^T, written with h + m r
        column = [inertia.second[j][i] - moment[j] * r[i] - r[j] * h[i] for j in range(3)]
        column[i] = column[i] + trace
        columns.append((column[0], column[1], column[2]))
    return Inertia(m, moment, symmetric(columns))


def symmetric(columns: Sequence[Components]) -> Rows:
    """Return a symmetric matrix from the lower parts of its columns."""
    (a, b, c), (_, d, e), (_, _, f) = columns
    return (a, b, c), (b, d, e), (c, e, f)


def turned(c: Rows, rows: Rows) -> Rows:
    """Return c^T rows c."""
    half = [rotate_back(c, row) for row in rows]
    x, y, z = (rotate_back(c, (half[0][j], half[1][j], half[2][j])) for j in range(3))
    return (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])
