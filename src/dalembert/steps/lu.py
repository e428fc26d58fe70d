"""L U factors of small dense matrices, real or complex, written out for the integrators' loops.

A complex matrix is two, its real and its imaginary parts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..subset.compiled_subset import compiled_subset, fma


@compiled_subset
def factor(a: FloatArray, pivots: NDArray[np.int64]) -> bool:
    """Factor ``a`` (n, n) in place with partial pivoting; return whether it is finite and regular."""
    n = a.shape[0]
    for k in range(n):
        best, largest = k, 0.0
        for i in range(k, n):
            size = abs(a[i, k])
            if not size < np.inf:
                return False
            if size > largest:
                best, largest = i, size
        if largest == 0.0:
            return False
        pivots[k] = best
        if best != k:
            for j in range(n):
                a[k, j], a[best, j] = a[best, j], a[k, j]
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, n):
            entry = a[i, k]
            if entry != 0.0:
                entry *= inverse
                a[i, k] = entry
                for j in range(k + 1, n):
                    a[i, j] = fma(-entry, a[k, j], a[i, j])
    return True


@compiled_subset
def solve(a: FloatArray, pivots: NDArray[np.int64], b: FloatArray) -> None:
    """Solve for ``b`` (n,) in place, ``a`` and ``pivots`` being what `factor` left."""
    n = a.shape[0]
    for k in range(n):  # every row was exchanged as a whole, so that all exchanges come first
        if pivots[k] != k:
            b[k], b[pivots[k]] = b[pivots[k]], b[k]
    for k in range(n):
        value = b[k]
        for j in range(k):
            value = fma(-a[k, j], b[j], value)
        b[k] = value
    for k in range(n - 1, -1, -1):
        value = b[k]
        for j in range(k + 1, n):
            value = fma(-a[k, j], b[j], value)
        b[k] = value / a[k, k]


@compiled_subset
def _inverse(x: float, y: float) -> tuple[float, float]:
    """Return 1 / (x + i y), whose square may be out of range (R. L. Smith, Communications of the ACM 5 (1962) 435)."""
    if abs(x) >= abs(y):
        ratio = y / x
        below = x + y * ratio
        return 1.0 / below, -ratio / below
    ratio = x / y
    below = x * ratio + y
    return ratio / below, -1.0 / below


@compiled_subset
def factor_pair(re: FloatArray, im: FloatArray, pivots: NDArray[np.int64]) -> bool:
    """Factor ``re + i im`` (n, n) as `factor` does."""
    n = re.shape[0]
    for k in range(n):
        best, largest = k, 0.0
        for i in range(k, n):
            size = abs(re[i, k]) + abs(im[i, k])
            if not size < np.inf:
                return False
            if size > largest:
                best, largest = i, size
        if largest == 0.0:
            return False
        pivots[k] = best
        if best != k:
            for j in range(n):
                re[k, j], re[best, j] = re[best, j], re[k, j]
                im[k, j], im[best, j] = im[best, j], im[k, j]
        u, v = _inverse(re[k, k], im[k, k])
        for i in range(k + 1, n):
            x, y = re[i, k], im[i, k]
            if x != 0.0 or y != 0.0:
                x, y = fma(x, u, -(y * v)), fma(x, v, y * u)
                re[i, k], im[i, k] = x, y
                for j in range(k + 1, n):
                    re[i, j] -= fma(x, re[k, j], -(y * im[k, j]))
                    im[i, j] -= fma(x, im[k, j], y * re[k, j])
    return True


@compiled_subset
def solve_pair(re: FloatArray, im: FloatArray, pivots: NDArray[np.int64], a: FloatArray, b: FloatArray) -> None:
    """Solve for ``a + i b`` (n,) in place, the rest being what `factor_pair` left."""
    n = re.shape[0]
    for k in range(n):
        if pivots[k] != k:
            a[k], a[pivots[k]] = a[pivots[k]], a[k]
            b[k], b[pivots[k]] = b[pivots[k]], b[k]
    for k in range(n):
        x, y = a[k], b[k]
        for j in range(k):
            x -= fma(re[k, j], a[j], -(im[k, j] * b[j]))
            y -= fma(re[k, j], b[j], im[k, j] * a[j])
        a[k], b[k] = x, y
    for k in range(n - 1, -1, -1):
        x, y = a[k], b[k]
        for j in range(k + 1, n):
            x -= fma(re[k, j], a[j], -(im[k, j] * b[j]))
            y -= fma(re[k, j], b[j], im[k, j] * a[j])
        u, v = _inverse(re[k, k], im[k, k])
        a[k], b[k] = fma(x, u, -(y * v)), fma(x, v, y * u)
