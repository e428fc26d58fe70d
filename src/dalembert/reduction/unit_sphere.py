"""Unit quaternions as inputs whose norm is identically one on the graph.

On them e.e is the node 1, so that what a quaternion turns becomes as short as what angles turn, and the angular
velocity in terms of e and e_dot is the one that it was solved for. Only derivatives along rates that keep the length
may be taken of such values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..errors import ConstraintError
from ..ir.node import Node, unit_names
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..mechanics.quasi_velocities import VelocityChoice, VelocityGroup
from ..transforms.linear import Matrix
from .base import Projection


def _constrained_quaternions(equations: EquationsOfMotion) -> list[VelocityGroup]:
    """Return the groups of quaternions whose length is among the constraints."""
    labels = {row.label for row in equations.constraints}
    return [group for group in equations.groups if group.norm in labels]


def unit_values(equations: EquationsOfMotion) -> dict[Node, Node]:
    """Return the components of quaternions whose length is among the constraints, and the inputs on the unit sphere."""
    values: dict[Node, Node] = {}
    for group in _constrained_quaternions(equations):
        names = unit_names([equations.symbols.coordinates[i] for i in group.coordinates])
        for i, name in zip(group.coordinates, names, strict=True):
            values[equations.q[i]] = equations.graph.input(name)
    return values


def on_unit_sphere(equations: EquationsOfMotion) -> EquationsOfMotion:
    """Return equations in which quaternions of length one are on the unit sphere, without the constraints of that.

    Raises
    ------
    ConstraintError
        Where forces that were solved for have no value there, as of contacts that depend on each other.
    """
    held = _constrained_quaternions(equations)
    lost = [group for group in equations.groups if group.norm and group not in held]
    if lost:
        equations = replace(equations, groups=tuple(group for group in equations.groups if group not in lost))
    if not held:
        return equations
    graph, values = equations.graph, unit_values(equations)

    def moved(nodes: Sequence[Node]) -> tuple[Node, ...]:
        try:
            return tuple(graph.substitute(nodes, values))
        except ZeroDivisionError as error:
            raise ConstraintError(
                f"scene {equations.name!r}: reactions are not determined where the quaternions have length one, because"
                " constraints or sticking contacts, as two on one body, depend on each other there while another"
                " slides: leave one of them out, or give a contact friction=0 or a regularization"
            ) from error

    def matrix(rows: Matrix) -> list[list[Node]]:
        return [list(moved(row)) for row in rows]

    def choice(old: VelocityChoice) -> VelocityChoice:
        rows, inverse = (tuple(moved(row) for row in table) for table in (old.rows, old.inverse))
        return VelocityChoice(old.names, rows, inverse)

    def row(old: ConstraintRow) -> ConstraintRow:
        position = None if old.position is None else moved([old.position])[0]
        drift, bias = moved([old.drift, old.bias])
        return replace(old, position=position, jacobian=moved(old.jacobian), drift=drift, bias=bias)

    norms = {group.norm for group in held}
    return replace(
        equations,
        q=tuple(values.get(q, q) for q in equations.q),
        dense=None if equations.dense is None else matrix(equations.dense),
        tree=None if equations.tree is None else equations.tree.substituted(graph, values),
        forcing=moved(equations.forcing),
        state_rates=moved(equations.state_rates),
        reactions=matrix(equations.reactions),
        constraints=tuple(row(old) for old in equations.constraints if old.label not in norms),
        groups=tuple(replace(group, choices=tuple(map(choice, group.choices))) for group in equations.groups),
    )


def from_unit_sphere(scene: EquationsOfMotion, equations: EquationsOfMotion, nodes: Sequence[Node]) -> list[Node]:
    """Return nodes of `on_unit_sphere` in the coordinates of the scene."""
    values = {b: a for a, b in zip(scene.q, equations.q, strict=True) if a is not b}
    return scene.graph.substitute(nodes, values) if values else list(nodes)


def unit_notes(equations: EquationsOfMotion) -> list[str]:
    """Return notes on the normalisation of quaternions, for `explain()`."""
    names = equations.symbols.coordinates
    listed = [", ".join(names[i] for i in group.coordinates) for group in _constrained_quaternions(equations)]
    return [f"({e}) stays a unit quaternion: it is brought to length one after every step" for e in listed]


def normalisation(equations: EquationsOfMotion, kept: Sequence[str], speeds: int) -> Projection | None:
    """Return the Newton corrections that keep quaternions at length one, where the state has any."""
    graph, held = equations.graph, _constrained_quaternions(equations)
    if not held:
        return None
    moves = dict.fromkeys(kept, graph.zero)
    for group in held:
        e = [equations.q[i] for i in group.coordinates]
        share = graph.node(0.5) * (1 - graph.sum(x * x for x in e))
        moves |= {equations.symbols.coordinates[i]: share * equations.q[i] for i in group.coordinates}
    nothing = [graph.zero] * speeds
    return Projection((*moves.values(), *nothing), tuple([graph.zero] * (len(moves) + speeds)))
