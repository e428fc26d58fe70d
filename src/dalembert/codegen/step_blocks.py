"""Runs in blocks of steps, for those that may end early, and cases with events among them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ..integrators.cases import BlockResult, CaseBlock
from ..integrators.chaining import blocks_between_knots
from ..integrators.events import integrate_watched
from ..integrators.problem import IntegrationProblem, Solution, prescribed
from ..integrators.watched import recorded_states
from ..methods.status import Status

if TYPE_CHECKING:
    from .base import Engine

__all__ = ["growing_step_blocks", "watched_case"]

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


def watched_case(
    engine: Engine, block: CaseBlock, i: int, problem: IntegrationProblem, method: str, result: BlockResult
) -> None:
    """Write the results of case i of a block with events."""
    assert block.watch is not None

    def step_blocks(part: IntegrationProblem) -> Iterator[Solution]:
        blocks = partial(engine.step_blocks, method=method)
        if not (len(part.y0) or engine.cuts):
            return iter([prescribed(part)])
        return blocks_between_knots(blocks, part) if watch.reads_inputs else blocks(part)

    watch = block.watch
    problem = engine.after_start(problem)
    constants = engine.constants_along(problem)
    watched = block.watch.watched(constants)
    own, carried = replace(problem, t_eval=None, dense=True), None if block.carried is None else block.carried[i]
    solution, occurrences = integrate_watched(step_blocks, own, watched, carried)
    result.y[i], result.ends[i] = solution.y[-1], (solution.t[-1], solution.status, solution.steps)
    reached, states = recorded_states(watched, block.t_eval, solution.dense, solution.t, solution.y)
    result.samples[i, : len(reached)] = states
    result.totals[i] = block.watch.totals(constants, solution.dense)
    for occurrence in occurrences:
        count, first, _ = result.happened[i, 3 * occurrence.event : 3 * occurrence.event + 3]
        row = count + 1, first if count else occurrence.t, occurrence.t
        result.happened[i, 3 * occurrence.event : 3 * occurrence.event + 3] = row
