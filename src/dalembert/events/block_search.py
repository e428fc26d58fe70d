"""Search for events in steps whose polynomials are known: the loop, and its arguments."""

from __future__ import annotations

from typing import NamedTuple

from ..lanes.workspace import EventKernels, EventWorkspace
from ..subset.arguments import Matrix, Record, Vector
from ..subset.compiled_subset import compiled_subset, row
from .event_resolution import begin_signs, go_on, resolve, starts, zeros_at_end
from .event_search import NOTHING, scan

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
