"""The times at which conditions on time and parameters change: all of them, found before a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import BreakTimesError
from ..ir.conditions import WHOLE, ZERO, Conditions
from ..ir.interpret import ARRAY_OPERATIONS, interpret
from ..ir.intervals import INTERVAL_OPERATIONS, Interval
from ..ir.kernel import Kernel
from ..methods.step_constants import EPSILON, SMALLEST_NORMAL, SMALLEST_OF_TIME
from .crossings import zeros

__all__ = ["MOST_BREAKS", "CaseBreaks", "break_times", "break_times_of_cases"]

MOST_BREAKS = 1_000_000
"""Largest number of breaks of a run."""

_MOST_EACH = 2_000
"""Largest number of breaks of each of many runs that are prepared together."""
_PARTS, _NOTHING = 8, 1e-290
_SHORT = 20.0
"""Smallest distance of a narrow pulse from its neighbours and the length of the run, in widths of the pulse."""
_AROUND = np.array([-3.0, -1.0, 0.0, 1.0, 3.0])
"""Ends of steps about a narrow pulse, in its width (the standard deviation of a Gaussian)."""
_FEW_PIECES = 512
"""Pieces a run that the search for what is narrow may need: it is given up where there are more."""
IntArray = NDArray[np.intp]


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
    fine = np.isfinite(low) & np.isfinite(high) & np.all(np.isfinite(_without(p, conditions.place)), axis=1)
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
            piece, found = _Search(kernel, kind, own).roots(a, b)
        else:
            piece, found = _narrow(kernel, sharpness, own, a, b)
        run, times = _merged(np.concatenate([run, whose[piece]]), np.concatenate([times, found]), low, high)
    starts = np.searchsorted(run, np.arange(count + 1))
    backward = t1 < t0
    if np.any(backward):
        for i in np.flatnonzero(backward):
            times[starts[i] : starts[i + 1]] = times[starts[i] : starts[i + 1]][::-1]
    return starts, times


def _without(p: FloatArray, place: int | None) -> FloatArray:
    return p if place is None else np.delete(p, place, axis=1)


def _narrow(
    kernel: Kernel, sharpness: Kernel, p: FloatArray, a: FloatArray, b: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return breaks around narrow pulses, for rows of parameters p (k, n_p) between a and b (k,).

    Short is what takes a small share of the time to the next of its kind, or of the run: a step may miss no other.
    """
    search = _Search(kernel, ZERO, p, _FEW_PIECES * (len(a) + _PARTS))
    try:
        row, times = search.roots(a, b)
    except BreakTimesError:  # too many for any to be narrow
        return np.zeros(0, np.intp), np.zeros(0)
    order = np.lexsort((times, row))
    row, times = row[order], times[order]
    with np.errstate(all="ignore"):
        (sharp,) = interpret(sharpness, {"t": times, "p": _Rows(p.T, row)}, ARRAY_OPERATIONS)
        size = 1.0 / np.sqrt(np.broadcast_to(np.asarray(sharp, dtype=float), times.shape))
    there = np.isfinite(size) & (size > 0.0)
    row, times, size = row[there], times[there], size[there]
    gap = (b - a)[row]
    same = row[1:] == row[:-1]
    apart = np.where(same, np.diff(times), np.inf)
    gap = np.minimum(gap, np.minimum(np.append(apart, np.inf), np.append(np.inf, apart)))
    short = _SHORT * size < gap
    row, times, size = row[short], times[short], size[short]
    around = times[:, np.newaxis] + size[:, np.newaxis] * _AROUND
    rows = np.repeat(row, len(_AROUND))
    inside = (around.ravel() > a[rows]) & (around.ravel() < b[rows])
    return rows[inside], around.ravel()[inside]


@final
@dataclass(frozen=True, eq=False)
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
    run, times, close = run[inside], times[inside], close[inside]
    apart = np.ones(len(times), bool)
    apart[1:] = (run[1:] != run[:-1]) | (np.diff(times) > close[1:])
    return run[apart], times[apart]


@final
class _Search:
    """The search for the roots of one function, of rows of parameters p (k, n_p) that are used in turn."""

    def __init__(self, kernel: Kernel, kind: str, p: FloatArray, most: int | None = None) -> None:
        self.kernel, self.kind = kernel, kind
        self.p = p.T
        self.most = max(MOST_BREAKS, _MOST_EACH * len(p)) if most is None else most

    def roots(self, a: FloatArray, b: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return all roots between a and b (k,): of which row each is, and the times."""
        row, low, high = np.arange(len(a)), a, b
        rows: list[IntArray] = []
        found: list[FloatArray] = []
        stuck: list[tuple[IntArray, FloatArray, FloatArray]] = []
        parts, total = _PARTS, 0
        while len(row):
            row, low, high = _cut(row, low, high, parts)
            parts = 2
            bounds, noise = self._bounds(row, low, high)
            open_ = self._may_cross(bounds.low - noise, bounds.high + noise)
            still = np.maximum(np.abs(bounds.rate_low), np.abs(bounds.rate_high)) <= _NOTHING
            open_ &= ~still
            turns = (bounds.rate_low <= 0.0) & (bounds.rate_high >= 0.0)
            straight = open_ & ~turns
            some = self._on_monotone(row[straight], low[straight], high[straight])
            rows.append(some[0])
            found.append(some[1])
            total += len(some[0])
            rest = open_ & turns
            small = high - low <= 4.0 * EPSILON * np.maximum(np.abs(low), np.abs(high)) + SMALLEST_NORMAL
            flat = bounds.high - bounds.low <= 4.0 * noise
            done = rest & (small | flat)
            if np.any(done):
                stuck.append((row[done], low[done], high[done]))
            rest &= ~done
            row, low, high = row[rest], low[rest], high[rest]
            if len(row) > self.most:
                zero = self._vanishes(row, low, high)
                stuck.append((row[zero], low[zero], high[zero]))
                row, low, high = row[~zero], low[~zero], high[~zero]
            if max(total, len(row), sum(len(part[0]) for part in stuck) / 4) > self.most:
                self._refuse(row, low, high)
        if stuck:
            some = self._across(*(np.concatenate(part) for part in zip(*stuck, strict=True)))
            rows.append(some[0])
            found.append(some[1])
        return np.concatenate([np.zeros(0, np.intp), *rows]), np.concatenate([np.zeros(0), *found])

    def _value(self, row: IntArray, t: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            (value,) = interpret(self.kernel, {"t": t, "p": _Rows(self.p, row)}, ARRAY_OPERATIONS)
        return np.broadcast_to(value, t.shape)

    def _bounds(self, row: IntArray, low: FloatArray, high: FloatArray) -> tuple[Interval, FloatArray]:
        """Return bounds over intervals, and bounds of the rounding error of a value in them."""
        middle = low + 0.5 * (high - low)
        with np.errstate(all="ignore"):
            arguments = {"p": _Rows(self.p, row)}
            one, zero = np.ones_like(low), np.zeros_like(low)
            (whole,) = interpret(self.kernel, arguments | {"t": Interval(low, high, one, one)}, INTERVAL_OPERATIONS)
            point = Interval(middle, middle, zero, zero)
            (centre,) = interpret(self.kernel, arguments | {"t": point}, INTERVAL_OPERATIONS)
            half = 0.5 * (high - low)
            spread = half * np.maximum(np.abs(whole.rate_low), np.abs(whole.rate_high))
            spread = np.where(np.isnan(spread), np.inf, spread)
            lower, upper = np.fmax(whole.low, centre.low - spread), np.fmin(whole.high, centre.high + spread)
        noise = np.nan_to_num(centre.high - centre.low, nan=0.0, posinf=0.0)
        shape = low.shape
        bounds = (np.broadcast_to(v, shape) for v in (lower, upper, whole.rate_low, whole.rate_high))
        return Interval(*bounds), np.broadcast_to(noise, shape)

    def _vanishes(self, row: IntArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
        """Return in which intervals the function is zero up to rounding."""
        parts = [low + share * (high - low) for share in (0.0, 0.31, 0.77, 1.0)]
        found = np.ones(len(row), bool)
        for t in parts:
            bounds, noise = self._bounds(row, t, t)
            found &= self._may_cross(bounds.low - noise, bounds.high + noise)
        return found

    def _may_cross(self, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
        if self.kind == WHOLE:
            return np.asarray(np.floor(high) >= np.ceil(low))
        return np.asarray((low <= 0.0) & (high >= 0.0))

    def _on_monotone(self, row: IntArray, low: FloatArray, high: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the roots in intervals in which the function rises or falls."""
        if not len(row):
            return row, low
        first, last = self._value(row, low), self._value(row, high)
        level = np.zeros_like(low)
        if self.kind == WHOLE:
            bottom, top = np.ceil(np.minimum(first, last)), np.floor(np.maximum(first, last))
            counts = np.nan_to_num(np.maximum(top - bottom + 1.0, 0.0), nan=0.0)
            if float(np.sum(counts)) > self.most:
                self._refuse(row, low, high)
            repeats = counts.astype(np.intp)
            source = np.repeat(np.arange(len(row)), repeats)
            level = bottom[source] + (np.arange(len(source)) - np.repeat(np.cumsum(repeats) - repeats, repeats))
            row, low, high, first, last = row[source], low[source], high[source], first[source], last[source]
        first, last = first - level, last - level
        crosses = np.sign(first) * np.sign(last) <= 0.0
        row, low, high = row[crosses], low[crosses], high[crosses]
        level, first, last = level[crosses], first[crosses], last[crosses]
        found = np.where(first == 0.0, low, high)
        inside = (first != 0.0) & (last != 0.0)
        if np.any(inside):
            which, wanted, ends = row[inside], level[inside], (low[inside], high[inside])
            least = EPSILON * np.maximum(np.abs(ends[0]), np.abs(ends[1]))

            def value(t: FloatArray) -> FloatArray:
                return self._value(which, t) - wanted

            found[inside], _ = zeros(value, *ends, first[inside], last[inside], least)
        return row, found

    def _across(self, row: IntArray, low: FloatArray, high: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return a break in each cluster of intervals that may hold a root, where the sides differ."""
        order = np.lexsort((low, row))
        row, low, high = row[order], low[order], high[order]
        begins = np.ones(len(row), bool)
        begins[1:] = (row[1:] != row[:-1]) | (low[1:] > high[:-1])
        firsts = np.flatnonzero(begins)
        lasts = np.append(firsts[1:], len(row)) - 1
        row, low, high = row[firsts], low[firsts], high[lasts]
        width = (high - low) + SMALLEST_OF_TIME * np.maximum(np.abs(low), np.abs(high))
        before, after = self._value(row, low - width), self._value(row, high + width)
        if self.kind == WHOLE:
            before, after = np.floor(before), np.floor(after)
        differ = np.sign(before) != np.sign(after) if self.kind != WHOLE else before != after
        middle = low + 0.5 * (high - low)
        return row[differ], middle[differ]

    def _refuse(self, row: IntArray, low: FloatArray, high: FloatArray) -> None:
        where = f" between t = {float(np.min(low)):.6g} and {float(np.max(high)):.6g}" if len(low) else ""
        raise BreakTimesError(
            f"a condition on time changes too often{where}: more than {MOST_BREAKS:,} times, or without end, as"
            " sign(sin(1/t)) does near zero. Runs end a step at each change: write the condition so that it changes"
            " fewer times, or leave those times out of the span"
        )


@final
class _Rows:
    """Parameters as a kernel loads them, for rows that use them in turn."""

    def __init__(self, p: FloatArray, row: IntArray) -> None:
        self._p, self._row = p, row

    def __getitem__(self, index: int) -> FloatArray:
        return self._p[index, self._row]


def _cut(row: IntArray, low: FloatArray, high: FloatArray, parts: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return intervals cut in equal parts."""
    shares = np.arange(parts + 1) / parts
    edges = low[:, np.newaxis] + (high - low)[:, np.newaxis] * shares
    edges[:, -1] = high
    return np.repeat(row, parts), edges[:, :-1].ravel(), edges[:, 1:].ravel()
