"""Chunks of a stored sweep: their results, and the decisions that all of them share."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...methods.status import Status
from ...options import SweepOptions
from ..cases import Cases, spans_of
from ..input_values import GivenInputs, read_inputs
from ..sweep import sweep
from .request import Part, Request
from .store import Columns

if TYPE_CHECKING:
    import xarray

    from ...results.sweep import Sweep
    from ..model import CompiledModel

__all__ = ["columns_of", "leading_cases", "method_of", "results_of"]

_SCANNED = 4096
"""Cases that are looked at together in the search for those that decide."""


def leading_cases(model: CompiledModel, request: Request, options: SweepOptions) -> list[int]:
    """Return the cases by which a sweep decides what all cases have in common.

    They are the first case, the first that can start, and, where a pivot of the constraints vanishes in the first case,
    the first in which none does.
    """
    lead = [0]
    few = replace(options, error_estimate=False, t_eval=None, max_steps=1, project_invariants=False)
    for first in range(0, request.count, _SCANNED):
        found = _swept(model, request.part(first, min(first + _SCANNED, request.count), []), few)
        able = np.flatnonzero(~np.isin(found.status, (Status.INITIAL_STATE, Status.ASSUMPTION)))
        if len(able):
            lead.append(first + int(able[0]))
            break
    if model.stages.reduced.pivots and _lost_pivots(model, request, 0, 1)[0]:
        for first in range(0, request.count, _SCANNED):
            kept = np.flatnonzero(~_lost_pivots(model, request, first, min(first + _SCANNED, request.count)))
            if len(kept):
                lead.append(first + int(kept[0]))
                break
    return list(dict.fromkeys(lead))


def method_of(model: CompiledModel, request: Request, options: SweepOptions) -> str:
    """Return the method that a sweep of all cases takes: "auto" looks at the first, the middle and the last."""
    if not options.automatic:
        return str(options.method)
    part = request.part(request.count - 1, request.count, [0, request.count // 2])
    return _swept(model, part, options).stats.method


def results_of(model: CompiledModel, part: Part, options: SweepOptions) -> xarray.Dataset:
    """Return the results of a part, without its leading cases."""
    found = _swept(model, part, options)
    results = found.to_xarray()
    if options.error_estimate:
        for name in (*model.layout.coordinates, *model.layout.rates):
            results[f"{name}_error"] = (results[name].dims, found.error_estimate[name])
    return results.isel(case=slice(part.leaders, None))


def columns_of(results: xarray.Dataset, request: Request) -> Columns:
    """Return the arrays over the cases: results, and what was varied. Values of axes are stored once, elsewhere."""
    columns = {str(name): np.asarray(v) for name, v in results.variables.items() if v.dims[:1] == ("case",)}
    for axis in () if request.cases is None else request.cases.axes:
        given = columns.pop(f"{axis}_given", None)
        values = columns.pop(axis)
        if given is not None:
            columns[f"{axis}_value"] = values
    return columns


def _swept(model: CompiledModel, part: Part, options: SweepOptions) -> Sweep:
    return sweep(model, part.t_span, part.initial, part.parameters, replace(options, inputs=_inputs(model, part)))


def _inputs(model: CompiledModel, part: Part) -> GivenInputs | None:
    return read_inputs(model.layout, model.stages.equations.symbols.inputs, part.inputs, many=True)


def _lost_pivots(model: CompiledModel, request: Request, first: int, last: int) -> NDArray[np.bool_]:
    """Return in which of some cases a pivot of the constraints vanishes."""
    part = request.part(first, last, [])
    given, parameters = _inputs(model, part), part.parameters
    if given is not None:
        parameters = dict(given.case_parameters(parameters, *spans_of(part.t_span)))
    cases = Cases(model.stages.program, model.derived.start, part.t_span, part.initial, parameters)
    return np.broadcast_to(cases.lost_pivots(slice(0, cases.count)), last - first)
