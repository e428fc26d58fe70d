"""Second rates and multipliers of constrained equations by the null space of the rows, and consistent states."""

from __future__ import annotations

from typing import Any

import numpy as np

from fuzz.newton_euler import Equations, Reference, Solved

__all__ = ["LOST", "consistent_position", "consistent_rates", "solved"]

LOST = 1e-9
"""Singular values of rows of length one below which they depend on each other."""


def scaled_rows(e: Equations) -> tuple[Any, Any]:
    """Return the rows of length one, and their lengths (C, m), one for rows that vanish."""
    length = np.sqrt((e.rows**2).sum(-1))
    length = np.where(length < 1e-12, 1.0, length)
    return e.rows / length[..., None], length


def solved(e: Equations) -> Solved:
    """Return the second rates; of multipliers that are not determined, the smallest."""
    count, m, n = e.rows.shape
    if m:
        rows, length = scaled_rows(e)
        U, s, Vt = np.linalg.svd(rows)
        big = s > LOST
        rank = big.sum(-1)
    else:
        rank = np.zeros(count, dtype=int)
    qdd, lam, regular, scale, clash = (
        np.zeros((count, n)),
        np.zeros((count, m)),
        np.ones(count),
        np.zeros(count),
        np.zeros(count),
    )
    gap, rest = np.ones(count), np.zeros(count)
    for c in range(count):
        r = int(rank[c])
        part, Z, spread = np.zeros(n), np.eye(n), 0.0
        if m:
            right = -e.gamma[c] / length[c]
            weights = U[c].T @ right
            part = Vt[c, :r].T @ (weights[:r] / s[c, :r])
            Z = Vt[c, r:].T
            clash[c] = float(np.max(np.abs(weights[r:]), initial=0.0))
            gap[c] = s[c, r - 1] * min(1.0, float(length[c].min())) if r else 1.0
            rest[c] = s[c, r] if r < len(s[c]) else 0.0
            spread = float(np.max(np.abs(right), initial=0.0)) / gap[c]
        push = e.forces[c] - e.M[c] @ part
        free = np.zeros(n)
        if Z.shape[1]:
            small = Z.T @ e.M[c] @ Z
            values, vectors = np.linalg.eigh(small)
            regular[c] = values[0] / max(values[-1], 1e-300)
            if regular[c] > 1e-14:
                free = Z @ (vectors @ ((vectors.T @ (Z.T @ push)) / values))
                spread += float(np.max(np.abs(push), initial=0.0)) / values[0]
            else:
                free[:] = np.nan
        qdd[c] = part + free
        scale[c] = max(spread, float(np.max(np.abs(qdd[c]), initial=0.0)))
        if m:
            left = Vt[c, :r] @ (e.M[c] @ qdd[c] - e.forces[c])
            lam[c] = (U[c][:, :r] @ (left / s[c, :r])) / length[c]
    return Solved(qdd, lam, rank, gap, rest, regular, scale, clash)


def consistent_position(
    reference: Reference, t: float, q: Any, parameters: Any, *, least: float = 1e-10
) -> tuple[Any, float]:
    """Return the coordinates (n,) near a guess that satisfy the holonomic constraints, and what is left of them.

    Corrections ignore directions whose singular value is below `least` of the largest.
    """
    held = np.array(reference.holonomic, dtype=bool)
    q = np.array(q, dtype=float)
    if not held.any():
        return q, 0.0
    size = left = np.inf
    for _ in range(40):
        e = reference.equations(t, np.concatenate([q, np.zeros_like(q)])[:, None], parameters)
        residual, rows = e.positions[0, held], e.rows[0, held]
        left = float(np.max(np.abs(residual)))
        step = np.linalg.lstsq(rows, -residual, rcond=least)[0]
        size = float(np.max(np.abs(step)))
        if not np.isfinite(size):
            return q, np.inf
        q = q + step * min(1.0, 0.5 / max(size, 1e-300))
        if size < 1e-15 * max(1.0, float(np.max(np.abs(q)))):
            break
    return q, left


def consistent_rates(reference: Reference, t: float, q: Any, u: Any, parameters: Any) -> tuple[Any, float]:
    """Return the rates (n,) nearest to a guess that satisfy all constraints, and what is left of them."""
    u, left = np.array(u, dtype=float), 0.0
    for _ in range(3 if reference.holonomic else 0):
        e = reference.equations(t, np.concatenate([q, u])[:, None], parameters)
        left = float(np.max(np.abs(e.rates)))
        u = u - np.linalg.lstsq(e.rows[0], e.rates[0], rcond=1e-10)[0]
    if reference.holonomic:
        e = reference.equations(t, np.concatenate([q, u])[:, None], parameters)
        left = float(np.max(np.abs(e.rates)))
    return u, left
