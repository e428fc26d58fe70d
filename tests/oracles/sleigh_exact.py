"""The closed form of the Chaplygin sleigh's motion, in 40 digits.

With ``rho^2 = I_C/m`` and ``V^2 = v0^2 + rho^2 omega0^2`` the reduced equations ``v' = b omega^2``,
``I_C omega' = -m b v omega`` (from example 13.4.6; Chaplygin 1911) have the solution

    u(t)     = u0 + b V t / rho^2,              u0 = atanh(v0 / V),
    v(t)     = V tanh u,
    omega(t) = sgn(omega0) (V / rho) sech u,
    theta(t) = theta0 + sgn(omega0) (rho / b) (gd u - gd u0),

where the difference of Gudermannians is written ``2 atan(sinh((u - u0)/2) / cosh((u + u0)/2))``, which does
not cancel for small b. The path of C is the quadrature of ``v exp(i theta)``.
"""

from dataclasses import dataclass
from typing import final

import mpmath as mp
import numpy as np

DIGITS = 40


@final
@dataclass(frozen=True)
class SleighState:
    """Configuration and quasi-velocities of the sleigh.

    Attributes
    ----------
    x, y : mpf
        Position of the contact point C.
    theta : mpf
        Angle of the blade, continuous (not reduced modulo 2 pi).
    v : mpf
        Velocity of C along the blade.
    omega : mpf
        Rate of theta.
    """

    x: mp.mpf
    y: mp.mpf
    theta: mp.mpf
    v: mp.mpf
    omega: mp.mpf

    @property
    def q(self) -> np.ndarray:
        """Coordinates (x, y, theta), shape (3,), float64."""
        return np.array([float(self.x), float(self.y), float(self.theta)])

    @property
    def qdot(self) -> np.ndarray:
        """Rates (x_dot, y_dot, theta_dot), shape (3,), float64."""
        with mp.workdps(DIGITS):
            rates = self.v * mp.cos(self.theta), self.v * mp.sin(self.theta), self.omega
        return np.array([float(rate) for rate in rates])


def sleigh_state(t, m, b, I_C, x, y, theta, v, omega) -> SleighState:
    """Return the exact state at time `t` of the sleigh that starts at time 0.

    Parameters
    ----------
    t : float, str or mpf
        Time, of either sign.
    m, b, I_C : float, str or mpf
        Mass, distance CG (of either sign, or zero), moment of inertia about C.
    x, y, theta, v, omega : float, str or mpf
        State at time 0; v and omega of either sign, or zero.

    Returns
    -------
    SleighState
        Correct to about 38 digits for moderate arguments.
    """
    with mp.workdps(DIGITS + 10):
        t, m, b, I_C, x, y, theta, v, omega = map(mp.mpf, (t, m, b, I_C, x, y, theta, v, omega))
        motion = _motion(m, b, I_C, theta, v, omega)

        def velocity(s):
            speed, _, angle = motion(s)
            return speed * mp.expj(angle)

        pieces = int(mp.ceil(abs(t))) + 1
        path = mp.quad(velocity, mp.linspace(0, t, pieces + 1), method="gauss-legendre") if t else mp.mpc(0)
        speed, rate, angle = motion(t)
        return SleighState(x + path.real, y + path.imag, angle, speed, rate)


def _motion(m, b, I_C, theta, v, omega):
    """Return the function of time t -> (v, omega, theta)."""
    if b == 0 or omega == 0:
        return lambda t: (v, omega, theta + omega * t)
    rho = mp.sqrt(I_C / m)
    V = mp.hypot(v, rho * omega)
    u0 = mp.atanh(v / V)
    sign = mp.sign(omega)

    def motion(t):
        advance = b * V * t / rho**2
        u = u0 + advance
        turn = 2 * mp.atan(mp.sinh(advance / 2) / mp.cosh((u + u0) / 2))
        return V * mp.tanh(u), sign * V / rho * mp.sech(u), theta + sign * rho / b * turn

    return motion
