"""Reactions of contacts that share a load indeterminately, and outputs in terms of them."""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Node
from .base import ReducedSystem
from .reactions import requested_outputs

__all__ = ["shared_reactions"]


def shared_reactions(system: ReducedSystem) -> tuple[Sequence[Node], Sequence[Node]] | None:
    """Return what decides the reactions, and the outputs in terms of them as inputs; None where none is asked for.

    What decides them is those of least norm, the power coefficients and the rows of the cones
    (`EquationsOfMotion.cones`), in terms of t and the state.
    """
    equations = system.equations
    own = {guard.output for guard in equations.guards}
    asked = [name for name in system.outputs if name not in own]
    if not equations.cones or not asked:
        return None
    values = dict(zip((*equations.q, *equations.qdot), (*system.coordinates, *system.rates), strict=True))
    values = {a: b for a, b in values.items() if a is not b}
    unknowns = set(equations.unknowns)
    held = requested_outputs(equations, list(system.outputs), values, system.accelerations, solve=False).outputs
    if not any(node in unknowns for node in equations.graph.topological([held[name] for name in asked])):
        return None
    least = requested_outputs(equations, equations.symbols.unknowns, values, system.accelerations).outputs
    entries = [entry for row in (*equations.reactions, *equations.cones) for entry in row]
    decide = [*least.values(), *equations.graph.substitute(entries, values)]
    return decide, list(held.values())
