"""L U factors of small dense matrices, real or complex, of every case side by side, written out for the loops.

Element (i, k) of the matrix of a lane is ``a[i, k * lanes + lane]``, element m of its vector ``b[m * lanes + lane]``. A
complex matrix is two, its real and its imaginary parts. The factors hold the inverses of the pivots.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..subset.compiled_subset import compiled_subset, fma, lane_count, lanes


@compiled_subset
def factor(
    a: FloatArray, pivots: NDArray[np.int64], numbers: FloatArray, largest: int, flags: NDArray[np.int64], regular: int
) -> None:
    """Factor ``a`` (n, n) in place with partial pivoting.

    A row `regular` of ``flags`` gets 0 in lanes where it is not finite and regular; a row `largest` of ``numbers`` is
    overwritten.
    """
    n, count = a.shape[0], lane_count()
    for k in range(n):
        for lane in lanes():
            pivots[k * count + lane], numbers[largest, lane] = k, 0.0
        for i in range(k, n):
            for lane in lanes():
                size, before = abs(a[i, k * count + lane]), numbers[largest, lane]
                flags[regular, lane] = flags[regular, lane] if size < np.inf else 0
                pivots[k * count + lane] = i if size > before else pivots[k * count + lane]
                numbers[largest, lane] = size if size > before else before
        exchange(a, pivots, k)
        for lane in lanes():
            flags[regular, lane] = 0 if numbers[largest, lane] == 0.0 else flags[regular, lane]
            a[k, k * count + lane] = 1.0 / a[k, k * count + lane]
        for i in range(k + 1, n):
            some = 0
            for lane in lanes():
                entry = a[i, k * count + lane]
                some += 0 if entry == 0.0 else 1
                a[i, k * count + lane] = entry * a[k, k * count + lane]
            if some == 0:
                continue
            for j in range(k + 1, n):
                for lane in lanes():
                    entry, old = a[i, k * count + lane], a[i, j * count + lane]
                    new = fma(-entry, a[k, j * count + lane], old)
                    a[i, j * count + lane] = new if entry != 0.0 else old


@compiled_subset
def _last(pivots: NDArray[np.int64], k: int, n: int) -> int:
    """Return n where row k of a lane has another pivot, else 0."""
    count, others = lane_count(), 0
    for lane in lanes():
        others += 0 if pivots[k * count + lane] == k else 1
    return n if others > 0 else 0


@compiled_subset
def exchange(a: FloatArray, pivots: NDArray[np.int64], k: int) -> None:
    """Exchange row k of each lane with that of its pivot."""
    n, count = a.shape[0], lane_count()
    for i in range(k + 1, _last(pivots, k, n)):
        some = 0
        for lane in lanes():
            some += 1 if pivots[k * count + lane] == i else 0
        if some == 0:
            continue
        for j in range(n):
            for lane in lanes():
                x, y = a[k, j * count + lane], a[i, j * count + lane]
                a[k, j * count + lane] = y if pivots[k * count + lane] == i else x
                a[i, j * count + lane] = x if pivots[k * count + lane] == i else y


@compiled_subset
def exchange_vector(b: FloatArray, pivots: NDArray[np.int64], n: int) -> None:
    """Exchange elements of ``b`` (n,) as the rows were."""
    count = lane_count()
    for k in range(n):  # every row was exchanged as a whole, so that all exchanges come first
        for i in range(k + 1, _last(pivots, k, n)):
            for lane in lanes():
                x, y = b[k * count + lane], b[i * count + lane]
                b[k * count + lane] = y if pivots[k * count + lane] == i else x
                b[i * count + lane] = x if pivots[k * count + lane] == i else y


@compiled_subset
def solve(a: FloatArray, pivots: NDArray[np.int64], b: FloatArray) -> None:
    """Solve for ``b`` (n,) in place, ``a`` and ``pivots`` being what `factor` left."""
    n, count = a.shape[0], lane_count()
    exchange_vector(b, pivots, n)
    for j in range(n):
        for k in range(j + 1, n):
            for lane in lanes():
                b[k * count + lane] = fma(-a[k, j * count + lane], b[j * count + lane], b[k * count + lane])
    for j in range(n - 1, -1, -1):
        for lane in lanes():
            b[j * count + lane] *= a[j, j * count + lane]
        for k in range(j):
            for lane in lanes():
                b[k * count + lane] = fma(-a[k, j * count + lane], b[j * count + lane], b[k * count + lane])


@compiled_subset
def factor_pair(
    re: FloatArray,
    im: FloatArray,
    pivots: NDArray[np.int64],
    numbers: FloatArray,
    largest: int,
    flags: NDArray[np.int64],
    regular: int,
) -> None:
    """Factor ``re + i im`` (n, n) as `factor` does."""
    n, count = re.shape[0], lane_count()
    for k in range(n):
        for lane in lanes():
            pivots[k * count + lane], numbers[largest, lane] = k, 0.0
        for i in range(k, n):
            for lane in lanes():
                size, before = abs(re[i, k * count + lane]) + abs(im[i, k * count + lane]), numbers[largest, lane]
                flags[regular, lane] = flags[regular, lane] if size < np.inf else 0
                pivots[k * count + lane] = i if size > before else pivots[k * count + lane]
                numbers[largest, lane] = size if size > before else before
        exchange(re, pivots, k)
        exchange(im, pivots, k)
        for lane in lanes():
            x, y = re[k, k * count + lane], im[k, k * count + lane]
            flags[regular, lane] = 0 if numbers[largest, lane] == 0.0 else flags[regular, lane]
            # the square of the pivot may be out of range (R. L. Smith, Communications of the ACM 5 (1962) 435)
            wide = abs(x) >= abs(y)
            large, small = x if wide else y, y if wide else x
            ratio = small / large
            below = 1.0 / (large + small * ratio)
            re[k, k * count + lane] = below if wide else ratio * below
            im[k, k * count + lane] = -(ratio * below) if wide else -below
        for i in range(k + 1, n):
            some = 0
            for lane in lanes():
                x, y = re[i, k * count + lane], im[i, k * count + lane]
                u, v = re[k, k * count + lane], im[k, k * count + lane]
                some += 0 if abs(x) + abs(y) == 0.0 else 1
                re[i, k * count + lane], im[i, k * count + lane] = fma(x, u, -(y * v)), fma(x, v, y * u)
            if some == 0:
                continue
            for j in range(k + 1, n):
                for lane in lanes():
                    x, y = re[i, k * count + lane], im[i, k * count + lane]
                    u, v = re[k, j * count + lane], im[k, j * count + lane]
                    a, b = re[i, j * count + lane], im[i, j * count + lane]
                    here = abs(x) + abs(y) != 0.0
                    re[i, j * count + lane] = a - fma(x, u, -(y * v)) if here else a
                    im[i, j * count + lane] = b - fma(x, v, y * u) if here else b


@compiled_subset
def solve_pair(re: FloatArray, im: FloatArray, pivots: NDArray[np.int64], a: FloatArray, b: FloatArray) -> None:
    """Solve for ``a + i b`` (n,) in place, the rest being what `factor_pair` left."""
    n, count = re.shape[0], lane_count()
    exchange_vector(a, pivots, n)
    exchange_vector(b, pivots, n)
    for j in range(n):
        for k in range(j + 1, n):
            _subtract(re, im, k, j, a, b)
    for j in range(n - 1, -1, -1):
        for lane in lanes():
            x, y = a[j * count + lane], b[j * count + lane]
            u, v = re[j, j * count + lane], im[j, j * count + lane]
            a[j * count + lane], b[j * count + lane] = fma(x, u, -(y * v)), fma(x, v, y * u)
        for k in range(j):
            _subtract(re, im, k, j, a, b)


@compiled_subset
def _subtract(re: FloatArray, im: FloatArray, k: int, j: int, a: FloatArray, b: FloatArray) -> None:
    """Subtract element (k, j) times element j of a vector from its element k."""
    count = lane_count()
    for lane in lanes():
        x, y = a[j * count + lane], b[j * count + lane]
        u, v = re[k, j * count + lane], im[k, j * count + lane]
        a[k * count + lane] -= fma(u, x, -(v * y))
        b[k * count + lane] -= fma(u, y, v * x)
