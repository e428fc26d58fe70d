"""Statistics of runs and sweeps: cost, cases that failed, counts of events."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.status import Status


@final
@dataclass(frozen=True)
class RunStatistics:
    """Cost of a run: accepted and rejected steps, evaluations of the right-hand side, seconds.

    `note` says why "auto" took another method than it usually does, or where a run met a singular configuration; `rtol`
    and `atol` are the tolerances, NaN where they are not known.
    """

    method: str
    steps: int
    rejected: int
    evaluations: int
    compile_seconds: float
    run_seconds: float
    note: str = ""
    rtol: float = math.nan
    atol: float = math.nan


@final
@dataclass(frozen=True)
class SweepStatistics:
    """Cost of a sweep, and its tolerances, NaN where they are not known.

    `note` says why "auto" took another method than it usually does, where it did. `methods` are those of each mode of
    contacts by number, `NO_MODE` without contacts, and by `rtol`.
    """

    method: str
    threads: int
    steps: int
    compile_seconds: float
    run_seconds: float
    note: str = ""
    rtol: float = math.nan
    atol: float = math.nan
    methods: Mapping[tuple[int, float], str] = field(default_factory=dict, repr=False)


@final
@dataclass(frozen=True)
class CaseFailure:
    """A case that did not reach its end: its number, why, and the time it reached."""

    case: int
    status: Status
    message: str
    t: float


@final
@dataclass(frozen=True, eq=False)
class EventCounts:
    """Number of times an event occurred in each case (n_case,), and first and last time [s], NaN where it did not."""

    count: NDArray[np.int64]
    first: FloatArray
    last: FloatArray
