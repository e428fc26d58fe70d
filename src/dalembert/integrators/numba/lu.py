"""L U factors of small dense matrices, real or complex, written out for the integrators' loops."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dalembert.integrators.numba.jit import compiled


@compiled
def factor(a: NDArray[Any], pivots: NDArray[np.intp]) -> bool:
    """Factor ``a`` (n, n) in place with partial pivoting; return whether it is finite and regular."""
    n = a.shape[0]
    for k in range(n):
        best, largest = k, 0.0
        for i in range(k, n):
            size = abs(a[i, k].real) + abs(a[i, k].imag)
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
                    a[i, j] -= entry * a[k, j]
    return True


@compiled
def solve(a: NDArray[Any], pivots: NDArray[np.intp], b: NDArray[Any]) -> None:
    """Solve for ``b`` (n,) in place, ``a`` and ``pivots`` being what `factor` left."""
    n = a.shape[0]
    for k in range(n):  # every row was exchanged as a whole, so that all exchanges come first
        if pivots[k] != k:
            b[k], b[pivots[k]] = b[pivots[k]], b[k]
    for k in range(n):
        value = b[k]
        for j in range(k):
            value -= a[k, j] * b[j]
        b[k] = value
    for k in range(n - 1, -1, -1):
        value = b[k]
        for j in range(k + 1, n):
            value -= a[k, j] * b[j]
        b[k] = value / a[k, k]
