"""Cases enter lanes and leave them: made ahead, as many together as there are lanes, and entered one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..methods.status import RUNNING, Status
from ..steps.step_control import largest_step
from ..subset.compiled_subset import call_code, call_test, compiled_subset, element, prefetch, row, take
from .step_records import end_record, refuse_record
from .sweep_arguments import Columns, SweepArguments
from .workspace import ATTEMPTS, END, FIRST, IDLE, LONG_ENDS, MADE, NEXT, NOW, REJECTIONS, SHORTENED


@compiled_subset
def begin_lanes(arguments: SweepArguments) -> None:
    """Begin with no cases in the lanes."""
    state, limits = arguments.state, arguments.limits
    progress, settings, constants = state.progress, state.settings, state.constants
    lanes = state.clock.shape[1]
    progress.coming = progress.last = progress.loaded = progress.filled = progress.place = 0
    progress.active, progress.old, progress.look = 0, 0, (1 << lanes) - 1
    for lane in range(lanes):
        state.numbers.case[lane], state.numbers.status[lane] = -1, IDLE
        for m in range(constants.shape[0]):
            constants[m, lane] = 1.0
        for m in range(2, limits.shape[1]):
            settings[m, lane] = state.settings_ahead[m, lane] = limits[0, m]


@compiled_subset
def runs_on(arguments: SweepArguments, lane: int) -> bool:
    """Return whether the case of a lane runs on and there is nothing to record, with limits for its next step.

    `resumes` would find the same: this is what most lanes need after most steps, which has to be quick.
    """
    if arguments.t_eval.size > 0 or arguments.state.numbers.status[lane] != RUNNING:
        return False
    _limit_step(arguments, lane)
    return True


@compiled_subset
def _limit_step(arguments: SweepArguments, lane: int) -> None:
    """Set the largest size of the next step of a lane."""
    state = arguments.state
    largest = largest_step(state.clock[NOW, lane], state.clock[END, lane], arguments.limits[0, 0])
    if state.tally[SHORTENED, lane] > 0.0:
        largest, state.tally[SHORTENED, lane] = min(largest, state.tally[SHORTENED, lane]), 0.0
    state.settings[0, lane] = largest


@compiled_subset
def resumes(arguments: SweepArguments, lane: int) -> bool:
    """Return whether the case of a lane runs on, with limits for its next step; one that has ended is handed in."""
    numbers = arguments.state.numbers
    if numbers.case[lane] < 0:
        return False
    if arguments.t_eval.size > 0:
        _record_reached(arguments, lane)
    if numbers.status[lane] != RUNNING:
        _store_results(arguments, lane)
        return False
    _limit_step(arguments, lane)
    return True


@compiled_subset
def _record_reached(arguments: SweepArguments, lane: int) -> None:
    """Record the state of a lane at the times to record that it has reached, and set which is the next."""
    state, t_eval, n = arguments.state, arguments.t_eval, arguments.shape.n
    i, old, time = state.numbers.case[lane], state.progress.old, state.clock[NOW, lane]
    sampled, direction = state.numbers.sampled[lane], state.settings[1, lane]
    while sampled < t_eval.size and (t_eval[sampled] - time) * direction <= 0.0:
        for m in range(n):
            arguments.samples[i, sampled * n + m] = state.states[old + m, lane]
        sampled += 1
    state.numbers.sampled[lane] = sampled
    state.clock[NEXT, lane] = t_eval[sampled] if sampled < t_eval.size else state.clock[END, lane]


@compiled_subset
def _store_results(arguments: SweepArguments, lane: int) -> None:
    """Write the results of a case that has ended, and leave its lane without one."""
    state, numbers, ends = arguments.state, arguments.state.numbers, arguments.ends
    i = numbers.case[lane]
    for m in range(arguments.shape.n):
        arguments.out[i, m] = state.states[state.progress.old + m, lane]
    ends[i, 0], ends[i, 1] = state.clock[NOW, lane], numbers.status[lane]
    ends[i, 2] = state.tally[ATTEMPTS, lane] - state.tally[REJECTIONS, lane]
    if ends.shape[1] == LONG_ENDS:
        ends[i, 3], ends[i, 4] = state.tally[ATTEMPTS, lane], float(numbers.sampled[lane])
        if arguments.rows.record.shape[0] > 0:
            end_record(arguments, i, numbers.sampled[lane], state.clock[NOW, lane], lane)
    numbers.case[lane], numbers.status[lane] = -1, IDLE
    state.settings[0, lane] = 0.0
    state.progress.active -= 1


@compiled_subset
def next_case_is_loaded(arguments: SweepArguments) -> bool:
    """Return whether there is another case, which is loaded then, with others, where all before have been entered."""
    progress, shape = arguments.state.progress, arguments.shape
    if progress.place < progress.filled:
        return True
    if progress.coming == progress.last and progress.last < shape.cases:
        progress.coming = min(take(arguments.turn, shape.share), shape.cases)
        progress.last = min(progress.coming + shape.share, shape.cases)
    if progress.coming == progress.last:
        return False
    progress.loaded, progress.place = progress.coming, 0
    progress.filled = min(arguments.state.clock.shape[1], progress.last - progress.coming)
    _load_cases(arguments, progress.loaded, progress.filled)
    progress.coming += progress.filled
    return True


@compiled_subset
def _fill(columns: Columns, column: int, rows: FloatArray, n_columns: int, first: int, count: int) -> None:
    """Write the values of cases in `n_columns` columns to the first rows."""
    for m in range(n_columns):
        address = columns.address[column + m]
        if columns.stride[column + m] == 0:
            value = element(address, 0)
            for lane in range(rows.shape[1]):
                rows[m, lane] = value
        elif count == rows.shape[1]:
            for lane in range(rows.shape[1]):
                rows[m, lane] = element(address, first + lane)
            prefetch(address, first + 2 * rows.shape[1])
        else:
            for lane in range(rows.shape[1]):
                rows[m, lane] = element(address, first + min(lane, count - 1))


@compiled_subset
def fill_by_number(columns: Columns, column: int, rows: FloatArray, n_columns: int, cases: NDArray[np.int64]) -> None:
    """Write the values of one case a lane, by its number, in `n_columns` columns to the first rows."""
    for m in range(n_columns):
        address, stride = columns.address[column + m], columns.stride[column + m]
        for lane in range(rows.shape[1]):
            rows[m, lane] = element(address, stride * cases[lane])


@compiled_subset
def _load_cases(arguments: SweepArguments, first: int, count: int) -> None:
    """Make constants, states and memory of `count` cases from number `first` on, as many as there are lanes at most."""
    kernels, shape, columns, state = arguments.kernels, arguments.shape, arguments.columns, arguments.state
    if arguments.rows.states.shape[0] > 0:
        _load_rows(arguments, first, count)
        return
    check, lanes, n = kernels.check, state.clock.shape[1], shape.n
    clock, settings, given, begun = state.clock_ahead, state.settings_ahead, state.given, state.begun
    target = row(state.constants_ahead, 0)
    _fill(columns, 0, clock, 2, first, count)
    _set_directions(arguments)
    if state.progress.common != MADE:
        _make_constants(arguments, first, count)
    _fill(columns, 2 + shape.parameters, given, shape.given, first, count)
    finite = state.progress.finite & call_test(check, row(clock, 0), 2, 0, 0, 0)
    finite &= call_test(check, row(given, 0), shape.given, 0, 0, 0)
    call_code(kernels.start, row(clock, 0), row(given, 0), target, 0, row(begun, 0))
    fits = call_test(check, row(begun, 0), n, shape.checks, 0, 0)
    for lane in range(lanes):
        state.numbers.loaded[lane] = RUNNING if fits >> lane & 1 else Status.INITIAL_STATE
        if not finite >> lane & 1:
            state.numbers.loaded[lane] = Status.NON_FINITE
    if kernels.begin != 0:
        memory = row(begun, n + shape.checks)
        call_code(kernels.begin, row(clock, 0), row(begun, 0), target, row(settings, 0), memory)


@compiled_subset
def _make_constants(arguments: SweepArguments, first: int, count: int) -> None:
    """Make constants of `count` cases from number `first` on; those of all cases are written to all lanes at once."""
    state, check, progress = arguments.state, arguments.kernels.check, arguments.state.progress
    given, ahead, size = row(state.given, 0), state.constants_ahead, arguments.shape.parameters
    _fill(arguments.columns, 2, state.given, size, first, count)
    progress.finite = call_test(check, given, size, 0, 0, 0)
    call_code(arguments.kernels.prepare, given, 0, 0, 0, row(ahead, 0))
    progress.finite &= call_test(check, row(ahead, 0), ahead.shape[0], 0, 0, 0)
    if progress.common != 0:
        progress.common = MADE
        for m in range(ahead.shape[0]):
            for lane in range(ahead.shape[1]):
                state.constants[m, lane] = ahead[m, lane]


@compiled_subset
def _set_directions(arguments: SweepArguments) -> None:
    """Set the largest first step and the direction of time of the cases that are loaded."""
    clock, settings = arguments.state.clock_ahead, arguments.state.settings_ahead
    for lane in range(clock.shape[1]):
        t0, t1 = clock[0, lane], clock[1, lane]
        settings[0, lane], settings[1, lane] = largest_step(t0, t1, arguments.limits[0, 0]), 1.0 if t1 >= t0 else -1.0


@compiled_subset
def _load_rows(arguments: SweepArguments, first: int, count: int) -> None:
    """Take times, constants and states of cases as they are given, and make what the first step remembers."""
    kernels, rows, state, n = arguments.kernels, arguments.rows, arguments.state, arguments.shape.n
    check, begun, constants = kernels.check, row(state.begun, 0), row(state.constants_ahead, 0)
    for lane in range(state.clock.shape[1]):
        i = first + min(lane, count - 1)
        own = i if rows.times.shape[0] > 1 else 0
        state.clock_ahead[0, lane] = rows.times[own, 0]
        state.clock_ahead[1, lane] = rows.times[own, rows.times.shape[1] - 1]
        own = i if rows.states.shape[0] > 1 else 0
        for m in range(n):
            state.begun[m, lane] = rows.states[own, m]
        own = i if rows.constants.shape[0] > 1 else 0
        for m in range(rows.constants.shape[1]):
            state.constants_ahead[m, lane] = rows.constants[own, m]
    _set_directions(arguments)
    finite = call_test(check, row(state.clock_ahead, 0), 2, 0, 0, 0) & call_test(check, begun, n, 0, 0, 0)
    finite &= call_test(check, constants, rows.constants.shape[1], 0, 0, 0)
    for lane in range(state.clock.shape[1]):
        state.numbers.loaded[lane] = RUNNING if finite >> lane & 1 else Status.NON_FINITE
    if kernels.begin != 0:
        clock, settings = row(state.clock_ahead, 0), row(state.settings_ahead, 0)
        call_code(kernels.begin, clock, begun, constants, settings, row(state.begun, n))


@compiled_subset
def enter_next(arguments: SweepArguments, lane: int) -> bool:
    """Enter the next loaded case in a lane; one that cannot begin is handed in at once. Return whether it entered."""
    state, progress = arguments.state, arguments.state.progress
    place = progress.place
    i = progress.loaded + place
    progress.place += 1
    _keep_start(arguments, i, place)
    if state.numbers.loaded[place] != RUNNING:
        _refuse(arguments, i, place)
        return False
    _enter_state(arguments, lane, place)
    t0, t1 = state.clock_ahead[0, place], state.clock_ahead[1, place]
    state.clock[NOW, lane], state.clock[END, lane], state.clock[NEXT, lane] = t0, t1, t1
    state.settings[1, lane] = state.settings_ahead[1, place]
    state.tally[ATTEMPTS, lane], state.tally[REJECTIONS, lane], state.tally[FIRST, lane] = 0.0, 0.0, t0
    state.tally[SHORTENED, lane] = 0.0
    state.numbers.case[lane], state.numbers.sampled[lane] = i, 0
    state.numbers.status[lane] = Status.SUCCESS if t0 == t1 else RUNNING
    progress.active += 1
    return True


@compiled_subset
def _keep_start(arguments: SweepArguments, i: int, place: int) -> None:
    """Write the constants and the first state of a loaded case where they are to be kept."""
    state, constants, states = arguments.state, arguments.kept.constants, arguments.kept.states
    if constants.shape[0] > 0:
        for m in range(constants.shape[1]):
            constants[i, m] = state.constants_ahead[m, place]
    if states.shape[0] > 0:
        for m in range(states.shape[1]):
            states[i, m] = state.begun[m, place]


@compiled_subset
def _refuse(arguments: SweepArguments, i: int, place: int) -> None:
    """Write the results of a loaded case that cannot begin."""
    state, rows, ends, n = arguments.state, arguments.rows, arguments.ends, arguments.shape.n
    t = state.clock_ahead[0, place]
    for m in range(n):
        arguments.out[i, m] = state.begun[m, place] if rows.states.shape[0] > 0 else np.nan
    ends[i, 0], ends[i, 1], ends[i, 2] = t, state.numbers.loaded[place], 0.0
    if ends.shape[1] == LONG_ENDS:
        ends[i, 3], ends[i, 4] = 0.0, 0.0
        if rows.record.shape[0] > 0:
            refuse_record(arguments, i, t, place)


@compiled_subset
def _enter_state(arguments: SweepArguments, lane: int, place: int) -> None:
    """Copy constants, state and memory of a loaded case to a lane."""
    state, shape, old = arguments.state, arguments.shape, arguments.state.progress.old
    if state.progress.common != MADE:
        for m in range(state.constants.shape[0]):
            state.constants[m, lane] = state.constants_ahead[m, place]
    state.states[old + shape.n + shape.events_with_series, lane] = 0.0
    if arguments.kernels.begin != 0:
        for m in range(shape.n + 2 + shape.memory):
            state.states[old + m, lane] = state.begun[shape.n + shape.checks + m, place]
    for m in range(shape.n):
        state.states[old + m, lane] = state.begun[m, place]
