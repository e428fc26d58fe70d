"""Rows of a motion: at other times than the recorded ones, of the phase that each time is in, and by number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError
from ..events.event_rules import last_instants
from ..methods.step_constants import RESOLUTION
from .parts import Part


def rows_of_phases(
    lasting: Sequence[Part], last_part: Part, times: FloatArray, origin: float, start: float
) -> tuple[list[Part], NDArray[np.intp]]:
    """Return the rows of a motion with phases at times, a part for each phase, and their order.

    Where a phase ends, or within rounding before, it is the next one that gives the row.

    Parameters
    ----------
    lasting : sequence of Part
        Phases that take time.
    last_part : Part
        The last phase, which may be the state after an impact at the end.
    times : ndarray (k,)
        Times since `origin` [s], in any order.
    origin : float
        Time that rounding is relative to [s].
    start : float
        Time of the start of the run, as its times are counted in messages [s].

    Raises
    ------
    OptionError
        For times outside the span.
    """
    lasting = [*lasting]
    if last_part is not lasting[-1]:
        lasting.append(last_part)
    first, last = lasting[0].span[0], lasting[-1].span[1]
    forward = 1.0 if last >= first else -1.0
    if np.any((times - last) * forward > 0.0) or np.any((times - first) * forward < 0.0):
        raise OptionError(f"times must lie within the span of the run, {start + first:.12g} to {start + last:.12g} s")
    begins = np.array([part.span[0] for part in lasting]) * forward
    place = np.clip(np.searchsorted(begins, times * forward, side="right") - 1, 0, len(begins) - 1)
    until = last_instants(times, origin)
    following = np.minimum(place + 1, len(begins) - 1)
    begun = begins[following] - until * forward <= RESOLUTION * np.abs(begins[following])  # as `recorded_after`
    place = np.where(begun, following, place)
    inside = forward * np.maximum(times * forward, begins[place])  # of the phase that has begun by then
    rows = [np.flatnonzero(place == number) for number in range(len(lasting))]
    parts = [part(inside[some]) for part, some in zip(lasting, rows, strict=True) if len(some)]
    return parts or [lasting[0].rows(np.arange(0))], np.argsort(np.concatenate(rows), kind="stable")


def rows_by_number(
    parts: Sequence[Part], order: NDArray[np.intp] | None, some: NDArray[np.intp]
) -> tuple[list[Part], NDArray[np.intp]]:
    """Return some rows (k,) of a motion, whose rows are those of its parts in an `order`, as parts and their order."""
    ends = np.cumsum([0, *(len(part.t) for part in parts)])
    rows = (np.arange(ends[-1]) if order is None else order)[some]
    found, places = [], []
    for part, first, last in zip(parts, ends, ends[1:], strict=False):
        mine = np.flatnonzero((first <= rows) & (rows < last))
        places.append(mine)
        found.append(part.rows(rows[mine] - first))
    return found, np.argsort(np.concatenate(places), kind="stable")


def own_times(
    lasting: Sequence[Part], times: FloatArray, own: FloatArray, recorded: FloatArray, elapsed: FloatArray
) -> FloatArray:
    """Return times since the start of a run.

    Those of recorded times are the ones that the run had; rounding takes none out of the span.

    Parameters
    ----------
    lasting : sequence of Part
        Phases that take time.
    times, own : ndarray (k,)
        The times, and their differences from the start [s].
    recorded, elapsed : ndarray (n_t,)
        Recorded times, and those since the start of the run [s].
    """
    if len(recorded):
        sign = 1.0 if recorded[-1] >= recorded[0] else -1.0
        near = np.minimum(np.searchsorted(sign * recorded, sign * times), len(recorded) - 1)
        own = np.where(recorded[near] == times, elapsed[near], own)
    first, last = sorted((lasting[0].span[0], lasting[-1].span[1]))
    inside = np.clip(own, first, last)
    return np.where(np.abs(own - inside) <= 4.0 * np.spacing(np.abs(times)), inside, own)
