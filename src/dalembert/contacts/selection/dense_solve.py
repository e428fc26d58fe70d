"""Solution of small dense linear systems that may be singular, in the compiled subset.

Regular systems are solved by elimination with partial pivoting on the equilibrated matrix. Where a pivot falls below
`SMALLEST_PIVOT`, the solution is the one of least norm, by the singular value decomposition that one-sided Jacobi
rotations give (G. H. Golub and C. F. Van Loan, Matrix Computations, section 8.6.3).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...subset.arguments import IntVector, Matrix, Vector
from ...subset.compiled_subset import compiled_subset, sqrt, square

SMALLEST_PIVOT = 1e-9
"""Pivot of the equilibrated matrix below which a system counts as singular."""

RANK = 1e-11
"""Singular value, as a share of the largest, below which it counts as zero."""

_MOST_PASSES = 60
_ORTHOGONAL = 1e-15

_NOISE = 1e-15
"""Length of a column, as a share of the matrix, below which it is rounding errors: no rotation turns it further."""


class DenseWorkspace(NamedTuple):
    """Memory for systems of at most n equations.

    Attributes
    ----------
    scaled, vectors : (n, n)
        The matrix during elimination, or its left singular vectors times its singular values; the right ones.
    free : (n, n)
        Directions in which the solution of a singular system is not determined, as rows.
    rows, columns, found : (n,)
        Scales of rows and columns; one right side.
    pivots : (n,)
        Exchanges of rows.
    """

    scaled: Matrix
    vectors: Matrix
    free: Matrix
    rows: Vector
    columns: Vector
    found: Vector
    pivots: IntVector


def dense_workspace(size: int) -> DenseWorkspace:
    """Return memory for systems of at most `size` equations."""
    n = max(size, 1)
    return DenseWorkspace(
        scaled=np.zeros((n, n)),
        vectors=np.zeros((n, n)),
        free=np.zeros((n, n)),
        rows=np.zeros(n),
        columns=np.zeros(n),
        found=np.zeros(n),
        pivots=np.zeros(n, np.int64),
    )


@compiled_subset
def solve_dense(matrix: FloatArray, right: FloatArray, n: int, columns: int, space: DenseWorkspace) -> int:
    """Solve the leading (n, n) block of a matrix for so many columns of the right side, in place.

    The least-norm solution is found where the matrix is singular; entries that are not finite give NaN. Returns the
    number of directions in which a solution is not determined; ``space.free`` has them as rows.
    """
    if n == 0:
        return 0
    if n == 1:
        for j in range(columns):
            right[0, j] = right[0, j] / matrix[0, 0] if matrix[0, 0] != 0.0 else 0.0
        space.free[0, 0] = 1.0
        return 1 if matrix[0, 0] == 0.0 else 0
    total = 0.0
    for i in range(n):
        for j in range(n):
            total += 0.0 * matrix[i, j]
    if total != 0.0:  # NaN or infinite
        for i in range(n):
            for j in range(columns):
                right[i, j] = math.nan
        return 0
    if _eliminated(matrix, n, space):
        for j in range(columns):
            _substitute(right, n, j, space)
        return 0
    decompose(matrix, n, space)
    for j in range(columns):
        _project(right, n, j, space)
    count = 0
    for j in range(n):
        if space.rows[j] == 0.0:
            for i in range(n):
                space.free[count, i] = space.vectors[i, j]
            count += 1
    return count


@compiled_subset
def _eliminated(matrix: FloatArray, n: int, space: DenseWorkspace) -> bool:
    """Factor the equilibrated matrix in ``scaled``; return whether it is regular."""
    a = space.scaled
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, abs(matrix[i, j]))
        if largest == 0.0:
            return False
        space.rows[i] = 1.0 / largest
    for j in range(n):
        largest = 0.0
        for i in range(n):
            a[i, j] = matrix[i, j] * space.rows[i]
            largest = max(largest, abs(a[i, j]))
        if largest == 0.0:
            return False
        space.columns[j] = 1.0 / largest
        for i in range(n):
            a[i, j] *= space.columns[j]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        space.pivots[k] = best
        if best != k:
            for j in range(n):
                a[k, j], a[best, j] = a[best, j], a[k, j]
        if not abs(a[k, k]) >= SMALLEST_PIVOT:
            return False
        for i in range(k + 1, n):
            if a[i, k] != 0.0:
                factor = a[i, k] / a[k, k]
                a[i, k] = factor
                for j in range(k + 1, n):
                    a[i, j] -= factor * a[k, j]
    return True


@compiled_subset
def _substitute(right: FloatArray, n: int, column: int, space: DenseWorkspace) -> None:
    a, x = space.scaled, space.found
    for i in range(n):
        x[i] = right[i, column] * space.rows[i]
    for k in range(n):
        other = space.pivots[k]
        if other != k:
            x[k], x[other] = x[other], x[k]
    for k in range(n):
        value = x[k]
        for j in range(k):
            value -= a[k, j] * x[j]
        x[k] = value
    for k in range(n - 1, -1, -1):
        value = x[k]
        for j in range(k + 1, n):
            value -= a[k, j] * x[j]
        x[k] = value / a[k, k]
    for k in range(n):
        right[k, column] = x[k] * space.columns[k]


@compiled_subset
def decompose(matrix: FloatArray, n: int, space: DenseWorkspace) -> int:
    """Rotate the columns of a matrix until they are perpendicular to each other; return how often all were passed."""
    u, v, noise, passes = space.scaled, space.vectors, 0.0, 0
    for i in range(n):
        for j in range(n):
            u[i, j] = matrix[i, j]
            v[i, j] = 1.0 if i == j else 0.0
            noise += square(_NOISE * u[i, j])
    while passes < _MOST_PASSES:
        turned, passes = False, passes + 1
        for p in range(n):
            for q in range(p + 1, n):
                a, b, c = 0.0, 0.0, 0.0
                for i in range(n):
                    a += u[i, p] * u[i, p]
                    b += u[i, q] * u[i, q]
                    c += u[i, p] * u[i, q]
                if abs(c) <= _ORTHOGONAL * sqrt(a * b) or min(a, b) <= noise:
                    continue
                turned = True
                zeta = (b - a) / (2.0 * c)
                tangent = (1.0 if zeta >= 0.0 else -1.0) / (abs(zeta) + sqrt(1.0 + zeta * zeta))
                cosine = 1.0 / sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for i in range(n):
                    x, y = u[i, p], u[i, q]
                    u[i, p], u[i, q] = cosine * x - sine * y, sine * x + cosine * y
                    x, y = v[i, p], v[i, q]
                    v[i, p], v[i, q] = cosine * x - sine * y, sine * x + cosine * y
        if not turned:
            break
    largest = 0.0
    for j in range(n):
        size = 0.0
        for i in range(n):
            size += u[i, j] * u[i, j]
        space.columns[j] = sqrt(size)
        largest = max(largest, space.columns[j])
    for j in range(n):
        space.rows[j] = 1.0 / (space.columns[j] * space.columns[j]) if space.columns[j] > RANK * largest else 0.0
    return passes


@compiled_subset
def _project(right: FloatArray, n: int, column: int, space: DenseWorkspace) -> None:
    u, v, x = space.scaled, space.vectors, space.found
    for j in range(n):
        value = 0.0
        for i in range(n):
            value += u[i, j] * right[i, column]
        x[j] = value * space.rows[j]
    for i in range(n):
        value = 0.0
        for j in range(n):
            value += v[i, j] * x[j]
        right[i, column] = value
