"""Runs taken one step at a time, with the state between the ends of a step: what code that is written for others calls.

A run begins with its arguments set; functions named `step` take the next step, those named `sample` give the state at a
time within it. They call the loops of recorded runs, so that a run goes through
the same states.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..arrays import FloatArray
from ..methods.status import RUNNING, Status
from ..methods.step_constants import FIRST_BLOCK, LARGEST_BLOCK
from ..steps.explicit_loop import LOOP as EXPLICIT_LOOP
from ..steps.explicit_loop import ExplicitArguments
from ..steps.implicit_loop import LOOP as IMPLICIT_LOOP
from ..steps.implicit_loop import ImplicitArguments, begin_piece
from ..steps.packed_tableaus import ALLOWED, POINT
from ..steps.projection import ROUNDING_OF_POLYNOMIALS, project_row
from ..steps.recorded_runs import Run, RunCodes, RunSettings, evaluate, evaluate_polynomial
from ..stops.instants import InstantTable, begin_instants, first_instant, instant_of, list_instants
from ..stops.stops import end_of_steps, is_due, pass_stops
from ..subset.arguments import IntVector, Record, Vector
from ..subset.compiled_subset import compiled_subset, flat, row
from .prepared_loop import RECORDED_LOOP, PreparedArguments, continue_in
from .taylor_runs import LARGEST_WINDING, TURN, turns_to_take, unwound

_STEP_ROW, _SPARE_ROW = 1, 2
"""Rows of the states of a run of Taylor steps: that of the step, and one for the state behind a stop or any other."""


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
def next_instant(steps: Any) -> float:
    """Return the first instant of controllers that is not among the stops of a run of any kind of steps."""
    return first_instant(steps.instants)


@compiled_subset
def instant_of_controller(steps: Any, number: int) -> float:
    """Return the first instant of a controller that is not among the stops."""
    return instant_of(steps.instants, number)


@compiled_subset
def taylor_step(arguments: TaylorSteps) -> int:
    """Take a step; return the status of the run."""
    run, place = arguments.run, arguments.place
    states, progress, n = run.states, run.progress, run.n
    if arguments.instants.listed.size > 0:
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
    if arguments.instants.listed.size > 0:
        list_instants(arguments.instants, run.stops, run.limits.t1, False)
    return RECORDED_LOOP(run)


@compiled_subset
def taylor_sample(arguments: TaylorSteps, t: float) -> int:
    """Compute the state at a time within the last step; return `RUNNING`."""
    run, begin = arguments.run, arguments.place.begin
    states, progress, n, end = run.states, run.progress, run.n, run.progress.t
    for i in range(n):
        arguments.sampled[i] = states[progress.row, i]
    if t != end and progress.row != 0:
        row, width = _STEP_ROW, (states.shape[1] - n - 2) // n
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
    run, sampled, place = arguments.run, arguments.sampled, _SPARE_ROW
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
def taylor_instants(arguments: TaylorSteps, t0: float) -> bool:
    """Take the periods of controllers in a run that begins at a time; return whether they make sense."""
    return begin_instants(arguments.instants, row(arguments.run.constants, 0), t0)


@compiled_subset
def taylor_act(arguments: TaylorSteps, t1: float) -> None:
    """Let controllers act that are due at the present time, which is the end of a run up to a time."""
    list_instants(arguments.instants, arguments.run.stops, t1, True)
    _act_in_taylor(arguments)


@compiled_subset
def taylor_settle(arguments: TaylorSteps) -> None:
    """Let controllers act that are due at the present time, and have not acted."""
    run, clock = arguments.run, arguments.instants.clock
    if clock.due != 0:
        clock.due = 0
        list_instants(arguments.instants, run.stops, run.limits.t1, False)
        _act_in_taylor(arguments)
        run.progress.end = end_of_steps(run.stops, 0, run.limits.t1, True)


@compiled_subset
def taylor_extend(arguments: TaylorSteps, t1: float) -> None:
    """Continue a run up to a time behind its end, where controllers may be due."""
    arguments.run.stops.inputs.ends[0, 0], arguments.instants.clock.due = t1, 1


@compiled_subset
def _act_in_taylor(arguments: TaylorSteps) -> None:
    run = arguments.run
    states, progress, stops, n = run.states, run.progress, run.stops, run.n
    if not is_due(stops, 0, progress.t, True):
        return
    if progress.row == _STEP_ROW:
        continue_in(run, _STEP_ROW, _SPARE_ROW)
    run.clock[0, 0], place = progress.t, progress.row * states.shape[1]
    pass_stops(stops, run.kernels.prepare, run.clock, flat(states), place, run.constants, n, True)
    if progress.row == _SPARE_ROW:
        for m in range(n):
            if states[_SPARE_ROW, m] != states[_STEP_ROW, m]:
                run.low[m] = 0.0  # what rounding took from another value


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
    if instants.listed.size > 0:
        list_instants(instants, run.stops, progress.t1, False)


@compiled_subset
def _sample(codes: RunCodes, settings: RunSettings, run: Run, place: StepPlace, sampled: FloatArray, t: float) -> int:
    """Compute the state at a time within the last step, one that was wanted or lies behind it; return the status."""
    progress, work, begin, source = run.progress, run.work, place.begin, run.progress.row
    status = RUNNING
    if t != progress.t and begin != progress.t:
        if run.pieces[0, 0] != progress.t:
            return Status.TIMES_IN_NO_ORDER  # the step has no polynomial: nobody wanted one
        evaluate_polynomial(run, 0, settings.degree, (t - begin) / (progress.t - begin), settings.kept)
        source, before = POINT, 1 - progress.row
        if not project_row(
            codes.position, codes.velocity, t, run.clock, work, POINT, work, before, run.constants, run.delta,
            run.mark, settings.rtol, settings.atol,
        ):  # fmt: skip
            status = Status.PROJECTION_FAILED
    for m in range(settings.kept):
        sampled[m] = work[source, m]
    return status


@compiled_subset
def _correct(codes: RunCodes, settings: RunSettings, run: Run, sampled: FloatArray, t: float) -> int:
    """Project a state onto the constraints; return the status."""
    work, status = run.work, RUNNING
    for m in range(settings.kept):
        work[POINT, m] = sampled[m]
    if not project_row(
        codes.position, codes.velocity, t, run.clock, work, POINT, work, POINT, run.constants, run.delta, run.mark,
        settings.rtol, settings.atol,
    ):  # fmt: skip
        status = Status.PROJECTION_FAILED
    for m in range(settings.kept):
        sampled[m] = work[POINT, m]
    return status


@compiled_subset
def _act(settings: RunSettings, run: Run) -> bool:
    """Let controllers act that are due at the present time; return whether there are any."""
    progress, forward = run.progress, True
    if not is_due(run.stops, 0, progress.t, forward):
        return False
    run.clock[0, 0], place = progress.t, progress.row * run.work.shape[1]
    pass_stops(run.stops, run.prepare, run.clock, flat(run.work), place, run.constants, settings.kept, forward)
    return True


@compiled_subset
def _settle(settings: RunSettings, run: Run, instants: InstantTable) -> bool:
    """Let controllers act that are due at the present time, and have not acted; return whether a run continues so."""
    progress, acts = run.progress, False
    if instants.clock.due != 0:
        instants.clock.due = 0
        list_instants(instants, run.stops, progress.t1, False)
        acts = _act(settings, run)
        progress.end = end_of_steps(run.stops, 0, progress.t1, True)
    return acts and progress.evaluations > 0


@compiled_subset
def explicit_step(arguments: ExplicitSteps) -> int:
    """Take a step; return the status of the run."""
    if arguments.instants.listed.size > 0:
        explicit_settle(arguments)
    _begin_step(arguments.run.settings, arguments.run.run, arguments.place, arguments.instants)
    return EXPLICIT_LOOP(arguments.run)


@compiled_subset
def explicit_sample(arguments: ExplicitSteps, t: float) -> int:
    """Compute the state at a time within the last step, one that was wanted or lies behind it; return the status."""
    loop = arguments.run
    return _sample(loop.codes, loop.settings, loop.run, arguments.place, arguments.sampled, t)


@compiled_subset
def explicit_correct(arguments: ExplicitSteps, t: float) -> int:
    """Project a state, `sampled`, of a run that has taken no steps onto the constraints; return the status."""
    loop = arguments.run
    return _correct(loop.codes, loop.settings, loop.run, arguments.sampled, t)


@compiled_subset
def explicit_continue(arguments: ExplicitSteps) -> None:
    """Evaluate the slope at the present state, where constants have changed."""
    codes, tableau, run = arguments.run.codes, arguments.run.tableau, arguments.run.run
    evaluate(codes.rhs, run.progress.t, run, run.progress.row, tableau.first)


@compiled_subset
def implicit_step(arguments: ImplicitSteps) -> int:
    """Take a step; return the status of the run."""
    if arguments.instants.listed.size > 0:
        implicit_settle(arguments)
    _begin_step(arguments.run.settings, arguments.run.run, arguments.place, arguments.instants)
    return IMPLICIT_LOOP(arguments.run)


@compiled_subset
def implicit_sample(arguments: ImplicitSteps, t: float) -> int:
    """Compute the state at a time within the last step, one that was wanted or lies behind it; return the status."""
    loop = arguments.run
    return _sample(loop.codes, loop.settings, loop.run, arguments.place, arguments.sampled, t)


@compiled_subset
def implicit_correct(arguments: ImplicitSteps, t: float) -> int:
    """Project a state, `sampled`, of a run that has taken no steps onto the constraints; return the status."""
    loop = arguments.run
    return _correct(loop.codes, loop.settings, loop.run, arguments.sampled, t)


@compiled_subset
def implicit_continue(arguments: ImplicitSteps) -> None:
    """Forget what was known of the motion before, where constants have changed."""
    loop, progress = arguments.run, arguments.run.run.progress
    begin_piece(loop.codes, loop.settings, loop.workspace, loop.run, progress.size)


@compiled_subset
def explicit_instants(arguments: ExplicitSteps, t0: float) -> bool:
    """Take the periods of controllers in a run that begins at a time; return whether they make sense."""
    return begin_instants(arguments.instants, row(arguments.run.run.constants, 0), t0)


@compiled_subset
def explicit_act(arguments: ExplicitSteps, t1: float) -> None:
    """Let controllers act that are due at the present time, which is the end of a run up to a time."""
    list_instants(arguments.instants, arguments.run.run.stops, t1, True)
    if _act(arguments.run.settings, arguments.run.run):
        explicit_continue(arguments)


@compiled_subset
def explicit_settle(arguments: ExplicitSteps) -> None:
    """Let controllers act that are due at the present time, and have not acted."""
    if _settle(arguments.run.settings, arguments.run.run, arguments.instants):
        explicit_continue(arguments)


@compiled_subset
def explicit_extend(arguments: ExplicitSteps, t1: float) -> None:
    """Continue a run up to a time behind its end, where controllers may be due."""
    arguments.run.run.stops.inputs.ends[0, 0], arguments.instants.clock.due = t1, 1


@compiled_subset
def implicit_instants(arguments: ImplicitSteps, t0: float) -> bool:
    """Take the periods of controllers in a run that begins at a time; return whether they make sense."""
    return begin_instants(arguments.instants, row(arguments.run.run.constants, 0), t0)


@compiled_subset
def implicit_act(arguments: ImplicitSteps, t1: float) -> None:
    """Let controllers act that are due at the present time, which is the end of a run up to a time."""
    list_instants(arguments.instants, arguments.run.run.stops, t1, True)
    if _act(arguments.run.settings, arguments.run.run):
        implicit_continue(arguments)


@compiled_subset
def implicit_settle(arguments: ImplicitSteps) -> None:
    """Let controllers act that are due at the present time, and have not acted."""
    if _settle(arguments.run.settings, arguments.run.run, arguments.instants):
        implicit_continue(arguments)


@compiled_subset
def implicit_extend(arguments: ImplicitSteps, t1: float) -> None:
    """Continue a run up to a time behind its end, where controllers may be due."""
    arguments.run.run.stops.inputs.ends[0, 0], arguments.instants.clock.due = t1, 1
