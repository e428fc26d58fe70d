"""The exact motion of a homogeneous sphere that rolls on a horizontal plane (example 13.4.3), in 40 digits.

The friction force vanishes, so the angular velocity omega is constant in space, the centre moves with the
constant velocity ``r omega x z = r (omega_y, -omega_x)``, and the rotation is ``R(t) = exp(t [omega]) R(0)``
with ``R = Rz(psi) Rx(theta) Rz(phi)``, whose columns are the body's axes. The angles are read off R(t) on the
branch 0 < theta < pi and followed continuously in time.
"""

from dataclasses import dataclass
from typing import final

import mpmath as mp
import numpy as np

DIGITS = 40


@final
@dataclass(frozen=True)
class SphereState:
    """Coordinates and rates in the order (x, y, psi, theta, phi), as tuples of mpf."""

    coordinates: tuple
    rates: tuple

    @property
    def q(self) -> np.ndarray:
        """Coordinates, shape (5,), float64."""
        return np.array([float(value) for value in self.coordinates])

    @property
    def qdot(self) -> np.ndarray:
        """Rates, shape (5,), float64."""
        return np.array([float(value) for value in self.rates])


def sphere_state(t, r, x, y, psi, theta, phi, omega) -> SphereState:
    """Return the exact state at time `t` of the sphere that starts at time 0.

    Parameters
    ----------
    t : float, str or mpf
        Time, of either sign.
    r : float, str or mpf
        Radius.
    x, y, psi, theta, phi : float, str or mpf
        Coordinates at time 0, with 0 < theta < pi.
    omega : sequence of three float, str or mpf
        Angular velocity along the fixed axes.

    Returns
    -------
    SphereState

    Raises
    ------
    ValueError
        If the body's axis comes so close to the vertical (0.01 rad) that the angles lose their meaning.
    """
    with mp.workdps(DIGITS + 10):
        t, r, x, y, psi, theta, phi = map(mp.mpf, (t, r, x, y, psi, theta, phi))
        omega = tuple(map(mp.mpf, omega))
        lowest, highest = theta_range(psi, theta, omega)
        margin = min(lowest, mp.pi - highest)
        if margin < 0.01:
            raise ValueError(f"theta ranges over [{mp.nstr(lowest, 5)}, {mp.nstr(highest, 5)}]")
        # |psi'| and |phi'| are at most |omega| (1 + 1/sin theta): no angle turns by more than 1 per sample.
        samples = int(mp.ceil(abs(t) * mp.norm(omega) * (1 + 1 / mp.sin(margin)))) + 1
        start = euler_rotation(psi, theta, phi)
        for k in range(1, samples + 1):
            rotation = spin(omega, t * k / samples) * start
            psi, theta, phi = _angles(rotation, psi, phi)
        x += r * omega[1] * t
        y -= r * omega[0] * t
        rates = (r * omega[1], -r * omega[0], *angle_rates(psi, theta, omega))
        return SphereState((x, y, psi, theta, phi), rates)


def theta_range(psi, theta, omega) -> tuple:
    """Return the least and the greatest value of theta over all time, as two mpf.

    The body's axis turns about omega at a constant angle beta; theta is its angle from the vertical, which is
    itself at an angle alpha from omega. So theta lies in [|alpha - beta|, pi - |pi - alpha - beta|], and over
    a full turn reaches both ends.
    """
    omega = tuple(map(mp.mpf, omega))
    axis = mp.sin(psi) * mp.sin(theta), -mp.cos(psi) * mp.sin(theta), mp.cos(theta)
    size = mp.norm(omega)
    alpha = mp.acos(omega[2] / size)
    beta = mp.acos(mp.fdot(omega, axis) / size)
    return abs(alpha - beta), mp.pi - abs(mp.pi - alpha - beta)


def euler_rotation(psi, theta, phi) -> mp.matrix:
    """Return Rz(psi) Rx(theta) Rz(phi), a 3 x 3 matrix whose columns are the body's axes."""
    return spin((0, 0, 1), psi) * spin((1, 0, 0), theta) * spin((0, 0, 1), phi)


def spin(omega, t) -> mp.matrix:
    """Return the rotation exp(t [omega]) by Rodrigues' formula, a 3 x 3 matrix."""
    size = mp.norm(omega)
    if not size:
        return mp.eye(3)
    a, b, c = (component / size for component in omega)
    K = mp.matrix([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    angle = size * t
    return mp.eye(3) + mp.sin(angle) * K + (1 - mp.cos(angle)) * K * K


def angle_rates(psi, theta, omega) -> tuple:
    """Return the rates of (psi, theta, phi) for the angular velocity omega = psi' z + theta' u + phi' z1."""
    along_u = omega[0] * mp.cos(psi) + omega[1] * mp.sin(psi)
    along_v = -omega[0] * mp.sin(psi) + omega[1] * mp.cos(psi)
    phi_dot = -along_v / mp.sin(theta)
    return omega[2] - phi_dot * mp.cos(theta), along_u, phi_dot


def spatial_angular_velocity(q, qdot) -> np.ndarray:
    """Return the angular velocity along the fixed axes from coordinates and rates, in float64.

    Parameters
    ----------
    q, qdot : ndarray, shape (..., 5)
        Coordinates and rates, in the order (x, y, psi, theta, phi).

    Returns
    -------
    ndarray, shape (..., 3)
    """
    psi, theta = q[..., 2], q[..., 3]
    psi_dot, theta_dot, phi_dot = qdot[..., 2], qdot[..., 3], qdot[..., 4]
    return np.stack(
        [
            theta_dot * np.cos(psi) + phi_dot * np.sin(theta) * np.sin(psi),
            theta_dot * np.sin(psi) - phi_dot * np.sin(theta) * np.cos(psi),
            psi_dot + phi_dot * np.cos(theta),
        ],
        axis=-1,
    )


def _angles(R, psi_before, phi_before) -> tuple:
    """Return (psi, theta, phi) of the rotation `R`, psi and phi on the turn nearest to the ones before."""
    theta = mp.atan2(mp.hypot(R[0, 2], R[1, 2]), R[2, 2])
    psi = mp.atan2(R[0, 2], -R[1, 2])
    phi = mp.atan2(R[2, 0], R[2, 1])
    return _nearest_turn(psi, psi_before), theta, _nearest_turn(phi, phi_before)


def _nearest_turn(angle, before):
    return angle + 2 * mp.pi * mp.nint((before - angle) / (2 * mp.pi))
