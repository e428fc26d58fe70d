"""The files of a simulator in C99 of a scene with events: the loop over lanes, for one case."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, final

import numpy as np

from ...frozen import frozen
from ...loops.event_steps import (
    EventPlace,
    EventSteps,
    act_run,
    begin_run_instants,
    continue_run,
    correct_run,
    cut_run,
    implicit_update,
    resume_run,
    sample_step,
    settle_run,
    take_implicit_step,
    take_step,
    take_step_with_stops,
    update,
    update_with_stops,
)
from ...methods.status import Status
from ...subset.arguments import kind_of
from ...subset.compiled_subset import NUMBER
from ..rendering import render
from ..subset.target import Value
from .contact_loops import CHECK, CONSTANT_OF_LANE
from .printing import Known, double
from .simulator import Simulator
from .source import LoopSource
from .unit_simulator import UnitSimulator
from .workspace import workspace_of

_AT = {
    "time": "place.time",
    "direction": "place.direction",
    "steps": "place.steps",
    "constants": "constants",
    "behind": "runner.state.constants",
    "evaluated": "runner.state.progress.paused",
    "now": "runner.state.states + run->runner.state.progress.old",
}
"""Members of a run that its functions set and read."""

_ROWS = ("times", "states", "constants")


@final
@frozen
class _Functions:
    """Functions of the loop; see `dalembert.codegen.c.run_loops.RunLoop`."""

    correct: Callable[..., Any] = correct_run
    act: Callable[..., Any] = act_run
    resume: Callable[..., Any] = resume_run


class EventSimulator(Simulator):
    """A simulator in C99 of a scene without contacts that change, with events."""

    template: ClassVar[str] = "c/event_functions.c.j2"
    statuses: ClassVar[tuple[Status, ...]] = (
        *Simulator.statuses,
        Status.EVENT,
        Status.EVENTS_ACCUMULATE,
        Status.EVENT_STATE,
        Status.EVENT_NON_FINITE,
    )

    def _variables(self) -> dict[str, dict[str, Any]]:
        """See `Simulator`."""
        own = self.source.events
        assert own is not None
        self.at |= _AT
        self._start_kernels()
        self._state_kernels()
        self._condition_kernels()
        steps = EventSteps(own.arguments, np.zeros(len(self.layout.state)), EventPlace(), own.instants)
        constant = frozenset(f"runner.{name}" for name in CONSTANT_OF_LANE.split())
        codes = {**own.functions.names, int(own.arguments.kernels.check): Known(CHECK)}
        space = workspace_of(steps, frozenset(), constant, codes)
        code = LoopSource(space, self.prefix, "fused", self._taken())
        value = Value(kind_of(EventSteps), (), "run", 0)
        inputs, controlled = bool(self.layout.inputs), bool(self.actions)
        step = take_implicit_step if own.implicit else take_step_with_stops if own.stops else take_step
        take = code.call(step, [value])[0]
        sample = code.call(sample_step, [value, Value(NUMBER, ("t",))])[0]
        go_on = [code.call(continue_run, [value, Value(NUMBER, ("t1",))])[0]] if self.source.goes_on else []
        renew = [code.call(cut_run, [value])[0]] if inputs else []
        begins = code.call(begin_run_instants, [value, Value(NUMBER, ("t0",))])[0] if controlled else ""
        settle = code.call(settle_run, [value])[0] if controlled else ""
        resume = self._breaks(_Functions(), EventSteps, code)
        further = self._further_calls(_Functions(), EventSteps, code)
        used = own.functions.used(code.text)
        self._finish(render("c/kernels.c.j2", {"kernels": self.kernels}) + used, code)
        needed = {"sampled", "place", "runner.state.states", "runner.state.progress", "runner.happened"}
        needed |= {"runner.limits", *(f"runner.rows.{name}" for name in _ROWS)}
        members = space.members_used(code.text, needed)
        members.append(f"double constants[{max(len(self.program.kernel('prepare').outputs), 1)}];")
        n_locks = len(self.source.locking)
        functions = {
            **self._function_variables(),
            "sample": sample,
            "at": {name: self.at[name] for name in ("time", "direction", "constants", "now")},
            "n_events": len(own.events),
            "n_constants": len(self.program.kernel("prepare").outputs),
            "n_locks": n_locks,
            "go_on": [(call, resume) for call in go_on],
            "constants_of_steps": bool(self.before),
            "begins": begins,
        }
        copies = ["runner.rows.constants", "runner.state.constants"] if inputs else []
        return {
            "header": self._header_variables(members) | {"n_locks": n_locks},
            "functions": functions,
            "calls": further,
            "steps": self._changing_steps(take, settle, n_events=len(own.events), n_locks=n_locks),
            **self._state_variables(renew, copies),
            **self._further_variables(space.beginning_used(code.text, needed), f"{self.prefix}_step"),
        }


@final
class EventUnitSimulator(UnitSimulator, EventSimulator):
    """A simulator in C99 of a functional mock-up unit of a scene without contacts that change, with events."""

    def _further_calls(self, loop: Any, kind: type[tuple[Any, ...]], code: LoopSource) -> dict[str, Any]:
        """See `Simulator`."""
        own, (begin, end) = self.source.events, self.source.span
        assert own is not None
        function = implicit_update if own.implicit else update_with_stops if own.stops else update
        found = code.entry(function, kind, "t", double(abs(end - begin))) if self.exchanged else ""
        return super()._further_calls(loop, kind, code) | {"update": found}

    def _further_functions(self, variables: Mapping[str, Any]) -> str:
        """See `Simulator`."""
        text = super()._further_functions(variables)
        if not self.exchanged:
            return text
        names = {"prefix": self.prefix, "upper": self.prefix.upper(), "n_states": len(self.layout.state)}
        return text + render("fmi/events.c.j2", {**names, "update": variables["calls"]["update"]})

    def _law_name(self, number: int) -> str:
        """See `UnitSimulator`."""
        assert self.source.events is not None
        return self.source.events.functions.names[int(self.source.events.arguments.stops.actions[number])]

    def _taken(self) -> frozenset[str]:
        """See `Simulator`."""
        return super()._taken() | {self._name("update")}
