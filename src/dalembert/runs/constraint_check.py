"""Runs that end where their constraints lose rank, or where constraints that were left out no longer follow."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray
from ..errors import list_names
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import SUSPECT, Status
from ..options import NamedTolerances
from ..reduction.base import ReducedSystem
from ..reduction.dependent_rows import Groups
from ..starts.constraint_rank import indeterminate
from ..starts.constraint_rows import jacobians_at, lengths_along, rank_of
from ..starts.state_sizes import coordinate_sizes
from ..steps.problem import IntegrationProblem, Solution
from ..stops.segments import Constants, constants_at
from .run_check import EndedRun, RunCheck, ended_alone
from .sampling import NoInstants
from .singular import checked_run, cut, searched, vanishing_choice

if TYPE_CHECKING:
    from ..model.model import CompiledModel


# Runs without constraints that follow from others: ended where they no longer follow, or no longer are enforced.
#
# What holds around the start of a run need not hold everywhere. The constraints that are enforced may lose rank where
# all together do not: of a parallelogram, the difference of the heights at which its cranks end, where these are
# level. And a constraint that was left out may be violated.

_LEAST, _ERRORS = 1e-6, 1e3
"""Least violation of a constraint that is more than an error of the run, as a share of its terms, and in tolerances."""

_SLOPE, _FAR = 10.0, 1e-2
"""Change of a unit row by a change of coordinates by their sizes that counts as ordinary, and the largest violation of
constraints beside which some follow from others: what drifts further says nothing of them."""


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
        f" {others}, not enforced because it followed from them around the start. All are enforced together where"
        " groups of them have a rank of 5 at most, no first integrals are kept and, in scenes with contacts, these have"
        " no friction and the formulation is 'projected'. Elsewhere write the closed loop with fewer constraints that"
        " are independent everywhere (of a parallelogram, the difference of two angles), or end the time span before"
    )


def _followed(program: Program, reduced: ReducedSystem) -> str:
    """Return the note on constraints that are enforced though they follow from others."""
    assert reduced.redundancy is not None
    labels = "; ".join(program.layout.constraints[i] for i in reduced.redundancy.following)
    return f"enforced together with the others, though it follows from the others around the start: {labels}"


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
    atol: tuple[float | FloatArray, ...] = problem.atol, problem.atol
    if isinstance(problem.atol, NamedTolerances):
        atol = problem.atol.of(program.layout.coordinates), problem.atol.of(program.layout.rates)
    shares = [np.maximum(_ERRORS * (problem.rtol + own), _LEAST) for own in atol]
    positions = shares[0] * np.maximum(np.max(np.abs(x[:, :n]), axis=0), first)
    rates = shares[1] * np.max(np.abs(x[:, n : 2 * n]), axis=0) + _ERRORS * atol[1] * first
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


def ended_where_rank_grows(
    program: Program,
    enforced: Sequence[int],
    rank: int | Groups,
    problem: IntegrationProblem,
    solution: Solution,
    c: Constants,
) -> tuple[Solution, str]:
    """Return a run ended where constraints that are enforced together have more rank, and a note on where that is.

    There a mechanism locks. What is enforced then leaves the part of positions that is no change by coordinates, by
    more than the square of what errors leave of the other part.
    """
    t = solution.t if solution.dense is None else solution.dense.knots
    enforced = [row for row in enforced if row < program.layout.holonomic]
    if not isinstance(rank, int):
        rank = rank_of(tuple(group for group in rank if max(group[0]) < len(enforced)))
    if len(t) == 0 or rank in (0, len(enforced)):
        return solution, ""
    y = solution.y if solution.dense is None else solution.dense(t)
    own, n = constants_at(c, t), len(program.layout.coordinates)
    x = interpret_rows(program.kernel("expand"), t, y, own)
    j = jacobians_at(program, t, y, c, enforced)
    left = interpret_rows(program.kernel("position_residual"), t, x, own)[:, list(enforced)]
    fine = np.flatnonzero(np.all(np.isfinite(j), axis=(1, 2)) & np.all(np.isfinite(left), axis=1))
    if not len(fine):
        return solution, ""
    lengths = lengths_along(program, t, y, c, j, enforced)
    basis = np.linalg.svd(j[fine] / lengths[:, np.newaxis], full_matrices=False)[0][:, :, :rank]
    left = left[fine] / lengths
    within = np.einsum("kir,kr->ki", basis, np.einsum("kir,ki->kr", basis, left))
    sizes = coordinate_sizes(program, t[:1], x[:1], own if own.ndim == 1 else own[:1])[0]
    most = np.max(np.abs(x[fine, :n]) / sizes, initial=1.0)
    limit = max(_ERRORS * (problem.rtol + problem.atol), _LEAST) * most + _SLOPE * np.linalg.norm(within, axis=1) ** 2
    beside = np.linalg.norm(left - within, axis=1) > limit
    wrong = fine[beside | (np.linalg.norm(within, axis=1) > _FAR * most)]
    if not len(wrong):
        return solution, ""
    at = float(t[wrong[0]])
    labels = list_names(program.layout.constraints[i] for i in enforced)
    note = (
        f"at t = {at:.6g} the constraints {labels} are no longer fulfilled together: of these only {rank} were"
        " independent around the start, and more are here, so that the mechanism locks"
    )
    return cut(solution, at, (problem.t0, problem.t1)), note


@final
@frozen(eq=False)
class ConstraintCheck(RunCheck):
    """The constraints that a model enforces and that may lose rank, and those left out that need not follow from them.

    Runs whose formulation does not project are searched for losses of rank that they have crossed, others are looked at
    where they failed.
    """

    model: CompiledModel
    enforced: Sequence[int]
    reduced: ReducedSystem

    @classmethod
    def of(cls, model: CompiledModel) -> ConstraintCheck | None:
        """Return the check of a model; None where its constraints are independent everywhere."""
        enforced, reduced = model.derived.enforced, model.stages.reduced
        return cls(model, enforced, reduced) if enforced or reduced.unproven else None

    def before(self, problem: IntegrationProblem) -> IntegrationProblem:
        """See `RunCheck.before`: between steps too it is found out whether constraints that were left out follow."""
        return replace(problem, dense=True) if self.reduced.unproven or self._rank is not None else problem

    @property
    def _rank(self) -> int | Groups | None:
        """The ranks of constraints that are enforced together, though some follow from others; None without such."""
        redundancy = self.reduced.redundancy
        return None if redundancy is None else redundancy.ranks

    def after(self, run: EndedRun) -> tuple[Solution, str]:
        """See `RunCheck.after`."""
        program, solution, c, notes = self.model.stages.program, run.solution, run.constants, []
        if self.enforced:
            if solution.status is not Status.SINGULAR_CONFIGURATION:
                about = program, solution, c, self.enforced, run.steps, run.span, self._rank
                solution, where = checked_run(*about, named=True)
                notes.append(where)
            problem = run.problem
            if self._rank is not None:
                ranked = program, self.enforced, self._rank, problem
                solution, locked = ended_where_rank_grows(*ranked, solution, c)
                notes += [locked, _followed(program, self.reduced)]
            notes.append(indeterminate(program, problem.t0, problem.y0, problem.constants))
        if self.reduced.unproven:
            solution, broken = ended_where_left_out_matter(program, self.reduced, run.problem, solution, c)
            notes += [self.model.note, broken]
        return solution, "; ".join(text for text in notes if text)

    @property
    def _ranked(self) -> bool:
        """Whether the cases of sweeps are searched for a rank that the constraints lose."""
        found = self._rank is not None or searched(self.model.stages.program)
        return bool(self.enforced and self.model.layout.state) and found

    def guards(self, method: str) -> str:
        """See `RunCheck.guards`: the cases of "radau" run alone in any case, and are all looked at."""
        return "ranks" if self._ranked and method != "radau" else ""

    def after_cases(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """See `RunCheck.after_cases`: cases that came near a lost rank, or failed, run alone once more.

        Where constraints were left out that followed from others around the start, all do. Samples behind the place are
        NaN, as are reductions, and events are not reported.
        """
        if not (self._ranked or self.reduced.unproven):
            return
        status = done.ends[:, 1]
        marked = status <= SUSPECT
        status[marked] = SUSPECT - status[marked]
        looked = [Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED]
        if method == "radau" or self.reduced.unproven:
            looked += [Status.SUCCESS, Status.EVENT, Status.MAX_STEPS]
        suspects = marked | np.isin(status, looked)
        if not suspects.any():
            return
        ended = partial(_ended, self.model, block)
        started = np.all(np.isfinite(np.hstack([block.y, block.c, block.spans])), axis=1)
        for i in np.flatnonzero(started & suspects):
            for bounded in (
                (False, True) if marked[i] else (False,)
            ):  # as a single run, then with the steps of the sweep
                problem = replace(block.problem(int(i), dense=True), bounded=bounded)
                with suppress(NoInstants):  # such a case has not run
                    if ended_alone(self.model, method, block, done, int(i), problem, ended):
                        break


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
    redundancy, span = model.stages.reduced.redundancy, (problem.t0, problem.t1)
    rank = None if redundancy is None else redundancy.ranks
    if model.derived.enforced:
        found, _ = checked_run(program, found, c, model.derived.enforced, solution, span, rank)
    if rank is not None and found.status is not Status.SINGULAR_CONFIGURATION:
        found, _ = ended_where_rank_grows(program, model.derived.enforced, rank, problem, found, c)
    if found.status is not Status.SINGULAR_CONFIGURATION:
        part = replace(problem, t0=float(solution.t[0]), y0=solution.y[0])
        found, _ = ended_where_left_out_matter(program, model.stages.reduced, part, found, c)
    if found.status is not Status.SINGULAR_CONFIGURATION:
        return None
    return float(found.t[-1] if len(found.t) else solution.t[0])
