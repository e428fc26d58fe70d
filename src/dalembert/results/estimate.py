"""Estimates of global errors from a second run at a tighter tolerance."""

from __future__ import annotations

from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

from ..errors import nesting_named

__all__ = ["TIGHTER", "ErrorEstimate", "NamedArrays"]

TIGHTER = 1e-2
"""Factor between the tolerances of a run and of its twin, which is that much nearer to the exact motion."""


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
