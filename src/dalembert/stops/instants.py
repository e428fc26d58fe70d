"""Instants of sampled controllers that a run meets one by one, for exports, whose runs have no lists of all stops.

They are those of `dalembert.runs.sampling.Sampling.instants`. The table of stops has room for two: the one that a run
reaches next, and the one to which its steps go behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..methods.step_constants import SMALLEST_OF_TIME
from ..subset.addresses import NO_CODE, OwnedAddress
from ..subset.arguments import Address, IntVector, Matrix, Record
from ..subset.compiled_subset import call_code, compiled_subset, row
from .input_records import InputTable
from .stops import CaseStops, StopAction, StopLists, StopTable

_LISTED = 2


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
    """

    clock: InstantClock
    times: Address
    schedule: Matrix
    listed: IntVector


def no_instants() -> InstantTable:
    """Return a table without controllers."""
    return InstantTable(InstantClock(), NO_CODE, np.zeros((0, 1)), np.zeros(0, np.int64))


def instants_of(times: OwnedAddress, count: int) -> InstantTable:
    """Return the table of so many controllers, for the code of their periods and offsets."""
    return InstantTable(InstantClock(), times, np.zeros((2 * count, 1)), np.zeros(count, np.int64))


def stops_at_instants(places: Sequence[Sequence[int]], codes: Sequence[OwnedAddress], inputs: InputTable) -> StopTable:
    """Return the stops of one case: those of controllers that set components of the state at places, by code."""
    nothing = np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros(_LISTED), np.zeros(_LISTED, np.int64)
    lists = StopLists(*nothing, np.full(_LISTED, np.nan))
    actions = tuple(StopAction(tuple(own)) for own in places)
    return CaseStops(lists, None, actions, tuple(codes)).table(inputs, 1, 0)


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
    """List the instants that come next before the end of a run, where ``closed`` at it too, without those passed.

    What differs from the start, the end or another instant by rounding is that time.
    """
    origin, count = instants.clock.origin, 0
    near = SMALLEST_OF_TIME * max(abs(origin), abs(t1))
    for place in range(stops.next[0], stops.until[0]):
        stops.times[count], stops.acts[count] = stops.times[place], stops.acts[place]
        count += 1
    while count < stops.times.size:
        time = first_instant(instants)
        at_end = abs(time - t1) <= near
        if time > t1 + near or (at_end and not closed and t1 > origin):
            break
        acts = 0
        for k in range(instants.listed.size):
            if instant_of(instants, k) <= time + near:
                acts += 1 << k
                instants.listed[k] += 1
        stops.times[count] = t1 if at_end else origin if time < origin + near else time
        stops.acts[count] = acts
        count += 1
    stops.next[0], stops.until[0], stops.last[0] = 0, count, count
