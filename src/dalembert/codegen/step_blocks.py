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
            problem = replace(problem, t0=float(solution.t[-1]), y0=solution.y[-1], first_step=step)


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
    before, problem = problem, engine.begun(problem)
    constants = engine.course(problem)
    watched = block.watch.watched(constants)
    own, jumped = replace(problem, t_eval=None, dense=True), None if before.sampled is None else before.y0
    solution, occurrences = integrate_watched(step_blocks, own, watched, jumped)
    result.y[i], result.ends[i] = solution.y[-1], (solution.t[-1], solution.status, solution.steps)
    forward = 1.0 if problem.t1 >= problem.t0 else -1.0
    reached = block.t_eval[(block.t_eval - solution.t[-1]) * forward <= 0.0]
    if len(reached) and solution.dense is not None:
        result.samples[i, : len(reached)] = watched.settle(reached, solution.dense(reached))
    ends = ((solution.t[0], solution.y[0]), (solution.t[-1], solution.y[-1]))
    for t, y in ends:
        result.samples[i, : len(reached)][reached == t] = y
    result.totals[i] = block.watch.totals(constants, solution.dense)
    for occurrence in occurrences:
        count, first, _ = result.happened[i, 3 * occurrence.event : 3 * occurrence.event + 3]
        row = count + 1, first if count else occurrence.t, occurrence.t
        result.happened[i, 3 * occurrence.event : 3 * occurrence.event + 3] = row
