"""Check that joints can exert something on the constraints of a scene."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import ConstraintError, list_names
from ..ir.graph import Graph, Node
from ..ir.zero_tests import vanishes
from ..scene.model import SceneModel
from .equations import EquationsOfMotion
from .manifold import meets_span_on_manifold

__all__ = ["parallel", "require_reactions_of_constraints"]


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
        deps = 0
        for piece in (*action.force, *action.torque):
            for component in piece.components:
                deps |= component.deps
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
