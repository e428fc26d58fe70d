"""Mode selection and impacts of many cases: the compiled decisions of a scene with contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...codegen.llvm.loops import loop_named
from ...hybrid import HybridAutomaton
from ...hybrid.modes import side_name
from ...integrators import contact_cases as rules
from ...integrators.contact_cases import ContactCases
from ...integrators.contact_decisions import DecisionArguments
from ...integrators.contact_sizes import gap_noise
from ...integrators.contact_table import GAP, ContactTable, contact_space, number, opening_power
from ...integrators.mode_candidates import candidates_space
from ...ir.kernel import Kernel
from ...mechanics.equations import Guard
from .state import HybridState

__all__ = ["LOOP", "Decisions", "Rows", "contact_table", "flag"]

LOOP = "contact_decisions"

Rows = Callable[[Kernel, FloatArray, FloatArray, FloatArray], FloatArray]
"""Outputs (k, n) of a kernel at times (k,), states (k, n_y) and constants (k, n_c)."""


def contact_table(automaton: HybridAutomaton) -> ContactTable:
    """Return the contacts of a scene as compiled code reads them."""
    contacts, data, equations = automaton.contacts, automaton.contact_data, automaton.equations
    ends = np.cumsum([0, *(len(contact.slips) for contact in contacts)])

    def column(values: list[int]) -> NDArray[np.int64]:
        return np.array(values, np.int64)

    return ContactTable(
        coordinates=data.coordinates,
        constraints=data.constraints,
        slips=data.slips,
        unknowns=data.unknowns,
        constraint=column([-1 if c.constraint is None else c.constraint for c in contacts]),
        sense=column([c.sense for c in contacts]),
        normal=column([c.normal for c in contacts]),
        first=column([int(end) for end in ends[:-1]]),
        width=column([len(c.tangential) for c in contacts]),
        smooth=column([int(c.regularization is not None) for c in contacts]),
        sided=column([int(side_name(c) is not None) for c in contacts]),
        tangential=column([unknown for c in contacts for unknown in c.tangential]),
        angle=column([int(name in equations.angles) for name in equations.symbols.coordinates]),
    )


def flag(guard: Guard) -> int:
    """Return the bit of `ContactCases.fired` that a guard sets; 0 for one of all contacts."""
    if guard.kind == "break":
        return {0: rules.BREAK_PLANE, 1: rules.BREAK_UP, -1: rules.BREAK_DOWN}[guard.sign]
    flags = {"lift": rules.LIFT, "turn": rules.TURN, "meet": rules.MEET, "stop": rules.STOP, "share": rules.SHARE}
    return flags.get(guard.kind, 0)


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
        self.automaton, self.table = automaton, contact_table(automaton)
        self._rows = rows

    def arguments(
        self, t: FloatArray, cases: ContactCases, values: FloatArray, wanted: NDArray[np.int64], rtol: float
    ) -> DecisionArguments:
        """Return the arguments of the loop for cases at times t (k,), with working memory of their own."""
        table = self.table
        return DecisionArguments(
            table=table,
            space=contact_space(table),
            candidates=candidates_space(table),
            demand=np.zeros(max(table.constraints, 1)),
            cases=cases,
            t=t,
            values=values,
            wanted=wanted,
            after_impact=np.zeros(len(wanted), np.int64),
            tolerance=rtol,
        )

    def values(self, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the numbers of the contacts (k, n_values) at times (k,), states (k, 2 n_q), parameters (k, n_p)."""
        return self._rows(self.automaton.contact_data.kernel, t, x, c)

    def decide(self, state: HybridState, wanted: NDArray[np.intp], rtol: float = 0.0) -> None:
        """Select the next modes of the `wanted` cases: their states, modes and `status` are written.

        `rtol` is the relative tolerance of the integration.
        """
        wanted = np.ascontiguousarray(wanted, np.int64)
        while len(wanted):
            values = self.values(state.t[wanted], state.x[wanted], state.c[wanted])
            arguments = self.arguments(state.t, state.cases, values, wanted, rtol)
            loop_named(LOOP)(arguments)
            wanted = wanted[arguments.after_impact != 0]

    def numbers(self, values: FloatArray, which: int) -> FloatArray:
        """Return gap, mu, mu_static, restitution or regularization (k, n_contacts) from the numbers of contacts."""
        space = contact_space(self.table)
        found = np.empty((len(values), len(self.table.constraint)))
        for row, own in zip(found, values, strict=True):
            space.values[:] = own
            row[:] = [number(self.table, space, i, which) for i in range(len(row))]
        return found

    def gaps(self, values: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gaps (n_contacts,), and the sizes below which they count as zero, at one state.

        From the numbers of the contacts (n,) and coordinates, rates and first-order states x (2 n_q + n_z,); of
        contacts that never open both are zero.
        """
        table, space = self.table, contact_space(self.table)
        space.values[:] = values
        found = np.zeros((2, len(table.constraint)))
        for i in np.flatnonzero(table.constraint >= 0).tolist():
            found[:, i] = number(table, space, i, GAP), gap_noise(table, space, x[np.newaxis], 0, i)
        return found[0], found[1]

    def pushes_open(self, values: FloatArray, contact: int) -> bool:
        """Return whether the normal reaction of a contact pushes its gap open, as it must, from its numbers (n,)."""
        space = contact_space(self.table)
        space.values[:] = values
        return opening_power(self.table, space, contact) > 0.0
