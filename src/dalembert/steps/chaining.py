"""Solutions of consecutive parts of a run, as that of the whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from .dense_output import DenseOutput, JoinedOutput, PiecewisePolynomial
from .problem import Solution


def at_requested(solution: Solution, times: FloatArray | None) -> Solution:
    """Return a solution at the first of the times that it recorded, without the last, its end; at none for None."""
    count = 0 if times is None else min(len(solution.t), len(times) - 1)
    wrapped = None if solution.wrapped is None else solution.wrapped[:count]
    end = solution.end
    if end is None and len(solution.t):
        end = float(solution.t[-1])
    return replace(solution, t=solution.t[:count], y=solution.y[:count], wrapped=wrapped, end=end)


def joined(done: Sequence[Solution], *, recorded: bool, right: bool) -> Solution:
    """Return consecutive solutions as one; states that accepted steps share are kept once.

    `recorded` means that they are at requested times. Of the states on both sides of a break, accepted steps hold the
    first, or where `right` the second.
    """
    if right and not recorded:
        done = [*(at_requested(part, part.t) for part in done[:-1]), done[-1]]
    first = [0 if recorded or right or k == 0 else 1 for k in range(len(done))]
    wrapped = None
    if any(part.wrapped is not None for part in done):
        wrapped = np.concatenate(
            [(part.y if part.wrapped is None else part.wrapped)[i:] for i, part in zip(first, done, strict=True)]
        )
    return Solution(
        status=done[-1].status,
        t=np.concatenate([part.t[i:] for i, part in zip(first, done, strict=True)]),
        y=np.concatenate([part.y[i:] for i, part in zip(first, done, strict=True)]),
        steps=sum(part.steps for part in done),
        rejected=sum(part.rejected for part in done),
        evaluations=sum(part.evaluations for part in done),
        dense=_dense([part.dense for part in done]),
        wrapped=wrapped,
        end=done[-1].end,
        last=done[-1].last,
    )


def _dense(parts: Sequence[DenseOutput | None]) -> DenseOutput | None:
    """Return consecutive continuous outputs as one; None where there is none."""
    found = [part for part in parts if part is not None and len(part.knots) > 1]
    if not found:
        return parts[0]
    polynomials = [part for part in found if isinstance(part, PiecewisePolynomial)]
    if len(polynomials) == len(found) and len({part.coefficients.shape[1] for part in polynomials}) == 1:
        knots = np.concatenate([found[0].knots[:1], *(part.knots[1:] for part in found)])
        return PiecewisePolynomial(knots, np.concatenate([part.coefficients for part in polynomials]))
    edges = np.array([float(found[0].knots[0]), *(float(part.knots[-1]) for part in found)])
    return JoinedOutput(edges, found)
