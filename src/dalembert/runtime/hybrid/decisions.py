"""Mode selection and impacts of many cases: the compiled decisions of a scene with contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...codegen.llvm.loops import loop_named
from ...hybrid import HybridAutomaton
from ...integrators.contact_cases import ContactCases
from ...integrators.contact_decisions import DecisionArguments
from ...integrators.contact_sizes import gap_noise
from ...integrators.contact_system import ContactSystem, contact_system
from ...integrators.mode_candidates import candidates_space
from ...ir.kernel import Kernel

__all__ = ["LOOP", "Decisions", "Rows"]

LOOP = "contact_decisions"

Rows = Callable[[Kernel, FloatArray, FloatArray, FloatArray], FloatArray]
"""Outputs (k, n) of a kernel at times (k,), states (k, n_y) and constants (k, n_c)."""


@final
class Decisions:
    """Impacts and mode selection of many cases, by compiled code.

    Parameters
    ----------
    automaton : HybridAutomaton
    rows : callable
        Evaluates the kernel of the contact data.
    """

    def __init__(self, automaton: HybridAutomaton, rows: Rows) -> None:
        self.automaton, self._rows = automaton, rows

    def arguments(
        self, cases: ContactCases, values: FloatArray, deciding: NDArray[np.int64], rtol: float
    ) -> DecisionArguments:
        """Return the arguments of the loop, with working memory of their own."""
        system = self.system()
        return DecisionArguments(
            system=system,
            candidates=candidates_space(system),
            cases=cases,
            values=values,
            deciding=deciding,
            after_impact=np.zeros(len(deciding), np.int64),
            tolerance=rtol,
        )

    def values(self, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the numbers of the contacts (k, n_values) at times (k,), states (k, 2 n_q), parameters (k, n_p)."""
        return self._rows(self.automaton.contact_data, t, x, c)

    def decide(self, cases: ContactCases) -> None:
        """Select the next modes of cases: their states, modes and ``status`` are written."""
        deciding = np.arange(len(cases.t))
        while len(deciding):
            values = self.values(cases.t[deciding], cases.x[deciding], cases.p[deciding])
            arguments = self.arguments(cases, values, deciding, 0.0)
            loop_named(LOOP)(arguments)
            deciding = deciding[arguments.after_impact != 0]

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
