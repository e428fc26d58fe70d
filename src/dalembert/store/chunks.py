"""Chunks of a stored sweep: their cases, their results as arrays over the cases, and how they come into the store."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from ..frozen import frozen
from ..methods.status import Status
from ..options import SweepOptions
from ..results.labels import distinct, value_name
from ..runs.case_settings import spans_of
from ..runs.cases import Cases
from ..runs.events import with_event_parameters
from ..runs.sweep import sweep_cases
from ..starts.input_values import GivenInputs, read_inputs
from .request import CasePart, Request
from .store import Columns, Store

if TYPE_CHECKING:
    import xarray

    from ..model.model import CompiledModel
    from ..results.sweep import Sweep


# Models as stored sweeps use them.

_SCANNED = 4096
"""Cases that are looked at together in the search for those that decide."""


@final
@frozen(eq=False)
class SweptModel:
    """A model in a stored sweep, with the decisions that a sweep makes once for all its cases.

    With contacts that change, every case decides for itself, but for methods.
    """

    model: CompiledModel

    @property
    def text(self) -> str:
        """Text of everything that the results depend on, the same in every process.

        It is the program or, with contacts that change, the program with all contacts open, the numbers that decide on
        modes, and what the outputs are.
        """
        modes, options = self.model.modes, self.model.options
        if modes is None:
            return str(self.model.stages.program)
        program = modes.model(modes.open_mode).stages.program
        return f"{program}\n{modes.automaton.contact_data}\n{options.formulation} {options.impacts} {options.outputs!r}"

    def with_event_parameters(self, parameters: Mapping[Any, Any], options: SweepOptions) -> SweptModel:
        """Return the model with the parameters that only events and reductions contain."""
        about = parameters, options.events, options.reduce, options.grid
        return SweptModel(with_event_parameters(self.model, *about))

    def run(self, part: CasePart, options: SweepOptions) -> Sweep:
        """Return the results of a part, its leading cases among them.

        Raises
        ------
        KeyboardInterrupt
            Where Ctrl-C has stopped cases.
        """
        own = replace(options, inputs=self.inputs(part))
        found = sweep_cases(self.model, part.t_span, part.initial, part.parameters, own)
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

    def inputs(self, part: CasePart) -> GivenInputs | None:
        """Return the inputs of the cases of a part."""
        return read_inputs(self.model.layout, self.model.inputs, part.inputs, many=True)

    def leading_cases(self, request: Request, options: SweepOptions) -> list[int]:
        """Return the cases by which a sweep decides what all cases have in common.

        They are the first case, the first that can start, and, where a pivot of the constraints vanishes in the first
        case, the first in which none does. With contacts that change it is the first, so that no part has one case.
        """
        lead = [0]
        if self.model.modes is not None:
            return lead
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
@frozen(eq=False)
class ChunkJob:
    """The common part of all chunks of a sweep: model, options, cases, leading cases, store."""

    model: SweptModel
    options: SweepOptions
    request: Request
    leaders: Sequence[int]
    store: Store

    def cases(self, chunk: int) -> tuple[int, int]:
        """Return the number of the first case of a chunk, and of the one behind its last."""
        first = chunk * self.store.rows * self.request.row
        return first, min(first + self.store.rows * self.request.row, self.request.count)

    def given(self, chunk: int) -> CasePart:
        """Return the arrays of a chunk."""
        return self.request.given(*self.cases(chunk), self.leaders)

    def run(self, chunk: int, given: CasePart, threads: int) -> None:
        """Compute a chunk from its arrays, and write it."""
        part = self.request.completed(given, *self.cases(chunk), self.leaders)
        results = results_of(self.model, part, replace(self.options, threads=threads))
        self.store.write(chunk, self.request, columns_of(results, self.request))


def results_of(model: SweptModel, part: CasePart, options: SweepOptions) -> xarray.Dataset:
    """Return the results of a part, without its leading cases."""
    found = model.run(part, options)
    results = found.to_xarray()
    if options.error_estimate:
        for name in (*model.model.layout.coordinates, *model.model.layout.rates):
            place = distinct(f"{name}_error", results.variables, "_value")
            results[place] = (results[value_name(name)].dims, found.error_estimate[name])
    return results.isel(case=slice(part.leaders, None))


def columns_of(results: xarray.Dataset, request: Request) -> Columns:
    """Return the arrays over the cases: results and varied values. Values of axes are stored once, elsewhere."""
    columns = {str(name): np.asarray(v) for name, v in results.variables.items() if v.dims[:1] == ("case",)}
    axes: Sequence[str] = () if request.cases is None else tuple(request.cases.axes)
    given = {axis: f"{axis}_given" if f"{axis}_given" in results.coords else axis for axis in axes}
    renamed = {
        axis: distinct(f"{axis}_value", columns, "_value")
        for axis, name in given.items()
        if name != axis and value_name(axis) == axis
    }
    left_out = set(given.values())
    return {renamed.get(name, name): values for name, values in columns.items() if name not in left_out}


# Outcomes of the chunks of a stored sweep.

Outcomes: TypeAlias = Generator[tuple[int, BaseException | None], None, None]
"""The number of each chunk that was tried, and what stopped it."""


class LostCluster(Exception):
    """The scheduler does not answer any more."""
