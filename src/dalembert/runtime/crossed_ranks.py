"""Search of a run for singular configurations that it has crossed: where its constraints lose rank.

Beyond one the branch of a motion is a matter of chance, unless its positions are projected onto the constraints. A run
crosses one where the share of `dalembert.runtime.constraint_rank` falls to next to nothing. With an error, it passes
beside it, as on a curve that crosses itself: the share is then as small as the error allows, and that is known by the
correction of the positions onto the constraints. As far from them as from where rank is lost, the correction turns the
Jacobian by as much as the share, and may lead to any branch: the number h of the theorem of Kantorovich, from 1/2 on
(Kantorovich and Akilov, Functional Analysis, chapter XVIII).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..integrators.dense_output import DenseOutput
from ..integrators.problem import Solution
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from .constraint_rank import correction_turns, jacobians_at, lengths_along, shares

__all__ = ["crossing"]

_CROSSED = 1e-5
"""Share below which a minimum along a motion is one where rank is lost."""

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
    program: Program, solution: Solution, c: Constants, enforced: Sequence[int]
) -> tuple[float, FloatArray] | None:
    """Return the first time and state at which rank is lost, None without any."""
    t, y, dense = solution.t, solution.y, solution.dense
    if dense is None and not len(t):
        return None
    if dense is not None:
        parts = np.linspace(0.0, 1.0, _PER_STEP, endpoint=False)
        knots = dense.knots
        t = np.append((knots[:-1, np.newaxis] + np.diff(knots)[:, np.newaxis] * parts).ravel(), knots[-1])
        y = dense(t)
    j = jacobians_at(program, t, y, c, enforced)
    lengths = lengths_along(program, t, y, c, j, enforced)
    profile = shares(j, lengths)
    for i in _minima(profile).tolist():
        near = slice(max(i - 1, 0), i + 2)
        times, states, found = t[near], y[near], profile[near]
        if dense is not None:
            times, states, found = _located(program, dense, c, enforced, lengths, (float(times[0]), float(times[-1])))
        k = int(np.argmin(np.nan_to_num(found, nan=np.inf)))
        if found[k] < _CROSSED or _ambiguous(program, times, states, c, enforced, lengths, found):
            return float(times[k]), states[k]
    return None


def _minima(profile: FloatArray) -> NDArray[np.intp]:
    """Return the places of minima of shares (k,) that are low."""
    beside = np.concatenate([profile[:1], profile, profile[-1:]])
    with np.errstate(invalid="ignore"):
        return np.flatnonzero((profile < _LOW) & (profile <= beside[:-2]) & (profile <= beside[2:]))


def _located(
    program: Program,
    dense: DenseOutput,
    c: Constants,
    enforced: Sequence[int],
    lengths: FloatArray,
    span: tuple[float, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times (k,), states (k, n_y) and shares (k,) around the least share in a span, ever closer to it."""
    tried = []
    for _ in range(_ROUNDS):
        times = np.linspace(*span, _POINTS)
        states = dense(times)
        found = shares(jacobians_at(program, times, states, c, enforced), lengths)
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
