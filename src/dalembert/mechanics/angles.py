"""Coordinates without a unit: angles, and components of quaternions.

Initial values are compared with sizes of their own kind (`dalembert.reduction.start_limits`): an angle with one,
whatever the unit of length, and every other coordinate with the lengths of the scene.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Graph, Node
from ..scene.model import SceneModel
from ..transforms.linear import Matrix
from .equations import ConstraintRow

__all__ = ["angles_of"]

_CIRCULAR = ("sin", "cos", "tan")
_LINEAR = ("add", "sub", "neg", "mul")


def angles_of(model: SceneModel, rows: Sequence[ConstraintRow], matrix: Matrix) -> tuple[str, ...]:
    """Return the names of the coordinates without a unit.

    These turn a frame by themselves, without a parameter, or are added to the argument of a sine, a cosine or a
    tangent.
    """
    graph, coordinates = model.graph, model.symbols.coordinates
    turned = [x for frame in model.frames for row in frame.rotation or () for x in row]
    placed = [x for point in model.points for piece in point.position for x in piece.components]
    held = [x for row in rows for x in (row.position, *row.jacobian) if x is not None]
    if model.given is not None or model.lagrangian is not None:
        held += [x for row in matrix for x in row]
    given = graph.mask(model.symbols.parameters)
    bare = 0
    for node in turned:
        bare |= 0 if node.deps & given else node.deps
    for node in Graph.topological([*turned, *placed, *held]):
        if node.op in _CIRCULAR:
            bare |= _added(node.args[0])
    return tuple(name for name in coordinates if graph.input(name).deps & bare)


def _added(node: Node) -> int:
    """Return the dependency bits of the inputs of which multiples by numbers are added to a value."""
    if node.op == "input":
        return node.deps
    if node.op not in _LINEAR or (node.op == "mul" and not any(arg.op == "const" for arg in node.args)):
        return 0
    found = 0
    for arg in node.args:
        found |= _added(arg)
    return found
