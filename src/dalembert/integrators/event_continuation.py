"""Events of cases that are cut in segments: what a lane remembers of them from one segment to the next."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import FloatArray
from .compiled_subset import compiled_subset
from .sweep_arguments import SweepArguments
from .workspace import END, FIRST

__all__ = ["continue_case", "end_of_case", "keep_case", "not_begun", "span_of_case"]

START, STOP, JUMPED, SOON, FRESH, PER_EVENT = range(6)
"""Columns of ``EventWorkspace.continued``; from the last on sign, zero and what was seen of each event."""


def not_begun(spans: FloatArray, events: int) -> FloatArray:
    """Return the rows of ``EventWorkspace.continued`` for cases with spans (k, 2) that have not begun."""
    rows = np.full((len(spans), PER_EVENT + 3 * events), np.nan)
    rows[:, [START, STOP]] = spans
    return rows


@compiled_subset
def end_of_case(arguments: SweepArguments, lane: int) -> float:
    """Return the time at which the case of a lane ends, where it is cut in segments, or the end of its next steps."""
    continued = arguments.workspace.continued
    if continued.shape[0] > 0:
        return continued[arguments.state.numbers.case[lane], STOP]
    return arguments.state.clock[END, lane]


@compiled_subset
def span_of_case(arguments: SweepArguments, lane: int) -> float:
    """Return how long the case of a lane lasts."""
    begin = arguments.state.tally[FIRST, lane]
    if arguments.workspace.continued.shape[0] > 0:
        begin = arguments.workspace.continued[arguments.state.numbers.case[lane], START]
    return abs(end_of_case(arguments, lane) - begin)


@compiled_subset
def continue_case(arguments: SweepArguments, lane: int) -> None:
    """Set what is remembered of the events of the case that has entered a lane, unless it begins there."""
    space, case = arguments.workspace, arguments.state.numbers.case[lane]
    if math.isnan(space.continued[case, FRESH]):
        return
    arguments.state.numbers.fresh[lane] = 1 if space.continued[case, FRESH] > 0.0 else 0
    space.jumped[lane, 0], space.jumped[lane, 1] = space.continued[case, JUMPED], space.continued[case, SOON]
    for e in range(arguments.events.directions.size):
        place = PER_EVENT + 3 * e
        space.signs[lane, e], space.zero[lane, e] = space.continued[case, place], space.continued[case, place + 1]
        space.seen[lane, e] = space.continued[case, place + 2]


@compiled_subset
def keep_case(arguments: SweepArguments, lane: int) -> None:
    """Keep what is remembered of the events of the case of a lane."""
    space, case = arguments.workspace, arguments.state.numbers.case[lane]
    space.continued[case, FRESH] = float(arguments.state.numbers.fresh[lane])
    space.continued[case, JUMPED], space.continued[case, SOON] = space.jumped[lane, 0], space.jumped[lane, 1]
    for e in range(arguments.events.directions.size):
        place = PER_EVENT + 3 * e
        space.continued[case, place], space.continued[case, place + 1] = space.signs[lane, e], space.zero[lane, e]
        space.continued[case, place + 2] = space.seen[lane, e]
