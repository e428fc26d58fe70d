"""Checks that joints can exert something on constraints, and that slip velocities are those of friction."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import ConstraintError, SceneError, list_names
from ..ir.graph import Graph
from ..ir.node import Node, unit_names
from ..ir.zero_tests import vanishes
from ..scene.model import SceneModel
from ..transforms.linear import SingularMatrix, factorize, matmul, matvec, transpose
from .equations import ConstraintRow, EquationsOfMotion
from .kinematics import Kinematics
from .manifold import agree_on_manifold, meets_span_on_manifold
from .quasi_velocities import quaternion_groups


def require_reactions_of_constraints(model: SceneModel, equations: EquationsOfMotion) -> None:
    """Raise for joints that have power on allowed motions alone, whatever their unknown components are.

    Constraints are ideal: they are held by reactions without power on the motions that they allow. A joint none of
    whose forces is such a reaction would hold nothing, and the motion would be that of another joint than the one
    described. Components with power beside others that make a reaction are zero, as the moment of the Chaplygin
    sleigh's blade, and no fault. Unknowns of contacts have laws of their own, and unknowns without any power are
    undetermined, which is an error where an output asks for them.

    Raises
    ------
    ConstraintError
        With the joint, its unknowns, and what to do.
    """
    rows, graph = equations.constraints, equations.graph
    if not rows:
        return
    names = equations.symbols.unknowns
    columns = {x: [row[i] for row in equations.reactions] for i, x in enumerate(names)}
    lawful = {names[i] for contact in equations.contacts for i in (contact.normal, *contact.tangential)}
    positions = [row.position for row in rows if row.position is not None]
    jacobian = [row.jacobian for row in rows]
    for joint, mine in _unknowns_of_joints(model, names).items():
        if lawful & set(mine):
            continue
        own = [columns[x] for x in mine if not all(vanishes(entry) for entry in columns[x])]
        if not own or any(parallel(graph, row, column) for row in jacobian for column in own):
            continue
        if meets_span_on_manifold(equations.q, own, positions, jacobian) is False:
            raise ConstraintError(
                f"scene {equations.name!r}: the joint {joint!r} cannot exert the reactions of any constraint, because"
                f" {list_names(mine)} would have power on motions that the constraints allow. Give it the unknown force"
                " or torque component that holds its constraint, add that constraint if it is missing, or give a force"
                " that drives the motion as a load (scene.add_loads)"
            )


def _unknowns_of_joints(model: SceneModel, names: Sequence[str]) -> dict[str, list[str]]:
    """Return the unknowns that occur in each joint, by its name."""
    masks = {name: model.graph.mask([name]) for name in names}
    found: dict[str, list[str]] = {}
    for action in model.actions:
        deps = action.deps
        mine = [name for name, mask in masks.items() if deps & mask]
        if mine:
            found[action.name] = list(dict.fromkeys([*found.get(action.name, ()), *mine]))
    return found


def parallel(graph: Graph, row: Sequence[Node], column: Sequence[Node]) -> bool:
    """Return whether a reaction has power along the row of a constraint alone, at all positions."""
    pivot = next((i for i, entry in enumerate(row) if not entry.is_zero), None)
    if pivot is None:
        return False
    return all(vanishes(graph.sum((row[pivot] * r, -(column[pivot] * j)))) for j, r in zip(row, column, strict=True))


# Consistency of given slip velocities with the power of friction forces.


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
