"""Moreau-Jean time stepping with projected Gauss-Seidel: the reference of random scenes with contacts.

The scheme works with velocities and impulses and knows no events (J. J. Moreau, CISM 302 (1988); M. Jean, Computer
Methods in Applied Mechanics and Engineering 177 (1999) 235). A step from (t, q, v) is

    q_mid = q + h/2 v,    v+ = v + M^-1 (h f + J^T P),    q+ = q_mid + h/2 v+,

with M, f and the rows of the contacts at the midpoint. The impulses P obey, with u = J v + w at the start and end of
the step, Newton's law of impact and Coulomb's law of friction:

    0 <= P_N, 0 <= u_N+ + e u_N-, one of them zero;    |P_T| <= mu P_N, and P_T = -mu P_N u_T+ / |u_T+| in slip.

It converges with order one. In scenes without friction a step in which a gap closes, or a contact is struck, is halved
`HALVINGS` times: what comes of impacts that follow each other closely depends on their order. Nothing here or in
`systems` comes from the package under test.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import boolean, float64, int64, njit
from numba.types import FunctionType, Tuple
from numpy.typing import NDArray

from fuzz.contacts.systems import SIGNATURE, SYSTEMS, equations

__all__ = ["Array", "integrated"]

Array = NDArray[np.float64]

_VECTOR, _MATRIX, _WHOLE, _FLAG = float64[::1], float64[:, ::1], int64, boolean
_RESULT = Tuple((_MATRIX, _MATRIX, _WHOLE))

CLOSED, TOUCHING = 1e-9, 1e-13
"""A gap up to this is closed [m]: with friction, and without, where steps in which gaps close are halved."""
STILL = 1e-10
"""A slip speed up to this is none [m/s]."""
SWEEPS = 2000
"""Most sweeps of projected Gauss-Seidel in a step."""
HALVINGS = 14
"""Halvings of a step in which a gap closes or a contact is struck."""
SLOW = 1e-6
"""Approach speed, over the largest speed, of a contact that is not struck but rests."""


@njit(cache=True)
def _row(J: Any, w: float, v: Any) -> float:
    """Return J v + w."""
    total = w
    for i in range(v.size):
        total += J[i] * v[i]
    return total


@njit(cache=True)
def _push(v: Any, B: Any, impulse: float) -> None:
    """Add the change of velocity by an impulse."""
    for i in range(v.size):
        v[i] += B[i] * impulse


@njit(cache=True)
def _solve(
    free: Any,
    v: Any,
    P: Any,
    active: Any,
    bilateral: bool,
    directions: int,
    radius: Any,
    law: Any,
    before: Any,
    J: Any,
    w: Any,
    B: Any,
    W: Any,
) -> bool:
    """Find impulses P (k, 3) and velocities v by projected Gauss-Seidel; return whether the sweeps converged."""
    contacts = P.shape[0]
    v[:] = free
    size = 0.0
    for i in range(v.size):
        size = max(size, abs(free[i]))
    for k in range(contacts):
        if not active[k]:
            P[k, :] = 0.0
            continue
        for j in range(1 + directions):
            _push(v, B[k, j], P[k, j])
    for _ in range(SWEEPS):
        change = 0.0
        for k in range(contacts):
            if not active[k]:
                continue
            u = _row(J[k, 0], w[k, 0], v)
            value = P[k, 0] - (u + law[k, 2] * before[k, 0]) / W[k, 0]
            if not bilateral and value < 0.0:
                value = 0.0
            step = value - P[k, 0]
            _push(v, B[k, 0], step)
            P[k, 0] = value
            change = max(change, abs(step) * W[k, 0])
            if directions == 0:
                continue
            scale = W[k, 1] if directions == 1 else W[k, 1] + W[k, 2]
            wanted = np.zeros(2)
            for j in range(directions):
                wanted[j] = P[k, 1 + j] - _row(J[k, 1 + j], w[k, 1 + j], v) / scale
            length, most = np.sqrt(wanted[0] ** 2 + wanted[1] ** 2), radius[k] * abs(P[k, 0])
            if length > most:
                wanted *= most / length
            for j in range(directions):
                step = wanted[j] - P[k, 1 + j]
                _push(v, B[k, 1 + j], step)
                P[k, 1 + j] = wanted[j]
                change = max(change, abs(step) * scale)
        if change <= 1e-14 * (size + 1e-3):
            return True
    return False


@njit(cache=True)
def _slipping(J: Any, w: Any, v: Any, directions: int) -> float:
    """Return the slip speed of a contact."""
    total = 0.0
    for j in range(directions):
        total += _row(J[1 + j], w[1 + j], v) ** 2
    return np.sqrt(total)


@njit(cache=True)
def _static(k: int, holds: Any, law: Any, speed: float, J: Any, w: Any, after: Any, before: Any, tried: Any) -> bool:
    """Settle whether static friction holds a contact; return whether the step must be solved again for it."""
    if law[0] == law[1]:
        return False
    if holds[k]:
        holds[k] = speed <= STILL
        return not holds[k]
    if speed <= STILL:
        holds[k] = True
        return False
    if tried[k] or before[k, 1] * _row(J[k, 1], w[k, 1], after) >= 0.0:
        return False
    tried[k] = holds[k] = True  # slip that reverses passes through rest
    return True


@njit(cache=True)
def _strikes(active: Any, before: Any, v: Any, P: Any) -> bool:
    """Return whether a contact is struck in a step."""
    fastest, found = 1e-3, False
    for i in range(v.size):
        fastest = max(fastest, abs(v[i]))
    for k in range(active.size):
        found |= active[k] and P[k, 0] > 0.0 and before[k, 0] < -SLOW * fastest
    return found


@njit(
    _RESULT(FunctionType(SIGNATURE), _WHOLE, _WHOLE, _FLAG, _VECTOR, _VECTOR, _VECTOR, float64, _WHOLE, _WHOLE),
    cache=True,
)
def _integrated(
    fill: Any,
    contacts: int,
    directions: int,
    bilateral: bool,
    p: Any,
    q0: Any,
    v0: Any,
    span: float,
    samples: int,
    each: int,
) -> Any:
    """Integrate, see `integrated`."""
    n = q0.size
    h = span / (samples * each)
    least, closed = 1.5 * h * 0.5**HALVINGS, CLOSED if directions > 0 else TOUCHING
    q, v, after = q0.copy(), v0.copy(), v0.copy()
    Q, V = np.zeros((samples + 1, n)), np.zeros((samples + 1, n))
    Q[0], V[0] = q, v
    M, f = np.zeros((n, n)), np.zeros(n)
    gap, law = np.zeros(contacts), np.zeros((contacts, 3))
    J, w = np.zeros((contacts, 3, n)), np.zeros((contacts, 3))
    B, W = np.zeros((contacts, 3, n)), np.zeros((contacts, 3))
    P, before, radius = np.zeros((contacts, 3)), np.zeros((contacts, 3)), np.zeros(contacts)
    holds, active, was = np.ones(contacts, np.bool_), np.zeros(contacts, np.bool_), np.zeros(contacts, np.bool_)
    tried, rough = np.zeros(contacts, np.bool_), 0
    for number in range(samples * each):
        left = size = h
        while left > 1e-9 * h:
            middle = q + 0.5 * size * v
            fill(number * h + (h - left) + 0.5 * size, middle, v, p, M, f, gap, law, J, w)
            inverse = np.linalg.inv(M)
            free = v + size * (inverse @ f)
            for k in range(contacts):
                active[k] = bilateral or gap[k] <= closed
                for j in range(1 + directions):
                    B[k, j] = inverse @ J[k, j]
                    W[k, j] = _row(J[k, j], 0.0, B[k, j])
                    before[k, j] = _row(J[k, j], w[k, j], v)
                if active[k] and not was[k]:
                    holds[k] = _slipping(J[k], w[k], v, directions) <= STILL
            tried[:] = False
            for _ in range(3 * contacts):
                for k in range(contacts):
                    radius[k] = law[k, 1] if holds[k] else law[k, 0]
                if not _solve(free, after, P, active, bilateral, directions, radius, law, before, J, w, B, W):
                    rough += 1
                again = False
                for k in range(contacts):
                    if active[k] and directions > 0:
                        again |= _static(
                            k, holds, law[k], _slipping(J[k], w[k], after, directions), J, w, after, before, tried
                        )
                if not again:
                    break
            end = middle + 0.5 * size * after
            if directions == 0 and size > least:
                fill(number * h + (h - left) + size, end, after, p, M, f, gap, law, J, w)
                closes = _strikes(active, before, v, P)
                for k in range(contacts):
                    closes |= not active[k] and gap[k] < -closed
                if closes:
                    size *= 0.5
                    continue
            was[:] = active
            v[:] = after
            q = end
            left -= size
            size = min(2.0 * size, left)
        if (number + 1) % each == 0:
            Q[(number + 1) // each], V[(number + 1) // each] = q, v
    return Q, V, rough


def integrated(
    name: str, p: Array, q0: Array, v0: Array, span: float, samples: int, each: int
) -> tuple[Array, Array, int]:
    """Integrate a system from time 0 to `span` with `samples` times `each` steps.

    Returns
    -------
    q, v : ndarray (samples + 1, n)
        Positions and velocities at equidistant times.
    rough : int
        Number of solutions for impulses that did not converge.
    """
    system = SYSTEMS[name]
    found: tuple[Array, Array, int] = _integrated(
        equations(name), system.contacts, system.directions, system.bilateral, p, q0, v0, span, samples, each
    )
    return found
