"""Stops of runs that are taken one step at a time: controllers, conditions on time, and changes of constants.

Of each kind of steps there are functions named `instants`, which begin with the periods of controllers; `settle`, which
lets those act that are due at the start or where a run continues; `act`, at its end; `extend`, which continues it;
`resume`, which before that finds the breaks of what follows; and `continue`, which evaluates anew what depends on
constants. `find` and `decided` are for starts: they find the breaks, and return when conditions are decided first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ..steps.implicit_loop import begin_piece
from ..steps.recorded_runs import Run, RunSettings, evaluate
from ..stops.break_search import middle_of
from ..stops.instants import (
    InstantTable,
    begin_breaks,
    begin_instants,
    continue_breaks,
    first_instant,
    instant_of,
    list_instants,
)
from ..stops.stops import end_of_steps, is_due, pass_stops
from ..subset.compiled_subset import compiled_subset, flat, row
from .prepared_loop import continue_in

if TYPE_CHECKING:
    from .single_steps import ExplicitSteps, ImplicitSteps, TaylorSteps

STEP_ROW, SPARE_ROW = 1, 2
"""Rows of the states of a run of Taylor steps: that of the step, and one for the state behind a stop or any other."""


@compiled_subset
def next_instant(steps: Any) -> float:
    """Return the first instant of controllers that is not among the stops of a run of any kind of steps."""
    return first_instant(steps.instants)


@compiled_subset
def instant_of_controller(steps: Any, number: int) -> float:
    """Return the first instant of a controller that is not among the stops."""
    return instant_of(steps.instants, number)


@compiled_subset
def find(steps: Any, t0: float, t1: float) -> bool:
    """Find the breaks of a run of any kind of steps; return whether there is room for them."""
    return begin_breaks(steps.instants, t0, t1)


@compiled_subset
def decided(steps: Any) -> float:
    """Return when conditions are decided from the start on."""
    return middle_of(steps.instants.breaks, 0)


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
        run.progress.end = end_of_steps(run.stops, 0, run.limits.t1, run.limits.t1 >= run.limits.t0)


@compiled_subset
def taylor_extend(arguments: TaylorSteps, t1: float) -> None:
    """Continue a run up to a time behind its end, where controllers may be due."""
    arguments.run.stops.inputs.ends[0, 0], arguments.instants.clock.due = t1, 1


@compiled_subset
def taylor_resume(arguments: TaylorSteps, t1: float) -> bool:
    """Find the breaks of a run that continues, and decide conditions; return whether there is room for them."""
    run = arguments.run
    return continue_breaks(arguments.instants, run.stops, run.kernels.prepare, run.constants, run.progress.t, t1)


@compiled_subset
def _act_in_taylor(arguments: TaylorSteps) -> None:
    run = arguments.run
    states, progress, stops, n = run.states, run.progress, run.stops, run.n
    forward = run.limits.t1 >= run.limits.t0
    if not is_due(stops, 0, progress.t, forward):
        return
    if progress.row == STEP_ROW:
        continue_in(run, STEP_ROW, SPARE_ROW)
    run.clock[0, 0], place = progress.t, progress.row * states.shape[1]
    pass_stops(stops, run.kernels.prepare, run.clock, flat(states), place, run.constants, n, forward)
    if progress.row == SPARE_ROW:
        for m in range(n):
            if states[SPARE_ROW, m] != states[STEP_ROW, m]:
                run.low[m] = 0.0  # what rounding took from another value


@compiled_subset
def _act(settings: RunSettings, run: Run) -> bool:
    """Let controllers act that are due at the present time; return whether there are any."""
    progress, forward = run.progress, run.progress.direction > 0.0
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
        progress.end = end_of_steps(run.stops, 0, progress.t1, progress.direction > 0.0)
    return acts and progress.evaluations > 0


@compiled_subset
def recorded_instants(arguments: ExplicitSteps | ImplicitSteps, t0: float) -> bool:
    """Take the periods of controllers in a run that begins at a time; return whether they make sense."""
    return begin_instants(arguments.instants, row(arguments.run.run.constants, 0), t0)


@compiled_subset
def recorded_extend(arguments: ExplicitSteps | ImplicitSteps, t1: float) -> None:
    """Continue a run up to a time behind its end, where controllers may be due."""
    arguments.run.run.stops.inputs.ends[0, 0], arguments.instants.clock.due = t1, 1


@compiled_subset
def explicit_continue(arguments: ExplicitSteps) -> None:
    """Evaluate the slope at the present state, where constants have changed."""
    codes, tableau, run = arguments.run.codes, arguments.run.tableau, arguments.run.run
    evaluate(codes.rhs, run.progress.t, run, run.progress.row, tableau.first)


@compiled_subset
def implicit_continue(arguments: ImplicitSteps) -> None:
    """Forget what was known of the motion before, where constants have changed."""
    loop, progress = arguments.run, arguments.run.run.progress
    begin_piece(loop.codes, loop.settings, loop.workspace, loop.run, progress.size)


class AtStops(NamedTuple):
    """Functions of explicit or implicit Runge-Kutta steps at stops, as the docstring of the module says."""

    act: Callable[[Any, float], None]
    settle: Callable[[Any], None]
    resume: Callable[[Any, float], bool]


def _continued_by(go_on: Callable[[Any], None]) -> AtStops:
    """Return the functions of one kind of steps, of which `go_on` evaluates anew what depends on constants."""

    def act(arguments: Any, t1: float) -> None:
        """Let controllers act that are due at the present time, which is the end of a run up to a time."""
        list_instants(arguments.instants, arguments.run.run.stops, t1, True)
        if _act(arguments.run.settings, arguments.run.run):
            go_on(arguments)

    def settle(arguments: Any) -> None:
        """Let controllers act that are due at the present time, and have not acted."""
        if _settle(arguments.run.settings, arguments.run.run, arguments.instants):
            go_on(arguments)

    def resume(arguments: Any, t1: float) -> bool:
        """Find the breaks of a run that continues, and decide conditions; return whether there is room for them."""
        run = arguments.run.run
        if not continue_breaks(arguments.instants, run.stops, run.prepare, run.constants, run.progress.t, t1):
            return False
        if run.progress.evaluations > 0:
            go_on(arguments)
        return True

    return AtStops(compiled_subset(act), compiled_subset(settle), compiled_subset(resume))


EXPLICIT, IMPLICIT = _continued_by(explicit_continue), _continued_by(implicit_continue)
