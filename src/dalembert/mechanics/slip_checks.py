"""Consistency of given slip velocities with the power of friction forces."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import SceneError
from ..ir.graph import Node, unit_names
from ..transforms.linear import SingularMatrix, factorize, matmul, matvec, transpose
from .equations import ConstraintRow
from .kinematics import Kinematics
from .manifold import agree_on_manifold
from .quaternions import quaternion_groups

__all__ = ["require_conjugate_slip"]


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
    positions = [other.position for other in constraints if other.position is not None]
    if not agree_on_manifold(kinematics.q, power, row.jacobian, positions, [row.jacobian for row in constraints]):
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
