"""Sign changes of functions along a motion: all of them, also where thousands lie within one step.

A step is cut in halves until on each piece a function provably keeps its sign or is monotone, as far as the
Chebyshev series through its values at eight points can tell: |T_k| <= 1 bounds the function by its coefficients, and
the last two of them stand for what the series leaves out. A sign change on a monotone piece is then one zero, located
with the function itself by Chandrupatla's method (Advances in Engineering Software 28, 1997).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.chebyshev import BETWEEN, CHECKS, COEFFICIENTS, CONVERGED, COUNT, MISSED, POINTS, SLOPE_TAIL, SLOPES
from ..methods.event_constants import DEEPEST, MOST, ROOT_PRECISION, ROOT_TRIES
from .zero_starts import ZeroStarts, least_sizes

__all__ = ["Changes", "Crossing", "Pieces", "changes", "located", "pieces"]

IntArray = NDArray[np.intp]
Sample = Callable[[IntArray, FloatArray], FloatArray]
"""From numbers of steps (k,) and fractions of them (k,) to the values of all functions (k, n)."""


_FIRST_BATCH, _PIECES_PER_STEP = 4, 64


@final
@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of steps in the order of time, with the values of all functions (k, n) at their ends."""

    step: IntArray
    low: FloatArray
    high: FloatArray
    first: FloatArray
    last: FloatArray
    finite: NDArray[np.bool_]


@final
@dataclass(frozen=True)
class Crossing:
    """A sign change: of which function, where, to which sign, and whether the old sign was seen beyond rounding."""

    function: int
    step: int
    theta: float
    sign: int
    seen: bool


def pieces(
    sample: Sample,
    count: int,
    noise: FloatArray,
    least: FloatArray,
    starts: ZeroStarts | None,
    *,
    oscillating: bool = False,
) -> Pieces:
    """Cut steps into pieces on which every function is monotone or keeps its sign.

    Parameters
    ----------
    sample
        The functions.
    count
        Number of steps.
    noise
        Size below which a function counts as zero (n,).
    least
        Length below which a piece is not cut, as a fraction of each step (count,).
    starts
        Functions that are zero where the first step begins, if there are any; they need not be monotone there.
    oscillating
        Whether the functions may oscillate between eight points: then pieces are simple by the values between, too.
    """
    step, low, high = np.arange(count), np.zeros(count), np.ones(count)
    done: list[tuple[NDArray[Any], ...]] = []
    budget = _PIECES_PER_STEP * count + MOST
    for depth in range(DEEPEST + 1):
        theta = low[:, np.newaxis] + (high - low)[:, np.newaxis] * POINTS
        values = sample(np.repeat(step, COUNT), theta.ravel()).reshape(len(step), COUNT, -1)
        good, finite = _good(values, noise), np.asarray(np.isfinite(values).all(axis=(1, 2)))
        if starts is not None:
            for i in np.flatnonzero((step == 0) & (low == 0.0)):
                good[i] &= starts.agree(values[i], high[i])
        simple = np.asarray(np.all(good, axis=1))
        if starts is not None:
            for i in np.flatnonzero((step == 0) & (low == 0.0) & ~simple):
                simple[i] = starts.simple(values[i], high[i] * POINTS, noise, good[i])
        if oscillating:
            # pieces whose series converge need no further look
            begins = (step == 0) & (low == 0.0) & (starts is not None)
            some = np.flatnonzero(simple & finite & (begins | ~_converge(values)))
            if len(some):
                theta = low[some, np.newaxis] + (high - low)[some, np.newaxis] * CHECKS
                between = sample(np.repeat(step[some], COUNT), theta.ravel()).reshape(len(some), COUNT, -1)
                resolved = _resolved(values[some], between, noise)
                if starts is not None:
                    for i in np.flatnonzero((step[some] == 0) & (low[some] == 0.0)):
                        starts.keep_sides(resolved[i], values[some[i], -1], between[i], high[some[i]] * CHECKS, noise)
                simple[some] = np.all(resolved, axis=1)
        budget -= len(step)
        if depth == DEEPEST or budget < 0:
            simple[:] = True
        simple |= high - low <= least[step]
        done.append((step[simple], low[simple], high[simple], values[simple, 0], values[simple, -1], finite[simple]))
        step, low, high = step[~simple], low[~simple], high[~simple]
        if not len(step):
            break
        middle = 0.5 * (low + high)
        step = np.concatenate([step, step])
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    parts = [np.concatenate(column) for column in zip(*done, strict=True)]
    order = np.lexsort((parts[1], parts[0]))
    found = Pieces(*(part[order] for part in parts))
    if starts is not None:
        own = slice(0, np.count_nonzero(found.step == 0))
        starts.drop_unresolved(found.low[own], found.high[own], found.first[own], found.last[own])
    return found


def _good(values: FloatArray, noise: FloatArray, missed: FloatArray | float = 0.0) -> NDArray[np.bool_]:
    """Return which functions a piece need not be cut for (k, n); `missed` (k, n) is what their polynomials miss."""
    with np.errstate(all="ignore"):
        series = np.abs(np.einsum("kj,ijn->ikn", COEFFICIENTS, values))
        slopes = np.abs(np.einsum("kj,ijn->ikn", SLOPES, values))
        tail = series[:, -2:].sum(axis=1)
        one_sign = least_sizes(series) > MISSED * missed
        monotone = slopes[:, 0] > slopes[:, 1:].sum(axis=1) + SLOPE_TAIL * (tail + missed)
        nothing = np.abs(values).max(axis=1) <= noise
    lost = ~np.isfinite(values).any(axis=1)
    return np.asarray(one_sign | monotone | nothing | lost)


def _converge(values: FloatArray) -> NDArray[np.bool_]:
    """Return on which pieces (k,) the series of all functions show no oscillation between the points."""
    series = np.abs(np.einsum("kj,ijn->ikn", COEFFICIENTS[1:], values))
    return np.asarray(np.all(series[:, -2:].sum(axis=1) <= CONVERGED * series.sum(axis=1), axis=1))


def _resolved(values: FloatArray, between: FloatArray, noise: FloatArray) -> NDArray[np.bool_]:
    """Return which functions (k, n) are simple on pieces by their values between the points, too."""
    with np.errstate(all="ignore"):
        missed = np.abs(between - np.einsum("kj,ijn->ikn", BETWEEN, values)).max(axis=1)
        largest = np.maximum(np.abs(values).max(axis=1), np.abs(between).max(axis=1))
    nothing = ~np.isfinite(missed) | (largest <= noise)
    return np.asarray(_good(values, noise, np.where(nothing, 0.0, missed)) | nothing)


@final
@dataclass(frozen=True, eq=False)
class Changes:
    """Sign changes before they are located, in the order of the pieces (k,) where they are.

    `signs` are what the functions change to, `seen` whether the old sign was seen beyond rounding, and `inside` whether
    the change is within the piece and not at its beginning.
    """

    piece: IntArray
    function: IntArray
    sign: IntArray
    seen: NDArray[np.bool_]
    inside: NDArray[np.bool_]


def changes(
    cut: Pieces, signs: NDArray[np.int8], noise: FloatArray
) -> tuple[Changes, NDArray[np.int8], NDArray[np.bool_]]:
    """Return all sign changes.

    Parameters
    ----------
    cut
        What `pieces` gave, or the beginning of it.
    signs
        Sign of each function (n,) before; 0 where it is zero.
    noise
        As for `pieces`.

    Returns
    -------
    Changes
    ndarray (n,)
        The signs at the end.
    ndarray (n,)
        Whether each function was anywhere beyond its noise.
    """
    ends, starts = (
        np.where(np.abs(values) > noise, np.sign(values), 0.0).astype(np.int8) for values in (cut.last, cut.first)
    )
    after = signs.copy()
    rows: list[tuple[NDArray[Any], ...]] = []
    for function in range(ends.shape[1]):
        # both ends of every piece, in order; a piece may start with another sign than the one before ended with
        row = np.stack([starts[:, function], ends[:, function]], axis=1).ravel()
        places = np.flatnonzero(row)
        sequence = np.concatenate([[signs[function]], row[places]])
        k = np.flatnonzero(sequence[1:] * sequence[:-1] < 0)
        piece, new = places[k] // 2, row[places[k]].astype(np.intp)
        inside = (places[k] % 2 == 1) & (cut.first[piece, function] * new < 0.0)
        rows.append((piece, np.full_like(piece, function), new, k > 0, inside))
        if len(places):
            after[function] = row[places[-1]]
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    order = np.argsort(columns[0], kind="stable")
    found = Changes(*(column[order] for column in columns))
    return found, after, np.any((starts != 0) | (ends != 0), axis=0)


def located(sample: Sample, cut: Pieces, found: Changes, least: FloatArray) -> Iterator[Crossing]:
    """Yield sign changes in the order of time, each located where it is needed; a few at first, then ever more.

    Parameters
    ----------
    sample, least
        As for `pieces`.
    cut, found
        What `pieces` and `changes` gave.
    """
    first, size = 0, _FIRST_BATCH
    while first < len(found.piece):
        last = min(first + size, len(found.piece))
        while last < len(found.piece) and found.piece[last] == found.piece[last - 1]:
            last += 1
        piece, function, sign, seen, inside = (getattr(found, name)[first:last] for name in found.__dataclass_fields__)
        step, theta = cut.step[piece], cut.low[piece].copy()
        if np.any(inside):
            chosen = piece[inside], function[inside]

            def value(theta: FloatArray, step: IntArray = step[inside], function: IntArray = chosen[1]) -> FloatArray:
                return sample(step, theta)[np.arange(len(step)), function]

            ends = cut.low[chosen[0]], cut.high[chosen[0]], cut.first[chosen], cut.last[chosen]
            theta[inside], rest = zeros(value, *ends, 0.25 * least[step[inside]])
            pole = np.abs(rest) > np.maximum(np.abs(ends[2]), np.abs(ends[3]))
            theta[np.flatnonzero(inside)[pole]] = np.nan
        for i in np.lexsort((function, theta, step)):
            if np.isfinite(theta[i]):
                yield Crossing(int(function[i]), int(step[i]), float(theta[i]), int(sign[i]), bool(seen[i]))
        first, size = last, 4 * size


def zeros(
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
    best, f_best = x1, f1
    for _ in range(ROOT_TRIES):
        x = x1 + t * (x2 - x1)
        f = value(x)
        same = (f > 0.0) == (f1 > 0.0)
        x3, f3 = np.where(same, x1, x2), np.where(same, f1, f2)
        x2, f2 = np.where(same, x2, x1), np.where(same, f2, f1)
        x1, f1 = x, f
        second = np.abs(f2) < np.abs(f1)
        best, f_best = np.where(second, x2, x1), np.where(second, f2, f1)
        with np.errstate(all="ignore"):
            room = (ROOT_PRECISION * np.abs(best) + least) / np.abs(x2 - x1)
            done = (room > 0.5) | (f_best == 0.0) | ~np.isfinite(room)
            if np.all(done):
                break
            xi, phi = (x1 - x2) / (x3 - x2), (f1 - f2) / (f3 - f2)
            inner = f1 / (f2 - f1) * f3 / (f2 - f3)
            outer = (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
            bend = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi) & np.isfinite(inner + outer)
            t = np.where(bend, np.clip(inner + outer, room, 1.0 - room), 0.5)
            t = np.where(done, np.where(second, 1.0, 0.0), t)  # what is found is only evaluated again
    return best, f_best
