"""Equations of the families, written by hand as numbers: mass matrices, forces, and rows of contacts.

Each function fills, at (t, q, v) with parameters p: M (n, n); f (n,), the generalised forces less what M does with v;
and a contact at a time its gap, its coefficients (mu, mu_static, e), its rows J (3, n) and drifts w (3,), so that
J v + w is its velocity along the normal and along one or two tangents. Signs are those of the scenes in `scenes`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, final

import numpy as np
from numba import float64, njit, void

__all__ = ["SIGNATURE", "SYSTEMS", "System", "equations"]

_VECTOR, _MATRIX, _ROWS = float64[::1], float64[:, ::1], float64[:, :, ::1]
SIGNATURE = void(float64, _VECTOR, _VECTOR, _VECTOR, _MATRIX, _VECTOR, _VECTOR, _MATRIX, _ROWS, _MATRIX)
"""Of a system: t, q, v, p, and what it fills: M, f, gap, law, J, w."""


@final
@dataclass(frozen=True)
class System:
    """The equations of a scene: what fills them, and its contacts: how many, with how many tangents, slots or not."""

    fill: Callable[..., None]
    contacts: int
    directions: int = 1
    bilateral: bool = False


@njit(cache=True)
def _law(law: Any, k: int, mu: float, static: float, e: float) -> None:
    law[k, 0], law[k, 1], law[k, 2] = mu, static, e


@njit(cache=True)
def _at(J: Any, w: Any, gap: Any, k: int, q: Any, a: float, b: float, axis: int) -> None:
    """Fill the rows of a point (a, b) of a body (x, y, theta) at the floor y = 0 (axis 1) or wall x = 0 (axis 0)."""
    c, s = np.cos(q[2]), np.sin(q[2])
    arm_x, arm_y = a * c - b * s, a * s + b * c
    gap[k] = q[axis] + (arm_y if axis == 1 else arm_x)
    along_x, along_y = (1, 0) if axis == 1 else (0, 1)  # places of the rows of x and y
    J[k, along_x, 0], J[k, along_x, 1], J[k, along_x, 2] = 1.0, 0.0, -arm_y
    J[k, along_y, 0], J[k, along_y, 1], J[k, along_y, 2] = 0.0, 1.0, arm_x
    w[k, 0] = w[k, 1] = 0.0


def _particle(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m, g_x, g_y, k, c, x_0, A, omega, phi, B, C, nu, belt, mu, static, e = p
    M[0, 0] = M[1, 1] = m
    f[0] = m * g_x - k * (q[0] - x_0) - c * v[0] + A * np.sin(omega * t + phi)
    f[1] = -m * g_y + B * t + C * np.sin(nu * t)
    gap[0] = q[1]
    J[0, 0, 1] = J[0, 1, 0] = 1.0
    w[0, 1] = -belt
    _law(law, 0, mu, static, e)


def _stack(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    g, belt, lift, nu = p[0], p[1], p[2], p[3]
    count = gap.size
    for i in range(count):
        m, A, omega, mu = p[4 + 4 * i], p[5 + 4 * i], p[6 + 4 * i], p[7 + 4 * i]
        M[2 * i, 2 * i] = M[2 * i + 1, 2 * i + 1] = m
        f[2 * i] = A * np.sin(omega * t)
        f[2 * i + 1] = -m * g
        gap[i] = q[2 * i + 1] - (q[2 * i - 1] if i > 0 else 0.0)
        J[i, 0, 2 * i + 1] = J[i, 1, 2 * i] = 1.0
        if i > 0:
            J[i, 0, 2 * i - 1] = J[i, 1, 2 * i - 2] = -1.0
        _law(law, i, mu, mu, 0.0)
    w[0, 1] = -belt
    f[2 * count - 1] += lift * np.sin(nu * t)


@njit(cache=True)
def _rod(t: float, p: Any, M: Any, f: Any) -> None:
    m, l, g, A, omega = p[:5]
    M[0, 0] = M[1, 1] = m
    M[2, 2] = m * l**2 / 3.0
    f[0], f[1], f[2] = A * np.sin(omega * t), -m * g, 0.0


def _rod_floor(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    _rod(t, p, M, f)
    for k in range(2):
        _at(J, w, gap, k, q, p[1] if k == 0 else -p[1], 0.0, 1)
        _law(law, k, p[5], p[5], p[6])


def _rod_corner(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    _rod(t, p, M, f)
    _at(J, w, gap, 0, q, p[1], 0.0, 1)
    _at(J, w, gap, 1, q, -p[1], 0.0, 0)
    _at(J, w, gap, 2, q, -p[1], 0.0, 1)
    _law(law, 0, p[5], p[5], 0.0)
    _law(law, 1, p[6], p[6], 0.0)
    _law(law, 2, p[5], p[5], 0.0)


def _plate(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m, I, b, h, g, mu, A, omega, phi = p
    M[0, 0] = M[1, 1] = m
    M[2, 2] = I
    f[0], f[1], f[2] = A * np.sin(omega * t + phi), -m * g, 0.0
    _at(J, w, gap, 0, q, -b, -h, 1)
    _at(J, w, gap, 1, q, b, -h, 1)
    _law(law, 0, mu, mu, 0.0)
    _law(law, 1, mu, mu, 0.0)


def _wheel(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m, I, r, g_x, g_y, belt, T, omega, A, mu, mu_wall, x_wall, e = p
    M[0, 0] = M[1, 1] = m
    M[2, 2] = I
    f[0], f[1], f[2] = m * g_x + A * np.cos(omega * t), -m * g_y, T * np.sin(omega * t)
    gap[0], gap[1] = q[1] - r, x_wall - q[0] - r
    J[0, 0, 1], J[0, 1, 0], J[0, 1, 2], w[0, 1] = 1.0, 1.0, r, -belt
    J[1, 0, 0], J[1, 1, 1], J[1, 1, 2] = -1.0, 1.0, r
    _law(law, 0, mu, mu, e)
    _law(law, 1, mu_wall, mu_wall, e)


def _slot(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m, k, A, omega, B, nu, load, belt, mu = p
    M[0, 0] = M[1, 1] = m
    f[0], f[1] = -k * q[0] + A * np.sin(omega * t), load + B * np.sin(nu * t)
    J[0, 0, 1] = J[0, 1, 0] = 1.0
    w[0, 1] = -belt
    _law(law, 0, mu, mu, 0.0)


def _ring(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m, _, g, A, omega, mu = p
    M[0, 0] = M[1, 1] = m
    f[0], f[1] = A * np.sin(omega * t), -m * g
    r = np.sqrt(q[0] ** 2 + q[1] ** 2)
    J[0, 0, 0], J[0, 0, 1] = q[0] / r, q[1] / r
    J[0, 1, 0], J[0, 1, 1] = -q[1] / r, q[0] / r
    _law(law, 0, mu, mu, 0.0)


def _trammel(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    _rod(t, p, M, f)
    _at(J, w, gap, 0, q, p[1], 0.0, 1)
    _at(J, w, gap, 1, q, -p[1], 0.0, 0)
    _law(law, 0, p[5], p[5], 0.0)
    _law(law, 1, p[6], p[6], 0.0)


def _chain(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    c, A, omega, e_wall, e = p[9], p[10], p[11], p[12], p[13]
    for i in range(3):
        M[i, i] = p[i]
        f[i] = -p[3 + i] * (q[i] - p[6 + i]) - c * v[i]
        gap[i] = q[i] - (q[i - 1] if i > 0 else 0.0)
        J[i, 0, i] = 1.0
        if i > 0:
            J[i, 0, i - 1] = -1.0
        _law(law, i, 0.0, 0.0, e if i > 0 else e_wall)
    f[2] += A * np.sin(omega * t)


def _disc(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m, g_x, g_y, g_z, k_x, k_y, c, u_x, u_y, A, omega, C, nu, mu, e = p
    for i in range(3):
        M[i, i] = m
    f[0] = m * g_x - k_x * q[0] - c * v[0] + A * np.cos(omega * t)
    f[1] = m * g_y - k_y * q[1] - c * v[1] + A * np.sin(omega * t)
    f[2] = -m * g_z + C * np.sin(nu * t)
    gap[0] = q[2]
    J[0, 0, 2] = J[0, 1, 0] = J[0, 2, 1] = 1.0
    w[0, 1], w[0, 2] = -u_x, -u_y
    _law(law, 0, mu, mu, e)


def _puck(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m, g_x, g_y, g_z, A, omega, B, nu, a, b, mu, e = p
    for i in range(3):
        M[i, i] = m
        J[0, i, (i + 2) % 3] = 1.0
        J[1, i, i] = J[2, i, (i + 1) % 3] = -1.0
    f[0] = m * g_x + A * np.cos(omega * t)
    f[1] = m * g_y + B * np.sin(nu * t)
    f[2] = -m * g_z
    gap[0], gap[1], gap[2] = q[2], a - q[0], b - q[1]
    _law(law, 0, mu, mu, 0.0)
    _law(law, 1, 0.0, 0.0, e)
    _law(law, 2, 0.0, 0.0, e)


def _pendulum(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
    m_1, m_2, l_1, l_2, g, d, A, omega, c, mu, e, mu_elbow = p
    s_1, s_2, c_1, c_2 = np.sin(q[0]), np.sin(q[1]), np.cos(q[0]), np.cos(q[1])
    couple, turn = m_2 * l_1 * l_2 * np.cos(q[0] - q[1]), m_2 * l_1 * l_2 * np.sin(q[0] - q[1])
    M[0, 0], M[1, 1] = (m_1 + m_2) * l_1**2, m_2 * l_2**2
    M[0, 1] = M[1, 0] = couple
    f[0] = -turn * v[1] ** 2 - (m_1 + m_2) * g * l_1 * s_1 - c * v[0] + A * np.sin(omega * t)
    f[1] = turn * v[0] ** 2 - m_2 * g * l_2 * s_2 - c * v[1]
    gap[0], gap[1] = d - l_1 * s_1 - l_2 * s_2, d - l_1 * s_1
    J[0, 0, 0], J[0, 0, 1] = -l_1 * c_1, -l_2 * c_2
    J[0, 1, 0], J[0, 1, 1] = l_1 * s_1, l_2 * s_2
    J[1, 0, 0], J[1, 1, 0] = -l_1 * c_1, l_1 * s_1
    _law(law, 0, mu, mu, e)
    _law(law, 1, mu_elbow, mu_elbow, e)


SYSTEMS = {
    "particle": System(_particle, 1),
    "stack of 2": System(_stack, 2),
    "stack of 3": System(_stack, 3),
    "rod on floor": System(_rod_floor, 2),
    "rod in corner": System(_rod_corner, 3),
    "plate": System(_plate, 2),
    "wheel": System(_wheel, 2),
    "slot": System(_slot, 1, bilateral=True),
    "ring": System(_ring, 1, bilateral=True),
    "trammel": System(_trammel, 2, bilateral=True),
    "chain": System(_chain, 3, directions=0),
    "disc": System(_disc, 1, directions=2),
    "pendulum": System(_pendulum, 2),
    "puck": System(_puck, 3, directions=2),
}


@cache
def equations(name: str) -> Any:
    """Return what fills the equations of a system, compiled."""
    return njit(SIGNATURE, cache=True)(SYSTEMS[name].fill)
