"""Chunks of a stored sweep: their cases, their results as arrays over the cases, and how they come into the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from ...options import SweepOptions
from ...results.labels import distinct, value_name
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
