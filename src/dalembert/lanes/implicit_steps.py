"""Steps of the implicit method in the one lane of a loop, by the functions of single runs.

A step gives what a compiled attempt of a Runge-Kutta step gives (`dalembert.transforms.runge_kutta_parts`): the state,
the size of the step, 0 where it is rejected, what failed, the size of the next one, and its polynomials.
"""

from __future__ import annotations

from ..methods.status import Status
from ..steps.implicit_loop import attempt, begin_motion, begin_piece, propose
from ..steps.implicit_stages import write_polynomial
from ..steps.step_control import ACCEPTED
from ..subset.compiled_subset import compiled_subset
from ..transforms.runge_kutta_parts import CONTROLS, PROPOSAL_AT
from .row_steps import RowSteps
from .workspace import ATTEMPTS, END, NOW, LaneState


@compiled_subset
def implicit_step(rows: RowSteps, state: LaneState, n: int, t1: float, fresh: bool, behind: bool) -> None:
    """Attempt a step of the case in the lane, from one half of the states to the other.

    Parameters
    ----------
    rows, state
        Memory of the implicit method, and of the lane.
    n
        Components of the state.
    t1
        End of the case.
    fresh, behind
        Whether a motion begins here, and whether it continues behind a stop.
    """
    run, states, old = rows.run, state.states, state.progress.old
    progress, new, finite = run.progress, states.shape[0] // 2 - old, True
    progress.t, progress.end, progress.t1 = state.clock[NOW, 0], state.clock[END, 0], t1
    progress.direction, progress.size = state.settings[1, 0], states[old + n + PROPOSAL_AT, 0]
    if (fresh or behind) and (rows.place.known == 0 or state.tally[ATTEMPTS, 0] == 0.0):
        for m in range(n):
            run.work[progress.row, m] = states[old + m, 0]
        finite = _begin(rows, fresh)
    rows.place.known = 1
    size, failed = 0.0, 0.0
    if not finite:
        failed, progress.size = float(Status.NON_FINITE), 0.0
    else:
        size, failed = _attempt(rows, state, n)
    for m in range(n):
        states[new + m, 0] = run.work[progress.row, m]
    states[new + n, 0], states[new + n + 1, 0], states[new + n + PROPOSAL_AT, 0] = size, failed, progress.size


@compiled_subset
def _begin(rows: RowSteps, fresh: bool) -> bool:
    """Begin a motion, or continue it behind a stop; return whether it can begin."""
    progress = rows.run.progress
    if not fresh:
        begin_piece(rows.codes, rows.settings, rows.run, progress.row, progress.t, progress.size)
        return True
    progress.size, progress.steps, progress.retried, progress.fresh = rows.settings.first_step, 0, 0, 0
    progress.factored = progress.unlimited = 0.0
    return begin_motion(rows.codes, rows.settings, rows.run)


@compiled_subset
def _attempt(rows: RowSteps, state: LaneState, n: int) -> tuple[float, float]:
    """Attempt a step, and write its polynomials where there is room; return its size, and what failed, or 0."""
    run, states, y = rows.run, state.states, rows.run.progress.row
    outcome, h, t_new, error, quotient = attempt(rows.codes, rows.settings, rows.space, run)
    if outcome != ACCEPTED:
        broken = outcome == Status.NON_FINITE or outcome == Status.PROJECTION_FAILED
        return 0.0, float(outcome) if broken else 0.0
    first, terms = states.shape[0] // 2 - state.progress.old + n + 2 + CONTROLS, rows.settings.degree + 1
    if states.shape[0] // 2 > n + 2 + CONTROLS:
        write_polynomial(run.work, y, 1 - y, run.pieces, 0, n)
        for m in range(n):
            for k in range(terms):
                states[first + m * terms + k, 0] = run.pieces[0, 1 + k * n + m]
    propose(run, h, t_new, error, quotient)
    run.progress.row = 1 - y
    run.progress.steps += 1
    rows.place.known = 0
    return abs(h), 0.0
