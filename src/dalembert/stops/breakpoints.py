"""The times at which conditions on time and parameters change: all of them, found before a run."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import BreakTimesError
from ..frozen import frozen
from ..ir.conditions import ZERO, Conditions
from ..ir.interpret import ARRAY_OPERATIONS, interpret
from ..ir.kernel import Kernel
from ..methods.step_constants import SMALLEST_OF_TIME
from .interval_roots import FIRST_PARTS, IntArray, ParameterRows, RootSearch

SHORT = 20.0
"""Smallest distance of a narrow pulse from its neighbours and the length of the run, in widths of the pulse."""
AROUND = np.array([-3.0, -1.0, 0.0, 1.0, 3.0])
"""Ends of steps about a narrow pulse, in its width (the standard deviation of a Gaussian)."""
FEW_PIECES = 512
"""Pieces a run that the search for what is narrow may need: it is given up where there are more."""


def break_times(conditions: Conditions, p: FloatArray, t0: float, t1: float) -> FloatArray:
    """Return the times (n,) strictly between t0 and t1 at which a condition changes, in the order of a run.

    Parameters
    ----------
    conditions : Conditions
        Of a program.
    p : ndarray (n_p,)
        Parameters.
    t0, t1 : float
        Start and end of the run [s], in either order.

    Raises
    ------
    BreakTimesError
        Where there are too many of them, as of ``sin(1/t)`` near zero.
    """
    _, times = break_times_of_cases(conditions, p[np.newaxis], np.array([t0]), np.array([t1]))
    return times


def break_times_of_cases(
    conditions: Conditions, p: FloatArray, t0: FloatArray, t1: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return the breaks of many runs.

    Parameters
    ----------
    conditions, p, t0, t1
        As for `break_times`, with p (k, n_p), t0 and t1 (k,); runs with what is not finite have none.

    Returns
    -------
    ndarray (k + 1,)
        Where in the times those of each run begin.
    ndarray (n,)
        The times.

    Raises
    ------
    BreakTimesError
    """
    count = len(p)
    low, high = np.minimum(t0, t1), np.maximum(t0, t1)
    known = p if conditions.place is None else np.delete(p, conditions.place, axis=1)
    fine = np.isfinite(low) & np.isfinite(high) & np.all(np.isfinite(known), axis=1)
    run, times = np.zeros(0, np.intp), np.zeros(0)
    rows = zip(conditions.functions, conditions.kinds, conditions.nested, conditions.sharpness, strict=True)
    for kernel, kind, nested, sharpness in rows:
        if nested:
            whose, a, b = _between(run, times, low, high, fine)
        else:
            whose = np.flatnonzero(fine & (low < high))
            a, b = low[whose], high[whose]
        own = p[whose]
        conditions.decide_at(own, a + 0.5 * (b - a))
        if sharpness is None:
            piece, found = RootSearch(kernel, kind, own).roots(a, b)
        else:
            piece, found = _narrow(kernel, sharpness, own, a, b)
        run, times = _merged(np.concatenate([run, whose[piece]]), np.concatenate([times, found]), low, high)
    starts = np.searchsorted(run, np.arange(count + 1))
    backward = t1 < t0
    if np.any(backward):
        for i in np.flatnonzero(backward).tolist():
            times[starts[i] : starts[i + 1]] = times[starts[i] : starts[i + 1]][::-1]
    return starts, times


def _narrow(
    kernel: Kernel, sharpness: Kernel, p: FloatArray, a: FloatArray, b: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return breaks around narrow pulses, for rows of parameters p (k, n_p) between a and b (k,).

    Short is what takes a small share of the time to the next of its kind, or of the run: a step may miss no other.
    """
    search = RootSearch(kernel, ZERO, p, FEW_PIECES * (len(a) + FIRST_PARTS))
    try:
        row, times = search.roots(a, b)
    except BreakTimesError:  # too many for any to be narrow
        return np.zeros(0, np.intp), np.zeros(0)
    order = np.lexsort((times, row))
    row, times = _apart(row[order], times[order])  # a root where an interval was cut is that of both parts
    with np.errstate(all="ignore"):
        (sharp,) = interpret(sharpness, {"t": times, "p": ParameterRows(p.T, row)}, ARRAY_OPERATIONS)
        size = 1.0 / np.sqrt(np.broadcast_to(np.asarray(sharp, dtype=float), times.shape))
    there = np.isfinite(size) & (size > 0.0)
    row, times, size = row[there], times[there], size[there]
    gap = (b - a)[row]
    same = row[1:] == row[:-1]
    apart = np.where(same, np.diff(times), np.inf)
    gap = np.minimum(gap, np.minimum(np.append(apart, np.inf), np.append(np.inf, apart)))
    short = SHORT * size < gap
    row, times, size = row[short], times[short], size[short]
    around = times[:, np.newaxis] + size[:, np.newaxis] * AROUND
    rows = np.repeat(row, len(AROUND))
    inside = (around.ravel() > a[rows]) & (around.ravel() < b[rows])
    return rows[inside], around.ravel()[inside]


@final
@frozen(eq=False)
class CaseBreaks:
    """The breaks of many runs: between t0 and t1 (k,), where those of each begin (k + 1,), and the times (n,)."""

    place: int | None
    t0: FloatArray
    t1: FloatArray
    starts: IntArray
    times: FloatArray

    @classmethod
    def of(cls, conditions: Conditions, p: FloatArray, t0: FloatArray, t1: FloatArray) -> CaseBreaks:
        """Return the breaks of runs, see `break_times_of_cases`."""
        return cls(conditions.place, t0, t1, *break_times_of_cases(conditions, p, t0, t1))

    def middles(self, cases: IntArray, t: FloatArray) -> FloatArray:
        """Return when conditions are decided (m,) for cases (m,) at times (m,): what follows a break counts there."""
        found = np.empty(len(t))
        for i, (case, time) in enumerate(zip(cases.tolist(), t.tolist(), strict=True)):
            own = self.times[self.starts[case] : self.starts[case + 1]]
            edges = np.concatenate([self.t0[case : case + 1], own, self.t1[case : case + 1]])
            sign = -1.0 if edges[-1] < edges[0] else 1.0
            k = int(np.searchsorted(sign * own, sign * time, side="right"))
            found[i] = edges[k] + 0.5 * (edges[k + 1] - edges[k])
        return found


def _between(
    run: IntArray, times: FloatArray, low: FloatArray, high: FloatArray, fine: NDArray[np.bool_]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the pieces into which breaks cut runs: of which run each is, and its ends."""
    runs = np.flatnonzero(fine & (low < high))
    whose = np.concatenate([runs, run])
    starts = np.concatenate([low[runs], times])
    order = np.lexsort((starts, whose))
    whose, starts = whose[order], starts[order]
    ends = np.append(starts[1:], 0.0)
    last = np.append(whose[1:] != whose[:-1], True)
    ends[last] = high[whose[last]]
    return whose, starts, ends


def _merged(run: IntArray, times: FloatArray, low: FloatArray, high: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return breaks in order, one for those that agree within rounding, and none at the ends of a run."""
    order = np.lexsort((times, run))
    run, times = run[order], times[order]
    close = SMALLEST_OF_TIME * np.abs(times)
    inside = (times - low[run] > close) & (high[run] - times > close)
    return _apart(run[inside], times[inside])


def _apart(run: IntArray, times: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return times in order without those that follow another of the same run within rounding."""
    apart = np.ones(len(times), bool)
    apart[1:] = (run[1:] != run[:-1]) | (np.diff(times) > SMALLEST_OF_TIME * np.abs(times[1:]))
    return run[apart], times[apart]
