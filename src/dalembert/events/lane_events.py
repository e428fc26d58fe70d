"""Events and reductions of the lanes, lane by lane: what `lane_tests` leave to look at."""

from __future__ import annotations

import numpy as np

from ..lanes.lane_steps import project_marked
from ..lanes.lane_stops import end_of_case
from ..lanes.step_records import drop_compensation, record_end
from ..lanes.sweep_arguments import SweepArguments
from ..lanes.workspace import ATTEMPTS, BEFORE, END, FIRST, IDLE, NOW, POINT_LANES, EventWorkspace
from ..methods.status import RUNNING, Status
from ..steps.projection import FAILED, NONE, PENDING, end_polynomial
from ..steps.step_control import largest_step, status_after
from ..subset.compiled_subset import call_code, compiled_subset, row
from .event_intervals import state_at
from .event_resolution import begin_signs, carry, go_on, resolve, starts, zeros_at_end
from .event_rules import recorded_after
from .event_search import BROKEN, NOTHING, scan
from .event_series import at_most_one_zero, load_event_series, no_sign_change
from .lane_tests import expect_signs
from .step_reductions import accumulate, advance


@compiled_subset
def watch_case(arguments: SweepArguments, lane: int) -> None:
    """Begin to watch the case that has entered a lane."""
    state, events, space = arguments.state, arguments.events, arguments.workspace
    count, old = state.constants.shape[0], state.progress.old
    state.numbers.fresh[lane] = 1
    drop_compensation(arguments, lane)
    for m in range(count):
        space.own[lane, m] = state.constants[m, lane]
    space.jumped[lane, 3] = 0.0
    for m in range(arguments.shape.n):
        space.one_point[0, m] = state.states[old + m, lane]
    t, direction = state.clock[NOW, lane], state.settings[1, lane]
    starts(events, space, lane, t, direction, row(space.own, lane))
    if space.carried.shape[0] > 0:
        go_on(events, space, lane, t, direction, state.numbers.case[lane])
    for e in range(events.kinds.size):
        space.totals[e, lane] = arguments.totals[state.numbers.case[lane], e]
    expect_signs(arguments, lane)


@compiled_subset
def handle_events(arguments: SweepArguments) -> None:
    """Find and resolve the events in the steps that were accepted, and continue the reductions."""
    for lane in range(arguments.state.clock.shape[1]):
        if arguments.state.numbers.mark[lane] != PENDING:
            _keep_totals(arguments, lane)
            continue
        searched, found, theta = _search(arguments, lane)
        arguments.state.numbers.fresh[lane] = 0
        _reduce(arguments, lane, searched, found, theta)
        stops = searched and _stops(arguments, lane, found, theta)
        record_end(arguments, lane)
        if stops:
            _stop(arguments, lane, found, theta)
        arguments.workspace.jumped[lane, 2] = 0.0
        _keep_totals(arguments, lane)
        expect_signs(arguments, lane)
        status, case = arguments.state.numbers.status[lane], arguments.state.numbers.case[lane]
        if arguments.workspace.carried.shape[0] > 0 and status != RUNNING:
            carry(arguments.events, arguments.workspace, lane, case, status, searched)


@compiled_subset
def _keep_totals(arguments: SweepArguments, lane: int) -> None:
    """Write the reductions of a case that has ended."""
    status, case = arguments.state.numbers.status[lane], arguments.state.numbers.case[lane]
    for e in range(0 if status == RUNNING or status == IDLE else arguments.events.kinds.size):
        arguments.totals[case, e] = arguments.workspace.totals[e, lane]


@compiled_subset
def _search(arguments: SweepArguments, lane: int) -> tuple[bool, int, float]:
    """Search the step of a lane for events.

    Returns whether tests left something to search, what was found, and at which fraction of the step.
    """
    state, events, space = arguments.state, arguments.events, arguments.workspace
    with_series, first = arguments.shape.events_with_series > 0, state.progress.old + _first_polynomial(arguments)
    now, fresh = state.tally[BEFORE, lane], state.numbers.fresh[lane] != 0
    h, simple = state.clock[NOW, lane] - now, False
    if _keeps_signs(arguments, lane, fresh):
        return False, NOTHING, 1.0
    if with_series:
        load_event_series(space, lane, state.states, first + arguments.shape.n * (arguments.shape.degree + 1), h)
        simple = at_most_one_zero(space, lane, fresh)
        if simple and no_sign_change(space, lane, now, h, fresh):
            return False, NOTHING, 1.0
    _copy_polynomials(arguments, lane, h)
    one, many = row(space.own, lane), row(space.constants, lane * state.constants.shape[0])
    case = state.numbers.case[lane]
    found, theta = scan(events, space, lane, many, one, now, h, fresh, simple, arguments.happened, case)
    return True, found, theta


@compiled_subset
def _first_polynomial(arguments: SweepArguments) -> int:
    """Return the place of the polynomials among the outputs of a step."""
    shape = arguments.shape
    return shape.n + shape.events_with_series + 2 + shape.memory


@compiled_subset
def _keeps_signs(arguments: SweepArguments, lane: int, fresh: bool) -> bool:
    """Return whether the test of the whole step shows that no expression changes its sign; the others are opened."""
    space, with_series = arguments.workspace, arguments.shape.events_with_series > 0
    all_keep = space.step_signs.shape[0] == arguments.events.directions.size
    for e in range(space.step_signs.shape[0]):
        keeps = space.step_signs[e, lane] * space.signs[lane, e] > 0.0
        keeps = keeps and not (fresh and space.zero[lane, e] != 0.0)
        all_keep = all_keep and keeps
        space.seen[lane, e] = 1.0 if all_keep or (with_series and keeps) else space.seen[lane, e]
        space.may_change[0, e] = 0.0 if with_series and keeps else 1.0
    return all_keep


@compiled_subset
def _copy_constants(space: EventWorkspace, lane: int) -> None:
    """Copy the constants of a lane for each point."""
    count = space.own.shape[1]
    for m in range(count):
        for point in range(POINT_LANES):
            space.constants[lane * count + m, point] = space.own[lane, m]


@compiled_subset
def _copy_polynomials(arguments: SweepArguments, lane: int, h: float) -> None:
    """Copy the polynomials of a lane's step, in the fraction of the step, made to end in the state that it ended in.

    With the first ones of a case, its constants are copied to all points.
    """
    if arguments.workspace.jumped[lane, 3] == 0.0:
        arguments.workspace.jumped[lane, 3] = 1.0
        _copy_constants(arguments.workspace, lane)
    series, states, old = arguments.workspace.series, arguments.state.states, arguments.state.progress.old
    first, (n, terms) = old + _first_polynomial(arguments), series.shape
    scale = 1.0 if arguments.shape.memory > 0 else h
    for m in range(n):
        power, total, size = 1.0, 0.0, 0.0
        for k in range(terms):
            value = states[first + m * terms + k, lane] * power
            series[m, k] = value
            total += value
            size += abs(value)
            power *= scale
        end_polynomial(series, m, 0, 1, states[old + m, lane] - total, size)


@compiled_subset
def _reduce(arguments: SweepArguments, lane: int, copied: bool, found: int, theta: float) -> None:
    """Continue minima, maxima and integrals over the step of a lane, or up to the fraction where an event stops it."""
    state, events, space, totals = arguments.state, arguments.events, arguments.workspace, arguments.workspace.totals
    now = state.tally[BEFORE, lane]
    one, many = row(space.own, lane), row(space.constants, lane * state.constants.shape[0])
    h, ready = state.clock[NOW, lane] - now, copied
    for e in range(events.kinds.size):
        decided, total = advance(events.kinds[e], totals[e, lane], space.step_bounds, e, lane, h)
        if found != NOTHING or not decided:
            if not ready:
                _copy_polynomials(arguments, lane, h)
            ready, kind = True, events.kinds[e]
            total = accumulate(events, space, many, one, now, h, theta, e, kind, totals[e, lane])
        totals[e, lane] = total


@compiled_subset
def _stops(arguments: SweepArguments, lane: int, found: int, theta: float) -> bool:
    """Return whether an event stops a lane within its step; the lane is moved back to that time."""
    state, space = arguments.state, arguments.workspace
    if found == NOTHING:
        ended = state.numbers.status[lane] == Status.SUCCESS and state.clock[NOW, lane] == end_of_case(arguments, lane)
        return ended and _ends_in_zeros(arguments, lane)
    if theta < 1.0:
        now = state.tally[BEFORE, lane]
        state_at(space, arguments.shape.n, theta, 0)
        state.clock[NOW, lane] = now + theta * (state.clock[NOW, lane] - now)
        _take_point(arguments, lane)
        return _project_alone(arguments, lane)
    return True


@compiled_subset
def _ends_in_zeros(arguments: SweepArguments, lane: int) -> bool:
    """Return whether an event occurs at the very end of the run of a lane."""
    state, space = arguments.state, arguments.workspace
    _give_point(arguments, lane)
    end, direction = state.clock[END, lane], state.settings[1, lane]
    one, case = row(space.own, lane), state.numbers.case[lane]
    return zeros_at_end(arguments.events, space, lane, end, direction, one, arguments.happened, case)


@compiled_subset
def _give_point(arguments: SweepArguments, lane: int) -> None:
    """Copy the state of a lane to the first row of ``one_point``."""
    for m in range(arguments.shape.n):
        arguments.workspace.one_point[0, m] = arguments.state.states[arguments.state.progress.old + m, lane]


@compiled_subset
def _take_point(arguments: SweepArguments, lane: int) -> None:
    """Copy the first row of ``one_point`` to the state of a lane."""
    for m in range(arguments.shape.n):
        arguments.state.states[arguments.state.progress.old + m, lane] = arguments.workspace.one_point[0, m]


@compiled_subset
def _project_alone(arguments: SweepArguments, lane: int) -> bool:
    """Project the state of one lane; return whether that came about, and else end its case."""
    numbers = arguments.state.numbers
    lone = numbers.lone
    for other in range(arguments.state.clock.shape[1]):
        lone[other] = PENDING if other == lane else NONE
    project_marked(arguments, lone)
    if lone[lane] == FAILED:
        numbers.status[lane] = Status.PROJECTION_FAILED
        return False
    return True


@compiled_subset
def _stop(arguments: SweepArguments, lane: int, found: int, theta: float) -> None:
    """Apply the events of a lane at its present time and state; end its case or restart it."""
    state, space, numbers = arguments.state, arguments.workspace, arguments.state.numbers
    t, end, direction = state.clock[NOW, lane], state.clock[END, lane], state.settings[1, lane]
    _give_point(arguments, lane)
    _drop_samples(arguments, lane, t)
    if found == BROKEN:
        numbers.status[lane] = Status.EVENT_NON_FINITE
        return
    span, one = abs(end_of_case(arguments, lane) - state.tally[FIRST, lane]), row(space.own, lane)
    n, case = arguments.shape.n, numbers.case[lane]
    outcome = resolve(arguments.events, space, lane, n, t, direction, span, one, arguments.happened, case, theta)
    _take_point(arguments, lane)
    if outcome != RUNNING:
        numbers.status[lane] = outcome
        return
    numbers.status[lane] = status_after(abs(end - t) == 0.0, state.tally[ATTEMPTS, lane], arguments.limits[0, 1])
    cut = numbers.status[lane] == Status.SUCCESS and t != end_of_case(arguments, lane)
    if numbers.status[lane] == RUNNING or cut:
        restart(arguments, lane)


@compiled_subset
def _drop_samples(arguments: SweepArguments, lane: int, t: float) -> None:
    """Drop the samples of a lane that show the motion from an occurrence at a time on."""
    state, t_eval, n = arguments.state, arguments.t_eval, arguments.shape.n
    i, direction, sampled = state.numbers.case[lane], state.settings[1, lane], state.numbers.sampled[lane]
    while sampled > 0 and recorded_after(t_eval[sampled - 1], t, direction):
        sampled -= 1
        for m in range(n):
            arguments.samples[i, sampled * n + m] = np.nan
        if arguments.inside.size > 0:
            arguments.inside[i, sampled] = False
    state.numbers.sampled[lane] = sampled


@compiled_subset
def restart(arguments: SweepArguments, lane: int) -> None:
    """Restart a lane from the state in ``one_point``: its signs, and the memory of its step."""
    state, space, events, limits = arguments.state, arguments.workspace, arguments.events, arguments.limits
    t, direction, one = state.clock[NOW, lane], state.settings[1, lane], row(space.own, lane)
    state.numbers.fresh[lane] = 1
    drop_compensation(arguments, lane)
    begin_signs(events, space, lane, t, direction, one)
    if events.refill != 0:
        space.setting[0, 0], space.setting[0, 1] = largest_step(t, state.clock[END, lane], limits[0, 0]), direction
        for m in range(2, limits.shape[1]):
            space.setting[0, m] = limits[0, m]
        space.one_clock[0, 0] = t
        setting, out = row(space.setting, 0), row(space.one_out, 0)
        call_code(events.refill, row(space.one_clock, 0), row(space.one_point, 0), one, setting, out)
        for m in range(_first_polynomial(arguments)):
            state.states[state.progress.old + m, lane] = space.one_out[0, m]
