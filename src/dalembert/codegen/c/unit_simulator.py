"""The simulator in C99 of a functional mock-up unit: that of any export, with values and derivatives besides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...ir.kernel import Kernel
from ...ir.program import coefficient_places
from ...loops.steps_at_instants import instant_of_controller, next_instant
from ...methods.step_constants import SMALLEST_OF_TIME
from ...transforms.partials import tangent_kernel
from ...transforms.taylor.nonsmooth import decisions
from ...transforms.taylor.step import STEP_ARGUMENTS
from ..rendering import render
from .descriptions import CSource, plain
from .printing import double
from .run_stops import LAW
from .simulator import Simulator
from .source import LoopSource

_PUBLIC = ("values", "directional", "rate", "correct", "advance", "act", "instant")
"""Ends of the names of public functions that only units have."""


class UnitSimulator(Simulator):
    """A simulator in C99 of a functional mock-up unit.

    Attributes
    ----------
    exchanged : bool
        Whether an integrator of the importer can run it, which needs rates without jumps and pulses.
    corrected : bool
        Whether such a run is projected onto constraints.
    """

    def __init__(self, source: CSource) -> None:
        self.exchanged = decisions(source.program) is None and source.program.conditions is None
        corrections = ("project_position", "project_velocity")
        self.corrected = self.exchanged and any(name in source.program for name in corrections)
        super().__init__(source)

    @property
    def n_computed(self) -> int:
        """Number of coordinates, rates, first-order states, outputs and events."""
        return self.first_event + len(self.source.watched)

    @property
    def first_event(self) -> int:
        """Place of the first event among the values."""
        return len(self.program.kernel("expand").outputs) + len(self.layout.outputs)

    @property
    def n_values(self) -> int:
        """Number of values: those that are computed, then the state, its rate and event indicators."""
        return self.n_computed + (2 * len(self.layout.state) + self.n_indicators if self.exchanged else 0)

    @property
    def n_indicators(self) -> int:
        """Number of event indicators: determinants of angles, then expressions of events."""
        return len(self.source.locking) + len(self.source.watched)

    @property
    def n_knowns(self) -> int:
        """Number of values by which others are differentiated: the state, inputs and parameters."""
        return self.n_known_states + len(self.layout.inputs) + len(self.source.parameters)

    @property
    def n_known_states(self) -> int:
        """Number of components of the state among them."""
        return len(self.layout.state) if self.exchanged else 0

    def _state_kernels(self) -> None:
        """See `Simulator`."""
        super()._state_kernels()
        known = {"expanded": "expand"} | ({"output": "outputs"} if self.layout.outputs else {})
        kernels = {what: self.program.kernel(name) for what, name in known.items()}
        if self.exchanged:
            kernels["rates"] = self.program.kernel("rhs")
            if self.source.method == "taylor" or self.source.events is not None:  # other loops print it
                self._program_kernel("rates", "rhs", "Rate of the state")
            locks = self._locks()
            kernels |= {} if locks is None else {"locks": locks}
            if self.source.events is not None:
                kernels["indicators"] = replace(self.source.events.values, arguments=STEP_ARGUMENTS)
                self._print("indicators", kernels["indicators"], "Expressions of events")
        for what, kernel in kernels.items() if self.n_knowns else ():
            self._print(f"{what}_along", self._tangent(kernel), f"Derivatives of {what} along a direction")
        if self.source.parameters:
            constants = replace(self.program.kernel("prepare"), arguments=("p", "y", "c", "s"))
            along = tangent_kernel(constants, 0, "p", len(self.layout.parameters))
            self._print("constants_along", along, "Derivatives of the constants along a direction")

    def _tangent(self, kernel: Kernel) -> Kernel:
        """Return the derivative of a kernel along a direction: parts of the state, and of the constants."""
        n_states, n_constants = len(self.layout.state), len(self.program.kernel("prepare").outputs)
        constants = [("c", place) for place in range(n_constants)]
        along = tangent_kernel(kernel, n_states, count=self.n_known_states, further=constants)
        return replace(along, arguments=STEP_ARGUMENTS)

    def _further_calls(self, loop: Any, kind: type[tuple[Any, ...]], code: LoopSource) -> dict[str, Any]:
        """See `Simulator`."""
        return {
            "correct": code.entry(loop.correct, kind, "t") if self.corrected else "",
            "act": [code.entry(loop.act, kind, "t1")] if self.actions else [],
            "next": code.entry(next_instant, kind) if self.actions else "",
            "instants": [code.entry(instant_of_controller, kind, number=k) for k in range(len(self.actions))],
        }

    def _taken(self) -> frozenset[str]:
        """See `Simulator`."""
        return super()._taken() | {self._name(what) for what in _PUBLIC}

    def _further_functions(self, variables: Mapping[str, Any]) -> str:
        """See `Simulator`."""
        known, n_states = {**variables["functions"], **variables["state"]}, len(self.layout.state)
        first, n_events = self.n_computed + n_states, len(self.source.watched)
        names = ("prefix", "upper", "n_states", "n_outputs", "n_variables")
        text = render(
            "fmi/simulator.c.j2",
            {
                **{name: known[name] for name in names},
                **{name: variables["calls"][name] for name in ("correct", "act")},
                "at": {"constants": self.behind if self.before else self.at["constants"]},
                "n_computed": self.n_computed,
                "n_knowns": self.n_knowns,
                **self._along_variables(),
                "first_rate": first,
                "first_lock": first + n_states if known["n_locks"] else 0,
                "counts": [[self.first_event, n_events]] if n_events else [],
                "indicators": [first + n_states + known["n_locks"]] if n_events else [],
                "exchanged": self.exchanged,
            },
        )
        return text + self._controllers(variables["calls"]) if self.actions else text

    def _along_variables(self) -> dict[str, Any]:
        """Return variables of directional derivatives; kernels take the state, then parts of it and of constants."""
        first = len(self.layout.state) + self.n_known_states
        inputs = coefficient_places(self.layout.parameters, self.layout.inputs)
        parameters, known = self.layout.parameters, self.n_known_states
        return {
            "n_along": first + len(self.program.kernel("prepare").outputs),
            "n_known_states": known,
            "first_constant": first,
            # the value of an input stands behind its time
            "input_parts": [[first + place + 1, known + i] for i, place in enumerate(inputs)],
            "parameter_parts": [
                [parameters.index(name), known + len(inputs) + i] for i, name in enumerate(self.source.parameters)
            ],
            "n_parameters": len(parameters),
        }

    def _law_name(self, number: int) -> str:
        """Return the name of the function of what a controller sets."""
        return self._name(LAW.format(number))

    def _controllers(self, calls: Mapping[str, Any]) -> str:
        """Return the functions of controllers, for calls of those of the loop."""
        laws = [
            {
                "name": plain(action.name),
                "law": self._law_name(number),
                "next": calls["instants"][number],
                "places": list(action.places),
            }
            for number, action in enumerate(self.actions)
        ]
        return render(
            "fmi/controllers.c.j2",
            {
                "prefix": self.prefix,
                "at": {"constants": self.at["constants"]},
                "controllers": laws,
                "most_set": max(len(action.places) for action in self.actions),
                "next": calls["next"],
                "nearness": double(SMALLEST_OF_TIME),
            },
        )

    def _header_variables(self, members: list[str]) -> dict[str, Any]:
        """See `Simulator`."""
        return {
            **super()._header_variables(members),
            "n_values": self.n_values,
            "n_knowns": self.n_knowns,
            "exchanged": self.exchanged,
            "corrected": self.corrected,
            "controlled": len(self.actions),
        }
