"""How many motions the laws of contact and friction allow at a state: by trial of everything the contacts may do."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, final

import numpy as np
from scipy.optimize import linprog

from fuzz.contacts.invariants import Rows, rows_at
from fuzz.contacts.moreau_jean import Array

__all__ = ["motions"]

SMALL = 1e-6
"""Of gaps, velocities, accelerations and reactions, over their sizes."""


@final
@dataclass(frozen=True, eq=False)
class _Problem:
    """Laws between reactions P (k, 3) and ends u = J x + b (k, 3): accelerations, or velocities after an impact.

    x = x_free + M^-1 J^T P (n,); an active contact ends with the normal value `target` (k,), any other with no less.
    """

    rows: Rows
    free: Array
    b: Array
    target: Array
    slip: Array
    """Sign of the slip that there is (k,), or 0 where it is to be decided."""


def motions(name: str, p: Array, t: float, q: Array, v: Array) -> list[tuple[tuple[str, ...], Array]] | None:
    """Return what the laws allow at a state: modes, and accelerations or velocities (n,); None for slip in a plane."""
    rows = rows_at(name, t, q, v, p)
    if rows.system.directions != 1:
        return None
    size = max(0.1, float(np.max(np.abs(v))))
    u = rows.speeds(v)
    near = [k for k in range(len(u)) if rows.system.bilateral or rows.gap[k] <= SMALL]
    impact = any(u[k, 0] < -SMALL * size for k in near)
    slip = np.where(np.abs(u[:, 1]) > SMALL * size, np.sign(u[:, 1]), 0.0)
    inverse = np.linalg.inv(rows.M)
    if impact:
        problem = _Problem(rows, v, rows.w, -rows.law[:, 2] * np.minimum(u[:, 0], 0.0), 0.0 * slip)
    else:
        near = [k for k in near if rows.system.bilateral or u[k, 0] <= SMALL * size]
        d = 1e-6
        after, before = (rows_at(name, t + s, q + s * v, v, p).speeds(v) for s in (d, -d))
        problem = _Problem(rows, inverse @ rows.f, (after - before) / (2 * d), np.zeros(len(u)), slip)
    found: list[tuple[tuple[str, ...], Array]] = []
    for modes in product(*(_possible(problem, k) for k in near)):
        x = _motion(problem, inverse, near, modes)
        if x is not None and not any(np.max(np.abs(x - y)) <= 1e-4 * (1.0 + np.max(np.abs(x))) for _, y in found):
            found.append((tuple(word for word, _, _ in modes), x))
    return found


def _possible(problem: _Problem, k: int) -> list[tuple[str, float, float]]:
    """Return what a contact may do: a word, the sign of its slip, and the sign of its normal reaction."""
    sides = (1.0, -1.0) if problem.rows.system.bilateral else (1.0,)
    slips = [problem.slip[k]] if problem.slip[k] else [1.0, -1.0]
    ways = [("slip", sign, side) for sign in slips for side in sides]
    if not problem.slip[k]:
        ways += [("stick", 0.0, side) for side in sides]
    return ways if problem.rows.system.bilateral else [("open", 0.0, 1.0), *ways]


def _motion(problem: _Problem, inverse: Array, near: list[int], modes: tuple[Any, ...]) -> Array | None:
    """Return the motion (n,) of some modes if some reactions in it obey all laws."""
    rows, columns, conditions, values = problem.rows, [], [], []
    for k, (word, sign, side) in zip(near, modes, strict=True):
        if word == "slip":
            columns.append(side * rows.J[k, 0] - rows.law[k, 0] * sign * rows.J[k, 1])
            conditions.append(rows.J[k, 0])
            values.append(problem.target[k] - problem.b[k, 0])
        elif word == "stick":
            columns += [side * rows.J[k, 0], rows.J[k, 1]]
            conditions += [rows.J[k, 0], rows.J[k, 1]]
            values += [problem.target[k] - problem.b[k, 0], -problem.b[k, 1]]
    x = problem.free
    if columns:
        pull = inverse @ np.array(columns).T
        left, right = np.array(conditions) @ pull, np.array(values) - np.array(conditions) @ x
        forces = _lawful(problem, near, modes, left, right)
        if forces is None:
            return None
        x = x + pull @ forces
    ends = rows.J @ x + problem.b
    size = SMALL * (1.0 + float(np.max(np.abs(ends))))
    for k, (word, sign, _) in zip(near, modes, strict=True):
        if word == "open" and ends[k, 0] < problem.target[k] - size:
            return None
        if word == "slip" and not problem.slip[k] and sign * ends[k, 1] < -size:
            return None
    return x


def _lawful(problem: _Problem, near: list[int], modes: tuple[Any, ...], left: Array, right: Array) -> Array | None:
    """Return reactions (m,) with left @ reactions = right within their cones, each normal one not negative."""
    bounds: list[tuple[float | None, float | None]] = []
    cones: list[Array] = []
    for k, (word, _, _) in zip(near, modes, strict=True):
        if word == "stick":
            for sign in (1.0, -1.0):
                row = np.zeros(len(right) + 1)
                row[len(bounds)], row[len(bounds) + 1], row[-1] = -problem.rows.law[k, 1], sign, -1.0
                cones.append(row)
        bounds += [(0.0, None)] * (word != "open") + [(None, None)] * (word == "stick")
    slack = -np.ones((len(right), 1))  # the last unknown is by how much the equations and the cones are missed
    above = np.vstack([np.hstack([left, slack]), np.hstack([-left, slack]), *(row[None] for row in cones)])
    limits = np.concatenate([right, -right, np.zeros(len(cones))])
    cost = np.append(np.zeros(len(right)), 1.0)
    found = linprog(cost, A_ub=above, b_ub=limits, bounds=[*bounds, (0.0, None)])
    if found.status != 0 or found.fun > SMALL * (1.0 + float(np.max(np.abs(right)))):
        return None
    forces: Array = found.x[:-1]
    return forces
