"""Maps of the state by events of users, on coordinates, rates and first-order states of scenes with contacts.

A case whose phase has ended so leaves the loop over phases. It is mapped here, and begins anew in the mode that is
selected then. Constraints that hold in all modes may forbid the state; contacts decide on it as on a start.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..events.event_rules import accumulates
from ..methods.status import RUNNING, Status
from ..subset.arguments import NO_CODE, Address, AddressTable, AddressVector, IntVector, Matrix, Vector
from ..subset.compiled_subset import call_code, compiled_subset, row
from .contact_cases import UNDECIDED
from .phase_tables import JUMPS, NOT_STARTED, CaseTable

DEFAULT, AT_TIME = -1, -2
"""In place of a column of the parameters of the scene: a default value; the time."""

MAP, REFUSE = range(2)
"""Tasks: map the states of cases in which events have occurred; undo maps to states that contacts forbid."""


class EventMaps(NamedTuple):
    """Maps, in the model in which all that can open is open.

    Attributes
    ----------
    prepare, initial, start, expand : Address
        Code of its constants, of its state from variables, of the state from what a map gives, with checks, and of
        variables from its state.
    jumps : (n_events,)
        Code of the maps; 0 for events without one.
    terminal : (n_events,)
        The occurrence that ends a case, 0 for none.
    columns, defaults : (n_p,)
        Where its parameters are among those of the scene, or `DEFAULT` or `AT_TIME`; and their default values.
    size : int
        Components of its state.
    clock, parameters, constants, states, given, begun, posed : (k, lanes)
        Arguments and results of the code.
    last : (n_cases,)
        Times of the last maps, NaN before the first.
    before, number : (n_cases, n_x), (n_cases,)
        Variables and modes before these.
    """

    prepare: Address
    initial: Address
    start: Address
    expand: Address
    jumps: AddressVector
    terminal: IntVector
    columns: IntVector
    defaults: Vector
    size: int
    clock: Matrix
    parameters: Matrix
    constants: Matrix
    states: Matrix
    given: Matrix
    begun: Matrix
    posed: Matrix
    last: Vector
    before: Matrix
    number: IntVector


def no_maps() -> EventMaps:
    """Return empty fields, for motions without maps."""
    none, nothing, room = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 1))
    return EventMaps(*(NO_CODE,) * 4, AddressTable(), none, none, nothing, 0, *(room,) * 7, nothing, room, none)


class MapArguments(NamedTuple):
    """Arguments of the loop, which carries out a task."""

    table: CaseTable
    maps: EventMaps
    task: int


@compiled_subset
def _load(table: CaseTable, maps: EventMaps, i: int) -> None:
    """Write time, parameters and variables of a case to all lanes."""
    cases = table.cases
    for lane in range(maps.clock.shape[1]):
        maps.clock[0, lane] = cases.t[i]
        for m in range(maps.columns.size):
            column, value = maps.columns[m], maps.defaults[m]
            if column >= 0:
                value = cases.p[i, column]
            elif column == AT_TIME:
                value = cases.t[i]
            maps.parameters[m, lane] = value
        for m in range(cases.x.shape[1]):
            maps.posed[m, lane] = cases.x[i, m]
        maps.given[maps.given.shape[0] - 1, lane] = -1.0 if cases.span[i] < 0.0 else 1.0  # or a map overwrites it


@compiled_subset
def _is_mapped(table: CaseTable, maps: EventMaps, i: int, e: int) -> bool:
    """Map the variables of a case by an event; return whether constraints allow them, which stay as they are if not."""
    _load(table, maps, i)
    clock, states, constants = row(maps.clock, 0), row(maps.states, 0), row(maps.constants, 0)
    call_code(maps.prepare, clock, 0, row(maps.parameters, 0), 0, constants)
    call_code(maps.initial, clock, row(maps.posed, 0), constants, 0, states)
    call_code(maps.jumps[e], clock, states, constants, 0, row(maps.given, 0))
    call_code(maps.start, clock, row(maps.given, 0), constants, 0, row(maps.begun, 0))
    total = 0.0
    for m in range(maps.begun.shape[0]):
        total += 0.0 * maps.begun[m, 0]
    for m in range(maps.size, maps.begun.shape[0], 2):
        total = total if abs(maps.begun[m, 0]) <= maps.begun[m + 1, 0] else math.nan
    if total != 0.0:
        return False
    call_code(maps.expand, clock, row(maps.begun, 0), constants, 0, row(maps.posed, 0))
    for m in range(table.cases.x.shape[1]):
        table.cases.x[i, m] = maps.posed[m, 0]
    return True


@compiled_subset
def map_state(table: CaseTable, maps: EventMaps, i: int) -> None:
    """Map the state of a case by the events that have just occurred in it, whose mode is to be selected then."""
    numbers, cases, t, status = table.numbers, table.cases, table.cases.t[i], RUNNING
    gap, seen = abs(t - maps.last[i]), True
    maps.last[i], maps.number[i] = t, cases.number[i]
    for m in range(cases.x.shape[1]):
        maps.before[i, m] = cases.x[i, m]
    for e in range(maps.jumps.size):
        here = maps.jumps[e] != 0 and table.occurred[i, 3 * e + 2] == t
        seen = seen and (not here or table.carried[i, 2 * e + 1] != 0.0)
        if status == RUNNING and here and not _is_mapped(table, maps, i, e):
            status = Status.EVENT_STATE
    for e in range(maps.jumps.size):
        last = maps.jumps[e] != 0 and maps.terminal[e] > 0 and table.occurred[i, 3 * e] >= maps.terminal[e]
        if status == RUNNING and last:
            status = Status.EVENT
    first = math.isnan(gap)
    if status == RUNNING and not first and accumulates(gap, t, abs(cases.span[i]), seen, 0.0):
        status = Status.EVENTS_ACCUMULATE
    for m in range(1, table.carried.shape[1], 2):
        table.carried[i, m] = 0.0
    if status == RUNNING:
        cases.number[i] = UNDECIDED
        for m in range(cases.modes.shape[1]):
            cases.modes[i, m] = UNDECIDED
    elif cases.passed[i] != 0.0:
        numbers.phases[i] -= 1
    numbers.state[i], numbers.runner[i] = status, NOT_STARTED


@compiled_subset
def refuse_map(table: CaseTable, maps: EventMaps, i: int) -> None:
    """Undo a map to a state that contacts forbid, which is not the start of the case: it has not taken place."""
    if table.cases.status[i] == Status.INITIAL_STATE and not math.isnan(maps.last[i]):
        table.numbers.state[i], table.cases.number[i] = Status.EVENT_STATE, maps.number[i]
        for m in range(table.cases.x.shape[1]):
            table.cases.x[i, m] = maps.before[i, m]


@compiled_subset
def LOOP(arguments: MapArguments) -> int:
    """Carry out a task for all cases; return 0."""
    table, maps = arguments.table, arguments.maps
    for i in range(table.t0.size):
        if arguments.task == REFUSE:
            refuse_map(table, maps, i)
        elif table.numbers.state[i] == RUNNING and table.numbers.runner[i] == JUMPS:
            map_state(table, maps, i)
    return 0
