"""Resolution of an event of a case: other events at its time, jumps, status, signs after it; blocks of its steps."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..arrays import FloatArray
from ..lanes.workspace import EventKernels, EventWorkspace
from ..methods.status import RUNNING, Status
from ..methods.step_constants import RESIDUAL, TOGETHER
from ..subset.arguments import Matrix, Record, Vector
from ..subset.compiled_subset import call_code, compiled_subset, row
from .event_begins import take_begins
from .event_rules import accumulates, carried_sign, change_counts, start_sign, too_soon
from .event_search import NOTHING, count_occurrence, occur, scan
from .event_series import happens_alone


@compiled_subset
def begin_signs(events: EventKernels, space: EventWorkspace, lane: int, t: float, direction: float, c: int) -> None:
    """Record the signs at the start of a lane, whose state is in the first row of ``one_point``."""
    for e in range(events.directions.size):
        space.seen[lane, e] = 0.0
    _take_signs(events, space, lane, t, direction, c, True)


@compiled_subset
def _take_signs(
    events: EventKernels, space: EventWorkspace, lane: int, t: float, direction: float, c: int, armed: bool
) -> None:
    """Record the signs that expressions have, or are about to have; armed events have theirs if ``armed``."""
    if events.begins != 0:
        take_begins(events, space, lane, c, t)
    for e in range(events.directions.size):
        value, rate, noise = (
            space.one_out[0, 3 * e],
            space.one_out[0, 3 * e + 1],
            space.one_out[0, 3 * e + 2],
        )
        rule = events.directions[e] if armed else 0
        sign, zero = start_sign(value, rate, noise, space.residual[0, e], t, direction, rule)
        space.start_noise[lane, e] = noise if math.isfinite(noise) else 0.0
        space.zero[lane, e], space.signs[lane, e] = 1.0 if zero else 0.0, sign


@compiled_subset
def starts(events: EventKernels, space: EventWorkspace, lane: int, t: float, direction: float, one: int) -> None:
    """Begin a case in a lane, its state being in the first row of ``one_point``."""
    space.jumped[lane, 0], space.jumped[lane, 1], space.jumped[lane, 2] = math.nan, 0.0, 0.0
    for e in range(events.directions.size):
        space.residual[0, e] = 0.0
    begin_signs(events, space, lane, t, direction, one)


@compiled_subset
def go_on(events: EventKernels, space: EventWorkspace, lane: int, t: float, direction: float, case: int) -> None:
    """Set the signs with which a case continues in a lane, see ``EventWorkspace.carried``."""
    for e in range(events.directions.size):
        before = space.carried[case, 2 * e]
        if not math.isnan(before):
            space.jumped[lane, 2] = 1.0
        value, rate, noise = space.one_out[0, 3 * e], space.one_out[0, 3 * e + 1], space.one_out[0, 3 * e + 2]
        sign = carried_sign(before, value, rate, noise, t, direction, events.directions[e])
        if sign != 0.0:
            space.signs[lane, e], space.zero[lane, e] = sign, 0.0


@compiled_subset
def carry(events: EventKernels, space: EventWorkspace, lane: int, case: int, status: int, searched: bool) -> None:
    """Record how a case ends with a status in a lane, whose last step was ``searched``: see ``EventWorkspace.carried``.

    Only at a stop does it continue with the signs that it has.
    """
    for e in range(events.directions.size):
        if status == Status.SUCCESS:
            unknown = searched and space.zero[lane, e] != 0.0
            space.carried[case, 2 * e] = 0.0 if unknown else space.signs[lane, e]
        if space.seen[lane, e] != 0.0:
            space.carried[case, 2 * e + 1] = 1.0


@compiled_subset
def zeros_at_end(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    t: float,
    direction: float,
    one: int,
    happened: FloatArray,
    case: int,
) -> bool:
    """Look for expressions that are zero at the very end, the state there being in ``one_point``; see `scan`.

    One that is zero from the beginning, up to rounding, does not occur there.
    """
    count = 0
    for e in range(events.directions.size):
        space.residual[0, e] = space.happens[0, e] = 0.0
        left = space.zero[lane, e] == 0.0 or space.seen[lane, e] != 0.0
        space.ends[0, e] = space.signs[lane, e] if left else 0.0
    _take_signs(events, space, lane, t, direction, one, False)
    for e in range(events.directions.size):
        if space.zero[lane, e] != 0.0 and space.signs[lane, e] * space.ends[0, e] < 0.0:
            space.found[count, 0], space.found[count, 1] = 0.0, e
            count += 1
            space.seen[lane, e] = 1.0
    return occur(events, space, lane, count, t, 0.0, happened, case) >= 0.0


@compiled_subset
def resolve(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    n: int,
    t: float,
    direction: float,
    span: float,
    one: int,
    happened: FloatArray,
    case: int,
    theta: float,
) -> int:
    """Apply the events that `scan` marked, at time t to the state in ``one_point``.

    `theta` is the fraction of the step where that is, 1 or more at its end.

    Returns the status of the case, `RUNNING` where it continues.
    """
    if events.events_with_series > 0 and theta < 1.0 and happens_alone(events, space, theta):
        return Status.EVENT
    take_begins(events, space, lane, one, t)
    _count_together(events, space, lane, t, direction, happened, case)
    ended, jumps, seen = False, False, True
    share = 0.0 if theta == 0.0 and space.jumped[lane, 2] != 0.0 else RESIDUAL
    for e in range(events.directions.size):
        here = space.happens[0, e] > 0.0
        space.residual[0, e] = share * abs(space.one_out[0, 3 * e]) if here else 0.0
        ended = ended or space.happens[0, e] == 2.0
        jumps = jumps or (here and events.jumps[e] != 0)
        seen = seen and (not here or space.seen[lane, e] != 0.0)
    for e in range(events.directions.size):
        if space.happens[0, e] > 0.0 and events.jumps[e] != 0 and not _jump(events, space, n, e, direction, one):
            return Status.EVENT_STATE
    if ended:
        return Status.EVENT
    return _status_after_jump(space, lane, t, span, seen) if jumps else RUNNING


@compiled_subset
def _count_together(
    events: EventKernels,
    space: EventWorkspace,
    lane: int,
    t: float,
    direction: float,
    happened: FloatArray,
    case: int,
) -> None:
    """Count expressions that are zero up to rounding and about to change their sign as events at the same time."""
    for e in range(events.directions.size):
        value, rate, noise = (
            space.one_out[0, 3 * e],
            space.one_out[0, 3 * e + 1],
            space.one_out[0, 3 * e + 2],
        )
        crosses = space.signs[lane, e] * rate * direction < 0.0
        if crosses and space.happens[0, e] == 0.0 and abs(value) <= noise + TOGETHER * abs(t) * abs(rate):
            if change_counts(events.directions[e], -space.signs[lane, e]):
                count_occurrence(events, space, e, t, -space.signs[lane, e], happened, case)
                space.seen[lane, e] = 1.0


@compiled_subset
def _jump(events: EventKernels, space: EventWorkspace, n: int, e: int, direction: float, one: int) -> bool:
    """Apply the jump of an event to the state in ``one_point``; return whether the constraints allow it."""
    clock, before, after = row(space.one_clock, 0), row(space.one_point, 0), row(space.one_point, 1)
    space.one_point[1, events.given - 1] = direction  # the start reads it, unless the jump overwrites it
    call_code(events.jumps[e], clock, before, one, 0, after)
    call_code(events.start, clock, after, one, 0, row(space.one_out, 0))
    total = 0.0
    for m in range(n + events.checks):
        total += 0.0 * space.one_out[0, m]
    for m in range(n, n + events.checks, 2):
        total = total if abs(space.one_out[0, m]) <= space.one_out[0, m + 1] else math.nan
    if total != 0.0:
        return False
    for m in range(n):
        space.one_point[0, m] = space.one_out[0, m]
    return True


@compiled_subset
def _status_after_jump(space: EventWorkspace, lane: int, t: float, span: float, seen: bool) -> int:
    """Return the status of a lane whose state has jumped, from the jumps before."""
    gap, space.jumped[lane, 0] = abs(t - space.jumped[lane, 0]), t
    if math.isnan(gap):
        return RUNNING
    space.jumped[lane, 1] = too_soon(gap, span, space.jumped[lane, 1])
    return Status.EVENTS_ACCUMULATE if accumulates(gap, t, span, seen, space.jumped[lane, 1]) else RUNNING


BEGIN, RESTART, SEARCH, RESOLVE, END = range(5)
"""Tasks: take signs at the start of a run, and after a jump; search steps; resolve what was found; look at the end."""


class SearchProgress(Record):
    """Task, and progress of a search.

    The step to search next, of which ``before`` were recorded before these; 1 where a motion begins with it
    (``fresh``); the fraction of the step where something stops it; time and direction of a task at one state.
    """

    task: int
    step: int
    before: int
    fresh: int
    theta: float
    t: float
    direction: float
    span: float


class SearchArguments(NamedTuple):
    """Arguments of the loop, for one case.

    Attributes
    ----------
    knots : (k + 1,)
        Ends of the steps.
    polynomials : (k, n * (degree + 1))
        Of each component in turn, lowest power first, in the fraction of the step.
    happened : (1, 3 n_events)
        As in `dalembert.lanes.sweep_arguments.SweepArguments`.
    """

    events: EventKernels
    workspace: EventWorkspace
    knots: Vector
    polynomials: Matrix
    happened: Matrix
    progress: SearchProgress


@compiled_subset
def LOOP(arguments: SearchArguments) -> int:
    """Carry out a task; return what was found, the status after it, or whether something occurs at the end."""
    events, space, progress = arguments.events, arguments.workspace, arguments.progress
    t, direction, one, outcome = progress.t, progress.direction, row(space.own, 0), 0
    if progress.task == SEARCH:
        return _search(arguments)
    if progress.task == BEGIN:
        starts(events, space, 0, t, direction, one)
        if space.carried.shape[0] > 0:
            go_on(events, space, 0, t, direction, 0)
    elif progress.task == RESTART:
        space.jumped[0, 2] = 0.0
        begin_signs(events, space, 0, t, direction, one)
    elif progress.task == RESOLVE:
        n, span, theta = space.series.shape[0], progress.span, progress.theta
        outcome = resolve(events, space, 0, n, t, direction, span, one, arguments.happened, 0, theta)
    elif zeros_at_end(events, space, 0, t, direction, one, arguments.happened, 0):
        outcome = 1
    return outcome


@compiled_subset
def _search(arguments: SearchArguments) -> int:
    """Search steps up to the first that something stops."""
    events, space, progress, knots = arguments.events, arguments.workspace, arguments.progress, arguments.knots
    series, steps = space.series, arguments.polynomials.shape[0]
    n, terms = series.shape
    while progress.step < steps:
        number = progress.step
        for m in range(n):
            for k in range(terms):
                series[m, k] = arguments.polynomials[number, m * terms + k]
        t, fresh = knots[number], progress.fresh != 0
        space.occurrences[0, 1] = float(progress.before + number)
        h, many, one = knots[number + 1] - t, row(space.constants, 0), row(space.own, 0)
        found, theta = scan(events, space, 0, many, one, t, h, fresh, False, arguments.happened, 0)
        progress.fresh = 0
        if found != NOTHING:
            progress.theta = theta
            return found
        space.jumped[0, 2] = 0.0
        progress.step = number + 1
    return NOTHING
