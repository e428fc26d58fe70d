"""Singular configurations that a run meets or has crossed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..methods.status import Status
from ..reduction.dependent_rows import Groups
from ..starts.branches import branches
from ..starts.constraint_rank import where_dependent
from ..starts.constraint_rows import correction_turns, jacobians_at, kept_shares, lengths_along, shares
from ..steps.dense_output import DenseOutput, JoinedOutput
from ..steps.problem import Solution
from ..stops.segments import Constants, constants_at

# Search of a run for configurations that it has crossed where its constraints lose rank.
#
# Where others were left out as redundant, those that are kept may lose rank where all together do not.
#
# Beyond one the branch of a motion is a matter of chance, unless its positions are projected onto the constraints. A
# run crosses one where the share of `dalembert.starts.constraint_rank` falls to next to nothing. With an error, it
# passes beside it, as on a curve that crosses itself: the share is then as small as the error allows, and that is
# known by the correction of the positions onto the constraints. As far from them as from where rank is lost, the
# correction turns the Jacobian by as much as the share, and may lead to any branch: the number h of the theorem of
# Kantorovich, from 1/2 on (Kantorovich and Akilov, Functional Analysis, chapter XVIII).

_CROSSED = 1e-5
"""Share below which a minimum along a motion is one where rank is lost."""

_KEPT = 0.03
"""Share below which kept constraints no longer enforce those that were left out: errors grow by its inverse."""

_LOW = 0.5
"""Share below which a minimum is looked at."""

_TURN = 0.25
"""Turn of the Jacobian by a correction, over the share, from which on the correction may lead to another branch."""

_BESIDE = 2.0
"""Multiple of a minimal share up to which states count as beside the minimum."""

_PER_STEP = 3
"""Points of each step at which a run is searched for minima."""

_ROUNDS, _POINTS = 6, 17
"""Rounds in which a minimum is located, and the points of each."""


def crossing(
    program: Program, solution: Solution, c: Constants, enforced: Sequence[int], rank: int | Groups | None = None
) -> tuple[float, FloatArray] | None:
    """Return the first time and state at which rank is lost, None without any.

    `rank` is given where the enforced constraints have less than their number, or the groups that they are solved by.
    """
    t, y = _searched_points(solution)
    if not len(t):
        return None
    j = jacobians_at(program, t, y, c, enforced)
    lengths = lengths_along(program, t, y, c, j, enforced)

    def near(t: FloatArray, y: FloatArray) -> FloatArray:
        return shares(jacobians_at(program, t, y, c, enforced), lengths, rank)

    for times, states, found in _minima(t, y, shares(j, lengths, rank), solution.dense, near):
        k = int(np.argmin(np.nan_to_num(found, nan=np.inf)))
        if found[k] < _CROSSED or _ambiguous(program, times, states, c, enforced, lengths, found):
            return float(times[k]), states[k]
    return None


def vanishing_choice(
    program: Program, solution: Solution, c: Constants, kept: Sequence[int]
) -> tuple[float, FloatArray] | None:
    """Return the first time and state at which kept constraints no longer enforce all, None without any.

    They lose rank there, or nearly, and all constraints do not.
    """
    t, y = _searched_points(solution)
    if not len(t) or not kept:
        return None
    rows = range(len(program.layout.constraints))
    j = jacobians_at(program, t, y, c, rows)
    lengths = lengths_along(program, t, y, c, j, rows)

    def near(t: FloatArray, y: FloatArray) -> FloatArray:
        return kept_shares(jacobians_at(program, t, y, c, rows), lengths, kept)

    for times, states, found in _minima(t, y, kept_shares(j, lengths, kept), solution.dense, near):
        with np.errstate(invalid="ignore"):
            low = np.flatnonzero(found < _KEPT)
        if len(low):
            forward = 1.0 if t[-1] >= t[0] else -1.0
            k = low[int(np.argmin(forward * times[low]))]
            return float(times[k]), states[k]
    return None


def _searched_points(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Return times (k,) and states (k, n_y) at which a run is searched: some in every step, as far as it is known."""
    if solution.dense is None:
        return solution.t, solution.y
    parts = np.linspace(0.0, 1.0, _PER_STEP, endpoint=False)
    knots = solution.dense.knots
    t = np.append((knots[:-1, np.newaxis] + np.diff(knots)[:, np.newaxis] * parts).ravel(), knots[-1])
    return t, solution.dense(t)


def _minima(
    t: FloatArray,
    y: FloatArray,
    profile: FloatArray,
    dense: DenseOutput | None,
    shares_at: Callable[[FloatArray, FloatArray], FloatArray],
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield times, states and shares around each minimum of shares (k,) that is low, in their order."""
    beside = np.concatenate([profile[:1], profile, profile[-1:]])
    with np.errstate(invalid="ignore"):
        places = np.flatnonzero((profile < _LOW) & (profile <= beside[:-2]) & (profile <= beside[2:]))
    for i in places.tolist():
        near = slice(max(i - 1, 0), i + 2)
        if dense is None:
            yield t[near], y[near], profile[near]
        else:
            yield _located(dense, (float(t[near][0]), float(t[near][-1])), shares_at)


def _located(
    dense: DenseOutput, span: tuple[float, float], shares_at: Callable[[FloatArray, FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times (k,), states (k, n_y) and shares (k,) around the least share in a span, ever closer to it."""
    tried = []
    for _ in range(_ROUNDS):
        times = np.linspace(*span, _POINTS)
        states = dense(times)
        found = shares_at(times, states)
        tried.append((times, states, found))
        k = int(np.argmin(np.nan_to_num(found, nan=np.inf)))
        span = float(times[max(k - 1, 0)]), float(times[min(k + 1, _POINTS - 1)])
    times, states, found = (np.concatenate(parts) for parts in zip(*tried, strict=True))
    return times, states, found


def _ambiguous(
    program: Program,
    t: FloatArray,
    y: FloatArray,
    c: Constants,
    enforced: Sequence[int],
    lengths: FloatArray,
    found: FloatArray,
) -> bool:
    """Return whether the positions beside a minimum of shares (k,) may belong to several branches."""
    if "position_residual" not in program:
        return False
    with np.errstate(invalid="ignore"):
        beside = found <= _BESIDE * np.nanmin(found)
    t, y = t[beside], y[beside]
    own = constants_at(c, t)
    x = interpret_rows(program.kernel("expand"), t, y, own)
    turns = correction_turns(program, t, x, own, enforced, lengths)
    with np.errstate(invalid="ignore"):
        return bool(np.any(turns > _TURN * found[beside]))


_NEAR = 0.05
"""Share below which a run that failed is taken to have failed for it."""


def checked_run(
    program: Program,
    solution: Solution,
    c: Constants,
    enforced: Sequence[int],
    steps: Solution,
    span: tuple[float, float],
    rank: int | Groups | None = None,
    *,
    named: bool = False,
) -> tuple[Solution, str]:
    """Return a run ended where it met a singular configuration, and where that was.

    A run that failed near one ended because of it. One whose formulation does not project its steps is also searched
    for one that it has crossed, beyond which its branch would be a matter of chance; projected runs cross them, and
    are rejected where they would change their branch. Searched too are those of constraints that are enforced together,
    of a `rank` that is less than their number. The text also has the branches that meet there, where they are to be
    `named`. `steps` is the same run with its accepted steps for records, `span` its
    start and end as given.
    """
    if len(steps.t) == 0:
        return solution, ""
    if rank is not None or searched(program):
        found = crossing(program, solution, c, enforced, rank)
        if found is not None:
            t, y = found
            where = where_dependent(program, t, y, c, enforced, rank)
            met = branches(program, t, y, c, enforced, steps.y) if named else ""
            return cut(solution, t, span), "; ".join(text for text in (where, met) if text)
    if not solution.success and solution.status is not Status.MAX_STEPS:
        j = jacobians_at(program, steps.t, steps.y, c, enforced)
        if shares(j[-1:], lengths_along(program, steps.t, steps.y, c, j, enforced), rank)[0] < _NEAR:
            t, y = float(steps.t[-1]), steps.y[-1]
            where = where_dependent(program, t, y, c, enforced, rank)
            met = branches(program, t, y, c, enforced, steps.y) if named else ""
            text = "; ".join(text for text in (where, met) if text)
            return replace(solution, status=Status.SINGULAR_CONFIGURATION), text
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
