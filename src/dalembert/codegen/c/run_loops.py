"""The loops of exported runs: their arguments, made for one program, and where in these a run finds what it sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, final

import numpy as np

from ...frozen import frozen
from ...loops.prepared_loop import PreparedArguments, PreparedKernels, PreparedLimits, PreparedProgress
from ...loops.single_steps import (
    ExplicitSteps,
    ImplicitSteps,
    StepPlace,
    TaylorSteps,
    explicit_correct,
    explicit_sample,
    explicit_step,
    implicit_correct,
    implicit_sample,
    implicit_step,
    taylor_correct,
    taylor_sample,
    taylor_step,
)
from ...loops.steps_at_instants import (
    EXPLICIT,
    IMPLICIT,
    explicit_continue,
    implicit_continue,
    recorded_extend,
    recorded_instants,
    taylor_act,
    taylor_extend,
    taylor_instants,
    taylor_resume,
    taylor_settle,
)
from ...methods.names import PAIRS
from ...methods.step_constants import SMALLEST_SCALE
from ...steps.explicit_loop import ExplicitArguments
from ...steps.explicit_stages import LANES
from ...steps.implicit_loop import DEGREE, ImplicitArguments
from ...steps.newton import ROWS, newton_workspace
from ...steps.packed_tableaus import packed_tableau
from ...steps.recorded_runs import Progress, Run, RunCodes, RunSettings
from ...stops.instants import InstantTable
from ...subset.arguments import NO_CODE, OwnedAddress
from ...transforms.taylor.step import scale_floor
from .run_stops import NOWHERE, PREPARE, RunStops, kernel_addresses


@final
@frozen
class RunLoop:
    """A loop that takes the steps of a run one by one.

    Attributes
    ----------
    arguments : NamedTuple
        For one program.
    given : frozenset of str
        Dotted names of the numbers that a run sets.
    constant : frozenset of str
        Dotted names of the arrays that never change.
    step, sample : function
        Takes a step; computes the state at a time. Both return a status.
    renew : function or None
        What follows where constants change between steps.
    correct : function
        Projects a state onto the constraints, in a run that has taken no steps; returns a status.
    instants, act, extend : function
        Takes the periods of controllers at a time, and returns whether they make sense; lets controllers act at the end
        of a run up to a time; continues a run up to a time.
    settle : function
        Lets controllers act that are due at the start of a run, or where it continues.
    resume : function
        Finds the breaks of a run that continues; returns whether there is room for them.
    at : mapping of str to str
        Members, as C has them, of what a run sets and reads.
    after_step, continuing : tuple of (str, str)
        Members that are set after each step, and where a run continues after its end, and their values.
    kernels : tuple of str
        What stands at the addresses 1, 2, ... among the arguments.
    """

    arguments: Any
    given: frozenset[str]
    constant: frozenset[str]
    step: Callable[..., Any]
    sample: Callable[..., Any]
    renew: Callable[..., Any] | None
    correct: Callable[..., Any]
    instants: Callable[..., Any]
    act: Callable[..., Any]
    extend: Callable[..., Any]
    settle: Callable[..., Any]
    resume: Callable[..., Any]
    at: Mapping[str, str]
    after_step: tuple[tuple[str, str], ...]
    continuing: tuple[tuple[str, str], ...]
    kernels: tuple[str, ...]


def taylor_loop_of(
    sizes: tuple[int, int],
    order: int,
    tolerances: tuple[float, float],
    angles: tuple[int, ...],
    has: Mapping[str, bool],
    at: RunStops = NOWHERE,
) -> RunLoop:
    """Return the loop of Taylor steps.

    Parameters
    ----------
    sizes : (int, int)
        Numbers of components of the state and of constants.
    order : int
    tolerances : (float, float)
        Relative and absolute.
    angles : tuple of int
        Components of the state that matter modulo a turn.
    has : mapping of str to bool
        Kernels of the program ("step", "position", "velocity"), and whether there are.
    at : RunStops
        Controllers have the kernels `SCHEDULE` and `LAW`, conditions `PREPARE` and `break_kernels`.
    """
    (n, constants), (rtol, atol), code = sizes, tolerances, kernel_addresses(has)
    nothing, width = np.zeros((0, 1)), n + 2 + n * (order + 1)
    stops, instants = at.tables(constants, code)
    angles = () if at.acts else angles  # laws read angles, and not modulo a turn
    run = PreparedArguments(
        kernels=PreparedKernels(code.get(PREPARE, NO_CODE), code["step"], NO_CODE, code["position"], code["velocity"]),
        limits=PreparedLimits(0.0, 0.0, 0.0, 0, 0, going=False, slack=1.0),
        n=n,
        memory=0,
        parameters=nothing,
        constants=np.zeros((constants, 1)),
        settings=np.array([[0.0, 1.0, scale_floor(rtol, atol), rtol, atol]]),
        clock=np.zeros((1, 1)),
        states=np.zeros((3, width)),
        times=np.zeros(3),
        low=np.zeros(n + 1),
        delta=np.zeros((n, 1)),
        mark=np.zeros(1, np.int64),
        tests=nothing,
        progress=PreparedProgress(),
        stops=stops,
    )
    limits = ("t0", "t1", "largest", "attempts", "going")
    members = {name: f"run.limits.{name}" for name in limits[:-1]} | {
        "constants": "run.constants",
        "state": "run.states",
        "now": f"run.states + {width} * run->run.progress.row",
        "time": "run.progress.t",
        "end": "run.progress.end",
        "steps": "run.progress.steps",
        "direction": "run.settings[1]",
        "dense": "place.dense",
        "evaluated": "run.progress.attempts",
    }
    return RunLoop(
        arguments=TaylorSteps(run, np.array(angles, np.int64), np.zeros(n), np.zeros(n), StepPlace(), instants),
        given=frozenset(f"run.limits.{name}" for name in limits),
        constant=frozenset({"angles"}),
        step=taylor_step,
        sample=taylor_sample,
        renew=None,
        correct=taylor_correct,
        instants=taylor_instants,
        act=taylor_act,
        extend=taylor_extend,
        settle=taylor_settle,
        resume=taylor_resume,
        at=members,
        after_step=(("run.limits.going", "true"),),
        continuing=(("run.progress.attempts", "0"),),
        kernels=tuple(has),
    )


def explicit_loop_of(
    method: str,
    sizes: tuple[int, int],
    tolerances: tuple[float, float],
    has: Mapping[str, bool],
    at: RunStops = NOWHERE,
) -> RunLoop:
    """Return the loop of the steps of a Runge-Kutta pair; for the parameters see `taylor_loop_of`.

    Kernels are "rhs", "position", "velocity" and "knots".
    """
    tableau, n = packed_tableau(PAIRS[method].tableau), sizes[0]
    shape = tableau.first + tableau.total, -(-n // LANES) * LANES
    codes, settings, run, instants = _recorded(sizes, tolerances, shape, tableau.degree, kernel_addresses(has), at)
    return _recorded_loop(
        arguments=ExplicitSteps(ExplicitArguments(codes, tableau, settings, run), np.zeros(n), StepPlace(), instants),
        constant=frozenset(f"run.tableau.{name}" for name in ("nodes", "starts", "stages", "weights")),
        functions=(
            *(explicit_step, explicit_sample, explicit_continue, explicit_correct),
            *(recorded_instants, EXPLICIT.act, recorded_extend, EXPLICIT.settle, EXPLICIT.resume),
        ),
        width=shape[1],
        has=has,
    )


def implicit_loop_of(
    sizes: tuple[int, int],
    tolerances: tuple[float, float],
    has: Mapping[str, bool],
    at: RunStops = NOWHERE,
) -> RunLoop:
    """Return the loop of the implicit method; for the parameters see `taylor_loop_of`.

    Kernels are those of `explicit_loop_of`, and "jacobian" or "tangent".
    """
    n = sizes[0]
    codes, settings, run, instants = _recorded(sizes, tolerances, (ROWS, n), DEGREE, kernel_addresses(has), at)
    return _recorded_loop(
        arguments=ImplicitSteps(
            ImplicitArguments(codes, settings, newton_workspace(n, n), run), np.zeros(n), StepPlace(), instants
        ),
        constant=frozenset(),
        functions=(
            *(implicit_step, implicit_sample, implicit_continue, implicit_correct),
            *(recorded_instants, IMPLICIT.act, recorded_extend, IMPLICIT.settle, IMPLICIT.resume),
        ),
        width=n,
        has=has,
    )


def _recorded(
    sizes: tuple[int, int],
    tolerances: tuple[float, float],
    shape: tuple[int, int],
    degree: int,
    code: Mapping[str, OwnedAddress],
    at: RunStops,
) -> tuple[RunCodes, RunSettings, Run, InstantTable]:
    """Return what loops of recorded runs have in common, with room for one step."""
    (n, constants), (rtol, atol) = sizes, tolerances
    stops, instants = at.tables(constants, code)
    settings = RunSettings(0.0, rtol, max(atol, SMALLEST_SCALE), 0.0, 0.0, 0, n, degree, False, False, False, False)
    run = Run(
        clock=np.zeros((1, 1)),
        constants=np.zeros((constants, 1)),
        t_eval=np.zeros(1),
        work=np.zeros(shape),
        delta=np.zeros((n, 1)),
        mark=np.zeros(1, np.int64),
        progress=Progress(),
        knot=np.zeros((1, 2)),
        rows=np.zeros((2, 1 + n)),
        pieces=np.zeros((1, 1 + (degree + 1) * n)),
        stops=stops,
        prepare=code.get(PREPARE, NO_CODE),
    )
    kernels = (code.get(name, NO_CODE) for name in ("rhs", "position", "velocity", "knots", "jacobian", "tangent"))
    return RunCodes(*kernels), settings, run, instants


def _recorded_loop(
    arguments: Any,
    constant: frozenset[str],
    functions: tuple[Callable[..., Any], ...],
    width: int,
    has: Mapping[str, bool],
) -> RunLoop:
    """Return a loop of recorded runs; ``width`` is that of the rows of its work."""
    progress = "run.run.progress"
    at = {
        "t0": "run.settings.t0",
        "t1": f"{progress}.t1",
        "largest": "run.settings.max_step",
        "attempts": "run.settings.max_steps",
        "constants": "run.run.constants",
        "state": "run.run.work",
        "now": f"run.run.work + {width} * run->{progress}.row",
        "time": f"{progress}.t",
        "end": f"{progress}.end",
        "steps": f"{progress}.steps",
        "direction": f"{progress}.direction",
        "dense": "run.settings.dense",
        "evaluated": f"{progress}.evaluations",
    }
    step, sample, renew, correct, instants, act, extend, settle, resume = functions
    return RunLoop(
        arguments=arguments,
        given=frozenset(f"run.settings.{name}" for name in ("t0", "max_step", "max_steps", "dense")),
        constant=constant,
        step=step,
        sample=sample,
        renew=renew,
        correct=correct,
        instants=instants,
        act=act,
        extend=extend,
        settle=settle,
        resume=resume,
        at=at,
        after_step=(),
        continuing=(
            (f"{progress}.steps", "0"),
            (f"{progress}.rejected", "0"),
            # a run that has taken no time has not chosen its first step
            (f"{progress}.evaluations", f"run->{progress}.size == 0.0 ? 0 : run->{progress}.evaluations"),
        ),
        kernels=tuple(has),
    )
