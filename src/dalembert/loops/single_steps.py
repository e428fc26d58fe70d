"""Runs taken one step at a time, with the state between the ends of a step: what code that is written for others calls.

A run begins with its arguments set; functions named `step` take the next step, those named `sample` give the state at a
time within it. They call the loops of recorded runs, so that a run goes through
the same states.
"""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import FloatArray
from ..methods.status import RUNNING, Status
from ..methods.step_constants import FIRST_BLOCK, LARGEST_BLOCK
from ..steps.explicit_loop import LOOP as EXPLICIT_LOOP
from ..steps.explicit_loop import ExplicitArguments
from ..steps.implicit_loop import LOOP as IMPLICIT_LOOP
from ..steps.implicit_loop import ImplicitArguments
from ..steps.packed_tableaus import ALLOWED, POINT
from ..steps.projection import ROUNDING_OF_POLYNOMIALS, project_row
from ..steps.recorded_runs import Run, RunCodes, RunSettings, evaluate_polynomial
from ..stops.break_tables import BreakTable
from ..stops.instants import InstantTable, has_stops, keep_constants, list_instants
from ..subset.arguments import IntVector, Record, Vector
from ..subset.compiled_subset import compiled_subset
from .prepared_loop import RECORDED_LOOP, PreparedArguments
from .steps_at_instants import EXPLICIT, IMPLICIT, SPARE_ROW, STEP_ROW, taylor_settle
from .taylor_records import TURN
from .taylor_runs import LARGEST_WINDING, turns_to_take, unwound


class StepPlace(Record):
    """Time at which the last step began; steps until turns are taken off angles, and how many there were before that.

    ``wanted`` is a time within the next step at which the state will be asked for, NaN where there is none; ``dense``
    says whether steps write polynomials, where the arguments of the loop do not.
    """

    begin: float
    left: int
    block: int
    wanted: float
    dense: int


class TaylorSteps(NamedTuple):
    """A recorded run of Taylor steps, with room for one step, whose series it writes.

    Attributes
    ----------
    angles : (n_angles,)
        Components of the state that matter modulo a turn.
    turns, sampled : (n,)
        Turns that have been taken off the components; gets a state.
    instants : InstantTable
        Of controllers, which act where the steps end at which they are due.
    """

    run: PreparedArguments
    angles: IntVector
    turns: Vector
    sampled: Vector
    place: StepPlace
    instants: InstantTable


class ExplicitSteps(NamedTuple):
    """A run of Runge-Kutta steps, with room for one step; ``sampled`` (n,) gets a state."""

    run: ExplicitArguments
    sampled: Vector
    place: StepPlace
    instants: InstantTable


class ImplicitSteps(NamedTuple):
    """A run of steps of the implicit method, with room for one step; ``sampled`` (n,) gets a state."""

    run: ImplicitArguments
    sampled: Vector
    place: StepPlace
    instants: InstantTable


@compiled_subset
def taylor_step(arguments: TaylorSteps) -> int:
    """Take a step; return the status of the run."""
    run, place = arguments.run, arguments.place
    states, progress, n = run.states, run.progress, run.n
    if has_stops(arguments.instants):
        taylor_settle(arguments)
    if run.limits.going:
        for m in range(n + 1):
            states[0, m] = states[progress.row, m]
    else:
        progress.t, place.left, place.block = run.limits.t0, 0, 0
    if arguments.angles.size > 0:
        if place.left == 0:
            place.block = FIRST_BLOCK if place.block == 0 else min(2 * place.block, min(LARGEST_WINDING, LARGEST_BLOCK))
            place.left = place.block
            for a in range(arguments.angles.size):
                i = arguments.angles[a]
                turns = turns_to_take(states[0, i])
                states[0, i], lost = unwound(states[0, i], turns)
                run.low[i] += lost
                arguments.turns[i] += turns
        place.left -= 1
    place.begin = progress.t
    if has_stops(arguments.instants):
        list_instants(arguments.instants, run.stops, run.limits.t1, False)
        keep_constants(arguments.instants.breaks, run.constants)
    return RECORDED_LOOP(run)


@compiled_subset
def taylor_sample(arguments: TaylorSteps, t: float) -> int:
    """Compute the state at a time within the last step; return `RUNNING`."""
    run, begin = arguments.run, arguments.place.begin
    states, progress, n, end = run.states, run.progress, run.n, run.progress.t
    for i in range(n):
        arguments.sampled[i] = states[progress.row, i]
    if t != end and progress.row != 0:
        row, width = STEP_ROW, (states.shape[1] - n - 2) // n
        h, theta = states[row, n] * run.settings[0, 1], (t - begin) / (end - begin)
        for i in range(n):
            first, value, total, terms, power = n + 2 + i * width, 0.0, 0.0, 0.0, 1.0
            for k in range(width):
                if states[row, first + k] != 0.0:
                    term = states[row, first + k] * power
                    total += term
                    terms += abs(term)
                power *= h
            for k in range(width - 1, -1, -1):
                value = value * (theta * h) + states[row, first + k]
            left = states[row, i] - total
            if abs(left) > ROUNDING_OF_POLYNOMIALS * terms:
                value += left * (theta * theta * (3.0 - 2.0 * theta))
            arguments.sampled[i] = value
    for a in range(arguments.angles.size):
        i = arguments.angles[a]
        arguments.sampled[i] += arguments.turns[i] * TURN
    return RUNNING


@compiled_subset
def taylor_correct(arguments: TaylorSteps, t: float) -> int:
    """Project a state, `sampled`, of a run that has taken no steps onto the constraints; return the status."""
    run, sampled, place = arguments.run, arguments.sampled, SPARE_ROW
    states, status = run.states, RUNNING
    for m in range(run.n):
        states[place, m] = sampled[m]
    if not project_row(
        run.kernels.position, run.kernels.velocity, t, run.clock, states, place, states, place, run.constants,
        run.delta, run.mark, run.settings[0, 3], run.settings[0, 4],
    ):  # fmt: skip
        status = Status.PROJECTION_FAILED
    for m in range(run.n):
        sampled[m] = states[place, m]
    return status


@compiled_subset
def _begin_step(settings: RunSettings, run: Run, place: StepPlace, instants: InstantTable) -> None:
    """Make room for a step, set the time at which its polynomial is wanted, and before the first the tolerances."""
    progress = run.progress
    if progress.evaluations == 0:
        for m in range(run.work.shape[1]):
            run.work[ALLOWED, m] = settings.atol
    progress.begun, progress.limit = progress.steps, progress.steps + 1
    progress.recorded, run.t_eval[0] = 0, place.wanted
    place.begin = progress.t
    if has_stops(instants):
        list_instants(instants, run.stops, progress.t1, False)
        keep_constants(instants.breaks, run.constants)


@compiled_subset
def _sample(
    codes: RunCodes,
    settings: RunSettings,
    run: Run,
    place: StepPlace,
    breaks: BreakTable,
    sampled: FloatArray,
    t: float,
) -> int:
    """Compute the state at a time within the last step, one that was wanted or lies behind it; return the status."""
    progress, work, begin, source = run.progress, run.work, place.begin, run.progress.row
    status = RUNNING
    if t != progress.t and begin != progress.t:
        if run.pieces[0, 0] != progress.t:
            return Status.TIMES_IN_NO_ORDER  # the step has no polynomial: nobody wanted one
        evaluate_polynomial(run, 0, settings.degree, (t - begin) / (progress.t - begin), settings.kept)
        source = POINT
        if breaks.before.shape[0] > 0:
            status = _project(codes, settings, run, 1 - progress.row, breaks.before, t)
        else:
            status = _project(codes, settings, run, 1 - progress.row, run.constants, t)
    for m in range(settings.kept):
        sampled[m] = work[source, m]
    return status


@compiled_subset
def _project(codes: RunCodes, settings: RunSettings, run: Run, before: int, constants: FloatArray, t: float) -> int:
    """Project a state within a step, or one that no step has reached, onto the constraints; return the status."""
    if project_row(
        codes.position, codes.velocity, t, run.clock, run.work, POINT, run.work, before, constants, run.delta,
        run.mark, settings.rtol, settings.atol,
    ):  # fmt: skip
        return RUNNING
    return Status.PROJECTION_FAILED


@compiled_subset
def _correct(codes: RunCodes, settings: RunSettings, run: Run, sampled: FloatArray, t: float) -> int:
    """Project a state onto the constraints; return the status."""
    work = run.work
    for m in range(settings.kept):
        work[POINT, m] = sampled[m]
    status = _project(codes, settings, run, POINT, run.constants, t)
    for m in range(settings.kept):
        sampled[m] = work[POINT, m]
    return status


@compiled_subset
def explicit_step(arguments: ExplicitSteps) -> int:
    """Take a step; return the status of the run."""
    if has_stops(arguments.instants):
        EXPLICIT.settle(arguments)
    _begin_step(arguments.run.settings, arguments.run.run, arguments.place, arguments.instants)
    return EXPLICIT_LOOP(arguments.run)


@compiled_subset
def explicit_sample(arguments: ExplicitSteps, t: float) -> int:
    """Compute the state at a time within the last step, one that was wanted or lies behind it; return the status."""
    loop = arguments.run
    breaks = arguments.instants.breaks
    return _sample(loop.codes, loop.settings, loop.run, arguments.place, breaks, arguments.sampled, t)


@compiled_subset
def explicit_correct(arguments: ExplicitSteps, t: float) -> int:
    """Project a state, `sampled`, of a run that has taken no steps onto the constraints; return the status."""
    loop = arguments.run
    return _correct(loop.codes, loop.settings, loop.run, arguments.sampled, t)


@compiled_subset
def implicit_step(arguments: ImplicitSteps) -> int:
    """Take a step; return the status of the run."""
    if has_stops(arguments.instants):
        IMPLICIT.settle(arguments)
    _begin_step(arguments.run.settings, arguments.run.run, arguments.place, arguments.instants)
    return IMPLICIT_LOOP(arguments.run)


@compiled_subset
def implicit_sample(arguments: ImplicitSteps, t: float) -> int:
    """Compute the state at a time within the last step, one that was wanted or lies behind it; return the status."""
    loop = arguments.run
    breaks = arguments.instants.breaks
    return _sample(loop.codes, loop.settings, loop.run, arguments.place, breaks, arguments.sampled, t)


@compiled_subset
def implicit_correct(arguments: ImplicitSteps, t: float) -> int:
    """Project a state, `sampled`, of a run that has taken no steps onto the constraints; return the status."""
    loop = arguments.run
    return _correct(loop.codes, loop.settings, loop.run, arguments.sampled, t)
