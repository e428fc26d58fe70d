"""Cases of a sweep that are run alone once more, to find out whether they met a singular configuration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..integrators.cases import BlockResult, CaseBlock
from ..integrators.problem import IntegrationProblem, Solution
from ..integrators.segments import Constants
from ..methods.status import Status
from .left_out_constraints import ended_where_left_out_matter
from .singular import checked_run

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["check_cases"]


def check_cases(model: CompiledModel, method: str, block: CaseBlock, done: BlockResult) -> None:
    """Check cases that came near a lost rank, or failed, by runs alone; end those that met a singular configuration.

    Those of "radau", which run alone in any case, are not marked, and all looked at; so are those without constraints
    that followed from others around the start. Samples behind the place are NaN, as are reductions, and events are not
    reported.
    """
    from ..integrators.event_code import SUSPECT

    marked = done.ends[:, 1] <= SUSPECT
    done.ends[marked, 1] = SUSPECT - done.ends[marked, 1]
    looked = [Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED]
    if method == "radau" or model.stages.reduced.unproven:
        looked += [Status.SUCCESS, Status.EVENT, Status.MAX_STEPS]
    started = np.all(np.isfinite(np.hstack([block.y, block.c, block.spans])), axis=1)
    for i in np.flatnonzero(started & (marked | np.isin(done.ends[:, 1], looked))):
        for bounded in (False, True) if marked[i] else (False,):  # as a single run, then with the steps of the sweep
            problem = replace(block.problem(int(i), dense=True), bounded=bounded)
            if _ended_alone(model, method, block, done, int(i), problem):
                break


def _ended_alone(
    model: CompiledModel, method: str, block: CaseBlock, done: BlockResult, i: int, problem: IntegrationProblem
) -> bool:
    """Run case i alone, and end it if it met a singular configuration; return whether it did."""
    c, before = model.engine.constants_along(problem), 0
    for solution in _alone(model, method, block, problem):
        ended = _ended(model, block, problem, solution, c)
        if ended is not None:
            forward = 1.0 if problem.t1 >= problem.t0 else -1.0
            steps = max(1, int(np.sum((solution.t - ended) * forward <= 0.0)))
            status = float(Status.SINGULAR_CONFIGURATION)
            done.y[i], done.ends[i] = solution.y[steps - 1], (solution.t[steps - 1], status, before + steps - 1)
            done.samples[i, (block.t_eval - ended) * forward > 0.0] = np.nan
            done.totals[i] = np.nan
            done.happened[i] = np.nan
            done.happened[i, ::3] = 0.0
            return True
        before += len(solution.t) - 1
    return False


def _ended(
    model: CompiledModel, block: CaseBlock, problem: IntegrationProblem, solution: Solution, c: Constants
) -> float | None:
    """Return the last time before a singular configuration in a run, or a part of one; None where it met none."""
    program, forward = model.stages.program, 1.0 if problem.t1 >= problem.t0 else -1.0
    requested = block.t_eval[(block.t_eval - solution.t[-1]) * forward <= 0.0]
    requested = requested[(requested - solution.t[0]) * forward >= 0.0]
    times = forward * np.union1d(forward * solution.t, forward * requested)
    states = solution.y if solution.dense is None else solution.dense(times)
    found = replace(solution, t=times, y=states)
    if model.derived.enforced:
        found, _ = checked_run(program, found, c, model.derived.enforced, solution, (problem.t0, problem.t1))
    if found.status is not Status.SINGULAR_CONFIGURATION:
        part = replace(problem, t0=float(solution.t[0]), y0=solution.y[0])
        found, _ = ended_where_left_out_matter(program, model.stages.reduced, part, found, c)
    return float(found.t[-1]) if found.status is Status.SINGULAR_CONFIGURATION else None


def _alone(model: CompiledModel, method: str, block: CaseBlock, problem: IntegrationProblem) -> Iterator[Solution]:
    """Yield a case of a block with its continuous output, and with its events where it has any.

    Without constraints that need not follow everywhere it comes in parts: beyond the place where these matter, steps
    may become very small.
    """
    engine = model.engine
    blocks = partial(engine.step_blocks, method=method)
    if block.watch is None or not block.watch.reported:
        return blocks(problem) if model.stages.reduced.unproven else iter([engine.integrate(problem, method)])
    from ..integrators.chaining import blocks_between_knots
    from ..integrators.events import integrate_watched

    watched = block.watch.watched(engine.constants_along(problem))
    between = partial(blocks_between_knots, blocks) if block.watch.reads_inputs else blocks
    return iter([integrate_watched(between, problem, watched)[0]])
