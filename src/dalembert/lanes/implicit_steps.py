"""Steps of the implicit method in the lanes of a loop, by the functions of single runs.

A step gives what a compiled attempt of a Runge-Kutta step gives (`dalembert.transforms.runge_kutta_parts`): the state,
the size of the step, 0 where it is rejected, what failed, the size of the next one, and its polynomials.
"""

from __future__ import annotations

from ..arrays import FloatArray
from ..methods.status import RUNNING, Status
from ..steps.implicit_attempts import attempt, propose
from ..steps.implicit_loop import begin_motions
from ..steps.implicit_stages import write_polynomial
from ..steps.lane_progress import (
    BEGINS,
    FINITE,
    NORM,
    QUOTIENT,
    RESULT,
    RUNS,
    STEP,
    T_NEW,
    enter_lane,
    leave_lane,
    marked,
)
from ..steps.step_control import ACCEPTED
from ..subset.compiled_subset import compiled_subset, lane_count, lanes
from ..transforms.runge_kutta_parts import CONTROLS, PROPOSAL_AT
from .row_steps import RowSteps
from .workspace import ATTEMPTS, END, NOW, LaneState

_NOTHING, _MOTION, _PIECE = 0, 1, 2
"""Kinds of beginnings in a lane: none, that of a motion, or that of a piece of one, behind a stop."""


@compiled_subset
def begin_implicit_step(rows: RowSteps, state: LaneState, lane: int, t1: float, fresh: bool, behind: bool) -> None:
    """Set the progress of a lane before its step, and what begins there.

    Parameters
    ----------
    rows, state
        Memory of the implicit method, and of the lanes.
    lane
    t1
        End of the case.
    fresh, behind
        Whether a motion begins here, and whether it continues behind a stop.
    """
    progress, states, old, n = rows.run.progress, state.states, state.progress.old, rows.settings.kept
    flags, place = rows.space.flags, n + PROPOSAL_AT
    flags[RUNS, lane] = 1 if state.numbers.status[lane] == RUNNING else 0
    flags[BEGINS, lane] = _NOTHING
    if flags[RUNS, lane] == 0:
        return
    enter_lane(rows.space.numbers, rows.run, lane)
    progress.row, progress.t, progress.end, progress.t1 = 0, state.clock[NOW, lane], state.clock[END, lane], t1
    progress.direction, progress.size = state.settings[1, lane], states[old + place, lane]
    if (fresh or behind) and (rows.known[lane] == 0 or state.tally[ATTEMPTS, lane] == 0.0):
        flags[BEGINS, lane] = _MOTION if fresh else _PIECE
        if fresh:
            progress.size, progress.steps, progress.retried, progress.fresh = rows.settings.first_step, 0, 0, 0
            progress.rejected, progress.factored, progress.unlimited = 0, 0.0, 0.0
    rows.known[lane] = 1
    leave_lane(rows.space.numbers, rows.run, lane)


@compiled_subset
def implicit_steps(rows: RowSteps, state: LaneState) -> None:
    """Attempt a step in every lane that has a case, from one half of the states to the other."""
    run, space, states, flags, old = rows.run, rows.space, state.states, rows.space.flags, state.progress.old
    n, new, count = rows.settings.kept, state.states.shape[0] // 2 - state.progress.old, lane_count()
    if marked(flags, BEGINS):
        _begin(rows, state)
    attempt(rows.codes, rows.settings, space, run)
    for lane in range(count):
        if flags[RUNS, lane] != 0:
            _write_outcome(rows, state, lane, new)
    for m in range(n):
        for lane in lanes():
            at, accepted = m * count + lane, flags[RUNS, lane] != 0 and flags[RESULT, lane] == ACCEPTED
            value = run.work[1, at] if accepted else run.work[0, at]
            run.work[0, at] = value
            states[new + m, lane] = value if flags[RUNS, lane] != 0 else states[old + m, lane]
    for m in range(n, run.work.shape[1] // count):
        for lane in lanes():
            at, accepted = m * count + lane, flags[RUNS, lane] != 0 and flags[RESULT, lane] == ACCEPTED
            run.work[0, at] = run.work[1, at] if accepted else run.work[0, at]


@compiled_subset
def _begin(rows: RowSteps, state: LaneState) -> None:
    """Begin motions, or continue them behind stops; lanes in which none can begin do not run."""
    run, space, flags, numbers = rows.run, rows.space, rows.space.flags, rows.space.numbers
    n, count, old = rows.settings.kept, lane_count(), state.progress.old
    new = state.states.shape[0] // 2 - old
    for m in range(n):
        for lane in lanes():
            at, begun = m * count + lane, state.states[old + m, lane]
            run.work[0, at] = begun if flags[BEGINS, lane] != 0 else run.work[0, at]
    begin_motions(rows.codes, rows.settings, space, run)
    for lane in range(count):
        if flags[BEGINS, lane] == _MOTION and numbers[FINITE, lane] != 0.0:
            flags[RUNS, lane] = 0
            state.states[new + n, lane], state.states[new + n + 1, lane] = 0.0, float(Status.NON_FINITE)
            state.states[new + n + PROPOSAL_AT, lane] = 0.0
            for m in range(n):
                state.states[new + m, lane] = state.states[old + m, lane]


@compiled_subset
def _write_outcome(rows: RowSteps, state: LaneState, lane: int, new: int) -> None:
    """Write the size of the step of a lane, what failed, or 0, and its polynomials where there is room."""
    run, space, states, n = rows.run, rows.space, state.states, rows.settings.kept
    numbers, result, size, failed = space.numbers, space.flags[RESULT, lane], 0.0, 0.0
    enter_lane(numbers, run, lane)
    if result != ACCEPTED:
        if result == Status.NON_FINITE or result == Status.PROJECTION_FAILED:
            failed = float(result)
    else:
        if states.shape[0] // 2 > n + 2 + CONTROLS:
            _write_polynomials(rows, states, new + n + 2 + CONTROLS, lane)
        propose(run, numbers[STEP, lane], numbers[T_NEW, lane], numbers[NORM, lane], numbers[QUOTIENT, lane])
        run.progress.steps += 1
        rows.known[lane] = 0
        size = abs(numbers[STEP, lane])
    states[new + n, lane], states[new + n + 1, lane] = size, failed
    states[new + n + PROPOSAL_AT, lane] = run.progress.size
    leave_lane(numbers, run, lane)


@compiled_subset
def _write_polynomials(rows: RowSteps, states: FloatArray, first: int, lane: int) -> None:
    """Write the polynomials of the step of a lane to rows from one on."""
    n, terms = rows.settings.kept, rows.settings.degree + 1
    write_polynomial(rows.run.work, 0, 1, lane, rows.run.pieces, 0, n)
    for m in range(n):
        for k in range(terms):
            states[first + m * terms + k, lane] = rows.run.pieces[0, 1 + k * n + m]
