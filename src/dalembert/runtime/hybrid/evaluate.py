"""Kernels of a scene with contacts at given states: without their forces, or in the mode that a state decides."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...errors import InitialStateError, list_names
from ...integrators.contact_cases import ContactCases, contact_cases
from ...ir.conditions import CONDITION_TIME
from ...methods.status import Status
from .decisions import Decisions

__all__ = ["decided_cases", "evaluate"]

_STRUCK = 1e-6
"""Share of the rates by which a state may miss what its contacts allow."""


def evaluate(decisions: Decisions, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray:
    """Return what a kernel of `dalembert.runtime.interface.evaluation` gives for k states.

    Raises
    ------
    InitialStateError
        For accelerations at states that the contacts forbid, or from which they let the motion go on in no way, or in
        several.
    """
    equations, system = decisions.automaton.equations, decisions.system()
    c = np.broadcast_to(p, (len(t), p.shape[-1]))
    if CONDITION_TIME in equations.symbols.parameters:
        c = c.copy()
        c[:, equations.symbols.parameters.index(CONDITION_TIME)] = t
    if kernel == "accelerations":
        return decided_cases(decisions, t, x, c, "no accelerations belong to").motion
    values, n, rows = decisions.values(t, x, np.ascontiguousarray(c)), system.coordinates, len(system.jacobian)
    if kernel == "mass_matrix":
        return values[:, : n * n].reshape(-1, n, n)
    if kernel == "forcing":
        return values[:, n * n : n * n + n]
    jacobians = values[:, n * n + n : n * n + n + rows * n].reshape(-1, rows, n)
    return jacobians[:, np.flatnonzero(system.row_owner[: system.constraints] < 0)]


def decided_cases(decisions: Decisions, t: FloatArray, x: FloatArray, p: FloatArray, what: str) -> ContactCases:
    """Return cases in the modes in which motions continue from states (k, 2 n_q) with parameters (k, n_p).

    Raises
    ------
    InitialStateError
        For states that the contacts forbid, or from which they let the motion go on in no way, or in several; `what`
        says what then does not exist.
    """
    equations = decisions.automaton.equations
    cases = contact_cases(t, x, p, np.ones(len(t)), len(equations.contacts), len(equations.states))
    decisions.decide(cases)
    names = equations.symbols.variables
    faults = []
    for i, status in enumerate(cases.status):
        place = ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, x[i], strict=True))
        jump, size = np.abs(cases.x[i] - x[i]), np.max(np.abs(x[i]), initial=0.0)
        if status != Status.SUCCESS:
            faults.append(f"at {place}: {Status(int(status)).message}")
        elif np.any(jump > _STRUCK * max(size, 1.0)):
            moved = [name for name, change in zip(names, jump, strict=True) if change > 0.0]
            faults.append(f"at {place}: a closed contact forbids the rates, and {list_names(moved)} would jump")
    if faults:
        raise InitialStateError(f"{what} a state\n  " + "\n  ".join(faults))
    return cases
