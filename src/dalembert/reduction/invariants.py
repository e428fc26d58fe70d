"""Candidates of first integrals: energy, and the momenta dT/dq_dot of coordinates.

With p = M q_dot, along every motion dp_i/dt = (dp_i/dq . q_dot + dp_i/dt + forcing_i) + (J^T lam)_i, and the energy
changes by q_dot . forcing + d(T + V)/dq . q_dot + d(T + V)/dt less lam . drift. Where the graph sees these vanish
identically, the integral is certain. Where they may vanish on the constraints only, as with a quaternion of norm one,
the rate of change is returned as a kernel, to be evaluated at states that satisfy the constraints, and so is the rate
with the arguments of switches, tables and steep functions free: what such functions do elsewhere counts too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import final

from ..errors import list_names
from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph, Node
from ..ir.kernel import Kernel
from ..mechanics.equations import EquationsOfMotion
from ..transforms.derivatives import tangents
from ..transforms.linear import matvec
from ..transforms.lower_kernels import lower_kernel
from .free_arguments import FreeArgument, free_arguments, has_branches

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
    branches : Kernel
        Alike, with y = (q, q_dot, states, free arguments), see `free_arguments`.
    free : tuple of FreeArgument
        Where these are.
    """

    names: tuple[str, ...]
    certain: tuple[bool, ...]
    values: Kernel
    changes: Kernel
    branches: Kernel
    free: tuple[FreeArgument, ...]


def candidates(equations: EquationsOfMotion) -> Candidates:
    """Return the functions of a scene that may be first integrals."""
    symbols = equations.symbols
    graph = Graph()  # a graph of its own, so that the kernels depend on the scene alone
    q, qdot = graph.adopt(equations.q), graph.adopt(equations.qdot)
    states = graph.adopt(equations.states)
    time, decided = graph.input(symbols.time), graph.input(CONDITION_TIME)
    second = [graph.input(f"{name} of {name}_dot") for name in symbols.coordinates]
    found = _found(equations, graph, [(time, graph.one), *zip(q, qdot, strict=True)])
    nodes = [each.value for each in found]
    directions = [{time: graph.one}]
    directions += [{x: rate} for x, rate in zip((*q, *qdot), (*qdot, *second), strict=True)]
    terms = [tangents(graph, nodes, direction) for direction in directions]
    rates, sizes = _rates_and_sizes(graph, [[row[k] for row in terms] for k in range(len(nodes))])
    certain = [each.certain for each in found]
    direct = [each.direct for each in found]
    if CONDITION_TIME in symbols.parameters:  # conditions on time change the equations at their breaks
        for k, node in enumerate(nodes):
            if graph.freed_of(node, [decided]) is None:
                certain[k], direct[k] = False, (graph.one,)
    variables = reduce(or_, (node.deps for node in (*q, *qdot, *states, time, decided)))
    unclear = has_branches(graph, _equations(equations, graph), variables)
    shown = [((graph.one,) if unclear else ()) if each is None else each for each in direct]
    freed, free = free_arguments(graph, [term for each in shown for term in each], variables)
    parts = iter(freed)
    branches = _rates_and_sizes(graph, [[next(parts) for _ in each] for each in shown])
    inputs: dict[Node, tuple[str, int | None]] = {time: ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}

    def kernel(name: str, outputs: Sequence[Node], *further: Node) -> Kernel:
        places = {node: ("y", i) for i, node in enumerate((*q, *qdot, *states, *further))}
        return lower_kernel(graph, name, outputs, inputs | places, arguments=("t", "y", "c"))

    return Candidates(
        tuple(each.name for each in found),
        tuple(certain),
        kernel("invariants", nodes),
        kernel("changes", [*rates, *sizes], *second),
        kernel("branches", [*branches[0], *branches[1]], *(node for node, _ in free)),
        tuple(where for _, where in free),
    )


@final
@dataclass(frozen=True)
class _Candidate:
    """A function, and the terms of its rate without reactions; None where reactions may contribute to it."""

    name: str
    value: Node
    direct: tuple[Node, ...] | None

    @property
    def certain(self) -> bool:
        return self.direct is not None and self.value.graph.sum(self.direct).is_zero


def _found(equations: EquationsOfMotion, graph: Graph, flow: Sequence[tuple[Node, Node]]) -> list[_Candidate]:
    """Return the energy, and the momenta that are not zero; `flow` are time and coordinates with their rates."""
    qdot, forcing = graph.adopt(equations.qdot), graph.adopt(equations.forcing)
    mass = [graph.adopt(row) for row in equations.mass_matrix]
    jacobian = [graph.adopt(row.jacobian) for row in equations.constraints]
    drifts = graph.adopt([row.drift for row in equations.constraints])
    kinetic, potential = equations.energies(graph)
    momenta = [tangents(graph, [kinetic], {rate: graph.one})[0] for rate in qdot]
    plain = all((a - b).is_zero for a, b in zip(momenta, matvec(graph, mass, qdot), strict=True))

    def along(node: Node) -> list[Node]:
        return [tangents(graph, [node], {x: rate})[0] for x, rate in flow]

    energy = kinetic + potential
    work = [*(a * b for a, b in zip(forcing, qdot, strict=True)), *along(energy)]
    found = [_Candidate("energy", energy, tuple(work) if plain and all(drift.is_zero for drift in drifts) else None)]
    for i, (name, momentum) in enumerate(zip(equations.symbols.coordinates, momenta, strict=True)):
        if not momentum.is_zero:
            silent = plain and all(row[i].is_zero for row in jacobian)
            found.append(_Candidate(f"p_{name}", momentum, (forcing[i], *along(momentum)) if silent else None))
    return found


def _equations(equations: EquationsOfMotion, graph: Graph) -> list[Node]:
    """Return what accelerations and the energy depend on."""
    rows = [*equations.mass_matrix, *(row.jacobian for row in equations.constraints)]
    nodes = [
        *equations.forcing,
        *(row.drift for row in equations.constraints),
        *(entry for row in rows for entry in row),
    ]
    return [*graph.adopt(nodes), *equations.energies(graph)]


def _rates_and_sizes(graph: Graph, terms: Sequence[Sequence[Node]]) -> tuple[list[Node], list[Node]]:
    """Return the sum of each row of terms, and the sum of their sizes."""
    return (
        [graph.sum(row) for row in terms],
        [graph.sum(graph.call("abs", term) for term in row) for row in terms],
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
