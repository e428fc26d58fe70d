"""The variables of the templates of ``codegen_templates/c`` that simulators have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from ...ir.program import coefficient_places
from ...methods.status import Status
from ...methods.step_constants import RESOLUTION
from ...options import MAX_STEPS
from ...stops.break_tables import MOST_BREAKS
from ..rendering import banner_lines
from .descriptions import (
    CSource,
    enumerations,
    main_variables,
    names_and_numbers,
    plain,
    quoted,
    readme_variables,
    step_of,
)
from .printing import double, prefix_of

STATUSES = (
    Status.SUCCESS,
    Status.MAX_STEPS,
    Status.STEP_TOO_SMALL,
    Status.NON_FINITE,
    Status.PROJECTION_FAILED,
    Status.INITIAL_STATE,
    Status.SINGULAR_CONFIGURATION,
    Status.SINGULAR_COORDINATES,
    Status.ASSUMPTION,
    Status.TIMES_IN_NO_ORDER,
)
"""Statuses of exported runs."""

STATUS_TEXTS = {
    Status.INITIAL_STATE: "The initial values contradict a constraint: see the number of the check.",
    Status.ASSUMPTION: "A parameter or an initial value contradicts what its symbol was declared to be.",
    Status.SINGULAR_CONFIGURATION: "Constraints depend on each other at the start, or do not determine the motion.",
}
"""Texts of statuses of exported runs that differ from their messages."""

_TIMES = "The times are not finite, not sorted, or before the last step"


class TemplateVariables:
    """Variables of templates by a source, and the names of its simulator.

    Attributes
    ----------
    prefix : str
        Of all public names.
    at : mapping of str to str
        Members of a run, see `dalembert.codegen.c.run_loops.RunLoop`.
    at_start : dict
        Calls at a start: "find" finds the breaks of conditions on time, "decided" has a place among the parameters and
        what returns when these are decided, its value; empty without conditions.
    before : str
        Member with the constants of the last step, empty where constants do not change.
    """

    statuses: ClassVar[tuple[Status, ...]] = STATUSES
    """Statuses of its runs."""

    contact_states: ClassVar[tuple[str, ...]] = ()
    """Names of the states of contacts that change, by their numbers; empty without such contacts."""

    def __init__(self, source: CSource) -> None:
        self.source, self.program, self.layout = source, source.program, source.program.layout
        self.prefix, self.at = prefix_of(source.program.name), dict[str, str]()
        self.at_start: dict[str, Any] = {"find": "", "decided": []}
        self.before = ""

    @property
    def behind(self) -> str:
        """Member with the constants behind the last step."""
        return self.at.get("behind", self.at["constants"])

    def _state_variables(self, renew: Sequence[str] = (), copies: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
        """Return the variables of templates of simulators without contacts.

        Calls follow where inputs change, which is also written to members that have copies of the constants.
        """
        named, n_locks = {"prefix": self.prefix}, len(self.source.locking)
        state = named | {
            "at": {name: self.at[name] for name in ("constants", "evaluated", "time")},
            "before": [(self.before, self.behind, self.at["direction"])] if self.before else [],
            "constants": "constants_at(run, t)" if self.before else f"run->{self.at['constants']}",
            "renew": list(renew),
            "copies": list(copies),
            "input_places": list(coefficient_places(self.layout.parameters, self.layout.inputs)),
            "n_inputs": len(self.layout.inputs),
            "n_outputs": len(self.layout.outputs),
            "n_variables": len(self.program.kernel("expand").outputs),
        }
        locks = named | {
            "at": {name: self.at[name] for name in ("constants", "now", "time")},
            "n_locks": n_locks,
        }
        return {"state": state} | ({"locks": locks} if n_locks else {})

    def _further_variables(self, beginning: Sequence[tuple[str, str]], advance: str) -> dict[str, dict[str, Any]]:
        """Return the variables of what all simulators have; members begin so, and a function takes steps."""
        return {
            "starts": self._start_variables(beginning),
            "texts": self._text_variables(advance),
            "main": main_variables(self.source, self.prefix),
            "readme": readme_variables(self.source, self.prefix),
        }

    def _header_variables(self, members: list[str]) -> dict[str, Any]:
        """Return the variables of ``c/header.h.j2`` for the members of a run, of one whose angles do not lock."""
        return {
            **names_and_numbers(self.source, self.prefix),
            "banner": [plain(line) for line in banner_lines(self.program)],
            "statuses": [{"name": status.name, "number": int(status)} for status in self.statuses],
            "guard": f"{self.prefix.upper()}_H",
            "enumerations": enumerations(self.source),
            "members": members,
            "max_steps": MAX_STEPS,
            "step": step_of(self.source),
            "n_further": len(self.layout.states),
            "n_locks": 0,
            "n_events": len(self.source.watched),
            "goes_on": self.source.goes_on,
            "contact_states": self.contact_states,
            **dict.fromkeys(("n_values", "n_knowns", "n_guards", "exchanged", "corrected", "controlled"), 0),
        }

    def _function_variables(self) -> dict[str, Any]:
        """Return variables of the public functions of all simulators."""
        return {
            "prefix": self.prefix,
            "upper": self.prefix.upper(),
            "at": self.at,
            "n_states": len(self.layout.state),
            "n_started": max(len(self.source.start.kernel.outputs), 1),
            "max_steps": MAX_STEPS,
        }

    def _changing_steps(
        self, take_step: str, settle: str = "", *, n_events: int, n_locks: int, phases: bool = False
    ) -> dict[str, Any]:
        """Return the variables of ``c/changing_steps.c.j2``; ``settle`` is a call where controllers act."""
        return {
            "prefix": self.prefix,
            "upper": self.prefix.upper(),
            "at": {name: self.at[name] for name in ("time", "direction")},
            "take_step": take_step,
            "n_states": len(self.layout.state),
            "n_events": n_events,
            "n_locks": n_locks,
            "settle": settle,
            "phases": phases,
            "rounding": double(RESOLUTION),
        }

    def _start_variables(self, beginning: Sequence[tuple[str, str]]) -> dict[str, Any]:
        """Return the variables of ``c/starts.c.j2``; members begin so."""
        source, parameters, admission = self.source, self.layout.parameters, self.source.admission
        return {
            "prefix": self.prefix,
            "upper": self.prefix.upper(),
            "at": {"constants": self.at["constants"]},
            "beginning": list(beginning),
            "defaults": [(parameters.index(name), double(value)) for name, value in source.defaults.items()],
            "parameter_places": [parameters.index(name) for name in source.parameters],
            "n_given": max(len(parameters), 1),
            "n_initial": len(source.start.given),
            "n_begun": source.begun,
            "n_checks": len(source.start.labels),
            "n_tests": 0 if admission is None else len(admission.outputs),
            "dependent_tests": self._dependent_tests(),
            "n_constants": len(self.program.kernel("prepare").outputs),
            "forward_only": source.forward_only,
            **self.at_start,
        }

    def _text_variables(self, advance: str) -> dict[str, Any]:
        """Return the variables of ``c/texts.c.j2``; a function takes steps."""
        times = _TIMES + "".join(text for has, text in self._bad_times() if has) + "."
        texts = STATUS_TEXTS | {Status.TIMES_IN_NO_ORDER: times}
        statuses = [
            {"name": status.name, "text": quoted(texts.get(status, status.message))} for status in self.statuses
        ]
        return {
            "prefix": self.prefix,
            "upper": self.prefix.upper(),
            "at": {"time": self.at["time"]},
            "advance": advance,
            "n_states": len(self.layout.state),
            "checks": [quoted(f"{kind}: {label}") for kind, label in self.source.start.labels],
            "statuses": statuses,
        }

    def _bad_times(self) -> list[tuple[bool, str]]:
        """Return what else `Status.TIMES_IN_NO_ORDER` may mean, each with whether a scene has it."""
        return [
            (self.source.sampling is not None, "; or a controller has no period above 0, or an offset below 0"),
            (bool(self.at_start["find"]), f"; or functions of time have more than {MOST_BREAKS} kinks and jumps"),
        ]

    def _dependent_tests(self) -> list[tuple[int, int]]:
        """Return the places of the number of constraints that depend on others and of its limit, where it is tested."""
        if self.source.admission is None or not self.source.dependent:
            return []
        count = len(self.source.admission.outputs)
        return [(count - 2, count - 1)]
