"""Numbers of contacts at an instant as a kernel: [EquationsOfMotion] -> [Kernel].

Mode selection and impacts are computed from them (`dalembert.contacts.contact_system`).
"""

from __future__ import annotations

from ...ir.graph import Graph
from ...ir.kernel import Kernel
from ...ir.node import Node
from ...mechanics.equations import EquationsOfMotion
from ...transforms.lower_kernels import lower_kernel
from .contact_laws import ContactLaws

NUMBERS = "gap", "mu", "mu_static", "restitution", "regularization", "normal_load"
"""Numbers of each contact, in the order of the outputs."""


def contact_data(equations: EquationsOfMotion) -> Kernel:
    """Return a kernel of (t, (q, q_dot), c), c beginning with the parameters of the scene.

    Its outputs are M (n_q, n_q) and the forcing (n_q,); of the constraints and, behind them, the slip velocities the
    Jacobians (n_rows, n_q), the biases of their accelerations (n_rows,) and their values on the rates (n_rows,); the
    power coefficients of the reactions (n_reactions, n_q); and of the contacts gaps, mu, mu_static, restitutions,
    regularizations and given normal loads (n_contacts,), zero where they have none.
    """
    graph = Graph()  # a graph of its own, so that the kernel depends on the equations alone
    rows = [*equations.constraints, *(row for contact in equations.contacts for row in contact.slips)]
    nodes: list[Node] = [entry for row in equations.mass_matrix for entry in row]
    nodes += equations.forcing
    nodes += [entry for row in rows for entry in row.jacobian]
    nodes += [row.bias for row in rows]
    for row in rows:
        terms = (a * b for a, b in zip(row.jacobian, equations.qdot, strict=True))
        nodes.append(equations.graph.sum(terms) + row.drift)
    nodes += [row[i] for i in range(len(equations.symbols.unknowns)) for row in equations.reactions]
    now = [ContactLaws(equations).coefficients_now(contact) for contact in equations.contacts]
    coefficients = {"mu": [mu for mu, _ in now], "mu_static": [static for _, static in now]}
    for name in NUMBERS:
        numbers = coefficients.get(name) or [getattr(contact, name) for contact in equations.contacts]
        nodes += [equations.graph.zero if node is None else node for node in numbers]
    inputs: dict[Node, tuple[str, int | None]] = {graph.input(equations.symbols.time): ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(equations.symbols.parameters)}
    inputs |= {graph.input(name): ("y", i) for i, name in enumerate(equations.symbols.variables)}
    return lower_kernel(graph, "contact_data", graph.adopt(nodes), inputs, arguments=("t", "y", "c"))
