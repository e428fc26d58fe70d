"""Records of the steps of cases: where each began, its size and the state there, or those that pass over times."""

from __future__ import annotations

from .compiled_subset import compiled_subset
from .projection import PENDING
from .sweep_arguments import SweepArguments
from .workspace import BEFORE, END, NOW

__all__ = ["end_record", "record_cases", "refuse_record"]


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
