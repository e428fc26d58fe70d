"""Cases on their way into lanes: made ahead, as many together as there are lanes, and entered one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.status import Status
from .compiled_subset import ahead, bare, call_code, call_test, element, row
from .workspace import ATTEMPTS, CASE, END, FIRST, NEXT, NOW, REFUSED, RUNNING, SAMPLED, STAGED, STATUS, Room

__all__ = ["enter", "stage"]

_SUCCESS, _NON_FINITE, _INITIAL_STATE = int(Status.SUCCESS), int(Status.NON_FINITE), int(Status.INITIAL_STATE)


@bare
def _fill(columns: NDArray[np.int64], column: int, rows: FloatArray, wanted: int, first: int, count: int) -> None:
    """Write what `wanted` columns of values, each with its address and stride, give cases to the first rows."""
    for m in range(wanted):
        address, stride = columns[column + m, 0], columns[column + m, 1]
        for lane in range(rows.shape[1]):
            rows[m, lane] = element(address, stride * (first + min(lane, count - 1)))
        ahead(address, stride * (first + 2 * rows.shape[1]))


@bare
def stage(
    codes: tuple[int, int, int, int, int, int, int, int],
    shape: tuple[int, int, int, int, int, int, int],
    limits: FloatArray,
    columns: NDArray[np.int64],
    first: int,
    count: int,
    room: Room,
) -> None:
    """Make constants, states and memory of `count` cases from number `first` on, as many as there are lanes at most."""
    _, begin, _, _, prepare, start, _, sound = codes
    _, _, parameters, values, checks, _, _ = shape
    lanes, n = room.clock.shape[1], room.delta.shape[0]
    clock, settings, given, begun = room.clock_ahead, room.settings_ahead, room.given, room.begun
    target = row(room.constants_ahead, 0)
    _fill(columns, 0, clock, 2, first, count)
    for lane in range(lanes):
        t0, t1 = clock[0, lane], clock[1, lane]
        settings[0, lane], settings[1, lane] = min(limits[0, 0], abs(t1 - t0)), 1.0 if t1 >= t0 else -1.0
    _fill(columns, 2, given, parameters, first, count)
    finite = call_test(sound, row(clock, 0), 2, 0, 0, 0) & call_test(sound, row(given, 0), parameters, 0, 0, 0)
    call_code(prepare, row(given, 0), 0, 0, 0, target)
    _fill(columns, 2 + parameters, given, values, first, count)
    finite &= call_test(sound, target, room.constants_ahead.shape[0], 0, 0, 0)
    finite &= call_test(sound, row(given, 0), values, 0, 0, 0)
    call_code(start, row(clock, 0), row(given, 0), target, 0, row(begun, 0))
    fits = call_test(sound, row(begun, 0), n, checks, 0, 0)
    for lane in range(lanes):
        room.whole[STAGED, lane] = RUNNING if fits >> lane & 1 else _INITIAL_STATE
        if not finite >> lane & 1:
            room.whole[STAGED, lane] = _NON_FINITE
    if begin != 0:
        call_code(begin, row(clock, 0), row(begun, 0), target, row(settings, 0), row(begun, n + checks))


@bare
def enter(room: Room, lane: int, place: int, case: int, old: int, from_: int, rows: int) -> None:
    """Put a case that was made ahead into a lane, with `rows` numbers of its state and memory."""
    for m in range(rows):
        room.states[old + m, lane] = room.begun[from_ + m, place]
    for m in range(room.constants.shape[0]):
        room.constants[m, lane] = room.constants_ahead[m, place]
    t0, t1 = room.clock_ahead[0, place], room.clock_ahead[1, place]
    room.clock[NOW, lane], room.clock[END, lane], room.clock[NEXT, lane] = t0, t1, t1
    room.settings[1, lane] = room.settings_ahead[1, place]
    room.tally[ATTEMPTS, lane], room.tally[REFUSED, lane], room.tally[FIRST, lane] = 0.0, 0.0, t0
    room.whole[CASE, lane], room.whole[SAMPLED, lane] = case, 0
    room.whole[STATUS, lane] = _SUCCESS if t0 == t1 else RUNNING
