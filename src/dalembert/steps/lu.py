"""L U factors of small dense matrices, real or complex, of every case side by side, written out for the loops.

Element (i, k) of the matrix of a lane is ``a[i, k * lanes + lane]``, element m of its vector ``b[m * lanes + lane]``. A
complex matrix is two, its real and its imaginary parts. ``pivots`` (n * (lanes + 2)) are laid out as vectors, with what
`_bound_pivots` writes behind them. The factors hold the inverses of the pivots. An entry that is not a number is never
a pivot before the last, and not regular there.
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
                pivots[k * count + lane] = i if size > before else pivots[k * count + lane]
                numbers[largest, lane] = size if size > before else before
        _bound_pivots(pivots, k, n)
        _exchange(a, pivots, k)
        for lane in lanes():
            regular_here = 0.0 < numbers[largest, lane] < np.inf
            flags[regular, lane] = flags[regular, lane] if regular_here else 0
            a[k, k * count + lane] = 1.0 / a[k, k * count + lane]
        for i in range(k + 1, n):
            some, last = 0, 0.0
            for lane in lanes():
                entry = a[i, k * count + lane]
                some += 0 if entry == 0.0 else 1
                last = entry * a[k, k * count + lane]
                a[i, k * count + lane] = last
            if some == 0:
                continue
            for j in range(k + 1, n):
                for lane in lanes():  # a single entry stays in a register
                    entry, old = last if count == 1 else a[i, k * count + lane], a[i, j * count + lane]
                    new = fma(-entry, a[k, j * count + lane], old)
                    a[i, j * count + lane] = new if count == 1 or entry != 0.0 else old


@compiled_subset
def _bound_pivots(pivots: NDArray[np.int64], k: int, n: int) -> None:
    """Write the first and the last row that row k is exchanged with in a lane behind the pivots of all rows."""
    first, last, count = n, 0, lane_count()
    for lane in lanes():
        first, last = min(first, pivots[k * count + lane]), max(last, pivots[k * count + lane])
    pivots[n * count + 2 * k], pivots[n * count + 2 * k + 1] = max(first, k + 1), last


@compiled_subset
def _exchange(a: FloatArray, pivots: NDArray[np.int64], k: int) -> None:
    """Exchange row k of each lane with that of its pivot."""
    n, count = a.shape[0], lane_count()
    for i in range(pivots[n * count + 2 * k], pivots[n * count + 2 * k + 1] + 1):
        for j in range(n):
            for lane in lanes():
                x, y = a[k, j * count + lane], a[i, j * count + lane]
                a[k, j * count + lane] = y if pivots[k * count + lane] == i else x
                a[i, j * count + lane] = x if pivots[k * count + lane] == i else y


@compiled_subset
def _exchange_elements(b: FloatArray, pivots: NDArray[np.int64], n: int) -> None:
    """Exchange elements of ``b`` (n,) as the rows were, as a whole, so that all exchanges come first."""
    count = lane_count()
    for k in range(n):
        for i in range(pivots[n * count + 2 * k], pivots[n * count + 2 * k + 1] + 1):
            for lane in lanes():
                x, y = b[k * count + lane], b[i * count + lane]
                b[k * count + lane] = y if pivots[k * count + lane] == i else x
                b[i * count + lane] = x if pivots[k * count + lane] == i else y


@compiled_subset
def solve(a: FloatArray, pivots: NDArray[np.int64], b: FloatArray) -> None:
    """Solve for ``b`` (n,) in place, ``a`` and ``pivots`` being what `factor` left."""
    n, count = a.shape[0], lane_count()
    _exchange_elements(b, pivots, n)
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
                pivots[k * count + lane] = i if size > before else pivots[k * count + lane]
                numbers[largest, lane] = size if size > before else before
        _bound_pivots(pivots, k, n)
        _exchange(re, pivots, k)
        _exchange(im, pivots, k)
        for lane in lanes():
            x, y = re[k, k * count + lane], im[k, k * count + lane]
            regular_here = 0.0 < numbers[largest, lane] < np.inf
            flags[regular, lane] = flags[regular, lane] if regular_here else 0
            # the square of the pivot may be out of range (R. L. Smith, Communications of the ACM 5 (1962) 435)
            wide = abs(x) >= abs(y)
            large, small = x if wide else y, y if wide else x
            ratio = small / large
            inverse = 1.0 / (large + small * ratio)
            re[k, k * count + lane] = inverse if wide else ratio * inverse
            im[k, k * count + lane] = -(ratio * inverse) if wide else -inverse
        for i in range(k + 1, n):
            some, last, below = 0, 0.0, 0.0
            for lane in lanes():
                x, y = re[i, k * count + lane], im[i, k * count + lane]
                u, v = re[k, k * count + lane], im[k, k * count + lane]
                some += 0 if abs(x) + abs(y) == 0.0 else 1
                last, below = fma(x, u, -(y * v)), fma(x, v, y * u)
                re[i, k * count + lane], im[i, k * count + lane] = last, below
            if some == 0:
                continue
            for j in range(k + 1, n):
                for lane in lanes():
                    x = last if count == 1 else re[i, k * count + lane]
                    y = below if count == 1 else im[i, k * count + lane]
                    u, v = re[k, j * count + lane], im[k, j * count + lane]
                    a, b = re[i, j * count + lane], im[i, j * count + lane]
                    here = count == 1 or abs(x) + abs(y) != 0.0
                    re[i, j * count + lane] = a - fma(x, u, -(y * v)) if here else a
                    im[i, j * count + lane] = b - fma(x, v, y * u) if here else b


@compiled_subset
def solve_pair(re: FloatArray, im: FloatArray, pivots: NDArray[np.int64], a: FloatArray, b: FloatArray) -> None:
    """Solve for ``a + i b`` (n,) in place, the rest being what `factor_pair` left."""
    n, count = re.shape[0], lane_count()
    _exchange_elements(a, pivots, n)
    _exchange_elements(b, pivots, n)
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
