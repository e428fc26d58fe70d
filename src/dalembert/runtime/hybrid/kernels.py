"""What of a scene with contacts can be told of a state: without their forces, or in the mode that the state decides."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...errors import InitialStateError, list_names
from ...ir.conditions import CONDITION_TIME
from ...mechanics.equations import EquationsOfMotion
from ...methods.status import Status
from .instants import Instants
from .settling import Laws

__all__ = ["outputs"]

_STRUCK = 1e-6
"""Share of the rates by which a state may miss what its contacts allow."""


def outputs(
    equations: EquationsOfMotion, laws: Laws, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray
) -> FloatArray:
    """Return what a kernel of `dalembert.runtime.evaluation.Evaluated` gives for k states.

    Raises
    ------
    InitialStateError
        For accelerations at states that the contacts forbid, or from which they let the motion go on in no way, or in
        several.
    """
    c = np.broadcast_to(p, (len(t), len(p)))
    if CONDITION_TIME in equations.symbols.parameters:
        c = c.copy()
        c[:, equations.symbols.parameters.index(CONDITION_TIME)] = t
    if kernel == "accelerations":
        return _accelerations(equations, laws, t, x, c)
    facts = laws.facts(t, x, c)
    if kernel == "mass_matrix":
        return facts.mass
    if kernel == "forcing":
        return facts.forcing
    opening = {contact.constraint for contact in equations.contacts}
    return facts.jacobian[:, [i for i in range(facts.jacobian.shape[1]) if i not in opening]]


def _accelerations(equations: EquationsOfMotion, laws: Laws, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return the second rates (k, n_q) with which motions go on from states (k, 2 n_q)."""
    now = Instants.starting(t, x, c, len(equations.contacts))
    settled, facts = laws.settle(now, None, ()), laws.facts(t, x, c)
    names = (*equations.symbols.coordinates, *equations.symbols.rates)
    faults = []
    for i, status in enumerate(settled.status):
        place = ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, x[i], strict=True))
        jump, size = np.abs(settled.x[i] - x[i]), np.max(np.abs(x[i]), initial=0.0)
        if status != Status.SUCCESS:
            faults.append(f"at {place}: {Status(int(status)).message}")
        elif np.any(jump > _STRUCK * max(size, 1.0)):
            moved = [name for name, change in zip(names, jump, strict=True) if change > 0.0]
            faults.append(f"at {place}: a closed contact forbids the rates, and {list_names(moved)} would jump")
    if faults:
        raise InitialStateError("no accelerations belong to a state\n  " + "\n  ".join(faults))
    found = np.empty_like(facts.forcing)
    for number, mode in enumerate(settled.table):
        here = np.flatnonzero(settled.mode == number)
        if len(here):
            part = facts.part(here)
            directions, sides = settled.directions[here], settled.sides[here]
            found[here] = part.solve(part.accelerating(), mode, directions, sides).motion
    return found
