"""Branches of motion that meet at a singular configuration: the tangent cone of the constraints, to second order.

Where constraints phi(q) lose rank, velocities v with J v = 0 are more than motions have. To second order, motions are
along those with w . H(v, v) = 0 for all w with J^T w = 0, H being the second derivative of phi. Isolated solutions, up
to their length, are the branches (J. M. Rico, J. Gallardo, J. Duffy, Mechanism and Machine Theory 34 (1999) 559-586).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..stops.segments import Constants, constants_at
from .state_sizes import coordinate_sizes

_LOW, _LOST = 0.2, 1e-6
"""Singular values of unit rows that may vanish close by, and that vanish."""

_MOST_LOST = 4
"""Largest number of singular values that vanish together: beyond it, there are more branches than a message lists."""

_FAR = 0.2
"""Distance of a singular configuration, in sizes of coordinates, beyond which it is another one."""

_STEP = 1e-3
"""Step of differences, in sizes of coordinates."""

_STARTS, _ROUNDS, _MOST = 120, 60, 8
"""Starts and iterations of the search for branches, and the largest number of them: more belong to a continuum."""

_SETTLED = 5
"""Iterations after which those for the place become shorter by a share, or are given up."""

_ALIKE, _LISTED = 1e-2, 12
"""Distance of unit velocities that are the same branch, and the largest number of rates that messages list."""

_SOME = 50
"""States of a motion at which its sizes are looked at."""

Matrices = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def branches(
    program: Program, t: float, y: FloatArray, c: Constants, enforced: Sequence[int], states: FloatArray | None = None
) -> str:
    """Return the velocities of the branches that meet at the singular configuration near a state y (n_y,), as text.

    States (k, n_y) of the motion say how large its lengths are. The branch that the velocity of the state is nearest to
    comes first. Empty where there are constraints of rates or of time, where no singular configuration is found nearby,
    and where the second-order analysis gives no isolated branches, or a single one.
    """
    rows, times = list(enforced), np.array([t])
    own = constants_at(c, times)
    own = own if own.ndim == 1 else own[0]
    if not rows or "position_residual" not in program or max(rows) >= program.layout.holonomic:
        return ""
    known = y[np.newaxis] if states is None else np.vstack([y, states[:: max(1, len(states) // _SOME)]])
    places = interpret_rows(program.kernel("expand"), np.full(len(known), t), known, own)
    places = places[np.all(np.isfinite(places), axis=1)]
    n = len(program.layout.coordinates)
    if not len(places) or not np.all(np.isfinite(y)):
        return ""
    x, still = places[0], np.concatenate([places[0, :n], np.zeros(places.shape[1] - n)])
    if np.any(interpret_rows(program.kernel("velocity_residual"), times, still[np.newaxis], own)[0][rows] != 0.0):
        return ""  # constraints depend on time
    sizes = np.max(coordinate_sizes(program, np.full(len(places), t), places, own), axis=0)
    lengths = _row_sizes(program, t, places, own, rows, sizes)

    def matrices(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        places = np.hstack([z * sizes, np.tile(still[n:], (len(z), 1))])
        left = interpret_rows(program.kernel("position_residual"), np.full(len(z), t), places, own)[:, rows]
        return left / lengths, _rows(program, t, places, own, rows) * sizes / lengths[:, np.newaxis]

    start = x[:n] / sizes
    low = int(np.sum(np.linalg.svd(matrices(start[np.newaxis])[1][0], compute_uv=False) < _LOW))
    for lost in range(low if low <= _MOST_LOST else 0, 0, -1):
        place = _singular_place(matrices, start, lost)
        if place is not None:
            found = _directions(*_second_order(matrices, place))
            came = x[n : 2 * n] / sizes
            return _listed(program, sorted(found, key=lambda v: -abs(float(v @ came))), sizes)
    return ""


def _rows(program: Program, t: float, x: FloatArray, c: FloatArray, rows: Sequence[int]) -> FloatArray:
    """Return rows of the Jacobian (k, n_rows, n) at coordinates and rates x (k, 2 n)."""
    found = interpret_rows(program.kernel("constraint_jacobian"), np.full(len(x), t), x, c)
    shape = len(x), len(program.layout.constraints), len(program.layout.coordinates)
    return np.asarray(found.reshape(shape)[:, list(rows)])


def _row_sizes(
    program: Program, t: float, places: FloatArray, c: FloatArray, rows: Sequence[int], sizes: FloatArray
) -> FloatArray:
    """Return the largest lengths of rows (n_rows,) at some places and beside the first of them."""
    n, rng = len(sizes), np.random.default_rng(0)
    beside = np.repeat(places[:1], 8, axis=0)
    beside[:, :n] += _FAR * sizes * rng.uniform(-1.0, 1.0, (8, n))
    j = _rows(program, t, np.vstack([places, beside]), c, rows) * sizes
    lengths = np.max(np.nan_to_num(np.linalg.norm(j, axis=2)), axis=0)
    return np.where(lengths > 0.0, lengths, 1.0)


def _singular_place(matrices: Matrices, start: FloatArray, lost: int) -> FloatArray | None:
    """Return coordinates near a start at which so many singular values vanish, None where none are found.

    By Newton's method for phi(q) = 0 and J(q)^T w = 0, for as many combinations w (n_rows,) of the rows.
    """
    z, n = start.copy(), len(start)
    (left,), (j,) = matrices(z[np.newaxis])
    m, before = len(left), np.inf
    across = np.linalg.svd(j)[0][:, : min(n, m)][:, -lost:]
    for number in range(_ROUNDS):
        (left,), (j,) = matrices(z[np.newaxis])
        if not np.all(np.isfinite(j)):
            return None
        bent = _derivatives(matrices, z, np.eye(n))  # (n, n_rows, n)
        whole = np.zeros((m + lost * (n + lost), n + lost * m))
        whole[:m, :n] = j
        demand = [left]
        for k in range(lost):
            rows = slice(m + k * (n + lost), m + k * (n + lost) + n)
            whole[rows, :n] = np.einsum("kri,r->ik", bent, across[:, k])
            whole[rows, n + k * m : n + (k + 1) * m] = j.T
            whole[rows.stop : rows.stop + lost, n + k * m : n + (k + 1) * m] = across.T
            demand += [j.T @ across[:, k], np.zeros(lost)]
        step = np.linalg.lstsq(whole, -np.concatenate(demand), rcond=1e-10)[0]
        z = z + step[:n]
        across = np.linalg.qr(across + step[n:].reshape(lost, m).T)[0]
        length, slower = float(np.linalg.norm(step)), number > _SETTLED and np.linalg.norm(step) > 0.8 * before
        if slower or not np.linalg.norm(z - start) < _FAR * np.sqrt(n):
            return None
        if length < 1e-11:
            break
        before = length
    (left,), (j,) = matrices(z[np.newaxis])
    values = np.linalg.svd(j, compute_uv=False)
    fine = np.max(np.abs(left)) < _LOST and int(np.sum(values < _LOST)) == lost
    return z if fine else None


def _derivatives(matrices: Matrices, z: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the derivatives (k, n_rows, n) of the Jacobian along directions (k, n), by differences of fourth order."""
    near, far = (matrices(z + s * directions)[1] - matrices(z - s * directions)[1] for s in (_STEP, 2.0 * _STEP))
    return np.asarray((8.0 * near - far) / (12.0 * _STEP))


def _second_order(matrices: Matrices, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a basis (n, d) of velocities that constraints allow, and their conditions (k, d, d) of second order."""
    left, values, right = np.linalg.svd(matrices(z[np.newaxis])[1][0])
    rank = int(np.sum(values > _LOST))
    allowed, across = right[rank:].T, left[:, rank:]
    bent = _derivatives(matrices, z, allowed.T)
    return allowed, np.einsum("krn,rl,nj->lkj", bent, across, allowed)


def _directions(allowed: FloatArray, conditions: FloatArray) -> list[FloatArray]:
    """Return unit velocities (n,) that fulfil all conditions and are isolated; none where they are not."""
    count = allowed.shape[1]
    rng = np.random.default_rng(0)
    found: list[FloatArray] = []
    size = float(np.max(np.abs(conditions), initial=0.0))
    if count < 2 or count - 1 > len(conditions) or not size > 0.0:
        return []
    for _ in range(_STARTS):
        v = np.asarray(rng.normal(size=count))
        for _ in range(_ROUNDS):
            v = v / np.linalg.norm(v)
            slopes = np.einsum("lij,j->li", conditions, v) / size
            rows = np.vstack([2.0 * slopes, v])  # the last keeps the step across to v
            step = np.linalg.lstsq(rows, np.append(slopes @ v, 0.0), rcond=1e-12)[0]
            v = v - step
            if np.linalg.norm(step) < 1e-12:
                break
        v = v / np.linalg.norm(v)
        if np.max(np.abs(np.einsum("lij,i,j->l", conditions, v, v))) < 1e-8 * size:
            if all(min(np.linalg.norm(v - w), np.linalg.norm(v + w)) > _ALIKE for w in found):
                found.append(v)
        if len(found) > _MOST:
            return []
    return [np.asarray(allowed @ v) for v in found]


def _listed(program: Program, found: Sequence[FloatArray], sizes: FloatArray) -> str:
    """Return unit velocities by ratios of rates; coordinates with the same ratio on all branches are left out."""
    if len(found) < 2:
        return ""
    unit, names = np.array(found), program.layout.rates
    least = np.min(np.abs(unit), axis=0)
    common = int(np.argmax(least)) if np.max(least) > 0.05 else None
    texts = []
    for v in unit:
        place = int(np.argmax(np.abs(v))) if common is None else common
        ratios = v * sizes / (v[place] * sizes[place])
        spread = np.ptp(unit / np.sign(unit[:, [place]] + 1e-300), axis=0)
        shown = [i for i in np.argsort(-spread).tolist() if i != place and spread[i] > _ALIKE]
        rates = [f"{names[i]} = {_multiple(ratios[i], names[place])}" for i in sorted(shown[:_LISTED])]
        rates += ["..."] if len(shown) > _LISTED else []
        texts.append(", ".join(rates) if rates else f"{names[place]} alone")
    return f"{len(texts)} branches meet there: {', or '.join(f'({text})' for text in texts)}"


def _multiple(ratio: float, rate: str) -> str:
    """Return a multiple of a rate with four digits, as text."""
    if abs(ratio) < 1e-3:
        return "0"
    number = f"{abs(ratio):.4g}"
    return ("-" if ratio < 0.0 else "") + (rate if number == "1" else f"{number} {rate}")
