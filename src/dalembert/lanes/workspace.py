"""Arrays of the loops over lanes: their callers make them, because compiled loops allocate nothing."""

from __future__ import annotations

from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from ..arrays import aligned
from ..methods.chebyshev import BOUNDS
from ..methods.step_constants import DEEPEST
from ..once import once
from ..subset.arguments import NO_CODE, Address, AddressTable, AddressVector, IntVector, Matrix, Record
from ..subset.packing import constant_group

POINT_LANES = 8
SLOPE_LANES = 4
NOW, END, NEXT = range(3)
"""Rows of ``LaneState.clock``."""

ATTEMPTS, REJECTIONS, BEFORE, FIRST, SHORTENED = range(5)
"""Rows of ``LaneState.tally``."""

RATE, BEND, DOUBT, LIMIT = range(4)
"""Rows of ``EventWorkspace.rates``."""

OCCURRENCE = 5
"""Columns of ``EventWorkspace.occurrences``: event, time, sign, at least 1 where it stops the motion, and the step."""

LONG_ENDS = 5
"""Columns of ``SweepArguments.ends`` where there are those for attempts and rows of a record, too."""

MADE = 2
"""Value of ``LoopProgress.common``."""

IDLE = -2
"""Status of a lane without a case."""


class LaneNumbers(NamedTuple):
    """Integers of the lanes, one column each.

    The case and its status; the samples recorded, now and before the last step; whether the state is to be projected,
    together (``mark``) or alone (``lone``); whether the case starts with the next step; the status of the case that was
    loaded for the lane.
    """

    case: IntVector
    status: IntVector
    sampled: IntVector
    sampled_before: IntVector
    mark: IntVector
    fresh: IntVector
    lone: IntVector
    loaded: IntVector


class LoopProgress(Record):
    """Progress of a loop over lanes, and when it returns before its end.

    After ``patience`` of its ``rounds`` it checks whether to stop, and returns where ``returns`` is not 0. ``paused``
    is 1 then, and it continues where it was when it is called again. This thread is to load the cases from ``coming``
    up to ``last``. Of those made ahead, ``filled`` in number, ``loaded`` is the first and ``place`` the next to enter.
    ``active`` lanes have a case; ``old`` is the first row of the states that steps begin from; ``look`` are the lanes
    that are looked at after a step, as bits; so many steps were ``recorded``. ``common`` is 1 where all cases have the
    same parameters and their constants never change, and `MADE` once these are in all lanes; ``finite`` are the lanes
    where they are finite, as bits.
    """

    patience: int
    rounds: int
    returns: int
    paused: int
    coming: int
    last: int
    loaded: int
    filled: int
    place: int
    active: int
    old: int
    look: int
    recorded: int
    common: int
    finite: int


class LaneState(NamedTuple):
    """State of the lanes, one column each.

    ``clock`` are time, end and the next time to record; ``tally`` attempts, rejected attempts, the time before the last
    step, that of the start, and the size of the next attempt after one whose end could not be projected, if steps do
    not remember it. A step reads the state in one half of ``states`` and writes the other. Others are for
    cases that come next: ``given`` values, state, checks and memory in ``begun``.
    """

    clock: Matrix
    settings: Matrix
    constants: Matrix
    states: Matrix
    delta: Matrix
    tally: Matrix
    numbers: LaneNumbers
    given: Matrix
    begun: Matrix
    clock_ahead: Matrix
    settings_ahead: Matrix
    constants_ahead: Matrix
    progress: LoopProgress


def lane_state(lanes: int, n: int, n_c: int, n_s: int, rows: int, given: int, begun: int) -> LaneState:
    """Return the arrays of so many lanes.

    States have n components, constants n_c, settings n_s; a step writes `rows` outputs; cases are made from at most
    `given` values, which gives `begun` numbers.
    """
    count, integers = max(n_c, 1), len(LaneNumbers._fields)
    sizes = 3, n_s, count, 2 * rows, n, 5, integers, max(given, 1), begun, 2, n_s, count
    block, ends = aligned(sum(sizes), lanes), tuple(accumulate(sizes))  # one, as arrays of their own take longer
    parts: list[Any] = [block[end - size : end] for size, end in zip(sizes, ends, strict=True)]
    numbers = LaneState._fields.index("numbers")
    parts[numbers] = LaneNumbers(*parts[numbers].view(np.int64))
    return LaneState._make([*parts, LoopProgress()])


class EventKernels(NamedTuple):
    """Addresses of compiled code, and the rules of the events.

    ``step_signs`` gives the sign of each expression over a step of every lane, 0 where it may change; it is 0 where all
    steps are searched. ``values`` are the watched expressions (n) at `POINT_LANES` points, all others take one point:
    ``value`` the same expressions, ``begins`` value, rate and noise of each (3 n), or with ``slopes`` what
    `dalembert.events.event_begins` makes them of, ``jumps`` (n) coordinates and rates after a jump or 0, ``start`` the
    state from them with its checks, and with the direction of time behind them where it depends on that, ``refill``
    what a step remembers at its start, or 0. ``used`` are the components of the state that the expressions read,
    ``given`` and ``checks`` the sizes around ``start``.

    Expressions of which minima, maxima or integrals are taken, as ``kinds`` say, are ``running`` at `POINT_LANES`
    points and ``at`` one; ``step_bounds`` bounds them over a step of every lane, and ``read`` is what they read of the
    state.

    ``events_with_series`` is 0, or the number of events: then all of these end the case, and a step writes their series
    too. ``oscillating`` is 1 where expressions may oscillate within a step, however smooth the motion is, and
    ``running_oscillates`` where those of minima and maxima may. ``position`` and ``velocity`` are projections, onto
    whose states zeros are located; ``exact`` is 1 where polynomials of steps have no error that counts.

    ``slopes`` are derivatives along directions, one for each of `SLOPE_LANES`, or 0; ``varying`` the places of a
    direction that count, and ``residuals`` the number of constraints whose residuals do.

    ``step_points`` gives `POINT_LANES` points of the step of every lane. ``step_values`` are the expressions at one of
    them, and ``step_running`` those that are reduced, where ``step_signs`` and ``step_bounds`` take these values; they
    are 0 where these take the outputs of the step.
    """

    step_signs: Address
    values: Address
    value: Address
    begins: Address
    start: Address
    refill: Address
    given: int
    checks: int
    jumps: AddressVector
    directions: IntVector
    last: IntVector
    used: IntVector
    step_bounds: Address
    held: Address
    running: Address
    at: Address
    kinds: IntVector
    read: IntVector
    varying: IntVector
    events_with_series: int = 0
    oscillating: int = 0
    running_oscillates: int = 0
    position: Address = NO_CODE
    velocity: Address = NO_CODE
    exact: int = 0
    slopes: Address = NO_CODE
    residuals: int = 0
    step_points: Address = NO_CODE
    step_values: Address = NO_CODE
    step_running: Address = NO_CODE


@once
def no_events() -> EventKernels:
    """Return empty fields, for loops without events."""
    nothing = np.zeros(0, np.int64)
    tables = AddressTable(), *(nothing,) * 3
    return constant_group(EventKernels(*(NO_CODE,) * 6, 0, 0, *tables, *(NO_CODE,) * 4, *(nothing,) * 3))


class EventWorkspace(NamedTuple):
    """Arrays to watch cases with, and what each lane remembers: signs, what was seen of them, and zeros at the start.

    ``event_series`` are those of the events that have any, in the fraction of the step, and ``start_noise`` what
    rounding of the state made of them where each lane began. ``may_change`` are 1 for events that may change their sign
    in the present step, else 0. ``rates`` belong to its beginning; its rows `BEND`, `DOUBT` and `LIMIT` are, over the
    step, the bends of armed events that are zero there, the errors of bends along its polynomials, and bounds of these
    errors (`dalembert.events.event_rules`). ``values`` are those of expressions at the points of a piece of a step,
    ``between`` those between these points.
    ``jumped`` are when the state of each lane last jumped, how many jumps in a row came too soon, 1 where its step
    begins behind a stop, at which expressions may change their signs without a zero, and 1 where ``constants`` are
    those of the present case.
    ``tests`` are the rows of the four that follow: ``expected`` (n_events, lanes) are the signs of ``step_signs`` where
    a lane need not be looked at, or 0, and ``totals`` (kinds, lanes) minima, maxima and integrals so far. ``held`` (1 +
    kinds, lanes) are 1 where tests decide all expressions over a step, else 0, and ``totals`` with the step.
    ``known`` are the values of ``EventKernels.begins`` where there are ``slopes``, ``direction`` the state and a
    direction for each lane of these, ``spread`` time and constants for these lanes, and ``sizes`` what they add up to.
    ``own`` (lanes, n_c) are the constants of each lane in a row, ``constants`` (lanes * n_c, 8) for eight points.
    Where ``occurrences`` has rows, it gets the occurrences, from the second row on; the first has their number, also of
    those for which there is no row, and the number of the present step among the records of steps.

    Where ``carried`` (n_cases, 2 n_events) has rows, it has the sign with which each event of a case continues, NaN at
    a start and 0 where it is not known, and 1 if the event was seen beyond rounding since the state last jumped, else
    0. It gets those at the ends of cases. Where ``low`` (n + 1, lanes) has rows, they are what rounding took from the
    sums of state and time.
    """

    own: Matrix
    constants: Matrix
    clock: Matrix
    point: Matrix
    out: Matrix
    series: Matrix
    values: Matrix
    between: Matrix
    ends: Matrix
    noise: Matrix
    one_clock: Matrix
    one_point: Matrix
    one_out: Matrix
    setting: Matrix
    step_begins: Matrix
    tests: Matrix
    expected: Matrix
    step_signs: Matrix
    step_bounds: Matrix
    totals: Matrix
    held: Matrix
    signs: Matrix
    seen: Matrix
    zero: Matrix
    found: Matrix
    happens: Matrix
    residual: Matrix
    jumped: Matrix
    work: Matrix
    stack: Matrix
    event_series: Matrix
    start_noise: Matrix
    rates: Matrix
    may_change: Matrix
    powers: Matrix
    known: Matrix
    direction: Matrix
    spread: Matrix
    slopes: Matrix
    sizes: Matrix
    step_points: Matrix
    step_values: Matrix
    step_running: Matrix
    occurrences: Matrix
    carried: Matrix
    low: Matrix


def event_workspace(events: EventKernels, n: int, degree: int, n_c: int, n_s: int, lanes: int) -> EventWorkspace:
    """Return the arrays to watch cases of n components and n_c constants, by polynomials of a degree, in lanes."""
    k, count = max(events.directions.size, events.kinds.size, 1), max(n_c, 1)
    size = max(3 * k, events.given, n + events.checks, 2 * n + 8)
    r, nothing = events.residuals, np.zeros((0, SLOPE_LANES))
    tested, kinds = events.directions.size if events.step_signs else 0, events.kinds.size
    tests = aligned(2 * tested + (BOUNDS + 1) * kinds, lanes)
    return EventWorkspace(
        own=aligned(lanes, count),
        constants=aligned(lanes * count, POINT_LANES),
        clock=aligned(1, POINT_LANES),
        point=aligned(n, POINT_LANES),
        out=aligned(k, POINT_LANES),
        series=aligned(n, degree + 1),
        values=aligned(k, POINT_LANES),
        between=aligned(k, POINT_LANES),
        ends=aligned(2, k),
        noise=aligned(1, k),
        one_clock=aligned(1, 1),
        one_point=aligned(2, max(n, events.given)),
        one_out=aligned(1, size),
        setting=aligned(1, n_s),
        step_begins=aligned(1, lanes),
        tests=tests,
        expected=tests[:tested],
        step_signs=tests[tested : 2 * tested],
        step_bounds=tests[2 * tested : 2 * tested + BOUNDS * kinds],
        totals=tests[2 * tested + BOUNDS * kinds :],
        held=aligned(1 + kinds, lanes),
        signs=aligned(lanes, k),
        seen=aligned(lanes, k),
        zero=aligned(lanes, k),
        found=aligned(k, 2),
        happens=aligned(1, k),
        residual=aligned(1, k),
        jumped=aligned(lanes, 4),
        work=aligned(5, 8),
        stack=aligned(2 * DEEPEST + 4, 3),
        event_series=aligned(max(events.events_with_series, 1), degree),
        start_noise=aligned(lanes, k),
        rates=aligned(4, k),
        may_change=np.ones((1, k)),
        powers=aligned(1, degree + 1),
        known=aligned(1, 2 * k + (1 + r) * n) if events.slopes else nothing,
        direction=aligned(2 * n + 1, SLOPE_LANES) if events.slopes else nothing,
        spread=aligned(1 + count, SLOPE_LANES) if events.slopes else nothing,
        slopes=aligned(k + r, SLOPE_LANES) if events.slopes else nothing,
        sizes=aligned(1, k + r) if events.slopes else nothing,
        step_points=aligned(POINT_LANES * (1 + n) if events.step_points else 0, lanes),
        step_values=aligned(POINT_LANES * events.directions.size if events.step_values else 0, lanes),
        step_running=aligned(POINT_LANES * events.kinds.size if events.step_running else 0, lanes),
        occurrences=np.zeros((0, OCCURRENCE)),
        carried=np.zeros((0, 2 * k)),
        low=np.zeros((0, lanes)),
    )


@once
def no_event_workspace() -> EventWorkspace:
    """Return empty fields, for loops without events."""
    return constant_group(EventWorkspace(*(np.empty((0, 0)),) * len(EventWorkspace._fields)))
