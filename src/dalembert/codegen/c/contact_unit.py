"""The simulator in C99 of a functional mock-up unit of a scene whose contacts change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...contacts.contact_steps import CHANGES
from ...methods.step_constants import RESOLUTION
from ...transforms.partials import tangent_kernel
from ...transforms.taylor.nonsmooth import decisions
from ...transforms.taylor.step import STEP_ARGUMENTS
from ..rendering import render
from .contact_loops import ContactLoop
from .contact_simulator import ContactSimulator
from .descriptions import CSource, plain
from .printing import double

_PUBLIC = ("begin", "changes", "change", "advance", "present", "values", "rate", "correct", "update")
"""Ends of the names of public functions that only these units have."""

_MODE = ("begun", "constants", "initial", "rates", "guards", "expanded_along")
"""Beginnings of the names of functions of a mode."""

_NEEDED = ("turn", "carried", "cases.added")
"""Members of the table of cases that these functions read or set besides those of `ContactSimulator`."""


class ContactUnitSimulator(ContactSimulator):
    """A simulator in C99 of a functional mock-up unit of a scene whose contacts change.

    It has the attributes of `dalembert.codegen.c.unit_simulator.UnitSimulator`. The state of model exchange is
    coordinates, rates and first-order states, in all modes.
    """

    n_knowns = n_known_states = 0

    def __init__(self, source: CSource) -> None:
        assert source.contacts is not None
        # importers that integrate look for zeros of guards, and not for guards that inputs have made negative
        smooth = all(decisions(mode.program) is None for mode in source.contacts.modes)
        self.exchanged = smooth and not source.contacts.inputs
        self.corrected = self.exchanged
        super().__init__(source)

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
    def n_guards(self) -> int:
        """Number of guards that a mode has at most."""
        return max(len(mode.guards.outputs) for mode in self.loop.modes) if self.exchanged else 0

    @property
    def n_values(self) -> int:
        """Number of values: those that are computed, then the state, its rate and guards."""
        return self.n_computed + (2 * len(self.loop.variables) + self.n_guards if self.exchanged else 0)

    def _needed(self) -> set[str]:
        """See `ContactSimulator`."""
        needed = super()._needed() | {f"phases.table.{name}" for name in _NEEDED}
        if self.exchanged:
            needed |= {"phases.space.progress", "own"}
            needed |= {f"mode_{i}.state.progress" for i in range(len(self.loop.modes))}
        return needed

    def _taken(self) -> frozenset[str]:
        """See `Simulator`."""
        own = {self._name(f"{what}_{number}") for number in range(len(self.loop.modes)) for what in _MODE}
        return super()._taken() | {self._name(what) for what in _PUBLIC} | own

    def _mode_kernels(self, number: int) -> dict[str, Any]:
        """See `ContactSimulator`."""
        mode, of = self.loop.modes[number], f"mode {number + 1}"
        if self.layout.outputs or self.exchanged:
            constants = replace(mode.program.kernel("prepare"), arguments=("p", "y", "c", "s"))
            self._print(f"constants_{number}", constants, f"Constants of {of}", exact=True)
        if self.exchanged:
            n, initial = len(mode.program.layout.state), mode.program.kernel("initial")
            along = tangent_kernel(mode.expansion, n, further=[("t", 0)])
            kernels = {"rates": mode.program.kernel("rhs"), "expanded_along": along}
            kernels |= {"guards": mode.guards} if mode.guards.outputs else {}
            kernels |= {} if self.layout.outputs else {"initial": initial}
            for what, kernel in kernels.items():
                kernel = replace(kernel, arguments=STEP_ARGUMENTS)
                self._print(f"{what}_{number}", kernel, f"{what.capitalize().replace('_', ' ')} in {of}")
        return super()._mode_kernels(number)

    def _mode_variables(self, number: int) -> dict[str, Any]:
        """Return the variables of a mode in the template of further functions."""
        mode, n_p = self.loop.modes[number], len(self.loop.parameters)
        given = [f"p[{place}]" if place < n_p else f"added[{place - n_p}]" for place in mode.places]
        return {
            **{what: self._name(f"{what}_{number}") for what in _MODE},
            "outputs": self._name(f"output_{number}"),
            "states": plain(" and ".join(mode.states)),
            "given": given,
            "n_given": len(given),
            "n_guards": len(mode.guards.outputs),
            "correct": self.corrections[number] if self.exchanged else "",
            "n_own": len(mode.program.layout.state),
            "n_along": 2 * len(mode.program.layout.state),
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
                "n_computed": self.n_computed,
                "first_rate": self.n_computed + len(self.loop.variables),
                "first_guard": self.n_computed + 2 * len(self.loop.variables),
                "n_guards": self.n_guards,
                "n_along": 2 * known["n_own"] + 1,
                "n_carried": max(len(mode.guards.outputs) for mode in self.loop.modes),
                "exchanged": self.exchanged,
                "rounding": double(RESOLUTION),
                "begins": bool(self.exchanged or self.layout.outputs),
                "modes": [self._mode_variables(number) for number in range(len(programs))],
                "n_constants": max(1, *(len(program.kernel("prepare").outputs) for program in programs)),
            },
        )

    def _header_variables(self, members: list[str]) -> dict[str, Any]:
        """See `Simulator`."""
        own = {
            "n_values": self.n_values,
            "n_guards": self.n_guards,
            "exchanged": self.exchanged,
            "corrected": self.corrected,
        }
        return {**super()._header_variables(members), **own}
