"""Checks of the records of inputs of many cases, each with its own knots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..integrators.samples import Samples
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_OF_TIME
from ..scene.symbol_table import InputSymbol

__all__ = ["record_statuses"]


def record_statuses(symbols: Sequence[InputSymbol], records: Mapping[str, Samples], t: FloatArray) -> NDArray[np.int64]:
    """Return the statuses (k,) of cases whose records do not serve runs along times t (k, n_t), else SUCCESS.

    Records hold knots (k, n) and values (k, n). The statuses are those of traced runs.
    """
    status = np.full(len(t), int(Status.SUCCESS))
    low, high = np.minimum(t[:, 0], t[:, -1]), np.maximum(t[:, 0], t[:, -1])
    near = SMALLEST_OF_TIME * np.maximum(np.abs(low), np.abs(high))
    known = {symbol.name: symbol for symbol in symbols}
    for name, record in records.items():
        knots = record.t
        with np.errstate(invalid="ignore"):
            ordered = np.all(np.isfinite(knots), axis=1) & np.all(knots[:, 1:] > knots[:, :-1], axis=1)
            beyond = (low < knots[:, 0] - near) | (high > knots[:, -1] + near)
        if record.extrapolate != "error" and record.smoothness_everywhere >= known[name].smoothness:
            beyond[:] = False
        finite = np.all(np.isfinite(record.values), axis=1)
        for wrong, found in (
            (~finite, Status.NON_FINITE),
            (beyond, Status.OUTSIDE_TABLE),
            (~ordered, Status.TIMES_IN_NO_ORDER),
        ):
            status = np.where(wrong & (status != Status.TIMES_IN_NO_ORDER), int(found), status)
    return status
