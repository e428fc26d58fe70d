"""Statistics of runs and sweeps, cases that failed, counts of events, and estimates of global errors."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, Protocol, Self, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, nesting_named
from ..frozen import frozen
from ..methods.status import Status
from ..methods.step_constants import EPSILON

if TYPE_CHECKING:
    from .parts import Part
    from .trajectory import Trajectory


@final
@frozen
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
@frozen
class SweepStatistics:
    """Cost of a sweep, and its tolerances, NaN where they are not known.

    `note` says why "auto" took another method than it usually does, where it did, and in how many cases which reactions
    are NaN at the end because the configuration does not determine them. `methods` are those of each mode of contacts
    by number, `NO_MODE` without contacts, and by `rtol`.
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
@frozen
class CaseFailure:
    """A case that did not reach its end: its number, why, and the time it reached."""

    case: int
    status: Status
    message: str
    t: float


@final
@frozen(eq=False)
class EventCounts:
    """Number of times an event occurred in each case (n_case,), and first and last time [s], NaN where it did not."""

    count: NDArray[np.int64]
    first: FloatArray
    last: FloatArray


class NamedArrays(Protocol):
    """Arrays by name."""

    def __getitem__(self, key: Any) -> NDArray[np.float64]: ...


@final
class ErrorEstimate:
    """``estimate["x"]`` is how far a run and its twin are apart, for everything that the run has by name.

    The twin's own error is some hundredth of it, until both come down to what rounding leaves.
    """

    def __init__(self, run: NamedArrays, twin: NamedArrays) -> None:
        self._run, self._twin = run, twin

    @nesting_named
    def __getitem__(self, key: Any) -> NDArray[np.float64]:
        return np.abs(self._run[key] - self._twin[key])


_SAME = (
    "the two runs of the error estimate take the same steps to the same states, so that it does not see what rounding"
    " grows to: compare with a run by another method, or with a smaller max_step"
)


_ROUNDING = 4.0 * EPSILON


class Estimated(ABC):
    """Base class of results whose errors a twin at a tighter tolerance may estimate."""

    stats: Any
    _twin: Self | None = None

    def with_note(self, note: str) -> Self:
        """Return these results with one more note in their statistics, where it is not empty."""
        if note:
            self.stats = replace(self.stats, note="; ".join(text for text in (self.stats.note, note) if text))
        return self

    @abstractmethod
    def __getitem__(self, key: Any) -> NDArray[np.float64]: ...

    def with_twin(self, twin: Self) -> Self:
        """Return this result with the estimate of its errors that a twin at a tighter tolerance gives.

        Where short steps between stops leave the tolerance nothing to choose, both are the same up to rounding.
        """
        self._twin = twin
        mine, theirs = self._ends(), twin._ends()
        same = self.stats.steps == twin.stats.steps > 1 and mine.shape == theirs.shape
        return self.with_note(_SAME if same and np.allclose(mine, theirs, _ROUNDING, 0.0, equal_nan=True) else "")

    @abstractmethod
    def _ends(self) -> FloatArray:
        """Return the final states (k, n)."""

    @property
    def error_estimate(self) -> ErrorEstimate:
        """Estimated global error by name, ``run.error_estimate["x"]``, shaped like ``run["x"]``.

        With contacts it is NaN where the two runs are not in the same phase after phases in the same modes, as between
        the times at which their contacts change.

        Raises
        ------
        OptionError
            For a run or a sweep without ``error_estimate=True``.
        """
        if self._twin is None:
            raise OptionError("there is no error estimate of this run; run it with error_estimate=True")
        return ErrorEstimate(self, self._compared(self._twin))

    def _compared(self, twin: Self) -> NamedArrays:
        """Return the values of a twin by name that are compared with those of this result."""
        return twin


@final
@frozen(eq=False)
class SamePhases:
    """The values of a twin by name at the times of a run, NaN where it is not in the same phase."""

    run: Trajectory
    twin: Trajectory

    def __getitem__(self, key: Any) -> FloatArray:
        mine, theirs = self.run._lasting, self.twin._lasting
        alike = 0
        while alike < min(len(mine), len(theirs)) and mine[alike].modes == theirs[alike].modes:
            alike += 1
        numbers = {id(part.phase): number for number, part in enumerate(mine[:alike])}

        def values(part: Part) -> FloatArray:
            t, found = part.t, np.full(len(part.t), np.nan)
            number = numbers.get(id(part.phase))
            if number is None:
                return found
            other = theirs[number]
            first, last = sorted(other.span)
            there = (first <= t) & (t <= last)
            found[there] = other(t[there]).named(str(key))
            return found

        joined: FloatArray = self.run._joined(values)
        return joined
