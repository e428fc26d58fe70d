"""Rank of the constraints: redundant ones at the start of a run, and singular configurations.

Measured by the smallest singular value of the constraint Jacobian, its `share` below, with rows of length one: 1 for
constraints that are orthogonal to each other, 0 where one follows from others. A row that vanishes somewhere is to
count as dependent there, so that rows are measured by how long they are elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.base import Engine
from ..errors import list_names
from ..integrators.cases import BlockResult, CaseBlock
from ..integrators.problem import IntegrationProblem, JoinedOutput, Solution
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..methods.status import Status

__all__ = [
    "cut",
    "indeterminate",
    "judged",
    "judged_cases",
    "nearly_redundant",
    "redundant",
    "searched",
    "singular_start",
    "still_redundant",
    "unlike",
]

_LOST = 1e-7
"""Share below which rank is lost."""

_ROUNDED = 1e-11
"""Share below which a constraint follows from the others up to rounding; larger differences are meant."""

_NEAR = 0.05
"""Share below which a run that failed is taken to have failed for it."""

CROSSED = 1e-5
"""Share below which a minimum along a motion is one where rank is lost."""


_NEARBY = 1e-3
_PER_STEP = 3


def _jacobians(program: Program, t: FloatArray, x: FloatArray, c: FloatArray, enforced: Sequence[int]) -> FloatArray:
    """Return constraint Jacobians (k, n_enforced, n_q) at coordinates and rates x (k, 2 n_q)."""
    layout = program.layout
    rows = interpret_rows(program.kernel("constraint_jacobian"), t, x, c)
    return rows.reshape(len(t), len(layout.constraints), len(layout.coordinates))[:, list(enforced)]


def _at_states(program: Program, t: FloatArray, y: FloatArray, c: Constants, enforced: Sequence[int]) -> FloatArray:
    c = constants_at(c, t)
    return _jacobians(program, t, interpret_rows(program.kernel("expand"), t, y, c), c, enforced)


def _lengths(j: FloatArray) -> FloatArray:
    """Return what rows are measured by (n_enforced,): their longest, at the least a tenth of the longest of all."""
    longest = np.nanmax(np.linalg.norm(j, axis=2), axis=0)
    found: FloatArray = np.maximum(longest, 0.1 * longest.max())
    return np.where(found > 0.0, found, 1.0)


def _shares(j: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return the smallest singular values (k,) of Jacobians (k, n_enforced, n_q), NaN where they are not finite."""
    found = np.full(len(j), np.nan)
    fine = np.all(np.isfinite(j), axis=(1, 2))
    if j.shape[1] == 1:
        found = np.linalg.norm(j[:, 0], axis=1) / lengths[0]
    elif j.shape[1] > j.shape[2]:
        found[fine] = 0.0
    elif np.any(fine):
        found[fine] = np.linalg.svd(j[fine] / lengths[:, np.newaxis], compute_uv=False)[:, -1]
    return found


def _dependent(j: FloatArray, share: float = _LOST) -> list[int]:
    """Return the rows of a Jacobian with rows of length one of which less than a share is new."""
    basis: list[FloatArray] = []
    found = []
    for i, row in enumerate(j):
        rest = row
        for _ in range(2):
            for direction in basis:
                rest = rest - (rest @ direction) * direction
        length = float(np.linalg.norm(rest))
        if length < share:
            found.append(i)
        else:
            basis.append(rest / length)
    return found


def redundant(
    program: Program, t: float, y: FloatArray, c: FloatArray, enforced: Sequence[int]
) -> tuple[int, ...] | None:
    """Return the constraints that follow from others at a start y (n_y,) and all around it.

    Returns
    -------
    tuple of int or None
        Their numbers; none for constraints that are independent. None where the start alone is singular.
    """
    times = np.array([t])
    j = _at_states(program, times, y[np.newaxis], c, enforced)
    if not np.all(np.isfinite(j)):
        return ()
    lengths = _lengths(j)[:, np.newaxis]
    lost = _dependent(j[0] / lengths)
    if not lost:
        return ()
    for x in _around(program, t, y, c, j[0] / lengths):
        near = _jacobians(program, times, x[np.newaxis], c, enforced)[0]
        if np.all(np.isfinite(near)) and len(_dependent(near / lengths)) < len(lost):
            return None
    return tuple(enforced[i] for i in lost)


def nearly_redundant(program: Program, t: float, y: FloatArray, c: FloatArray, enforced: Sequence[int]) -> str:
    """Return where constraints are so nearly dependent that double precision does not tell, or nothing.

    They do not follow from each other: what they differ by is more than rounding, and is lost when it is squared.
    """
    times, rows = np.array([t]), list(enforced)
    x = interpret_rows(program.kernel("expand"), times, y[np.newaxis], c)[0]
    j = _jacobians(program, times, _closed(program, t, x, c)[np.newaxis], c, rows)
    if not np.all(np.isfinite(j)):
        return ""
    j = j[0] / _lengths(j)[:, np.newaxis]
    if len(_dependent(j, _ROUNDED)) == len(_dependent(j)):
        return ""
    return (
        f"{_where(program, t, y, c, enforced)}, by more than rounding: which motions they allow cannot be told with"
        " this formulation in double precision. Make them equal or more different, or use formulation='minimal'"
    )


def unlike(
    program: Program, t: FloatArray, y: FloatArray, c: FloatArray, rows: Sequence[int], *, lost: bool
) -> NDArray[np.bool_]:
    """Return which starts t (k,), y (k, n_y), c (k, n_c) have constraints that depend on each other, or do not.

    Parameters
    ----------
    rows : sequence of int
        The constraints.
    lost : bool
        Whether some of them are expected to follow from others.
    """
    found = np.zeros(len(t), bool)
    fine = np.flatnonzero(np.all(np.isfinite(np.column_stack([t, y, c])), axis=1))
    if not len(fine):
        return found
    j = _at_states(program, t[fine], y[fine], c[fine], rows)
    lengths = np.linalg.norm(j, axis=2, keepdims=True)
    lengths = np.maximum(lengths, 0.1 * np.max(lengths, axis=1, keepdims=True))
    shares = _shares(j / np.where(lengths > 0.0, lengths, 1.0), np.ones(len(rows)))
    found[fine] = np.isfinite(shares) & ((shares < _LOST) != lost)
    return found


def _around(program: Program, t: float, y: FloatArray, c: FloatArray, j: FloatArray) -> list[FloatArray]:
    """Return coordinates and rates at some configurations near a start that fulfil the constraints."""
    times, n = np.array([t]), len(program.layout.coordinates)
    x0 = interpret_rows(program.kernel("expand"), times, y[np.newaxis], c)[0]
    _, values, directions = np.linalg.svd(j)
    free = directions[int(np.sum(values > _LOST)) :]
    found = []
    for direction in [*free, np.sum(free, axis=0)]:
        x = x0.copy()
        x[:n] += _NEARBY * direction
        found.append(_closed(program, t, x, c))
    return found


def _closed(program: Program, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return coordinates and rates x (2 n_q,) with the coordinates moved onto the constraints."""
    times, n = np.array([t]), len(program.layout.coordinates)
    if "position_residual" not in program:
        return x
    x = x.copy()
    for _ in range(8):
        left = interpret_rows(program.kernel("position_residual"), times, x[np.newaxis], c)[0]
        whole = interpret_rows(program.kernel("constraint_jacobian"), times, x[np.newaxis], c)[0]
        rows = whole.reshape(-1, n)[: len(left)]
        if not (np.all(np.isfinite(left)) and np.all(np.isfinite(rows))):
            break
        x[:n] -= np.linalg.pinv(rows, rcond=1e-5) @ left
    return x


def _where(program: Program, t: float, y: FloatArray, c: Constants, enforced: Sequence[int]) -> str:
    """Return which constraints come to depend on each other, and where."""
    layout = program.layout
    times, rows = np.array([t]), y[np.newaxis]
    c = constants_at(c, times)
    j = _at_states(program, times, rows, c, enforced)
    left, values, _ = np.linalg.svd(j[0] / _lengths(j)[:, np.newaxis])
    weights = np.abs(left[:, -1])
    labels = [layout.constraints[enforced[i]] for i in range(len(weights)) if weights[i] > 0.2 * weights.max()]
    x = interpret_rows(program.kernel("expand"), times, rows, c)[0]
    place = ", ".join(f"{name} = {x[i]:.6g}" for i, name in enumerate(layout.coordinates))
    return (
        f"at t = {t:.6g} ({place}) the constraints {list_names(labels)} depend on each other, or nearly so (smallest"
        f" singular value {values[-1]:.1e})"
    )


def singular_start(program: Program, t: float, y: FloatArray, c: FloatArray, enforced: Sequence[int]) -> str:
    """Return the note of a run that would start at a singular configuration."""
    return f"{_where(program, t, y, c, enforced)}, and not around it: start elsewhere, or use other coordinates"


def judged(
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
    `span` its start and end as they were asked for.
    """
    if len(steps.t) == 0:
        return solution, ""
    if searched(program):
        crossing = _crossing(program, solution, c, enforced)
        if crossing is not None:
            t, y = crossing
            return cut(solution, t, span), _where(program, t, y, c, enforced)
    if not solution.success and solution.status is not Status.MAX_STEPS:
        j = _at_states(program, steps.t, steps.y, c, enforced)
        if _shares(j[-1:], _lengths(j))[0] < _NEAR:
            where = _where(program, float(steps.t[-1]), steps.y[-1], c, enforced)
            return replace(solution, status=Status.SINGULAR_CONFIGURATION), where
    return solution, ""


def searched(program: Program) -> bool:
    """Return whether runs are searched for singular configurations that they have crossed: those not projected."""
    return "project_velocity" not in program


def _crossing(
    program: Program, solution: Solution, c: Constants, enforced: Sequence[int]
) -> tuple[float, FloatArray] | None:
    """Return the first time and state at which rank is lost."""
    t, y = solution.t, solution.y
    dense = solution.dense
    if dense is None and not len(t):
        return None
    if dense is not None:
        knots = dense.knots
        parts = np.linspace(0.0, 1.0, _PER_STEP, endpoint=False)
        t = np.append((knots[:-1, np.newaxis] + np.diff(knots)[:, np.newaxis] * parts).ravel(), knots[-1])
        y = dense(t)
    j = _at_states(program, t, y, c, enforced)
    lengths = _lengths(j)
    profile = _shares(j, lengths)
    beside = np.concatenate([profile[:1], profile, profile[-1:]])
    with np.errstate(invalid="ignore"):
        least = (profile < 0.5) & (profile <= beside[:-2]) & (profile <= beside[2:])
    for i in np.flatnonzero(least).tolist():
        before, after = max(i - 1, 0), min(i + 1, len(t) - 1)
        place, state, share = float(t[i]), y[i], float(profile[i])
        if dense is not None:
            first, last = float(t[before]), float(t[after])
            for _ in range(6):
                times = np.linspace(first, last, 17)
                states = dense(times)
                fine = _shares(_at_states(program, times, states, c, enforced), lengths)
                k = int(np.argmin(np.nan_to_num(fine, nan=np.inf)))
                place, state, share = float(times[k]), states[k], float(fine[k])
                first, last = float(times[max(k - 1, 0)]), float(times[min(k + 1, 16)])
        if share < CROSSED:
            return place, state
    return None


def judged_cases(
    program: Program, engine: Engine, method: str, enforced: Sequence[int], block: CaseBlock, done: BlockResult
) -> None:
    """Look alone at cases that came near a lost rank, or failed; end those that met one there.

    Those of "radau", which run alone in any case, are not marked, and all looked at. Samples behind the
    place are NaN, as are reductions, and nothing is said of events.
    """
    from ..integrators.event_code import SUSPECT

    marked = done.ends[:, 1] <= SUSPECT
    done.ends[marked, 1] = SUSPECT - done.ends[marked, 1]
    looked = [Status.STEP_TOO_SMALL, Status.NON_FINITE, Status.PROJECTION_FAILED]
    if method == "radau":
        looked += [Status.SUCCESS, Status.EVENT, Status.MAX_STEPS]
    started = np.all(np.isfinite(np.hstack([block.y, block.c, block.spans])), axis=1)
    for i in np.flatnonzero(started & (marked | np.isin(done.ends[:, 1], looked))):
        problem = block.problem(int(i), dense=True)
        solution, forward = _alone(engine, method, block, problem), 1.0 if problem.t1 >= problem.t0 else -1.0
        wanted = block.t_eval[(block.t_eval - solution.t[-1]) * forward <= 0.0]
        times = forward * np.union1d(forward * solution.t, forward * wanted)
        states = solution.y if solution.dense is None else solution.dense(times)
        course = engine.course(problem)
        found, _ = judged(
            program, replace(solution, t=times, y=states), course, enforced, solution, (problem.t0, problem.t1)
        )
        if found.status is not Status.SINGULAR_CONFIGURATION:
            continue
        steps = max(1, int(np.sum((solution.t - found.t[-1]) * forward <= 0.0)))
        done.y[i], done.ends[i] = solution.y[steps - 1], (solution.t[steps - 1], found.status, steps - 1)
        done.samples[i, (block.t_eval - found.t[-1]) * forward > 0.0] = np.nan
        done.totals[i] = np.nan
        done.happened[i] = np.nan
        done.happened[i, ::3] = 0.0


def _alone(engine: Engine, method: str, block: CaseBlock, problem: IntegrationProblem) -> Solution:
    """Return a case of a block with its continuous output, and with its events where it has any."""
    if block.watch is None or not block.watch.reported:
        return engine.integrate(problem, method)
    from ..integrators.chaining import blocks_between_knots
    from ..integrators.events import integrate_watched

    watched, blocks = block.watch.watched(engine.course(problem)), partial(engine.step_blocks, method=method)
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
    near = None if solution.near is None else solution.near[kept]
    times = solution.t[kept]
    return replace(solution, status=status, t=times, y=solution.y[kept], dense=dense, near=near, end=t)


def still_redundant(
    program: Program,
    solution: Solution,
    c: Constants,
    left_out: Sequence[int],
    tolerance: float,
    span: tuple[float, float],
) -> tuple[Solution, str]:
    """Return a run ended before constraints that were left out as redundant come to be violated by more than rounding.

    The tolerance is relative to the size of the coordinates.
    """
    places = [i for i in left_out if i < program.layout.holonomic]
    if not places or len(solution.t) == 0:
        return solution, ""
    c = constants_at(c, solution.t)
    x = interpret_rows(program.kernel("expand"), solution.t, solution.y, c)
    left = np.abs(interpret_rows(program.kernel("position_residual"), solution.t, x, c)[:, places])
    wrong = np.max(left, axis=1) > tolerance * max(1.0, float(np.max(np.abs(x), initial=0.0)))
    if not np.any(wrong):
        return solution, ""
    first = int(np.argmax(wrong))
    label = program.layout.constraints[places[int(np.argmax(left[first]))]]
    note = f"at t = {solution.t[first]:.6g} {label} no longer follows from the others, as it did around the start"
    return cut(solution, float(solution.t[first]), span), note


def indeterminate(program: Program, t: float, y: FloatArray, c: FloatArray) -> str:
    """Return which of the requested reactions the equations do not determine at a state, as a note."""
    if "reaction_matrix" not in program:
        return ""
    layout = program.layout
    x = interpret_rows(program.kernel("expand"), np.array([t]), y[np.newaxis], c)
    rows = interpret_rows(program.kernel("reaction_matrix"), np.array([t]), x, c)
    matrix = rows.reshape(len(layout.coordinates), len(layout.unknowns))
    if not np.all(np.isfinite(matrix)):
        return ""
    _, values, directions = np.linalg.svd(matrix)
    loose = directions[int(np.sum(values > _LOST * values.max(initial=0.0))) :]
    weights = np.max(np.abs(loose), axis=0, initial=0.0)
    names = [n for n, weight in zip(layout.unknowns, weights, strict=True) if weight > _LOST and n in layout.outputs]
    return f"the reactions {list_names(names)} are not determined here, and the least ones are given" if names else ""
