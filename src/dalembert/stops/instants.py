"""Stops that a run meets one by one, for exports, whose runs have no lists of all: instants of controllers, and breaks.

They are those of `dalembert.runs.sampling.Sampling.instants` and `dalembert.runs.stop_lists.stop_lists`. The table of
stops has room for the ones that a run reaches next, and the one to which its steps go behind them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..methods.step_constants import SMALLEST_OF_TIME
from ..subset.arguments import NO_CODE, Address, IntVector, Matrix, OwnedAddress, Record
from ..subset.compiled_subset import call_code, compiled_subset, row
from .break_search import find_breaks, middle_of
from .break_tables import BreakTable, no_breaks
from .input_records import InputTable
from .stops import CaseStops, StopAction, StopLists, StopTable, prepare_lanes

_LISTED, _LISTED_WITH_BREAKS = 2, 8
"""Stops that are listed; where conditions change about an instant, up to four follow each other within rounding."""


class InstantClock(Record):
    """Time from which instants count, and 1 where controllers may be ``due`` at the present time, and have not acted.

    That is at the start and where a run continues behind its end: inputs may be set before they act.
    """

    origin: float
    due: int


class InstantTable(NamedTuple):
    """Instants of controllers.

    Attributes
    ----------
    clock : InstantClock
    times : Address
        Kernel of their periods, then of their offsets.
    schedule : (2 n, 1)
        Gets these.
    listed : (n,)
        How many instants of each are among the stops, or have passed.
    breaks : BreakTable
        Changes of conditions on time.
    """

    clock: InstantClock
    times: Address
    schedule: Matrix
    listed: IntVector
    breaks: BreakTable


def no_instants(breaks: BreakTable | None = None) -> InstantTable:
    """Return a table without controllers."""
    none = np.zeros(0, np.int64)
    return InstantTable(InstantClock(), NO_CODE, np.zeros((0, 1)), none, breaks or no_breaks())


def instants_of(times: OwnedAddress, count: int, breaks: BreakTable | None = None) -> InstantTable:
    """Return the table of so many controllers, for the code of their periods and offsets."""
    listed = np.zeros(count, np.int64)
    return InstantTable(InstantClock(), times, np.zeros((2 * count, 1)), listed, breaks or no_breaks())


def stops_at_instants(
    places: Sequence[Sequence[int]], codes: Sequence[OwnedAddress], inputs: InputTable, breaks: BreakTable | None = None
) -> StopTable:
    """Return the stops of one case: of controllers that set components of the state at places, by code, and breaks."""
    listed, constants = (_LISTED, 0) if breaks is None else (_LISTED_WITH_BREAKS, len(breaks.before))
    nothing = np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(listed), np.zeros(listed, np.int64)
    lists = StopLists(*nothing, np.full(listed, np.nan))
    actions = tuple(StopAction(tuple(own)) for own in places)
    place = None if breaks is None or breaks.place < 0 else breaks.place
    return CaseStops(lists, place, actions, tuple(codes)).table(inputs, 1, constants)


@compiled_subset
def has_stops(instants: InstantTable) -> bool:
    """Return whether there are controllers or conditions."""
    return instants.listed.size > 0 or instants.breaks.kinds.size > 0


@compiled_subset
def begin_breaks(instants: InstantTable, t0: float, t1: float) -> bool:
    """Find the breaks of a run, whose parameters their table has; return whether there is room for them."""
    instants.clock.origin, instants.clock.due = t0, 1
    return find_breaks(instants.breaks, t0, t1)


@compiled_subset
def continue_breaks(
    instants: InstantTable, stops: StopTable, prepare: int, constants: FloatArray, t: float, t1: float
) -> bool:
    """Find the breaks of a run that continues, and decide conditions; return whether there is room for them."""
    breaks = instants.breaks
    for m in range(breaks.parameters.shape[1]):
        breaks.parameters[0, m] = constants[m, 0]
    if not find_breaks(breaks, t, t1):
        return False
    if breaks.place >= 0:
        constants[breaks.place, 0] = middle_of(breaks, 0)
        prepare_lanes(stops, prepare, constants, 1)
    return True


@compiled_subset
def keep_constants(breaks: BreakTable, constants: FloatArray) -> None:
    """Keep the constants of the step that follows."""
    for m in range(breaks.before.shape[0]):
        breaks.before[m, 0] = constants[m, 0]


@compiled_subset
def begin_instants(instants: InstantTable, constants: int, t0: float) -> bool:
    """Compute periods and offsets from constants at an address; return whether they make sense."""
    count, schedule, sensible = instants.listed.size, instants.schedule, True
    instants.clock.origin, instants.clock.due = t0, 1
    call_code(instants.times, 0, 0, constants, 0, row(schedule, 0))
    for k in range(count):
        period, offset = schedule[k, 0], schedule[count + k, 0]
        sensible = sensible and 0.0 < period and period < np.inf and 0.0 <= offset and offset < np.inf
    return sensible


@compiled_subset
def instant_of(instants: InstantTable, k: int) -> float:
    """Return the first instant of a controller that is not listed."""
    count, schedule = instants.listed.size, instants.schedule
    return instants.clock.origin + (schedule[count + k, 0] + schedule[k, 0] * float(instants.listed[k]))


@compiled_subset
def first_instant(instants: InstantTable) -> float:
    """Return the first instant that is not listed."""
    first = np.inf
    for k in range(instants.listed.size):
        first = min(first, instant_of(instants, k))
    return first


@compiled_subset
def list_instants(instants: InstantTable, stops: StopTable, t1: float, closed: bool) -> None:
    """List the stops that come next before the end of a run, where ``closed`` instants at it too, without those passed.

    What differs from the start, the end or another instant by rounding is that time. Where an instant is at a break,
    but for rounding, or at the start, controllers act with conditions as of that very time.
    """
    origin, count, breaks = instants.clock.origin, 0, instants.breaks
    near = SMALLEST_OF_TIME * max(abs(origin), abs(t1))
    for place in range(stops.next[0], stops.until[0]):
        stops.times[count], stops.acts[count] = stops.times[place], stops.acts[place]
        if breaks.place >= 0:
            stops.middles[count] = stops.middles[place]
        count += 1
    while count < stops.times.size - (1 if breaks.kinds.size > 0 else 0):
        time = first_instant(instants)
        if breaks.kinds.size > 0:
            following = breaks.search.next
            if following < breaks.search.count and breaks.times[following] <= time:
                _list(instants, stops, count, breaks.times[following], 0, middle_of(breaks, following + 1))
                breaks.search.next, count = following + 1, count + 1
                continue
        at_end = abs(time - t1) <= near
        if time > t1 + near or (at_end and not closed and t1 > origin):
            break
        acts = 0
        for k in range(instants.listed.size):
            if instant_of(instants, k) <= time + near:
                acts += 1 << k
                instants.listed[k] += 1
        time = t1 if at_end else origin if time < origin + near else time
        if breaks.place >= 0 and _is_at_break(breaks, time):
            _list(instants, stops, count, time, acts, time)
            _list(instants, stops, count + 1, time, 0, middle_of(breaks, breaks.search.next))
            count += 2
        else:
            _list(instants, stops, count, time, acts, np.nan)
            count += 1
    stops.next[0], stops.until[0], stops.last[0] = 0, count, count


@compiled_subset
def _list(instants: InstantTable, stops: StopTable, place: int, time: float, acts: int, decided: float) -> None:
    """Write a stop: its time, which controllers act, and when conditions are decided from there on."""
    stops.times[place], stops.acts[place] = time, acts
    if instants.breaks.place >= 0:
        stops.middles[place] = decided


@compiled_subset
def _is_at_break(breaks: BreakTable, t: float) -> bool:
    """Return whether an instant is at a break that is listed, or at the next one, or at the start."""
    search, distance = breaks.search, t - breaks.search.begin
    if search.next > 0:
        distance = t - breaks.times[search.next - 1]
    if search.next < search.count:
        distance = min(distance, breaks.times[search.next] - t)
    return distance <= SMALLEST_OF_TIME * abs(t)
