"""Results of the chunks of a stored sweep, as arrays over the cases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...options import SweepOptions
from .request import Part, Request
from .store import Columns
from .swept_models import SweptModel

if TYPE_CHECKING:
    import xarray

__all__ = ["columns_of", "results_of"]


def results_of(model: SweptModel, part: Part, options: SweepOptions) -> xarray.Dataset:
    """Return the results of a part, without its leading cases."""
    found = model.run(part, options)
    results = found.to_xarray()
    if options.error_estimate:
        for name in (*model.model.layout.coordinates, *model.model.layout.rates):
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
