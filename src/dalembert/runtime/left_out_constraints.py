"""Runs without constraints that follow from others: ended where they no longer follow, or no longer are enforced.

What holds around the start of a run need not hold everywhere. The constraints that are enforced may lose rank where all
together do not: of a parallelogram, the difference of the heights at which its cranks end, where these are level. And
a constraint that was left out may be violated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray
from ..errors import list_names
from ..integrators.problem import IntegrationProblem, Solution
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..reduction.base import ReducedSystem
from .crossed_ranks import vanishing_choice
from .singular import cut
from .state_sizes import coordinate_sizes

__all__ = ["ended_where_left_out_matter"]

_LEAST, _ERRORS = 1e-6, 1e3
"""Least violation of a constraint that is more than an error of the run, as a share of its terms, and in tolerances."""


def ended_where_left_out_matter(
    program: Program, reduced: ReducedSystem, problem: IntegrationProblem, solution: Solution, c: Constants
) -> tuple[Solution, str]:
    """Return a run ended before constraints that were left out need to be enforced, and a note on where that is."""
    if not reduced.unproven or (len(solution.t) == 0 and solution.dense is None):
        return solution, ""
    kept = [i for i in range(len(program.layout.constraints)) if i not in reduced.left_out]
    lost = vanishing_choice(program, solution, c, kept)
    broken = _first_violation(program, reduced.unproven, problem, solution, c)
    forward = 1.0 if problem.t1 >= problem.t0 else -1.0
    ends = [end for end in (lost and (lost[0], _lost(program, reduced, kept, lost, c)), broken) if end]
    if not ends:
        return solution, ""
    t, note = min(ends, key=lambda end: forward * end[0])
    return cut(solution, t, (problem.t0, problem.t1)), note


def _lost(
    program: Program, reduced: ReducedSystem, kept: Sequence[int], where: tuple[float, FloatArray], c: Constants
) -> str:
    t, y = where
    layout, times = program.layout, np.array([t])
    x = interpret_rows(program.kernel("expand"), times, y[np.newaxis], constants_at(c, times))[0]
    place = ", ".join(f"{name} = {x[i]:.6g}" for i, name in enumerate(layout.coordinates))
    enforced, others = (list_names(layout.constraints[i] for i in rows) for rows in (kept, reduced.unproven))
    return (
        f"at t = {t:.6g} ({place}) the enforced constraints {enforced} come to lose rank that they have together with"
        f" {others}, not enforced because it followed from them around the start: write the closed loop with fewer"
        " constraints that are independent everywhere (of a parallelogram, the difference of two angles), or end the"
        " time span before"
    )


def _first_violation(
    program: Program, rows: Sequence[int], problem: IntegrationProblem, solution: Solution, c: Constants
) -> tuple[float, str] | None:
    """Return the first time at which a constraint that is not enforced is violated by more than errors of the run.

    Positions are measured by what the coordinates add to a constraint, rates by what the rates add to it.
    """
    t = solution.t if solution.dense is None else solution.dense.knots
    y = solution.y if solution.dense is None else solution.dense(t)
    c = constants_at(c, t)
    x = interpret_rows(program.kernel("expand"), t, y, c)
    n, holonomic = len(program.layout.coordinates), program.layout.holonomic
    jacobians = np.abs(interpret_rows(program.kernel("constraint_jacobian"), t, x, c).reshape(len(x), -1, n))
    first = coordinate_sizes(program, t[:1], x[:1], c if c.ndim == 1 else c[:1])[0]
    tolerance = max(_ERRORS * (problem.rtol + problem.atol), _LEAST)
    positions = tolerance * np.maximum(np.max(np.abs(x[:, :n]), axis=0), first)
    rates = tolerance * np.max(np.abs(x[:, n : 2 * n]), axis=0) + _ERRORS * problem.atol * first
    found: list[tuple[float, str]] = []
    for row in rows:
        kernel, limits = ("position_residual", positions) if row < holonomic else ("velocity_residual", rates)
        left = np.abs(interpret_rows(program.kernel(kernel), t, x, c)[:, row])
        wrong = np.flatnonzero(left > np.max(jacobians[:, row] @ limits))
        if len(wrong):
            label = program.layout.constraints[row]
            note = f"at t = {t[wrong[0]]:.6g} {label} no longer follows from the others, as it did around the start"
            found.append((float(t[wrong[0]]), note))
    forward = 1.0 if problem.t1 >= problem.t0 else -1.0
    return min(found, key=lambda end: forward * end[0], default=None)
