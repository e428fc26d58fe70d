"""The files of a simulator in C99 of a scene whose contacts change, also of a functional mock-up unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, final

from ...contacts.contact_steps import CHANGES
from ...contacts.equations.contact_laws import STATES
from ...contacts.phase_tables import NOT_STARTED
from ...ir.program import coefficient_places
from ...methods.status import Status
from ...methods.step_constants import RESOLUTION
from ...transforms.partials import tangent_kernel
from ...transforms.taylor.nonsmooth import decisions
from ...transforms.taylor.step import STEP_ARGUMENTS
from ..rendering import render
from .contact_loops import ContactLoop, ContactSource
from .descriptions import CSource, plain
from .event_simulator import EventSimulator
from .fixed_simulator import FixedSimulator
from .printing import double
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


_PUBLIC = ("begin", "changes", "change", "advance", "present", "values", "rate", "correct", "update")
"""Ends of the names of public functions that only units have."""

_MODE = ("begun", "constants", "initial", "rates", "guards", "expanded_along")
"""Beginnings of the names of functions of a mode."""

_NEEDED = ("turn", "carried", "cases.added")
"""Members of the table of cases that functions of units read or set besides those of `ContactSimulator`."""


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
