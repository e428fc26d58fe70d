"""Models as stored sweeps use them: with and without contacts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np
from numpy.typing import NDArray

from ...methods.status import Status
from ...options import SweepOptions
from ..cases import Cases, spans_of
from ..event_parameters import with_event_parameters
from ..input_values import GivenInputs, read_inputs
from ..sweep import sweep
from .request import Part, Request

if TYPE_CHECKING:
    from ...results.hybrid_sweep import HybridSweep
    from ...results.sweep import Sweep
    from ..hybrid.model import HybridModel
    from ..model import CompiledModel

__all__ = ["ContactModel", "SmoothModel", "SweptModel"]

_SCANNED = 4096
"""Cases that are looked at together in the search for those that decide."""


@dataclass(frozen=True, eq=False)
class SweptModel(ABC):
    """Base class of models in stored sweeps; a subclass has the decisions that a sweep makes once for all its cases."""

    model: Any

    @property
    @abstractmethod
    def text(self) -> str:
        """Text of everything that the results depend on, the same in every process."""

    @abstractmethod
    def leading_cases(self, request: Request, options: SweepOptions) -> list[int]:
        """Return the cases, at least one, from which a sweep makes its decisions for all cases."""

    @abstractmethod
    def with_event_parameters(self, parameters: Mapping[Any, Any], options: SweepOptions) -> Self:
        """Return the model with the parameters that only events and reductions contain."""

    def run(self, part: Part, options: SweepOptions) -> Sweep | HybridSweep:
        """Return the results of a part, its leading cases among them.

        Raises
        ------
        KeyboardInterrupt
            Where Ctrl-C has stopped cases.
        """
        own = replace(options, inputs=self.inputs(part))
        found: Sweep | HybridSweep = sweep(self.model, part.t_span, part.initial, part.parameters, own)
        if np.any(found.status == Status.INTERRUPTED):
            raise KeyboardInterrupt
        return found

    def methods(self, request: Request, options: SweepOptions) -> dict[tuple[int, float], str] | None:
        """Return the methods that the first, the middle and the last case take, None where they are given.

        "auto" looks at these cases, in a scene with contacts at all phases of their motions.
        """
        if not options.automatic:
            return None
        part = request.part(request.count - 1, request.count, [0, request.count // 2])
        return dict(self.run(part, options).stats.methods)

    def inputs(self, part: Part) -> GivenInputs | None:
        """Return the inputs of the cases of a part."""
        return read_inputs(self.model.layout, self.model._inputs, part.inputs, many=True)


@final
@dataclass(frozen=True, eq=False)
class SmoothModel(SweptModel):
    """A scene without contacts, or with contacts in one mode."""

    model: CompiledModel

    @property
    def text(self) -> str:
        """The program."""
        return str(self.model.stages.program)

    def with_event_parameters(self, parameters: Mapping[Any, Any], options: SweepOptions) -> SmoothModel:
        """Return the model with the parameters that only events and reductions contain."""
        about = parameters, options.events, options.reduce, options.grid
        return SmoothModel(with_event_parameters(self.model, *about))

    def leading_cases(self, request: Request, options: SweepOptions) -> list[int]:
        """Return the cases by which a sweep decides what all cases have in common.

        They are the first case, the first that can start, and, where a pivot of the constraints vanishes in the first
        case, the first in which none does.
        """
        lead = [0]
        few = replace(options, error_estimate=False, t_eval=None, max_steps=1, project_invariants=False)
        for first in range(0, request.count, _SCANNED):
            found = self.run(request.part(first, min(first + _SCANNED, request.count), []), few)
            able = np.flatnonzero(~np.isin(found.status, (Status.INITIAL_STATE, Status.ASSUMPTION)))
            if len(able):
                lead.append(first + int(able[0]))
                break
        if self.model.stages.reduced.pivots and self._lost_pivots(request, 0, 1)[0]:
            for first in range(0, request.count, _SCANNED):
                kept = np.flatnonzero(~self._lost_pivots(request, first, min(first + _SCANNED, request.count)))
                if len(kept):
                    lead.append(first + int(kept[0]))
                    break
        return list(dict.fromkeys(lead))

    def _lost_pivots(self, request: Request, first: int, last: int) -> NDArray[np.bool_]:
        """Return in which of some cases a pivot of the constraints vanishes."""
        part = request.part(first, last, [])
        given, parameters = self.inputs(part), part.parameters
        if given is not None:
            parameters = dict(given.case_parameters(parameters, *spans_of(part.t_span)))
        program, start = self.model.stages.program, self.model.derived.start
        cases = Cases(program, start, part.t_span, part.initial, parameters)
        return np.broadcast_to(cases.lost_pivots(slice(0, cases.count)), last - first)


@final
@dataclass(frozen=True, eq=False)
class ContactModel(SweptModel):
    """A scene whose contacts change their modes; every case decides for itself, but for methods."""

    model: HybridModel

    @property
    def text(self) -> str:
        """The program with all contacts open, the numbers that decide on modes, and what the outputs are."""
        modes, options = self.model.modes, self.model.several.options
        program = modes.model(modes.open_mode).stages.program
        return f"{program}\n{modes.automaton.contact_data}\n{options.formulation} {options.outputs!r}"

    def with_event_parameters(self, parameters: Mapping[Any, Any], options: SweepOptions) -> ContactModel:
        """Return the model with the parameters that only events and reductions contain."""
        about = parameters, options.events, options.reduce, options.grid
        return ContactModel(with_event_parameters(self.model, *about))

    def leading_cases(self, request: Request, options: SweepOptions) -> list[int]:
        """Return the first case, so that no part has one case alone."""
        return [0]
