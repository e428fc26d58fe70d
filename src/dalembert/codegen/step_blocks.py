"""Runs in blocks of steps, for those that may end early, and cases with events among them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ..events.events import run_with_events
from ..events.recorded_motion import recorded_states
from ..lanes.cases import BlockResult, CaseBlock
from ..lanes.host_stops import CasesAtStops, in_blocks
from ..methods.status import Status
from ..once import computed_once
from ..steps.problem import IntegrationProblem, Solution, prescribed_blocks
from ..steps.projection import projected
from ..subset.arguments import NO_CODE
from .host_code import interpreted_code, raise_failure
from .steppers import event_kernels

if TYPE_CHECKING:
    from ..arrays import FloatArray
    from ..events.event_code import EventCode
    from ..events.event_resolution import SearchArguments
    from ..events.recorded_motion import RecordedCase
    from ..lanes.workspace import EventKernels
    from .engine import Engine

LONGEST_BLOCK = 256
"""Attempts in the longest block of a run that may end early."""


def growing_step_blocks(
    integrate: Callable[[IntegrationProblem], Solution], problem: IntegrationProblem, size: int
) -> Iterator[Solution]:
    """Yield a solution in blocks of steps: one of `size` attempts at first, ever longer ones later."""
    left = problem.max_steps
    while True:
        solution = integrate(replace(problem, max_steps=min(size, left)))
        left -= solution.steps + solution.rejected
        yield solution
        if solution.status is not Status.MAX_STEPS or left <= 0:
            return
        size = min(2 * size, LONGEST_BLOCK)
        if solution.steps:
            step = abs(float(solution.t[-1] - solution.t[-2]))
            y0 = solution.y[-1] if solution.last is None else solution.last  # that behind a knot
            problem = replace(problem, t0=float(solution.t[-1]), y0=y0, first_step=step)


def recorded_in_blocks(
    engine: Engine, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
) -> RecordedCase:
    """Return the records of a run with events, searched in blocks of steps; see `Engine.recorded`."""
    from .llvm.loops import loop_named

    def step_blocks(part: IntegrationProblem) -> Iterator[Solution]:
        blocks = partial(engine.step_blocks, method=method) if len(part.y0) or engine.cuts else prescribed_blocks
        return in_blocks(CasesAtStops.alone(part), part, blocks) if watch.reads_inputs else blocks(part)

    problem = engine.after_start(problem)
    events = computed_once(engine.block_events, watch, lambda: _event_kernels(watch))
    constants, loop = engine.constants_along(problem), loop_named("block_search")
    return run_with_events(step_blocks, problem, watch, events, constants, _raising(loop), carried)


def _raising(loop: Callable[[SearchArguments], int]) -> Callable[[SearchArguments], int]:
    """Return a loop that raises what interpreted kernels have raised in it."""

    def call(arguments: SearchArguments) -> int:
        found = loop(arguments)
        raise_failure()
        return found

    return call


def _event_kernels(watch: EventCode) -> EventKernels:
    """Return interpreted kernels of events, for polynomials of any steps."""
    program = watch.program
    position, velocity = (
        interpreted_code(program.kernel(name), 1) if name in program else NO_CODE
        for name in ("project_position", "project_velocity")
    )
    about = interpreted_code, (position, velocity), replace(watch, kinds=()), NO_CODE
    return event_kernels(*about, (len(program.layout.state), 0, 0), 1, 0, tested=False, exact=False)


def watched_case(
    engine: Engine, block: CaseBlock, i: int, problem: IntegrationProblem, method: str, result: BlockResult
) -> None:
    """Write the results of case i of a block with events."""
    assert block.watch is not None
    carried = None if block.carried is None else block.carried[i]
    own = replace(problem, t_eval=None, dense=True)
    solution, occurrences = engine.integrate_watched(own, method, block.watch, carried)
    result.y[i], result.ends[i] = solution.y[-1], (solution.t[-1], solution.status, solution.steps)
    constants, times = engine.constants_along(own), block.times(i)
    settle = partial(projected, block.watch.program, constants)
    reached, states = recorded_states(settle, block.t_eval[times], solution.dense, solution.t, solution.y)
    result.samples[i, times][: len(reached)] = states
    result.totals[i] = block.watch.totals(constants, solution.dense)
    for occurrence in occurrences:
        count, first, _ = result.happened[i, 3 * occurrence.event : 3 * occurrence.event + 3]
        row = count + 1, first if count else occurrence.t, occurrence.t
        result.happened[i, 3 * occurrence.event : 3 * occurrence.event + 3] = row
