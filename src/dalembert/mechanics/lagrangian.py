"""Equations of motion from a Lagrangian: d/dt dL/dq_dot - dL/dq = Q.

L is a polynomial of degree two in the rates, L = T_2 + L_1 + L_0. Then M = d^2 L/dq_dot^2, and the forcing is Q + dL/dq
less the rate of dL/dq_dot at zero second rates. T_2 stands for the kinetic and -L_0 for the potential energy, so that
the energy is Jacobi's integral q_dot . dL/dq_dot - L, which is conserved where L does not depend on time and loads do
no work.
"""

from __future__ import annotations

from ..errors import SceneError
from ..transforms.derivatives import jacobian, tangents
from ..transforms.linear import Matrix
from .kane import load_powers
from .kinematics import Kinematics
from .virtual_power import Powers

__all__ = ["lagrangian_powers"]


def lagrangian_powers(kinematics: Kinematics) -> Powers:
    """Return the mass matrix, forcing and energies of a scene that gives its Lagrangian.

    Raises
    ------
    SceneError
        When the Lagrangian is not of degree two in the rates.
    """
    graph, model = kinematics.graph, kinematics.model
    lagrangian = model.lagrangian
    assert lagrangian is not None and model.given is not None
    q, rates = kinematics.q, kinematics.qdot
    momenta = [tangents(graph, [lagrangian], {rate: graph.one})[0] for rate in rates]
    matrix: Matrix = []
    for name, row in zip(model.symbols.coordinates, jacobian(graph, momenta, rates), strict=True):
        freed = [graph.freed_of(entry, rates) for entry in row]
        if any(entry is None for entry in freed):
            why = f"the Lagrangian is not of degree two in the rates: dL/d{name}_dot is not affine in them"
            raise SceneError(model.name, [f"{why}. Only L = T - V with velocities affine in the rates can be compiled"])
        matrix.append([entry for entry in freed if entry is not None])
    bias = tangents(graph, momenta, kinematics.flow)
    slopes = [tangents(graph, [lagrangian], {x: graph.one})[0] for x in q]
    loads = load_powers(kinematics, model.given.loads)
    forcing = [load + slope - rate for load, slope, rate in zip(loads, slopes, bias, strict=True)]
    pairs = ((matrix[i][j], rates[i], rates[j]) for i in range(len(q)) for j in range(len(q)))
    kinetic = graph.sum(entry * a * b for entry, a, b in pairs) / 2
    still = graph.substitute([lagrangian], dict.fromkeys(rates, graph.zero))[0]
    return Powers(matrix, forcing, kinetic, -still, -still)
