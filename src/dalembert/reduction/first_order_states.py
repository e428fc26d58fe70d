"""First-order states beside the state of a formulation: [ReducedSystem] -> [ReducedSystem]."""

from __future__ import annotations

from dataclasses import replace

from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion
from .base import Projection, ReducedSystem, StageSystem


def with_states(system: ReducedSystem, equations: EquationsOfMotion) -> ReducedSystem:
    """Return a system whose state ends with the first-order states of its scene.

    Projections leave them as they are; implicit methods have them among the components with rates, before multipliers.

    Parameters
    ----------
    system : ReducedSystem
        Of a formulation; its state has coordinates and speeds alone.
    equations : EquationsOfMotion
        That were reduced, with coordinates and rates of the scene as inputs.
    """
    if not equations.states:
        return system
    graph, states = equations.graph, equations.states
    scene, found = (*equations.q, *equations.qdot), (*system.coordinates, *system.rates)
    values = {a: b for a, b in zip(scene, found, strict=True) if a is not b}
    rates = graph.substitute(equations.state_rates, values) if values else equations.state_rates
    return replace(
        system,
        state=(*system.state, *equations.symbols.states),
        inputs=(*system.inputs, *states),
        rhs=(*system.rhs, *rates),
        initial=(*system.initial, *states),
        projection=_extended(system.projection, states),
        start_projection=_extended(system.start_projection, states),
        stages=_staged(system.stages, equations, len(system.inputs)),
    )


def _extended(projection: Projection | None, states: tuple[Node, ...]) -> Projection | None:
    if projection is None:
        return None
    nothing = [states[0].graph.zero] * len(states)
    return Projection((*projection.position, *nothing), (*projection.velocity, *nothing))


def _staged(stages: StageSystem | None, equations: EquationsOfMotion, size: int) -> StageSystem | None:
    if stages is None:
        return None
    return replace(
        stages,
        inputs=(*stages.inputs[:size], *equations.states, *stages.inputs[size:]),
        rhs=(*stages.rhs[:size], *equations.state_rates, *stages.rhs[size:]),
    )
