"""The simulator in C99 of a functional mock-up unit with events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

from ...loops.event_steps import implicit_update, update, update_with_stops
from ..rendering import render
from .event_simulator import EventSimulator
from .printing import double
from .source import LoopSource
from .unit_simulator import UnitSimulator


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
