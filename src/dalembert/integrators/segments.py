"""Constants of a run that change on the way: what they are on each of its segments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray

__all__ = ["Constants", "Segments", "constants_at"]


@final
@dataclass(frozen=True, eq=False)
class Segments:
    """The segments of one run.

    Attributes
    ----------
    edges : ndarray (m + 1,)
        The start, the breaks and the end.
    constants : ndarray (m, n_c)
        Those of each segment.
    """

    edges: FloatArray
    constants: FloatArray

    def __len__(self) -> int:
        return len(self.constants)

    def number(self, t: FloatArray) -> NDArray[np.intp]:
        """Return in which segments times (k,) are: that which begins at a break, the last at the end."""
        sign = -1.0 if self.edges[-1] < self.edges[0] else 1.0
        found = np.searchsorted(sign * self.edges[1:-1], sign * np.asarray(t, dtype=float), side="right")
        return np.asarray(found, dtype=np.intp)

    def at(self, t: FloatArray) -> FloatArray:
        """Return the constants (k, n_c) at times (k,)."""
        return self.constants[self.number(t)]

    @property
    def first(self) -> FloatArray:
        """The constants (n_c,) of the first segment."""
        return np.asarray(self.constants[0])


Constants = FloatArray | Segments
"""Constants (n_c,) of a whole run, or those of its segments."""


def constants_at(constants: Constants, t: FloatArray) -> FloatArray:
    """Return constants for kernels at times (k,): (n_c,), or (k, n_c) where they differ."""
    return constants.at(t) if isinstance(constants, Segments) else constants
