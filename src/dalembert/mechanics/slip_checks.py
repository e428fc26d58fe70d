"""Consistency of given slip velocities with the power of friction forces."""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..ir.graph import Node, unit_names
from ..ir.linear import SingularMatrix, factorize, matmul, matvec, transpose
from ..ir.rounding import evaluate, random_inputs
from .equations import ConstraintRow
from .kinematics import Kinematics
from .quaternions import quaternion_groups

__all__ = ["require_conjugate_slip"]

FloatArray = NDArray[np.float64]
_POINTS, _DRAWS, _ITERATIONS = 3, 60, 60
_TOLERANCE = 1e-9
"""Relative size of the part of a slip velocity that counts as zero at points that satisfy the constraints."""


def require_conjugate_slip(
    kinematics: Kinematics,
    contact: str,
    force: str,
    power: Sequence[Node],
    row: ConstraintRow,
    constraints: Sequence[ConstraintRow],
) -> None:
    """Raise unless the slip velocity times the force is the power of friction on motions that constraints allow.

    Parameters
    ----------
    kinematics : Kinematics
    contact, force : str
        Names of the contact and of the friction force.
    power : sequence of Node, length n_q
        Power coefficients of the force.
    row : ConstraintRow
        The slip velocity.
    constraints : sequence of ConstraintRow
        Those that hold whenever the contact is closed.

    Raises
    ------
    SceneError
        When they differ at positions and velocities that satisfy the constraints.
    """
    name = kinematics.model.name
    if all(p.is_zero for p in power):
        why = f"{force} has no power on any coordinate, so that it cannot hold anything"
        raise SceneError(name, [f"friction {contact!r}: {why}; the joint must act on a body that can slip"])
    rest = [p - j for p, j in zip(power, row.jacobian, strict=True)]
    if all(node.is_zero for node in rest) or _in_span(kinematics, rest, constraints):
        return
    if not _in_span_on_manifold(kinematics, power, row.jacobian, constraints):
        raise SceneError(
            name,
            [
                f"friction {contact!r}: the slip velocity given for {force} is not the one that {force} has power on,"
                " at positions and velocities that satisfy the constraints that hold while the contact is closed; leave"
                " slip out, or write the velocity of the body's point of contact along that force, less that of what it"
                " slips on"
            ],
        )


def _units(kinematics: Kinematics) -> dict[Node, Node]:
    """Return unit quaternions among the coordinates as points of the unit sphere, on which e.e is the node 1."""
    units: dict[Node, Node] = {}
    for group in quaternion_groups(kinematics):
        e = [kinematics.q[i] for i in group.coordinates]
        names = unit_names([kinematics.model.symbols.coordinates[i] for i in group.coordinates])
        units |= dict(zip(e, map(kinematics.graph.input, names), strict=True))
    return units


def _in_span(kinematics: Kinematics, rest: Sequence[Node], constraints: Sequence[ConstraintRow]) -> bool:
    """Whether a covector is a combination of the constraint Jacobian's rows at every position, exactly."""
    graph, units = kinematics.graph, _units(kinematics)
    rest = graph.substitute(rest, units) if units else rest
    base: list[list[Node]] = []
    weights: list[Node] = []
    for other in constraints:
        trial = [*base, graph.substitute(other.jacobian, units) if units else list(other.jacobian)]
        try:
            weights = factorize(graph, matmul(graph, trial, transpose(trial))).solve(matvec(graph, trial, rest))
        except SingularMatrix:
            continue
        base = trial
    if base:
        rest = [r - v for r, v in zip(rest, matvec(graph, transpose(base), weights), strict=True)]
    return all(node.is_zero for node in rest)


def _in_span_on_manifold(
    kinematics: Kinematics, power: Sequence[Node], slip: Sequence[Node], constraints: Sequence[ConstraintRow]
) -> bool:
    """Whether the difference is such a combination at random positions that satisfy the constraints."""
    q, size = kinematics.q, len(kinematics.q)
    positions = [row.position for row in constraints if row.position is not None]
    jacobian = [node for row in constraints for node in row.jacobian]
    nodes = [*positions, *jacobian, *power, *slip]
    found = 0
    for seed in range(_DRAWS):
        draw = random.Random(seed)
        values = random_inputs([*nodes, *q], draw)
        place = _consistent(nodes, q, len(positions), values | {x: draw.uniform(-1.5, 1.5) for x in q})
        if place is None:
            continue
        flat = _numbers(nodes, place)[len(positions) :]
        if not np.all(np.isfinite(flat)):
            continue
        rows, (p, s) = flat[: len(jacobian)].reshape(-1, size), flat[len(jacobian) :].reshape(2, size)
        rest = p - s
        if len(rows):
            rest = rest - rows.T @ np.linalg.lstsq(rows.T, rest, rcond=1e-10)[0]
        if np.abs(rest).max() > _TOLERANCE * max(np.abs(p).max(), np.abs(s).max()):
            return False
        found += 1
        if found == _POINTS:
            return True
    return False


def _consistent(
    nodes: Sequence[Node], q: Sequence[Node], count: int, values: dict[Node, float]
) -> dict[Node, float] | None:
    """Return values with coordinates moved onto the first `count` nodes' zeros by Newton's method, or None."""
    size = len(q)
    for _ in range(_ITERATIONS):
        if not count:
            return values
        flat = _numbers(nodes[: count + count * size], values)
        if not np.all(np.isfinite(flat)):
            return None
        residual, rows = flat[:count], flat[count:].reshape(count, size)
        step = np.linalg.lstsq(rows, residual, rcond=1e-10)[0]
        largest = float(np.abs(step).max())
        x = np.array([values[node] for node in q]) - step / max(1.0, largest)
        values = values | dict(zip(q, map(float, x), strict=True))
        if largest < 1e-14 * max(1.0, float(np.abs(x).max())):
            return values if np.abs(residual).max() < 1e-11 else None
    return None


def _numbers(nodes: Sequence[Node], values: dict[Node, float]) -> FloatArray:
    return np.array([value for value, _ in evaluate(nodes, values)])
