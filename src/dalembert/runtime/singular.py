"""Singular configurations that a run meets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..integrators.dense_output import JoinedOutput
from ..integrators.problem import Solution
from ..integrators.segments import Constants
from ..ir.program import Program
from ..methods.status import Status
from .constraint_rank import jacobians_at, lengths_along, shares, where_dependent
from .crossed_ranks import crossing

__all__ = ["checked_run", "cut", "searched"]

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
