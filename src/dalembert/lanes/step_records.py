"""Records of steps: of a case that runs alone, for its trajectory, and of many cases for XLA; exact sums of steps."""

from __future__ import annotations

from ..arrays import FloatArray
from ..steps.projection import PENDING
from ..subset.compiled_subset import compiled_subset
from .sweep_arguments import SweepArguments
from .workspace import ATTEMPTS, BEFORE, END, NOW

START_AT, END_AT, ENDED_AT, ATTEMPTS_AT, FIRST_AT = range(5)
"""Columns of a record: the times where the step starts, where it ended, and where it ends after events cut it; attempts
so far. Then come the states at both ends, and the coefficients of the polynomial of each component."""


@compiled_subset
def records_are_full(arguments: SweepArguments) -> bool:
    """Return whether the loop has to pause, because there is no room for what the next step may bring."""
    progress, occurrences = arguments.state.progress, arguments.workspace.occurrences
    if arguments.steps.shape[0] == 0:
        return False
    full = progress.recorded == arguments.steps.shape[0]
    return full or 2.0 * occurrences[0, 0] > float(occurrences.shape[0])


@compiled_subset
def exact_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b as rounded, and the rounding error (Knuth's two-sum)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@compiled_subset
def compensate_steps(arguments: SweepArguments) -> None:
    """Sum time and state of Taylor steps that were accepted with compensation, where a run alone has that.

    See `dalembert.loops.prepared_loop`.
    """
    low, state, shape = arguments.workspace.low, arguments.state, arguments.shape
    if low.shape[0] == 0:
        return
    states, n, old = state.states, shape.n, state.progress.old
    before, first = states.shape[0] // 2 - old, old + n + shape.events_with_series
    for lane in range(state.clock.shape[1]):
        if state.numbers.mark[lane] == PENDING:
            h = state.settings[1, lane] * states[first, lane]
            for m in range(n):
                move = 0.0
                for k in range(shape.degree, 0, -1):
                    move = (move + states[first + 2 + m * (shape.degree + 1) + k, lane]) * h
                states[old + m, lane], low[m, lane] = exact_sum(states[before + m, lane], move + low[m, lane])
            if state.clock[NOW, lane] == state.clock[END, lane]:
                low[n, lane] = 0.0
            else:
                state.clock[NOW, lane], low[n, lane] = exact_sum(state.tally[BEFORE, lane], h + low[n, lane])


@compiled_subset
def drop_compensation(arguments: SweepArguments, lane: int) -> None:
    """Forget the rounding errors of sums in a lane whose state is another one now."""
    for m in range(arguments.workspace.low.shape[0]):
        arguments.workspace.low[m, lane] = 0.0


@compiled_subset
def record_steps(arguments: SweepArguments) -> None:
    """Record the steps that were accepted, before events cut them."""
    steps, state, shape = arguments.steps, arguments.state, arguments.shape
    if steps.shape[0] == 0:
        return
    old, n, terms = state.progress.old, shape.n, shape.degree + 1
    first = old + n + shape.events_with_series + 2 + shape.memory
    for lane in range(state.clock.shape[1]):
        if state.numbers.mark[lane] == PENDING:
            place = state.progress.recorded
            arguments.workspace.occurrences[0, 1] = float(place)
            steps[place, START_AT], steps[place, END_AT] = state.tally[BEFORE, lane], state.clock[NOW, lane]
            steps[place, ATTEMPTS_AT] = state.tally[ATTEMPTS, lane]
            for m in range(n):
                steps[place, FIRST_AT + m] = state.states[old + m, lane]
            for m in range(n * terms):
                steps[place, FIRST_AT + 2 * n + m] = state.states[first + m, lane]


@compiled_subset
def record_end(arguments: SweepArguments, lane: int) -> None:
    """Record where the step of a lane ended, before events map the state there."""
    steps, state, n = arguments.steps, arguments.state, arguments.shape.n
    if steps.shape[0] == 0:
        return
    place = state.progress.recorded
    steps[place, ENDED_AT] = state.clock[NOW, lane]
    for m in range(n):
        steps[place, FIRST_AT + n + m] = state.states[state.progress.old + m, lane]
    state.progress.recorded += 1


# Records of the steps of cases: where each began, its size and the state there, or those that pass over times.


@compiled_subset
def record_cases(arguments: SweepArguments) -> None:
    """Record the steps that were accepted."""
    state, shape = arguments.state, arguments.shape
    states, numbers, old, n = state.states, state.numbers, state.progress.old, shape.n
    begun, record = states.shape[0] // 2 - old, arguments.rows.record
    room = record.shape[0] // shape.cases
    for lane in range(state.clock.shape[1]):
        if numbers.mark[lane] != PENDING:
            continue
        i, written, before = numbers.case[lane], numbers.sampled[lane], state.tally[BEFORE, lane]
        if record.shape[1] == n + 2:
            if written < room:
                place = i * room + written
                record[place, 0] = before
                record[place, 1] = state.settings[1, lane] * states[old + n + shape.events_with_series, lane]
                for m in range(n):
                    record[place, 2 + m] = states[begun + m, lane]
                numbers.sampled[lane] = written + 1
            continue
        while written < room and _is_passed(arguments, i, written, state.clock[NOW, lane], state.clock[END, lane]):
            record[i * room + written, 0] = before
            for m in range(n):
                record[i * room + written, 1 + m] = states[begun + m, lane]
            written += 1
        numbers.sampled[lane] = written


@compiled_subset
def _is_passed(arguments: SweepArguments, i: int, number: int, now: float, end: float) -> bool:
    """Return whether a time of a case lies before the end of a step, or this is the end of the run."""
    times = arguments.rows.times
    mine = i if times.shape[0] > 1 else 0
    forward = times[mine, times.shape[1] - 1] >= times[mine, 0]
    ahead = now - times[mine, number] if forward else times[mine, number] - now
    return ahead > 0.0 or now == end


@compiled_subset
def end_record(arguments: SweepArguments, i: int, written: int, t: float, lane: int) -> None:
    """Write the end of the run of a case in the rest of its rows, as steps of size 0."""
    state, record, n = arguments.state, arguments.rows.record, arguments.shape.n
    room, first = record.shape[0] // arguments.shape.cases, record.shape[1] - n
    for number in range(i * room + written, i * room + room):
        record[number, 0] = t
        if first == 2:
            record[number, 1] = 0.0
        for m in range(n):
            record[number, first + m] = state.states[state.progress.old + m, lane]


@compiled_subset
def refuse_record(arguments: SweepArguments, i: int, t: float, place: int) -> None:
    """Write the start of a loaded case that cannot begin in its rows, as steps of size 0."""
    state, record, n = arguments.state, arguments.rows.record, arguments.shape.n
    room, first = record.shape[0] // arguments.shape.cases, record.shape[1] - n
    for number in range(i * room, i * room + room):
        record[number, 0] = t
        if first == 2:
            record[number, 1] = 0.0
        for m in range(n):
            record[number, first + m] = state.begun[m, place]


@compiled_subset
def move_compensated(states: FloatArray, old: int, new: int, h: float, low: FloatArray) -> None:
    """Write to ``states[new, :n]`` the state ``states[old, :n]`` moved by the series in that row, with compensation."""
    n = low.size - 1
    width = (states.shape[1] - n - 2) // n
    for i in range(n):
        first = n + 2 + i * width
        move = 0.0
        for k in range(width - 1, 0, -1):
            move = (move + states[new, first + k]) * h
        states[new, i], low[i] = exact_sum(states[old, i], move + low[i])
