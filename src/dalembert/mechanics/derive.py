"""[SceneModel] -> [EquationsOfMotion]: the principle of virtual power, written on the graph."""

from __future__ import annotations

from ..errors import SceneError
from ..ir.derivatives import tangents
from ..ir.graph import Node
from ..ir.linear import Matrix
from ..scene.model import ConstraintModel, SceneModel
from .equations import ConstraintRow, EquationsOfMotion
from .kinematics import Kinematics
from .quasi_velocities import velocity_groups
from .quaternions import quaternion_groups
from .virtual_power import powers

__all__ = ["derive"]


def derive(model: SceneModel) -> EquationsOfMotion:
    """Return the equations of motion of a scene, unconstrained (assumption 13.1.2) beside its constraints.

    Raises
    ------
    SceneError
        When a reaction enters an action otherwise than linearly.
    """
    kinematics = Kinematics(model)
    power = powers(kinematics)
    forcing, reactions = _split(model, power.forcing)
    return EquationsOfMotion(
        name=model.name,
        graph=model.graph,
        symbols=model.symbols,
        q=tuple(kinematics.q),
        qdot=tuple(kinematics.qdot),
        mass_matrix=power.mass_matrix,
        forcing=tuple(forcing),
        reactions=reactions,
        constraints=tuple(
            [_holonomic(kinematics, constraint) for constraint in model.holonomic]
            + [_nonholonomic(kinematics, constraint) for constraint in model.nonholonomic]
        ),
        kinetic_energy=power.kinetic_energy,
        potential_energy=power.gravity_potential + model.potential,
        groups=(*quaternion_groups(kinematics), *velocity_groups(kinematics)),
        outputs=model.outputs,
    )


def _split(model: SceneModel, power: list[Node]) -> tuple[list[Node], Matrix]:
    """Separate the powers into the part without reactions and the coefficients of the reactions."""
    graph = model.graph
    unknowns = [graph.input(name) for name in model.symbols.unknowns]
    if not unknowns:
        return power, [[] for _ in power]
    given = graph.substitute(power, dict.fromkeys(unknowns, graph.zero))
    columns = [tangents(graph, power, {unknown: graph.one}) for unknown in unknowns]
    faults = []
    for name, column in zip(model.symbols.unknowns, columns, strict=True):
        for place, entry in enumerate(column):
            freed = graph.freed_of(entry, unknowns)
            if freed is None:
                faults.append(f"the unknown {name!r} enters an action nonlinearly; reactions must be linear components")
                break
            column[place] = freed
    if faults:
        raise SceneError(model.name, faults)
    return given, [list(row) for row in zip(*columns, strict=True)]


def _holonomic(kinematics: Kinematics, constraint: ConstraintModel) -> ConstraintRow:
    velocity = tangents(kinematics.graph, [constraint.expression], kinematics.flow)[0]
    return _row(kinematics, constraint.label, constraint.expression, velocity)


def _nonholonomic(kinematics: Kinematics, constraint: ConstraintModel) -> ConstraintRow:
    return _row(kinematics, constraint.label, None, constraint.expression)


def _row(kinematics: Kinematics, label: str, position: Node | None, velocity: Node) -> ConstraintRow:
    graph, rates = kinematics.graph, kinematics.qdot
    still = dict.fromkeys(rates, graph.zero)
    slopes = [tangents(graph, [velocity], {rate: graph.one})[0] for rate in rates]
    *jacobian, drift = graph.substitute([*slopes, velocity], still)
    bias = -tangents(graph, [velocity], kinematics.flow)[0]
    return ConstraintRow(label, position, tuple(jacobian), drift, bias)
