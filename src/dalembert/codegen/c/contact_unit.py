"""The simulator in C99 of a functional mock-up unit of a scene whose contacts change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...contacts.contact_steps import CHANGES
from ..rendering import render
from .contact_loops import ContactLoop
from .contact_simulator import ContactSimulator
from .descriptions import plain

_PUBLIC = ("begin", "changes", "change", "advance", "present", "values")
"""Ends of the names of public functions that only these units have."""

_NEEDED = ("phases.table.turn", "phases.table.cases.added")
"""Members of a run that these functions read or set besides those of `ContactSimulator`."""


class ContactUnitSimulator(ContactSimulator):
    """A simulator in C99 of a functional mock-up unit of a scene whose contacts change.

    It has the attributes of `dalembert.codegen.c.unit_simulator.UnitSimulator`.
    """

    exchanged = corrected = False
    n_knowns = 0

    @property
    def loop(self) -> ContactLoop:
        """The loops of the contacts."""
        assert self.source.contacts is not None
        return self.source.contacts

    @property
    def n_computed(self) -> int:
        """Number of coordinates, rates, first-order states, outputs and contacts."""
        return len(self.loop.variables) + len(self.layout.outputs) + len(self.loop.contacts)

    @property
    def n_values(self) -> int:
        """Number of values: those that are computed."""
        return self.n_computed

    def _needed(self) -> set[str]:
        """See `ContactSimulator`."""
        return super()._needed() | {*_NEEDED}

    def _taken(self) -> frozenset[str]:
        """See `Simulator`."""
        own = {self._name(f"begun_{number}") for number in range(len(self.loop.modes))}
        return super()._taken() | {self._name(what) for what in _PUBLIC} | own

    def _mode_kernels(self, number: int) -> dict[str, str]:
        """See `ContactSimulator`."""
        program = self.loop.modes[number].program
        if self.layout.outputs:
            constants = replace(program.kernel("prepare"), arguments=("p", "y", "c", "s"))
            self._print(f"constants_{number}", constants, f"Constants of mode {number + 1}", exact=True)
        return super()._mode_kernels(number)

    def _mode_variables(self, number: int) -> dict[str, Any]:
        """Return the variables of a mode in the template of further functions."""
        mode, n_p = self.loop.modes[number], len(self.loop.parameters)
        given = [f"p[{place}]" if place < n_p else f"added[{place - n_p}]" for place in mode.places]
        names = {what: self._name(f"{what}_{number}") for what in ("begun", "constants", "initial")}
        return {
            **names,
            "outputs": self._name(f"output_{number}"),
            "states": plain(" and ".join(mode.states)),
            "given": given,
            "n_given": len(given),
        }

    def _further_functions(self, variables: Mapping[str, Any]) -> str:
        """See `Simulator`."""
        known, programs = variables["functions"], [mode.program for mode in self.loop.modes]
        return render(
            "fmi/contacts.c.j2",
            {
                **{name: known[name] for name in ("prefix", "upper", "n_states", "n_outputs", "n_own", "n_contacts")},
                "at": {"time": self.at["time"]},
                "changes": CHANGES,
                "first_contact": len(self.loop.variables) + len(self.layout.outputs),
                "modes": [self._mode_variables(number) for number in range(len(programs))],
                "n_constants": max(1, *(len(program.kernel("prepare").outputs) for program in programs)),
            },
        )

    def _header_variables(self, members: list[str]) -> dict[str, Any]:
        """See `Simulator`."""
        return {**super()._header_variables(members), "n_values": self.n_values}
