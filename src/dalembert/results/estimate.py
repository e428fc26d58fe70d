"""Estimates of global errors from a second run at a tighter tolerance."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, nesting_named

if TYPE_CHECKING:
    from .parts import Part
    from .trajectory import Trajectory


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


class Estimated(ABC):
    """Base class of results whose errors a twin at a tighter tolerance may estimate."""

    _twin: Self | None = None

    @abstractmethod
    def __getitem__(self, key: Any) -> NDArray[np.float64]: ...

    def with_twin(self, twin: Self) -> Self:
        """Return this result with the estimate of its errors that a twin at a tighter tolerance gives."""
        self._twin = twin
        return self

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
@dataclass(frozen=True, eq=False)
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
