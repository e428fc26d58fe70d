"""All roots of functions of time in intervals, by interval arithmetic.

Intervals are cut in two until the function is monotone in them, or cannot be told from zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import BreakTimesError
from ..ir.conditions import WHOLE
from ..ir.interpret import ARRAY_OPERATIONS, interpret
from ..ir.intervals import INTERVAL_OPERATIONS, Interval, interval_of
from ..ir.kernel import Kernel
from ..methods.step_constants import EPSILON, ROOT_PRECISION, ROOT_TRIES, SMALLEST_NORMAL, SMALLEST_OF_TIME

IntArray = NDArray[np.intp]

FIRST_PARTS = 8
"""Parts that an interval is cut in at first."""
MOST_CUTS = 128
"""Largest number of times that a part is halved: enough to come down to rounding, except for times near zero."""
_MOST_ROOTS = 1_000_000
"""Largest number of roots of one function."""
_MOST_EACH = 2_000
"""Largest number of roots of each of many rows that are searched together."""
_NOTHING = 1e-290


@final
class RootSearch:
    """The search for the roots of one function of time.

    Parameters
    ----------
    kernel : Kernel
        The function, of t and p.
    kind : str
        `dalembert.ir.conditions.ZERO` for its zeros, or ``WHOLE`` for the times at which it is a whole number.
    p : ndarray (k, n_p)
        Rows of parameters.
    most : int, optional
        The most roots, and intervals at a time.
    """

    def __init__(self, kernel: Kernel, kind: str, p: FloatArray, most: int | None = None) -> None:
        self.kernel, self.kind = kernel, kind
        self.p = p.T
        self.most = max(_MOST_ROOTS, _MOST_EACH * len(p)) if most is None else most

    def roots(self, a: FloatArray, b: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return all roots between a and b (k,): of which row each is, and the times."""
        row, low, high = np.arange(len(a)), a, b
        rows: list[IntArray] = []
        found: list[FloatArray] = []
        stuck: list[tuple[IntArray, FloatArray, FloatArray]] = []
        parts, total, cuts = FIRST_PARTS, 0, 0
        while len(row):
            row, low, high = _cut(row, low, high, parts)
            straight, rest, done = self._kinds(row, low, high)
            done |= rest & (cuts == MOST_CUTS)
            parts, cuts = 2, cuts + 1
            some = self._on_monotone(row[straight], low[straight], high[straight])
            rows.append(some[0])
            found.append(some[1])
            total += len(some[0])
            if np.any(done):
                stuck.append((row[done], low[done], high[done]))
            rest &= ~done
            row, low, high = row[rest], low[rest], high[rest]
            if len(row) > self.most:
                zero = self._vanishes(row, low, high)
                stuck.append((row[zero], low[zero], high[zero]))
                row, low, high = row[~zero], low[~zero], high[~zero]
            if max(total, len(row), sum(len(part[0]) for part in stuck) / 4) > self.most:
                self._refuse(low, high)
        if stuck:
            some = self._across(*(np.concatenate(part) for part in zip(*stuck, strict=True)))
            rows.append(some[0])
            found.append(some[1])
        return np.concatenate([np.zeros(0, np.intp), *rows]), np.concatenate([np.zeros(0), *found])

    def _kinds(
        self, row: IntArray, low: FloatArray, high: FloatArray
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which intervals may hold roots: with a monotone function, with another, and those not to be cut."""
        return kinds_of(self.kind, low, high, *self._intervals(row, low, high))

    def _value(self, row: IntArray, t: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            (value,) = interpret(self.kernel, {"t": t, "p": ParameterRows(self.p, row)}, ARRAY_OPERATIONS)
        return np.broadcast_to(value, t.shape)

    def _intervals(self, row: IntArray, low: FloatArray, high: FloatArray) -> tuple[Interval, Interval]:
        """Return bounds over intervals, and bounds of a value in the middle of each."""
        middle, one, zero = low + 0.5 * (high - low), np.ones_like(low), np.zeros_like(low)
        ranges = Interval(low, high, one, one), Interval(middle, middle, zero, zero)
        arguments, found = {"p": ParameterRows(self.p, row)}, []
        with np.errstate(all="ignore"):
            for t in ranges:
                (value,) = interpret(self.kernel, arguments | {"t": t}, INTERVAL_OPERATIONS)
                found.append(spread_over(low, interval_of(value)))
        return found[0], found[1]

    def _vanishes(self, row: IntArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
        """Return in which intervals the function is zero up to rounding."""
        parts = [low + share * (high - low) for share in (0.0, 0.31, 0.77, 1.0)]
        found = np.ones(len(row), bool)
        for t in parts:
            bounds, noise = _bounds(t, t, *self._intervals(row, t, t))
            found &= _may_cross(self.kind, bounds.low - noise, bounds.high + noise)
        return found

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
                self._refuse(low, high)
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
            which, levels, ends = row[inside], level[inside], (low[inside], high[inside])
            least = EPSILON * np.maximum(np.abs(ends[0]), np.abs(ends[1]))

            def value(t: FloatArray) -> FloatArray:
                return self._value(which, t) - levels

            found[inside], _ = _zeros(value, *ends, first[inside], last[inside], least)
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

    def _refuse(self, low: FloatArray, high: FloatArray) -> None:
        where = f" between t = {float(np.min(low)):.6g} and {float(np.max(high)):.6g}" if len(low) else ""
        raise BreakTimesError(
            f"a condition on time changes too often{where}: more than {_MOST_ROOTS:,} times, or without end, as"
            " sign(sin(1/t)) does near zero. Runs end a step at each change: write the condition so that it changes"
            " fewer times, or leave those times out of the span"
        )


def spread_over(places: FloatArray, x: Interval) -> Interval:
    """Return an interval with a number at each place, where it has one for all."""
    return Interval(*(np.broadcast_to(v, places.shape) for v in (x.low, x.high, x.rate_low, x.rate_high)))


def kinds_of(kind: str, low: Any, high: Any, whole: Interval, centre: Interval) -> tuple[Any, Any, Any]:
    """Return which intervals may hold roots: with a monotone function, with another, and those not to be cut.

    Parameters
    ----------
    kind : str
        See `RootSearch`.
    low, high : ndarray (k,)
        The intervals.
    whole, centre : Interval
        Bounds of the function over them, and in the middle of each.
    """
    with np.errstate(all="ignore"):
        bounds, noise = _bounds(low, high, whole, centre)
        constant = np.maximum(np.abs(bounds.rate_low), np.abs(bounds.rate_high)) <= _NOTHING
        held = _may_cross(kind, bounds.low - noise, bounds.high + noise) & ~constant
        turns = (bounds.rate_low <= 0.0) & (bounds.rate_high >= 0.0)
        small = high - low <= 4.0 * EPSILON * np.maximum(np.abs(low), np.abs(high)) + SMALLEST_NORMAL
        flat = bounds.high - bounds.low <= 4.0 * noise
        return held & ~turns, held & turns, held & turns & (small | flat)


def kinds_of_numbers(kind: str, *numbers: Any) -> tuple[Any, Any, Any]:
    """Return `kinds_of` an interval: its ends, the bounds over it (4), and those of the value in its middle."""
    low, high, *whole, least, most = numbers
    rest: Any = 0.0
    return kinds_of(kind, low, high, Interval(*whole), Interval(least, most, rest, rest))


def _bounds(low: Any, high: Any, whole: Interval, centre: Interval) -> tuple[Interval, Any]:
    """Return bounds over intervals, and bounds of the rounding error of a value in them."""
    with np.errstate(all="ignore"):
        spread = 0.5 * (high - low) * np.maximum(np.abs(whole.rate_low), np.abs(whole.rate_high))
        spread = np.where(np.isnan(spread), np.inf, spread)
        lower, upper = np.fmax(whole.low, centre.low - spread), np.fmin(whole.high, centre.high + spread)
        noise = centre.high - centre.low
        return Interval(lower, upper, whole.rate_low, whole.rate_high), np.where(np.isfinite(noise), noise, 0.0)


def _may_cross(kind: str, low: Any, high: Any) -> Any:
    if kind == WHOLE:
        return np.floor(high) >= np.ceil(low)
    return (low <= 0.0) & (high >= 0.0)


@final
class ParameterRows:
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


def _zeros(
    value: Callable[[FloatArray], FloatArray],
    a: FloatArray,
    b: FloatArray,
    fa: FloatArray,
    fb: FloatArray,
    least: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return zeros of functions between a and b (k,), where their values differ in sign, and their values there.

    Source: T. R. Chandrupatla, Advances in Engineering Software 28 (1997) 145-149.
    """
    x1, f1, x2, f2, x3, f3 = b, fb, a, fa, a, fa
    t = np.full_like(a, 0.5)
    best, f_best, done = x1, f1, np.zeros(len(a), bool)
    for _ in range(ROOT_TRIES):
        x = x1 + t * (x2 - x1)
        f = value(x)
        same = (f > 0.0) == (f1 > 0.0)
        x3, f3 = np.where(same, x1, x2), np.where(same, f1, f2)
        x2, f2 = np.where(same, x2, x1), np.where(same, f2, f1)
        x1, f1 = x, f
        second = np.abs(f2) < np.abs(f1)
        best = np.where(done, best, np.where(second, x2, x1))  # what is found stays, whatever others need
        f_best = np.where(done, f_best, np.where(second, f2, f1))
        with np.errstate(all="ignore"):
            room = (ROOT_PRECISION * np.abs(best) + least) / np.abs(x2 - x1)
            done |= (room > 0.5) | (f_best == 0.0) | ~np.isfinite(room)
            if np.all(done):
                break
            xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
            inner = f1 / (f2 - f1) * f3 / (f2 - f3)
            outer = (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
            bend = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi) & np.isfinite(inner + outer)
            t = np.where(bend & ~done, np.clip(inner + outer, room, 1.0 - room), 0.5)
    return best, f_best
