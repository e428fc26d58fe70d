"""The files of a simulator in C99 of a scene whose contacts change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar, final

from ...contacts.equations.contact_laws import STATES
from ...contacts.phase_tables import NOT_STARTED
from ...ir.program import coefficient_places
from ...methods.status import Status
from ...transforms.taylor.step import STEP_ARGUMENTS
from ..rendering import render
from .contact_loops import ContactSource
from .descriptions import CSource, plain
from .event_simulator import EventSimulator
from .fixed_simulator import FixedSimulator
from .simulator import Simulator

_AT = {
    "time": "place.time",
    "direction": "place.direction",
    "steps": "phases.table.numbers.steps[0]",
    "constants": "constants",
}
"""Members of a run that its functions set and read."""

_CASE = ("t", "x", "p", "span", "modes")
_TABLE = ("t0", "t1", "numbers.state", "numbers.runner", "numbers.steps", *(f"cases.{name}" for name in _CASE))
"""Members of the case, and of the table that it is in, that the functions set or read, too."""


def c_files(source: CSource) -> dict[str, str]:
    """Return the texts of the files of a simulator, by their names."""
    return simulator_of(source).files


def simulator_of(source: CSource) -> Simulator:
    """Return a simulator in C99."""
    if source.step is not None:
        return FixedSimulator(source)
    if source.events is not None:
        return EventSimulator(source)
    if source.contacts is None:
        return Simulator(source)
    return ContactEventSimulator(source) if source.watched else ContactSimulator(source)


class ContactSimulator(Simulator):
    """A simulator in C99 of a scene whose contacts change.

    Attributes
    ----------
    corrected : bool
        Whether states that an integrator of others has reached are put back onto the constraints.
    corrections : sequence of str
        How, for each mode.
    """

    corrected = False
    corrections: Sequence[str] = ()
    template: ClassVar[str] = "c/contact_functions.c.j2"
    contact_states: ClassVar[tuple[str, ...]] = tuple(state.upper() for state in STATES)
    statuses: ClassVar[tuple[Status, ...]] = (
        *Simulator.statuses,
        Status.CONTACT_IMPOSSIBLE,
        Status.CONTACT_AMBIGUOUS,
        Status.EVENTS_ACCUMULATE,
        Status.EVENT_NON_FINITE,
    )

    def _variables(self) -> dict[str, dict[str, Any]]:
        """See `Simulator`."""
        loop = self.source.contacts
        assert loop is not None
        self.at |= _AT
        self._start_kernels()
        modes = [self._mode_kernels(number) for number in range(len(loop.modes))]
        loops = ContactSource(loop, self.prefix, self._taken(), corrected=self.corrected)
        used = loop.functions.used(loops.code.text)
        self._finish(render("c/kernels.c.j2", {"kernels": self.kernels}) + used, loops.code)
        needed = self._needed()
        members = loops.space.members_used(loops.code.text, needed)
        members.append(f"double constants[{max(len(self.program.kernel('prepare').outputs), 1)}];")
        functions = {
            **self._function_variables(),
            "at": {name: self.at[name] for name in ("time", "direction", "constants")},
            "n_outputs": len(self.layout.outputs),
            "samples": loops.samples,
            "sample_end": loops.sample_end,
            "modes": modes,
            "n_own": max(len(mode.program.kernel("initial").outputs) for mode in loop.modes),
            "n_contacts": len(loop.contacts),
            "parameters": [(loop.parameters.index(name), plain(name)) for name in self.source.parameters],
            "n_inputs": len(loop.inputs),
            "input_places": list(coefficient_places(loop.parameters, loop.inputs)),
            "cuts": loops.cuts,
            "not_started": NOT_STARTED,
            "n_events": len(self.source.watched),
            "begins": loops.begins,
        }
        further = self._further_variables(loops.space.beginning_used(loops.code.text, needed), f"{self.prefix}_step")
        self.corrections = loops.corrections
        steps = self._changing_steps(loops.take_step, n_events=len(self.source.watched), n_locks=0, phases=True)
        return {"header": self._header_variables(members), "functions": functions, "steps": steps, **further}

    def _needed(self) -> set[str]:
        """Return the members that the public functions read or set."""
        assert self.source.contacts is not None
        count = len(self.source.contacts.modes)
        needed = {"sampled", "place", "phases.plan.most_steps", *(f"phases.table.{name}" for name in _TABLE)}
        needed |= {"phases.table.turn"} if self.layout.inputs else set()
        needed |= {"phases.table.occurred", "phases.space.happened"} if self.source.watched else set()
        return needed | {f"mode_{i}.{name}" for i in range(count) for name in ("limits", "state.constants")}

    def _mode_kernels(self, number: int) -> dict[str, Any]:
        """Print the kernels of outputs in a mode; return their names, and the places of inputs among its constants."""
        assert self.source.contacts is not None
        mode, named = (
            self.source.contacts.modes[number],
            {"initial": f"initial_{number}", "outputs": f"output_{number}"},
        )
        kernels = {"initial": mode.program.kernel("initial"), "outputs": mode.outputs}
        for what, name in named.items() if self.layout.outputs else ():
            kernel = replace(kernels[what], arguments=STEP_ARGUMENTS)
            self._print(name, kernel, f"{what.capitalize()} where contacts {' and '.join(mode.states)}")
        inputs = [str(place) for place in coefficient_places(mode.program.layout.parameters, self.layout.inputs)]
        return {what: self._name(name) for what, name in named.items()} | {"inputs": inputs}


@final
class ContactEventSimulator(ContactSimulator):
    """A simulator in C99 of a scene whose contacts change, with events."""

    statuses: ClassVar[tuple[Status, ...]] = (*ContactSimulator.statuses, Status.EVENT, Status.EVENT_STATE)
