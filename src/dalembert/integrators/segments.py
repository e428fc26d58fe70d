"""Constants of a run on each of its segments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from .input_records import InputRecords
from .problem import IntegrationProblem

__all__ = ["Constants", "KnotSegments", "Segments", "constants_at"]


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
    inputs : InputRecords or None
        Records of which the coefficients change within segments, too.
    acts : tuple of int
        What controllers do where each segment begins, 0 for nothing; empty without controllers.
    """

    edges: FloatArray
    constants: FloatArray
    inputs: InputRecords | None = None
    acts: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.constants)

    def cut(self, times: FloatArray, acts: NDArray[np.int64]) -> Segments:
        """Return the segments cut at further times (m,), with the actions (m,) of controllers there."""
        edges = np.union1d(self.edges, times)  # runs with controllers go forwards
        if len(self.edges) == 2 and self.edges[0] == self.edges[1]:
            edges = self.edges
        done = np.zeros(len(edges) - 1, np.int64)
        done[np.searchsorted(edges[:-1], times)] = acts
        constants = self.constants[self.number(edges[:-1])]
        return Segments(edges, constants, self.inputs, tuple(done.tolist()))

    def number(self, t: FloatArray) -> NDArray[np.intp]:
        """Return in which segments times (k,) are: that which begins at a break, the last at the end."""
        sign = -1.0 if self.edges[-1] < self.edges[0] else 1.0
        found = np.searchsorted(sign * self.edges[1:-1], sign * np.asarray(t, dtype=float), side="right")
        return np.asarray(found, dtype=np.intp)

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
        """The constants (n_c,) of the first segment."""
        return np.asarray(self.constants[0])

    def of(self, number: int, *, ending: bool = False) -> FloatArray:
        """Return the constants (n_c,) with which a segment begins, or those with which it ends."""
        if self.inputs is None:
            return np.asarray(self.constants[number])
        found = self.constants[number : number + 1].copy()
        forward = bool(self.edges[-1] >= self.edges[0])
        self.inputs.write(found, self.edges[number + ending, np.newaxis], after=forward != ending)
        return np.asarray(found[0])


@final
class KnotSegments:
    """Segments of a problem from knot to knot of its inputs, whose constants are made one by one."""

    def __init__(self, problem: IntegrationProblem) -> None:
        assert problem.inputs is not None
        self.inputs, self._constants = problem.inputs, problem.constants
        self.edges = np.concatenate([[problem.t0], self.inputs.knots(problem.t0, problem.t1), [problem.t1]])

    def __len__(self) -> int:
        return len(self.edges) - 1

    def of(self, number: int, *, ending: bool = False) -> FloatArray:
        """Return the constants (n_c,) of a segment."""
        found = self._constants[np.newaxis].copy()
        middle = self.edges[number] + 0.5 * (self.edges[number + 1] - self.edges[number])
        self.inputs.write(found, np.array([middle]))
        return np.asarray(found[0])


Constants = FloatArray | Segments
"""Constants (n_c,) of a whole run, or those of its segments."""


def constants_at(constants: Constants, t: FloatArray) -> FloatArray:
    """Return constants for kernels at times (k,): (n_c,), or (k, n_c) where they differ."""
    return constants.at(t) if isinstance(constants, Segments) else constants
