"""Candidates of first integrals: energy, and the momenta dT/dq_dot of coordinates.

With p = M q_dot, along every motion dp_i/dt = (dp_i/dq . q_dot + dp_i/dt + forcing_i) + (J^T lam)_i, and the energy
changes by q_dot . forcing + d(T + V)/dq . q_dot + d(T + V)/dt less lam . drift. Where the graph sees these vanish
identically, the integral is certain. Where they may vanish on the constraints only, as with a quaternion of norm one,
the rate of change is returned as a kernel, to be evaluated at states that satisfy the constraints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from ..errors import list_names
from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph, Node
from ..ir.kernel import Kernel
from ..mechanics.equations import EquationsOfMotion
from ..transforms.derivatives import tangents
from ..transforms.linear import matvec
from ..transforms.lower_kernels import lower_kernel

__all__ = ["Candidates", "candidates", "integrals", "why_not"]


@final
@dataclass(frozen=True)
class Candidates:
    """Functions that may be first integrals.

    Attributes
    ----------
    names : tuple of str
        "energy", and "p_x" for the momentum of x.
    certain : tuple of bool
        Whether each is conserved whatever the state.
    values : Kernel
        Of arguments (t, y, c), y = (q, q_dot, states) and c beginning with the parameters.
    changes : Kernel
        Alike, with y = (q, q_dot, states, q_ddot): the rate of each, and the sum of the sizes of its terms.
    """

    names: tuple[str, ...]
    certain: tuple[bool, ...]
    values: Kernel
    changes: Kernel


def candidates(equations: EquationsOfMotion) -> Candidates:
    """Return the functions of a scene that may be first integrals."""
    symbols = equations.symbols
    graph = Graph()  # a graph of its own, so that the kernels depend on the scene alone
    q, qdot = graph.adopt(equations.q), graph.adopt(equations.qdot)
    forcing = graph.adopt(equations.forcing)
    jacobian = [graph.adopt(row.jacobian) for row in equations.constraints]
    drifts = graph.adopt([row.drift for row in equations.constraints])
    kinetic, potential = equations.energies(graph)
    mass = [graph.adopt(row) for row in equations.mass_matrix]
    time = graph.input(symbols.time)
    flow = dict(zip(q, qdot, strict=True)) | {time: graph.one}
    momenta = [tangents(graph, [kinetic], {rate: graph.one})[0] for rate in qdot]
    plain = all((a - b).is_zero for a, b in zip(momenta, matvec(graph, mass, qdot), strict=True))
    energy = kinetic + potential
    power = graph.sum(a * b for a, b in zip(forcing, qdot, strict=True)) + tangents(graph, [energy], flow)[0]
    found: dict[str, tuple[Node, bool]] = {}
    found["energy"] = energy, plain and power.is_zero and all(drift.is_zero for drift in drifts)
    for i, (name, momentum) in enumerate(zip(symbols.coordinates, momenta, strict=True)):
        if not momentum.is_zero:
            silent = plain and all(row[i].is_zero for row in jacobian)
            certain = silent and (tangents(graph, [momentum], flow)[0] + forcing[i]).is_zero
            found[f"p_{name}"] = momentum, certain
    nodes = [node for node, _ in found.values()]
    second = [graph.input(f"{name} of {name}_dot") for name in symbols.coordinates]
    directions = [{time: graph.one}]
    directions += [{x: rate} for x, rate in zip((*q, *qdot), (*qdot, *second), strict=True)]
    terms = [tangents(graph, nodes, direction) for direction in directions]
    sizes = [graph.sum(graph.call("abs", row[k]) for row in terms) for k in range(len(nodes))]
    rates = [graph.sum(row[k] for row in terms) for k in range(len(nodes))]
    if CONDITION_TIME in equations.symbols.parameters:  # conditions on time change the equations at their breaks
        decided = graph.input(CONDITION_TIME)
        for k, (name, (node, _)) in enumerate(found.items()):
            if graph.freed_of(node, [decided]) is None:
                found[name] = node, False
                rates[k] = sizes[k] = sizes[k] + graph.one
    inputs: dict[Node, tuple[str, int | None]] = {time: ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}
    states = graph.adopt(equations.states)
    inputs |= {node: ("y", i) for i, node in enumerate((*q, *qdot, *states, *second))}
    arguments = ("t", "y", "c")
    return Candidates(
        tuple(found),
        tuple(certain for _, certain in found.values()),
        lower_kernel(graph, "invariants", nodes, inputs, arguments=arguments),
        lower_kernel(graph, "changes", [*rates, *sizes], inputs, arguments=arguments),
    )


def integrals(equations: EquationsOfMotion) -> dict[str, Node]:
    """Return the energy and the momenta that are not zero, by the names of `candidates`, as nodes of the equations."""
    graph = equations.graph
    momenta = [tangents(graph, [equations.kinetic_energy], {rate: graph.one})[0] for rate in equations.qdot]
    named = zip(equations.symbols.coordinates, momenta, strict=True)
    kinetic, potential = equations.energies(graph)
    found = {"energy": kinetic + potential}
    return found | {f"p_{name}": momentum for name, momentum in named if not momentum.is_zero}


def why_not(equations: EquationsOfMotion, name: str) -> str:
    """Return the reason why a candidate is not conserved, for messages."""
    graph, time = equations.graph, {equations.time: equations.graph.one}
    loads = equations.load_energy
    moving = [row.label for row in equations.constraints if not row.drift.is_zero]
    if name != "energy":
        x = name.removeprefix("p_")
        held = [
            row.label
            for row in equations.constraints
            if not row.jacobian[equations.symbols.coordinates.index(x)].is_zero
        ]
        if held:
            return f"constraints act along {x!r}: {', '.join(held)}"
        return f"a force acts along {x!r}, or the kinetic or potential energy depends on it"
    if moving:
        return f"constraints that depend on time do work: {', '.join(moving)}"
    energies = equations.energies(graph)
    if not all(change.is_zero for change in tangents(graph, energies, time)):
        return "the scene depends explicitly on time"
    momenta = [tangents(graph, [equations.kinetic_energy], {rate: graph.one})[0] for rate in equations.qdot]
    at_rest = graph.substitute(momenta, dict.fromkeys(equations.qdot, graph.zero))
    if not all(momentum.is_zero for momentum in at_rest):
        return "prescribed motions of bodies do work"
    named = dict.fromkeys((*loads.rates, *loads.time, *loads.states, *loads.unknown))
    which = f": {list_names(named)}" if named else ", such as friction"
    return f"forces without a potential energy do work{which}"
