"""Numbers of contacts at an instant as a kernel: [EquationsOfMotion] -> [Kernel].

Mode selection and impacts are computed from them (`dalembert.integrators.contact_table`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from ..ir.graph import Graph, Node
from ..ir.kernel import Kernel
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..transforms.lower_kernels import lower_kernel

__all__ = ["ContactData", "contact_data"]


@final
@dataclass(frozen=True)
class ContactData:
    """A kernel of (t, (q, q_dot), c), c beginning with the parameters of the scene, and what its outputs are.

    They are M (n_q, n_q), the forcing (n_q,), then for every constraint and every slip velocity its Jacobian (n_q,),
    the bias of its acceleration and its value on the rates; then the power coefficients of the reactions
    (n_q, n_unknown); then for every contact its gap, mu, mu_static, restitution and regularization, zero
    where it has none.
    """

    kernel: Kernel
    coordinates: int
    constraints: int
    slips: int
    unknowns: int
    contacts: int


def contact_data(equations: EquationsOfMotion) -> ContactData:
    """Return the numbers of a scene with contacts."""
    graph = Graph()  # a graph of its own, so that the kernel depends on the equations alone
    nothing = equations.graph.zero
    slips = [row for contact in equations.contacts for row in contact.slips]
    nodes: list[Node] = [entry for row in equations.mass_matrix for entry in row]
    nodes += equations.forcing
    for row in (*equations.constraints, *slips):
        nodes += [*row.jacobian, row.bias, _velocity(equations, row)]
    nodes += [entry for row in equations.reactions for entry in row]
    for contact in equations.contacts:
        numbers = (contact.gap, contact.mu, contact.mu_static, contact.restitution, contact.regularization)
        nodes += [nothing if node is None else node for node in numbers]
    inputs: dict[Node, tuple[str, int | None]] = {graph.input(equations.symbols.time): ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(equations.symbols.parameters)}
    state = equations.symbols.variables
    inputs |= {graph.input(name): ("y", i) for i, name in enumerate(state)}
    kernel = lower_kernel(graph, "contact_data", graph.adopt(nodes), inputs, arguments=("t", "y", "c"))
    return ContactData(
        kernel,
        coordinates=len(equations.q),
        constraints=len(equations.constraints),
        slips=len(slips),
        unknowns=len(equations.symbols.unknowns),
        contacts=len(equations.contacts),
    )


def _velocity(equations: EquationsOfMotion, row: ConstraintRow) -> Node:
    terms = (a * b for a, b in zip(row.jacobian, equations.qdot, strict=True))
    return equations.graph.sum(terms) + row.drift
