"""Outputs along motions whose contacts share a load indeterminately.

The kernels of such a mode give reactions X of least norm. Where these leave a cone of friction, or pull at what only
pushes, they are replaced by those of least norm that do not: the changes of X that no equation feels are the null space
of the matrix of power coefficients, and the least change is a least distance problem, solved by non-negative least
squares (Lawson and Hanson 1974, chapter 23). Round cones are cut by tangent planes until none is left.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program

_RANK = 1e-10
"""Singular value of equations with rows of length one, below which they do not determine a combination of reactions."""

_NOISE = 1e-12
"""Share of the largest row of power coefficients, up to which rounding makes a row."""

_INSIDE = 1e-10
"""Share of the largest reaction up to which rounding takes reactions out of their cones."""

_CLOSE, _MOST_CUTS = 1e-13, 60
"""Share of the largest reaction by which a round cone may be missed, and most rounds of tangent planes."""

_IMPOSSIBLE = 1e-8
"""Residual of the least squares of a least distance problem up to which no distance does."""


def output_rows(program: Program, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
    """Return the requested outputs (k, n_outputs) at times (k,), states (k, n_y) and constants (n_c,) or (k, n_c)."""
    out = interpret_rows(program.kernel("outputs"), t, y, c)
    if "shared_loads" not in program:
        return out
    found = interpret_rows(program.kernel("shared_loads"), t, y, c)
    k, n = len(program.layout.unknowns), len(program.layout.coordinates)
    reactions = found[:, :k].copy()
    matrices = found[:, k:].reshape(len(t), -1, k)
    changed = [i for i in range(len(t)) if _lawful(reactions[i], matrices[i, :n], matrices[i, n:].reshape(-1, 4, k))]
    if changed:
        rows = np.hstack([y[changed], reactions[changed]])
        own = c[changed] if c.ndim > 1 else c
        out[changed] = interpret_rows(program.kernel("outputs_of_reactions"), t[changed], rows, own)
    return out


def shared_outputs(program: Program) -> frozenset[str]:
    """Return the names of the outputs that depend on reactions which contacts share indeterminately."""
    if "shared_loads" not in program:
        return frozenset()
    kernel, first = program.kernel("outputs_of_reactions"), len(program.layout.state)
    found = {load.target for load in kernel.loads if load.array == "y" and (load.index or 0) >= first}
    for line in kernel.body:
        if any(operand in found for operand in line.args):
            found.add(line.target)
    named = zip(program.layout.outputs, kernel.outputs, strict=True)
    return frozenset(name for name, operand in named if operand in found)


def _lawful(x: FloatArray, matrix: FloatArray, cones: FloatArray) -> bool:
    """Make reactions x (k,) those of least norm within their cones (m, 4, k); return whether that changed them.

    In a cone the first row is not less than the length of the next two, and the last does not change. Reactions stay as
    they are where they are lawful, or nothing is.
    """
    size = float(np.max(np.abs(x), initial=0.0))
    if not np.isfinite([*x, *matrix.ravel(), *cones.ravel()]).all() or _margin(cones, x) >= -_INSIDE * size:
        return False
    free = _null_space(np.vstack([matrix, cones[:, 3]]))
    nearest = _nearest(cones, x / size, free) if free.shape[1] else None
    if nearest is None:
        return False
    x += size * (free @ nearest)
    return True


def _margin(cones: FloatArray, x: FloatArray) -> float:
    """Return by how much reactions are within the cones, least of all; below zero they are outside."""
    values = cones @ x
    return float(np.min(values[:, 0] - np.hypot(values[:, 1], values[:, 2]), initial=np.inf))


def _null_space(matrix: FloatArray) -> FloatArray:
    """Return orthonormal columns (k, d) that a matrix, whose rows have units of their own, maps to zero."""
    length = np.linalg.norm(matrix, axis=1)
    kept = length > _NOISE * np.max(length, initial=0.0)
    _, values, rows = np.linalg.svd(matrix[kept] / length[kept, np.newaxis])
    return np.ascontiguousarray(rows[int(np.sum(values > _RANK)) :].T)


def _nearest(cones: FloatArray, x: FloatArray, free: FloatArray) -> FloatArray | None:
    """Return the least w with x + free w within the cones; None where there is none.

    x is orthogonal to `free`, so that the least change has the least norm.
    """
    moving = cones[np.linalg.norm(cones[:, :3] @ free, axis=(1, 2)) > _RANK * np.linalg.norm(cones[:, :3], axis=(1, 2))]
    w: FloatArray | None = None
    axes = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0]])
    cuts = np.einsum("ab,mbk->mak", axes, moving[:, :3]).reshape(-1, cones.shape[2])
    for _ in range(_MOST_CUTS):
        w = _least_distance(cuts @ free, -(cuts @ x))
        if w is None:
            break
        values = moving[:, :3] @ (x + free @ w)
        force = np.hypot(values[:, 1], values[:, 2])
        beyond = force - values[:, 0] > _CLOSE * max(1.0, float(np.max(force)))
        if not beyond.any():
            break
        unit = values[:, 1:] / np.where(force > 0.0, force, 1.0)[:, np.newaxis]
        across = np.column_stack([np.ones(len(force)), -unit])
        tangent = np.einsum("mb,mbk->mk", across[beyond], moving[beyond, :3])
        cuts = np.vstack([cuts, tangent])
    return None if w is None or _margin(cones, x + free @ w) < -_INSIDE else w


def _least_distance(slopes: FloatArray, least: FloatArray) -> FloatArray | None:
    """Return the shortest w with slopes w >= least; None where there is none."""
    from scipy.optimize import nnls

    length = np.linalg.norm(slopes, axis=1)
    kept = length > _RANK
    slopes, least = slopes[kept] / length[kept, np.newaxis], least[kept] / length[kept]
    target = np.zeros(slopes.shape[1] + 1)
    target[-1] = 1.0
    try:
        weights, left = nnls(np.vstack([slopes.T, least]), target)
    except RuntimeError:
        return None
    if left <= _IMPOSSIBLE:
        return None
    active = weights > 0.0
    return np.asarray(np.linalg.lstsq(slopes[active], least[active], rcond=None)[0], np.float64)
