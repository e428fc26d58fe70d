"""How a case with contacts goes on, by the verdict of a kernel: see `dalembert.runtime.hybrid.deciding.judge`."""

from __future__ import annotations

import math

from .compiled_subset import compiled_subset
from .phase_tables import Bench, Fleet, Plan

__all__ = ["NOISE", "REGULAR", "ROUNDING", "chosen", "go_on", "pose"]

NOISE = 1e-8
"""Share of a velocity, or of a position, below which it counts as zero."""

ROUNDING = 1e-9
"""Share of the forces, or rates, within which a comparison may go either way."""

REGULAR = 1e-6
"""Share of its diagonal entry that a pivot must have, so that a decision by kernels is trusted."""


@compiled_subset
def pose(plan: Plan, fleet: Fleet, bench: Bench, rule: int, i: int, lane: int) -> None:
    """Write the directions of a case, those of its slip velocities where it has any, and its sides behind its state."""
    n, k = fleet.x.shape[1], fleet.sides.shape[1]
    for m in range(k):
        slip, way = bench.slips[m, lane], fleet.directions[i, 2 * m]
        if slip > 0.0:
            way = 1.0
        if slip < 0.0:
            way = -1.0
        bench.posed[n + m, lane] = way
        bench.posed[n + k + m, lane] = fleet.sides[i, m] if plan.rules.known[rule] != 0 else 1.0


@compiled_subset
def chosen(plan: Plan, bench: Bench, rule: int, lane: int) -> int:
    """Return the first attempt of a rule that contradicts nothing, -1 where that is not sure."""
    first, verdict = plan.rules.first_attempt[rule], bench.verdict
    strict, loose, clear, torn = -1, -1, 0, False
    for a in range(plan.rules.attempts[rule]):
        margin = verdict[2 + a, lane]
        if strict < 0 and margin >= 0.0:
            strict = a
        if loose < 0 and margin >= -ROUNDING:
            loose = a
        if margin > ROUNDING:
            torn = torn or clear & plan.attempts.apart[first + a] != 0
            clear += 1 << a
    if torn or not math.isfinite(verdict[1, lane]) or not verdict[0, lane] >= REGULAR:
        return -1
    if strict < 0 and plan.rules.known[rule] != 0:
        return -1
    best = strict if strict >= 0 else loose
    return first + best if best >= 0 else -1


@compiled_subset
def go_on(plan: Plan, fleet: Fleet, bench: Bench, attempt: int, i: int, lane: int) -> None:
    """Give a case the rates, directions and sides of an attempt."""
    n, k, held = fleet.x.shape[1], fleet.sides.shape[1], plan.attempts.held[attempt]
    if held > 0:
        for m in range(n // 2):
            fleet.x[i, n // 2 + m] = bench.verdict[held + m, lane]
    for m in range(k):
        way, side = plan.attempts.ways[attempt, m], plan.attempts.sides[attempt, m]
        fleet.directions[i, 2 * m] = bench.posed[n + m, lane]
        if way != 0:
            fleet.directions[i, 2 * m] = float(way)
        fleet.directions[i, 2 * m + 1] = 0.0
        fleet.sides[i, m] = bench.posed[n + k + m, lane] * float(side)
