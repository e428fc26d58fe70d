"""A run of one case that other programs call: its steps are those of prepared runs, and it takes down where they began.

Its memory is that of the caller, so that as many threads as like may run it at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..methods.status import RUNNING, Status
from .arguments import Matrix, Vector
from .compiled_subset import call_code, compiled_subset, row
from .prepared_loop import PreparedArguments, attempt
from .step_control import largest_step, status_after

__all__ = ["LOOP", "ForeignArguments"]


class ForeignArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    run : PreparedArguments
        The run, whose parameters are not read, with its constants; the memory of the rest may hold anything.
    reads : (m,)
        What a step reads behind the largest step and the direction of time.
    start : (n_y,)
        The first state.
    times : (n_t,)
        From the start of the run to its end, in order.
    end : (n_y,)
        Gets the last state.
    numbers : (5,)
        Gets how many rows of a record were written, the time that was reached, status, steps and attempts.
    rows : (room, 2 + n_y) or (n_t, 1 + n_y)
        Gets a record of the steps, where each began, its size and the state there, and zeros behind the last; or the
        time and the state where those began that pass over the times.
    """

    run: PreparedArguments
    reads: Vector
    start: Vector
    times: Vector
    end: Vector
    numbers: Vector
    rows: Matrix


@compiled_subset
def LOOP(arguments: ForeignArguments) -> int:
    """Run from the first state to the last; return the status."""
    run, rows, numbers = arguments.run, arguments.rows, arguments.numbers
    progress, states, n = run.progress, run.states, run.n
    every, forward = rows.shape[1] == n + 2, run.limits.t1 >= run.limits.t0
    written, status = 0, _begin(arguments)
    while status == RUNNING:
        t, old, steps = progress.t, progress.row, progress.steps
        status = attempt(run)
        if progress.steps == steps:
            continue
        if not every:
            written = _pass_over(arguments, written, t, old, status == Status.SUCCESS, forward)
        elif written < rows.shape[0]:
            rows[written, 0] = t
            rows[written, 1] = states[progress.row, n] if forward else -states[progress.row, n]
            for m in range(n):
                rows[written, 2 + m] = states[old, m]
            written += 1
    numbers[0], numbers[1], numbers[2] = float(written), progress.t, float(status)
    numbers[3], numbers[4] = float(progress.steps), float(progress.attempts)
    for m in range(n):
        arguments.end[m] = states[progress.row, m]
    if every:
        for number in range(written, rows.shape[0]):
            for m in range(2 + n):
                rows[number, m] = 0.0
    else:
        _pass_over(arguments, written, progress.t, progress.row, True, forward)
    return status


@compiled_subset
def _begin(arguments: ForeignArguments) -> int:
    """Take the first state, and compute what the first step remembers; return the status."""
    run = arguments.run
    limits, progress, states, settings, n = run.limits, run.progress, run.states, run.settings, run.n
    progress.t, progress.end, progress.steps, progress.attempts, progress.row = limits.t0, limits.t1, 0, 0, 0
    settings[0, 0], settings[0, 1] = 0.0, 1.0 if limits.t1 >= limits.t0 else -1.0
    for m in range(arguments.reads.size):
        settings[0, 2 + m] = arguments.reads[m]
    finite = True
    for m in range(n):
        states[0, m] = arguments.start[m]
        finite = finite and math.isfinite(arguments.start[m])
    for m in range(n, states.shape[1]):
        states[0, m] = 0.0
    for m in range(run.constants.shape[0]):
        finite = finite and math.isfinite(run.constants[m, 0])
    if not finite:
        return Status.NON_FINITE
    status = status_after(limits.t0 == limits.t1, 0.0, limits.attempts)
    if run.kernels.start != 0 and status == RUNNING:
        run.clock[0, 0], settings[0, 0] = limits.t0, largest_step(limits.t0, limits.t1, limits.largest)
        call_code(
            run.kernels.start,
            row(run.clock, 0),
            row(states, 0),
            row(run.constants, 0),
            row(settings, 0),
            row(states, 1),
        )
        progress.row = 1
    return status


@compiled_subset
def _pass_over(arguments: ForeignArguments, written: int, t: float, at: int, last: bool, forward: bool) -> int:
    """Write where a step began, its time and the row of its state, for times that it passes over; return their number.

    They are all that are left where it is the `last`.
    """
    rows, times, progress, states = arguments.rows, arguments.times, arguments.run.progress, arguments.run.states
    while written < rows.shape[0]:
        ahead = progress.t - times[written] if forward else times[written] - progress.t
        if not last and ahead <= 0.0:
            return written
        rows[written, 0] = t
        for m in range(arguments.run.n):
            rows[written, 1 + m] = states[at, m]
        written += 1
    return written
