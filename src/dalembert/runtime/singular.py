"""Singular configurations that a run meets, and redundant constraints that it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..codegen.base import Engine
from ..integrators.cases import BlockResult, CaseBlock
from ..integrators.dense_output import JoinedOutput
from ..integrators.problem import IntegrationProblem, Solution
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..methods.status import Status
from .constraint_rank import jacobians_at, lengths_along, shares, where_dependent
from .crossed_ranks import crossing
from .state_sizes import coordinate_sizes

__all__ = ["check_cases", "checked_run", "cut", "searched", "still_redundant"]

_NEAR = 0.05
"""Share below which a run that failed is taken to have failed for it."""


def checked_run(
    program: Program,
    solution: Solution,
    c: Constants,
    enforced: Sequence[int],
    steps: Solution,
    span: tuple[float, float],
) -> tuple[Solution, str]:
    """Return a run ended where it met a singular configuration, and where that was.

    A run that failed near one ended because of it. One whose formulation does not project its steps is also searched
    for one that it has crossed, beyond which its branch would be a matter of chance; projected runs cross them, and
    are refused where they would change their branch. `steps` is the same run with its accepted steps for records,
    `span` its start and end as given.
    """
    if len(steps.t) == 0:
        return solution, ""
    if searched(program):
        found = crossing(program, solution, c, enforced)
        if found is not None:
            t, y = found
            return cut(solution, t, span), where_dependent(program, t, y, c, enforced)
    if not solution.success and solution.status is not Status.MAX_STEPS:
        j = jacobians_at(program, steps.t, steps.y, c, enforced)
        if shares(j[-1:], lengths_along(program, steps.t, steps.y, c, j, enforced))[0] < _NEAR:
            where = where_dependent(program, float(steps.t[-1]), steps.y[-1], c, enforced)
            return replace(solution, status=Status.SINGULAR_CONFIGURATION), where
    return solution, ""


def searched(program: Program) -> bool:
    """Return whether runs are searched for singular configurations that they have crossed: those not projected."""
    return "project_velocity" not in program


def check_cases(
    program: Program, engine: Engine, method: str, enforced: Sequence[int], block: CaseBlock, done: BlockResult
) -> None:
    """Check cases that came near a lost rank, or failed, by runs alone; end those that met a singular configuration.

    Those of "radau", which run alone in any case, are not marked, and all looked at. Samples behind the
    place are NaN, as are reductions, and events are not reported.
    """
    from ..integrators.event_code import SUSPECT

    marked = done.ends[:, 1] <= SUSPECT
    done.ends[marked, 1] = SUSPECT - done.ends[marked, 1]
    looked = [Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED]
    if method == "radau":
        looked += [Status.SUCCESS, Status.EVENT, Status.MAX_STEPS]
    started = np.all(np.isfinite(np.hstack([block.y, block.c, block.spans])), axis=1)
    for i in np.flatnonzero(started & (marked | np.isin(done.ends[:, 1], looked))):
        for bounded in (False, True) if marked[i] else (False,):  # as a single run, then with the steps of the sweep
            problem = replace(block.problem(int(i), dense=True), bounded=bounded)
            if _ended_alone(program, engine, method, enforced, block, done, int(i), problem):
                break


def _ended_alone(
    program: Program,
    engine: Engine,
    method: str,
    enforced: Sequence[int],
    block: CaseBlock,
    done: BlockResult,
    i: int,
    problem: IntegrationProblem,
) -> bool:
    """Run case i alone, and end it if it met a singular configuration; return whether it did."""
    solution, forward = _alone(engine, method, block, problem), 1.0 if problem.t1 >= problem.t0 else -1.0
    requested = block.t_eval[(block.t_eval - solution.t[-1]) * forward <= 0.0]
    times = forward * np.union1d(forward * solution.t, forward * requested)
    states = solution.y if solution.dense is None else solution.dense(times)
    c = engine.constants_along(problem)
    found, _ = checked_run(
        program, replace(solution, t=times, y=states), c, enforced, solution, (problem.t0, problem.t1)
    )
    if found.status is not Status.SINGULAR_CONFIGURATION:
        return False
    steps = max(1, int(np.sum((solution.t - found.t[-1]) * forward <= 0.0)))
    done.y[i], done.ends[i] = solution.y[steps - 1], (solution.t[steps - 1], found.status, steps - 1)
    done.samples[i, (block.t_eval - found.t[-1]) * forward > 0.0] = np.nan
    done.totals[i] = np.nan
    done.happened[i] = np.nan
    done.happened[i, ::3] = 0.0
    return True


def _alone(engine: Engine, method: str, block: CaseBlock, problem: IntegrationProblem) -> Solution:
    """Return a case of a block with its continuous output, and with its events where it has any."""
    if block.watch is None or not block.watch.reported:
        return engine.integrate(problem, method)
    from ..integrators.chaining import blocks_between_knots
    from ..integrators.events import integrate_watched

    watched, blocks = block.watch.watched(engine.constants_along(problem)), partial(engine.step_blocks, method=method)
    between = partial(blocks_between_knots, blocks) if block.watch.reads_inputs else blocks
    return integrate_watched(between, problem, watched)[0]


def cut(
    solution: Solution, t: float, span: tuple[float, float], status: Status = Status.SINGULAR_CONFIGURATION
) -> Solution:
    """Return a run over a span that ends before time t with the status of a singular configuration, or another.

    Its start is kept where it was recorded, and nothing that lies behind its end.
    """
    forward = span[1] >= span[0]
    kept = (solution.t < t if forward else solution.t > t) | (solution.t == span[0])
    dense = None if solution.dense is None else JoinedOutput(np.array([span[0], t]), [solution.dense])
    wrapped = None if solution.wrapped is None else solution.wrapped[kept]
    times = solution.t[kept]
    return replace(solution, status=status, t=times, y=solution.y[kept], dense=dense, wrapped=wrapped, end=t)


def still_redundant(
    program: Program,
    solution: Solution,
    c: Constants,
    left_out: Sequence[int],
    tolerance: float,
    span: tuple[float, float],
) -> tuple[Solution, str]:
    """Return a run, ended before constraints that were left out as redundant are violated by more than rounding.

    The tolerance is relative to the sizes of what the coordinates add to them.
    """
    places = [i for i in left_out if i < program.layout.holonomic]
    if not places or len(solution.t) == 0:
        return solution, ""
    c = constants_at(c, solution.t)
    x = interpret_rows(program.kernel("expand"), solution.t, solution.y, c)
    left = np.abs(interpret_rows(program.kernel("position_residual"), solution.t, x, c)[:, places])
    n = len(program.layout.coordinates)
    rows = interpret_rows(program.kernel("constraint_jacobian"), solution.t, x, c).reshape(len(x), -1, n)[:, places]
    first = coordinate_sizes(program, solution.t[:1], x[:1], c if c.ndim == 1 else c[:1])[0]
    size = np.maximum(np.max(np.abs(x[:, :n]), axis=0), first)
    wrong = np.any(left > tolerance * np.max(np.abs(rows) @ size, axis=0), axis=1)
    if not np.any(wrong):
        return solution, ""
    first = int(np.argmax(wrong))
    label = program.layout.constraints[places[int(np.argmax(left[first]))]]
    note = f"at t = {solution.t[first]:.6g} {label} no longer follows from the others, as it did around the start"
    return cut(solution, float(solution.t[first]), span), note
