"""Chunks of a stored sweep: their cases, their results as arrays over the cases, and how they come into the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from ...options import SweepOptions
from .request import Part, Request
from .store import Columns, Store
from .swept_models import SweptModel

if TYPE_CHECKING:
    import xarray

__all__ = ["ChunkJob", "columns_of", "results_of"]


@final
@dataclass(frozen=True, eq=False)
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

    def given(self, chunk: int) -> Part:
        """Return the arrays of a chunk."""
        return self.request.given(*self.cases(chunk), self.leaders)

    def run(self, chunk: int, given: Part, threads: int) -> None:
        """Compute a chunk from its arrays, and write it."""
        part = self.request.completed(given, *self.cases(chunk), self.leaders)
        results = results_of(self.model, part, replace(self.options, threads=threads))
        self.store.write(chunk, self.request, columns_of(results, self.request))


def results_of(model: SweptModel, part: Part, options: SweepOptions) -> xarray.Dataset:
    """Return the results of a part, without its leading cases."""
    found = model.run(part, options)
    results = found.to_xarray()
    if options.error_estimate:
        for name in (*model.model.layout.coordinates, *model.model.layout.rates):
            results[f"{name}_error"] = (results[name].dims, found.error_estimate[name])
    return results.isel(case=slice(part.leaders, None))


def columns_of(results: xarray.Dataset, request: Request) -> Columns:
    """Return the arrays over the cases: results and varied values. Values of axes are stored once, elsewhere."""
    columns = {str(name): np.asarray(v) for name, v in results.variables.items() if v.dims[:1] == ("case",)}
    for axis in () if request.cases is None else request.cases.axes:
        given = columns.pop(f"{axis}_given", None)
        values = columns.pop(axis)
        if given is not None:
            columns[f"{axis}_value"] = values
    return columns
