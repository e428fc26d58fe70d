"""Constants of a run on each of its segments."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from .input_records import InputRecords


@final
@frozen(eq=False)
class Segments:
    """The segments of one run.

    Attributes
    ----------
    edges : ndarray (m + 1,)
        The start, the breaks and the end.
    constants : ndarray (m, n_c)
        Those of each segment.
    inputs : InputRecords or None
        Records of which the coefficients change within segments, too.
    """

    edges: FloatArray
    constants: FloatArray
    inputs: InputRecords | None = None

    def number(self, t: FloatArray) -> NDArray[np.intp]:
        """Return in which segments times (k,) are: that which begins at a break, the last at the end."""
        edges, times = self.edges[1:-1], np.asarray(t, dtype=float)
        if self.edges[-1] < self.edges[0]:
            edges, times = -edges, -times
        return np.asarray(np.searchsorted(edges, times, side="right"), dtype=np.intp)

    def at(self, t: FloatArray) -> FloatArray:
        """Return the constants (k, n_c) at times (k,); at a knot those of what follows, at the end those of before."""
        times = np.asarray(t, dtype=float)
        found = self.constants[self.number(times)]
        if self.inputs is not None:
            last, forward = self.edges[-1], self.edges[-1] >= self.edges[0]
            self.inputs.write(found, times, after=(times < last) if forward else (times == last))
        return found

    @property
    def first(self) -> FloatArray:
        """The constants (n_c,) with which the run begins."""
        found = self.constants[:1].copy()
        if self.inputs is not None:
            self.inputs.write(found, self.edges[:1], after=bool(self.edges[-1] >= self.edges[0]))
        return np.asarray(found[0])


Constants = FloatArray | Segments
"""Constants (n_c,) of a whole run, or those of its segments."""


def constants_at(constants: Constants, t: FloatArray) -> FloatArray:
    """Return constants for kernels at times (k,): (n_c,), or (k, n_c) where they differ."""
    return constants.at(t) if isinstance(constants, Segments) else constants
