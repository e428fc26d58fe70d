"""Records of the steps of a case that runs alone, from which its trajectory is made."""

from __future__ import annotations

from .compiled_subset import compiled_subset
from .projection import PENDING
from .sweep_arguments import SweepArguments
from .workspace import ATTEMPTS, BEFORE, NOW

__all__ = [
    "ATTEMPTS_AT",
    "ENDED_AT",
    "END_AT",
    "FIRST_AT",
    "START_AT",
    "record_ends",
    "record_steps",
    "records_are_full",
]

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
            steps[place, START_AT], steps[place, END_AT] = state.tally[BEFORE, lane], state.clock[NOW, lane]
            steps[place, ATTEMPTS_AT] = state.tally[ATTEMPTS, lane]
            for m in range(n):
                steps[place, FIRST_AT + m] = state.states[old + m, lane]
            for m in range(n * terms):
                steps[place, FIRST_AT + 2 * n + m] = state.states[first + m, lane]


@compiled_subset
def record_ends(arguments: SweepArguments) -> None:
    """Record where the steps ended that were accepted."""
    steps, state, n = arguments.steps, arguments.state, arguments.shape.n
    if steps.shape[0] == 0:
        return
    for lane in range(state.clock.shape[1]):
        if state.numbers.mark[lane] == PENDING:
            place = state.progress.recorded
            steps[place, ENDED_AT] = state.clock[NOW, lane]
            for m in range(n):
                steps[place, FIRST_AT + n + m] = state.states[state.progress.old + m, lane]
            state.progress.recorded += 1
