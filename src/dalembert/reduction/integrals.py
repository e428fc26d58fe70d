"""Functions of coordinates and rates that may be first integrals: energy, Jacobi's integral, and momenta.

With p = dT/dq_dot, the momentum along a direction xi(q) of the coordinates is p . xi: along a coordinate, or along an
axis of the angular velocity of a frame that a unit quaternion orients, about which it is an angular momentum. Jacobi's
integral p . q_dot - T + V = T2 - T0 + V differs from the energy T + V where bodies move by prescribed functions of time
(H. Goldstein, Classical Mechanics, section 2.7).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..errors import list_names
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion
from ..transforms.derivatives import tangents

ENERGY, JACOBI = "energy", "jacobi"


@final
@frozen
class Integral:
    """A function that may be conserved, and the change of the coordinates (n_q) that generates it.

    That is their rates for the energy and Jacobi's integral, and a direction for a momentum.
    """

    value: Node
    along: tuple[Node, ...]


def integrals(equations: EquationsOfMotion, graph: Graph | None = None) -> dict[str, Integral]:
    """Return the functions by name, on a graph, by default that of the equations; momenta are left out that vanish."""
    graph = equations.graph if graph is None else graph
    qdot = tuple(graph.adopt(equations.qdot))
    kinetic, potential = equations.energies(graph)
    momenta = momenta_of(graph, kinetic, qdot)
    found = {ENERGY: Integral(kinetic + potential, qdot)}
    action = graph.sum(p * rate for p, rate in zip(momenta, qdot, strict=True))
    if not (action - 2 * kinetic).is_zero:
        found[JACOBI] = Integral(action - kinetic + potential, qdot)
    for name, along in _directions(equations, graph).items():
        value = graph.sum(p * share for p, share in zip(momenta, along, strict=True))
        if not value.is_zero:
            found[name] = Integral(value, along)
    return found


def momenta_of(graph: Graph, kinetic: Node, qdot: Sequence[Node]) -> list[Node]:
    """Return the derivatives (n_q) of the kinetic energy by the rates."""
    return [tangents(graph, [kinetic], {rate: graph.one})[0] for rate in qdot]


def _directions(equations: EquationsOfMotion, graph: Graph) -> dict[str, tuple[Node, ...]]:
    """Return directions of the coordinates (n_q), by the names of the momenta along them."""
    names = equations.symbols.coordinates
    places = range(len(names))
    found = {f"p_{name}": tuple(graph.one if i == j else graph.zero for j in places) for i, name in enumerate(names)}
    for group in equations.groups:
        for choice in group.choices if group.norm else ():
            columns = zip(*(graph.adopt(row) for row in choice.inverse), strict=True)
            for speed, column in zip(choice.names, columns, strict=True):
                own = dict(zip(group.coordinates, column, strict=True))
                name = f"p_{speed}"
                if name in found:  # of two bodies, whose parent is the same frame
                    name += f" of {', '.join(names[i] for i in group.coordinates)}"
                found[name] = tuple(own.get(i, graph.zero) for i in places)
    return found


def why_not(equations: EquationsOfMotion, name: str) -> str:
    """Return the reason why a candidate is not conserved, for messages."""
    return _of_energy(equations, name) if name in (ENERGY, JACOBI) else _of_momentum(equations, name)


def _of_momentum(equations: EquationsOfMotion, name: str) -> str:
    graph, along = equations.graph, integrals(equations)[name].along
    held = [
        row.label
        for row in equations.constraints
        if not graph.sum(a * b for a, b in zip(row.jacobian, along, strict=True)).is_zero
    ]
    x = name.removeprefix("p_")
    if held:
        return f"constraints act along {x!r}: {', '.join(held)}"
    return f"a force acts along {x!r}, or the kinetic or potential energy depends on it"


def _of_energy(equations: EquationsOfMotion, name: str) -> str:
    graph, time = equations.graph, {equations.time: equations.graph.one}
    loads = equations.load_energy
    moving = [row.label for row in equations.constraints if not row.drift.is_zero]
    if moving:
        return f"constraints that depend on time do work: {', '.join(moving)}"
    energies = equations.energies(graph)
    if not all(change.is_zero for change in tangents(graph, energies, time)):
        return "the scene depends explicitly on time"
    if name == ENERGY and JACOBI in integrals(equations):
        return "prescribed motions of bodies do work"
    named = dict.fromkeys((*loads.rates, *loads.time, *loads.states, *loads.unknown))
    which = f": {list_names(named)}" if named else ", such as friction"
    return f"forces without a potential energy do work{which}"
