"""Decisions at given states of a scene with contacts: mode selection, impacts, kernels, and faults of starts."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.engine import Engine
from ..codegen.llvm.loops import loop_named
from ..contacts.automaton import HybridAutomaton
from ..contacts.contact_cases import ContactCases, contact_cases, gap_noise
from ..contacts.contact_decisions import DecisionArguments
from ..contacts.contact_system import ContactSystem, opening_power
from ..contacts.contact_topology import contact_system
from ..contacts.selection.mode_candidates import candidates_space
from ..errors import InitialStateError, ValueInputError, list_names
from ..ir.conditions import CONDITION_TIME
from ..methods.status import Status

LOOP = "contact_decisions"

_STRUCK = 1e-6
"""Share of the rates by which a state may miss what its contacts allow."""


@final
class Decisions:
    """Impacts and mode selection of many cases, by compiled code.

    Parameters
    ----------
    automaton : HybridAutomaton
    engine : callable
        Returns the engine that evaluates the contact data.
    """

    def __init__(self, automaton: HybridAutomaton, engine: Callable[[], Engine]) -> None:
        self.automaton, self._engine = automaton, engine

    def arguments(
        self, cases: ContactCases, values: FloatArray, deciding: NDArray[np.int64], tolerances: tuple[float, float]
    ) -> DecisionArguments:
        """Return the arguments of the loop for relative and absolute tolerances, with working memory of their own."""
        system = self.system()
        return DecisionArguments(
            system=system,
            candidates=candidates_space(system),
            cases=cases,
            values=values,
            deciding=deciding,
            ending=np.zeros(len(deciding), np.int64),
            after_impact=np.zeros(len(deciding), np.int64),
            rtol=tolerances[0],
            atol=tolerances[1],
        )

    def values(self, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the numbers of the contacts (k, n_values) at times (k,), states (k, 2 n_q), parameters (k, n_p)."""
        return self._engine().rows(self.automaton.contact_data, t, x, c)

    def decide(self, cases: ContactCases) -> None:
        """Select the next modes of cases: their states, modes and ``status`` are written."""
        deciding = np.arange(len(cases.t))
        while len(deciding):
            values = self.values(cases.t[deciding], cases.x[deciding], cases.p[deciding])
            arguments = self.arguments(cases, values, deciding, (0.0, 0.0))
            loop_named(LOOP)(arguments)
            deciding = deciding[arguments.after_impact != 0]

    def at_states(self, t: FloatArray, x: FloatArray, p: FloatArray, what: str) -> ContactCases:
        """Return cases in the modes in which motions continue from states (k, 2 n_q) with parameters (k, n_p).

        Raises
        ------
        InitialStateError
            For states that the contacts forbid, or from which they let the motion continue in no way, or in several;
            `what` says what then does not exist.
        """
        equations, faults = self.automaton.equations, []
        cases = contact_cases(t, x, p, np.ones(len(t)), len(equations.contacts), len(equations.states))
        self.decide(cases)
        names = equations.symbols.variables
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

    def evaluate(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray:
        """Return what a kernel of `dalembert.model.evaluation` gives for k states.

        Raises
        ------
        InitialStateError
            For accelerations, as `at_states`.
        """
        symbols, system = self.automaton.equations.symbols, self.system()
        p = np.array(np.broadcast_to(p, (len(t), p.shape[-1])), order="C")
        if CONDITION_TIME in symbols.parameters:
            p[:, symbols.parameters.index(CONDITION_TIME)] = t
        if kernel == "accelerations":
            return self.at_states(t, x, p, "no accelerations belong to").motion
        values, n, rows = self.values(t, x, p), system.coordinates, len(system.jacobian)
        if kernel == "mass_matrix":
            return values[:, : n * n].reshape(-1, n, n)
        if kernel == "forcing":
            return values[:, n * n : n * n + n]
        jacobians = values[:, n * n + n : n * n + n + rows * n].reshape(-1, rows, n)
        return jacobians[:, np.flatnonzero(system.row_owner[: system.constraints] < 0)]

    def system(self, values: FloatArray | None = None) -> ContactSystem:
        """Return the contacts with memory of their own, with numbers of the contacts (n_values,) if they are given."""
        system = contact_system(self.automaton)
        if values is not None:
            system.values[:] = values
        return system

    def gaps(self, t: FloatArray, x: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gaps (n_contacts,) of one case, and the sizes below which they count as zero.

        Times are (1,), coordinates, rates and first-order states (1, 2 n_q + n_z), and parameters (1, n_p). Of contacts
        that never open both are zero.
        """
        system = self.system(self.values(t, x, p)[0])
        opens = system.constraint >= 0
        noise = [gap_noise(system, x[0], i) if opens[i] else 0.0 for i in range(system.contacts)]
        return np.where(opens, system.gap, 0.0), np.array(noise)

    def start_error(self, cases: ContactCases) -> Exception | None:
        """Return what is wrong with the start of a motion, the only case; None where nothing is."""
        system, equations = self.system(self.values(cases.t, cases.x, cases.p)[0]), self.automaton.equations
        mu, static, e = system.mu, system.mu_static, system.restitution
        faults = []
        for i, contact in enumerate(equations.contacts):
            if mu[i] < 0.0:
                faults.append(f"mu of {contact.name!r} is {mu[i]:g}; it must not be negative")
            elif static[i] < mu[i]:
                less = f"mu_static of {contact.name!r} is {static[i]:g}, less than mu = {mu[i]:g}"
                faults.append(f"{less}; raise it, or leave it out")
            if not 0.0 <= e[i] <= 1.0:
                faults.append(f"restitution of {contact.name!r} is {e[i]:g}; it must lie between 0 and 1")
        if faults:
            return ValueInputError("; ".join(faults))
        for i, contact in enumerate(equations.contacts):
            name = equations.symbols.unknowns[contact.normal]
            if contact.constraint is None:
                continue
            power = opening_power(system, i)
            if not np.isfinite(power):
                faults.append(
                    f"contact {contact.name!r}: its gap or the direction of {name} has no finite gradient here, as that"
                    " of a distance that is zero; start from another configuration"
                )
            elif not power > 0.0:
                faults.append(
                    f"contact {contact.name!r}: {name} pushes its gap closed here; turn the sign of the gap, or the"
                    " direction of the force in the joint"
                )
            elif system.gap[i] < 0.0:
                faults.append(
                    f"contact {contact.name!r} penetrates: its gap is {system.gap[i]:.3g}; start with gap >= 0"
                )
        if not faults:
            return None
        return InitialStateError("the initial state contradicts the contacts:\n  " + "\n  ".join(faults))
