"""The rolling sphere's equations from the kinetic energy printed in example 13.4.3."""

import functools

import sympy as sp

from oracles.lagrange_operator import LagrangeEquations, lagrange_equations


@functools.cache
def sphere_equations() -> LagrangeEquations:
    """Return the equations in q = (x, y, psi, theta, phi), p = (m, r), with constraints (6) and (7).

    Gravity, the only given action, has vanishing power coefficients.
    """
    q = _, _, psi, theta, _ = sp.symbols("x y psi theta phi")
    qdot = dx, dy, dpsi, dtheta, dphi = sp.symbols("x_dot y_dot psi_dot theta_dot phi_dot")
    p = m, r = sp.symbols("m r")
    spin2 = dpsi**2 + dtheta**2 + dphi**2 + 2 * dpsi * dphi * sp.cos(theta)
    T2 = m * (dx**2 + dy**2) + sp.Rational(2, 5) * m * r**2 * spin2
    rolling = [
        dx - (r * dtheta * sp.sin(psi) - r * dphi * sp.sin(theta) * sp.cos(psi)),
        dy - (-r * dtheta * sp.cos(psi) - r * dphi * sp.sin(theta) * sp.sin(psi)),
    ]
    return lagrange_equations(T2 / 2, [0] * 5, rolling, q, qdot, p)
